"""The coordinates of a reduced body: x = Σ φ_i c_i at the nodes of its mesh."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from dolfinx import fem, la
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from gossamer_fx.algebra.numbering import NumberedBlock
from gossamer_fx.model.body import Array
from gossamer_fx.terms.coordinates import Coordinates


class ReducedCoordinates(Coordinates):
    """Unknowns are the coefficients c (r, 3) on rank 0; forces and matrices are projected, Φᵀb and ΦᵀKΦ.

    Args:
        values: Φ (n, r) at the owned and ghost nodes of the space.

    Attributes:
        end, change: the coefficients of q1 and δ, on every rank; strains follow from them, and no form has δ.
    """

    def __init__(self, space: fem.FunctionSpace, alpha: float, values: Array) -> None:
        super().__init__(space, alpha)
        self._Φ, self._comm = values, space.mesh.comm
        self._owned = space.dofmap.index_map.size_local
        self._matrices: dict[fem.Form, la.MatrixCSR] = {}
        self.end: Array = np.zeros((values.shape[1], 3))
        self.change: Array = self.end

    def take(self, function: fem.Function, unknowns: Array) -> None:
        c = coefficients(self._comm, unknowns)
        if function is self.δ:
            self.change = c
            return
        if function is self.q1:
            self.end = c
        function.x.array[:] = (self._Φ @ c).ravel()

    def add_forces(self, b: Array, forces: Array) -> None:
        total = self._comm.reduce(self._Φ[: self._owned].T @ b.reshape(-1, 3)[: self._owned])
        if total is not None:
            forces += total.ravel()

    def assemble(self, A: PETSc.Mat, forms: Iterable[fem.Form], block: NumberedBlock) -> None:
        n, r = self._Φ.shape
        K: Array = np.zeros((r, 3, r, 3))
        found = False
        for form in forms:
            # of this rank's own cells; the ranks' shares add up after the projection
            matrix = self._matrices.get(form) or self._matrices.setdefault(
                form, fem.create_matrix(form)
            )
            matrix.set_value(np.float64(0))
            fem.assemble_matrix(matrix, form)  # type: ignore[arg-type]
            blocks = matrix.data.reshape(-1, *matrix.block_size)
            for i, j in np.ndindex(3, 3):
                part = csr_matrix((blocks[:, i, j], matrix.indices, matrix.indptr))
                part.resize(n, n)
                K[:, i, :, j] += self._Φ.T @ (part @ self._Φ)
            found = True
        if not found:
            return
        size = 3 * r
        total = self._comm.reduce(K.reshape(size, size))
        if total is not None:
            A.setValues(block.rows, block.rows, total, addv=PETSc.InsertMode.ADD_VALUES)


def coefficients(comm: MPI.Intracomm, unknowns: Array) -> Array:
    """The coefficients (r, 3), which rank 0 owns, on every rank."""
    c: Array = unknowns.reshape(-1, 3)
    return c if comm.size == 1 else comm.bcast(c.copy())
