"""Pairs that may come near for some steps: their distances, and where contact begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.contact.broad_phase.box_tree import candidates, refused
from gossamer_fx.contact.broad_phase.trajectory_bounds import TrajectoryBounds
from gossamer_fx.contact.geometry.collision_mesh import WALLS, CollisionMesh
from gossamer_fx.contact.kernels.library import Array, Bytes, Integers
from gossamer_fx.contact.potential import (
    BARRIER,
    EDGE_EDGE,
    IN_SPHERE,
    PLANE,
    ContactPairs,
    approaches,
    infinite_at_crossings,
    squared_distances,
)

KEPT = 0.1  # part of its distance, or of that at which contact begins, that a pair keeps on the way of a step


@dataclass(frozen=True)
class Candidates:
    """n pairs of this rank, complete as long as all points keep their course.

    Of pairs: nodes (n, 4), kind, names, area [m²] (n,), `second` (n,) the first point of the other side, `radius` (n,)
    of both sides together and `wall` (n,) of a ball or cylinder that holds the point [m].
    """

    course: TrajectoryBounds
    nodes: Integers
    kind: Bytes
    names: npt.NDArray[np.int64]
    area: Array
    second: Integers
    radius: Array
    wall: Array

    @classmethod
    def find(cls, bodies: CollisionMesh, course: TrajectoryBounds, distance: float) -> Candidates:
        """All pairs that can be within a distance [m] while points keep their course."""
        reach, (lo, hi) = (distance / 2 + bodies.radius)[:, None], course.boxes()
        nodes, kind, numbers = candidates(
            bodies.surface, lo - reach, hi + reach, bodies.own_vertices, bodies.own_edges
        )
        radius = bodies.radius[nodes[:, 0]] + bodies.radius[_second(nodes, kind)]
        gaps = np.sqrt(squared_distances(nodes, kind, course.x)) - radius
        near = np.flatnonzero(gaps < distance + course.approach(nodes, kind))
        near = near[
            np.lexsort((*numbers[near].T, kind[near]))
        ]  # an order that does not depend on where they are
        nodes, kind, numbers, radius = nodes[near], kind[near], numbers[near], radius[near]

        at_walls, wall_kind, wall_names = bodies.wall_pairs()
        area = np.concatenate([bodies.areas_of(kind, nodes, numbers), bodies.area[at_walls[:, 0]]])
        names = np.concatenate([bodies.name(kind, numbers), wall_names])
        wall = np.concatenate([np.zeros(len(kind)), bodies.wall_radius(at_walls)])
        radius = np.concatenate([radius, bodies.radius[at_walls[:, 0]]])
        nodes, kind = np.vstack([nodes, at_walls]), np.concatenate([kind, wall_kind])
        return cls(course, nodes, kind, names, area, _second(nodes, kind), radius, wall)

    def gaps(self, x: Array, some: Any = slice(None)) -> Array:
        """Distances (n,) [m] less the radii, at points x; or of some pairs."""
        kind, radius = self.kind[some], self.radius[some]
        s = squared_distances(self.nodes[some], kind, x)
        walls, balls = kind >= WALLS, kind >= IN_SPHERE
        gap: Array = np.sqrt(np.maximum(np.where(walls, 0, s), 0)) - radius
        gap[walls] = s[walls] - radius[walls]
        gap[balls] = self.wall[some][balls] - radius[balls] - np.sqrt(-s[balls])
        return gap

    def approach(self, x0: Array, x1: Array) -> Array:
        """By how much (n,) [m] pairs may come nearer on the straight way from x0 to x1; of walls infinite."""
        return approaches(self.nodes, self.kind, x0, x1)

    def least(self, gaps: Array, comm: MPI.Intracomm, m: int) -> Array:
        """Distance (m,) of each point to what is nearest, on all ranks; infinite where all gaps are."""
        nearest = np.full(m, np.inf)
        some = np.isfinite(gaps)
        nodes, gaps, pairs = self.nodes[some], gaps[some], self.kind[some] < WALLS
        for j in range(4):
            np.minimum.at(nearest, nodes[pairs, j], gaps[pairs])
        np.minimum.at(nearest, nodes[~pairs, 0], gaps[~pairs])
        comm.Allreduce(MPI.IN_PLACE, nearest, op=MPI.MIN)
        return nearest

    def distance(self, of_points: Array) -> Array:
        """Where contact begins (n,) [m], from that of points: the least of a pair's."""
        of_pair = of_points[self.nodes.T]
        d: Array = np.where(self.kind >= WALLS, of_pair[0], of_pair.min(axis=0))
        return d

    def pairs(self, which: npt.NDArray[np.bool_], begins: Array, law: int) -> ContactPairs:
        """Some of them, of which contact begins at the distances (n,), with S and offset, and without stiffness."""
        R, kind, d = self.radius[which], self.kind[which], begins[which]
        S: Array = (R + d) ** 2 - R**2
        offset: Array = R**2
        if law == BARRIER:
            S, offset = infinite_at_crossings(kind, S, offset)
        plane, ball = kind == PLANE, kind >= IN_SPHERE
        S[plane], offset[plane] = d[plane], R[plane]
        room = self.wall[which][ball] - R[ball]
        S[ball], offset[ball] = room**2 - (room - d[ball]) ** 2, -(room**2)
        nodes = np.ascontiguousarray(self.nodes[which])
        return ContactPairs(nodes, kind, np.zeros(len(kind)), S, offset, self.names[which])

    def refused(
        self, x0: Array, x1: Array, gaps: Array, begins: Array, way: Array, among: Any = True
    ) -> npt.NDArray[np.intp]:
        """Which of them (or `among` a mask) would pass through each other from x0 to x1.

        gaps, begins, way: at x0, where contact begins, and of `approach` (n,) [m].
        """
        least = KEPT * np.minimum(gaps, begins)
        some = np.flatnonzero((way > gaps - least) & (self.kind < WALLS) & among)
        pairs = self.nodes[some], self.kind[some]
        return some[refused(*pairs, x0, x1, self.radius[some], gaps[some], least[some])]


def _second(nodes: Integers, kind: Bytes) -> Integers:
    """The first point (n,) of the other side of pairs (n, 4)."""
    return np.where(kind == EDGE_EDGE, nodes[:, 2], nodes[:, 1])
