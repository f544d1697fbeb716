"""Factorisations: sparse matrices by MUMPS, small ones by PETSc, dense ones by LAPACK; their
reasons of failure.  Also incomplete factorisations, a test of singularity, and low-rank updates.

MUMPS estimates its workspace from the sparsity pattern.  Pivots that it delays, such as those of
Lagrange multipliers, may need more than that.  ICNTL(14) is the margin in per cent.  It is doubled,
and the factorisation repeated, when INFOG(1) reports too small a workspace (MUMPS users' guide,
sections on control parameters and error diagnostics).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.algebra.block_entries import block_keys, stored_blocks
from gossamer_fx.core.algebra.numbering import PREFIX
from gossamer_fx.core.model.body import Array, Indices

EPS = float(np.finfo(float).eps)

# Numbers of MUMPS's control parameters.
ICNTL_ORDERING = 7
ICNTL_SCALING = 8
ICNTL_WORKSPACE_MARGIN = 14
ORDERING_BY_MINIMUM_FILL = 2

# Margins of the workspace [%]: the default of MUMPS, and the largest one that is tried.
DEFAULT_MARGIN = 20
MAX_MARGIN = 20_000

# Sweeps of row and column scaling: each halves the order of magnitude by which rows differ, and 8
# leave 1e12 a factor of 1.1.
EQUILIBRATIONS = 8

# A is singular to round-off if |A| |A⁻¹| exceeds this.
MAX_CONDITION = 1 / (4 * EPS)

# Smallest norm that is divided by, against division by zero.
TINY = 1e-300

# PETSc's types of preconditioners that are factorisations.
TYPES = "lu", "cholesky"

# Cells by which the incompletely factorised parts of several ranks overlap; without overlap the
# Krylov iterations double.  On eight ranks, with the coarse matrix factorised, a step of a sheet
# with 44 thousand unknowns takes 16 of them, with two cells 18, on one rank 13.
OVERLAP = 3

# Unknowns up to which PETSc factorises blocks of three faster than MUMPS.  Of a square sheet with
# 1323 unknowns a factorisation and its first solution take 0.9 ms instead of 1.2 ms, with 2523
# unknowns 2.9 ms instead of 2.6 ms; of the folded tube with 582 unknowns 0.25 ms instead of 0.94
# ms.
MAX_UNKNOWNS_BLOCKS = 1500

# Unknowns of systems that are difficult for incomplete factors up to which those of blocks replace
# them, and the number that they store for an unknown above which they do not (`BlockFactors.fill`):
# see the tables of `solvers.two_level`.
MAX_UNKNOWNS_DIFFICULT = 9000
MAX_FILL = 150.0

# δ of `SaddlePoint`, and refinements of a solution: with 1e-6 to 1e-8 two of them leave relative
# residuals of 1e-9 to 1e-14 in a tube with a rigid end, with 1e-5 some of 1e-7.
REGULARISATION = 1e-7
REFINEMENTS = 2

# Stiffness of a coordinate without mass, over that of others: what is below is round-off.
NO_STIFFNESS = 1e-18

# Relative residual of a solution from which the factors of blocks are not accurate enough.
# Measured in the tube and the sheet: 1e-15 to 3e-14.
MAX_BLOCK_RESIDUAL = 1e-10

# INFOG(1) of MUMPS: the error codes that more workspace may cure, and the words for all known
# codes.
WORKSPACE_ERRORS = (-8, -9, -11, -14, -15, -17, -20)
SINGULAR = -10
REASONS = {
    -6: "the matrix is singular by its pattern",
    SINGULAR: "the matrix is singular",
    -13: "it ran out of memory",
    -37: "the matrix has numbers that are not finite",
} | dict.fromkeys(WORKSPACE_ERRORS, "its workspace is too small")


class Lapack:
    """LU factors of a dense matrix on one rank, as PETSc's Python preconditioner; `problem` says
    why the last factorisation failed.  PETSc's own dense factorisation ends the program at a zero
    pivot."""

    problem = ""
    is_exact = True

    def __init__(self) -> None:
        # Imported here, as few scenes have a dense matrix: SciPy's linear algebra takes a fifth of
        # the time in which this package and dolfinx are loaded.
        from scipy.linalg import lapack

        self._lapack = lapack

    def setUp(self, pc: PETSc.PC) -> None:
        """Factorise the matrix of the preconditioner; called by PETSc."""
        matrix = pc.getOperators()[1].getDenseArray(readonly=True)
        self._lu, self._pivots, info = self._lapack.dgetrf(matrix)
        self.problem = ""
        if info:
            self.problem = f"LAPACK: {REASONS[SINGULAR]}"

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve A x = b; x is NaN if A is singular, so that the caller's iteration ends."""
        if self.problem:
            x.array[:] = np.nan
        else:
            x.array[:] = self._lapack.dgetrs(self._lu, self._pivots, b.array_r)[0]

    def applyTranspose(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve Aᵀ x = b, as `apply` solves A x = b."""
        if self.problem:
            x.array[:] = np.nan
        else:
            x.array[:] = self._lapack.dgetrs(self._lu, self._pivots, b.array_r, trans=1)[0]

    def __str__(self) -> str:
        return "a factorisation by LAPACK"


@dataclass(frozen=True, eq=False)
class SaddlePoint:
    """What a matrix with Lagrange multipliers needs to be factorised without pivots.

    Rows of multipliers λ have zeros on the diagonal, and directors without inertia, such as the
    normal of a disc, have no stiffness in some directions.  The matrix that is factorised is
    quasi-definite, so that every order of elimination serves (R. J. Vanderbei, SIAM J. Optim. 5
    (1995) 100, doi:10.1137/0805005):

        [ K + δ k   Bᵀ                      ]
        [ C        -δ diag(Σ_j C_ij²/k_j)   ]                                                (1)

    k_j is the diagonal of K, at directors the largest of those of the node; k is that of directors,
    and zero at positions.  A solution of (1) has a relative error of about δ, and each iterative
    refinement with the matrix itself leaves δ of it.

    Attributes:
        multipliers: indices (m,) of the multipliers, whole blocks of three.
        directors: indices (n, d) of the coordinates of the directors of each node that has any.
    """

    multipliers: Indices
    directors: Sequence[Indices]

    def shift(self, matrix: PETSc.Mat, rows: MultiplierRows) -> Array | None:
        """What (1) adds to the diagonal of a matrix (size,); `rows` are those of its multipliers.
        None: it needs pivots, as a part has no mass, such as the frame of a region that is rigid.

        It follows from this matrix alone, so that a step that is undone and made again is the same.
        """
        stiffness = np.abs(matrix.getDiagonal().array)
        shift = np.zeros(len(stiffness))
        for nodes in self.directors:
            stiffness[nodes] = stiffness[nodes].max(axis=1, keepdims=True)
            shift[nodes] = REGULARISATION * stiffness[nodes]
        of_coordinates = stiffness[: self.multipliers[0]]
        if of_coordinates.min(initial=math.inf) <= NO_STIFFNESS * np.median(of_coordinates):
            return None
        # Entries of multipliers among themselves are zero.
        flexibility = 1 / np.maximum(stiffness, TINY)
        flexibility[self.multipliers] = 0
        shift[self.multipliers] = -REGULARISATION * rows.sums(flexibility)
        return shift


class MultiplierRows:
    """The stored blocks of the multipliers' rows of a matrix of 3 x 3 blocks on one rank, whose
    pattern does not change."""

    def __init__(self, matrix: PETSc.Mat, multipliers: Indices) -> None:
        rows, columns = np.divmod(block_keys(matrix), matrix.getSize()[0] // 3)
        first = multipliers[0] // 3
        self._found = np.flatnonzero(rows >= first)
        self._rows = rows[self._found] - first
        self._columns = columns[self._found]
        self._values = stored_blocks(matrix)
        self._count = len(multipliers) // 3

    def sums(self, weights: Array) -> Array:
        """Σ_j w_j C_ij² (m,) over the columns j of each row i, for weights w (size,)."""
        # Stored column by column.
        squares = self._values[self._found].reshape(-1, 3, 3) ** 2
        products = np.einsum("bji,bj->bi", squares, weights.reshape(-1, 3)[self._columns])
        sums = np.zeros((self._count, 3))
        np.add.at(sums, self._rows, products)
        return sums.ravel()


class BlockFactors:
    """LU factors of a small matrix of 3 x 3 blocks on one rank, as PETSc's Python preconditioner.

    PETSc factorises blocks in the order of (approximate) minimum degree and without pivoting, which
    is fast for small matrices: a new pattern costs 0.05 ms, MUMPS takes 0.4 ms for it.  Each
    factorisation is tested by one solution; a matrix that needs pivots is factorised by MUMPS
    instead.  `problem` says why the last factorisation failed, `fill` how many numbers the last
    factors without pivots store for an unknown.

    Args:
        saddle_point: of matrices with Lagrange multipliers; None: there are none.
    """

    problem = ""
    fill = 0.0
    is_exact = True

    def __init__(self, saddle_point: SaddlePoint | None = None) -> None:
        """Make two solvers without a matrix: PETSc's for blocks without pivots, and MUMPS with
        pivots."""
        self._saddle_point = saddle_point
        self._matrix: PETSc.Mat | None = None
        self._without_pivots = PETSc.PC().create(PETSc.COMM_SELF)
        self._without_pivots.setType("lu")
        self._without_pivots.setFactorSolverType("petsc")
        self._without_pivots.setFactorOrdering(_minimum_degree())
        self._with_pivots = PETSc.PC().create(PETSc.COMM_SELF)
        choose(self._with_pivots)
        self._in_use = self._without_pivots
        self._right: PETSc.Vec = None
        self._shifted: PETSc.Mat = None

    def setUp(self, pc: PETSc.PC) -> None:
        """Factorise the matrix of the preconditioner, without pivots or else by MUMPS; called by
        PETSc. A failure sets `problem`."""
        matrix = pc.getOperators()[1]
        if self._right is None:
            self._solution, self._right = matrix.createVecs()
            self._product = self._right.duplicate()
            self._remainder = self._right.duplicate()
            self._correction = self._right.duplicate()
            self._right.set(1.0)
        self.problem = ""
        self._in_use = self._without_pivots
        if self._is_factorised(matrix):
            stored = self._without_pivots.getFactorMatrix().getInfo()["nz_used"]
            self.fill = float(stored) / matrix.getSize()[0]
            return
        self._in_use = self._with_pivots
        self._with_pivots.setOperators(matrix)
        self.problem = set_up(self._with_pivots)

    def _is_factorised(self, matrix: PETSc.Mat) -> bool:
        """Factorise a matrix without pivots; returns whether the factors are accurate enough."""
        saddle_point = self._saddle_point
        if saddle_point is None:
            return self._is_factorised_as(matrix, matrix)
        # The matrix is kept, so that no other one has its handle.  While it stays PETSc does not
        # order its pattern again.
        if self._matrix is None or self._matrix.handle != matrix.handle:
            self._matrix = matrix
            self._shifted = matrix.duplicate()
            self._rows = MultiplierRows(matrix, saddle_point.multipliers)
        shift = saddle_point.shift(matrix, self._rows)
        if shift is None:
            return False
        self._solution.array[:] = shift
        matrix.copy(self._shifted, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._shifted.setDiagonal(self._solution, PETSc.InsertMode.ADD_VALUES)
        # The displacement [m] of a force of 1 N, for which the others are tested; idle multipliers
        # have rows of the unit matrix.
        multipliers = saddle_point.multipliers
        displacement = np.abs(shift[multipliers]) / REGULARISATION
        self._right.array[multipliers] = np.where(displacement > 0, displacement, 1.0)
        return self._is_factorised_as(matrix, self._shifted)

    def _is_factorised_as(self, matrix: PETSc.Mat, regularised: PETSc.Mat) -> bool:
        """Factorise a regularised matrix, and test whether the factors solve with a matrix itself;
        those that do not are dropped."""
        self._without_pivots.setOperators(regularised)
        self._without_pivots.setUp()
        if self._is_accurate(matrix):
            return True
        self._reset()
        return False

    def _solve(self, matrix: PETSc.Mat, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve by the factors in use, with refinements where they are those of (1) of
        `SaddlePoint`."""
        self._in_use.apply(b, x)
        if self._saddle_point is None or self._in_use is not self._without_pivots:
            return
        for _ in range(REFINEMENTS):
            matrix.mult(x, self._remainder)
            self._remainder.aypx(-1.0, b)
            self._in_use.apply(self._remainder, self._correction)
            x.axpy(1.0, self._correction)

    def _is_accurate(self, matrix: PETSc.Mat) -> bool:
        """Whether the factors without pivots solve A x = b, where all entries of b are one, for
        multipliers the diagonal of C K⁻¹ Cᵀ, to a relative residual of 1e-10 of the rows."""
        if self._without_pivots.getFailedReason() != PETSc.PC.FailedReason.NOERROR:
            return False
        assert self._right is not None, "setUp makes it"
        self._solve(matrix, self._right, self._solution)
        matrix.mult(self._solution, self._product)
        self._product.axpy(-1.0, self._right)
        self._product.pointwiseDivide(self._product, self._right)
        # Written so that NaN counts as inaccurate.
        return bool(self._product.norm() <= MAX_BLOCK_RESIDUAL * self._right.getSize() ** 0.5)

    def _reset(self) -> None:
        """Discard factors that failed: PETSc would not try the next matrix."""
        self._without_pivots.reset()
        self._without_pivots.setFailedReason(PETSc.PC.FailedReason.NOERROR)

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve A x = b; x is NaN if A could not be factorised, so that the caller's iteration
        ends."""
        if self.problem:
            x.array[:] = np.nan
        else:
            self._solve(pc.getOperators()[1], b, x)

    def __str__(self) -> str:
        return "a factorisation of blocks"


@cache
def _minimum_degree() -> str:
    """PETSc's name of the order of minimum degree: approximate, which it takes from SuiteSparse, or
    exact, which takes longer."""
    matrix = PETSc.Mat().createAIJ((1, 1), csr=([0, 1], [0], [1.0]), comm=PETSc.COMM_SELF)
    try:
        matrix.getOrdering("amd")
    except PETSc.Error:
        return "qmd"
    return "amd"


# ---- preconditioners that are factorisations -----------------------------------------------------


def choose(pc: PETSc.PC, A: PETSc.Mat | None = None) -> None:
    """Make a preconditioner a factorisation: by LAPACK if A is given and dense, else by MUMPS."""
    if A is not None and A.getType() == PETSc.Mat.Type.SEQDENSE:
        pc.setType("python")
        pc.setPythonContext(Lapack())
        return
    pc.setType("lu")
    pc.setFactorSolverType("mumps")


def new(A: PETSc.Mat, is_scaled: bool) -> PETSc.PC:
    """A factorisation of A by MUMPS, before its set-up.

    Without scaled rows and columns it takes a tenth less time, on two ranks a fifth: 90 instead of
    102 ms for an antenna of 47 thousand unknowns, 464 instead of 530 ms for 170 thousand.  Pivots
    are then chosen among numbers of different units, so that the caller has to test its solutions.
    """
    pc = PETSc.PC().create(A.comm)
    choose(pc)
    pc.setOperators(A)
    if not is_scaled:
        pc.setFactorSetUpSolverType()
        pc.getFactorMatrix().setMumpsIcntl(ICNTL_SCALING, 0)
    return pc


def has_blocks(A: PETSc.Mat) -> bool:
    """Whether `BlockFactors` can factorise a matrix: it has 3 x 3 blocks and is on one rank."""
    return bool(A.getType() == PETSc.Mat.Type.SEQBAIJ and A.getBlockSize() == 3)


def choose_for_steps(pc: PETSc.PC, A: PETSc.Mat, saddle_point: SaddlePoint | None = None) -> None:
    """Make a preconditioner the fastest factorisation of matrices like A, which must not be
    singular: those of 3 x 3 blocks on one rank, with at most 1500 unknowns, are factorised by
    PETSc, others by MUMPS.  `saddle_point` is given with Lagrange multipliers.  PETSc's option
    `-gx_pc_type` keeps MUMPS."""
    is_small = A.getSize()[0] <= MAX_UNKNOWNS_BLOCKS
    is_free = PETSc.Options(pc.getOptionsPrefix()).getString("pc_type", "python") == "python"
    if is_small and has_blocks(A) and is_free:
        pc.setType("python")
        pc.setPythonContext(BlockFactors(saddle_point))
    else:
        choose(pc, A)


def is_exact(pc: PETSc.PC) -> bool:
    """Whether a preconditioner solves with its matrix, to round-off."""
    if pc.getType() == "python":
        return getattr(pc.getPythonContext(), "is_exact", False)
    return pc.getType() in TYPES


def set_up(pc: PETSc.PC) -> str:
    """Factorise the matrix of a preconditioner from `choose`, with more workspace if necessary.
    Returns why it failed, e.g. that the matrix is singular; empty if it did not."""
    # The attribute is asked first: PETSc 3.25 fails if there are no factors yet.
    if pc.getAttr("factorised") and failure(pc) < 0:
        renew(pc)
    _factorise(pc)
    while failure(pc) < 0 and enlarge(pc):
        _factorise(pc)
    return reason(pc)


def _factorise(pc: PETSc.PC) -> None:
    """Factorise once, and note that there are factors."""
    pc.setUp()
    pc.setAttr("factorised", True)


def enlarge(pc: PETSc.PC) -> bool:
    """Double the workspace if a factorisation failed for lack of it; returns whether another
    attempt may succeed, False up from the margin `MAX_MARGIN` or after another failure."""
    if failure(pc) not in WORKSPACE_ERRORS:
        return False
    present = pc.getFactorMatrix().getMumpsIcntl(ICNTL_WORKSPACE_MARGIN)
    margin = 2 * max(present, DEFAULT_MARGIN)
    renew(pc, margin)
    return bool(margin <= MAX_MARGIN)


def renew(pc: PETSc.PC, margin: int = 0) -> None:
    """Discard the factors of MUMPS, but not its matrices: after a failure PETSc would not try the
    next matrix.  The margin [%] is that of the workspace over MUMPS's estimate; 0 leaves it as it
    is."""
    operators = pc.getOperators()
    margin = margin or pc.getFactorMatrix().getMumpsIcntl(ICNTL_WORKSPACE_MARGIN)
    pc.reset()
    pc.setAttr("factorised", False)
    pc.setFailedReason(PETSc.PC.FailedReason.NOERROR)
    pc.setOperators(*operators)
    pc.setFactorSetUpSolverType()
    pc.getFactorMatrix().setMumpsIcntl(ICNTL_WORKSPACE_MARGIN, margin)


def replace(pc: PETSc.PC, A: PETSc.Mat) -> None:
    """Make A the matrix of a factorisation, and destroy the one before, whose pattern may differ.

    A new pattern is ordered by approximate minimum fill.  For a folded film with 32 thousand
    unknowns the ordering takes 20 ms instead of 70 ms with the default of MUMPS, and the numerical
    factorisation 87 ms instead of 86 ms.
    """
    before = pc.getOperators()[0]
    if A.handle == before.handle:
        return
    pc.setOperators(A)
    if pc.getFactorSolverType() == "mumps":
        # PETSc discards the factors with the old pattern; `renew` restores the workspace margin.
        renew(pc)
        pc.getFactorMatrix().setMumpsIcntl(ICNTL_ORDERING, ORDERING_BY_MINIMUM_FILL)
    # On several ranks PETSc would otherwise hold the old matrix to the end of the step.
    before.destroy()


def failure(pc: PETSc.PC) -> int:
    """INFOG(1) of the last factorisation: negative if it failed; zero if there was none."""
    if pc.getType() not in TYPES or pc.getFactorSolverType() != "mumps":
        return 0
    return int(pc.getFactorMatrix().getMumpsInfog(1))


def reason(pc: PETSc.PC) -> str:
    """Why the last factorisation, by MUMPS or by the classes of this module, failed; empty if it
    did not."""
    if pc.getType() == "python":
        return str(getattr(pc.getPythonContext(), "problem", ""))
    code = failure(pc)
    if code >= 0:
        return ""
    words = REASONS.get(code, "see its manual")
    detail = int(pc.getFactorMatrix().getMumpsInfog(2))
    return f"MUMPS: {words} (INFOG(1) = {code}, INFOG(2) = {detail})"


# ---- single systems ------------------------------------------------------------------------------


def solve(A: PETSc.Mat, b: PETSc.Vec, x: PETSc.Vec) -> str:
    """Solve A x = b once by a factorisation; returns why it failed, empty if it did not."""
    return _solve(_solver(A), b, x)


def is_singular(A: PETSc.Mat) -> bool:
    """Whether A is singular to round-off: |B| |B⁻¹| > 1/(4 ε) with B, the equilibrated A.
    Collective.

    The rows of a tangent have different units: N/m of positions, N m of directors, none of
    constraints.  B is A with rows and columns scaled until the largest entry of each row is about
    one, so that the answer does not depend on units (Ruiz, RAL-TR-2001-034).  |B⁻¹| is estimated by
    two steps of inverse iteration from a random vector.  A matrix whose factorisation fails counts
    as singular.
    """
    B = equilibrated(A)
    ksp = _solver(B)
    singular = _amplifies(B, lambda b, x: _solve(ksp, b, x))
    ksp.destroy()
    B.destroy()
    return singular


def _amplifies(B: PETSc.Mat, solve_with_factors: Callable[[PETSc.Vec, PETSc.Vec], str]) -> bool:
    """Whether B⁻¹ enlarges a vector by 1/(4 ε |B|) or more, or cannot be applied.  Collective."""
    x, b = B.createVecs()
    b.setRandom()
    norm = B.norm(PETSc.NormType.INFINITY)
    for _ in range(2):
        if solve_with_factors(b, x):
            return True
        amplification = float(x.norm()) / max(float(b.norm()), TINY)
        # Written so that NaN counts as singular.
        if not amplification * norm < MAX_CONDITION:
            return True
        x.copy(b)
        b.normalize()
    return False


class SymmetricFactors:
    """Factors L D Lᵀ by MUMPS of a symmetric matrix, which take half the operations of LU.

    Args:
        A: a matrix of PETSc's type "aij", which is taken over.  One from `equilibrated` has
            eigenvalues of the same signs.

    Attributes:
        pc: solves with the matrix.
        problem: why the factorisation failed; empty if it did not.
        negative: number of negative pivots, by Sylvester's law of inertia that of the negative
            eigenvalues.
    """

    def __init__(self, A: PETSc.Mat) -> None:
        self._matrix = A
        A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self.pc = PETSc.PC().create(A.comm)
        self.pc.setOperators(A)
        self.pc.setType("cholesky")
        self.pc.setFactorSolverType("mumps")
        self.pc.setFactorSetUpSolverType()
        is_complete = False
        while not is_complete:
            # PETSc asks for both: no dense root shared by the ranks, and null pivots recognised.
            # More workspace means new factors, which do not know them.
            self.pc.getFactorMatrix().setMumpsIcntl(13, 1)
            self.pc.getFactorMatrix().setMumpsIcntl(24, 1)
            self.pc.setUp()
            is_complete = failure(self.pc) >= 0 or not enlarge(self.pc)
        self.problem = reason(self.pc)
        self.negative = 0
        self._null = 0
        if not self.problem:
            self.negative, self._null, _ = self.pc.getFactorMatrix().getInertia()

    def is_singular(self) -> bool:
        """Whether the matrix is singular to round-off.  Collective."""
        if self.problem or self._null:
            return True

        def solve_with_factors(b: PETSc.Vec, x: PETSc.Vec) -> str:
            self.pc.apply(b, x)
            return ""

        return _amplifies(self._matrix, solve_with_factors)

    def destroy(self) -> None:
        """Free the factors and the matrix.  Collective."""
        self.pc.destroy()
        self._matrix.destroy()


def equilibrated(A: PETSc.Mat) -> PETSc.Mat:
    """A new matrix D A D whose rows have largest entries of about one."""
    B = A.convert("aij", PETSc.Mat())
    scale = B.createVecLeft()
    for _ in range(EQUILIBRATIONS):
        pointers, _, values = B.getValuesCSR()
        rows = np.repeat(np.arange(len(pointers) - 1), np.diff(pointers))
        largest = np.zeros(len(pointers) - 1)
        np.maximum.at(largest, rows, np.abs(values))
        # Rows of zeros stay as they are.
        scale.array[:] = np.where(largest > 0, largest, 1.0) ** -0.5
        B.diagonalScale(scale, scale)
    scale.destroy()
    return B


def _solver(A: PETSc.Mat) -> PETSc.KSP:
    """A linear solver that factorises A at its first use."""
    ksp = PETSc.KSP().create(A.comm)
    ksp.setOperators(A)
    ksp.setType("preonly")
    choose(ksp.getPC(), A)
    return ksp


def _solve(ksp: PETSc.KSP, b: PETSc.Vec, x: PETSc.Vec) -> str:
    """Solve with a solver of `_solver`; returns why it failed, or nothing."""
    pc = ksp.getPC()
    ksp.solve(b, x)
    while ksp.getConvergedReason() < 0 and enlarge(pc):
        # `enlarge` has reset the preconditioner, which forgets its matrix.
        ksp.setOperators(ksp.getOperators()[0])
        ksp.solve(b, x)
    return reason(pc)


def new_incomplete(comm: MPI.Intracomm) -> PETSc.PC:
    """A preconditioner of incomplete factorisations, before it has a matrix; PETSc's options of it
    have the prefix `gx_local_`.  Several ranks factorise parts that overlap by `OVERLAP` cells
    (additive Schwarz)."""
    pc = PETSc.PC().create(comm)
    pc.setOptionsPrefix(PREFIX + "local_")
    kind = "ilu"
    if comm.size > 1:
        kind = "asm"
    pc.setType(kind)
    pc.setASMOverlap(OVERLAP)
    pc.setFromOptions()
    return pc


def choose_fill(pc: PETSc.PC, levels: int) -> None:
    """Choose the levels of fill, 0 or more, of this rank's incomplete factorisations of a
    preconditioner that has its matrix; a higher level is more accurate and costs more. Collective.
    """
    parts = [pc]
    if pc.getType() == "asm":
        # The parts exist after the first set-up only.
        pc.setUp()
        parts = [ksp.getPC() for ksp in pc.getASMSubKSP()]
    for part in parts:
        part.setType("ilu")
        # Reverse Cuthill-McKee: a small bandwidth makes the incomplete factors more accurate.
        part.setFactorOrdering("rcm")
        part.setFactorLevels(levels)
        part.setFromOptions()


class HardSteps:
    """How many steps are factorised completely, after a solve with many Krylov iterations, before
    an incomplete factorisation is tried again.

    One such solve says little about the next step, several in turn do: their number doubles with
    each, up to a limit, and a step without any halves it.  It concerns time only, and a restarted
    run learns it again from a few solves: it is not in checkpoints.

    Args:
        limit: largest number of steps.

    Attributes:
        left: steps to go, the present one included.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self.left = 0
        self._next = 1  # after the next hard solve
        self._at_start = (self.left, self._next)

    def begin_step(self) -> None:
        """Count a step."""
        self._at_start = (self.left, self._next)
        if not self.left:
            self._next = max(self._next // 2, 1)
        self.left = max(self.left - 1, 0)

    def extend(self) -> None:
        """A solve was hard: factorise the next steps."""
        self.left = self._next
        self._next = min(2 * self._next, self._limit)

    def restore(self) -> None:
        """Return to the state before the step, which was not solved and does not count."""
        self.left, self._next = self._at_start


class LowRankUpdate:
    """Solutions of (A + Σ κ g⊗g) x = b from those of A, by the formula of Sherman, Morrison and
    Woodbury.  Collective.

    `terms` are k pairs of this rank's part of a vector g (n,) and of κ, which is not zero;
    `solve(b, x)` sets x = A⁻¹ b.  `inner` (k, k) is κ⁻¹ + Gᵀ A⁻¹ G with the columns g of G.
    """

    def __init__(
        self,
        A: PETSc.Mat,
        terms: Sequence[tuple[Array, float]],
        solve: Callable[[PETSc.Vec, PETSc.Vec], None],
    ) -> None:
        self._comm = A.comm.tompi4py()
        solution, right = A.createVecs()
        solutions = []
        for vector, _ in terms:
            right.array[:] = vector
            solve(right, solution)
            solutions.append(solution.array_r.copy())
        self._vectors = np.array([vector for vector, _ in terms])
        self._solutions = np.array(solutions)
        self.inner: Array = self._comm.allreduce(self._vectors @ self._solutions.T)
        self.inner += np.diag([1 / factor for _, factor in terms])

    def correct(self, x: PETSc.Vec) -> None:
        """Turn x = A⁻¹ b into (A + Σ κ g⊗g)⁻¹ b, in place.  Collective."""
        amounts = self._comm.allreduce(self._vectors @ x.array_r)
        x.array[:] -= np.linalg.solve(self.inner, amounts) @ self._solutions
