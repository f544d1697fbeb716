"""The stored energy of a reduced film: forces and tangents of its modes as products of full
matrices.

    forces    f = Σ_a G_aᵀ N_a,         N_a = Σ_b S_ab F_mean_b dA                               (1)
    tangent   K = Σ_ac G_aᵀ T_ac G_c,   T_ac = (Σ_bd D_abcd F_mean_b ⊗ F_d + α S_ac 1) dA        (2)

G are the gradients of the modes (`mode_gradients`), F and F_mean the gradients at q1 and at q_mid.
The stress S and its derivatives D are those of the mixed iteration in strains, which
`terms.element_energies` describes; `points` evaluates them at the quadrature points.

Each rank has the points of the sampled cells that it owns.  Sums over ranks go to rank 0, which
owns the unknowns c of the positions x = Σ φ_i c_i.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from dolfinx import fem, la
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from gossamer_fx.analysis.reduction.points import (
    Points,
    initial_strains,
    mode_gradients,
    own_cells,
    points_and_areas,
)
from gossamer_fx.core.algebra.numbering import NumberedBlock
from gossamer_fx.core.checks.lookups import check_midpoint
from gossamer_fx.core.model.body import Array, Body
from gossamer_fx.mechanics.terms.assembly import Assembly, CompiledTerms, Compiler
from gossamer_fx.mechanics.terms.coordinates import Coordinates
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule
from gossamer_fx.mechanics.terms.element_energies import StoredEnergy, quadrature_element
from gossamer_fx.mechanics.terms.law_kernel import LawFunctions, law_functions


class ReducedEnergies(CompiledTerms["ReducedEnergy"]):
    """All `ReducedEnergy` terms of a scene, compiled."""

    def __init__(self, terms: Sequence[ReducedEnergy], system: Assembly) -> None:
        check_midpoint(terms[0].name, system.rule.takes_mid_strain)
        self._system = system
        self._forces = []
        for term in terms:
            forces = ModeForces(term, coordinates_of(system, term.body), system.rule)
            self._forces.append((term.body, forces))

    def begin_step(self, t: float) -> None:
        for _, force in self._forces:
            force.begin()

    def update(self, linearly: bool) -> None:
        for _, force in self._forces:
            force.move(linearly)

    def commit(self) -> None:
        for _, force in self._forces:
            force.points.keep()

    def energies(self) -> dict[str, float]:
        return {force.name: force.points.energy() for _, force in self._forces}

    def add_forces(self, r: PETSc.Vec) -> None:
        with r as values:
            for body, force in self._forces:
                owned = self._system.block(body).owned
                values[owned] += self._on_rank_zero(force.forces()).ravel()

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the dense blocks (3r, 3r) [N/m] of the reduced films to the system's matrix, on rank
        0. Collective."""
        for body, force in self._forces:
            K = self._on_rank_zero(force.tangents(self._system.geometric))
            add_full_block(A, self._system.block(body), K)

    def _on_rank_zero(self, values: Array) -> Array:
        """The sum over all ranks on rank 0, which owns the coefficients; an empty array on the
        others."""
        comm = self._system.comm
        if comm.size == 1:
            return values
        own = np.ascontiguousarray(values)
        if comm.rank == 0:
            total: Array = np.zeros_like(values)
            comm.Reduce(own, total)
            return total
        comm.Reduce(own, None)
        return np.zeros((0, 0))


def add_full_block(A: PETSc.Mat, block: NumberedBlock, K: Array) -> None:
    """Add a full matrix K [N/m] of the unknowns of a body that this rank owns to its block of A."""
    # PETSc takes ten times as long to enter a full block number by number.
    if A.getType() == PETSc.Mat.Type.SEQDENSE:
        A.getDenseArray()[block.owned, block.owned] += K
    else:
        A.setValues(block.rows, block.rows, K, addv=PETSc.InsertMode.ADD_VALUES)


def coordinates_of(system: Assembly, body: Body) -> ReducedCoordinates:
    """The coordinates of a reduced film in a system."""
    coordinates = system.coordinates[body]
    # Its body is a reduced film, which makes such coordinates.
    assert isinstance(coordinates, ReducedCoordinates)
    return coordinates


@dataclass(frozen=True, eq=False)
class ReducedEnergy(StoredEnergy):
    """The stored energy of a reduced film with modes φ (nodes, r), over cells of weights ξ (cells,)
    that this rank owns."""

    modes: Array | None = None
    weights: Array | None = None
    compiler: ClassVar[Compiler] = ReducedEnergies


class ModeForces:
    """Forces (1) and tangents (2) of the modes on this rank's cells."""

    def __init__(self, term: ReducedEnergy, at: ReducedCoordinates, rule: StressRule) -> None:
        assert term.modes is not None and term.weights is not None
        film: Any = term.body
        reference_points, dA = points_and_areas(film)
        self.name = term.name
        self.points = Points(
            _compiled_law(term, rule),
            own_cells(film),
            dA=dA * term.weights[:, None],
            G=mode_gradients(film, term.modes, reference_points),
            initial=initial_strains(film, reference_points),
            # A quadratic energy has one linear stress: there is nothing to choose.
            may_choose=not term.quadratic and not rule.acts_at_end,
        )
        self._at = at
        self._alpha = rule.alpha

    def begin(self) -> None:
        """Begin a step from the strains of the last accepted one."""
        self.points.law.begin_step()

    def move(self, linearly: bool) -> None:
        """Set the strains at the quadrature points after the end q1 of the step was set: those of
        q1, or `linearly` those about the last iterate of Newton's method, see
        `terms.element_energies`."""
        self.points.move(self._at.end)
        if linearly:
            self.points.linearise(self._at.change)
        else:
            self.points.set_true_strains()

    def forces(self) -> Array:
        """Forces (r, 3) [N] on the coefficients."""
        return self.points.forces(self._alpha)

    def tangents(self, geometric: float) -> Array:
        """Derivatives (3r, 3r) [N/m] of the forces by q1, with a share of the geometric
        stiffness."""
        return self.points.stiffness(self._alpha, self._alpha * geometric)


def _compiled_law(term: ReducedEnergy, rule: StressRule) -> LawFunctions:
    """Compile the functions of a law at the quadrature points."""
    film: Any = term.body
    mesh = film.space.mesh
    Q = fem.functionspace(mesh, quadrature_element(mesh, term.dx.metadata(), (3,)))
    return law_functions(term, rule, start=fem.Function(Q), strain=fem.Function(Q))


class ReducedCoordinates(Coordinates):
    """Coordinates of which rank 0 owns the unknowns c (r, 3), with x = Φ c at the nodes.

    Forms see functions on the mesh as for any body.  An assembled force b becomes Φᵀb, a matrix K
    becomes ΦᵀKΦ.  Every rank has the coefficients (r, 3) [m] of q1, `end`, and of the increment δ
    of the iteration, `change`, from which the strains at points follow.
    """

    def __init__(self, space: fem.FunctionSpace, alpha: float, values: Array) -> None:
        super().__init__(space, alpha)
        self._modes = values
        self._comm = space.mesh.comm
        self._owned = space.dofmap.index_map.size_local
        self._matrix: la.MatrixCSR | None = None
        self.end: Array = np.zeros((values.shape[1], 3))
        self.change: Array = self.end

    def take(self, function: fem.Function, unknowns: Array) -> None:
        """Set a function on the mesh [m] from the 3r coefficients of the modes on rank 0.
        Collective."""
        c = coefficients(self._comm, unknowns)
        if function is self.δ:
            self.change = c
        elif function is self.q1:
            self.end = c
        # Φ is known at ghosts: nothing has to be communicated.
        function.x.array[:] = (self._modes @ c).ravel()

    def add_forces(self, b: Array, forces: Array) -> None:
        """Add the generalised forces Φᵀb [N] to the forces on the unknowns, on rank 0.
        Collective."""
        nodal = b.reshape(-1, 3)[: self._owned]
        total = self._comm.reduce(self._modes[: self._owned].T @ nodal)
        if total is not None:
            forces += total.ravel()

    def assemble(self, A: PETSc.Mat, forms: Iterable[fem.Form], block: NumberedBlock) -> None:
        """Add the projected matrix ΦᵀKΦ of the sum K of bilinear forms to a block of A, on rank 0.
        Collective."""
        all_forms = list(forms)
        if not all_forms:
            return
        # Forms of a film are sums over its cells, so that all have one pattern; an entry outside of
        # it would raise an error.
        if self._matrix is None:
            self._matrix = fem.create_matrix(all_forms[0])
        self._matrix.set_value(np.float64(0))
        for form in all_forms:
            # Only this rank's own cells are assembled: the ranks' shares add up after the
            # projection.
            fem.assemble_matrix(self._matrix, form)  # type: ignore[arg-type]
        size = 3 * self._modes.shape[1]
        total = self._comm.reduce(projected(self._matrix, self._modes).reshape(size, size))
        if total is not None:
            add_full_block(A, block, total)


def projected(matrix: la.MatrixCSR, modes: Array) -> Array:
    """ΦᵀKΦ (r, 3, r, 3) of a matrix K with blocks of three components, and modes Φ (n, r) at the
    owned and ghost nodes; this rank's share."""
    n, r = modes.shape
    K = np.zeros((r, 3, r, 3))
    blocks = matrix.data.reshape(-1, *matrix.block_size)
    # A sparse matrix for each pair of components, as SciPy has no fast product of blocks
    for i, j in np.ndindex(3, 3):
        part = csr_matrix((blocks[:, i, j], matrix.indices, matrix.indptr))
        part.resize(n, n)
        K[:, i, :, j] = modes.T @ (part @ modes)
    return K


def coefficients(comm: MPI.Intracomm, unknowns: Array) -> Array:
    """The coefficients (r, 3) of a reduced body, which rank 0 owns, on every rank.  Collective."""
    own: Array = unknowns.reshape(-1, 3)
    if comm.size == 1:
        return own
    # A copy, since the unknowns may be a view of a vector that changes.
    return comm.bcast(own.copy())
