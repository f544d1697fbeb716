"""Points that several ranks know: values of their owner are spread, and minima over all ranks are
found."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.rank_exchange import RankExchange
from gossamer_fx.mechanics.contact.arrays import Array
from gossamer_fx.mechanics.contact.geometry.surface_share import SurfacePoints


class SharedPoints:
    """Exchanges values of the n points that a rank knows with the owners of those points.

    Args:
        comm: the ranks.
        points: that this rank knows; the owner of a point always knows it.

    Attributes:
        is_own: which points (n,) this rank owns.
    """

    def __init__(self, comm: MPI.Intracomm, points: SurfacePoints) -> None:
        """Let the owners know which of their points this rank knows; collective."""
        self._comm = comm
        self.is_own = points.owner == comm.rank
        # The only rank owns all points.
        if comm.size == 1:
            return
        self._borrowed = np.flatnonzero(~self.is_own)
        self._exchange = RankExchange(comm, points.owner[self._borrowed])
        wanted = self._exchange.send(points.number[self._borrowed])
        self._lent = np.searchsorted(points.number, wanted)

    def spread(self, values: Array) -> None:
        """Replace the values (n, ...) of points of other ranks by those of their owners;
        collective."""
        if self._comm.size > 1:
            values[self._borrowed] = self._exchange.answer(values[self._lent])

    def take_minimum(self, values: Array) -> None:
        """Replace values by the least that any rank has for the same point; collective.

        Args:
            values: (n,) of the points that this rank knows, in any unit; changed in place.
        """
        if self._comm.size > 1:
            # The owner sees the values of all ranks, and spreads what it finds.
            received = self._exchange.send(values[self._borrowed])
            np.minimum.at(values, self._lent, received)
            self.spread(values)

    def take_sum(self, values: Array) -> None:
        """Replace values (n,) by the sum over all ranks of those for the same point; collective."""
        if self._comm.size > 1:
            received = self._exchange.send(values[self._borrowed])
            np.add.at(values, self._lent, received)
            self.spread(values)
