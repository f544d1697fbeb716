"""A beam's section with its normal, for joints that need three directors."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from dolfinx.common import IndexMap
from mpi4py import MPI

from gossamer_fx.attachment import Frame, initial, initial_rate
from gossamer_fx.parts import Array, Block, Part, PointConstraint, PointMeasure, Port


class SectionFrame:
    """Point x and directors n, d2, d3 without mass that follow a section (x_s, s2, s3) of a beam, n its normal:

        x - x_s = 0   d2 - s2 = 0   d3 - s3 = 0   ½(n·n - 1) = 0   n·s2 = n·s3 = 0

    Two sections in one plane have no products of their directors that change to first order when one of them tilts; of
    the normal of the one and the directors of the other there are.  As these measures are quadratic and objective, the
    joints of beams conserve what those of rigid bodies do.
    """

    def __init__(self, section: Frame, origin: Port, name: str) -> None:
        self._section, self._origin, self.name = (origin, *section.directors), origin, name
        self.comm: MPI.Intracomm = origin.body.comm
        self.block = Block(IndexMap(self.comm, 1 if self.comm.rank == 0 else 0), 12)

    @property
    def frame(self) -> Frame:
        x, *directors = self._vectors()
        return Frame(x, tuple(directors))

    def _vectors(self) -> tuple[Port, ...]:
        return tuple(Port(self, (0,), (1.0,), (k,)) for k in range(4))

    def requires(self) -> Iterable[Any]:
        yield self._origin.body

    def initial_state(self) -> tuple[Array, Array]:
        x, s2, s3 = map(initial, self._section)
        vx, v2, v3 = map(initial_rate, self._section)
        q = np.concatenate([x, np.cross(s2, s3), s2, s3])
        v = np.concatenate([vx, np.cross(v2, s3) + np.cross(s2, v3), v2, v3])
        here = 12 * self.block.index_map.size_local
        return q[:here], v[:here]

    def parts(self) -> Iterable[Part]:
        # of the stacked vectors (x, n, d2, d3, x_s, s2, s3)
        same = np.eye(7)[[0, 2, 3]] - np.eye(7)[[4, 5, 6]]
        products = np.zeros((3, 7, 7))
        for k, other in enumerate((1, 5, 6)):
            products[k, 1, other] = products[k, other, 1] = 1.0
        H = np.concatenate([np.zeros((9, 21, 21)), np.kron(products, np.eye(3))])
        L = np.concatenate([np.kron(same, np.eye(3)), np.zeros((3, 21))])
        c = np.concatenate([np.zeros(9), [-0.5, 0.0, 0.0]])
        yield PointConstraint(f"{self.name} follows", PointMeasure([(*self._vectors(), *self._section)], H, L, c))

    def describe(self, node: int) -> str:
        return "the frame of the section"
