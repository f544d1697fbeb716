"""The table of contact pairs that the stages of contact hand on, one row a pair.

A pair is two primitives that may touch: a point and a triangle, two edges, or a point and a
boundary. Its kind is the number of its stencil, which says in which order its four points stand
(`stencils`). The table is a structure of arrays, since the C functions and NumPy work on columns.
The broad phase makes `CandidatePairs`, of which the active set makes `ActivePairs` with the columns
of the energy.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any, Self, cast

import numpy as np

from gossamer_fx.core.forms.c_source import CStruct, check_indices
from gossamer_fx.mechanics.contact.contract import Array, ByteArray, Int32Array, Int64Array, Sides
from gossamer_fx.mechanics.contact.kernels.library import library
from gossamer_fx.mechanics.contact.stencils import SIDES, STENCILS


class PairRows:
    """Base of dataclasses whose fields are arrays with a row for each of n pairs."""

    def rows(self, which: Any) -> Self:
        """Return a table of some rows, given by indices or by a mask (n,)."""
        columns: dict[str, Any] = {}
        for column in fields(cast(Any, self)):
            values = getattr(self, column.name)
            # Columns that are not computed yet stay so.
            columns[column.name] = None if values is None else values[which]
        return type(self)(**columns)


@dataclass
class PairTable(PairRows):
    """n pairs of this rank: what their distances need.

    Attributes:
        kind: of each pair (n,), the number of its stencil.
        points: numbers (n, 4) of its points in the contact.
        shape: number (n,) that the stencil needs, such as the radius of a room [m]; None: zeros.
    """

    kind: ByteArray
    points: Int32Array
    shape: Array | None = field(default=None, kw_only=True)

    def __len__(self) -> int:
        return len(self.kind)

    def followed_by(self, other: Self) -> Self:
        """Return a table of these rows and those of another one that has the same columns."""
        columns = {}
        for column in fields(self):
            both = (getattr(self, column.name), getattr(other, column.name))
            columns[column.name] = np.concatenate(both)
        return type(self)(**columns)

    def check(self, point_count: int) -> None:
        """Raise `ValueError` if a pair has a point or kind that does not exist: C does not look."""
        check_indices("The points of pairs", self.points, point_count)
        check_indices("The kinds of pairs", self.kind, max(STENCILS) + 1)

    def geometry(self, which: Any) -> PairTable:
        """Return what the distances of some rows need, without the columns of a subclass."""
        shape = None if self.shape is None else self.shape[which]
        return PairTable(self.kind[which], self.points[which], shape=shape)

    @property
    def shapes(self) -> Array:
        """The numbers (n,) that stencils need."""
        return np.zeros(len(self)) if self.shape is None else self.shape

    @property
    def second_point(self) -> Int32Array:
        """The first point (n,) of the second side."""
        # The second side begins behind one point, or behind the two ends of an edge.
        is_edges = SIDES[self.kind] == Sides.EDGE_EDGE
        return np.where(is_edges, self.points[:, 2], self.points[:, 1])


@dataclass
class CandidatePairs(PairTable):
    """Pairs that may come near in the next steps.

    Attributes:
        identifier: numbers (n,) that are the same on every rank and in every search, by which
            history variables find their pair again; see `CollisionMesh.identifiers`.
        area: for which each pair stands [m²] (n,).
        radius: of both sides together [m] (n,), for cables, beams and round obstacles.
    """

    identifier: Int64Array
    area: Array
    radius: Array


@dataclass
class ActivePairs(PairTable):
    """Pairs that may have energy k b(x) in a step, x = (s - offset)/width of the squared distance
    s.

    Attributes:
        identifier: as those of candidates (n,).
        stiffness: k [J] (n,).
        width: change of s over which the energy falls to zero (n,), in the unit of s: [m²] or [m].
        offset: s at which x is zero (n,).
        start: at the start of the step (n, 4): parameters u, v of the closest points, distance [m],
            and s with rounded edges.  None: not computed yet; see
            `potential.pair_starts`.
    """

    identifier: Int64Array
    stiffness: Array
    width: Array
    offset: Array
    start: Array | None = None


def pair_list_fields(pairs: PairTable) -> dict[str, Any]:
    """Return the fields of a `pair_list`, which other structures hold, too."""
    c = library()
    count = len(pairs)
    return {
        "count": count,
        "points": c.array("points", pairs.points, "int32", (count, 4)),
        "kind": c.array("kind", pairs.kind, "uint8", (count,)),
        "shape": c.array("shape", pairs.shape, "float64", (count,)),
    }


def pair_list(pairs: PairTable) -> CStruct:
    """Return what distances of pairs need as a `pair_list`."""
    return library().struct("pair_list", pair_list_fields(pairs))
