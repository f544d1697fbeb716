"""Exchange of values between ranks by name, when no rank knows which other rank has a value.

Each name is assigned to one rank, its home, by its remainder modulo the number of ranks.  Ranks
that have values send them to the homes of their names; ranks that need values ask there.  The load
is even if names are hashes, as `hash_rows` returns them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.core.checks.errors import check_on_all

Names = npt.NDArray[np.uint64]

# The start value of a hash, 2⁶⁴ divided by the golden ratio: words of zeros must not give zero.
GOLDEN_RATIO = 0x9E3779B97F4A7C15

# Shifts and factors of Stafford's variant 13 of the finaliser of MurmurHash3 with 64 bits.
STAFFORD_ROUNDS = ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB))
STAFFORD_LAST_SHIFT = 31


def hash_rows(words: npt.NDArray[Any]) -> Names:
    """Hashes (n,) with 64 bits of n rows of k integers.

    Each integer of a row is mixed into the hash by Stafford's variant 13 of the 64-bit finaliser of
    MurmurHash3.  Equal rows have equal hashes on all ranks and machines.

    Args:
        words: integers (n, k) that fit into 64 bits.

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
    twice: str | None = None,
) -> npt.NDArray[Any]:
    """Return the values of wanted names, whichever ranks have them.  Collective.

    A name is a number that identifies a value on all ranks, e.g. a hash.  Each name is assigned to
    one rank by its remainder modulo the number of ranks; values and questions meet there.

    Args:
        comm: the ranks.
        names: names (n,) whose values this rank has, unsigned integers.
        values: their values (n, k), in any unit.
        wanted: names (m,) whose values this rank needs.
        lacks: error message for a wanted name that no rank has.
        twice: error message for a name that occurs twice; None if a name may occur several times
            with the same values.

    Returns:
        Values (m, k) of the wanted names, as floats.

    Raises:
        InputError: with the message `lacks` or `twice`, on all ranks.

    >>> import numpy as np
    >>> from mpi4py import MPI
    >>> names = np.array([7, 3], dtype=np.uint64)
    >>> values = np.array([[70.0], [30.0]])
    >>> wanted = np.array([3], dtype=np.uint64)
    >>> fetch(MPI.COMM_SELF, names, values, wanted, lacks="The name is unknown.")
    array([[30.]])
    """
    # Send names and values to their homes, and sort there what has arrived.
    size = np.uint64(comm.size)
    rows_by_home = [np.flatnonzero(names % size == home) for home in range(comm.size)]
    arrived = comm.alltoall([(names[rows], values[rows]) for rows in rows_by_home])
    known = np.concatenate([some_names for some_names, _ in arrived])
    known_values = np.concatenate([some_values for _, some_values in arrived])
    order = np.argsort(known)
    known = known[order]
    known_values = known_values[order]
    if twice is not None:
        check_on_all(comm, bool((known[1:] != known[:-1]).all()), twice)

    # Send questions to the homes of the wanted names.
    wanted_by_home = [np.flatnonzero(wanted % size == home) for home in range(comm.size)]
    questions = comm.alltoall([wanted[rows] for rows in wanted_by_home])
    all_found = True
    positions_by_rank = []
    for asked in questions:
        positions = np.searchsorted(known, asked)
        # A name above all known ones has the position len(known), one beyond the last index.
        positions = np.minimum(positions, max(len(known) - 1, 0))
        if len(asked):
            all_found &= len(known) > 0 and bool((known[positions] == asked).all())
        positions_by_rank.append(positions)
    check_on_all(comm, all_found, lacks)

    # Reply, and put the values into the order of the questions.
    replies = []
    for positions in positions_by_rank:
        # Without known names there are no questions either; the positions are empty or not valid.
        if len(known):
            replies.append(known_values[positions])
        else:
            replies.append(known_values)
    result = np.zeros((len(wanted), values.shape[1]))
    for rows, reply in zip(wanted_by_home, comm.alltoall(replies), strict=True):
        result[rows] = reply
    return result
