"""Rows of integers that name points, edges or triangles, numbered over all ranks without gathering
them."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.rank_exchange import RankExchange
from gossamer_fx.mechanics.contact.arrays import Array, Int64Array


class DistributedRows:
    """Rows of which several ranks may have the same one, numbered in lexicographic order.

    Every row is sent to a rank that follows from its first entry.  There equal rows meet, and are
    counted once; numbers, sums and owners come back.

    Args:
        comm: the ranks.
        rows: (n, k) of this rank; each entry is at least 0.
        bound: more than any first entry.

    Attributes:
        numbers: of this rank's rows (n,); they do not depend on how rows are distributed.
        owners: lowest rank (n,) that has each row.
        count: number of distinct rows on all ranks.
    """

    def __init__(self, comm: MPI.Intracomm, rows: Int64Array, bound: int) -> None:
        """Number the distinct rows of integers of all ranks in lexicographic order; collective."""
        # Ranges of first entries in the order of the ranks: so numbers are in the order of rows.
        meeting_rank = rows[:, 0] * comm.size // max(bound, 1)
        self._exchange = RankExchange(comm, meeting_rank)
        met = self._exchange.send(rows)
        distinct, row_of = np.unique(met, axis=0, return_inverse=True)
        self._row_of = row_of.ravel()
        self._met_count = len(distinct)
        self.count = comm.allreduce(self._met_count)
        # exscan leaves rank 0 without a value.
        first = int(comm.exscan(self._met_count) or 0)
        self.numbers: Int64Array = self._exchange.answer(first + self._row_of)
        owner = np.full(self._met_count, comm.size)
        np.minimum.at(owner, self._row_of, self._exchange.source)
        self.owners: Int64Array = self._exchange.answer(owner[self._row_of])

    def sums(self, values: Array) -> Array:
        """Return for each row of integers the sum of the values that all ranks have for it;
        collective.

        A row consists of the integers that name a point, edge or triangle; several ranks may have
        equal rows. On each of them the sum is the same.

        Args:
            values: (n,), one for each row of this rank.

        Returns:
            sums (n,), in the unit of the values.
        """
        met = self._exchange.send(values)
        total = np.bincount(self._row_of, met, self._met_count).astype(float)
        return self._exchange.answer(total[self._row_of])
