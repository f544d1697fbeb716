"""Everything that takes part in a contact: its points and primitives, with areas, radii and masses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gossamer_fx.contact.arrays import Array, ByteArray, Int32Array, Int64Array
from gossamer_fx.contact.geometry.collision_filter import filter_labels
from gossamer_fx.contact.geometry.collision_primitives import (
    TRIANGLE_SIDES,
    CollisionPrimitives,
)
from gossamer_fx.contact.geometry.contact_points import ContactPoints, ObstaclePoints
from gossamer_fx.contact.geometry.facets import Facets, facets_of
from gossamer_fx.contact.obstacles import Obstacle, ObstacleSolid, ObstacleWall
from gossamer_fx.contact.pair_table import PairKind, is_wall
from gossamer_fx.contact.system_view import ContactAssembly
from gossamer_fx.model.body import Attached, MeshBody

# Identifiers of pairs are 4 k + type: triangle pairs, edge pairs and walls have the types 0, 1, 2.
TYPE_COUNT = 4
WALL_TYPE = 2

# An obstacle with friction has four points more: an origin and three axes that move with it.
FRAME_SIZE = 4


@dataclass(frozen=True)
class NumberedWall:
    """A wall with the numbers of the three points that describe it, and of its obstacle."""

    wall: ObstacleWall
    points: tuple[int, int, int]
    obstacle: int


@dataclass
class _Primitives:
    """Primitives of the parts that were added so far."""

    vertices: list[Int32Array] = field(default_factory=list)
    edges: list[Int32Array] = field(default_factory=list)
    edge_area: list[Array] = field(default_factory=list)
    triangles: list[Int32Array] = field(default_factory=list)


class CollisionMesh:
    """Bodies and obstacles of one contact as points and primitives, the same on every rank.

    Bodies are numbered in their order, obstacles follow.  Points of bodies come first, in the order of
    the bodies; of an obstacle first the points of its walls, then those of its solids, then its frame.

    Args:
        bodies: films, cables and beams.
        obstacles: what they touch.
        radii: of each body [m], zero for films without a radius.
        system: to which the bodies belong.
        has_friction: of each obstacle whether it needs a frame; none: no obstacle does.

    Attributes:
        bodies, obstacles, names: what touches, and the names of bodies and obstacles.
        points: the m points.
        surface: primitives between them.
        nodes: global numbers (n,) of the points of bodies among the nodes of their body.
        body: number (m,) of the body or obstacle of each point.
        area: area [m²] (m,) for which each point stands.
        edge_area: area [m²] (e,) for which each edge stands.
        radius: of points [m] (m,).
        walls: planes, and insides of obstacles.
        frames: the first point (k,) of each obstacle's frame; -1: it has none.
        own_vertices, own_edges: numbers of the vertices and edges for which this rank searches.
    """

    def __init__(
        self,
        bodies: Sequence[MeshBody],
        obstacles: Sequence[Obstacle],
        radii: Sequence[float],
        system: ContactAssembly,
        has_friction: Sequence[bool] = (),
    ) -> None:
        """Number points and primitives of bodies, then of obstacles, alike on all ranks.

        Collective.
        """
        self.bodies = list(bodies)
        self.obstacles = list(obstacles)
        self.names = [body.name for body in bodies] + [obstacle.name for obstacle in obstacles]
        # Every rank knows all facets, so that numbers need no exchange later.
        facets = [facets_of(body) for body in bodies]
        parts = [obstacle.parts() for obstacle in obstacles]
        has_frame = list(has_friction) or [False] * len(obstacles)
        self.points = ContactPoints(
            [(body, facet.nodes) for body, facet in zip(bodies, facets, strict=True)],
            [
                _obstacle_points(obstacle, *part, with_frame)
                for obstacle, part, with_frame in zip(obstacles, parts, has_frame, strict=True)
            ],
            system,
        )
        self.nodes = np.concatenate([facet.nodes for facet in facets])
        point_count = self.points.count
        self.radius = np.zeros(point_count)
        self.area = np.zeros(point_count)
        self.body = np.zeros(point_count, dtype=np.int32)
        self.walls: list[NumberedWall] = []
        self.frames = np.full(len(obstacles), -1, dtype=np.int32)

        found = _Primitives([np.arange(self.points.body_count, dtype=np.int32)])
        start = self._add_bodies(facets, radii, found)
        # An obstacle has no mesh; its points and edges stand for as much area as those of bodies.
        self.area[start:] = float(self.area[:start].mean())
        edge_area = float(np.concatenate(found.edge_area).mean())
        for k, (walls, solids) in enumerate(parts):
            first = start
            start = self._add_walls(walls, len(bodies) + k, start)
            for solid in solids:
                start = self._add_solid(solid, edge_area, start, found)
            if has_frame[k]:
                self.frames[k] = start
                start += FRAME_SIZE
            self.body[first:start] = len(bodies) + k

        self.edge_area = np.concatenate(found.edge_area)
        # Two obstacles never form a pair.
        is_fixed: ByteArray = (np.arange(point_count) >= self.points.body_count).astype(np.uint8)
        self.surface = CollisionPrimitives(
            vertices=np.concatenate(found.vertices),
            edges=_stacked(found.edges, 2),
            triangles=_stacked(found.triangles, 3),
            is_fixed=is_fixed,
            labels=filter_labels(system, bodies, [facet.nodes for facet in facets], point_count),
        )
        self.own_vertices = self._owned(self.surface.vertices)
        # An edge belongs to the rank of its first point.
        self.own_edges = self._owned(self.surface.edges[:, 0])
        self._wall_vertices = self.own_vertices[self.own_vertices < self.points.body_count]

    def _add_bodies(
        self, facets: Sequence[Facets], radii: Sequence[float], found: _Primitives
    ) -> int:
        """Add the surfaces of all bodies; return the number of their points."""
        start = 0
        for k, (facet, radius) in enumerate(zip(facets, radii, strict=True)):
            end = start + len(facet.nodes)
            edges, edge_area, point_area = _edges_and_areas(facet, radius)
            self.radius[start:end] = radius
            self.body[start:end] = k
            self.area[start:end] = point_area
            found.edges.append(edges + start)
            found.edge_area.append(edge_area)
            found.triangles.append(facet.triangles + start)
            start = end
        return start

    def _add_walls(self, walls: Sequence[ObstacleWall], obstacle: int, start: int) -> int:
        """Add walls whose points begin at `start`; return where they end."""
        for wall in walls:
            self.walls.append(NumberedWall(wall, (start, start + 1, start + 2), obstacle))
            start += 3
        return start

    def _add_solid(
        self,
        solid: ObstacleSolid,
        edge_area: float,
        start: int,
        found: _Primitives,
    ) -> int:
        """Add a solid whose points begin at `start`; return where they end."""
        end = start + len(solid.corners)
        edges = np.array(solid.edges, dtype=np.int32).reshape(-1, 2)
        triangles = np.array(solid.triangles, dtype=np.int32).reshape(-1, 3)
        found.vertices.append(np.arange(start, end, dtype=np.int32))
        found.edges.append(edges + start)
        found.edge_area.append(np.full(len(edges), edge_area))
        found.triangles.append(triangles + start)
        self.radius[start:end] = solid.radius
        return end

    def _owned(self, points: Int32Array) -> Int32Array:
        """Return which of the points (k,) this rank searches for, as indices."""
        return np.flatnonzero(self.points.owned(points)).astype(np.int32)

    def name_of(self, point: int) -> str:
        """Return the name of the body or obstacle of a point."""
        return self.names[self.body[point]]

    # ---- identifiers of pairs ----

    def identifiers(self, kind: ByteArray, primitives: Int64Array) -> Int64Array:
        """Return numbers (n,) that tell pairs apart, the same on every rank and in every search.

        Args:
            kind: of the pairs (n,).
            primitives: numbers (n, 2): vertex and triangle, two edges, or wall and point.
        """
        # A pair (i, j) has the number i n + j, n being the count of the second kind of primitive.
        second_count = np.full(len(kind), self._triangle_count, dtype=np.int64)
        second_count[kind == PairKind.EDGE_EDGE] = self._edge_count
        second_count[is_wall(kind)] = self.points.count
        pair_type = np.minimum(kind.astype(np.int64), WALL_TYPE)
        return (primitives[:, 0] * second_count + primitives[:, 1]) * TYPE_COUNT + pair_type

    def first_points(self, identifier: Int64Array) -> Int32Array:
        """Return the first point (n,) of the pairs with these identifiers (n,)."""
        pair_type = identifier % TYPE_COUNT
        number = identifier // TYPE_COUNT
        points: Int32Array = np.zeros(len(identifier), dtype=np.int32)
        triangles = pair_type == PairKind.POINT_TRIANGLE
        vertex = number[triangles] // self._triangle_count
        points[triangles] = self.surface.vertices[vertex]
        edges = pair_type == PairKind.EDGE_EDGE
        first_edge = number[edges] // self._edge_count
        points[edges] = self.surface.edges[first_edge, 0]
        walls = pair_type == WALL_TYPE
        points[walls] = number[walls] % self.points.count
        return points

    @property
    def _triangle_count(self) -> int:
        # At least one: numbers are divided by it.
        return len(self.surface.triangles) or 1

    @property
    def _edge_count(self) -> int:
        return len(self.surface.edges) or 1

    # ---- pairs with walls, which need no search ----

    def wall_pairs(self) -> tuple[ByteArray, Int32Array, Int64Array, Array]:
        """Return pairs of this rank's points and all walls: kind, points, identifier, radius of the wall.

        The arrays are (n,), (n, 4), (n,) and (n,) [m]; planes have the radius zero.
        """
        vertices = self.surface.vertices[self._wall_vertices]
        count = len(vertices)
        kinds: list[ByteArray] = [np.zeros(0, dtype=np.uint8)]
        points: list[Int32Array] = [np.zeros((0, 4), dtype=np.int32)]
        identifiers: list[Int64Array] = [np.zeros(0, dtype=np.int64)]
        radii: list[Array] = [np.zeros(0)]
        for k, numbered in enumerate(self.walls):
            kind: ByteArray = np.full(count, numbered.wall.kind, dtype=np.uint8)
            of_wall = np.broadcast_to(np.array(numbered.points, dtype=np.int32), (count, 3))
            primitives = np.column_stack([np.full(count, k), vertices]).astype(np.int64)
            kinds.append(kind)
            points.append(np.column_stack([vertices, of_wall]).astype(np.int32))
            identifiers.append(self.identifiers(kind, primitives))
            radii.append(np.full(count, numbered.wall.radius))
        return (
            np.concatenate(kinds),
            np.vstack(points),
            np.concatenate(identifiers),
            np.concatenate(radii),
        )

    # ---- areas and masses ----

    def areas(self, kind: ByteArray, points: Int32Array, primitives: Int64Array) -> Array:
        """Return the area [m²] (n,) for which triangle pairs and edge pairs stand.

        Both sides of a film are covered twice, by its points and by those of the other film, so that each
        takes a half.  The areas of edges and points overlap in the same way.

        Args:
            kind, points: of the pairs (n,), (n, 4).
            primitives: numbers (n, 2) of the two primitives of each pair.
        """
        area: Array = self.area[points[:, 0]] * 0.5
        edges = kind == PairKind.EDGE_EDGE
        area[edges] = self.edge_area[primitives[edges]].sum(axis=1) / 4
        return area

    def surface_densities(self, system: ContactAssembly) -> Array:
        """Return the mass per area [kg/m²] (m,) of the body of each point; infinite for obstacles.

        A body has the same density everywhere: its mass over its area.  Collective.
        """
        numbering = system.numbering
        direction = numbering.vector()
        momentum = numbering.vector()
        density = np.full(self.points.count, np.inf)
        for k, body in enumerate(self.bodies):
            owned = system.block(body).owned
            size = body.block.size
            # The momentum of a unit velocity along x is the mass.
            direction.set(0.0)
            with direction as values:
                values[owned].reshape(-1, size)[:, 0] = 1.0
            system.M.mult(direction, momentum)
            own_mass = float(momentum.array_r[owned].reshape(-1, size)[:, 0].sum())
            of_body = self.body == k
            density[of_body] = system.comm.allreduce(own_mass) / self.area[of_body].sum()
        return density


def _obstacle_points(
    obstacle: Obstacle,
    walls: Sequence[ObstacleWall],
    solids: Sequence[ObstacleSolid],
    has_frame: bool,
) -> ObstaclePoints:
    """Return the points and directions of an obstacle in the order of `CollisionMesh`."""
    vectors: list[Attached] = []
    is_point: list[bool] = []
    for wall in walls:
        vectors += wall.points
        is_point += [True, False, False]
    for solid in solids:
        vectors += solid.corners
        is_point += [True] * len(solid.corners)
    if has_frame:
        vectors += obstacle.frame()
        is_point += [True, False, False, False]
    return ObstaclePoints(vectors, is_point, obstacle.motion, obstacle.name)


def _stacked(parts: list[Int32Array], width: int) -> Int32Array:
    """Return arrays (., width) as one, also if there is none."""
    none: Int32Array = np.zeros((0, width), dtype=np.int32)
    return np.ascontiguousarray(np.vstack([none, *parts]), dtype=np.int32)


def _edges_and_areas(facets: Facets, radius: float) -> tuple[Int32Array, Array, Array]:
    """Return the edges (e, 2) of a body, and the areas [m²] of edges (e,) and points (n,).

    A triangle gives each of its sides and corners a third of its area.  A line stands for the area of its
    shadow, length times diameter, and gives each end a half.
    """
    count = len(facets.nodes)
    if len(facets.lines):
        ends = facets.X[facets.lines]
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        area: Array = length * 2 * radius
        halves = np.repeat(area / 2, 2)
        return facets.lines, area, _summed(facets.lines, halves, count)
    corners = facets.X[facets.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    thirds = np.repeat(np.linalg.norm(normals, axis=1) / 6, 3)
    sides = np.sort(facets.triangles[:, TRIANGLE_SIDES].reshape(-1, 2), axis=1)
    edges, edge = np.unique(sides, axis=0, return_inverse=True)
    edge_area = _summed(edge, thirds, len(edges))
    return edges.astype(np.int32), edge_area, _summed(facets.triangles, thirds, count)


def _summed(numbers: np.ndarray, values: Array, count: int) -> Array:
    """Return the sums (count,) of values that belong to numbers."""
    return np.bincount(numbers.ravel(), values, count).astype(float)
