"""The geometry that the enclosures and openings of a scene share: loops of rings and surfaces of
films.

Two chambers may share a film, and a chamber and an orifice may share a ring.  Each is evaluated
once in an iteration, whoever uses it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from dolfinx import fem

from gossamer_fx.core.model.body import Body
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.gas.ring import Loop, Ring
from gossamer_fx.mechanics.gas.surface import FilmSurface
from gossamer_fx.mechanics.terms.assembly import Assembly


class Moving(Protocol):
    """A geometry that is evaluated once in an iteration."""

    def follow(self) -> None:
        """Evaluate it at the end of the step, `system.q1`."""
        ...

    def accept(self) -> None:
        """Make the end of this step the start of the next."""
        ...


class Geometry:
    """Loops, surfaces and pistons of a running scene, each of them once.

    Args:
        system: the compiled scene.
    """

    def __init__(self, system: Assembly) -> None:
        self.comm = system.comm
        self._system = system
        self._loops: dict[Ring, Loop] = {}
        self._surfaces: dict[Membrane, FilmSurface] = {}
        self._others: list[Moving] = []

    def loop(self, ring: Ring) -> Loop:
        """The loop of a ring, created on the first call.  Collective."""
        if ring not in self._loops:
            self._loops[ring] = Loop(ring, self._system)
        return self._loops[ring]

    def surface(self, film: Membrane) -> FilmSurface:
        """The surface of a film, created on the first call."""
        if film not in self._surfaces:
            self._surfaces[film] = FilmSurface(film, self._system)
        return self._surfaces[film]

    def add(self, moving: Moving) -> None:
        """Register another geometry, e.g. a piston, that `follow` and `accept` shall call."""
        self._others.append(moving)

    def follow(self) -> None:
        """Evaluate all geometries at the end of the step.  Collective."""
        for moving in self._all():
            moving.follow()

    def accept(self) -> None:
        """Make the end of this step the start of the next."""
        for moving in self._all():
            moving.accept()

    def tangents(self, body: Body) -> Iterable[fem.Form]:
        """Bilinear forms of the derivative of all pressure forces on a film.

        The derivatives on the strips of loops are missing: no form gives them, see
        `Loop.add_tangent`.
        """
        for film, surface in self._surfaces.items():
            if film is body:
                yield from surface.tangents()

    def _all(self) -> list[Moving]:
        # Loops come first: surfaces add the volumes of their strips.
        return [*self._loops.values(), *self._surfaces.values(), *self._others]
