"""Numbers of eigenvalues below a shift, from the inertia of a factorisation.

Problem.  A Krylov method finds one vector of a multiple eigenvalue; further copies come by
round-off only, and may be left out.

Idea.  By Sylvester's law of inertia the pivots of K - σ M = L D Lᵀ have the signs of its
eigenvalues: the number of negative pivots is that of the eigenvalues ω² below σ.  The difference of
two such numbers is the number of modes between two shifts.  Lagrange multipliers add the same
negative pivots at every shift.  The stiffness of gas, Σ κ g⊗g, is the Schur complement of a
larger matrix:

    [ A   U   ]
    [ Uᵀ -κ⁻¹ ]       n₋(A + U κ Uᵀ) = n₋(A) + n₋(-κ⁻¹ - Uᵀ A⁻¹ U) - n₋(-κ⁻¹)

Cost.  One factorisation for each shift.  Limit: the stiffness has to be symmetric; loads that
follow an open film make it unsymmetric.

Source: as the spectrum slicing of SLEPc (SLEPc Users Manual, section 3.4.5).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.solvers import factorisation

# Norm of K - Kᵀ over that of K, up to which a stiffness counts as symmetric: round-off.
SYMMETRY = 1e-10

DIFFERENT_PATTERN = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN


def is_symmetric(K: PETSc.Mat) -> bool:
    """Whether a matrix is symmetric up to round-off.  Collective."""
    difference = K.transpose(PETSc.Mat())
    difference.axpy(-1.0, K, DIFFERENT_PATTERN)
    result = difference.norm() <= SYMMETRY * K.norm()
    difference.destroy()
    return bool(result)


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
        A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        pc = PETSc.PC().create(A.comm)
        pc.setOperators(A)
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        pc.setFactorSetUpSolverType()
        is_complete = False
        while not is_complete:
            # PETSc asks for both: no dense root shared by the ranks, and null pivots recognised.
            # More workspace means new factors, which do not know them.
            pc.getFactorMatrix().setMumpsIcntl(13, 1)
            pc.getFactorMatrix().setMumpsIcntl(24, 1)
            pc.setUp()
            is_complete = factorisation.failure(pc) >= 0 or not factorisation.enlarge(pc)
        problem = factorisation.reason(pc)
        if problem:
            raise RuntimeError(f"no inertia at the shift {shift:.6g}: {problem}")
        negative, _, _ = pc.getFactorMatrix().getInertia()
        if self._stiffnesses:
            # n₋(-κ⁻¹ - Uᵀ A⁻¹ U) of the module
            inner = factorisation.LowRankUpdate(A, self._stiffnesses, pc.apply).inner
            negative += (np.linalg.eigvalsh(-(inner + inner.T) / 2) < 0).sum()
        pc.destroy()
        A.destroy()
        return int(negative)
