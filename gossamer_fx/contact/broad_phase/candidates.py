"""Candidate pairs: all that can come within the activation distance in the next steps."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from gossamer_fx.contact.arrays import Array
from gossamer_fx.contact.broad_phase.overlaps import find_overlaps
from gossamer_fx.contact.broad_phase.trajectory_bounds import RigidDrift, TrajectoryBounds
from gossamer_fx.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.contact.narrow_phase.closest_points import closest_points
from gossamer_fx.contact.pair_table import CandidatePairs, is_wall

# Part of its expected way by which a point may miss its expected position.  A wider margin makes more
# candidates, a smaller one more searches.
WAY_MARGIN = 0.3

# Steps for which one search shall serve: at first, and at most.  The number doubles when a search served
# to its end, and falls to what was reached when it did not.
FIRST_HORIZON = 4
MAX_HORIZON = 32

# A part of a step [1] by which a search lasts longer than its horizon, so that round-off in the time does
# not end it one step early.
SPARE_TIME = 1e-6


class CandidateSearch:
    """Keeps a list of candidates that is complete as long as points stay within their bounds.

    Args:
        mesh: what may touch.
        activation_distance: largest gap [m] at which pairs have energy.

    Attributes:
        pairs: the n candidates of this rank.
        bounds: of the trajectories for which they are complete.
        count: number of searches so far.
    """

    pairs: CandidatePairs
    bounds: TrajectoryBounds

    def __init__(self, mesh: CollisionMesh, activation_distance: float) -> None:
        """Start without candidates; the first search finds them."""
        self._mesh = mesh
        self._activation_distance = activation_distance
        self._horizon = FIRST_HORIZON
        self._age = 0
        self.count = 0

    def begin_step(self) -> None:
        """Count a step for which the present candidates serve."""
        self._age += 1

    def find_at_rest(self, x: Array, time: float) -> None:
        """Search about points x (m, 3) [m] that do not move; collective."""
        self._choose_horizon()
        at_rest = np.zeros_like(x)
        bounds = self._bounds(x, at_rest, time, duration=0.0)
        self._find(bounds)

    def find(
        self,
        x: Array,
        v: Array,
        time: float,
        step: float,
        end: Array,
    ) -> None:
        """Search for the next steps; collective.

        Args:
            x, v: points [m] and their velocities [m/s] (m, 3) at a time [s].
            step: its length [s].
            end: points (m, 3) [m] at the end of the step, which are within the bounds, too.
        """
        self._choose_horizon()
        bounds = self._bounds(x, v, time, duration=(self._horizon + SPARE_TIME) * step)
        end_time = time + step
        expected = x + (end_time - time) * bounds.velocities
        missed = bounds.drift.undone(end, end_time) - expected
        bounds.margin[:] += np.linalg.norm(missed, axis=1)
        self._find(bounds)

    def _choose_horizon(self) -> None:
        """Choose the number of steps for which the next search serves, from how long the last one
        did.
        """
        if not self._age:
            return
        if self._age >= self._horizon:
            self._horizon = min(2 * self._horizon, MAX_HORIZON)
        else:
            self._horizon = max(self._age, 1)

    def _bounds(
        self,
        x: Array,
        v: Array,
        time: float,
        duration: float,
    ) -> TrajectoryBounds:
        """Return bounds for a motion from points x (m, 3) with velocities v (m, 3)."""
        vertices = self._mesh.surface.vertices
        drift = RigidDrift.of(x[vertices], v[vertices], time)
        velocities = v - drift.velocities(x)
        # Points of walls do not belong to a primitive: their pairs are candidates wherever they are.
        margin = np.full(len(x), np.inf)
        way = duration * np.linalg.norm(velocities[vertices], axis=1)
        margin[vertices] = self._activation_distance / 2 + WAY_MARGIN * way
        return TrajectoryBounds(drift, x, velocities, margin, duration)

    def _find(self, bounds: TrajectoryBounds) -> None:
        self.pairs = find_candidates(self._mesh, bounds, self._activation_distance)
        self.bounds = bounds
        self._age = 0
        self.count += 1


def find_candidates(
    mesh: CollisionMesh, bounds: TrajectoryBounds, activation_distance: float
) -> CandidatePairs:
    """Return this rank's pairs whose gap can be below a distance [m] within the bounds.

    1. Boxes of primitives, with half of the distance and their radius around them, overlap.
    2. The gap at the beginning, less what the pair can come closer, is below the distance.
    3. Pairs are sorted by their primitives: their order depends on no position, so that sums over pairs
       are the same after a restart.
    4. Each point of a body and each wall are a pair.
    """
    reach = (activation_distance / 2 + mesh.radius)[:, None]
    lower, upper = bounds.boxes()
    found = find_overlaps(
        mesh.surface, lower - reach, upper + reach, mesh.own_vertices, mesh.own_edges
    )
    found.check(len(bounds.x))
    radius = mesh.radius[found.points[:, 0]] + mesh.radius[found.second_point]
    squared_distance, _ = closest_points(found, bounds.x)
    gap = np.sqrt(squared_distance) - radius
    near = np.flatnonzero(gap < activation_distance + bounds.approach(found))
    first, second = found.primitives[near].T
    near = near[np.lexsort((first, second, found.kind[near]))]

    pairs = found.rows(near)
    wall_kind, wall_points, wall_identifier, wall_radius = mesh.wall_pairs()
    area = mesh.areas(pairs.kind, pairs.points, pairs.primitives)
    identifier = mesh.identifiers(pairs.kind, pairs.primitives)
    wall_point = wall_points[:, 0]
    return CandidatePairs(
        kind=np.concatenate([pairs.kind, wall_kind]),
        points=np.vstack([pairs.points, wall_points]),
        identifier=np.concatenate([identifier, wall_identifier]),
        area=np.concatenate([area, mesh.area[wall_point]]),
        radius=np.concatenate([radius[near], mesh.radius[wall_point]]),
        wall_radius=np.concatenate([np.zeros(len(pairs)), wall_radius]),
    )


def nearest_gaps(
    pairs: CandidatePairs,
    gap: Array,
    point_count: int,
    comm: MPI.Intracomm,
) -> Array:
    """Return the gap (m,) [m] of each point to what is nearest, on every rank; collective.

    Args:
        pairs: the candidates of this rank.
        gap: of the candidates (n,) [m]; infinite ones are left out.
        point_count: m.
    """
    nearest = np.full(point_count, np.inf)
    rows = np.isfinite(gap)
    points = pairs.points[rows]
    gap = gap[rows]
    walls = is_wall(pairs.kind[rows])
    for k in range(4):
        np.minimum.at(nearest, points[~walls, k], gap[~walls])
    # Only the first point of a wall pair is a point that touches.
    np.minimum.at(nearest, points[walls, 0], gap[walls])
    comm.Allreduce(MPI.IN_PLACE, nearest, op=MPI.MIN)
    return nearest
