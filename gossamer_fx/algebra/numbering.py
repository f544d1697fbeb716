"""One numbering for the unknowns of all blocks: rank by rank, on each rank block after block."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.forms.backend import add_to_matrix
from gossamer_fx.model.body import Block

PREFIX = "gx_"  # of PETSc's options
# a node with at least as many numbers, which are a third of all unknowns, makes a matrix full on one rank: it is stored
# as one then, which takes a tenth of the time to enter and factorise
MANY, SHARE = 36, 1 / 3

GlobalIndices = npt.NDArray[np.int32] | npt.NDArray[np.int64]


@dataclass(frozen=True)
class NumberedBlock:
    """One block in the numbering of all: the only way to its unknowns for those who know the body."""

    numbering: Numbering
    k: int

    @property
    def owned(self) -> slice:
        """Where its owned unknowns stand in the local part of a vector."""
        return self.numbering.owned(self.k)

    @property
    def rows(self) -> GlobalIndices:
        """Global indices of its owned unknowns."""
        owned = self.owned
        return (self.numbering.start + np.arange(owned.start, owned.stop)).astype(PETSc.IntType)

    def to_global(self, nodes: npt.NDArray[np.integer]) -> GlobalIndices:
        """Global indices (n, size) of the unknowns of global nodes (n,)."""
        return self.numbering.to_global(self.k, np.asarray(nodes, dtype=np.int64))

    def assemble(self, A: PETSc.Mat, forms: Iterable[fem.Form]) -> None:
        """Add bilinear forms of its space to its diagonal block of A."""
        self.numbering.assemble(A, self.k, forms)


class Numbering:
    """Global indices of the blocks' unknowns, and the PETSc objects that follow from them.

    Each rank owns one contiguous range: its share of block 0, then of block 1, and so on.
    """

    def __init__(self, comm: MPI.Intracomm, blocks: list[Block]) -> None:
        self.comm, self.blocks = comm, blocks
        sizes = np.array([b.index_map.size_local * b.size for b in blocks], dtype=np.int64)
        self.size_local = int(sizes.sum())
        self.start = start = int(comm.exscan(self.size_local) or 0)
        self.local_starts = np.concatenate([[0], np.cumsum(sizes)])
        block_starts = np.array(
            comm.allgather((start + self.local_starts[:-1]).tolist()), dtype=np.int64
        )
        self.size = comm.allreduce(self.size_local)
        self._node_starts = [np.array(comm.allgather(b.index_map.local_range[0])) for b in blocks]
        self._starts = block_starts
        self.indices = [self._block_indices(k) for k in range(len(blocks))]
        # dolfinx enters blocks of a node's numbers at once; PETSc takes them so if all blocks have the same size,
        # and one by one otherwise
        sizes_of_nodes = {b.size for b in blocks}
        self.block_size = sizes_of_nodes.pop() if len(sizes_of_nodes) == 1 else 1
        everything = np.concatenate([np.zeros(0, dtype=PETSc.IntType), *self.indices])
        largest = max((b.size for b in blocks), default=0)
        self.full = comm.size == 1 and largest >= MANY and largest >= SHARE * self.size
        self._map = PETSc.LGMap().create(
            (everything[:: self.block_size] // self.block_size).astype(PETSc.IntType),
            bsize=self.block_size,
            comm=comm,
        )
        ends = np.cumsum([0] + [len(i) for i in self.indices])
        self._local_sets = [self._local_set(a, e) for a, e in pairwise(ends)]

    def _local_set(self, start: int, end: int) -> PETSc.IS:
        """The range of local (owned and ghost) unknowns of one block."""
        blocks = np.arange(start // self.block_size, end // self.block_size, dtype=PETSc.IntType)
        return PETSc.IS().createBlock(self.block_size, blocks, comm=MPI.COMM_SELF)

    def _block_indices(self, k: int) -> GlobalIndices:
        """Global index of every owned and ghost unknown of block k."""
        index_map = self.blocks[k].index_map
        nodes = index_map.local_to_global(
            np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        )
        return self.to_global(k, nodes).ravel()

    def to_global(self, k: int, nodes: npt.NDArray[np.int64]) -> GlobalIndices:
        """Global indices (n, size) of the unknowns of global nodes (n,) of block k."""
        size = self.blocks[k].size
        owner = np.searchsorted(self._node_starts[k], nodes, side="right") - 1
        first = self._starts[owner, k] + (np.asarray(nodes) - self._node_starts[k][owner]) * size
        return (first[:, None] + np.arange(size)).astype(PETSc.IntType)

    def owned(self, k: int) -> slice:
        """Where block k's owned unknowns stand in the local part of a vector."""
        return slice(int(self.local_starts[k]), int(self.local_starts[k + 1]))

    def block(self, k: int) -> NumberedBlock:
        """The k-th block in this numbering."""
        return NumberedBlock(self, k)

    def vector(self) -> PETSc.Vec:
        return PETSc.Vec().createMPI((self.size_local, self.size), comm=self.comm)

    def matrix(self) -> PETSc.Mat:
        """An empty matrix; its pattern is that of the first assembly.

        It stores blocks of a node's numbers if all nodes have as many: they are entered, factorised and multiplied in
        half of the time of single numbers.  A full one is dense.  Option `-gx_mat_type`.
        """
        A = PETSc.Mat().create(self.comm)
        A.setSizes(((self.size_local, self.size), (self.size_local, self.size)))
        A.setBlockSize(self.block_size)
        A.setType("dense" if self.full else "baij" if self.block_size > 1 else "aij")
        A.setOptionsPrefix(PREFIX)
        A.setFromOptions()
        A.setLGMap(self._map, self._map)
        A.setUp()
        return A

    def assemble(self, A: PETSc.Mat, k: int, forms: Iterable[fem.Form]) -> None:
        """Add bilinear forms of the k-th body's space to the block (k, k) of A."""
        local = self._local_sets[k]
        view = A.getLocalSubMatrix(local, local)
        unrolled = self.block_size != self.blocks[k].size
        for form in forms:
            add_to_matrix(view, form, unrolled)
        A.restoreLocalSubMatrix(local, local, view)
