"""The surfaces of all bodies of one contact, divided by ranks: tables of points, edges and
triangles.

Every primitive has a number that is the same on all ranks, and an owner, which searches for its
pairs.  Rows of a table can be sent to other ranks and united with theirs, in the order of the
numbers.  For points that several ranks know, `SharedPoints` spreads values of the owner, and finds
sums and minima over all ranks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.rank_exchange import RankExchange
from gossamer_fx.core.model.body import MeshBody
from gossamer_fx.mechanics.contact.contract import Array, Int32Array, Int64Array, MaskArray
from gossamer_fx.mechanics.contact.geometry.facets import (
    TRIANGLE_SIDES,
    DistributedRows,
    Facets,
    facets_of,
)


@dataclass(frozen=True)
class SurfacePrimitives:
    """n primitives of one kind, ascending by number.

    Attributes:
        number: the same on all ranks (n,).
        owner: rank (n,) that searches for their pairs.
    """

    number: Int64Array
    owner: Int64Array

    def __len__(self) -> int:
        return len(self.number)

    def received(self, which: Int64Array, exchange: RankExchange) -> Self:
        """Send the rows `which` (k,) of this table to the ranks of an exchange; return the table of
        those that this rank gets.  Collective."""
        columns = self._arrays_by_name()
        return type(self)(
            **{column: exchange.send(values[which]) for column, values in columns.items()}
        )

    def united(self, *others: Self) -> Self:
        """Return a table with the rows of all tables of points, edges or triangles, each once, by
        number."""
        tables = [self, *others]
        numbers = np.concatenate([table.number for table in tables])
        # Rows with the same number are equal, whichever rank they come from.
        _, first = np.unique(numbers, return_index=True)
        columns = {
            column: np.concatenate([getattr(table, column) for table in tables])[first]
            for column in self._arrays_by_name()
        }
        return type(self)(**columns)

    def _arrays_by_name(self) -> dict[str, Any]:
        """Return the columns of the table, those of a subclass included."""
        return {column.name: getattr(self, column.name) for column in fields(self)}


@dataclass(frozen=True)
class SurfacePoints(SurfacePrimitives):
    """Points of bodies.

    Attributes:
        body: number (n,) of their body.
        nodes: global numbers (n, w), among the nodes of the body, of those that move each point; a
            point that is a node has this one first.
        weights: of these nodes in each point (n, w); zero where a point has fewer than w nodes.
        area: area [m²] (n,) for which each stands.
    """

    body: Int64Array
    nodes: Int64Array
    weights: Array
    area: Array

    @property
    def is_node(self) -> MaskArray:
        """Which points (n,) are nodes: all but those between the nodes of a cell of order 2."""
        return np.asarray(self.weights[:, 0] == 1)

    def numbers_of_nodes(self) -> Int64Array:
        """Return the numbers (n, w) of the points that are the nodes of each of these points."""
        base = 1 + int(self.nodes.max(initial=0))
        keys = self.body[:, None] * base + self.nodes
        at_node = np.flatnonzero(self.is_node)
        order = at_node[np.argsort(keys[at_node, 0])]
        return self.number[order[np.searchsorted(keys[order, 0], keys)]]


@dataclass(frozen=True)
class SurfaceEdges(SurfacePrimitives):
    """Edges between points of bodies.

    Attributes:
        points: numbers (n, 2) of their ends.
        area: area [m²] (n,) for which each stands.
        share: of each (n,) in the area of all edges with which it is tied to coincide; 1: it is
            alone.
    """

    points: Int64Array
    area: Array
    share: Array


@dataclass(frozen=True)
class SurfaceTriangles(SurfacePrimitives):
    """Triangles between points of bodies.

    Attributes:
        points: numbers (n, 3) of their corners.
    """

    points: Int64Array


@dataclass(frozen=True)
class SurfaceTables:
    """Primitives of bodies that a rank knows, with all of their points."""

    points: SurfacePoints
    edges: SurfaceEdges
    triangles: SurfaceTriangles

    def united(self, other: SurfaceTables) -> SurfaceTables:
        """Return the primitives of both, each once."""
        return SurfaceTables(
            points=self.points.united(other.points),
            edges=self.edges.united(other.edges),
            triangles=self.triangles.united(other.triangles),
        )

    def point_indices(self, numbers: Int64Array) -> Int32Array:
        """Return where points with some numbers, of any shape, stand in the table of points."""
        return np.searchsorted(self.points.number, numbers).astype(np.int32)


@dataclass(frozen=True)
class SurfaceShare:
    """The primitives of the cells that this rank owns.

    Attributes:
        surface: those on the boundary between two ranks are on both.
        point_count, edge_count, triangle_count: of all ranks together.
    """

    surface: SurfaceTables
    point_count: int
    edge_count: int
    triangle_count: int

    @classmethod
    def of(
        cls,
        bodies: Sequence[MeshBody],
        piece_counts: Sequence[int],
        radii: Sequence[float],
        comm: MPI.Intracomm,
    ) -> SurfaceShare:
        """Number the points, edges and triangles of bodies, one body after the other.
        `piece_counts`: into how many pieces the edges of each body's cells are cut."""
        # Bodies are numbered one after the other, so that each kind of primitive has one range of
        # numbers.
        points: list[SurfacePoints] = []
        edges: list[SurfaceEdges] = []
        triangles: list[SurfaceTriangles] = []
        counts = np.zeros(3, dtype=np.int64)
        of_bodies = [
            facets_of(body, piece_count)
            for body, piece_count in zip(bodies, piece_counts, strict=True)
        ]
        # Points of one table have as many columns, also where bodies of both orders touch.
        width = max(facets.nodes.shape[1] for facets in of_bodies)
        for k, (facets, radius) in enumerate(zip(of_bodies, radii, strict=True)):
            surface, of_body = _surface_of(facets.widened(width), k, radius, counts, comm)
            points.append(surface.points)
            edges.append(surface.edges)
            triangles.append(surface.triangles)
            counts += of_body
        whole = SurfaceTables(
            points=points[0].united(*points[1:]),
            edges=edges[0].united(*edges[1:]),
            triangles=triangles[0].united(*triangles[1:]),
        )
        return cls(whole, *map(int, counts))


def _surface_of(
    facets: Facets, body: int, radius: float, first: Int64Array, comm: MPI.Intracomm
) -> tuple[SurfaceTables, list[int]]:
    """Return tables of this rank's points, edges and triangles of one body, and how many of each
    kind the body has on all ranks; collective.  `body`: its number in the contact; `radius` [m];
    `first`: the lowest numbers (3,) of its points, edges and triangles."""
    ends, edge_area, point_area = _edges_and_areas(facets, radius)
    rows = facets.rows
    # Names of edges and triangles are numbers of points, which are the same on all ranks.
    bound = rows.count
    edge_rows = DistributedRows(comm, rows.numbers[ends], bound)
    corners = rows.numbers[facets.triangles]
    triangle_rows = DistributedRows(comm, corners, bound)
    points = SurfacePoints(
        number=first[0] + rows.numbers,
        owner=rows.owners,
        body=np.full(len(facets.nodes), body),
        nodes=facets.nodes,
        weights=facets.weights,
        # A rank knows the cells that it owns; areas on a boundary are sums over its sides.
        area=rows.sums(point_area),
    )
    edges = SurfaceEdges(
        number=first[1] + edge_rows.numbers,
        owner=edge_rows.owners,
        points=first[0] + rows.numbers[ends],
        area=edge_rows.sums(edge_area),
        share=np.ones(len(ends)),
    )
    triangles = SurfaceTriangles(
        number=first[2] + triangle_rows.numbers,
        # A cell has one owner: no other rank brings its triangles.
        owner=triangle_rows.owners,
        points=first[0] + corners,
    )
    return SurfaceTables(points, edges, triangles), [bound, edge_rows.count, triangle_rows.count]


def _edges_and_areas(facets: Facets, radius: float) -> tuple[Int32Array, Array, Array]:
    """Return the edges (e, 2) of facets, as indices of points, and the areas [m²] for which edges
    (e,) and points (n,) stand, from the cells of this rank.

    A triangle gives each of its sides and corners a third of its area.  A line stands for the area
    of its shadow, length times diameter, and gives each end a half.  In cells of order 2 points
    stand for `Facets.area_factors` times that.
    """
    count = len(facets.nodes)
    if len(facets.lines):
        ends = facets.X[facets.lines]
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        area: Array = length * 2 * radius
        halves = np.repeat(area / 2, 2)
        return facets.lines, area, facets.area_factors * _summed(facets.lines, halves, count)
    corners = facets.X[facets.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    thirds = np.repeat(np.linalg.norm(normals, axis=1) / 6, 3)
    sides = np.sort(facets.triangles[:, TRIANGLE_SIDES].reshape(-1, 2), axis=1)
    edges, edge = np.unique(sides, axis=0, return_inverse=True)
    edge_area = _summed(edge, thirds, len(edges))
    point_area = facets.area_factors * _summed(facets.triangles, thirds, count)
    return edges.astype(np.int32), edge_area, point_area


def _summed(numbers: np.ndarray, values: Array, count: int) -> Array:
    """Return for each number below `count` the sum of the values that belong to it."""
    return np.bincount(numbers.ravel(), values, count).astype(float)


class SharedPoints:
    """Exchanges values of the n points that a rank knows with the owners of those points.

    Attributes:
        is_own: which points (n,) this rank owns.
    """

    def __init__(self, comm: MPI.Intracomm, points: SurfacePoints) -> None:
        """Report to the owners which of their points this rank knows; collective."""
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
        """Replace values by the least that any rank has for the same point; collective. `values`:
        (n,) of the points that this rank knows, in any unit; changed in place."""
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
