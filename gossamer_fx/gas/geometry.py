"""What the enclosures and openings of a running scene share: loops of rings, surfaces of films."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from dolfinx import fem

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.gas.ring import Loop, Ring
from gossamer_fx.gas.surface import FilmSurface
from gossamer_fx.model.body import Body
from gossamer_fx.terms.assembly import Assembly


class Moving(Protocol):
    """Something that is evaluated once in an iteration, whoever uses it."""

    def follow(self) -> None:
        """Take the end of the step from the system."""
        ...

    def accept(self) -> None:
        """The end of this step is the start of the next."""
        ...


class Geometry:
    """Each ring and each film once, though two chambers and an orifice may share them."""

    def __init__(self, system: Assembly) -> None:
        self.comm = system.comm
        self._system = system
        self._loops: dict[Ring, Loop] = {}
        self._surfaces: dict[Membrane, FilmSurface] = {}
        self._others: list[Moving] = []

    def loop(self, ring: Ring) -> Loop:
        """The loop of a ring, made when it is first asked for."""
        if ring not in self._loops:
            self._loops[ring] = Loop(ring, self._system)
        return self._loops[ring]

    def surface(self, film: Membrane) -> FilmSurface:
        """The surface of a film, made when it is first asked for."""
        if film not in self._surfaces:
            self._surfaces[film] = FilmSurface(film, self._system)
        return self._surfaces[film]

    def add(self, moving: Moving) -> None:
        """Let something else follow the iteration."""
        self._others.append(moving)

    def follow(self) -> None:
        """Take the end of the step from the system: loops first, which surfaces need."""
        for moving in self._all():
            moving.follow()

    def accept(self) -> None:
        """The end of this step is the start of the next."""
        for moving in self._all():
            moving.accept()

    def tangents(self, body: Body) -> Iterable[fem.Form]:
        """Derivative of the pressure forces of all chambers on a film, as far as forms give it."""
        for film, surface in self._surfaces.items():
            if film is body:
                yield from surface.tangents()

    def _all(self) -> list[Moving]:
        return [*self._loops.values(), *self._surfaces.values(), *self._others]
