"""Volumes that bodies enclose, as functions V(q) with gradient G: the pressure force is p G, its work p G·Δq."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
import ufl
from dolfinx import fem, la
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.errors import check, check_on_all
from gossamer_fx.forms.compilation import compile_form, constant
from gossamer_fx.forms.kinematics import area_vector
from gossamer_fx.gas.ring import Loop, Loops, Ring
from gossamer_fx.model.ports import unit
from gossamer_fx.model.terms import Array, Assembly, Body, Port


class CompiledEnclosure(Protocol):
    """An enclosed volume in a step from q0 to q1 with q̄ between; arrays are owned parts of the system's vectors."""

    volume: float  # V(q1) [m³]
    magnitude: float  # size of the terms that add up to it, for round-off [m³]
    swept: float  # W = G(q̄)·Δq, or ΔV if forces act at the end of the step [m³]

    def start(self) -> None:
        """Take q1 as the first state."""
        ...

    def evaluate(self) -> None:
        """Bring the above and the gradients up to date with q1."""
        ...

    def add_force(self, values: Array, pressure: float) -> None:
        """values -= pressure G(q̄)."""
        ...

    def gradients(self) -> tuple[Array, Array, Array]:
        """G(q̄), ∂V/∂q1, ∂W/∂q1."""
        ...

    def tangents(self, body: Body) -> Iterable[fem.Form]:
        """Derivative of the force of the last `add_force`, as far as it is made of forms."""
        ...

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the rest of that derivative."""
        ...

    def accept(self) -> None:
        """q1 is the start of the next step."""
        ...


class Enclosure(Protocol):
    """What bounds a chamber."""

    def requires(self) -> Iterable[Any]: ...

    def compile(self, system: Assembly, loops: Loops) -> CompiledEnclosure:
        """In a running scene, with the loops of its rings, which its owner moves along."""
        ...


class FilmEnclosure:
    """The volume inside a film and the fans over its rings: V = ⅓∫x·n dA, G[w] = ∫n·w dA, n the deformed area vector.

    V is homogeneous of degree three, so V = ⅓ G(q)·q; and as G is quadratic, ∂W/∂q1 = G(q̄) + α (G(q1) - G(q0))
    for the midpoint α = ½: one linear form gives all.
    """

    def __init__(self, film: Membrane, surface: tuple[str, ...], rings: tuple[Ring, ...], chamber: str) -> None:
        self.film, self.surface, self.rings, self.chamber = film, surface, rings, chamber
        odd = next((r.edges for r in rings if r.film is not film), None)
        check(odd is None, f"Chamber '{chamber}': its ring '{odd}' is on another film than '{film.name}'.")

    def requires(self) -> Iterable[Any]:
        yield self.film

    def compile(self, system: Assembly, loops: Loops) -> CompiledEnclosure:
        return _CompiledFilm(self, system, [loops.of(ring) for ring in self.rings])

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
        """The signs with which fans over the loops close the surface.

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
    def __init__(self, enclosure: FilmEnclosure, system: Assembly, loops: list[Loop]) -> None:
        film, cells = enclosure.film, enclosure.cells()
        self._loops, self._signs = loops, enclosure.check_closed(cells, loops)
        self._film, self._comm = film, film.comm
        k = system.bodies.index(film)
        self._at, self._owned, self._n = system.fields[k], system.numbering.owned(k), system.numbering.size_local
        self._x = fem.Function(film.space)
        self._p = constant(film.space.mesh, 0.0)
        degree = 2 * (film.order - 1) + film.order
        owned_cells = cells[cells < film.mesh.domain.topology.index_map(2).size_local]
        whole = film.mesh.domain.topology.index_map(2).size_local == len(owned_cells)
        whole = film.comm.allreduce(whole, op=MPI.LAND)
        dx = ufl.Measure(
            "dx",
            film.mesh.domain,
            metadata={"quadrature_degree": degree},
            **({} if whole else {"subdomain_data": [(1, owned_cells)], "subdomain_id": 1}),
        )

        def gradient(x: Any, w: Any) -> Any:
            return ufl.dot(area_vector(film.deformation(x)), w) * dx

        self._form = compile_form(gradient(self._x, self._at.w))
        self._tangent = compile_form(
            -self._p * ufl.derivative(gradient(self._at.mid, self._at.w), self._at.q1, self._at.dq)
        )
        self._vector = la.vector(film.block.index_map, 3)
        self._α = system.rule.alpha
        self._sign = 1.0

    def start(self) -> None:
        G = self._gradient(1.0)
        if self._comm.allreduce(float(G @ self._q(self._at.q1))) < 0:
            self._sign = -1.0  # all normals point inwards
        self._G0: Array = self._sign * G
        self._V0 = 0.0
        self.evaluate()
        self._V0 = self.volume

    def _q(self, f: fem.Function) -> Array:
        array: Array = f.x.array[: self._owned.stop - self._owned.start]
        return array

    def _gradient(self, share: float) -> Array:
        """G at (1 - share) q0 + share q1."""
        self._x.x.array[:] = (1 - share) * self._at.q0.x.array + share * self._at.q1.x.array
        self._vector.array[:] = 0
        fem.assemble_vector(self._vector.array, self._form)
        self._vector.scatter_reverse(la.InsertMode.add)
        G: Array = self._vector.array[: self._owned.stop - self._owned.start].copy()
        for loop, sign in zip(self._loops, self._signs, strict=True):
            loop.add_own(G, self._owned.start, sign * loop.gradient(share))
        return self._sign * G

    def evaluate(self) -> None:
        self._Gm, self._G1 = self._gradient(self._α), self._gradient(1.0)
        products = self._G1 * self._q(self._at.q1) / 3
        Δq = self._q(self._at.q1) - self._q(self._at.q0)
        local = np.array([products.sum(), abs(products).sum(), self._Gm @ Δq])
        self.volume, self.magnitude, swept = self._comm.allreduce(local).tolist()
        self.swept = swept if self._α == 0.5 else self.volume - self._V0

    def add_force(self, values: Array, pressure: float) -> None:
        self._p.value = pressure * self._sign
        values[self._owned] -= pressure * self._Gm

    def gradients(self) -> tuple[Array, Array, Array]:
        dW = self._Gm + self._α * (self._G1 - self._G0) if self._α == 0.5 else self._G1
        parts = self._Gm, self._G1, dW
        result = tuple(np.zeros(self._n) for _ in parts)
        for vector, part in zip(result, parts, strict=True):
            vector[self._owned] = part
        return result  # type: ignore[return-value]

    def tangents(self, body: Body) -> Iterable[fem.Form]:
        if body is self._film:
            yield self._tangent

    def add_tangents(self, A: PETSc.Mat) -> None:
        for loop, sign in zip(self._loops, self._signs, strict=True):
            loop.add_tangent(A, -sign * float(self._p.value), self._α)

    def accept(self) -> None:
        self._G0, self._V0 = self._G1, self.volume


class Piston:
    """The volume A n·(x - x0) that a port sweeps from its initial position x0.

    Args:
        port: a point of a body.
        area: A [m²].
        direction: n, the direction in which the volume grows.
    """

    def __init__(self, port: Port, area: float, direction: tuple[float, float, float]) -> None:
        check(area > 0, f"Piston: area is {area!r} m²; give a positive number.")
        check(any(direction), "Piston: direction has no length; give the axis along which it moves.")
        self.port, self.area, self.direction = port, area, unit(direction)

    def requires(self) -> Iterable[Any]:
        yield self.port.body

    def compile(self, system: Assembly, loops: Loops) -> CompiledEnclosure:
        return _CompiledPiston(self, system)


class _CompiledPiston:
    def __init__(self, piston: Piston, system: Assembly) -> None:
        self._system = system
        k = system.bodies.index(piston.port.body)
        indices = system.numbering.to_global(k, np.array(piston.port.nodes, dtype=np.int64))[:, :3]
        entries = np.outer(piston.port.weights, piston.area * piston.direction)
        start, end = system.q0.getOwnershipRange()
        self._G = np.zeros(end - start)
        mine = (indices >= start) & (indices < end)
        np.add.at(self._G, indices[mine] - start, entries[mine])

    def start(self) -> None:
        self._origin = self._along(self._system.q1.array_r)
        self.volume, self.magnitude, self.swept = 0.0, abs(self._origin), 0.0

    def _along(self, values: Array) -> float:
        return float(self._system.comm.allreduce(float(self._G @ values)))

    def evaluate(self) -> None:
        end, start = self._along(self._system.q1.array_r), self._along(self._system.q0.array_r)
        self.volume, self.magnitude, self.swept = end - self._origin, abs(end) + abs(self._origin), end - start

    def add_force(self, values: Array, pressure: float) -> None:
        values -= pressure * self._G

    def gradients(self) -> tuple[Array, Array, Array]:
        return self._G, self._G, self._G

    def tangents(self, body: Body) -> Iterable[fem.Form]:
        return ()

    def add_tangents(self, A: PETSc.Mat) -> None:
        pass

    def accept(self) -> None:
        pass
