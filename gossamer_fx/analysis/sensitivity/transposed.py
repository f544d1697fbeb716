"""Linear systems with the transposed tangent."""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

from gossamer_fx.core.checks.errors import InputError
from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.solvers import factorisation

# Relative residual above which a solution is refined, once.  That brings the solution of an
# ill-conditioned tangent, as a stiff film has, from 1e-9 to the round-off of its residual; it costs
# a tenth of a step.
MAX_LINEAR_RESIDUAL = 1e-13


class TransposedSolver:
    """Solves Aᵀ x = b by factors of A; matrices of one pattern share the ordering of the first."""

    def __init__(self, A: PETSc.Mat) -> None:
        # A scene of gas between rigid walls has no coordinates, and MUMPS factorises no empty
        # matrix.
        self._is_empty = A.getSize()[0] == 0
        self._pc = PETSc.PC().create(A.comm)
        self._pc.setOperators(A)
        if not self._is_empty:
            factorisation.choose(self._pc, A)
        self._correction, self._residual = A.createVecs()
        self._update: factorisation.LowRankUpdate | None = None

    def factorise(self, A: PETSc.Mat) -> None:
        """Factorise a matrix with the pattern of the first one; `InputError` if it is singular.
        Collective."""
        self._A = A
        if self._is_empty:
            return
        factorisation.replace(self._pc, A)
        problem = factorisation.set_up(self._pc)
        if problem:
            raise InputError(
                f"gradient: the tangent cannot be factorised, {problem}; "
                "hold the rigid motions of the scene, or give slack film a residual stiffness."
            )

    def add_to_inverse(self, stiffnesses: Sequence[tuple[Array, float]]) -> None:
        """Solve with A + Σ κ g⊗g from now on, κ ≠ 0, by its factors of A and this rank's parts of g
        (n,). Collective."""
        self._update = None
        if stiffnesses:
            self._update = factorisation.LowRankUpdate(self._A, stiffnesses, self._solve)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Set x = A⁻ᵀ b, or that of `add_to_inverse`, refined where that changes it."""
        self._solve(b, x)
        if self._update is not None:
            self._update.correct(x)

    def _solve(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Set x = A⁻ᵀ b."""
        if self._is_empty:
            return
        self._pc.applyTranspose(b, x)
        self._A.multTranspose(x, self._residual)
        self._residual.aypx(-1.0, b)
        # Written so that NaN is refined, too: what asks for the solution then finds it.
        if self._residual.norm() <= MAX_LINEAR_RESIDUAL * b.norm():
            return
        self._pc.applyTranspose(self._residual, self._correction)
        x.axpy(1.0, self._correction)

    def destroy(self) -> None:
        """Free the factors."""
        self._pc.destroy()
