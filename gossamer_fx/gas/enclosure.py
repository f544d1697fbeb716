"""Volumes that bodies enclose, as functions V(q) with gradient G: the pressure force is p G, its work p G·Δq."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol, runtime_checkable

import numpy as np
from petsc4py import PETSc

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check, check_on_all
from gossamer_fx.gas.geometry import Geometry
from gossamer_fx.gas.ring import Loop, Ring
from gossamer_fx.gas.surface import FilmSurface, Side
from gossamer_fx.model.body import Array, Port
from gossamer_fx.model.ports import unit
from gossamer_fx.terms.assembly import Assembly

ROUND_OFF = 1e-12  # of the sum of its terms' sizes: a volume that is smaller has no sign


class CompiledEnclosure(Protocol):
    """An enclosed volume in a step from q0 to q1 with q̄ between; arrays are owned parts of the system's vectors.

    All of it is that of the last `Geometry.follow`.
    """

    @property
    def volume(self) -> float:
        """V(q1) [m³]."""
        ...

    @property
    def magnitude(self) -> float:
        """Size of the terms that add up to it, for round-off [m³]."""
        ...

    @property
    def swept(self) -> float:
        """W = G(q̄)·Δq, or ΔV if forces act at the end of the step [m³]."""
        ...

    def start(self) -> None:
        """Take q1 as the first state."""
        ...

    def set_pressure(self, pressure: float) -> None:
        """Choose the pressure [Pa] that acts on it in the iterate; forces and tangents are those at it."""
        ...

    def add_force(self, values: Array) -> None:
        """Subtract pressure · G(q_mid) [N] from the owned part of a system vector."""
        ...

    def gradients(self) -> tuple[Array, Array, Array]:
        """G(q̄), ∂V/∂q1, ∂W/∂q1; not to be written to."""
        ...

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the derivative of the force, except what forms of surfaces give (`Geometry.tangents`)."""
        ...


@runtime_checkable
class Enclosure(Protocol):
    """What bounds a chamber."""

    @property
    def film(self) -> Membrane | None:
        """The film that bounds it, if one does: outputs show the pressure on it."""
        ...

    @property
    def is_whole_film(self) -> bool:
        """Whether all of its film bounds the chamber, so that no other chamber may have a part of it."""
        ...

    def cells(self) -> np.ndarray:
        """Local cells (owned and ghost) of its film that bound the chamber."""
        ...

    def requires(self) -> Iterable[Any]: ...

    def compile(self, system: Assembly, geometry: Geometry) -> CompiledEnclosure:
        """In a running scene; what is evaluated once for all enclosures of a scene is in its geometry."""
        ...


class FilmEnclosure:
    """The volume inside a film and the strips over its rings: V = ⅓∫x·n dA, n the deformed area vector.

    Normals may all point inwards: then they are turned, at the start.  Of a film that is flat but for round-off, those
    of the mesh are outwards.
    """

    def __init__(
        self, film: Membrane, surface: tuple[str, ...], rings: tuple[Ring, ...], chamber: str
    ) -> None:
        self._film = film
        self.surface = surface
        self.rings = rings
        self.chamber = chamber
        odd = next((r.edges for r in rings if r.body is not film), None)
        check(
            odd is None,
            f"Chamber '{chamber}': its ring '{odd}' is on another film than '{film.name}'.",
        )

    @property
    def film(self) -> Membrane:
        """The film that bounds the chamber."""
        return self._film

    @property
    def is_whole_film(self) -> bool:
        """Whether all of the film bounds the chamber."""
        return not self.surface

    def requires(self) -> Iterable[Any]:
        yield self.film

    def compile(self, system: Assembly, geometry: Geometry) -> CompiledEnclosure:
        loops, cells = [geometry.loop(ring) for ring in self.rings], self.cells()
        signs = self.check_closed(cells, loops)
        owned = cells[cells < self.film.mesh.domain.topology.index_map(2).size_local]
        return _CompiledFilm(geometry.surface(self.film), Side(owned, loops, signs))

    def cells(self) -> np.ndarray:
        """Local cells (owned and ghost) of the bounding surface."""
        topology = self.film.mesh.domain.topology
        if not self.surface:
            index_map = topology.index_map(2)
            return np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        groups = [self.film.mesh.group(name) for name in self.surface]
        check(
            all(dim == 2 for dim, _ in groups),
            f"Chamber '{self.chamber}': its surface {self.surface} must be named groups of triangles.",
        )
        return np.unique(np.concatenate([cells for _, cells in groups]))

    def check_closed(self, cells: np.ndarray, loops: list[Loop]) -> list[float]:
        """The signs with which strips over the loops close the surface.

        Every edge then has two triangles that pass it in opposite directions.

        Raises:
            InputError: open edges, rings inside, or triangles of inconsistent orientation.
        """
        comm, table = self.film.comm, self.film.mesh.edges
        count, sum_of_directions = table.tally(cells)
        open_edges = np.flatnonzero(count == 1)
        names = table.ends[open_edges]
        signs = []
        for ring, loop in zip(self.rings, loops, strict=True):
            passed = loop.direction(names)
            film = passed * sum_of_directions[open_edges]
            found, film_direction = comm.allreduce(np.array([np.count_nonzero(passed), film.sum()]))
            check(
                found == len(loop.vertices),
                f"Chamber '{self.chamber}': its ring '{ring.edges}' is no border of its surface; give the groups of "
                "triangles on one side of it.",
            )
            signs.append(-float(np.sign(film_direction)))
            spanned = open_edges[passed != 0]
            count[spanned] += 1
            sum_of_directions[spanned] += signs[-1] * passed[passed != 0]
        check_on_all(
            comm,
            bool(((count == 0) | (count == 2)).all()),
            f"Chamber '{self.chamber}': the surface of '{self.film.name}' is open; close it, name the groups of "
            "triangles that bound the chamber, or span holes by rings.",
        )
        check_on_all(
            comm,
            bool((sum_of_directions == 0).all()),
            f"Chamber '{self.chamber}': neighbouring triangles of '{self.film.name}' have opposite normals; orient the "
            "surface consistently (gmsh: model.mesh.reverse).",
        )
        return signs


class _CompiledFilm:
    def __init__(self, surface: FilmSurface, side: Side) -> None:
        self._surface, self._side, self._place = surface, side, surface.add(side)
        self._sign = 1.0  # -1: all normals point inwards

    @property
    def volume(self) -> float:
        return self._sign * float(self._surface.volume[self._place])

    @property
    def magnitude(self) -> float:
        return float(self._surface.magnitude[self._place])

    @property
    def swept(self) -> float:
        return self._sign * float(self._surface.swept[self._place])

    def start(self) -> None:
        self._sign = (
            -1.0 if self._surface.volume[self._place] < -ROUND_OFF * self.magnitude else 1.0
        )

    def set_pressure(self, pressure: float) -> None:
        self._surface.pressures[self._place] = self._sign * pressure

    def add_force(self, values: Array) -> None:
        self._surface.add_force(self._place, values)

    def gradients(self) -> tuple[Array, Array, Array]:
        mid, end, work = self._surface.gradients(self._place)
        return self._sign * mid, self._sign * end, self._sign * work

    def add_tangents(self, A: PETSc.Mat) -> None:
        pressure = self._surface.pressures[self._place]
        for loop, sign in zip(self._side.loops, self._side.signs, strict=True):
            loop.add_tangent(A, -sign * pressure)


@check_arguments
class Piston:
    """The volume A n·(x - x0) that a port sweeps from its initial position x0.

    Args:
        port: a point of a body.
        area: A [m²].
        direction: n, the direction in which the volume grows.
    """

    def __init__(self, port: Port, area: float, *, direction: tuple[float, float, float]) -> None:
        check(area > 0, f"Piston: area is {area!r} m²; give a positive number.")
        check(
            any(direction), "Piston: direction has no length; give the axis along which it moves."
        )
        self.port = port
        self.area = area
        self.direction = unit(direction)

    @property
    def film(self) -> None:
        """A piston is not a film."""
        return None

    @property
    def is_whole_film(self) -> bool:
        """A piston is not a film."""
        return False

    def cells(self) -> np.ndarray:
        """No cells: a piston is not a film."""
        return np.zeros(0, dtype=np.int32)

    def requires(self) -> Iterable[Any]:
        yield self.port.body

    def compile(self, system: Assembly, geometry: Geometry) -> CompiledEnclosure:
        """In a running scene."""
        compiled = _CompiledPiston(self, system)
        geometry.add(compiled)
        return compiled


class _CompiledPiston:
    def __init__(self, piston: Piston, system: Assembly) -> None:
        self._system = system
        indices = system.block(piston.port.body).to_global(np.array(piston.port.nodes))[:, :3]
        entries = np.outer(piston.port.weights, piston.area * piston.direction)
        start, end = system.q0.getOwnershipRange()
        self._G = np.zeros(end - start)
        mine = (indices >= start) & (indices < end)
        np.add.at(self._G, indices[mine] - start, entries[mine])
        self._origin = 0.0
        self._pressure = 0.0

    def start(self) -> None:
        self._origin = self._along(self._system.q1.array_r)
        self.follow()

    def _along(self, values: Array) -> float:
        return float(self._system.comm.allreduce(float(self._G @ values)))

    def follow(self) -> None:
        end, start = self._along(self._system.q1.array_r), self._along(self._system.q0.array_r)
        self.volume, self.magnitude, self.swept = (
            end - self._origin,
            abs(end) + abs(self._origin),
            end - start,
        )

    def set_pressure(self, pressure: float) -> None:
        self._pressure = pressure

    def add_force(self, values: Array) -> None:
        values -= self._pressure * self._G

    def gradients(self) -> tuple[Array, Array, Array]:
        return self._G, self._G, self._G

    def add_tangents(self, A: PETSc.Mat) -> None:
        pass

    def accept(self) -> None:
        pass
