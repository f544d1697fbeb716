"""Pieces without mass: a position and one to three directors, moved by what is tied to them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from dolfinx.common import IndexMap
from mpi4py import MPI

from gossamer_fx.core.algebra.point_measures import PointMeasure
from gossamer_fx.core.algebra.rotations import perpendicular_pair
from gossamer_fx.core.model.body import Array, Block, Body, Port
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.rigid_body import orthonormality
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint

# Extent of a set of points, over its largest one, below which it counts as flat in that direction.
FLAT = 1e-9

# [m] Avoids 0 < 0 in the comparison of extents where all points coincide.
SMALLEST_EXTENT = 1e-300


class RigidPiece:
    """Position x and directors d_i, orthonormal by multipliers, without mass: what is tied to it
    decides its motion.

    Args:
        name: in messages.
        owner: the body that is tied to it.
        start: positions (1 + k, 3) of x and the k directors, orthonormal.
        rates: their velocities.
        rigid: whether lengths and angles of the directors are constant; one director alone may else
            change its length.
    """

    def __init__(
        self,
        name: str,
        owner: Body,
        start: Array,
        rates: Array,
        rigid: bool = True,
    ) -> None:
        """Take position, directors and rates of a massless rigid piece without a check.
        Collective.

        The coordinates of the piece are on rank 0; the arguments are the same on all ranks.

        What is tied to the piece decides its motion."""
        self.name = name
        self.comm = owner.comm
        self._owner = owner
        self._rigid = rigid
        # Initial coordinates and rates, (1 + k, 3).
        self._q = start
        self._v = rates
        # One node, which rank 0 owns; all ranks know the initial state.
        owned_nodes = int(self.comm.rank == 0)
        self.block = Block(IndexMap(self.comm, owned_nodes), start.size)

    def requires(self) -> Iterable[Any]:
        yield self._owner

    def initial_state(self) -> tuple[Array, Array]:
        here = self._q.size * self.block.index_map.size_local
        return self._q.ravel()[:here].copy(), self._v.ravel()[:here].copy()

    @property
    def directors(self) -> tuple[Port, ...]:
        """The k directors as ports."""
        return tuple(Port(self, (0,), weights=(1.0,), vectors=(k,)) for k in range(1, len(self._q)))

    def port(self, *along: float) -> Port:
        """The point x + Σ along[i] d_i."""
        count = 1 + len(along)
        nodes = (0,) * count
        vectors = tuple(range(count))
        return Port(self, nodes, weights=(1.0, *along), vectors=vectors)

    def terms(self, start: State) -> Iterable[Term]:
        if self._rigid:
            H, L, c = orthonormality(len(self._q) - 1)
            measure = PointMeasure([self.directors], H, L, c)
            yield PointConstraint(f"{self.name} directors", measure)

    def describe(self, node: int) -> str:
        return "the piece without mass"


def fitted(comm: MPI.Intracomm, x: Array, v: Array) -> tuple[Array, Array, Array]:
    """Mean position and directors of the points of all ranks, from those that this rank owns.
    Collective.

    Args:
        comm: of the body; it has at least one point on all ranks together.
        x, v: positions [m] and velocities [m/s] (n, 3) of this rank's points; n may be zero.

    Returns:
        The centre [m] and k unit vectors (1 + k, 3), one for each dimension of the set of points,
        see `directors_of`; their rates (1 + k, 3) [m/s, 1/s] in the best affine motion; and the
        coordinates (n, k) [m] of this rank's points along the directors.  The first two are the
        same on all ranks.
    """
    count = comm.allreduce(len(x))
    mean = comm.allreduce(x.sum(axis=0)) / count
    mean_velocity = comm.allreduce(v.sum(axis=0)) / count
    arms = x - mean
    covariance = comm.allreduce(arms.T @ arms)
    rates = comm.allreduce(arms.T @ (v - mean_velocity))
    # d (k, 3): the directors.
    # Sums may differ between ranks in the last digit, and with it the sign of an eigenvector.
    d = comm.bcast(directors_of(covariance))
    along = arms @ d.T
    director_rates = np.zeros((0, 3))
    if len(d):
        director_rates = np.linalg.solve(d @ covariance @ d.T, d @ rates)
    frame = np.vstack([mean[None], d])
    frame_rates = np.vstack([mean_velocity[None], director_rates])
    return frame, frame_rates, along


def directors_of(covariance: Array, flat: float = FLAT) -> Array:
    """Orthonormal directors (k, 3) of a set of points: as many as it has dimensions.

    One along a line; two in a plane, right-handed with its normal; the axes of space for points in
    space; none where all points coincide.

    Args:
        covariance: Σ (x - x_mean)(x - x_mean)ᵀ (3, 3) [m²] of the points.
        flat: ratio of an extent to the largest one, below which the set counts as flat there.

    Returns:
        Unit vectors (k, 3), k from 0 to 3.
    """
    # Eigenvalues are in ascending order.  Round-off may make the least of them negative.
    squares, vectors = np.linalg.eigh(covariance)
    extents = np.sqrt(np.maximum(squares, 0.0))
    dimension = 0
    if extents[2] > 0:
        dimension = int((extents > flat * max(extents[2], SMALLEST_EXTENT)).sum())
    if dimension == 0:
        return np.zeros((0, 3))
    if dimension == 3:
        return np.eye(3)
    # The direction of a line has the largest extent, the normal of a plane the smallest one.
    n: Array = vectors[:, 0]
    if dimension == 1:
        n = vectors[:, 2]
    # An eigenvector has no sign; its largest component is made positive.
    n = n * np.sign(n[np.argmax(np.abs(n))])
    if dimension == 1:
        return n[None]
    return np.array(perpendicular_pair(n))
