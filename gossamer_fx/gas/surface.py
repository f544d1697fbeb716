"""A film that bounds chambers: the volumes of all of them and their gradients, from one form."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la
from mpi4py import MPI

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.forms.compilation import compile_form
from gossamer_fx.forms.kinematics import area_vector
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.gas.ring import Loop
from gossamer_fx.model.body import Array
from gossamer_fx.terms.assembly import Assembly

Cells = npt.NDArray[np.int32]


@dataclass
class Side:
    """What bounds one chamber: owned cells of the film, and loops with the signs that close it."""

    cells: Cells
    loops: list[Loop]
    signs: list[float]
    first: Array = field(default_factory=lambda: np.zeros(0))  # G at q0, owned part


class FilmSurface:
    """Integrals over a film for the chambers that it bounds: G_c[w] = ∫n·w dA, n the deformed area vector.

    A linear form with discontinuous test functions gives them triangle by triangle; sums over the triangles and loops
    of a chamber c give its G_c.  V = ⅓∫x·n dA is homogeneous of degree three, so V_c = ⅓ G_c(q)·q, and G_c quadratic.
    However many chambers there are, an iteration assembles this form twice and one tangent.

    Attributes:
        pressures: (chambers,) on the cells of each chamber, along their normals [Pa].
    """

    def __init__(self, film: Membrane, system: Assembly) -> None:
        self.film, self._comm, self._sides = film, film.comm, list[Side]()
        self._at = system.fields[film]
        self._owned = system.block(film).owned
        self._n = system.numbering.size_local
        self._α = system.rule.alpha
        self._form: fem.Form | None = None

    def add(self, side: Side) -> int:
        """Register what bounds a chamber; returns its place in the results.  Before the first `follow`."""
        self._sides.append(side)
        self.pressures = np.zeros(len(self._sides))
        return len(self._sides) - 1

    def _compile(self) -> None:
        film, domain = self.film, self.film.mesh.domain
        cells = np.unique(np.concatenate([side.cells for side in self._sides]))
        whole = self._comm.allreduce(
            len(cells) == domain.topology.index_map(2).size_local, op=MPI.LAND
        )
        restricted = {} if whole else {"subdomain_data": [(1, cells)], "subdomain_id": 1}
        degree = 2 * (film.order - 1) + film.order
        dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": degree}, **restricted)
        broken = fem.functionspace(domain, ("Discontinuous Lagrange", film.order, (3,)))
        self._x = fem.Function(film.space)
        self._pressure = fem.Function(fem.functionspace(domain, ("Discontinuous Lagrange", 0)))

        def flux(x: Any, w: Any) -> Any:
            return ufl.dot(area_vector(film.deformation(x)), w)

        self._form = compile_form(flux(self._x, ufl.TestFunction(broken)) * dx)
        load = -self._pressure * flux(self._at.mid, self._at.w) * dx
        self._tangent = compile_form(ufl.derivative(load, self._at.q1, self._at.dq))
        index_map = broken.dofmap.index_map
        self._parts = np.zeros(3 * (index_map.size_local + index_map.num_ghosts))
        self._collect(broken)
        self._vector = la.vector(film.block.index_map, 3)
        self._mid: Array = np.zeros((len(self._nodes), 3))  # gradients at q̄ and q1
        self._end: Array = self._mid
        self._V0: Array = np.zeros(len(self._sides))

    def _collect(self, broken: fem.FunctionSpace) -> None:
        """The sum over the cells of each chamber, node by node, as a sparse matrix; the nodes of one after another."""
        from scipy.sparse import csr_matrix

        nodes, rows, columns, self._starts = [], [], [], [0]
        for side in self._sides:
            own, places = np.unique(cell_nodes(self.film.space)[side.cells], return_inverse=True)
            nodes.append(own)
            rows.append(places.ravel() + self._starts[-1])
            columns.append(cell_nodes(broken)[side.cells].ravel())
            self._starts.append(self._starts[-1] + len(own))
        self._nodes = np.concatenate(nodes)
        entries = (np.concatenate(rows), np.concatenate(columns))
        shape = self._starts[-1], len(self._parts) // 3
        self._sum = csr_matrix((np.ones(len(entries[0])), entries), shape=shape)

    # ---- the step ----------------------------------------------------------------------------------------------------

    def follow(self) -> None:
        """Take the end of the step from the system; the loops have followed."""
        if self._form is None:
            self._compile()
        q0, q1 = (f.x.array.reshape(-1, 3)[self._nodes] for f in (self._at.q0, self._at.q1))
        self._end = self._gradient(1.0)
        self._mid = self._end if self._α == 1.0 else self._gradient(self._α)
        terms, works = self._end * q1, self._mid * (q1 - q0)
        local = np.zeros((len(self._sides), 3))
        for c, side in enumerate(self._sides):
            here = slice(self._starts[c], self._starts[c + 1])
            local[c] = terms[here].sum(), abs(terms[here]).sum(), works[here].sum()
            if self._comm.rank == 0:  # every rank has all of a loop
                shares = [
                    loop.products() * (sign, 1.0, sign)
                    for loop, sign in zip(side.loops, side.signs, strict=True)
                ]
                local[c] += np.sum(shares, axis=0) if shares else 0.0
        self._comm.Allreduce(MPI.IN_PLACE, local, op=MPI.SUM)
        self.volume: Array = local[:, 0] / 3
        self.magnitude: Array = local[:, 1]
        self.swept: Array = local[:, 2] if self._α == 0.5 else self.volume - self._V0

    def accept(self) -> None:
        """The end of this step is the start of the next."""
        self._V0 = self.volume
        for c, side in enumerate(self._sides):
            side.first = self._at_end(c)

    def _gradient(self, share: float) -> Array:
        """G at (1 - share) q0 + share q1, at the nodes of each chamber: this rank's cells only."""
        q0, q1 = self._at.q0.x.array, self._at.q1.x.array
        self._x.x.array[:] = q1 if share == 1.0 else (1 - share) * q0 + share * q1
        self._parts[:] = 0
        fem.assemble_vector(self._parts, self._form)
        G: Array = self._sum @ self._parts.reshape(-1, 3)
        return G

    # ---- one chamber -------------------------------------------------------------------------------------------------

    def add_force(self, c: int, values: Array) -> None:
        """Subtract the force of chamber c, pressure · G_c(q_mid) [N], from the owned part of a system vector."""
        values[self._owned] -= self.pressures[c] * self._at_middle(c)

    def gradients(self, c: int) -> tuple[Array, Array, Array]:
        """G_c(q̄), ∂V_c/∂q1, ∂W_c/∂q1, owned parts of system vectors.

        As G is quadratic, ∂W/∂q1 = G(q̄) + α (G(q1) - G(q0)) for the midpoint α = ½.
        """
        mid, end = self._at_middle(c), self._at_end(c)
        work = mid + self._α * (end - self._sides[c].first) if self._α == 0.5 else end
        result = []
        for part in (mid, end, work):
            vector = np.zeros(self._n)
            vector[self._owned] = part
            result.append(vector)
        return result[0], result[1], result[2]

    def _at_middle(self, c: int) -> Array:
        """G_c(q̄), owned part."""
        return self._spread(c, self._mid, [loop.gradients[0] for loop in self._sides[c].loops])

    def _at_end(self, c: int) -> Array:
        """G_c(q1), owned part."""
        return self._spread(c, self._end, [loop.gradients[1] for loop in self._sides[c].loops])

    def _spread(self, c: int, G: Array, rims: list[Array]) -> Array:
        """Sum of all ranks of a gradient at the nodes of a chamber and at those of its loops; the owned part."""
        here = slice(self._starts[c], self._starts[c + 1])
        values = self._vector.array
        values[:] = 0
        values.reshape(-1, 3)[self._nodes[here]] = G[here]
        self._vector.scatter_reverse(la.InsertMode.add)
        total: Array = values[: self._owned.stop - self._owned.start].copy()
        side = self._sides[c]
        for loop, sign, rim in zip(side.loops, side.signs, rims, strict=True):
            loop.add_own(total, self._owned.start, sign * rim)
        return total

    def tangents(self) -> Iterable[fem.Form]:
        """Derivative of the forces of all chambers at their `pressures`, except those of the loops."""
        pressure = self._pressure.x.array
        pressure[:] = 0
        dofs = cell_nodes(self._pressure.function_space)[:, 0]
        for side, acting in zip(self._sides, self.pressures, strict=True):
            pressure[dofs[side.cells]] += acting
        yield self._tangent
