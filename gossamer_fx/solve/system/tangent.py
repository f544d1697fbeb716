"""The tangent as a sum: a matrix of fixed pattern, and the couplings of active sets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.core.algebra.block_entries import block_keys, stored_blocks
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.terms.assembly import ActiveSet, CouplingBlocks

DIFFERENT_PATTERN = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN

# Integers of blocks: their keys, positions, rows or columns.
Keys = npt.NDArray[np.int64]

# A pattern that lacks a coupling is made again.  It keeps the couplings of iterations before while
# they are not more than this multiple of the present ones: pairs come and go, and each new pattern
# costs an ordering of the unknowns, each coupling too many fill.
KEPT_COUPLINGS = 1.5

# Entries of a block that has them row by row, in the order in which PETSc stores them.
BY_COLUMNS = [0, 3, 6, 1, 4, 7, 2, 5, 8]


class Tangent:
    """A + Σ C: A has a fixed sparsity pattern, the couplings C come from terms with active sets,
    whose connectivity changes from step to step."""

    def __init__(self, A: PETSc.Mat, active_sets: Sequence[ActiveSet]) -> None:
        self.A = A
        self._active_sets = active_sets
        # Couplings as blocks, or else as matrices, which are made of the blocks when asked for.
        self._blocks: list[CouplingBlocks] = []
        self._matrices: list[PETSc.Mat] | None = []
        self._diagonal: PETSc.Vec | None = None
        self._sum: BlockSum | None = None

    def fetch_couplings(self) -> None:
        """Replace the couplings by those at the present iterate, once A is assembled.  The old ones
        are destroyed at once: on several ranks PETSc keeps what Python drops until all ranks
        collect garbage together."""
        for C in self._matrices or ():
            C.destroy()
        found = [pairs.coupling_blocks() for pairs in self._active_sets]
        self._blocks = [blocks for blocks in found if blocks is not None and blocks.values.size]
        self._matrices = None
        if None in found:
            self._blocks = []
            # Without a diagonal: strong and weak ones.
            self._matrices = [
                C for pairs in self._active_sets for C in pairs.coupling_matrices(None)
            ]

    @property
    def _couplings(self) -> list[PETSc.Mat]:
        """The matrices C."""
        if self._matrices is None:
            row_count = self.A.getSize()[0] // 3
            self._matrices = [
                _block_matrix(blocks.rows, blocks.columns, blocks.values, row_count)
                for blocks in self._blocks
            ]
        return self._matrices

    @property
    def is_coupled(self) -> bool:
        """Whether there are couplings, the same on all ranks."""
        return bool(self._blocks or self._couplings)

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
        return self._sum_with(self._couplings)

    def for_factorisation(self) -> PETSc.Mat:
        """The sum as one matrix, which the next call may overwrite: its pattern is kept while it
        has all couplings, so that the unknowns are not ordered again in each iteration."""
        # The user may choose another type of matrices.
        if not self._blocks or self.A.getType() != PETSc.Mat.Type.SEQBAIJ:
            return self.whole()
        if self._sum is None:
            self._sum = BlockSum(self.A)
        return self._sum.set(self._blocks)

    def for_preconditioner(self) -> PETSc.Mat:
        """The part of the tangent [N/m] that a preconditioner needs: A and the strong couplings, as
        a new matrix if there are any.  Collective."""
        strong = self.strong_couplings()
        total = self._sum_with(strong)
        for C in strong:
            C.destroy()
        return total

    def strong_couplings(self) -> list[PETSc.Mat]:
        """Those couplings [N/m] of contact pairs that are strong compared with the diagonal of A,
        as new matrices, which the caller destroys.  Collective."""
        if not self.is_coupled:
            return []
        self._diagonal = self.A.getDiagonal(self._diagonal)
        return [C for pairs in self._active_sets for C in pairs.coupling_matrices(self._diagonal)]

    def _sum_with(self, couplings: Sequence[PETSc.Mat]) -> PETSc.Mat:
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


class BlockSum:
    """A matrix of 3 x 3 blocks on one rank, and couplings, summed in one matrix of both patterns.

    Blocks are named by their keys (`block_keys`), which in ascending order are those of the
    matrix's values.
    """

    def __init__(self, A: PETSc.Mat) -> None:
        """Take A, which is assembled and whose pattern does not change."""
        self._row_count = A.getSize()[0] // 3
        self._keys_of_A = block_keys(A)
        self._values_of_A = stored_blocks(A)
        # Keys of the matrix, of which there is none yet, and of its blocks that A has not.
        self._keys: Keys = np.zeros(0, dtype=np.int64)
        self._added_keys: Keys = self._keys

    def set(self, couplings: Sequence[CouplingBlocks]) -> PETSc.Mat:
        """Return the sum of A and couplings with their present values, at least one block, as the
        matrix of the last call or a new one."""
        keys = [blocks.rows * self._row_count + blocks.columns for blocks in couplings]
        positions = [self._keys.searchsorted(some) for some in keys]
        for at, some in zip(positions, keys, strict=True):
            if not self._keys.size or (self._keys.take(at, mode="clip") != some).any():
                self._make(np.concatenate(keys))
                positions = [self._keys.searchsorted(some) for some in keys]
                break
        # Without `mode` NumPy would fill a copy of the array first.
        self._values_of_A.take(self._positions_in_A, axis=0, out=self._values, mode="clip")
        self._values[self._added] = 0
        for blocks, at in zip(couplings, positions, strict=True):
            self._values[at] += blocks.values[:, BY_COLUMNS]
        self._matrix.stateIncrease()
        return self._matrix

    def _make(self, keys: Keys) -> None:
        """Make the matrix again, with blocks of these keys (k,)."""
        needed: Keys = np.unique(keys[~_are_among(keys, self._keys_of_A)])
        self._added_keys = np.union1d(self._added_keys, needed)
        if len(self._added_keys) > KEPT_COUPLINGS * len(needed):
            self._added_keys = needed
        self._keys = np.sort(np.concatenate([self._keys_of_A, self._added_keys]), kind="stable")
        self._added = np.searchsorted(self._keys, self._added_keys)
        # For blocks that A has not: the position of another one.
        self._positions_in_A = np.searchsorted(self._keys_of_A, self._keys)
        rows, columns = np.divmod(self._keys, self._row_count)
        zeros = np.zeros((len(rows), 9))
        self._matrix = _block_matrix(rows, columns, zeros, self._row_count)
        self._values = stored_blocks(self._matrix)


def _are_among(keys: Keys, sorted_keys: Keys) -> npt.NDArray[np.bool_]:
    """Which keys (k,) are among others that are sorted."""
    if not len(sorted_keys):
        return np.zeros(len(keys), dtype=bool)
    return np.take(sorted_keys, np.searchsorted(sorted_keys, keys), mode="clip") == keys


def _block_matrix(rows: Keys, columns: Keys, values: Array, row_count: int) -> PETSc.Mat:
    """A new square matrix on one rank of 3 x 3 blocks (k, 9), sorted by row, then by column."""
    ends = np.append(0, np.cumsum(np.bincount(rows, minlength=row_count)))
    csr = (ends.astype(PETSc.IntType), columns.astype(PETSc.IntType), values)
    size = 3 * row_count
    return PETSc.Mat().createBAIJ(((size, size), (size, size)), 3, csr=csr, comm=PETSc.COMM_SELF)
