"""What takes part in a contact, as far as a rank knows it: points and primitives, areas, radii and
masses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.model.body import Attached, MeshBody
from gossamer_fx.mechanics.contact.contract import (
    Array,
    ByteArray,
    Int32Array,
    Int64Array,
    Sides,
)
from gossamer_fx.mechanics.contact.geometry.collision_filter import tied_labels
from gossamer_fx.mechanics.contact.geometry.contact_points import ContactPoints, ObstaclePoints
from gossamer_fx.mechanics.contact.geometry.curved_cells import has_middle_nodes, largest_distances
from gossamer_fx.mechanics.contact.geometry.facets import CollisionPrimitives
from gossamer_fx.mechanics.contact.geometry.surface_share import (
    SharedPoints,
    SurfaceEdges,
    SurfacePoints,
    SurfacePrimitives,
    SurfaceShare,
    SurfaceTables,
)
from gossamer_fx.mechanics.contact.obstacles import Obstacle, ObstacleBoundary, ObstacleSolid
from gossamer_fx.mechanics.contact.pairs import SIDES, CandidatePairs
from gossamer_fx.mechanics.terms.assembly import Assembly

# Identifiers of pairs are 4 k + sides: a room for one more kind of sides.
TYPE_COUNT = 4

# An obstacle with friction has four points more: an origin and three axes that move with it.
FRAME_SIZE = 4


@dataclass(frozen=True)
class NumberedBoundary:
    """A boundary with the numbers of the three points that describe it, and of its obstacle."""

    boundary: ObstacleBoundary
    points: tuple[int, int, int]
    obstacle: int


class CollisionMesh:
    """Bodies and obstacles of one contact as points and primitives, as far as this rank knows them.

    A rank owns a part of the bodies' primitives, for whose pairs it searches.  It knows these,
    those on their boundary, and what other ranks have near them (`broad_phase.candidates`); on
    one rank all. `show` changes which ones are known, and with them the numbers of points.

    Bodies are numbered in their order, obstacles follow.  Points of bodies come first, in the order
    of the bodies; of an obstacle first the points of its boundaries, then those of its solids, then
    its frame.

    Args:
        piece_counts: into how many pieces the edges of each body's cells are cut, see
            `geometry.curved_cells`.
        has_friction: of each obstacle whether it needs a frame; none: no obstacle does.

    Attributes:
        comm: the ranks.
        bodies, obstacles, names: what touches, and the names of bodies and obstacles.
        piece_counts: as given.
        points_per_node: number of points to a node (k,) of each body and obstacle; 1 for order 1.
        share: primitives of the cells that this rank owns.
        known: all primitives of bodies that this rank knows.
        points: the m points.
        shared: exchanges values of the n points of bodies with other ranks.
        surface: primitives between the points.
        body: number (m,) of the body or obstacle of each point.
        area: area [m²] (m,) for which each point stands.
        edge_area: area [m²] (e,) for which each edge stands.
        edge_share: of each edge (e,) in the area of all with which it is tied to coincide.
        radius: of points [m] (m,).
        boundaries: planes, and insides of obstacles.
        frames: number (k,) of the first point of each obstacle's frame; -1: it has none.
        own_vertices, own_edges: indices of the vertices and edges of `surface` for which this rank
            searches.
        sent_edges, sent_triangles: indices of those of bodies that this rank owns, which it may
            send to others.
    """

    points: ContactPoints
    surface: CollisionPrimitives
    frames: Int32Array

    def __init__(
        self,
        bodies: Sequence[MeshBody],
        obstacles: Sequence[Obstacle],
        radii: Sequence[float],
        piece_counts: Sequence[int],
        system: Assembly,
        has_friction: Sequence[bool] = (),
    ) -> None:
        """Number the points, edges and triangles of bodies, then of obstacles, alike on all ranks.
        Collective."""
        self.comm = system.comm
        self.bodies = list(bodies)
        self.obstacles = list(obstacles)
        self.names = [body.name for body in bodies] + [obstacle.name for obstacle in obstacles]
        self._radii = np.array(radii, dtype=float)
        self.piece_counts = list(piece_counts)
        # Two pieces along an edge have the points of its nodes.
        self.points_per_node = np.ones(len(self.names))
        for k, body in enumerate(self.bodies):
            if has_middle_nodes(body):
                dimension = body.space.mesh.topology.dim
                self.points_per_node[k] = (self.piece_counts[k] / 2) ** dimension
        self.share = SurfaceShare.of(bodies, piece_counts, radii, self.comm)
        self._tied = tied_labels(system, bodies, self.share.surface.points)
        self._parts = [obstacle.parts() for obstacle in obstacles]
        self._has_frame = list(has_friction) or [False] * len(obstacles)
        self.points = ContactPoints(
            bodies,
            [
                _obstacle_points(obstacle, *part, with_frame)
                for obstacle, part, with_frame in zip(
                    obstacles, self._parts, self._has_frame, strict=True
                )
            ],
            system,
        )
        own = self.share.surface
        if self._tied is not None:
            own.edges.share[:] = self._tied.edge_shares(own, self._radii, self.comm)
        # An obstacle has no mesh; its points and edges stand for as much area as those of bodies.
        self._mean_area = self._mean(own.points, self.share.point_count)
        self._mean_edge_area = self._mean(own.edges, self.share.edge_count)
        self.show(own)

    def _mean(self, table: SurfacePoints | SurfaceEdges, count: int) -> float:
        """Return the mean area [m²] of the points or edges of all ranks; collective."""
        of_owned = float(table.area[table.owner == self.comm.rank].sum())
        return float(self.comm.allreduce(of_owned)) / max(count, 1)

    # ---- what this rank knows ----

    def show(self, known: SurfaceTables) -> None:
        """Set the points, edges and triangles of bodies that this rank knows; collective.  All
        attributes with a row for each point, edge or triangle are set again."""
        rank = self.comm.rank
        self.known = known
        points = known.points
        self.shared = SharedPoints(self.comm, points)
        self.points.set_points(points.body, points.nodes, points.weights)
        body_count = len(points)
        point_count = self.points.count
        self.radius = np.zeros(point_count)
        self.radius[:body_count] = self._radii[points.body]
        self.area = np.full(point_count, self._mean_area)
        self.area[:body_count] = points.area
        self.body = np.zeros(point_count, dtype=np.int32)
        self.body[:body_count] = points.body

        solids = self._add_obstacles(body_count)
        edges = known.point_indices(known.edges.points)
        self.edge_area = np.concatenate(
            [known.edges.area, np.full(len(solids.edges), self._mean_edge_area)]
        )
        self.edge_share = np.concatenate([known.edges.share, np.ones(len(solids.edges))])
        body_vertices: Int32Array = np.arange(body_count, dtype=np.int32)
        # Two obstacles never form a pair.
        is_fixed: ByteArray = (np.arange(point_count) >= body_count).astype(np.uint8)
        labels = None
        if self._tied is not None:
            labels = self._tied.labels_of(self._point_numbers()).astype(np.int32)
        self.surface = CollisionPrimitives(
            vertices=np.concatenate([body_vertices, solids.vertices]),
            edges=np.vstack([edges, solids.edges]).astype(np.int32),
            triangles=np.vstack(
                [known.point_indices(known.triangles.points), solids.triangles]
            ).astype(np.int32),
            is_fixed=is_fixed,
            labels=labels,
        )
        self.sent_edges = np.flatnonzero(known.edges.owner == rank)
        self.sent_triangles = np.flatnonzero(known.triangles.owner == rank)
        # All ranks know the primitives of obstacles, which are dealt out in turn.
        own_solid_vertices = _dealt(len(solids.vertices), self.comm)
        own_solid_edges = _dealt(len(solids.edges), self.comm)
        own_body_vertices = np.flatnonzero(self.shared.is_own)
        self.own_vertices = np.concatenate(
            [own_body_vertices, body_count + own_solid_vertices]
        ).astype(np.int32)
        self.own_edges = np.concatenate([self.sent_edges, len(edges) + own_solid_edges]).astype(
            np.int32
        )
        self._boundary_vertices = own_body_vertices.astype(np.int32)

    def _add_obstacles(self, start: int) -> CollisionPrimitives:
        """Number the points of obstacles, from `start` on, and set boundaries, frames, and radius
        and obstacle of these points.  A boundary has three points, a solid one for each corner, a
        frame four: an origin and three axes.  Returns the primitives of solids."""
        self.boundaries: list[NumberedBoundary] = []
        self.frames = np.full(len(self.obstacles), -1, dtype=np.int32)
        vertices: list[Int32Array] = [np.zeros(0, dtype=np.int32)]
        edges: list[Int32Array] = [np.zeros((0, 2), dtype=np.int32)]
        triangles: list[Int32Array] = [np.zeros((0, 3), dtype=np.int32)]
        edge_kinds: list[int] = []
        edge_shapes: list[float] = []
        has_lines = any(body.space.mesh.topology.dim == 1 for body in self.bodies)
        for k, (boundaries, solids) in enumerate(self._parts):
            number = len(self.bodies) + k
            first = start
            for boundary in boundaries:
                self.boundaries.append(
                    NumberedBoundary(boundary, (start, start + 1, start + 2), number)
                )
                start += 3
            for solid in solids:
                end = start + len(solid.corners)
                vertices.append(np.arange(start, end, dtype=np.int32))
                of_solid = solid.edges
                # Balls touch films by their triangles, and lines by an edge without length.
                if has_lines and not of_solid:
                    of_solid = tuple((corner, corner) for corner in range(len(solid.corners)))
                edges.append(np.array(of_solid, dtype=np.int32).reshape(-1, 2) + start)
                triangles.append(np.array(solid.triangles, dtype=np.int32).reshape(-1, 3) + start)
                self.radius[start:end] = solid.radius
                edge_kinds += [solid.edge_stencil.number] * len(of_solid)
                edge_shapes += [solid.edge_shape] * len(of_solid)
                start = end
            if self._has_frame[k]:
                self.frames[k] = start
                start += FRAME_SIZE
            self.body[first:start] = number
        self._solid_edge_kind = np.array(edge_kinds, dtype=np.uint8)
        self._solid_edge_shape = np.array(edge_shapes, dtype=float)
        return CollisionPrimitives(
            vertices=np.concatenate(vertices),
            edges=np.vstack(edges),
            triangles=np.vstack(triangles),
            is_fixed=np.zeros(0, dtype=np.uint8),
        )

    def _point_numbers(self) -> Int64Array:
        """Return the numbers (m,) of the points over all ranks; those of obstacles are the last."""
        of_obstacles = self.share.point_count + np.arange(self.points.obstacle_count)
        return np.concatenate([self.known.points.number, of_obstacles])

    def own_points(self) -> tuple[Int64Array, Int64Array]:
        """Return the points of which this rank stores history variables, those of bodies that it
        owns and all of obstacles: their indices (k,) among the points that it knows, and their
        numbers (k,) over all ranks."""
        is_own = np.ones(self.points.count, dtype=bool)
        is_own[: self.points.body_count] = self.shared.is_own
        own = np.flatnonzero(is_own)
        return own, self._point_numbers()[own]

    def take_minimum(self, values: Array) -> None:
        """Replace values (m,) of points by the least that any rank has for the same point;
        collective."""
        count = self.points.body_count
        self.shared.take_minimum(values[:count])
        if self.comm.size > 1 and self.points.obstacle_count:
            self.comm.Allreduce(MPI.IN_PLACE, values[count:], op=MPI.MIN)

    def distances_from_pieces(self, x: Array) -> Array:
        """Return a bound (m,) [m] for the distance of the cells round each point from the flat
        pieces as which they touch; collective.  It is zero for cells of order 1, points of
        obstacles, and flat cells whose middle nodes are in the middle.  `x`: points (m, 3) [m]."""
        bounds = np.zeros(self.points.count)
        known = self.known.points
        for number, body in enumerate(self.bodies):
            if not has_middle_nodes(body):
                continue
            index_map = body.block.index_map
            of_body = np.flatnonzero(known.body == number)
            nodes = np.ascontiguousarray(known.nodes[of_body])
            local = index_map.global_to_local(nodes.ravel()).reshape(nodes.shape)
            # Points of other ranks' cells, which were imported, are not among the nodes of this
            # rank.
            is_local = (local >= 0).all(axis=1)
            at_node = is_local & known.is_node[of_body]
            positions = np.zeros((index_map.size_local + index_map.num_ghosts, 3))
            positions[local[at_node, 0]] = x[of_body[at_node]]
            bound_of_node = largest_distances(body, positions, self.piece_counts[number])
            # A point has the cells that all of its nodes have.
            of_nodes = np.where(
                known.weights[of_body] != 0, bound_of_node[np.maximum(local, 0)], np.inf
            )
            bounds[of_body[is_local]] = of_nodes.min(axis=1)[is_local]
        # The least of the negative: the largest of all ranks that have a cell at the point.
        negative = -bounds
        self.take_minimum(negative)
        return -negative

    def name_of(self, point: int) -> str:
        """Return the name of the body or obstacle of a point."""
        return self.names[self.body[point]]

    # ---- identifiers of pairs ----

    def identifiers(self, sides: ByteArray, primitives: Int32Array) -> Int64Array:
        """Return numbers (n,) of pairs that are the same on every rank and in every search. History
        variables, such as the stiffness of a pair, are found by them.  The pairs have some `Sides`
        (n,), and primitives (n, 2) among what this rank knows: vertex and triangle, two edges, or
        boundary and point."""
        known = self.known
        share = self.share
        found = np.empty(len(sides), dtype=np.int64)
        for kind in Sides:
            rows = (sides == kind).nonzero()[0]
            # A product of two numbers needs more digits than one.
            first, second = primitives[rows].T.astype(np.int64)
            # Indices of what this rank knows become numbers that are the same on all ranks.
            if kind == Sides.POINT_TRIANGLE:
                first = _numbers(first, known.points, share.point_count)
                second = _numbers(second, known.triangles, share.triangle_count)
                count = self._triangle_count
            elif kind == Sides.EDGE_EDGE:
                first = _numbers(first, known.edges, share.edge_count)
                second = _numbers(second, known.edges, share.edge_count)
                count = self._edge_count
            else:
                second = _numbers(second, known.points, share.point_count)
                count = share.point_count + self.points.obstacle_count
            # A pair (i, j) has the number i n + j, n being the count of the second primitives.
            found[rows] = (first * count + second) * TYPE_COUNT + kind
        return found

    @property
    def _triangle_count(self) -> int:
        """Number of triangles on all ranks, those of obstacles once."""
        solid_count = len(self.surface.triangles) - len(self.known.triangles)
        return self.share.triangle_count + solid_count

    @property
    def _edge_count(self) -> int:
        """Number of edges on all ranks, those of obstacles once."""
        solid_count = len(self.surface.edges) - len(self.known.edges)
        return self.share.edge_count + solid_count

    # ---- pairs with boundaries, which need no search ----

    def boundary_pairs(self) -> CandidatePairs:
        """Return the pairs of each point of bodies that this rank owns with each boundary."""
        vertices = self.surface.vertices[self._boundary_vertices]
        count = len(vertices)
        boundary = np.repeat(np.arange(len(self.boundaries)), count)
        of_boundaries = np.array([numbered.points for numbered in self.boundaries], dtype=np.int32)
        shapes = np.array([numbered.boundary.shape for numbered in self.boundaries])
        numbers = [numbered.boundary.stencil.number for numbered in self.boundaries]
        kind = np.array(numbers, dtype=np.uint8)[boundary]
        vertex = np.tile(vertices, len(self.boundaries))
        return CandidatePairs(
            kind=kind,
            points=np.column_stack([vertex, of_boundaries.reshape(-1, 3)[boundary]]).astype(
                np.int32
            ),
            shape=shapes[boundary],
            identifier=self.identifiers(
                SIDES[kind], np.column_stack([boundary, vertex]).astype(np.int32)
            ),
            area=self.area[vertex],
            radius=self.radius[vertex],
        )

    def kinds_of(self, kind: ByteArray, primitives: Int32Array) -> tuple[ByteArray, Array]:
        """Return kind and shape (n,) of pairs that the broad phase found between primitives (n, 2).
        Some edges of obstacles have another stencil.  They stand behind those of bodies, and
        two obstacles form no pair, so that they are always second."""
        shape = np.zeros(len(kind))
        # Edges of obstacles have a number of at least zero here, those of bodies are below.
        of_obstacle = primitives[:, 1] - len(self.known.edges)
        rows = np.flatnonzero((SIDES[kind] == Sides.EDGE_EDGE) & (of_obstacle >= 0))
        if not len(rows):
            return kind, shape
        kind = kind.copy()
        kind[rows] = self._solid_edge_kind[of_obstacle[rows]]
        shape[rows] = self._solid_edge_shape[of_obstacle[rows]]
        return kind, shape

    # ---- areas and masses ----

    def areas(self, kind: ByteArray, points: Int32Array, primitives: Int32Array) -> Array:
        """Return the area (n,) [m²] for which each pair of a point and a triangle, or of two edges,
        stands. Both sides of a film are covered twice, by its points and by those of the other
        film, so that each takes a half.  The areas of edges and points overlap in the same way.

        Where a film is cut and tied, two edges stand for one: with shares that add up to one, their
        pairs with another edge stand for as much area as before the cut.
        `primitives`: indices (n, 2) of the two primitives of each pair."""
        area: Array = self.area[points[:, 0]] * 0.5
        edges = SIDES[kind] == Sides.EDGE_EDGE
        first, second = primitives[edges].T
        of_first = self.edge_area[first] * self.edge_share[second]
        of_second = self.edge_area[second] * self.edge_share[first]
        area[edges] = (of_first + of_second) / 4
        return area

    def body_densities(self, system: Assembly) -> Array:
        """Return the mass per area (k,) [kg/m²] of each body and obstacle, in their order; infinite
        for obstacles; collective.  A body has the same density everywhere: its mass over its area
        in the stress-free shape, that of cables and beams being length times diameter."""
        mass = self.body_masses(system)
        density = np.full(len(self.names), np.inf)
        own = self.shared.is_own
        for k in range(len(self.bodies)):
            own_area = float(self.known.points.area[own & (self.known.points.body == k)].sum())
            density[k] = mass[k] / system.comm.allreduce(own_area)
        return density

    def body_masses(self, system: Assembly) -> Array:
        """Return the mass [kg] (k,) of each body, with what is attached to it.  Collective. A body
        whose nodes have no mass has the mass zero. The result is the same on all ranks."""
        numbering = system.numbering
        direction = numbering.vector()
        momentum = numbering.vector()
        mass = np.zeros(len(self.bodies))
        for k, body in enumerate(self.bodies):
            owned = system.block(body).owned
            size = body.block.size
            # The momentum of a unit velocity along x is the mass.
            direction.set(0.0)
            with direction as values:
                values[owned].reshape(-1, size)[:, 0] = 1.0
            system.M.mult(direction, momentum)
            own_mass = float(momentum.array_r[owned].reshape(-1, size)[:, 0].sum())
            mass[k] = system.comm.allreduce(own_mass)
        return mass


def _obstacle_points(
    obstacle: Obstacle,
    boundaries: Sequence[ObstacleBoundary],
    solids: Sequence[ObstacleSolid],
    has_frame: bool,
) -> ObstaclePoints:
    """Return the points and directions of an obstacle: first of boundaries, then of solids, then of
    its frame."""
    vectors: list[Attached] = []
    is_point: list[bool] = []
    for boundary in boundaries:
        vectors += boundary.points
        is_point += [True, False, False]
    for solid in solids:
        vectors += solid.corners
        is_point += [True] * len(solid.corners)
    if has_frame:
        vectors += obstacle.frame()
        is_point += [True, False, False, False]
    return ObstaclePoints(vectors, is_point, obstacle.motion, obstacle.name)


def _dealt(count: int, comm: MPI.Intracomm) -> Int64Array:
    """Return for which of `count` primitives of obstacles this rank searches: their indices (k,),
    dealt out to the ranks in turn."""
    return np.arange(comm.rank, count, comm.size)


def _numbers(indices: Int64Array, of_bodies: SurfacePrimitives, count: int) -> Int64Array:
    """Return the numbers (n,) over all ranks of points, edges or triangles, given their indices
    (n,) among those that this rank knows, those of obstacles last.  `count`: how many of this kind
    the bodies have on all ranks."""
    known_count = len(of_bodies)
    # Obstacles' primitives are the last ones, on every rank.
    if not known_count:
        return indices + count
    number = of_bodies.number[np.minimum(indices, known_count - 1)]
    return np.where(indices < known_count, number, indices - known_count + count)
