"""Assembly of the tangent of contact: 3 x 3 blocks between block rows, summed over pairs.

Which block rows are coupled changes from step to step, and most of what may touch does not.  Blocks
on the diagonal go into the matrix of the system, whose pattern stays that of a scene without
contact. Blocks between two block rows make a separate matrix, which is built in every iteration of
those that are not zero, and multiplied in addition to the other.

A *block row* is a vector of three unknowns (`geometry.contact_points`).  A *block index* is the row
of a block in the array `blocks`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.algebra.point_measures import Gather
from gossamer_fx.core.algebra.rank_exchange import RankExchange
from gossamer_fx.core.forms.c_source import check_indices
from gossamer_fx.mechanics.contact.contract import (
    Array,
    ByteArray,
    ContactAssembly,
    Int32Array,
    Int64Array,
)
from gossamer_fx.mechanics.contact.geometry.contact_points import ContactPoints
from gossamer_fx.mechanics.contact.kernels.library import library
from gossamer_fx.mechanics.terms.assembly import CouplingBlocks

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


class BlockAssembly:
    """The blocks that the pairs of one contact add to the tangent in one step.

    Attributes:
        blocks: the b blocks (b, 9) [N/m] of this rank's pairs, row by row.  On another rank's block
            rows they are sent to that rank.
    """

    blocks: Array
    # Indices (k,) in `blocks` of those off the diagonal, in the order in which owners get them.
    _sent: Int32Array
    # First unknown of each block row of the coupling matrix; `_coupling_rows` and
    # `_coupling_columns` of its blocks are indices of this array.
    _row_dof: Int64Array
    # Blocks (k, 9) off the diagonal that are not zero, and their block rows and columns (k,).
    _entries: Array
    _entry_rows: Int64Array
    _entry_columns: Int64Array

    def __init__(self, points: ContactPoints, system: ContactAssembly) -> None:
        """Find out which unknowns ranks own; `couple` makes the pattern of a step.  Collective."""
        self._points = points
        self._system = system
        self._comm = system.comm
        self._numbering = system.numbering
        end = self._numbering.start + self._numbering.size_local
        self._ends = np.array(self._comm.allgather(end))
        # Whether all bodies have three unknowns a node, so that matrices have blocks of 3 x 3.
        self._has_node_blocks = self._numbering.block_size == 3
        self.blocks = np.zeros((0, 9))
        self._sort_block_rows()

    def _sort_block_rows(self) -> None:
        """Find order and owner of all block rows that this rank knows."""
        self._first_dof = self._points.first_dof
        # Block rows in the order of their unknowns, and the position of each in this order.
        self._order = np.argsort(self._first_dof)
        self._position = np.argsort(self._order)
        # Ranks own consecutive unknowns, so that their ends decide.
        self._owner = np.searchsorted(self._ends, self._first_dof, side="right")

    # ---- the pattern of a step ----

    def couple(self, *groups: np.ndarray) -> list[Int32Array]:
        """Choose the pattern of the tangent: all block rows within each row of each group are
        coupled.  Collective; `blocks` is zero afterwards.

        `groups`: arrays (n, w) of block rows, each with its own n and w, one row a pair.  Returns
        for each group the block index (n, w w), row in `blocks`, of each two of its block rows.
        """
        # A search may have changed which points this rank knows.
        if self._points.first_dof is not self._first_dof:
            self._sort_block_rows()
        counts = [len(group) for group in groups]
        widths = [group.shape[1] for group in groups]
        sizes = [count * width**2 for count, width in zip(counts, widths, strict=True)]
        room = sum(sizes)
        if room > MAX_BLOCKS:
            raise RuntimeError(
                f"Contact: {sum(counts)} pairs on a rank are too many; use more ranks."
            )
        block_index, rows, columns = self._number_blocks(
            group_size=np.repeat(widths, counts).astype(np.int32),
            members=np.concatenate([group.ravel() for group in groups]).astype(np.int32),
            room=room,
        )
        self.blocks = np.zeros((len(rows), 9))
        self._divide(rows, columns)
        parts = np.split(block_index, np.cumsum(sizes)[:-1])
        return [
            part.reshape(count, width**2)
            for part, count, width in zip(parts, counts, widths, strict=True)
        ]

    def _number_blocks(
        self, group_size: Int32Array, members: Int32Array, room: int
    ) -> tuple[Int32Array, Int32Array, Int32Array]:
        """Number the distinct 3 x 3 blocks of the tangent that groups of block rows couple.

        `group_size`: how many block rows each group has, (g,); `members`: the block rows of all
        groups, one group after the other; `room`: the sum of squared group sizes.  Returns block
        index (room,) of each two members of each group; rows and columns (b,) of the blocks.
        """
        c = library()
        row_count = len(self._position)
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

    def _divide(self, rows: Int32Array, columns: Int32Array) -> None:
        """Divide the 3 x 3 blocks into those on the diagonal and those off it, which are announced
        to the ranks that own their rows; collective.  `rows, columns`: block rows (b,) of each
        block, as this rank numbers them."""
        diagonal = (rows == columns).nonzero()[0]
        self._diagonal = diagonal[np.argsort(self._position[rows[diagonal]])]
        diagonal_rows = rows[self._diagonal]
        self._diagonal_csr = self._csr(diagonal_rows, diagonal_rows, self._first_dof)
        coupling = (rows != columns).nonzero()[0]
        if self._comm.size > 1:
            self._send_to_owners(coupling, rows, columns)
        else:
            self._keep_all(coupling, rows, columns)
        free = self._system.free_marks()
        marks = self._values_at(free)
        free.destroy()
        of_rows = marks[self._coupling_rows]
        of_columns = marks[self._coupling_columns]
        # Most contacts have few blocks with fixed coordinates, or none.
        fixed = np.flatnonzero(~(of_rows.all(axis=1) & of_columns.all(axis=1)))
        free_entries = of_rows[fixed, :, None] * of_columns[fixed, None]
        self._free_entries = free_entries.reshape(-1, 9)
        # Blocks of this rank's block rows, and what finds those that are not zero.
        self._own_blocks = self.blocks
        index = self._sent
        if self._comm.size > 1:
            self._own_blocks = np.zeros((len(self._coupling_rows), 9))
            index = np.arange(len(self._coupling_rows), dtype=np.int32)
        self._own_index = index
        self._fixed = index[fixed]
        count = len(index)
        self._is_nonzero: ByteArray = np.empty(count, dtype=np.uint8)
        c = library()
        self._find_nonzero = partial(
            c.lib.find_nonzero_blocks,
            count,
            c.array("index", index, "int32", (count,)),
            c.array("blocks", self._own_blocks, "float64", (len(self._own_blocks), 9)),
            c.array("is_nonzero", self._is_nonzero, "uint8", (count,), writable=True),
        )

    def _keep_all(self, coupling: np.ndarray, rows: Int32Array, columns: Int32Array) -> None:
        """Sort the 3 x 3 blocks off the diagonal of the only rank by row, then by column.
        `coupling`: indices (k,) of these blocks; `rows, columns`: block rows (b,) of all blocks."""
        # A key names the row and column of a block in the order of the unknowns.
        row_count = len(self._position)
        keys = self._position[rows[coupling]] * row_count + self._position[columns[coupling]]
        order = np.argsort(keys)
        self._sent = coupling[order].astype(np.int32)
        row, column = np.divmod(keys[order], row_count)
        self._coupling_rows = self._order[row]
        self._coupling_columns = self._order[column]
        self._row_dof = self._first_dof

    def _send_to_owners(self, coupling: np.ndarray, rows: Int32Array, columns: Int32Array) -> None:
        """Report to the owners of block rows which 3 x 3 blocks they get; collective.  `coupling`:
        indices (k,) of these blocks; `rows, columns`: block rows (b,) of all blocks, as this rank
        numbers them."""
        self._sent = coupling.astype(np.int32)
        self._exchange = RankExchange(self._comm, self._owner[rows[coupling]])
        # Ranks have different numbers for the same block row, and the same for its first unknown.
        row_dofs = self._exchange.send(self._first_dof[rows[coupling]])
        column_dofs = self._exchange.send(self._first_dof[columns[coupling]])
        self._row_dof, index_of_dof = np.unique(
            np.concatenate([row_dofs, column_dofs]), return_inverse=True
        )
        row, column = np.split(index_of_dof.ravel(), 2)
        row_count = len(self._row_dof)
        keys, self._received = np.unique(row * row_count + column, return_inverse=True)
        self._coupling_rows, self._coupling_columns = np.divmod(keys, max(row_count, 1))
        # An owner need not know the points that other ranks couple with its own.
        self._gather = Gather(self._numbering, [self._row_dof[:, None] + np.arange(3)])

    def _values_at(self, q: PETSc.Vec) -> Array:
        """Return the entries (k, 3) of a vector at the block rows of the coupling matrix;
        collective."""
        if self._comm.size == 1:
            return self._points.of_block_rows(q)
        return self._gather(q)[0]

    # ---- the matrix of the system ----

    def reserve_diagonal(self, A: PETSc.Mat) -> None:
        """Enter zeros, so that the pattern of a matrix holds the blocks on the diagonal of all
        points."""
        blocks = np.zeros((len(self._order), 9))
        self._enter(A, self._csr(self._order, self._order, self._first_dof), blocks)

    def add_diagonal(self, A: PETSc.Mat) -> None:
        """Add the blocks on the diagonal to a matrix."""
        self._enter(A, self._diagonal_csr, self.blocks[self._diagonal])

    def _enter(self, A: PETSc.Mat, pattern: SparseRows, blocks: Array) -> None:
        """Add blocks (k, 9) to a matrix at the entries of a pattern, in the format that it has."""
        if not len(blocks):
            return
        enter = A.setValuesBlockedIJV if self._has_node_blocks else A.setValuesIJV
        enter(
            pattern.ends,
            pattern.columns,
            pattern.values(blocks),
            addv=PETSc.InsertMode.ADD_VALUES,
            rowmap=pattern.rows,
        )

    # ---- the matrix of couplings ----

    def coupling(self, diagonal: PETSc.Vec | None) -> PETSc.Mat | None:
        """Return the matrix [N/m] of the tangent's 3 x 3 blocks between two different block rows,
        zero in the rows and columns of fixed coordinates; None if it has no entries.  Collective.

        Without a diagonal it has all blocks, as they are now.  With the diagonal of the system's
        matrix it has those that a preconditioner needs (`STRONG_COUPLING`), as they were at the
        last call without one, which has to come first.
        """
        if diagonal is None:
            self._fetch_entries()
            strong: Any = slice(None)
        else:
            size = np.abs(self._values_at(diagonal)).max(axis=1)
            squared_norm = np.einsum("ni,ni->n", self._entries, self._entries)
            mean = size[self._entry_rows] * size[self._entry_columns]
            strong = np.flatnonzero(squared_norm > STRONG_COUPLING**2 * mean)
        entries = self._entries[strong]
        if not self._comm.allreduce(len(entries)):
            return None
        pattern = self._csr(self._entry_rows[strong], self._entry_columns[strong], self._row_dof)
        block_size = 3 if self._has_node_blocks else 1
        local_size = self._numbering.size_local
        row_ends = np.zeros(local_size // block_size + 1, dtype=PETSc.IntType)
        row_ends[pattern.rows - self._numbering.start // block_size + 1] = np.diff(pattern.ends)
        ends = np.cumsum(row_ends, dtype=PETSc.IntType)
        csr = (ends, pattern.columns, pattern.values(entries))
        sizes = 2 * ((local_size, self._numbering.size),)
        if self._has_node_blocks:
            return PETSc.Mat().createBAIJ(sizes, 3, csr=csr, comm=self._comm)
        return PETSc.Mat().createAIJ(sizes, csr=csr, comm=self._comm)

    def coupling_blocks(self) -> CouplingBlocks | None:
        """Return all blocks of `coupling` as they are now; None: on several ranks, or where the
        matrices have no blocks of three."""
        if self._comm.size > 1 or not self._has_node_blocks:
            return None
        self._fetch_entries()
        rows = self._row_dof[self._entry_rows] // 3
        columns = self._row_dof[self._entry_columns] // 3
        return CouplingBlocks(rows, columns, self._entries)

    def _fetch_entries(self) -> None:
        """Sum the tangent's 3 x 3 blocks [N/m] of all ranks in this rank's block rows; collective.
        The results are `_entries` (k, 9), with `_entry_rows` and `_entry_columns` (k,).  Blocks
        that are zero are left out; rows and columns of fixed coordinates become zero."""
        blocks = self._own_blocks
        if self._comm.size > 1:
            blocks[:] = 0
            np.add.at(blocks, self._received, self._exchange.send(self.blocks[self._sent]))
        blocks[self._fixed] *= self._free_entries
        self._find_nonzero()
        nonzero = self._is_nonzero.nonzero()[0]
        self._entry_rows = self._coupling_rows[nonzero]
        self._entry_columns = self._coupling_columns[nonzero]
        self._entries = blocks[self._own_index[nonzero]]

    def _csr(
        self, block_rows: np.ndarray, block_columns: np.ndarray, first_dof: Int64Array
    ) -> SparseRows:
        """Return where 3 x 3 blocks of the tangent are in a matrix of PETSc's.  `block_rows,
        block_columns`: of each block (k,), sorted by rows, as indices of `first_dof`, which has the
        first unknown of each.  If the system has no blocks of three, a row of blocks is three
        rows."""
        first = np.flatnonzero(np.diff(block_rows, prepend=-1))
        counts = np.diff(np.append(first, len(block_rows)))
        rows = first_dof[block_rows[first]]
        columns = first_dof[block_columns]
        order = None
        if self._has_node_blocks:
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
