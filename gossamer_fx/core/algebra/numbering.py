"""Global numbering of the unknowns of all blocks, and the PETSc objects that follow from it.

A block is the unknowns of one body: nodes with the same number of unknowns each.  The numbering
runs rank by rank, and on each rank block after block, so every rank owns one contiguous range.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.algebra.block_entries import block_assembly
from gossamer_fx.core.forms.backend import add_to_matrix
from gossamer_fx.core.model.body import Block

# Prefix of all PETSc options of the package.
PREFIX = "gx_"

# The matrix is dense where one node (of a reduced body, say) has at least this many unknowns, and
# at least this share of all unknowns.  On one rank a dense matrix then takes a tenth of the time to
# assemble and factorise.
DENSE_NODE_SIZE = 36
DENSE_NODE_SHARE = 1 / 3

GlobalIndices = npt.NDArray[np.int32] | npt.NDArray[np.int64]


class NumberedBlock:
    """Indices of the unknowns of block `k` of a numbering.

    Attributes:
        owned: range of its owned unknowns in the local part of a vector.
    """

    def __init__(self, numbering: Numbering, k: int) -> None:
        self.numbering = numbering
        self.k = k
        self.owned = numbering.owned(k)
        # The last matrix A of `assemble`, and its diagonal block of these unknowns.  It is stored,
        # as for the tangent it would otherwise be made again in each iteration.
        self._matrix: PETSc.Mat | None = None
        self._diagonal_block: PETSc.Mat | None = None
        # What adds forms to it.
        self._entered: dict[fem.Form, Callable[[], None]] = {}

    @property
    def rows(self) -> GlobalIndices:
        """Global indices (n,) of its owned unknowns."""
        rows = self.numbering.start + np.arange(self.owned.start, self.owned.stop)
        return rows.astype(PETSc.IntType)

    def to_global(self, nodes: npt.NDArray[np.integer]) -> GlobalIndices:
        """Global indices (n, size) of the unknowns of global nodes (n,)."""
        return self.numbering.to_global(self.k, np.asarray(nodes, dtype=np.int64))

    def assemble(self, A: PETSc.Mat, forms: Iterable[fem.Form]) -> None:
        """Add compiled bilinear forms of the body's space to the diagonal block of A with its
        unknowns; A is not assembled afterwards."""
        if A is not self._matrix:
            if self._diagonal_block is not None:
                self._diagonal_block.destroy()
            local = self.numbering.local_sets[self.k]
            self._diagonal_block = A.getLocalSubMatrix(local, local)
            self._matrix = A
            self._entered = {}
        for form in forms:
            if form not in self._entered:
                self._entered[form] = self._entering(A, form)
            self._entered[form]()

    def _entering(self, A: PETSc.Mat, form: fem.Form) -> Callable[[], None]:
        """What adds a form to A."""
        numbering = self.numbering
        found = None
        if A is numbering.fixed:
            found = block_assembly(A, form, numbering.indices[self.k])
        if found is not None:
            return found
        # Blocks of nodes can be entered only where the matrix has blocks of the same size.
        unrolled = numbering.block_size != numbering.blocks[self.k].size
        return partial(add_to_matrix, self._diagonal_block, form, unrolled)


class Numbering:
    """Global indices of the unknowns of all blocks, and vectors and matrices of that layout.

    Each rank owns one contiguous range: its share of block 0, then of block 1, and so on.  A block
    is the unknowns of one body; blocks have the same order on all ranks.  Behind them may stand one
    or two unknowns that nothing depends on, where they complete a block of three of the matrix.

    Args:
        comm: the ranks.
        blocks: those of all bodies.
        multipliers: those of Lagrange multipliers, which stand behind them.

    Attributes:
        blocks: of bodies and multipliers.
        size, size_local: number of unknowns on all ranks, and of those that this rank owns.
        unused: range of those of this rank that nothing depends on, at its end.
        start: global index of the first of them.
        local_starts: for each block the index of its first unknown in the local part of a vector;
            the last entry is the end of the last block.
        indices: for each block the global indices of its owned and ghost unknowns.
        local_sets: for each body the index set of these among the local unknowns of all blocks.
        block_size: unknowns of a node if all nodes have equally many; otherwise 3 if the nodes of
            all bodies consist of vectors, and 1 if some do not.
        full: whether matrices are dense.
        fixed: the matrix whose pattern does not change, see `fix_pattern`.
    """

    def __init__(
        self, comm: MPI.Intracomm, blocks: list[Block], multipliers: Sequence[Block] = ()
    ) -> None:
        """Number the unknowns of all blocks, rank by rank and block by block.  Collective."""
        self.fixed: PETSc.Mat | None = None
        self.comm = comm
        # dolfinx enters the unknowns of a node as one block, which PETSc accepts if its own blocks
        # have the same size.  Multipliers are entered one by one.
        self.block_size = _common_block_size({b.size for b in blocks}, bool(multipliers))
        blocks = [*blocks, *multipliers]
        self.blocks = blocks
        sizes = np.array([b.index_map.size_local * b.size for b in blocks], dtype=np.int64)
        used = int(sizes.sum())
        self.size_local = used + -used % self.block_size
        self.unused = slice(used, self.size_local)
        # exscan leaves rank 0 without a value.
        self.start = int(comm.exscan(self.size_local) or 0)
        self.local_starts = np.concatenate([[0], np.cumsum(sizes)])
        self.size = comm.allreduce(self.size_local)

        # For every rank: the global index at which each block begins, and its first node.
        block_starts = self.start + self.local_starts[:-1]
        self._starts = np.array(comm.allgather(block_starts.tolist()), dtype=np.int64)
        self._node_starts = [np.array(comm.allgather(b.index_map.local_range[0])) for b in blocks]
        self.indices = [self._block_indices(k) for k in range(len(blocks))]

        largest = max((b.size for b in blocks), default=0)
        has_large_node = largest >= DENSE_NODE_SIZE and largest >= DENSE_NODE_SHARE * self.size
        self.full = comm.size == 1 and has_large_node

        unused = np.arange(used, self.size_local) + self.start
        everything = np.concatenate([*self.indices, unused]).astype(PETSc.IntType)
        nodes = everything[:: self.block_size] // self.block_size
        self._map = PETSc.LGMap().create(
            nodes,
            bsize=self.block_size,
            comm=comm,
        )
        bodies = self.indices[: len(blocks) - len(multipliers)]
        ends = np.cumsum([0] + [len(indices) for indices in bodies])
        self.local_sets = [self._local_set(start, end) for start, end in pairwise(ends)]

    def _local_set(self, start: int, end: int) -> PETSc.IS:
        """Index set of the local (owned and ghost) unknowns from `start` to `end`, of one block."""
        blocks = np.arange(start // self.block_size, end // self.block_size, dtype=PETSc.IntType)
        return PETSc.IS().createBlock(self.block_size, blocks, comm=MPI.COMM_SELF)

    def _block_indices(self, k: int) -> GlobalIndices:
        """Global indices (n,) of all owned and ghost unknowns of block k."""
        index_map = self.blocks[k].index_map
        count = index_map.size_local + index_map.num_ghosts
        nodes = index_map.local_to_global(np.arange(count, dtype=np.int32))
        return self.to_global(k, nodes).ravel()

    def to_global(self, k: int, nodes: npt.NDArray[np.int64]) -> GlobalIndices:
        """Global indices (n, size) of the unknowns of global nodes (n,) of block k."""
        size = self.blocks[k].size
        owner = np.searchsorted(self._node_starts[k], nodes, side="right") - 1
        node_on_owner = np.asarray(nodes) - self._node_starts[k][owner]
        first = self._starts[owner, k] + node_on_owner * size
        return (first[:, None] + np.arange(size)).astype(PETSc.IntType)

    def owned(self, k: int) -> slice:
        """Range of the owned unknowns of block k in the local part of a vector."""
        return slice(int(self.local_starts[k]), int(self.local_starts[k + 1]))

    def vector(self) -> PETSc.Vec:
        """A new vector of all unknowns, without ghosts."""
        return PETSc.Vec().createMPI((self.size_local, self.size), comm=self.comm)

    def matrix(self) -> PETSc.Mat:
        """Make an empty square PETSc matrix of all unknowns, distributed like `vector`.
        Collective.

        The first assembly determines its sparsity pattern.  It is dense where one node has most of
        the unknowns (`full`).  If nodes consist of blocks of one size it stores blocks (BAIJ),
        which takes half the time of single numbers to assemble, factorise and multiply.  Otherwise
        it is AIJ.  The PETSc option `-gx_mat_type` chooses another type.
        """
        kind = "aij"
        if self.full:
            kind = "dense"
        elif self.block_size > 1:
            kind = "baij"
        A = PETSc.Mat().create(self.comm)
        A.setSizes(((self.size_local, self.size), (self.size_local, self.size)))
        A.setBlockSize(self.block_size)
        A.setType(kind)
        A.setOptionsPrefix(PREFIX)
        A.setFromOptions()
        A.setLGMap(self._map, self._map)
        A.setUp()
        return A

    def fix_pattern(self, A: PETSc.Mat) -> None:
        """Keep the pattern of a matrix, which is assembled, until that of another one is fixed: an
        entry outside raises an error of PETSc."""
        A.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        A.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, True)
        self.fixed = A


def _common_block_size(sizes: set[int], has_multipliers: bool) -> int:
    """Size of the blocks of a matrix whose bodies' nodes have these numbers of unknowns: the number
    itself if there is only one, and no multiplier; 3 if all are multiples of 3; otherwise 1.  A
    rigid body has four vectors, so that one of them in a scene of films leaves the blocks of three.
    """
    if len(sizes) == 1 and not has_multipliers:
        return next(iter(sizes))
    has_vectors = bool(sizes) and all(size % 3 == 0 for size in sizes)
    return 3 if has_vectors else 1
