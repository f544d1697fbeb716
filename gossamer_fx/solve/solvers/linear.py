"""The linear system of a Newton iteration: sparse coordinates and a few scalar unknowns.

Problem.  With the tangent A (n, n) of the coordinates z [m], sparse, and m scalar unknowns y (gas
pressures and the like), m being of the order of ten,

    [ A  G ] [δz]   [ r ]
    [ Hᵀ C ] [δy] = [ s ]                                                                     (1)

A pressure acts on all nodes of a film, so that a column of G is dense and must not enter the
pattern of A.

Idea.  Block elimination (Govaerts & Pryce, IMA J. Numer. Anal. 13 (1993) 161) with any
preconditioner P ≈ A.  With Z = P⁻¹ G and the dense Schur complement Σ = C - Hᵀ Z (m, m),

    δy = Σ⁻¹ (s - Hᵀ P⁻¹ r)                                                                   (2)
    δz = P⁻¹ r - Z δy                                                                         (3)

This is exact if P = A; otherwise it preconditions GMRES on (1).

Algorithm, in a Newton iteration.

1. Set up P: a factorisation, the two-level preconditioner (`solvers.two_level`), or the one that
   eliminates a few joints (`solvers.eliminated_joints`); ties are condensed before them
   (`solvers.condensed_constraints`).
2. Compute Z by one application of P⁻¹ for each column of G.  If P is not a factorisation, Z of an
   earlier iteration of the step is used, as long as the Krylov iterations do not rise.
3. Compute Σ from this Z.
4. Apply (2) and (3) in each Krylov iteration.

Cost.  A scalar unknown costs one application of P⁻¹ in a Newton iteration, however dense its
column.

Limits.  (2) needs a regular Σ.  If Σ is singular, the result is not a number, and the step is
repeated with a shorter length.

All options can be overridden by those of PETSc with the prefix `gx_` (e.g. `-gx_pc_type lu`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

import gossamer_fx.solve.solvers.factorisation as factorisation
from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.system.tangent import Tangent

# Unknowns up to which a factorisation costs less than preconditioned GMRES.
MAX_UNKNOWNS_DIRECT = 3000

# The same with contact: new pairs change the pattern of the matrix, whose unknowns are then ordered
# again, on several ranks for each factorisation, and couplings of contact increase the fill.
MAX_UNKNOWNS_DIRECT_WITH_CONTACT = 900

# Applications in a solve above which the preconditioner includes the strong couplings of contact
# for the rest of the step.  Up to this number the matrix of fixed pattern, which is ordered once,
# costs less.
MAX_APPLICATIONS_WITHOUT_COUPLINGS = 10

# Z is computed again when a solve needs more applications than the first one with that Z, plus
# this.
ALLOWED_EXTRA_APPLICATIONS = 1

# Krylov iterations of a solve, all in one cycle of GMRES.  A solution that is not finished then
# still serves as an inexact Newton step.
MAX_KSP_ITERATIONS = 60

# Relative tolerance of a linear solve, except for the last of a step (`newton.FINAL_LINEAR_RATIO`):
# Newton's iteration does not gain from more digits.
LINEAR_RTOL = 1e-3

# PETSc's names of failures, in words for messages.
KSP_REASON = PETSc.KSP.ConvergedReason
REASONS = {
    int(KSP_REASON.DIVERGED_NANORINF): "numbers that are not finite",
    int(KSP_REASON.DIVERGED_PCSETUP_FAILED): "its preconditioner could not be set up",
    int(KSP_REASON.DIVERGED_MAX_IT): "too many iterations",
    int(KSP_REASON.DIVERGED_BREAKDOWN): "breakdown",
}


class Composite:
    """Vectors x = (z, y): coordinates distributed as a vector of fields, n on this rank, and m
    scalar unknowns y at the end of the part of rank 0."""

    def __init__(self, comm: MPI.Intracomm, fields: PETSc.Vec, scalars: int) -> None:
        self.comm = comm
        self.fields = fields.duplicate()
        self.scalars = scalars
        self.n = fields.getLocalSize()

    def vector(self) -> PETSc.Vec:
        """A new vector (z, y)."""
        size = self.n
        if self.comm.rank == 0:
            size += self.scalars
        return PETSc.Vec().createMPI((size, None), comm=self.comm)

    def join(self, z: PETSc.Vec, y: Array, x: PETSc.Vec) -> None:
        """Set x = (z, y) from coordinates z [m] and scalar unknowns y (m,), e.g. pressures [Pa], of
        which those of rank 0 count."""
        if not self.scalars:
            z.copy(x)
            return
        values = x.array
        values[: self.n] = z.array_r
        if self.comm.rank == 0:
            values[self.n :] = y

    def split(self, x: PETSc.Vec) -> tuple[PETSc.Vec, Array]:
        """Coordinates z [m] of x, in a vector that the next call overwrites, and its scalar
        unknowns y (m,), e.g. pressures [Pa], on all ranks.  Collective."""
        if not self.scalars:
            x.copy(self.fields)
            return self.fields, np.zeros(0)
        values = x.array_r
        self.fields.array[:] = values[: self.n]
        if self.comm.size == 1:
            return self.fields, values[self.n :].copy()
        y: Array = np.empty(self.scalars)
        if self.comm.rank == 0:
            y[:] = values[self.n :]
        self.comm.Bcast(y)
        return self.fields, y


class Bordered:
    """The operator of (1), as PETSc's Python matrix.

    Attributes:
        G, H: those columns that are not zero, as rows (k, n), where n counts this rank's unknowns.
        of_G, of_H: their indices (k,) among all m columns.
        C: (m, m).
    """

    def __init__(self, composite: Composite, A: Tangent) -> None:
        self.composite = composite
        self.A = A
        self._out = composite.fields.duplicate()

    def set(self, G: list[Array | None], H: list[Array | None], C: Array) -> None:
        """Set G and H, by this rank's parts (n,) of their columns (None: zero), and C (m, m)."""
        self.of_G = [k for k, column in enumerate(G) if column is not None]
        self.of_H = [k for k, column in enumerate(H) if column is not None]
        self.G: Array = np.array([G[k] for k in self.of_G])
        self.H: Array = np.array([H[k] for k in self.of_H])
        self.C = C

    def rows(self, z: Array) -> Array:
        """Hᵀ z, summed over the ranks: (m,) for z (n,), or (m, k) for k vectors z (k, n)."""
        total = np.zeros((len(self.C), *z.shape[:-1]))
        if self.of_H:
            total[self.of_H] = self.H @ z.T
        if self.composite.comm.size > 1:
            self.composite.comm.Allreduce(MPI.IN_PLACE, total)
        return total

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, out: PETSc.Vec) -> None:
        """Set out = the matrix of (1) times x; called by PETSc."""
        z, y = self.composite.split(x)
        self.A.mult(z, self._out)
        if self.of_G:
            self._out.array[:] += y[self.of_G] @ self.G
        self.composite.join(self._out, self.rows(z.array_r) + self.C @ y, out)


class BorderedPreconditioner:
    """Block elimination (2), (3) for the operator of (1), as PETSc's Python preconditioner, with
    the preconditioner P ≈ A of the sparse part."""

    def __init__(self, operator: Bordered, sparse: PETSc.PC, system: System) -> None:
        self._operator = operator
        self._sparse = sparse
        self._system = system
        self._out = operator.composite.fields.duplicate()
        # Z as rows (k, n), and the indices of these columns among those of G.
        self._Z: Array = np.zeros((0, 0))
        self._solved: list[int] = []
        context = sparse.getPythonContext() if sparse.getType() == "python" else None
        self._context = context
        # Whether P is a factorisation; a context may change from step to step.
        self._factorises = factorisation.is_exact(sparse)
        # What lets it use the factors of an earlier matrix for the next one, if it can; returns
        # whether it does, so that the next matrix need not be summed.
        self._keep_factors: Callable[[], bool] | None = getattr(context, "keep_factors", None)
        self._step: tuple[float, float] | None = None  # time and length of the step of Z
        self._applications = 0  # since the last set-up
        self._fresh_applications: int | None = None  # of the first solve with the present Z
        self._needs_couplings = False  # whether P includes strong couplings in this step
        self._solve_dense: Any = None
        if operator.composite.scalars:
            # Imported here, see `factorisation.Lapack`.
            from scipy.linalg import lapack

            # A fifth of the calls of NumPy's function.
            self._solve_dense = lapack.dgesv

    def setUp(self, pc: PETSc.PC) -> None:
        """Set up P for the present tangent [[A, G], [Hᵀ, C]], and compute Z = P⁻¹ G and the Schur
        complement Σ = C - Hᵀ Z (m, m) of the scalar unknowns; called by PETSc.  With the two-level
        preconditioner Z of an earlier iteration of the same step is used until solves take more
        applications."""
        operator = self._operator
        step = self._system.unknowns.time, self._system.unknowns.h
        is_new_step = step != self._step
        self._set_up_sparse(is_new_step)
        # Only the two-level preconditioner costs so much that it pays to use an earlier Z.
        if self._is_exact or is_new_step or self._has_aged():
            self._solve_columns()
            self._step = step
            self._fresh_applications = None
        elif self._fresh_applications is None:
            self._fresh_applications = self._applications
        self._applications = 0
        self._schur = operator.C.copy()
        if self._solved:
            self._schur[:, self._solved] -= operator.rows(self._Z)

    def recover(self) -> None:
        """Become usable again after a step that was not solved: another attempt of its length does
        not take Z of its iterates."""
        self._step = None
        recover(self._sparse)

    @property
    def _is_exact(self) -> bool:
        """Whether P = A, to round-off."""
        return bool(getattr(self._context, "is_exact", self._factorises))

    def _is_marked(self, mark: str) -> bool:
        """Whether a preconditioner adds the couplings of contact itself (`adds_couplings`), or is
        to be set up again within a solve, as its factors are those of an earlier matrix
        (`is_outdated`)."""
        return bool(getattr(self._context, mark, False))

    def _set_up_sparse(self, is_new_step: bool) -> None:
        """Set up the preconditioner of the coordinates' tangent, with or without the couplings of
        contact."""
        tangent = self._operator.A
        was_slow = self._applications > MAX_APPLICATIONS_WITHOUT_COUPLINGS
        self._needs_couplings = not is_new_step and (self._needs_couplings or was_slow)
        if self._keep_factors is not None:
            is_kept = self._keep_factors()
            # Otherwise PETSc would set up at the next application, if its matrix is A.
            self._sparse.setReusePreconditioner(is_kept)
            if is_kept:
                return
        # A preconditioner that is exact now may say that it will not be for the next matrix.
        if getattr(self._context, "needs_couplings", self._is_exact):
            factorisation.replace(self._sparse, tangent.for_factorisation())
        elif self._needs_couplings and not self._is_marked("adds_couplings"):
            self._sparse.setOperators(tangent.for_preconditioner(), tangent.A)
        else:
            self._sparse.setOperators(tangent.A)
        self._sparse.setUp()

    def _has_aged(self) -> bool:
        """Whether the last solve took more applications than the first one with the present Z."""
        if self._fresh_applications is None:
            return False
        return self._applications > self._fresh_applications + ALLOWED_EXTRA_APPLICATIONS

    def _solve_columns(self) -> None:
        """Compute Z = P⁻¹ G for the columns G (n, m) of the scalar unknowns that are not zero.
        Collective."""
        G = self._operator.G
        column = self._operator.composite.fields
        self._Z = np.empty(G.shape)
        self._solved = self._operator.of_G
        for k, values in enumerate(G):
            column.array[:] = values
            self._sparse.apply(column, self._out)
            self._Z[k] = self._out.array_r

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, out: PETSc.Vec) -> None:
        """Set out = (δz, δy) for residuals x = (r, s) by block elimination; called by PETSc.

            δy = Σ⁻¹ (s - Hᵀ P⁻¹ r),    δz = P⁻¹ r - Z δy

        in [m] and e.g. [Pa] for r in [N].  It is NaN if Σ is singular, so that the step is
        repeated.
        """
        operator = self._operator
        # The flexible Krylov method allows another preconditioner within a solve.
        if self._is_marked("is_outdated"):
            # PETSc does not set up for a matrix again unless it has changed.
            operator.A.A.stateIncrease()
            self._set_up_sparse(is_new_step=False)
        self._applications += 1
        r, s = operator.composite.split(x)
        self._sparse.apply(r, self._out)
        δy: Array = s - operator.rows(self._out.array_r)
        if δy.size:
            _, _, δy, zero_pivot = self._solve_dense(self._schur, δy)
            if zero_pivot:
                # The iteration has diverged.  PETSc detects NaN on all ranks, and the step is
                # repeated.
                δy[:] = np.nan
        if self._solved:
            self._out.array[:] -= δy[self._solved] @ self._Z
        operator.composite.join(self._out, δy, out)


def configure(ksp: PETSc.KSP, pc: PETSc.PC, system: System, direct: bool) -> None:
    """Choose the Krylov method and the preconditioner of the coordinates; PETSc's options may
    override.

    A matrix is factorised if `direct` or if it is small: up to 3000 unknowns, with contact 900 or,
    if incomplete factors are slow, 9000 (`two_level.FactorisedIfDifficult`).
    Lagrange multipliers have zeros on the diagonal, for which an incomplete factorisation fails:
    those of ties are condensed, and in large systems those of beams and rigid bodies; others are
    eliminated if few of them are coupled with films (`condensed_constraints.for_constraints`), else
    the matrix is factorised, too.

    Two alternatives were measured and rejected.  Constraints satisfied exactly by the coarse space:
    for an antenna with up to half a million unknowns, on one and two ranks, it took no less time
    than the factorisation.  A factorisation kept for the next Newton iteration, even for the last
    ones of a step: where films switch, the additional Krylov iterations take longer than another
    factorisation.
    """
    largest_direct = MAX_UNKNOWNS_DIRECT
    if system.equations.active_sets:
        largest_direct = MAX_UNKNOWNS_DIRECT_WITH_CONTACT
    is_small = system.unknowns.numbering.size <= largest_direct
    is_free = PETSc.Options(pc.getOptionsPrefix()).getString("pc_type", "python") == "python"
    if system.equations.constraints is not None and is_free and not (direct or is_small):
        # Imported here, as scenes without joints must not pay for it.
        from gossamer_fx.solve.solvers import condensed_constraints

        # Scalar unknowns need a separate preconditioner.
        is_alone = not system.matrices.scalar_count
        context = condensed_constraints.for_constraints(system, MAX_KSP_ITERATIONS, is_alone)
        if context is not None:
            _choose_gmres(ksp)
            pc.setType("python")
            pc.setPythonContext(context)
            if is_alone and isinstance(context, condensed_constraints.CondensedConstraints):
                ksp.setType("python")
                ksp.setPythonContext(condensed_constraints.CondensedSolver(context))
            return
    if direct or system.equations.constraints is not None or is_small:
        ksp.setType("preonly")
        # Statics have singular matrices, which need pivots.
        if direct:
            factorisation.choose(pc, system.matrices.A)
        else:
            factorisation.choose_for_steps(pc, system.matrices.A, saddle_point_of(system))
        return
    _choose_gmres(ksp)
    if is_free:
        # Imported here, as small scenes must not pay for it.
        from gossamer_fx.solve.solvers.two_level import FactorisedIfDifficult, TwoLevel

        pc.setType("python")
        kind = FactorisedIfDifficult if FactorisedIfDifficult.serves(system) else TwoLevel
        pc.setPythonContext(kind(system))


def saddle_point_of(system: System) -> factorisation.SaddlePoint | None:
    """The multipliers and directors of a system on one rank; None: it has no multipliers, or they
    share blocks of the matrix with coordinates."""
    constraints = system.equations.constraints
    if constraints is None or system.comm.size > 1:
        return None
    owned = constraints.owned
    multipliers = np.arange(owned.start, owned.stop, dtype=np.int32)
    if not len(multipliers) or owned.start % 3 or len(multipliers) % 3:
        return None
    directors = []
    for body in system.unknowns.bodies:
        size = body.block.size
        if size > 3:
            own = system.unknowns.block(body).owned
            rows = np.arange(own.start, own.stop, dtype=np.int32).reshape(-1, size)
            directors.append(rows[:, 3:])
    return factorisation.SaddlePoint(multipliers, directors)


def _choose_gmres(ksp: PETSc.KSP) -> None:
    """Solve by GMRES, to the tolerance of Newton's iterations."""
    # The flexible form keeps the preconditioned vectors, which the solution is a sum of.  The other
    # one applies the preconditioner once more for it, one time in five.
    ksp.setType("fgmres")
    ksp.setGMRESRestart(MAX_KSP_ITERATIONS)
    # On the right, so that the tolerance refers to the true residual.
    ksp.setPCSide(PETSc.PC.Side.RIGHT)
    ksp.setTolerances(rtol=LINEAR_RTOL, max_it=MAX_KSP_ITERATIONS)


def recover(pc: PETSc.PC) -> None:
    """Make a preconditioner usable again after a matrix that could not be factorised."""
    # Factorisations of this package take the next matrix whatever became of this one.
    if pc.getType() == "python" and not factorisation.is_exact(pc):
        pc.getPythonContext().recover()
    elif factorisation.failure(pc) < 0:
        factorisation.renew(pc)


def reason(ksp: PETSc.KSP, pc: PETSc.PC) -> str:
    """Why the last linear system was not solved, in words."""
    code = int(ksp.getConvergedReason())
    unknown = f"PETSc's reason {code}"
    # PETSc may count a system as solved whose solution is infinite.
    if code > 0:
        unknown = REASONS[int(KSP_REASON.DIVERGED_NANORINF)]
    return factorisation.reason(pc) or REASONS.get(code, unknown)


def krylov_name(ksp: PETSc.KSP) -> str:
    """The Krylov method of a solver, in words."""
    kind = ksp.getType()
    return "fgmres" if kind == "python" else str(kind)


def name(pc: PETSc.PC) -> str:
    """What a preconditioner is, in words."""
    kind = pc.getType()
    if kind == "python":
        return str(pc.getPythonContext())
    return str(kind)
