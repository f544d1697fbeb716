"""Rows of arrays that ranks send to each other, with messages only between those that have any."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

# Messages of one exchange have one tag: exchanges come in the same order on all ranks, and MPI
# keeps the order of messages between two ranks.
TAG = 1729


class RankExchange:
    """Sends n rows to the ranks that are given for them, and answers back.

    Args:
        comm: the ranks.
        ranks: destination (n,) of each row.

    Attributes:
        source: rank (r,) from which each of the r received rows comes, ascending.
        message_count: messages that this rank sends to others in one `send`.
    """

    def __init__(self, comm: MPI.Intracomm, ranks: npt.NDArray[np.integer]) -> None:
        """Prepare the exchange: tell each rank how many rows it receives from each other.
        Collective."""
        self._comm = comm
        self._order = np.argsort(ranks, kind="stable")
        sent = np.bincount(ranks, minlength=comm.size).astype(np.int64)
        received = np.empty_like(sent)
        comm.Alltoall(sent, received)
        self.source = np.repeat(np.arange(comm.size), received)
        self._sent_parts = _parts(sent)
        self._received_parts = _parts(received)
        self.message_count = sum(rank != comm.rank for rank, _ in self._sent_parts)

    def send(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the rows (r, ...) that this rank gets of the values (n, ...) of all;
        collective."""
        ordered = np.ascontiguousarray(values[self._order])
        return self._transfer(ordered, self._sent_parts, self._received_parts, len(self.source))

    def answer(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Send one row back for each received row, to the rank from which it came.  Collective.

        Args:
            values: rows (r, ...), in the order in which `send` returned the received rows.

        Returns:
            Rows (n, ...): the answers to the n rows of this rank, in their order.
        """
        ordered = np.ascontiguousarray(values)
        count = len(self._order)
        received = self._transfer(ordered, self._received_parts, self._sent_parts, count)
        answers = np.empty_like(received)
        answers[self._order] = received
        return answers

    def _transfer(
        self,
        values: npt.NDArray[Any],
        sent_parts: list[tuple[int, slice]],
        received_parts: list[tuple[int, slice]],
        count: int,
    ) -> npt.NDArray[Any]:
        """Exchange rows of an array between the ranks.  Collective.

        Args:
            values: rows (s, ...) to be sent, in any unit, ordered by destination, contiguous.

        Returns:
            Rows (count, ...) of the other ranks, ordered by source.
        """
        received = np.empty((count, *values.shape[1:]), dtype=values.dtype)
        # Receives first, so that MPI can put messages where they belong.
        requests = [
            self._comm.Irecv(received[rows], source=rank, tag=TAG) for rank, rows in received_parts
        ]
        requests += [
            self._comm.Isend(values[rows], dest=rank, tag=TAG) for rank, rows in sent_parts
        ]
        MPI.Request.Waitall(requests)
        return received


def _parts(counts: npt.NDArray[np.int64]) -> list[tuple[int, slice]]:
    """Return the ranks with rows, each with the range of its rows."""
    ends = np.cumsum(counts)
    return [
        (int(rank), slice(int(ends[rank] - counts[rank]), int(ends[rank])))
        for rank in np.flatnonzero(counts)
    ]


def maximum_over_ranks(
    comm: MPI.Intracomm, values: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the largest of each of the values (n,) over all ranks; collective."""
    # As a buffer: MPI compares pickled arrays as a whole, which NumPy refuses.
    largest = np.empty_like(values)
    comm.Allreduce(np.ascontiguousarray(values), largest, op=MPI.MAX)
    return largest
