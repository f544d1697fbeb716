"""The surfaces that bound chambers: volumes, gradients, forces and tangent.

A surface consists of triangles of films and of strips that close rings and seams (`gas.ring`,
`gas.sewn`).  With the deformed area vectors n dA of chamber c:

    G_c[w] = ∫ n·w dA                  gradient of the volume, quadratic in x              (1)
    V_c = ⅓ ∫ n·x dA = ⅓ G_c(q)·q      since the volume is homogeneous of degree three     (2)
    W_c = G_c(q̄)·(q1 - q0)             swept volume, for the midpoint rule                 (3)
    ∂W_c/∂q1 = G_c(q̄) + α (G_c(q1) - G_c(q0))      since G_c is quadratic, for α = ½       (4)

The films' share of (1), and its derivative, are UFL forms.  A strip is a patch with positions
x(s, r) = Σ N_i(s, r) x_i, which C evaluates: n dA = x,s × x,r ds dr.

Algorithm.  In every iteration:

1. One call of C for all strips, and two for the triangles of a film at all chambers, give (1) at q̄
   and at q1.  Each is evaluated on one rank; shares of nodes that other ranks own are sent to them.
2. Products with positions, summed over ranks, give (2) and (3).
3. One call for all strips, and one for the triangles of a film at all chambers, give the derivative
   of the forces of all pressures, one block of numbers for each pair of nodes.  One call of PETSc
   enters the blocks in the tangent.

Cost: proportional to the number of triangles and strips.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.algebra.numbering import GlobalIndices, Numbering
from gossamer_fx.core.algebra.point_measures import FixedBlocks, Gather
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.forms.c_source import CLibrary, CStruct, c_library, check_indices
from gossamer_fx.core.forms.cell_loops import HEADER as CELLS_HEADER
from gossamer_fx.core.forms.cell_loops import CellValues, PreparedFunction, prepared_integral
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.forms.kinematics import area_vector
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.terms.assembly import Assembly

HEADER = Path(__file__).parent / "patches.h"


@dataclass(frozen=True, eq=False)
class Patches:
    """The patches of one kind that this rank evaluates.

    Attributes:
        nodes: global index of the first coordinate of each node, (n, k).
        along, across: slopes of the nodes' functions by s and by r at the quadrature points, (g, k)
            for all patches or (n, g, k) for each.
        test: values of these functions times the weight of the point.
    """

    nodes: GlobalIndices
    along: Array
    across: Array
    test: Array


@dataclass(frozen=True, eq=False)
class Triangles:
    """The triangles of a film that this rank evaluates, by their local numbers (n,)."""

    film: Membrane
    cells: npt.NDArray[np.int32]


# Part of a surface, with the sign, 1 or -1, that makes its normals agree with those of the other
# parts of a chamber
Side = tuple[Patches | Triangles, float]


@dataclass(frozen=True, eq=False)
class FilmParts:
    """The triangles of a film at all chambers, in p parts with the `chambers` (p,) and the `signs`
    (p,) of `Side`, and what adds the values of their forms to the arrays of all surfaces.

    Attributes:
        factors: of the forms, (p, 1): the sign of the normals, in the tangent times the pressure
            [Pa].
        add_at_end, add_at_mid: of linear forms, (1) at q1 and at q̄.
        add_tangent: of a bilinear form, the derivative of the negative of (1) at q̄ by q1.
    """

    factors: Array
    chambers: npt.NDArray[np.intp]
    signs: Array
    add_at_end: Callable[[], Any]
    add_at_mid: Callable[[], Any]
    add_tangent: Callable[[], Any]


def is_owned(indices: GlobalIndices, numbering: Numbering) -> npt.NDArray[np.bool_]:
    """Which of the unknowns this rank owns, by their global indices."""
    end = numbering.start + numbering.size_local
    return (numbering.start <= indices) & (indices < end)


class Moving(ABC):
    """A geometry of a gas that is evaluated once in an iteration."""

    @abstractmethod
    def follow(self) -> None:
        """Evaluate it at the end of the step, `system.q1`."""

    @abstractmethod
    def accept(self) -> None:
        """Make the end of this step the start of the next."""

    @abstractmethod
    def add_forces(self, values: Array) -> None:
        """Subtract the forces of the gas, pressure · G(q_mid) [N], from the owned part of a
        residual."""


class ChamberSurfaces(Moving):
    """The surfaces of all chambers of a scene that patches bound.

    Attributes:
        pressures: pressure [Pa] on the patches of each chamber, along their normals (chambers,).
        measures: three volumes of each chamber (3, chambers) [m³]: V_c at q1, of its sign; the sum
            of the sizes of the terms of G_c(q)·q, for round-off; and W_c, or V_c(q1) - V_c(q0) if
            forces act at the end of the step.
        at_middle, at_end: this rank's parts of G_c (chambers, n) [m²] in the positions q̄ where
            forces act, and at q1, where it is ∂V_c/∂q1.
    """

    def __init__(self, system: Assembly) -> None:
        self._system = system
        # Chamber, part of its surface and sign
        self._sides: list[tuple[int, Patches | Triangles, float]] = []
        self.count = 0

    def add(self, sides: Sequence[Side]) -> int:
        """Register a chamber before `compile`; returns its index in the results."""
        self._sides += [(self.count, part, sign) for part, sign in sides]
        self.count += 1
        return self.count - 1

    def compile(self) -> None:
        """Number the nodes of all surfaces, compile the forms and allocate the arrays.
        Collective."""
        system = self._system
        numbering = system.numbering
        nodes = [self._nodes_of(part) for _, part, _ in self._sides]
        flat = np.concatenate([some.ravel() for some in nodes])
        ghosts = np.unique(flat[~is_owned(flat, numbering)])
        self._owned = numbering.size_local
        # Nodes of this rank's parts that other ranks own, behind its own unknowns
        self._gather: Gather | None = None
        if system.comm.size > 1:
            self._gather = Gather(numbering, [ghosts[:, None] + np.arange(3)])
            self._shares = numbering.vector()

        def local(indices: GlobalIndices) -> npt.NDArray[np.int32]:
            """Numbers of unknowns among this rank's own, then those of ghosts."""
            of_ghosts = self._owned + 3 * np.searchsorted(ghosts, indices)
            own = indices - numbering.start
            return np.where(is_owned(indices, numbering), own, of_ghosts).astype(np.int32)

        # Each pair of nodes of one triangle or strip has one block of the tangent; pairs are
        # numbered by row, then by column.
        pairs = []
        for some in nodes:
            rows = some[:, :, None].astype(np.int64)
            pairs.append(rows * numbering.size + some[:, None, :])
        keys, blocks = np.unique(
            np.concatenate([one.ravel() for one in pairs]), return_inverse=True
        )
        self._c = c_library(HEADER, system.comm)
        self._allocate(self._owned + 3 * len(ghosts), len(keys))
        rows, columns = np.divmod(keys, numbering.size)
        self._entries = FixedBlocks(numbering, rows, columns, self._blocks)
        ends = np.cumsum([one.size for one in pairs])[:-1]
        # The parts of each film: chamber, sign, triangles, unknowns, blocks
        parts: dict[Membrane, list[tuple[Any, ...]]] = {}
        self._kinds: list[CStruct] = []
        for (chamber, part, sign), indices, of_pairs in zip(
            self._sides, nodes, np.split(blocks, ends), strict=True
        ):
            numbers = of_pairs.reshape(*indices.shape, indices.shape[1]).astype(np.int32)
            if isinstance(part, Patches):
                kind = self._kind_for_kernel(chamber, part, sign, local(indices), numbers)
                self._kinds.append(kind)
                continue
            unknowns = local(indices)[:, :, None] + np.arange(3, dtype=np.int32)
            part_of_film = (chamber, sign, part.cells, unknowns, numbers)
            parts.setdefault(part.film, []).append(part_of_film)
        self._films = [self._film_for_kernel(film, some) for film, some in parts.items()]
        self._c_all = self._surfaces_for_kernel()

    def _nodes_of(self, part: Patches | Triangles) -> GlobalIndices:
        """Global index of the first coordinate of each node of patches or triangles (n, k)."""
        if isinstance(part, Patches):
            return part.nodes
        film = part.film
        nodes = cell_nodes(film.space)[part.cells]
        numbers = film.block.index_map.local_to_global(nodes.ravel())
        return self._system.block(film).to_global(numbers)[:, 0].reshape(nodes.shape)

    def _allocate(self, unknowns: int, blocks: int) -> None:
        """Allocate what C reads and writes, for the unknowns of this rank, ghosts included."""
        chambers = self.count
        # 1, or -1 if all normals of a chamber point inwards
        self._orientation = np.ones(chambers)
        self.pressures = np.zeros(chambers)
        self._start = np.zeros(unknowns)
        self._end = np.zeros(unknowns)
        self._mid = np.zeros(unknowns)
        # G_c(q0), G_c(q̄) and G_c(q1) [m²], of other ranks' nodes what they do not know yet
        self._at_start = np.zeros((chambers, unknowns))
        self._at_end = np.zeros((chambers, unknowns))
        self._at_mid = self._at_end
        if not self._system.rule.acts_at_end:
            self._at_mid = np.zeros((chambers, unknowns))
        self.at_end = self._at_end[:, : self._owned]
        self.at_middle = self._at_mid[:, : self._owned]
        self.measures = np.zeros((3, chambers))
        self._initial_volume = np.zeros(chambers)
        # Each column by column, as PETSc stores them
        self._blocks = np.zeros((blocks, 9))

    def _kind_for_kernel(
        self,
        chamber: int,
        patches: Patches,
        sign: float,
        nodes: npt.NDArray[np.int32],
        blocks: npt.NDArray[np.int32],
    ) -> CStruct:
        """Return patches of a chamber as the C structure `gas_patches`; `nodes` (n, k) and `blocks`
        (n, k, k) are numbers on this rank."""
        count, k = nodes.shape
        points = patches.test.shape[-2]
        shape: tuple[int, ...] = (points, k)
        if patches.test.ndim == 3:
            shape = (count, points, k)
        check_indices("The nodes of patches", nodes, len(self._end) - 2)

        def table(name: str, values: Array) -> Any:
            return self._c.array(name, np.ascontiguousarray(values), "float64", shape)

        return self._c.struct(
            "gas_patches",
            {
                "count": count,
                "node_count": k,
                "point_count": points,
                "table_stride": points * k if len(shape) == 3 else 0,
                "chamber": chamber,
                "sign": sign,
                "nodes": self._c.array("nodes", nodes, "int32", (count, k)),
                "along": table("along", patches.along),
                "across": table("across", patches.across),
                "test": table("test", patches.test),
                "blocks": self._c.array("blocks", blocks, "int32", (count, k, k)),
            },
        )

    def _film_for_kernel(self, film: Membrane, parts: list[tuple[Any, ...]]) -> FilmParts:
        """Return the parts of a film with what evaluates them.  Collective."""
        system = self._system
        chambers, signs, cells, unknowns, blocks = zip(*parts, strict=True)
        at = system.coordinates[film]
        # One number in each triangle, in place of which that of the triangle's part is taken.
        factor = fem.Function(fem.functionspace(film.mesh.domain, ("DG", 0)))
        # Degree of (1): 2 (order - 1) of the area vector, order of w.
        degree = 2 * (film.order - 1) + film.order
        dx = ufl.Measure("dx", film.mesh.domain, metadata={"quadrature_degree": degree})

        def flux(x: Any) -> Any:
            """The form (1) at positions x on the film."""
            return factor * ufl.dot(area_vector(film.deformation(x)), at.w) * dx

        factors = np.ones((len(parts), 1))
        # Of each triangle: the row of its factor, and those of its nodes in gradients.
        counts = [len(some) for some in cells]
        part = np.repeat(np.arange(len(parts), dtype=np.int32), counts)[:, None]
        in_place_of = {factor._cpp_object: CellValues(factors, part)}
        chamber_of = np.array(chambers)
        first = (chamber_of[part] * len(self._end)).astype(np.int32)
        rows = np.concatenate(unknowns) + first[:, :, None]

        library = c_library(CELLS_HEADER, system.comm)

        def prepared(compiled: fem.Form) -> PreparedFunction:
            found = prepared_integral(compiled, np.concatenate(cells), in_place_of)
            assert found is not None
            return found[0]

        def adding(compiled: fem.Form, gradients: Array) -> Callable[[], Any]:
            """Return what adds a linear form to the gradients of all chambers."""
            to = CellValues(gradients.reshape(-1, 1), rows.reshape(len(part), -1))
            return prepared(compiled).applied("add_in_cells", to.struct(library), to.width)

        at_end = compile_form(flux(at.q1))
        acting = at_end if system.rule.acts_at_end else compile_form(flux(at.mid))
        tangent = compile_form(ufl.derivative(-flux(at.mid), at.q1, at.dq))
        pairs = np.concatenate(blocks)
        # Shares of nodes of other ranks are in these blocks, too.
        of_pairs = library.struct(
            "block_matrix",
            {
                "size": 3,
                "node_count": pairs.shape[1],
                "values": library.array("blocks", self._blocks, "float64", self._blocks.shape),
                "positions": library.array("pairs", pairs, "int32", pairs.shape),
                "rows": library.ffi.NULL,
                "matrix": 0,
                "set_values": 0,
            },
        )
        return FilmParts(
            factors,
            chamber_of,
            np.array(signs),
            adding(at_end, self._at_end),
            adding(acting, self._at_mid),
            prepared(tangent).applied("add_to_blocks", of_pairs, (3 * pairs.shape[1]) ** 2),
        )

    def _surfaces_for_kernel(self) -> CStruct:
        """Return all patches and arrays as the C structure `gas_surfaces`."""
        library: CLibrary = self._c
        arrays = {
            "orientation": self._orientation,
            "pressure": self.pressures,
            "start": self._start,
            "end": self._end,
            "mid": self._mid,
            "at_mid": self._at_mid,
            "at_end": self._at_end,
            "sums": self.measures,
            "blocks": self._blocks,
        }
        fields = {
            name: library.array(name, values, "float64", values.shape, writable=True)
            for name, values in arrays.items()
        }
        pointers = [kind.pointer for kind in self._kinds]
        return library.struct(
            "gas_surfaces",
            {
                "kind_count": len(pointers),
                "chamber_count": self.count,
                "unknown_count": len(self._end),
                "owned_count": self._owned,
                "block_count": len(self._blocks),
                "alpha": self._system.rule.alpha,
                "kinds": library.ffi.new("gas_patches *[]", pointers),
                **fields,
            },
        )

    # ---- the step --------------------------------------------------------------------------------

    def follow(self) -> None:
        """Evaluate volumes [m³] and gradients [m²] of all chambers at the end of the step, as
        iterated.  Collective."""
        self._end[: self._owned] = self._system.q1.array_r
        if self._gather is not None:
            self._end[self._owned :] = self._gather(self._system.q1)[0].ravel()
        self._c.lib.patches_gradients(self._c_all.pointer)
        for film in self._films:
            film.factors[:, 0] = film.signs * self._orientation[film.chambers]
            film.add_at_end()
            if self._at_mid is not self._at_end:
                film.add_at_mid()
        if self._gather is not None:
            self._send_shares(self._gather, self._at_end)
            if self._at_mid is not self._at_end:
                self._send_shares(self._gather, self._at_mid)
        self._c.lib.patches_sums(self._c_all.pointer)
        if self._gather is not None:
            self._system.comm.Allreduce(MPI.IN_PLACE, self.measures, op=MPI.SUM)
        if self._at_mid is self._at_end:
            self.measures[2] = self.measures[0] - self._initial_volume

    def _send_shares(self, gather: Gather, gradients: Array) -> None:
        """Add the shares of ghosts in gradients (chambers, unknowns) to those of the ranks that own
        them.  Collective."""
        for row in gradients:
            self._shares.array[:] = row[: self._owned]
            gather.add(row[self._owned :], self._shares)
            row[: self._owned] = self._shares.array_r

    def orient(self, c: int, smallest: float) -> None:
        """Turn the normals of chamber c if its volume was below -`smallest` [m³] without a sign at
        the last `follow`; the next one evaluates it so."""
        volume = self._orientation[c] * self.measures[0, c]
        self._orientation[c] = -1.0 if volume < -smallest else 1.0

    def accept(self) -> None:
        """Make the end of this step the start of the next."""
        self._start[:] = self._end
        self._at_start[:] = self._at_end
        self._initial_volume[:] = self.measures[0]

    def of_swept(self, c: int) -> Array:
        """Return this rank's part of ∂W_c/∂q1 [m²], (4)."""
        if self._at_mid is self._at_end:
            return self.at_end[c]
        change = self.at_end[c] - self._at_start[c, : self._owned]
        return self.at_middle[c] + self._system.rule.alpha * change

    def add_forces(self, values: Array) -> None:
        """Subtract the forces of all chambers, pressure · G_c(q̄) [N], from the owned part of a
        residual."""
        values -= self.pressures @ self.at_middle

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the derivative of the forces of all `pressures` [Pa] by the end of the step to the
        tangent of the system [N/m]."""
        self._c.lib.patches_tangent(self._c_all.pointer)
        forces = self._orientation * self.pressures
        for film in self._films:
            film.factors[:, 0] = film.signs * forces[film.chambers]
            film.add_tangent()
        self._entries.add(A)
