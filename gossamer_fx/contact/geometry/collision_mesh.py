"""The surface of everything that takes part in a contact: points, edges, triangles, their areas, masses and radii."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gossamer_fx.contact.broad_phase.box_tree import CollisionPrimitives
from gossamer_fx.contact.geometry.collision_filter import places_of
from gossamer_fx.contact.geometry.contact_points import ContactPoints, ObstaclePoints
from gossamer_fx.contact.geometry.facets import Facets, facets_of
from gossamer_fx.contact.kernels.library import Array, Bytes, Integers
from gossamer_fx.contact.obstacles import Obstacle, ObstacleWall
from gossamer_fx.contact.potential import EDGE_EDGE, POINT_TRIANGLE
from gossamer_fx.model.body import MeshBody
from gossamer_fx.terms.assembly import Assembly

WALLS = 2  # number of the first kind of name that belongs to walls


@dataclass(frozen=True)
class PlacedWall:
    """A wall by the numbers of the three points behind the film's point in its pairs."""

    wall: ObstacleWall
    behind: tuple[int, int, int]
    of: int  # number of its obstacle


class CollisionMesh:
    """Bodies and obstacles of one contact.

    Of points (m,): `area` [m²] that they stand for, `radius` [m], `body` (number of what they are of), and
    `X` (n, 3), the stress-free places of those of bodies; of edges (e,): `edge_area`.  Of obstacles (k,): `frames`,
    the first of four points, origin and axes, of those that are `rough`; of others -1.  `of` are the bodies, and
    `nodes` (n,) the global numbers of their points among the nodes of each.
    """

    def __init__(
        self,
        bodies: Sequence[MeshBody],
        obstacles: Sequence[Obstacle],
        radii: Sequence[float],
        system: Assembly,
        rough: Sequence[bool] = (),
    ) -> None:
        self.shortest: list[float] = []  # edge of each body [m]
        self.names = [b.name for b in bodies] + [o.name for o in obstacles]
        self.indices = [system.bodies.index(b) for b in bodies]
        facets = [facets_of(b) for b in bodies]
        supports, shapes = [], []
        rubs = [*rough] or [False] * len(obstacles)
        for obstacle, has_frame in zip(obstacles, rubs, strict=True):
            walls, solids = obstacle.parts()
            at = [p for w in walls for p in w.behind] + [p for s in solids for p in s.corners]
            moves = [i == 0 for _ in walls for i in range(3)]  # origins move, directions do not
            moves += [True] * sum(len(s.corners) for s in solids)
            if has_frame:
                at, moves = [*at, *obstacle.frame()], [*moves, True, False, False, False]
            supports.append(ObstaclePoints(at, moves, obstacle.motion))
            shapes.append((walls, solids))
        nodes = [(k, f.nodes) for k, f in zip(self.indices, facets, strict=True)]
        self.points = points = ContactPoints(nodes, supports, system)
        self.of, self.nodes = list(bodies), np.concatenate([f.nodes for f in facets])
        m = points.m
        self.X = np.vstack([f.X for f in facets])
        self.radius, self.area, self.body = np.zeros(m), np.zeros(m), np.zeros(m, dtype=np.int32)
        triangles, edges, areas, vertices = [], [], [], [np.arange(points.n, dtype=np.int32)]
        start = 0
        for k, (shape, radius) in enumerate(zip(facets, radii, strict=True)):
            here = slice(start, start + len(shape.nodes))
            self.radius[here], self.body[here] = radius, k
            lines, of_edges, of_points = _edges_and_areas(shape, radius)
            edges.append(lines + start)
            areas.append(of_edges)
            self.area[here] = of_points
            triangles.append(shape.triangles + start)
            start += len(shape.nodes)
            lengths = np.linalg.norm(shape.X[lines[:, 0]] - shape.X[lines[:, 1]], axis=1)
            self.shortest.append(float(lengths.min()))
        mean_point, mean_edge = float(self.area[:start].mean()), float(np.concatenate(areas).mean())
        self.area[start:] = mean_point
        self.walls: list[PlacedWall] = []
        self.frames = np.full(len(obstacles), -1, dtype=np.int32)
        for k, (walls, solids) in enumerate(shapes):
            begin = start
            for wall in walls:
                self.walls.append(PlacedWall(wall, (start, start + 1, start + 2), len(bodies) + k))
                start += 3
            for solid in solids:
                corners = np.arange(start, start + len(solid.corners), dtype=np.int32)
                vertices.append(corners)
                self.radius[corners] = solid.radius
                edges.append(np.array(solid.edges, dtype=np.int32).reshape(-1, 2) + start)
                areas.append(np.full(len(solid.edges), mean_edge))
                triangles.append(np.array(solid.triangles, dtype=np.int32).reshape(-1, 3) + start)
                start += len(corners)
            if rubs[k]:
                self.frames[k] = start
                start += 4
            self.body[begin:start] = len(bodies) + k
        self.edge_area = np.concatenate(areas)
        fixed: Bytes = (np.arange(m) >= points.n).astype(np.uint8)
        places = places_of(system, bodies, [f.nodes for f in facets], m)
        self.surface = CollisionPrimitives(
            np.concatenate(vertices), _stack(edges, 2), _stack(triangles, 3), fixed, places
        )
        vertex_points = self.surface.vertices
        self.own_vertices = np.flatnonzero(points.owned(vertex_points)).astype(np.int32)
        self.own_edges = np.flatnonzero(points.owned(self.surface.edges[:, 0])).astype(np.int32)
        self._strides = np.array(
            [len(self.surface.triangles) or 1, len(self.surface.edges) or 1], dtype=np.int64
        )
        self._wall_of = self.own_vertices[self.own_vertices < points.n]

    # ---- names of pairs: the same on every rank, in every search ----------------------------------------------------

    def name(
        self, kind: npt.NDArray[np.integer], numbers: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.int64]:
        """Names (n,) of pairs of primitives with numbers (n, 2); of a wall and a point they are (wall, point)."""
        stride = np.where(kind == EDGE_EDGE, self._strides[1], self._strides[0])
        stride = np.where(kind >= WALLS, np.int64(self.points.m), stride)
        return (numbers[:, 0] * stride + numbers[:, 1]) * 4 + np.minimum(
            kind.astype(np.int64), WALLS
        )

    def numbers(self, names: npt.NDArray[np.int64]) -> tuple[Bytes, Integers]:
        """Kind (n,) and points (n, 4) of named pairs."""
        what, rest = names % 4, names // 4
        kind, nodes = what.astype(np.uint8), np.zeros((len(names), 4), dtype=np.int32)
        i, j = np.divmod(rest[what == POINT_TRIANGLE], self._strides[0])
        nodes[what == POINT_TRIANGLE] = np.column_stack(
            [self.surface.vertices[i], self.surface.triangles[j]]
        )
        i, j = np.divmod(rest[what == EDGE_EDGE], self._strides[1])
        nodes[what == EDGE_EDGE] = np.hstack([self.surface.edges[i], self.surface.edges[j]])
        for at in np.flatnonzero(what == WALLS):
            wall, point = divmod(int(rest[at]), self.points.m)
            kind[at] = self.walls[wall].wall.kind
            nodes[at] = (point, *self.walls[wall].behind)
        return kind, nodes

    def wall_pairs(self) -> tuple[Integers, Bytes, npt.NDArray[np.int64]]:
        """Pairs of this rank's points with all walls: points (n, 4), kind (n,), names (n,)."""
        points = self.surface.vertices[self._wall_of]
        nodes: list[Integers] = [np.zeros((0, 4), np.int32)]
        kinds: list[Bytes] = [np.zeros(0, np.uint8)]
        names: list[npt.NDArray[np.int64]] = [np.zeros(0, np.int64)]
        for k, placed in enumerate(self.walls):
            behind = np.broadcast_to(np.array(placed.behind, dtype=np.int32), (len(points), 3))
            nodes.append(np.column_stack([points, behind]).astype(np.int32))
            kinds.append(np.full(len(points), placed.wall.kind, dtype=np.uint8))
            both = np.column_stack(
                [np.full(len(points), k, dtype=np.int64), points.astype(np.int64)]
            )
            names.append(self.name(kinds[-1], both))
        return np.vstack(nodes), np.concatenate(kinds), np.concatenate(names)

    def wall_radius(self, nodes: Integers) -> Array:
        """Radius (n,) of the walls of pairs (n, 4)."""
        by_origin = {placed.behind[0]: placed.wall.radius for placed in self.walls}
        return np.array([by_origin[int(i)] for i in nodes[:, 1]])

    def areas_of(self, kind: Bytes, nodes: Integers, numbers: npt.NDArray[np.int64]) -> Array:
        """The area [m²] for which each pair stands; a wall takes the whole of a point's, a film half of it."""
        area: Array = self.area[nodes[:, 0]] * np.where(kind >= WALLS, 1.0, 0.5)
        edges = kind == EDGE_EDGE
        area[edges] = self.edge_area[numbers[edges]].sum(axis=1) / 4
        return area

    def masses(self, system: Any) -> Array:
        """Mass per area (m,) [kg/m²] of what each point is of; infinite for obstacles."""
        ones, out = system.numbering.vector(), system.numbering.vector()
        density = np.full(self.points.m, np.inf)
        for k, index in enumerate(self.indices):
            owned, size = system.numbering.owned(index), system.bodies[index].block.size
            ones.set(0.0)
            with ones as values:
                values[owned].reshape(-1, size)[:, 0] = 1.0
            system.M.mult(ones, out)
            mass = system.comm.allreduce(float(out.array_r[owned].reshape(-1, size)[:, 0].sum()))
            here = self.body == k
            density[here] = mass / self.area[here].sum()
        return density


def _stack(parts: list[Integers], width: int) -> Integers:
    return np.ascontiguousarray(np.vstack([np.zeros((0, width), np.int32), *parts]), dtype=np.int32)


def _edges_and_areas(shape: Facets, radius: float) -> tuple[Integers, Array, Array]:
    """Edges (e, 2), and the area for which each of them and each point stands: thirds of triangles, and the halves of
    lines' shadows."""
    n = len(shape.nodes)
    if len(shape.lines):
        area: Array = (
            np.linalg.norm(shape.X[shape.lines[:, 1]] - shape.X[shape.lines[:, 0]], axis=1)
            * 2
            * radius
        )
        return (
            shape.lines,
            area,
            np.bincount(shape.lines.ravel(), np.repeat(area / 2, 2), n).astype(float),
        )
    T = shape.X[shape.triangles]
    thirds = np.repeat(
        np.linalg.norm(np.cross(T[:, 1] - T[:, 0], T[:, 2] - T[:, 0]), axis=1) / 6, 3
    )
    sides = np.sort(shape.triangles[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2), axis=1)
    edges, which = np.unique(sides, axis=0, return_inverse=True)
    return (
        edges.astype(np.int32),
        np.bincount(which.ravel(), thirds, len(edges)).astype(float),
        np.bincount(shape.triangles.ravel(), thirds, n).astype(float),
    )
