"""Values that ranks ask each other for by name.

Each name has a rank where those that have it meet those that want it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.checks.errors import check_on_all

Names = npt.NDArray[np.uint64]


def hash_rows(words: npt.NDArray[Any]) -> Names:
    """Hashes (n,) of rows of integers (n, k): Stafford's variant 13 of the 64-bit finaliser, word after word."""
    h: Names = np.full(len(words), 0x9E3779B97F4A7C15, dtype=np.uint64)
    for word in words.T.astype(np.int64).view(np.uint64):
        h = h ^ word
        for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
            h = (h ^ (h >> np.uint64(shift))) * np.uint64(factor)
        h = h ^ (h >> np.uint64(31))
        h = h + np.uint64(0x9E3779B97F4A7C15)
    return h


def fetch(
    comm: MPI.Intracomm,
    names: npt.NDArray[Any],
    values: npt.NDArray[Any],
    wanted: Names,
    lacks: str,
    twice: str | None = None,
) -> npt.NDArray[Any]:
    """Values (m, k) of the wanted names (m,), whatever rank has them in its values (n, k) of names (n,).

    Raises:
        InputError: with the words of `lacks`, a name that nobody has; of `twice`, a name that occurs twice.  Without
            them values of one name are the same.
    """
    size = np.uint64(comm.size)
    homes = [np.flatnonzero(names % size == r) for r in range(comm.size)]
    brought = comm.alltoall([(names[i], values[i]) for i in homes])
    known, rows = np.concatenate([n for n, _ in brought]), np.concatenate([v for _, v in brought])
    order = np.argsort(known)
    known, rows = known[order], rows[order]
    if twice is not None:
        check_on_all(comm, bool((known[1:] != known[:-1]).all()), twice)
    askers = [np.flatnonzero(wanted % size == r) for r in range(comm.size)]
    asked = comm.alltoall([wanted[i] for i in askers])
    at = [np.minimum(np.searchsorted(known, a), max(len(known) - 1, 0)) for a in asked]
    found = all(
        len(known) > 0 and bool((known[i] == a).all())
        for i, a in zip(at, asked, strict=True)
        if len(a)
    )
    check_on_all(comm, found, lacks)
    answers = comm.alltoall([rows[i] if len(rows) else rows for i in at])
    result = np.zeros((len(wanted), values.shape[1]))
    for i, answer in zip(askers, answers, strict=True):
        result[i] = answer
    return result
