"""The tangent as a sum: a matrix whose pattern stays, and what couples places that change from step to step."""

from __future__ import annotations

from collections.abc import Sequence

from petsc4py import PETSc

from gossamer_fx.model.terms import CompiledTerms

DIFFERENT = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN


class Tangent:
    """A + Σ C, where A is assembled and `take` fetches the couplings C of what searches."""

    def __init__(self, A: PETSc.Mat, searching: Sequence[CompiledTerms]) -> None:
        self.A = A
        self._searching, self._couplings = searching, list[PETSc.Mat]()
        self._diagonal: PETSc.Vec | None = None

    def take(self) -> None:
        """A was assembled anew."""
        for C in self._couplings:
            C.destroy()
        self._couplings = [C for terms in self._searching for C in terms.couplings(None)]

    def mult(self, z: PETSc.Vec, out: PETSc.Vec) -> None:
        """Out = (A + Σ C) z."""
        self.A.mult(z, out)
        for C in self._couplings:
            C.multAdd(z, out, out)

    def whole(self) -> PETSc.Mat:
        """All of it as one matrix: A itself if nothing is coupled."""
        return self._sum(self._couplings)

    def strong(self) -> PETSc.Mat:
        """A and the couplings that a preconditioner needs."""
        if not self._couplings:
            return self.A
        self._diagonal = self.A.getDiagonal(self._diagonal)
        strong = [C for terms in self._searching for C in terms.couplings(self._diagonal)]
        found = self._sum(strong)
        for C in strong:
            C.destroy()
        return found

    def _sum(self, couplings: Sequence[PETSc.Mat]) -> PETSc.Mat:
        if not couplings:
            return self.A
        total = self.A.copy()
        total.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, False)
        for C in couplings:
            total.axpy(1.0, C, DIFFERENT)
        return total
