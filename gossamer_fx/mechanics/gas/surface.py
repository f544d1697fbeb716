"""The surface of a film that bounds one or more chambers: volumes, gradients, forces and tangent.

For chamber c with the deformed area vector n dA of its part of the film and the strips of its
rings:

    G_c[w] = ∫ n·w dA                  gradient of the volume, quadratic in x              (1)
    V_c = ⅓ ∫ x·n dA = ⅓ G_c(q)·q      since the volume is homogeneous of degree three     (2)
    W_c = G_c(q̄)·(q1 - q0)            swept volume, for the midpoint rule                 (3)
    ∂W_c/∂q1 = G_c(q̄) + α (G_c(q1) - G_c(q0))      since G_c is quadratic, for α = ½     (4)

Algorithm.  In every iteration:

1. One linear form with discontinuous test functions gives (1) triangle by triangle, at q̄ and at
   q1.
2. The triangles of each chamber are summed node by node, and the strips of its rings are added.
3. Products with positions, summed over ranks, give (2) and (3).
4. `add_force` adds pressure · G_c(q̄); one bilinear form gives the tangent of all chambers.

Cost: two assemblies of a vector and one of a matrix in an iteration, however many chambers share
the film.  A form for each chamber would cost as many assemblies as there are chambers.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la
from mpi4py import MPI

from gossamer_fx.core.forms.backend import add_to_vector, cell_nodes
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.forms.kinematics import area_vector
from gossamer_fx.core.model.body import Array, Body
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.gas.ring import Loop, Ring
from gossamer_fx.mechanics.terms.assembly import Assembly

Cells = npt.NDArray[np.int32]


@dataclass
class Side:
    """What bounds one chamber: owned triangles of the film, and loops with strips of triangles that
    close it; `signs`, +1 or -1, make the normals of the strips agree with those of the film."""

    cells: Cells
    loops: list[Loop]
    signs: list[float]


class FilmSurface:
    """Volumes of all chambers that a film bounds, with gradients, forces and tangent.

    Attributes:
        pressures: pressure [Pa] of each chamber on its triangles, along their normals (chambers,).
        volume: V_c at q1 (chambers,) [m³], positive if the normals point outwards.
        magnitude: sum of the sizes of the terms of G_c(q)·q (chambers,) [m³], for round-off.
        swept: W_c (chambers,) [m³], or V_c(q1) - V_c(q0) if forces act at the end of the step.
    """

    def __init__(self, film: Membrane, system: Assembly) -> None:
        self.film = film
        self.pressures: Array = np.zeros(0)
        self._comm = film.comm
        self._sides: list[Side] = []
        self._coordinates = system.coordinates[film]
        # The owned unknowns of the film in this rank's part of a system vector
        self._owned = system.block(film).owned
        self._local_size = system.numbering.size_local
        # Weight of the end of a step in the positions where forces act: ½, or 1 at its end.
        self._alpha = system.rule.alpha
        self._acts_at_end = system.rule.acts_at_end
        self._form: fem.Form | None = None

    def add(self, side: Side) -> int:
        """Register a chamber before the first `follow`, which compiles the forms; returns its index
        in the results."""
        self._sides.append(side)
        self.pressures = np.zeros(len(self._sides))
        return len(self._sides) - 1

    def _compile(self) -> None:
        """Compile the forms of area vectors and of the pressure's tangent, and allocate the arrays.
        Collective."""
        film = self.film
        domain = film.mesh.domain
        # Area vector: 2 (order - 1); test function or position: order.
        degree = 2 * (film.order - 1) + film.order
        dx = ufl.Measure(
            "dx",
            domain,
            metadata={"quadrature_degree": degree},
            **self._restriction(),
        )
        broken = fem.functionspace(domain, ("Discontinuous Lagrange", film.order, (3,)))
        constants = fem.functionspace(domain, ("Discontinuous Lagrange", 0))
        self._x = fem.Function(film.space)
        self._pressure = fem.Function(constants)
        # One value in each triangle
        self._pressure_dofs = cell_nodes(constants)[:, 0]
        # Positions [m] of this rank's nodes, ghosts included, at the start and end of the step:
        # views of the functions' values.
        self._start: Array = self._coordinates.q0.x.array
        self._end: Array = self._coordinates.q1.x.array

        def flux(x: Any, w: Any) -> Any:
            """The integrand n·w of (1) at positions x, for a vector field w on the film."""
            return ufl.dot(area_vector(film.deformation(x)), w)

        self._form = compile_form(flux(self._x, ufl.TestFunction(broken)) * dx)
        load = -self._pressure * flux(self._coordinates.mid, self._coordinates.w) * dx
        tangent = ufl.derivative(load, self._coordinates.q1, self._coordinates.dq)
        self._tangent = compile_form(tangent)
        index_map = broken.dofmap.index_map
        self._parts = np.zeros(3 * (index_map.size_local + index_map.num_ghosts))
        self._compile_sum(broken)
        self._vector = la.vector(film.block.index_map, 3)
        # Owned parts (chambers, unknowns) [m²] of G_c(q̄), G_c(q1) and G_c(q0), strips included
        self._at_mid: Array = np.zeros((len(self._sides), self._owned.stop - self._owned.start))
        self._at_end: Array = self._at_mid
        self._at_start: Array = self._at_mid
        self._initial_volume: Array = np.zeros(len(self._sides))

    def _restriction(self) -> dict[str, Any]:
        """`subdomain_data` and `subdomain_id` of a UFL measure on the triangles that bound the
        chambers of a film; empty if they use the whole film.  Collective."""
        of_sides = [side.cells for side in self._sides]
        cells = np.unique(np.concatenate(of_sides))
        owned = self.film.mesh.domain.topology.index_map(2).size_local
        whole = self._comm.allreduce(len(cells) == owned, op=MPI.LAND)
        if whole:
            return {}
        return {"subdomain_data": [(1, cells)], "subdomain_id": 1}

    def _compile_sum(self, broken: fem.FunctionSpace) -> None:
        """Prepare the sum over the triangles of each chamber, node by node.

        Its rows are the nodes of one chamber after another; a node shared by two chambers has two
        rows."""
        nodes = []
        rows = []
        columns = []
        count = 0
        for side in self._sides:
            cells_to_nodes = cell_nodes(self.film.space)[side.cells]
            own, positions = np.unique(cells_to_nodes, return_inverse=True)
            nodes.append(own)
            rows.append(positions.ravel() + count)
            columns.append(cell_nodes(broken)[side.cells].ravel())
            count += len(own)
        # Node and chamber of each row
        self._nodes = np.concatenate(nodes)
        self._chambers = np.repeat(np.arange(len(nodes)), [len(own) for own in nodes])
        all_rows = np.concatenate(rows)
        order = np.argsort(all_rows, kind="stable")
        # The corners of triangles, row after row, and where each row begins: none is empty.
        self._summands = np.concatenate(columns)[order]
        self._row_starts = np.flatnonzero(np.diff(all_rows[order], prepend=-1))

    # ---- the step --------------------------------------------------------------------------------

    def follow(self) -> None:
        """Evaluate volumes [m³] and gradients [m²] of all chambers at the end of the step, as
        iterated; the rings of the chambers have to be evaluated before.  Collective.

        `volume`, `magnitude` and `swept` are summed over all ranks.
        """
        if self._form is None:
            self._compile()
        # The end itself, without the round-off and the cost of a weighted sum.
        self._at_end = self._gradients(self._end, at=1)
        self._at_mid = self._at_end
        if not self._acts_at_end:
            middle = (1 - self._alpha) * self._start + self._alpha * self._end
            self._at_mid = self._gradients(middle, at=0)
        count = self._at_end.shape[1]
        end = self._end[:count]
        volume_terms = self._at_end * end
        swept = self._at_mid @ (end - self._start[:count])
        sums = np.stack([volume_terms.sum(axis=1), abs(volume_terms).sum(axis=1), swept])
        self._comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
        self.volume: Array = sums[0] / 3
        self.magnitude: Array = sums[1]
        self.swept: Array = sums[2]
        if self._acts_at_end:
            self.swept = self.volume - self._initial_volume

    def accept(self) -> None:
        """Make the end of this step the start of the next."""
        self._initial_volume = self.volume
        self._at_start = self._at_end

    def _gradients(self, x: Array, at: int) -> Array:
        """G_c (chambers, unknowns) [m²] of all chambers, strips of rings included, by the owned
        unknowns of the film, at the positions x [m] of this rank's nodes, ghosts included and
        flattened; `at` is the index of these positions in `Loop.gradients`.  Collective."""
        self._x.x.array[:] = x
        self._parts[:] = 0
        assert self._form is not None
        add_to_vector(self._parts, self._form)
        summands = self._parts.reshape(-1, 3)[self._summands]
        of_triangles = np.zeros((len(self._sides), len(x) // 3, 3))
        of_triangles[self._chambers, self._nodes] = np.add.reduceat(summands, self._row_starts)
        if self._comm.size > 1:
            for c in range(len(self._sides)):
                self._vector.array[:] = of_triangles[c].ravel()
                self._vector.scatter_reverse(la.InsertMode.add)
                of_triangles[c] = self._vector.array.reshape(-1, 3)
        count = self._owned.stop - self._owned.start
        found = of_triangles.reshape(len(self._sides), -1)[:, :count]
        for c, side in enumerate(self._sides):
            for loop, sign in zip(side.loops, side.signs, strict=True):
                # Every rank knows the gradients of a whole loop, and adds those of its nodes.
                loop.add_own(found[c], self._owned.start, sign * loop.gradients[at])
        return found

    # ---- one chamber -----------------------------------------------------------------------------

    def add_force(self, c: int, values: Array) -> None:
        """Subtract the force of chamber c, pressure · G_c(q̄) [N], from the owned part of a
        residual."""
        values[self._owned] -= self.pressures[c] * self._at_mid[c]

    def gradients(self, c: int) -> tuple[Array, Array, Array]:
        """Return this rank's parts of the gradients [m²] of chamber c: G_c = ∂V_c/∂q in the
        positions q̄ where forces act, which times the pressure is the force; and ∂V_c/∂q1 and
        ∂W_c/∂q1."""
        at_mid = self._at_mid[c]
        at_end = self._at_end[c]
        of_swept = at_end
        if not self._acts_at_end:
            of_swept = at_mid + self._alpha * (at_end - self._at_start[c])
        return (
            self._in_system(at_mid),
            self._in_system(at_end),
            self._in_system(of_swept),
        )

    def _in_system(self, values: Array) -> Array:
        """This rank's part of a system vector, with values at the unknowns of the film and else
        zero; the values themselves if there are no other unknowns."""
        if len(values) == self._local_size:
            return values
        vector = np.zeros(self._local_size)
        vector[self._owned] = values
        return vector

    def tangents(self) -> Iterable[fem.Form]:
        """Yield the bilinear form of the derivative of all chambers' pressure forces by the end of
        the step, but for forces on strips over rings.  The current `pressures` [Pa] add up on
        triangles that two chambers share."""
        pressure = self._pressure.x.array
        pressure[:] = 0
        for side, acting in zip(self._sides, self.pressures, strict=True):
            pressure[self._pressure_dofs[side.cells]] += acting
        yield self._tangent


# ---- geometry that enclosures and openings share -------------------------------------------------


class Moving(Protocol):
    """A geometry that is evaluated once in an iteration."""

    def follow(self) -> None:
        """Evaluate it at the end of the step, `system.q1`."""
        ...

    def accept(self) -> None:
        """Make the end of this step the start of the next."""
        ...


class MovingArea(Protocol):
    """The area of an opening that moves with bodies, taken at the middle of the coming step."""

    def aperture(self, h: float) -> float:
        """The area [m²] at q0 + ½ h v0 for a step of length h [s].  Collective."""
        ...

    def aperture_gradient(self, h: float) -> Array:
        """Derivative [m] of the area of `aperture` by positions at the start of the step, for
        `add_own`; that by v0 is ½ h times as large.  Collective."""
        ...

    def add_own(self, values: Array, start: int, gradient: Array, /) -> None:
        """Add a gradient of `aperture_gradient` to the owned unknowns of the body in `values`,
        whose first entry is unknown number `start` of this rank's part of a system vector."""
        ...


class DeformedArea(Protocol):
    """The area of a part of a body, as an item of a scene."""

    def compile(self, system: Assembly) -> MovingArea:
        """The area in a running scene.  Collective."""
        ...


class Geometry:
    """Loops, surfaces and pistons of a running scene, each of them once: two chambers may share a
    film, and a chamber and an orifice a ring."""

    def __init__(self, system: Assembly) -> None:
        self.comm = system.comm
        self.system = system
        self._loops: dict[Ring, Loop] = {}
        self._surfaces: dict[Membrane, FilmSurface] = {}
        self._areas: dict[DeformedArea, MovingArea] = {}
        self._others: list[Moving] = []

    def loop(self, ring: Ring) -> Loop:
        """The loop of a ring, created on the first call.  Collective."""
        if ring not in self._loops:
            self._loops[ring] = Loop(ring, self.system)
        return self._loops[ring]

    def area(self, area: Ring | DeformedArea) -> MovingArea:
        """The area of an opening, created on the first call.  Collective."""
        if isinstance(area, Ring):
            return self.loop(area)
        if area not in self._areas:
            self._areas[area] = area.compile(self.system)
        return self._areas[area]

    def surface(self, film: Membrane) -> FilmSurface:
        """The surface of a film, created on the first call."""
        if film not in self._surfaces:
            self._surfaces[film] = FilmSurface(film, self.system)
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
        """Bilinear forms of the derivative of all pressure forces on a film; those on the strips of
        loops are missing, see `Loop.add_tangent`."""
        for film, surface in self._surfaces.items():
            if film is body:
                yield from surface.tangents()

    def _all(self) -> list[Moving]:
        # Loops come first: surfaces add the volumes of their strips.
        return [*self._loops.values(), *self._surfaces.values(), *self._others]
