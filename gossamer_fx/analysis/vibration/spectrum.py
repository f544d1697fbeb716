"""Signs of the eigenvalues of a stiffness: the number of modes between two frequencies, and the
stability of an equilibrium; `natural_modes` has the equations (2) and (4)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.solvers import factorisation
from gossamer_fx.solve.system.system import System

# What `count_unstable` returns where stability is not known.
UNKNOWN = -1

# Squares of frequencies over |K|/|M| up to which they count as round-off, where free motions have
# the frequency zero.
COUNTED_FROM = 1e-10

# Norm of K - Kᵀ over that of K, up to which a stiffness counts as symmetric: round-off.
SYMMETRY = 1e-10

# Random motions in which the stiffness has to be symmetric: one is enough but for chance.
PROJECTED_MOTIONS = 2

DIFFERENT_PATTERN = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN


def is_symmetric(K: PETSc.Mat) -> bool:
    """Whether a matrix is symmetric up to round-off.  Collective."""
    difference = K.transpose(PETSc.Mat())
    difference.axpy(-1.0, K, DIFFERENT_PATTERN)
    result = difference.norm() <= SYMMETRY * K.norm()
    difference.destroy()
    return bool(result)


@contextmanager
def symmetric_on_constraints(system: System, K: PETSc.Mat) -> Iterator[PETSc.Mat | None]:
    """Context with the stiffness K of a system as a symmetric matrix, or None where it has none;
    collective.  A matrix other than K is destroyed at the end.

    The eigenvalues of an equilibrium are those of K in the motions that the constraints allow.
    Film that is cut and tied has an unsymmetric stiffness of pressure on either side of the cut,
    whose difference from its transpose does no work in motions that keep both sides together.
    There K may be replaced by (K + Kᵀ)/2.
    """
    symmetric = _symmetric(system, K)
    try:
        yield symmetric
    finally:
        if symmetric is not None and symmetric is not K:
            symmetric.destroy()


def _symmetric(system: System, K: PETSc.Mat) -> PETSc.Mat | None:
    """The matrix of `symmetric_on_constraints`: K itself, a new one, or None."""
    if is_symmetric(K):
        return K
    if system.equations.constraints is None:
        return None
    difference = K.transpose(PETSc.Mat())
    difference.axpy(-1.0, K, DIFFERENT_PATTERN)
    project = _ConstraintProjection(system, K)
    generator = np.random.default_rng(system.comm.rank)
    is_allowed = not project.problem
    motion = K.createVecRight()
    forces = K.createVecLeft()
    work = K.createVecLeft()
    for _ in range(PROJECTED_MOTIONS):
        if not is_allowed:
            break
        motion.array[:] = generator.standard_normal(motion.local_size)
        project(motion)
        K.mult(motion, forces)
        difference.mult(motion, work)
        project(work)
        is_allowed = bool(work.norm() <= SYMMETRY * forces.norm())
    project.destroy()
    symmetric = None
    if is_allowed:
        symmetric = K.copy()
        symmetric.axpy(0.5, difference, DIFFERENT_PATTERN)
    for each in (difference, motion, forces, work):
        each.destroy()
    return symmetric


class _ConstraintProjection:
    """The orthogonal projection of vectors on the motions that the constraints of a system allow,
    by the matrix (I Bᵀ; B 0), with B from the tangent K.

    Attributes:
        problem: why there is none, as for equations that depend on each other; empty if there is.
    """

    def __init__(self, system: System, K: PETSc.Mat) -> None:
        assert system.equations.constraints is not None, "the caller asks"
        owned = system.equations.constraints.owned
        self._local = slice(owned.start, owned.stop)
        of_motion = K.createVecLeft()
        of_motion.set(1.0)
        of_motion.array[self._local] = 0.0
        stiffness = K.convert("aij", PETSc.Mat())
        saddle = stiffness.copy()
        stiffness.diagonalScale(of_motion, of_motion)
        saddle.axpy(-1.0, stiffness, DIFFERENT_PATTERN)
        saddle.setDiagonal(of_motion, addv=PETSc.InsertMode.ADD_VALUES)
        self._factors = factorisation.SymmetricFactors(saddle)
        self.problem = self._factors.problem
        if not self.problem and self._factors.is_singular():
            self.problem = "the constraints depend on each other"
        self._solution = K.createVecRight()
        for each in (stiffness, of_motion):
            each.destroy()

    def __call__(self, vector: PETSc.Vec) -> None:
        """Replace a vector by its projection; multipliers become zero.  Collective."""
        vector.array[self._local] = 0.0
        self._factors.pc.apply(vector, self._solution)
        self._solution.copy(vector)
        vector.array[self._local] = 0.0

    def destroy(self) -> None:
        """Free the factors.  Collective."""
        self._factors.destroy()
        self._solution.destroy()


class Spectrum:
    """Counts the modes of K φ = ω² M φ between two squares of frequencies.  K is symmetric, with
    the gas chambers' κ g⊗g in addition; rows of fixed coordinates are those of the unit matrix in K
    and zero in M."""

    def __init__(
        self, K: PETSc.Mat, M: PETSc.Mat, stiffnesses: Sequence[tuple[Array, float]]
    ) -> None:
        self.comm = K.comm
        self._K = K
        self._M = M
        self._stiffnesses = stiffnesses
        self._below: dict[float, int] = {}

    def count(self, low: float, high: float) -> int:
        """Number of modes with ω² between two shifts [rad²/s²]; `RuntimeError` if MUMPS could not
        factorise the matrix at one of them.  Collective."""
        for shift in (low, high):
            if shift not in self._below:
                self._below[shift] = self.negative_pivots(shift)
        return self._below[high] - self._below[low]

    def negative_pivots(self, shift: float) -> int:
        """Number of negative eigenvalues of K + Σ κ g⊗g - σ M, less a number that is the same at
        every shift."""
        # The symmetric factorisation takes neither blocks nor a dense matrix.
        A = self._K.convert("aij", PETSc.Mat())
        A.axpy(-shift, self._M, DIFFERENT_PATTERN)
        factors = factorisation.SymmetricFactors(A)
        if factors.problem:
            raise RuntimeError(f"no inertia at the shift {shift:.6g}: {factors.problem}")
        negative = factors.negative
        if self._stiffnesses:
            # n₋(-κ⁻¹ - Uᵀ A⁻¹ U) of (4); n₋(-κ⁻¹) is the same at every shift.
            inner = factorisation.LowRankUpdate(A, self._stiffnesses, factors.pc.apply).inner
            negative += (np.linalg.eigvalsh(-(inner + inner.T) / 2) < 0).sum()
        factors.destroy()
        return int(negative)


def count_unstable(system: System, K: PETSc.Mat) -> int:
    """Number of negative eigenvalues of the stiffness in the state of a system, whose tangent
    without inertia is K; `UNKNOWN` if it is not symmetric, gas flows, or the factorisation fails.
    Collective."""
    stiffnesses = []
    for scalars in system.equations.scalar_unknowns:
        if not scalars.is_closed:
            return UNKNOWN
        for gradient, stiffness in scalars.static_stiffness():
            gradient = gradient.copy()
            gradient[system.unknowns.supports.held] = 0.0
            if stiffness:
                stiffnesses.append((gradient, stiffness))
    with symmetric_on_constraints(system, K) as symmetric:
        if symmetric is None:
            return UNKNOWN
        try:
            negative = Spectrum(symmetric, system.unknowns.M, stiffnesses).negative_pivots(0.0)
        except RuntimeError:
            return UNKNOWN
    # The matrix of which these are pivots has one of -1/κ for each gas.
    negative -= sum(stiffness > 0 for _, stiffness in stiffnesses)
    return negative - active_multipliers(system)


def count_beyond_round_off(
    system: System, K: PETSc.Mat, part: npt.NDArray[np.int64], parts: int
) -> int:
    """As `count_unstable`, of a stiffness that is singular where parts of the scene move freely:
    the number of eigenvalues ω² below the round-off of the part, of which there are `parts`;
    `part` (n,) is that of each unknown of this rank, -1 where it is fixed.  Collective."""
    comm = system.comm
    is_free = part >= 0
    sizes = []
    for matrix in (K, system.unknowns.M):
        pointers, _, values = matrix.convert("aij", PETSc.Mat()).getValuesCSR()
        rows = np.repeat(np.arange(len(pointers) - 1), np.diff(pointers))
        squares = np.zeros(parts)
        concerned = is_free[rows]
        np.add.at(squares, part[rows[concerned]], values[concerned] ** 2)
        comm.Allreduce(MPI.IN_PLACE, squares)
        sizes.append(np.sqrt(squares))
    stiffnesses, masses = sizes
    squares = np.divide(stiffnesses, masses, out=np.zeros(parts), where=masses > 0)
    # A part without any stiffness has that of the others.
    shifts = COUNTED_FROM * np.where(squares > 0, squares, squares.max(initial=0.0))
    M = system.unknowns.M.copy()
    system.unknowns.supports.clear(M, 0.0)
    scale = M.createVecLeft()
    scale.array[:] = np.where(is_free, np.sqrt(shifts[part]), 0.0)
    M.diagonalScale(scale, scale)
    shifted = K.copy()
    shifted.axpy(1.0, M, DIFFERENT_PATTERN)
    unstable = count_unstable(system, shifted)
    for each in (M, shifted, scale):
        each.destroy()
    return unstable


def active_multipliers(system: System) -> int:
    """Number of Lagrange multipliers with an equation, each of which adds a negative eigenvalue to
    the tangent.  Collective."""
    if system.equations.constraints is None:
        return 0
    owned = system.equations.constraints.owned
    held = system.unknowns.supports.held
    idle = ((held >= owned.start) & (held < owned.stop)).sum()
    return int(system.comm.allreduce(int(owned.stop - owned.start - idle)))
