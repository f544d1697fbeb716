"""The coordinates of a reduced body: x = Σ φ_i c_i at the nodes of its mesh, with the unknowns
c."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from dolfinx import fem, la
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from gossamer_fx.core.algebra.numbering import NumberedBlock
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.terms.coordinates import Coordinates


class ReducedCoordinates(Coordinates):
    """Coordinates of which rank 0 owns the unknowns c (r, 3), with x = Φ c at the nodes.

    Forms see functions on the mesh as for any body.  An assembled force b becomes Φᵀb, a matrix K
    becomes ΦᵀKΦ.  Every rank has the coefficients (r, 3) [m] of q1, `end`, and of the increment δ
    of the iteration, `change`: strains follow from them; no form uses δ.
    """

    def __init__(self, space: fem.FunctionSpace, alpha: float, values: Array) -> None:
        super().__init__(space, alpha)
        self._modes = values
        self._comm = space.mesh.comm
        self._owned = space.dofmap.index_map.size_local
        self._matrices: dict[fem.Form, la.MatrixCSR] = {}
        self.end: Array = np.zeros((values.shape[1], 3))
        self.change: Array = self.end

    def take(self, function: fem.Function, unknowns: Array) -> None:
        """Set a function on the mesh [m] from the 3r coefficients of the modes on rank 0; of the
        increment only the coefficients are stored.  Collective."""
        c = coefficients(self._comm, unknowns)
        if function is self.δ:
            self.change = c
            return
        if function is self.q1:
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
        n, r = self._modes.shape
        K: Array = np.zeros((r, 3, r, 3))
        found = False
        for form in forms:
            found = True
            # Only this rank's own cells are assembled: the ranks' shares add up after the
            # projection.
            matrix = self._matrix(form)
            matrix.set_value(np.float64(0))
            fem.assemble_matrix(matrix, form)  # type: ignore[arg-type]
            blocks = matrix.data.reshape(-1, *matrix.block_size)
            # A sparse matrix for each pair of components, as SciPy has no fast product of blocks
            for i, j in np.ndindex(3, 3):
                part = csr_matrix((blocks[:, i, j], matrix.indices, matrix.indptr))
                part.resize(n, n)
                K[:, i, :, j] += self._modes.T @ (part @ self._modes)
        if not found:
            return
        size = 3 * r
        total = self._comm.reduce(K.reshape(size, size))
        if total is not None:
            A.setValues(block.rows, block.rows, total, addv=PETSc.InsertMode.ADD_VALUES)

    def _matrix(self, form: fem.Form) -> la.MatrixCSR:
        """The sparse matrix of a form, created on the first call: its pattern does not change."""
        if form not in self._matrices:
            self._matrices[form] = fem.create_matrix(form)
        return self._matrices[form]


def coefficients(comm: MPI.Intracomm, unknowns: Array) -> Array:
    """The coefficients (r, 3) of a reduced body, which rank 0 owns, on every rank.  Collective."""
    own: Array = unknowns.reshape(-1, 3)
    if comm.size == 1:
        return own
    # A copy, since the unknowns may be a view of a vector that changes.
    return comm.bcast(own.copy())
