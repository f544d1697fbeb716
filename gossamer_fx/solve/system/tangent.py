"""The tangent as a sum: a matrix of fixed pattern, and the couplings of active sets."""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

from gossamer_fx.mechanics.terms.assembly import ActiveSet

DIFFERENT_PATTERN = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN


class Tangent:
    """A + Σ C: A has a fixed sparsity pattern, the couplings C come from terms with active sets,
    whose connectivity changes from step to step."""

    def __init__(self, A: PETSc.Mat, active_sets: Sequence[ActiveSet]) -> None:
        self.A = A
        self._active_sets = active_sets
        self._couplings: list[PETSc.Mat] = []
        self._diagonal: PETSc.Vec | None = None

    def fetch_couplings(self) -> None:
        """Replace the couplings by those at the present iterate, once A is assembled.  The old ones
        are destroyed at once: on several ranks PETSc keeps what Python drops until all ranks
        collect garbage together."""
        for C in self._couplings:
            C.destroy()
        # Without a diagonal: strong and weak ones.
        self._couplings = [C for pairs in self._active_sets for C in pairs.coupling_matrices(None)]

    @property
    def is_coupled(self) -> bool:
        """Whether there are couplings, the same on all ranks."""
        return bool(self._couplings)

    def mult(self, z: PETSc.Vec, out: PETSc.Vec) -> None:
        """Set out = (A + Σ C) z."""
        self.A.mult(z, out)
        self.add_couplings(z, out)

    def add_couplings(self, z: PETSc.Vec, out: PETSc.Vec) -> None:
        """Add Σ C z to `out`."""
        for C in self._couplings:
            # Products instead of a sum, which would build a matrix in every iteration.
            C.multAdd(z, out, out)

    def mult_transpose(self, z: PETSc.Vec, out: PETSc.Vec) -> None:
        """Set out = (A + Σ C)ᵀ z."""
        self.A.multTranspose(z, out)
        for C in self._couplings:
            C.multTransposeAdd(z, out, out)

    def whole(self) -> PETSc.Mat:
        """The sum as one matrix: A itself if nothing is coupled."""
        return self._sum(self._couplings)

    def for_preconditioner(self) -> PETSc.Mat:
        """The part of the tangent [N/m] that a preconditioner needs: A and the strong couplings, as
        a new matrix if there are any.  Collective."""
        strong = self.strong_couplings()
        total = self._sum(strong)
        for C in strong:
            C.destroy()
        return total

    def strong_couplings(self) -> list[PETSc.Mat]:
        """Those couplings [N/m] of contact pairs that are strong compared with the diagonal of A,
        as new matrices, which the caller destroys.  Collective."""
        if not self._couplings:
            return []
        self._diagonal = self.A.getDiagonal(self._diagonal)
        return [C for pairs in self._active_sets for C in pairs.coupling_matrices(self._diagonal)]

    def _sum(self, couplings: Sequence[PETSc.Mat]) -> PETSc.Mat:
        """The sum of A and coupling matrices of contact pairs as one new matrix; A itself if
        nothing is coupled.  Collective."""
        if not couplings:
            return self.A
        # A copy: the pattern of A is fixed, and the couplings have entries elsewhere.
        total = self.A.copy()
        total.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, False)
        for C in couplings:
            total.axpy(1.0, C, DIFFERENT_PATTERN)
        return total
