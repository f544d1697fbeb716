"""Geometry that enclosures and openings of a scene share: surfaces, pistons, areas of openings."""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.state import HasSystem
from gossamer_fx.mechanics.gas.film_area import CompiledFilmArea, FilmArea
from gossamer_fx.mechanics.gas.patches import ChamberSurfaces, Moving
from gossamer_fx.mechanics.gas.ring import Loop, Ring
from gossamer_fx.mechanics.terms.assembly import Assembly

# The area of an opening that moves with bodies, taken at the middle of the coming step.
MovingArea = Loop | CompiledFilmArea


@dataclass
class SeenSystem:
    """What functions of the user see of a system."""

    unknowns: Assembly


@dataclass
class InStep(HasSystem):
    """A scene at the start of a step as a run, for functions of the user: probes read
    `run.system.unknowns`."""

    system: SeenSystem


class Geometry:
    """Surfaces of chambers, loops, areas and pistons of a running scene, each of them once: a
    chamber and an orifice may share a ring.

    Attributes:
        surfaces: of all chambers that films bound.
    """

    def __init__(self, system: Assembly) -> None:
        self.comm = system.comm
        self.system = system
        self.surfaces = ChamberSurfaces(system)
        self._loops: dict[Ring, Loop] = {}
        self._areas: dict[FilmArea, MovingArea] = {}
        self._moving: list[Moving] = []

    def loop(self, ring: Ring) -> Loop:
        """The loop of a ring, created on the first call.  Collective."""
        if ring not in self._loops:
            self._loops[ring] = Loop(ring, self.system)
        return self._loops[ring]

    def area(self, area: Ring | FilmArea) -> MovingArea:
        """The area of an opening, created on the first call.  Collective."""
        if isinstance(area, Ring):
            return self.loop(area)
        if area not in self._areas:
            self._areas[area] = area.compile(self.system)
        return self._areas[area]

    def add(self, moving: Moving) -> None:
        """Register another geometry, e.g. a piston, that `follow` and `accept` shall call."""
        self._moving.append(moving)

    def compile(self) -> None:
        """Compile the surfaces, when all chambers are registered.  Collective."""
        if self.surfaces.count:
            self.surfaces.compile()
            self.add(self.surfaces)

    def follow(self) -> None:
        """Evaluate all volumes at the end of the step.  Collective."""
        for moving in self._moving:
            moving.follow()

    def accept(self) -> None:
        """Make the end of this step the start of the next."""
        for moving in self._moving:
            moving.accept()

    def add_forces(self, values: Array) -> None:
        """Subtract the forces of all surfaces and pistons [N] from the owned part of a residual."""
        for moving in self._moving:
            moving.add_forces(values)

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the derivative of the forces of all surfaces to the tangent of the system."""
        if self.surfaces.count:
            self.surfaces.add_tangents(A)
