"""Rows of arrays that ranks send to each other, and values that they fetch by name.

Where the ranks are known (`RankExchange`), messages pass only between those that have any.  Where
no rank knows which other rank has a value, it is exchanged by name (`fetch`).  Each name is
assigned to one rank, its home, by its remainder modulo the number of ranks.  Ranks that have values
send them to the homes of their names; ranks that need values ask there.  The load is even if names
are hashes, as `hash_rows` returns them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.core.checks.errors import check_on_all

# Messages of one exchange have one tag: exchanges come in the same order on all ranks, and MPI
# keeps the order of messages between two ranks.
TAG = 1729


class RankExchange:
    """Sends n rows to the ranks (n,) that are given for them, and answers back.

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
        self._sent_ranges = _ranges(sent)
        self._received_ranges = _ranges(received)
        self.message_count = sum(rank != comm.rank for rank, _ in self._sent_ranges)

    def send(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the rows (r, ...) that this rank gets of the values (n, ...) of all;
        collective."""
        ordered = np.ascontiguousarray(values[self._order])
        return self._transfer(ordered, self._sent_ranges, self._received_ranges, len(self.source))

    def answer(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Send one row back for each received row (r, ...), in the order in which `send` returned
        them; returns the answers (n, ...) to the n rows of this rank, in their order.  Collective.
        """
        ordered = np.ascontiguousarray(values)
        count = len(self._order)
        received = self._transfer(ordered, self._received_ranges, self._sent_ranges, count)
        answers = np.empty_like(received)
        answers[self._order] = received
        return answers

    def _transfer(
        self,
        values: npt.NDArray[Any],
        sent_ranges: list[tuple[int, slice]],
        received_ranges: list[tuple[int, slice]],
        count: int,
    ) -> npt.NDArray[Any]:
        """Exchange contiguous rows (s, ...), ordered by destination; returns `count` rows, ordered
        by source.  Collective."""
        received = np.empty((count, *values.shape[1:]), dtype=values.dtype)
        # Receives first, so that MPI can put messages where they belong.
        requests = [
            self._comm.Irecv(received[rows], source=rank, tag=TAG) for rank, rows in received_ranges
        ]
        requests += [
            self._comm.Isend(values[rows], dest=rank, tag=TAG) for rank, rows in sent_ranges
        ]
        MPI.Request.Waitall(requests)
        return received


def _ranges(counts: npt.NDArray[np.int64]) -> list[tuple[int, slice]]:
    """Return the ranks that have rows, by the numbers of rows (ranks,), each with the range of its
    rows where those of all ranks stand one after the other."""
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


# ---- exchange by name ----------------------------------------------------------------------------

Names = npt.NDArray[np.uint64]

# The start value of a hash, 2⁶⁴ divided by the golden ratio: words of zeros must not give zero.
GOLDEN_RATIO = 0x9E3779B97F4A7C15

# Shifts and factors of Stafford's variant 13 of the finaliser of MurmurHash3 with 64 bits.
STAFFORD_ROUNDS = ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB))
STAFFORD_LAST_SHIFT = 31


def hash_rows(words: npt.NDArray[Any]) -> Names:
    """Hashes (n,) with 64 bits of n rows of k integers, equal for equal rows on all ranks and
    machines.  Each integer is mixed in by Stafford's variant 13 of the 64-bit finaliser of
    MurmurHash3.

    >>> import numpy as np
    >>> hashes = hash_rows(np.array([[1, 2], [2, 1], [1, 2]]))
    >>> bool(hashes[0] == hashes[2]), bool(hashes[0] == hashes[1])
    (True, False)
    """
    h: Names = np.full(len(words), GOLDEN_RATIO, dtype=np.uint64)
    for word in words.T.astype(np.int64).view(np.uint64):
        h = h ^ word
        for shift, factor in STAFFORD_ROUNDS:
            h = (h ^ (h >> np.uint64(shift))) * np.uint64(factor)
        h = h ^ (h >> np.uint64(STAFFORD_LAST_SHIFT))
        # The finaliser maps zero to zero; with this constant a word of zeros changes the hash.
        h = h + np.uint64(GOLDEN_RATIO)
    return h


def fetch(
    comm: MPI.Intracomm,
    names: npt.NDArray[Any],
    values: npt.NDArray[Any],
    wanted: Names,
    lacks: str,
    twice: str,
) -> npt.NDArray[Any]:
    """Return the values (m, k) of wanted names (m,), as floats, whichever ranks have them.
    Collective.

    This rank has `values` (n, k) of `names` (n,), unsigned integers such as hashes.  A wanted name
    that no rank has raises `InputError(lacks)` on all ranks, and a name that occurs twice
    `InputError(twice)`.

    >>> import numpy as np
    >>> from mpi4py import MPI
    >>> names = np.array([7, 3], dtype=np.uint64)
    >>> values = np.array([[70.0], [30.0]])
    >>> wanted = np.array([3], dtype=np.uint64)
    >>> fetch(MPI.COMM_SELF, names, values, wanted, lacks="It is unknown.", twice="Twice.")
    array([[30.]])
    """
    # Send names and values to their homes, and sort there what has arrived.
    size = np.uint64(comm.size)
    to_homes = RankExchange(comm, (names % size).astype(np.int64))
    known = to_homes.send(names.astype(np.uint64))
    order = np.argsort(known)
    known = known[order]
    known_values = to_homes.send(values.astype(float))[order]
    check_on_all(comm, bool((known[1:] != known[:-1]).all()), twice)

    # Ask the homes of the wanted names.
    questions = RankExchange(comm, (wanted % size).astype(np.int64))
    asked = questions.send(wanted)
    # A name above all known ones has the position len(known), one beyond the last index.
    positions = np.minimum(np.searchsorted(known, asked), max(len(known) - 1, 0))
    all_found = not len(asked) or (len(known) > 0 and bool((known[positions] == asked).all()))
    check_on_all(comm, all_found, lacks)
    return questions.answer(known_values[positions])
