"""The table of contact pairs that the stages of contact hand on, one row a pair.

A pair is two primitives that may touch: a point and a triangle, two edges, or a point and a wall.
Its four points stand in a fixed order:

    POINT_TRIANGLE     the point, the three corners
    EDGE_EDGE          the ends of the first edge, the ends of the second
    POINT_PLANE        the point, an origin on the plane, the plane's normal, the origin again
    POINT_IN_SPHERE    the point, the centre three times
    POINT_IN_CYLINDER  the point, an origin on the axis, two directions across the axis

The table is a structure of arrays, since the C functions and NumPy work on columns.  The broad
phase makes `CandidatePairs`, of which the active set makes `ActivePairs` with the columns of the
energy.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any, Self

import numpy as np

from gossamer_fx.core.forms.c_source import check_indices
from gossamer_fx.mechanics.contact.arrays import Array, ByteArray, Int32Array, Int64Array, MaskArray


class PairKind(IntEnum):
    """What the two sides of a pair are; the numbers are those of `kernels/contact.h`."""

    POINT_TRIANGLE = 0
    EDGE_EDGE = 1
    POINT_PLANE = 2
    POINT_IN_SPHERE = 3
    POINT_IN_CYLINDER = 4


def is_wall(kind: ByteArray) -> MaskArray:
    """Return which pairs (n,) are of a point and a wall: a plane, or the inside of a room."""
    # By the order of the kinds, which the C kernels use, too.
    return kind >= PairKind.POINT_PLANE


def is_room(kind: ByteArray) -> MaskArray:
    """Return which pairs (n,) are of a point and the inside of a sphere or cylinder."""
    return kind >= PairKind.POINT_IN_SPHERE


@dataclass
class PairTable:
    """n pairs of this rank: what their distances need.

    Attributes:
        kind: of each pair (n,), a `PairKind`.
        points: numbers (n, 4) of its points in the contact.
    """

    kind: ByteArray
    points: Int32Array

    def __len__(self) -> int:
        return len(self.kind)

    def rows(self, which: Any) -> Self:
        """Return a table of some rows, given by indices or by a mask (n,)."""
        columns: dict[str, Any] = {}
        for column in fields(self):
            values = getattr(self, column.name)
            # Columns that are not computed yet stay so.
            columns[column.name] = None if values is None else values[which]
        return type(self)(**columns)

    def check(self, point_count: int) -> None:
        """Raise `ValueError` if a pair has a point or kind that does not exist: C does not look."""
        check_indices("The points of pairs", self.points, point_count)
        check_indices("The kinds of pairs", self.kind, len(PairKind))

    @property
    def second_point(self) -> Int32Array:
        """The first point (n,) of the second side."""
        # The second side begins behind one point, or behind the two ends of an edge.
        is_edges = self.kind == PairKind.EDGE_EDGE
        return np.where(is_edges, self.points[:, 2], self.points[:, 1])


@dataclass
class CandidatePairs(PairTable):
    """Pairs that may come near in the next steps.

    Attributes:
        identifier: numbers (n,) that are the same on every rank and in every search, by which
            history variables find their pair again; see `CollisionMesh.identifiers`.
        area: for which each pair stands [m²] (n,).
        radius: of both sides together [m] (n,), for cables, beams and round obstacles.
        wall_radius: of the sphere or cylinder that holds the point [m] (n,); zero for other pairs.
    """

    identifier: Int64Array
    area: Array
    radius: Array
    wall_radius: Array


@dataclass
class ActivePairs(PairTable):
    """Pairs that may have energy k b(x) in a step, x = (s - offset)/width of the squared distance
    s.

    Attributes:
        identifier: as those of candidates (n,).
        stiffness: k [J] (n,).
        width: change of s over which the energy falls to zero [m²] (n,); for planes s is a distance
            [m].
        offset: s at which x is zero [m²] (n,); for planes [m].
        start: at the start of the step (n, 4): parameters u, v of the closest points, distance [m],
            and squared distance with rounded edges [m²].  None: not computed yet; see
            `potential.pair_starts`.
    """

    identifier: Int64Array
    stiffness: Array
    width: Array
    offset: Array
    start: Array | None = None
