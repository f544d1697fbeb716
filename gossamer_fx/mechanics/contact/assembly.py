"""Assembly of the tangent of contact: 3 x 3 blocks between block rows, summed over pairs.

Which block rows are coupled changes from step to step, and most of what may touch does not.  Blocks
on the diagonal go into the matrix of the system, whose pattern stays that of a scene without
contact. Blocks between two block rows make a separate matrix, which is built in every iteration of
those that are not zero, and multiplied in addition to the other.

Pairs couple *block rows*, the points that they move; the system has *node rows*
(`geometry.contact_points`).  These are the same, except for points of cells of order 2, which are
sums of nodes.  A *block index* is the row of a block in the array of all blocks of a step.
`BlockAssembly.couple` makes the pattern of a step, which does not change; its methods take the
blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from gossamer_fx.core.algebra.point_measures import Gather
from gossamer_fx.core.algebra.rank_exchange import RankExchange
from gossamer_fx.core.forms.c_source import check_indices
from gossamer_fx.mechanics.contact.contract import (
    Array,
    ByteArray,
    Int32Array,
    Int64Array,
    MaskArray,
)
from gossamer_fx.mechanics.contact.geometry.contact_points import ContactPoints
from gossamer_fx.mechanics.contact.kernels.library import library
from gossamer_fx.mechanics.terms.assembly import Assembly, CouplingBlocks

# Norm of a block over the geometric mean of the two on its diagonal from which a preconditioner
# needs it.  In the inflating tube of docs/theory/contact.md, without them a solve takes 3 to 42
# iterations, with those above a tenth 1 to 13, with those above 3 % 1 to 10, at more than twice the
# fill.
STRONG_COUPLING = 0.1

# Blocks are numbered by 32 bits in C.
MAX_BLOCKS = 2**31 - 1


@dataclass(frozen=True)
class SparseRows:
    """Entries of a sparse matrix as compressed rows, in the format of PETSc.

    Attributes:
        rows: the r rows that have entries.
        ends: where the entries of each begin and end (r + 1,).
        columns: of each entry.
        order: number of the value of each entry in an array of blocks; None: they have this order.
    """

    rows: np.ndarray
    ends: np.ndarray
    columns: np.ndarray
    order: Int64Array | None

    def values(self, blocks: Array) -> Array:
        """The values of all entries, from blocks (k, 9)."""
        values: Array = blocks.ravel()
        return values if self.order is None else values[self.order]


@dataclass(frozen=True, eq=False)
class PairBlocks:
    """Blocks of a tangent to which a group of n pairs adds.

    Attributes:
        index: rows (n, w w) of `values` for each two of the w block rows of a pair.
        values: blocks (b, 9) [N/m] of all groups, row by row.
    """

    index: Int32Array
    values: Array

    def add(self, tangents: Array) -> None:
        """Add tangents (n, w, w, 3, 3) [N/m]."""
        _add_blocks(self.values, self.index.ravel(), tangents)

    def rows(self, which: Any) -> PairBlocks:
        """Return the blocks of some of the pairs."""
        return PairBlocks(self.index[which], self.values)


def _add_blocks(sums: Array, index: np.ndarray, blocks: Array) -> None:
    """Add blocks (n, 9), of any shape, to the rows `index` (n,) of `sums` (b, 9), which may
    repeat."""
    # Of one-dimensional arrays `np.add.at` takes a fifth of the time.
    entries = 9 * index[:, None].astype(np.int64) + np.arange(9)
    np.add.at(sums.reshape(-1), entries.ravel(), blocks.ravel())


@dataclass(frozen=True, eq=False)
class CouplingEntries:
    """Blocks of 3 x 3 between two different block rows, in a rank's rows, zero in the rows and
    columns of fixed coordinates.

    Attributes:
        which: numbers (k,) of these blocks among the couplings of the pattern.
        values: (k, 9) [N/m].
    """

    which: Int64Array
    values: Array


class BlockAssembly:
    """Makes the patterns of what the pairs of one contact add to the tangent."""

    def __init__(self, points: ContactPoints, system: Assembly) -> None:
        """Find out which unknowns ranks own; collective."""
        self._points = points
        self._system = system
        numbering = system.numbering
        self._ends = np.array(system.comm.allgather(numbering.start + numbering.size_local))

    def couple(self, groups: Sequence[np.ndarray]) -> TangentPattern:
        """Return the pattern of a tangent in which all block rows within each row of each group are
        coupled; collective.

        `groups`: arrays (n, w) of block rows, each with its own n and w, one row a pair.
        """
        # Points of this rank change with each search.
        first_dof = self._points.first_dof
        counts = [len(group) for group in groups]
        widths = [group.shape[1] for group in groups]
        sizes = [count * width**2 for count, width in zip(counts, widths, strict=True)]
        if sum(sizes) > MAX_BLOCKS:
            raise RuntimeError(
                f"Contact: {sum(counts)} pairs on a rank are too many; use more ranks."
            )
        members = [np.zeros(0, dtype=np.int32), *(group.ravel() for group in groups)]
        block_index, block_rows, block_columns = _number_blocks(
            group_size=np.repeat(np.array(widths, dtype=np.int32), np.array(counts, dtype=int)),
            members=np.concatenate(members).astype(np.int32),
            room=sum(sizes),
            row_count=self._points.block_row_count,
        )
        transfer = None
        rows = block_rows.astype(np.int64)
        columns = block_columns.astype(np.int64)
        in_matrix: MaskArray = rows == columns
        if self._points.shape is not None:
            transfer, rows, columns, in_matrix = _between_nodes(self._points.shape, rows, columns)
        ends = np.cumsum(sizes)
        index = [
            block_index[end - size : end].reshape(count, width**2)
            for end, size, count, width in zip(ends, sizes, counts, widths, strict=True)
        ]
        # Block rows in the order of their unknowns, and the position of each in this order.
        order = np.argsort(first_dof)
        position = np.argsort(order)
        diagonal = in_matrix.nonzero()[0]
        diagonal = diagonal[np.lexsort((position[columns[diagonal]], position[rows[diagonal]]))]
        coupling = (~in_matrix).nonzero()[0]
        couplings: OwnCouplings | SharedCouplings
        if self._system.comm.size > 1:
            owner = np.searchsorted(self._ends, first_dof, side="right")
            couplings = SharedCouplings.announce(
                coupling.astype(np.int32),
                owners=owner[rows[coupling]],
                row_dofs=first_dof[rows[coupling]],
                column_dofs=first_dof[columns[coupling]],
                system=self._system,
            )
        else:
            # A key names the row and column of a block in the order of the unknowns.
            keys = position[rows[coupling]] * len(order) + position[columns[coupling]]
            sort = np.argsort(keys)
            row, column = np.divmod(keys[sort], len(order))
            couplings = OwnCouplings(
                rows=order[row],
                columns=order[column],
                first_dof=first_dof,
                index=coupling[sort].astype(np.int32),
                points=self._points,
            )
        free = self._system.free_marks()
        marks = couplings.values_at(free)
        free.destroy()
        of_rows = marks[couplings.rows]
        of_columns = marks[couplings.columns]
        # Most contacts have few blocks with fixed coordinates, or none.
        fixed = np.flatnonzero(~(of_rows.all(axis=1) & of_columns.all(axis=1)))
        free_entries = of_rows[fixed, :, None] * of_columns[fixed, None]
        has_node_blocks = self._system.numbering.block_size == 3
        return TangentPattern(
            system=self._system,
            has_node_blocks=has_node_blocks,
            count=len(block_rows),
            index=index,
            transfer=transfer,
            diagonal=diagonal,
            diagonal_rows=_csr(rows[diagonal], columns[diagonal], first_dof, has_node_blocks),
            couplings=couplings,
            fixed=couplings.index[fixed],
            free_entries=free_entries.reshape(-1, 9),
        )

    def reserve_diagonal(self, A: PETSc.Mat) -> None:
        """Enter zeros, so that the pattern of a matrix holds the blocks on the diagonal of all
        node rows.  Those between nodes of one cell are in the pattern of its film."""
        first_dof = self._points.first_dof
        order = np.argsort(first_dof)
        has_node_blocks = self._system.numbering.block_size == 3
        pattern = _csr(order, order, first_dof, has_node_blocks)
        _enter(A, pattern, np.zeros((len(order), 9)), has_node_blocks)


@dataclass(frozen=True, eq=False)
class OwnCouplings:
    """Where the k blocks off the diagonal belong on the only rank, sorted by row, then by column.

    Attributes:
        rows, columns: node rows of each block (k,).
        first_dof: first unknown of each node row.
        index: of each block (k,), in the array that `sums` returns.
    """

    rows: Int64Array
    columns: Int64Array
    first_dof: Int64Array
    index: Int32Array
    points: ContactPoints

    def sums(self, blocks: Array) -> Array:
        """Return the blocks (b, 9) themselves: no other rank has any."""
        return blocks

    def values_at(self, q: PETSc.Vec) -> Array:
        """Return the entries (u, 3) of a vector of the system at all node rows."""
        return self.points.of_node_rows(q)


@dataclass(frozen=True, eq=False)
class SharedCouplings:
    """Where the k blocks off the diagonal belong that all ranks add to the node rows of this one,
    sorted by row, then by column.

    Attributes:
        rows, columns: node rows of each block (k,), numbered by `first_dof`.
        first_dof: first unknown of each node row that this rank's blocks need.
        index: of each block (k,), in the array that `sums` returns.
        sent: indices of this rank's blocks, in the order in which their owners get them.
        received: number (r,) of each block that this rank gets.
    """

    rows: Int64Array
    columns: Int64Array
    first_dof: Int64Array
    index: Int32Array
    sent: Int32Array
    received: Int64Array
    exchange: RankExchange
    gather: Gather

    @classmethod
    def announce(
        cls,
        sent: Int32Array,
        *,
        owners: Int64Array,
        row_dofs: Int64Array,
        column_dofs: Int64Array,
        system: Assembly,
    ) -> SharedCouplings:
        """Report to the owners of node rows which blocks they get; collective.  `sent`: indices
        (s,) of these blocks; `owners`: ranks (s,); `row_dofs`, `column_dofs`: first unknowns (s,)
        of their node rows and columns."""
        exchange = RankExchange(system.comm, owners)
        # Ranks have different numbers for the same node row, and the same for its first unknown.
        of_all_ranks = np.concatenate([exchange.send(row_dofs), exchange.send(column_dofs)])
        first_dof, index_of_dof = np.unique(of_all_ranks, return_inverse=True)
        row, column = np.split(index_of_dof.ravel(), 2)
        row_count = len(first_dof)
        keys, received = np.unique(row * row_count + column, return_inverse=True)
        rows, columns = np.divmod(keys, max(row_count, 1))
        return cls(
            rows=rows,
            columns=columns,
            first_dof=first_dof,
            index=np.arange(len(keys), dtype=np.int32),
            sent=sent,
            received=received,
            exchange=exchange,
            # An owner need not know the points that other ranks couple with its own.
            gather=Gather(system.numbering, [first_dof[:, None] + np.arange(3)]),
        )

    def sums(self, blocks: Array) -> Array:
        """Return the sums (k, 9) over all ranks of blocks (b, 9); collective."""
        sums = np.zeros((len(self.rows), 9))
        _add_blocks(sums, self.received, self.exchange.send(blocks[self.sent]))
        return sums

    def values_at(self, q: PETSc.Vec) -> Array:
        """Return the entries (u, 3) of a vector of the system at all node rows; collective."""
        return self.gather(q)[0]


@dataclass(frozen=True, eq=False)
class TangentPattern:
    """Which 3 x 3 blocks the pairs of a step add to the tangent, and where they go.

    Attributes:
        has_node_blocks: whether all bodies have three unknowns a node, so that matrices have blocks
            of 3 x 3.
        count: b, the number of blocks of this rank's pairs.
        index: of each two block rows of each pair (n, w w), for each group of pairs.
        transfer: weights (k, b) of the blocks between block rows in those between node rows; None:
            they are the same.
        diagonal, diagonal_rows: indices of the blocks in the matrix of the system, those on its
            diagonal or between nodes of a cell of order 2, and where they are in it.
        couplings: the other blocks.
        fixed, free_entries: indices (f,) of couplings with fixed coordinates, and 1 for each of
            their entries (f, 9) that is between two that are not, else 0.
    """

    system: Assembly
    has_node_blocks: bool
    count: int
    index: Sequence[Int32Array]
    transfer: csr_matrix | None
    diagonal: np.ndarray
    diagonal_rows: SparseRows
    couplings: OwnCouplings | SharedCouplings
    fixed: Int32Array
    free_entries: Array

    def between_nodes(self, blocks: Array) -> Array:
        """Return the blocks (k, 9) between node rows from those (b, 9) between block rows."""
        return blocks if self.transfer is None else np.asarray(self.transfer @ blocks)

    def add_diagonal(self, A: PETSc.Mat, blocks: Array) -> None:
        """Add those of blocks (k, 9) between node rows that are in the matrix of the system."""
        _enter(A, self.diagonal_rows, blocks[self.diagonal], self.has_node_blocks)

    @cached_property
    def _index_pointer(self) -> Any:
        """`couplings.index` as C takes it."""
        index = self.couplings.index
        return library().array("index", index, "int32", index.shape)

    def entries(self, blocks: Array) -> CouplingEntries:
        """Sum those of blocks (k, 9) that are couplings in this rank's node rows; collective.
        Blocks that are zero are left out.  Entries of fixed coordinates are set to zero, also in
        `blocks`."""
        sums = self.couplings.sums(blocks)
        # In place: a copy of all blocks would take longer than what follows.
        sums[self.fixed] *= self.free_entries
        index = self.couplings.index
        is_nonzero: ByteArray = np.empty(len(index), dtype=np.uint8)
        c = library()
        c.lib.find_nonzero_blocks(
            len(index),
            self._index_pointer,
            c.array("blocks", sums, "float64", (len(sums), 9)),
            c.array("is_nonzero", is_nonzero, "uint8", index.shape, writable=True),
        )
        nonzero = is_nonzero.nonzero()[0]
        return CouplingEntries(nonzero, sums[index[nonzero]])

    def strong(self, entries: CouplingEntries, diagonal: PETSc.Vec) -> CouplingEntries:
        """Return the couplings that a preconditioner needs (`STRONG_COUPLING`) besides a matrix
        with this diagonal; collective."""
        size = np.abs(self.couplings.values_at(diagonal)).max(axis=1)
        squared_norm = np.einsum("ni,ni->n", entries.values, entries.values)
        rows = self.couplings.rows[entries.which]
        columns = self.couplings.columns[entries.which]
        mean = size[rows] * size[columns]
        strong = np.flatnonzero(squared_norm > STRONG_COUPLING**2 * mean)
        return CouplingEntries(entries.which[strong], entries.values[strong])

    def matrix(self, entries: CouplingEntries) -> PETSc.Mat | None:
        """Return couplings as a new matrix [N/m]; None if no rank has any.  Collective."""
        comm = self.system.comm
        if not comm.allreduce(len(entries.which)):
            return None
        first_dof = self.couplings.first_dof
        rows = self.couplings.rows[entries.which]
        columns = self.couplings.columns[entries.which]
        pattern = _csr(rows, columns, first_dof, self.has_node_blocks)
        numbering = self.system.numbering
        block_size = 3 if self.has_node_blocks else 1
        local_size = numbering.size_local
        row_ends = np.zeros(local_size // block_size + 1, dtype=PETSc.IntType)
        row_ends[pattern.rows - numbering.start // block_size + 1] = np.diff(pattern.ends)
        ends = np.cumsum(row_ends, dtype=PETSc.IntType)
        csr = (ends, pattern.columns, pattern.values(entries.values))
        sizes = 2 * ((local_size, numbering.size),)
        if self.has_node_blocks:
            return PETSc.Mat().createBAIJ(sizes, 3, csr=csr, comm=comm)
        return PETSc.Mat().createAIJ(sizes, csr=csr, comm=comm)

    @cached_property
    def _nodes(self) -> tuple[Int64Array, Int64Array]:
        """Row and column (k,) of each coupling in a matrix of blocks."""
        first_dof = self.couplings.first_dof
        return first_dof[self.couplings.rows] // 3, first_dof[self.couplings.columns] // 3

    def blocks(self, entries: CouplingEntries) -> CouplingBlocks | None:
        """Return couplings as blocks of the matrix of the system; None: on several ranks, or where
        it has no blocks of three."""
        if self.system.comm.size > 1 or not self.has_node_blocks:
            return None
        rows, columns = self._nodes
        return CouplingBlocks(rows[entries.which], columns[entries.which], entries.values)


def _number_blocks(
    group_size: Int32Array, members: Int32Array, room: int, row_count: int
) -> tuple[Int32Array, Int32Array, Int32Array]:
    """Number the distinct 3 x 3 blocks of the tangent that groups of block rows couple.

    `group_size`: how many block rows each group has, (g,); `members`: the block rows of all groups,
    one group after the other; `room`: the sum of squared group sizes; `row_count`: number of block
    rows.  Returns block index (room,) of each two members of each group; rows and columns (b,) of
    the blocks.
    """
    c = library()
    check_indices("The block rows of pairs", members, row_count)
    block_index: Int32Array = np.empty(room, dtype=np.int32)
    rows: Int32Array = np.empty(room, dtype=np.int32)
    columns: Int32Array = np.empty(room, dtype=np.int32)
    row_work: Int32Array = np.empty(3 * row_count + 2, dtype=np.int32)
    # Work space is allocated here, since the C functions allocate nothing.
    member_work: Int32Array = np.empty(4 * len(members), dtype=np.int32)
    groups = c.struct(
        "block_groups",
        {
            "group_count": len(group_size),
            "row_count": row_count,
            "group_size": c.array("group_size", group_size, "int32", (len(group_size),)),
            "members": c.array("members", members, "int32", (len(members),)),
        },
    )
    pattern = c.struct(
        "block_pattern",
        {
            name: c.array(name, values, "int32", values.shape, writable=True)
            for name, values in (
                ("block_index", block_index),
                ("rows", rows),
                ("columns", columns),
                ("row_work", row_work),
                ("member_work", member_work),
            )
        },
    )
    count = c.lib.number_blocks(groups.pointer, pattern.pointer)
    return block_index, rows[:count], columns[:count]


def _between_nodes(
    shape: csr_matrix, rows: Int64Array, columns: Int64Array
) -> tuple[csr_matrix, Int64Array, Int64Array, MaskArray]:
    """Express b blocks between block rows by k blocks between node rows: Sᵀ K S, for the shape
    functions S (v, u).  `rows, columns`: block rows (b,) of the blocks.

    Returns the weights (k, b) of the given blocks in the new ones; node rows (k,) and columns (k,)
    of these; and which of them (k,) are of one point, between nodes of one cell.
    """
    node_count = np.diff(shape.indptr)
    row_nodes = node_count[rows]
    column_nodes = node_count[columns]
    of_block = row_nodes * column_nodes
    if of_block.sum() > MAX_BLOCKS:
        raise RuntimeError(f"Contact: {len(rows)} blocks on a rank are too many; use more ranks.")
    # Every node of a row with every node of a column.
    block = np.repeat(np.arange(len(rows)), of_block)
    number = np.arange(len(block)) - np.repeat(np.cumsum(of_block) - of_block, of_block)
    row_number, column_number = np.divmod(number, column_nodes[block])
    row_entry = shape.indptr[rows[block]] + row_number
    column_entry = shape.indptr[columns[block]] + column_number
    keys = shape.indices[row_entry].astype(np.int64) * shape.shape[1] + shape.indices[column_entry]
    distinct, target = np.unique(keys, return_inverse=True)
    weights = shape.data[row_entry] * shape.data[column_entry]
    transfer = csr_matrix((weights, (target, block)), shape=(len(distinct), len(rows)))
    is_in_cell = np.zeros(len(distinct), dtype=bool)
    is_in_cell[target[(rows == columns)[block]]] = True
    node_rows, node_columns = np.divmod(distinct, shape.shape[1])
    return transfer, node_rows, node_columns, is_in_cell


def _enter(A: PETSc.Mat, pattern: SparseRows, blocks: Array, has_node_blocks: bool) -> None:
    """Add blocks (k, 9) to a matrix at the entries of a pattern, in the format that it has."""
    if not len(blocks):
        return
    enter = A.setValuesBlockedIJV if has_node_blocks else A.setValuesIJV
    enter(
        pattern.ends,
        pattern.columns,
        pattern.values(blocks),
        addv=PETSc.InsertMode.ADD_VALUES,
        rowmap=pattern.rows,
    )


def _csr(
    block_rows: np.ndarray, block_columns: np.ndarray, first_dof: Int64Array, has_node_blocks: bool
) -> SparseRows:
    """Return where 3 x 3 blocks of the tangent are in a matrix of PETSc's.  `block_rows,
    block_columns`: of each block (k,), sorted by rows, as indices of `first_dof`, which has the
    first unknown of each.  Without blocks of three in the system, a row of blocks is three rows."""
    first = np.flatnonzero(np.diff(block_rows, prepend=-1))
    counts = np.diff(np.append(first, len(block_rows)))
    rows = first_dof[block_rows[first]]
    columns = first_dof[block_columns]
    order = None
    if has_node_blocks:
        rows = rows // 3
        columns = columns // 3
    else:
        columns, order = _unrolled(columns, first, counts)
        rows = (rows[:, None] + np.arange(3)).ravel()
        # Each row of blocks becomes three rows with three entries a block.
        counts = np.repeat(3 * counts, 3)
    ends = np.append(0, np.cumsum(counts))
    return SparseRows(
        rows.astype(PETSc.IntType),
        ends.astype(PETSc.IntType),
        columns.astype(PETSc.IntType),
        order,
    )


def _unrolled(
    columns: Int64Array, first: Int64Array, counts: Int64Array
) -> tuple[Int64Array, Int64Array]:
    """Return the columns (9 k,) of k blocks in the order of scalar rows, of which a row of blocks
    is three, and the entries (9 k,) of the blocks in this order.  `columns`:
    first column (k,) of each block; `first`, `counts`: index of the first block of each row of
    blocks, and how many it has, which are consecutive."""
    total = len(columns)
    # In a row of n blocks entry (c, d) of a block is 3 n entries behind its entry (c - 1, d).
    start = np.repeat(first, counts)
    count = np.repeat(counts, counts)
    row_in_block = np.arange(3)[:, None]
    column_in_block = np.arange(3)
    first_entry = 9 * start + 3 * (np.arange(total) - start)
    entry = first_entry[:, None, None] + column_in_block
    entry = (entry + row_in_block * (3 * count)[:, None, None]).ravel()
    order: Int64Array = np.empty(9 * total, dtype=np.int64)
    order[entry] = np.arange(9 * total)
    in_block = columns[:, None, None] + column_in_block + 0 * row_in_block
    return in_block.ravel()[order], order
