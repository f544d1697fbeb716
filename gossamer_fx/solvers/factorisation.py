"""Factorisations by MUMPS: their workspace, and why one failed, in its own words; those of full matrices by LAPACK.

MUMPS estimates its workspace from the pattern of the matrix.  Pivots that it puts off, as those of multipliers, may
need more; ICNTL(14) is the margin in per cent, and is doubled when INFOG(1) says that it did not do.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc
from scipy.linalg.lapack import dgetrf, dgetrs

EPS = float(np.finfo(float).eps)
MARGIN, LARGEST = (
    20,
    20_000,
)  # % of the estimated workspace: MUMPS's own default, and the last that is tried
MINIMUM_FILL = 2  # ICNTL(7)
TYPES = "lu", "cholesky"
WORKSPACE = (-8, -9, -11, -14, -15, -17, -20)
REASONS = {
    -6: "the matrix is singular by its pattern",
    -10: "the matrix is singular",
    -13: "it ran out of memory",
    -37: "the matrix has numbers that are not finite",
} | dict.fromkeys(WORKSPACE, "its workspace is too small")


class Lapack:
    """LU factors of a dense matrix, as PETSc's Python preconditioner; its own stops the program at a zero pivot."""

    problem = ""

    def setUp(self, pc: PETSc.PC) -> None:
        self._lu, self._pivots, info = dgetrf(pc.getOperators()[1].getDenseArray(readonly=True))
        self.problem = f"LAPACK: {REASONS[-10]}" if info else ""

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        x.array[:] = np.nan if self.problem else dgetrs(self._lu, self._pivots, b.array_r)[0]

    def recover(self) -> None:
        """The next matrix is factorised whatever became of this one."""

    def __str__(self) -> str:
        return "a factorisation by LAPACK"


def choose(pc: PETSc.PC, A: PETSc.Mat | None = None) -> None:
    """Let a preconditioner be a factorisation by MUMPS, or by LAPACK of matrices like A if that is dense."""
    if A is not None and A.getType() == PETSc.Mat.Type.SEQDENSE:
        pc.setType("python")
        pc.setPythonContext(Lapack())
        return
    pc.setType("lu")
    pc.setFactorSolverType("mumps")


def enlarge(pc: PETSc.PC) -> bool:
    """After a factorisation failed: whether its workspace was too small, which has been doubled; then try again."""
    code = failure(pc)
    if code not in WORKSPACE:
        return False
    margin = 2 * max(pc.getFactorMatrix().getMumpsIcntl(14), MARGIN)
    renew(pc, margin)
    return bool(margin <= LARGEST)


def set_up(pc: PETSc.PC) -> str:
    """Factorise its matrix, with a larger workspace where it was too small; returns why it failed, or nothing."""
    if pc.getAttr("factorised") and failure(pc) < 0:  # PETSc 3.25 has no factors to ask before
        renew(pc)
    pc.setUp()
    pc.setAttr("factorised", True)
    while failure(pc) < 0 and enlarge(pc):
        pc.setUp()
    return reason(pc)


def renew(pc: PETSc.PC, margin: int = 0) -> None:
    """Begin anew, as after a failure PETSc would not even try the next matrix; `margin` [%], 0: as before."""
    operators, margin = pc.getOperators(), margin or pc.getFactorMatrix().getMumpsIcntl(14)
    pc.reset()
    pc.setFailedReason(PETSc.PC.FailedReason.NOERROR)
    pc.setOperators(*operators)
    pc.setFactorSetUpSolverType()
    pc.getFactorMatrix().setMumpsIcntl(14, margin)


def replace(pc: PETSc.PC, A: PETSc.Mat) -> None:
    """Let a factorisation be of A, whose pattern may be another one than that of the matrix before.

    PETSc would forget the workspace.  A new pattern is ordered by approximate minimum fill: in a folded film of 32
    thousand unknowns that takes 20 ms where MUMPS's own choice takes 70, and the numbers 87 ms instead of 86.
    """
    before = pc.getOperators()[0]
    pc.setOperators(A)
    if pc.getFactorSolverType() == "mumps" and A.handle != before.handle:
        renew(pc)
        pc.getFactorMatrix().setMumpsIcntl(7, MINIMUM_FILL)
    before.destroy()  # on several ranks it would be kept to the end of the step


def failure(pc: PETSc.PC) -> int:
    """INFOG(1) of the last factorisation: negative if it failed; zero if there was none."""
    if pc.getType() not in TYPES or pc.getFactorSolverType() != "mumps":
        return 0
    return int(pc.getFactorMatrix().getMumpsInfog(1))


def reason(pc: PETSc.PC) -> str:
    """Why the last factorisation failed; nothing if it did not."""
    if pc.getType() == "python":
        return str(getattr(pc.getPythonContext(), "problem", ""))
    code = failure(pc)
    if code >= 0:
        return ""
    return f"MUMPS: {REASONS.get(code, 'see its manual')} (INFOG(1) = {code}, INFOG(2) = {_detail(pc)})"


def _detail(pc: PETSc.PC) -> int:
    return int(pc.getFactorMatrix().getMumpsInfog(2))


def solve(A: PETSc.Mat, b: PETSc.Vec, x: PETSc.Vec) -> str:
    """Solve A x = b once; returns why it failed, or nothing."""
    return _solve(_solver(A), b, x)


def _solver(A: PETSc.Mat) -> PETSc.KSP:
    """It factorises A at its first use."""
    ksp = PETSc.KSP().create(A.comm)
    ksp.setOperators(A)
    ksp.setType("preonly")
    choose(ksp.getPC(), A)
    return ksp


def _solve(ksp: PETSc.KSP, b: PETSc.Vec, x: PETSc.Vec) -> str:
    pc = ksp.getPC()
    ksp.solve(b, x)
    while ksp.getConvergedReason() < 0 and enlarge(pc):
        ksp.setOperators(ksp.getOperators()[0])
        ksp.solve(b, x)
    return reason(pc)


def is_singular(A: PETSc.Mat) -> bool:
    """Whether A is singular to round-off: |A| |A⁻¹| above 1/(4 ε), estimated by two solutions from a random vector."""
    x, b = A.createVecs()
    b.setRandom()
    ksp, size = _solver(A), A.norm(PETSc.NormType.INFINITY)
    for _ in range(2):
        if _solve(ksp, b, x):
            return True
        amplified = float(x.norm()) / max(float(b.norm()), 1e-300)
        if not amplified * size < 1 / (4 * EPS):
            return True
        x.copy(b)
        b.normalize()
    return False
