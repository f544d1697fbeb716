"""Blocks of 3 x 3 that contact adds to the tangent: summed by places, those of single vectors apart from the others.

Which vectors are coupled changes from step to step, and most of what may touch does not.  So the blocks on the diagonal
go into the system's matrix, whose pattern stays, and those of two vectors into a matrix of their own, which is made
anew in each iteration of what is not zero.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.contact.geometry.contact_points import ContactPoints
from gossamer_fx.contact.kernels.library import Array, Integers, library, pointers

STRONG = 0.1  # norm of a block over the mean of the two on its diagonal, from which a preconditioner needs it


class BlockAssembly:
    """The blocks between the vectors of a contact's points, in one step.

    `values` (e, 9) are those of this rank's pairs; a block belongs to the rank that has its row.
    """

    def __init__(self, points: ContactPoints, system: Any) -> None:
        self._points, self._system, self._comm = points, system, system.comm
        self._numbering = numbering = system.numbering
        unknowns = points.unknowns
        self._sorted = np.argsort(
            unknowns
        )  # vectors by their unknowns, and the place of each in this order
        self._place = np.argsort(self._sorted)
        ends = np.array(self._comm.allgather(numbering.start + numbering.size_local))
        self._owner = np.searchsorted(ends, unknowns, side="right")
        self._rows: npt.NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self.values: Array = np.zeros((0, 9))

    def lay_out(self, *groups: npt.NDArray[np.integer]) -> list[Integers]:
        """Couple the vectors within each row of groups (n, w); where their blocks (n, w w) stand in `values`."""
        widths = np.repeat([g.shape[1] for g in groups], [len(g) for g in groups]).astype(np.int32)
        members = np.concatenate([g.ravel() for g in groups]).astype(np.int32)
        room = int((widths.astype(np.int64) ** 2).sum())
        slots, rows, columns = (np.empty(room, dtype=np.int32) for _ in range(3))
        v = len(self._place)
        work = np.empty(3 * v + 2, dtype=np.int32), np.empty(4 * len(members), dtype=np.int32)
        count = library().lib.lay_out(
            len(widths), v, *pointers(widths, members, slots, rows, columns, *work)
        )
        self.values = np.zeros((count, 9))
        self._divide(rows[:count], columns[:count])
        ends = np.cumsum([len(g) * g.shape[1] ** 2 for g in groups])
        return [
            s.reshape(len(g), g.shape[1] ** 2)
            for s, g in zip(np.split(slots, ends[:-1]), groups, strict=True)
        ]

    def _divide(self, rows: Integers, columns: Integers) -> None:
        """Tell the blocks of single vectors from the others, and to which rank they go."""
        v, comm = len(self._place), self._comm
        on_diagonal = np.flatnonzero(rows == columns)
        self._on_diagonal = on_diagonal[np.argsort(self._place[rows[on_diagonal]])]
        self._of_diagonal = rows[self._on_diagonal]
        others = np.flatnonzero(rows != columns)
        keys = self._place[rows[others]] * v + self._place[columns[others]]
        order = np.argsort(keys)
        others, keys = others[order].astype(np.int32), keys[order]
        self._parts, self._places = [others], []
        if comm.size > 1:
            of = self._owner[rows[others]]
            self._parts = [others[of == rank] for rank in range(comm.size)]
            received = comm.alltoall([keys[of == rank] for rank in range(comm.size)])
            keys = np.unique(np.concatenate(received))
            self._places = [np.searchsorted(keys, k) for k in received]
        i, j = np.divmod(keys, v)
        self._rows, self._columns = self._sorted[i], self._sorted[j]
        free = self._numbering.vector()
        free.set(1.0)
        free.array[self._system.supports.held] = 0
        self._free = self._points.of_vectors(free)  # 0 where held

    # ---- into matrices ----------------------------------------------------------------------------------------------

    def reserve(self, A: PETSc.Mat) -> None:
        """Let the pattern of a matrix hold a block on the diagonal for each of this rank's vectors."""
        own = self._sorted[self._owner[self._sorted] == self._comm.rank]
        self._enter(A, own, np.zeros((len(own), 9)))

    def add_diagonal(self, A: PETSc.Mat) -> None:
        """A += the blocks of single vectors."""
        self._enter(A, self._of_diagonal, self.values[self._on_diagonal])

    def _enter(self, A: PETSc.Mat, vectors: npt.NDArray[np.integer], values: Array) -> None:
        if not len(vectors):
            return
        rows, *csr = self._csr(vectors, vectors, values)
        enter = A.setValuesBlockedIJV if self._blocked else A.setValuesIJV
        enter(*csr, addv=PETSc.InsertMode.ADD_VALUES, rowmap=rows)

    def coupling(self, diagonal: PETSc.Vec | None) -> PETSc.Mat | None:
        """The matrix of the blocks of two vectors, or of those that are strong beside the `diagonal` of the tangent.

        Zero at held coordinates; none if there is no such block on any rank.
        """
        if diagonal is None:
            self._take_entries()
            some: Any = slice(None)
        else:
            sizes = np.abs(self._points.of_vectors(diagonal)).max(axis=1)
            squares = np.einsum("ni,ni->n", self._entries, self._entries)
            some = np.flatnonzero(squares > STRONG**2 * sizes[self._row] * sizes[self._column])
        values = self._entries[some]
        if not self._comm.allreduce(len(values)):
            return None
        rows, ends, columns, values = self._csr(self._row[some], self._column[some], values)
        n, start, size = (
            self._numbering.size_local,
            self._numbering.start,
            3 if self._blocked else 1,
        )
        counts = np.zeros(n // size + 1, dtype=PETSc.IntType)
        counts[rows - start // size + 1] = np.diff(ends)
        csr = np.cumsum(counts, dtype=PETSc.IntType), columns, values
        sizes = 2 * ((n, self._numbering.size),)
        if self._blocked:
            return PETSc.Mat().createBAIJ(sizes, 3, csr=csr, comm=self._comm)
        return PETSc.Mat().createAIJ(sizes, csr=csr, comm=self._comm)

    def _take_entries(self) -> None:
        """The blocks (k, 9) of this rank's rows that are not zero, of all ranks' pairs, their rows and columns."""
        values, places = self.values, self._parts[0]
        if self._comm.size > 1:
            values, places = (
                np.zeros((len(self._rows), 9)),
                np.arange(len(self._rows), dtype=np.int32),
            )
            received = self._comm.alltoall([self.values[part] for part in self._parts])
            for at, part in zip(self._places, received, strict=True):
                values[at] += part
        kept = np.empty(len(places), dtype=np.uint8)
        library().lib.which_count(len(places), *pointers(places, values, kept))
        some = np.flatnonzero(kept)
        self._row, self._column, self._entries = (
            self._rows[some],
            self._columns[some],
            values[places[some]],
        )
        if not self._free.all():
            free = self._free
            self._entries *= (free[self._row][:, :, None] * free[self._column][:, None]).reshape(
                -1, 9
            )

    @property
    def _blocked(self) -> bool:
        return bool(self._numbering.block_size == 3)

    def _csr(
        self, of_rows: npt.NDArray[np.integer], of_columns: npt.NDArray[np.integer], values: Array
    ) -> tuple[Integers, Integers, Integers, Array]:
        """Rows of a matrix, where each one's entries begin, their columns and values, of blocks sorted by rows.

        If the matrix has no blocks of three, each row of blocks is three rows.
        """
        unknowns = self._points.unknowns
        first = np.flatnonzero(np.diff(of_rows, prepend=-1))
        counts = np.diff(np.append(first, len(of_rows)))
        rows, columns = unknowns[of_rows[first]], unknowns[of_columns]
        if self._blocked:
            rows, columns = rows // 3, columns // 3
        else:
            start, count = np.repeat(first, counts), np.repeat(counts, counts)
            c, d = np.arange(3)[:, None], np.arange(3)
            there = (9 * start + 3 * (np.arange(len(start)) - start))[:, None, None] + d
            there = (there + c * (3 * count)[:, None, None]).reshape(-1, 9)
            spread, single = np.empty(9 * len(start)), np.empty(9 * len(start), dtype=np.int64)
            spread[there], single[there] = (
                values,
                (columns[:, None, None] + d + 0 * c).reshape(-1, 9),
            )
            values, columns = spread, single
            rows, counts = (rows[:, None] + np.arange(3)).ravel(), np.repeat(3 * counts, 3)
        ends = np.append(0, np.cumsum(counts))
        kind = PETSc.IntType
        return (
            rows.astype(kind),
            ends.astype(kind),
            columns.astype(kind),
            np.ascontiguousarray(values).ravel(),
        )
