"""Pieces without mass: a position and one to three directors, moved by what is tied to them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from dolfinx.common import IndexMap
from mpi4py import MPI

from gossamer_fx.algebra.point_measures import PointMeasure
from gossamer_fx.algebra.rotations import perpendicular_pair
from gossamer_fx.bodies.rigid_body import orthonormality
from gossamer_fx.model.body import Array, Block, Body, Port
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.point_constraints import PointConstraint


class RigidPiece:
    """Position x and directors d_i, orthonormal by multipliers, without mass: what is tied to it decides its motion.

    Args:
        name: in messages.
        owner: the body that is tied to it.
        start: positions (1 + k, 3) of x and the k directors, orthonormal.
        rates: their velocities.
        rigid: whether lengths and angles of the directors are constant; one director alone may else change its length.
    """

    def __init__(
        self,
        name: str,
        owner: Body,
        start: Array,
        rates: Array,
        rigid: bool = True,
    ) -> None:
        self.name, self.comm, self._owner, self._rigid = name, owner.comm, owner, rigid
        self._q, self._v = start, rates
        self.block = Block(IndexMap(self.comm, 1 if self.comm.rank == 0 else 0), start.size)

    def requires(self) -> Iterable[Any]:
        yield self._owner

    def initial_state(self) -> tuple[Array, Array]:
        here = self._q.size * self.block.index_map.size_local
        return self._q.ravel()[:here].copy(), self._v.ravel()[:here].copy()

    @property
    def directors(self) -> tuple[Port, ...]:
        return tuple(Port(self, (0,), weights=(1.0,), vectors=(k,)) for k in range(1, len(self._q)))

    def port(self, *along: float) -> Port:
        """The point x + Σ along[i] d_i."""
        return Port(
            self,
            (0,) * (1 + len(along)),
            weights=(1.0, *along),
            vectors=tuple(range(1 + len(along))),
        )

    def terms(self, start: State) -> Iterable[Term]:
        if self._rigid:
            measures = orthonormality(len(self._q) - 1)
            yield PointConstraint(
                f"{self.name} directors", PointMeasure([self.directors], *measures)
            )

    def describe(self, node: int) -> str:
        return "the piece without mass"


def fitted(comm: MPI.Intracomm, x: Array, v: Array) -> tuple[Array, Array, Array]:
    """The frame of points that this rank owns, x and velocities v (n, 3): see `frame_of`.

    Returns the centre and the k directors (1 + k, 3), their rates in the best affine motion, and the coordinates (n, k)
    of the points along the directors.
    """
    count = comm.allreduce(len(x))
    mean, drift = (comm.allreduce(values.sum(axis=0)) / count for values in (x, v))
    arms = x - mean
    covariance, rates = comm.allreduce(arms.T @ arms), comm.allreduce(arms.T @ (v - drift))
    d = comm.bcast(directors_of(covariance))
    along = arms @ d.T
    turning = np.linalg.solve(d @ covariance @ d.T, d @ rates) if len(d) else np.zeros((0, 3))
    return np.vstack([mean[None], d]), np.vstack([drift[None], turning]), along


def directors_of(covariance: Array, flat: float = 1e-9) -> Array:
    """Directors (k, 3) of points with this covariance about their centre: as many as they have dimensions.

    One along a line; two in a plane, right-handed with its normal; the axes of space for points in space.
    """
    squares, vectors = np.linalg.eigh(covariance)  # ascending
    extents = np.sqrt(np.maximum(squares, 0.0))
    dimension = int((extents > flat * max(extents[2], 1e-300)).sum()) if extents[2] > 0 else 0
    if dimension == 0:
        return np.zeros((0, 3))
    if dimension == 3:
        return np.eye(3)
    n: Array = vectors[:, 2 if dimension == 1 else 0]
    n = n * np.sign(n[np.argmax(np.abs(n))])
    if dimension == 1:
        return n[None]
    return np.array(perpendicular_pair(n))
