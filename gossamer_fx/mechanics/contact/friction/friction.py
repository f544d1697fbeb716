"""Friction of one contact: which pairs rub in a step, and between which of their points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gossamer_fx.mechanics.contact.contact_step import PUSH_BACK, PairStep
from gossamer_fx.mechanics.contact.contract import (
    Array,
    Int32Array,
    Int64Array,
    Sides,
)
from gossamer_fx.mechanics.contact.friction.friction_pairs import FrictionPairs
from gossamer_fx.mechanics.contact.friction.sliding import BetweenBodies, WithObstacles
from gossamer_fx.mechanics.contact.geometry.collision_mesh import FRAME_SIZE, CollisionMesh
from gossamer_fx.mechanics.contact.pairs import SIDES
from gossamer_fx.mechanics.terms.assembly import Assembly


class Friction:
    """Friction of one contact.

    Args:
        coefficient: μ of bodies with each other.
        of_obstacles: μ of each obstacle (k,) with bodies; None: that of bodies.
        slip_velocity: v_s [m/s] below which what sticks may creep.
    """

    def __init__(
        self,
        mesh: CollisionMesh,
        coefficient: float,
        of_obstacles: Sequence[float | None],
        slip_velocity: float,
        system: Assembly,
    ) -> None:
        self._mesh = mesh
        self._points = mesh.points
        self._system = system
        self._slip_velocity = slip_velocity
        own = [None] * len(mesh.bodies) + list(of_obstacles)
        # By the number of a body or obstacle: whether it takes the common coefficient, and the one
        # that it takes.
        self._has_shared_coefficient = np.array([one is None for one in own])
        self._coefficient = np.array([coefficient if one is None else one for one in own])

    def _block_row_of_points(self) -> Int64Array:
        """Return the block row (m,), a vector of three unknowns, that moves each point of a body or
        a frame; -1 where none does, and for boundaries and solids of obstacles.  A frame, the
        origin and axes of an obstacle, is fixed in its rigid body, so that each of its vectors is
        one block row."""
        weights = self._points.weights
        block_row = np.full(self._points.count, -1, dtype=np.int64)
        block_row[: self._points.body_count] = np.arange(self._points.body_count)
        for first in self._mesh.frames[self._mesh.frames >= 0]:
            for point in range(first, first + FRAME_SIZE):
                columns = weights.indices[weights.indptr[point] : weights.indptr[point + 1]]
                if len(columns):
                    block_row[point] = columns[0]
        return block_row

    # ---- a step ----

    def groups(self, step: PairStep) -> list[FrictionPairs]:
        """Return those of the pairs of a step that have friction, whose coefficient is above zero,
        with the two directions in which each slides.  Groups differ in the number of points of a
        pair, which are columns of arrays."""
        block_row = self._block_row_of_points()
        # Normal forces push pairs back that passed through, in recorded steps, too.
        step = replace(step, push_back=PUSH_BACK)
        step = step.rows(self._coefficient_of(step.pairs.points) > 0)
        points = step.pairs.points
        with_obstacle = np.asarray((points >= self._points.body_count).any(axis=1))
        groups = []
        if not with_obstacle.all():
            groups.append(self._between_bodies(step.rows(~with_obstacle), block_row))
        if with_obstacle.any():
            groups.append(self._with_obstacles(step.rows(with_obstacle), block_row))
        return groups

    @property
    def coefficient(self) -> float:
        """Coefficient of bodies with each other, and with obstacles that do not have one."""
        return float(self._coefficient[0])

    def set_coefficient(self, coefficient: float) -> None:
        """Give bodies, and obstacles without an own coefficient, another coefficient."""
        self._coefficient[self._has_shared_coefficient] = coefficient

    # ---- what rubs on what ----

    def _partner(self, points: Int32Array) -> np.ndarray:
        """Return for pairs with points (n, 4) the number (n,) of the obstacle, or of one of the
        bodies: obstacles have the higher numbers."""
        return self._mesh.body[points].max(axis=1)

    def _coefficient_of(self, points: Int32Array) -> Array:
        """Return μ (n,) of pairs with points (n, 4); that of the obstacle if there is one."""
        return self._coefficient[self._partner(points)]

    def _block_rows_of(self, points: Int32Array, block_row: Int64Array) -> Int64Array:
        """Return the block rows (n, k) of points (n, k); a point that nothing moves repeats that of
        a body's point in the same row."""
        block_rows = block_row[points]
        is_of_body = points < self._points.body_count
        of_body = points[np.arange(len(points)), is_of_body.argmax(axis=1)]
        return np.where(block_rows >= 0, block_rows, of_body[:, None])

    def _between_bodies(self, step: PairStep, block_row: Int64Array) -> FrictionPairs:
        """Return the friction of contact pairs between bodies, which slide along two edges of the
        pair."""
        pairs = step.pairs
        points = pairs.points
        is_edges = (SIDES[pairs.kind] == Sides.EDGE_EDGE)[:, None]
        return self._friction_pairs(
            step,
            block_row,
            side_weights=np.where(is_edges, [1.0, 1, 0, 0], [1.0, 0, 0, 0]),
            geometry=BetweenBodies(pairs.kind),
            points=points,
            point_weights=np.broadcast_to(np.eye(4), (len(points), 4, 4)),
        )

    def _with_obstacles(self, step: PairStep, block_row: Int64Array) -> FrictionPairs:
        """Return the friction of contact pairs with an obstacle, which slide along two of its axes.
        The vector r of a pair, whose products with the two directions measure its sliding, leads
        from the point of the obstacle that lies where the body's point is, fixed in the obstacle's
        frame: so a ball on a rigid body rolls."""
        pairs = step.pairs
        is_of_body = np.asarray(pairs.points < self._points.body_count)
        points = self._with_frames(pairs.points)
        return self._friction_pairs(
            step,
            block_row,
            side_weights=is_of_body.astype(float),
            geometry=WithObstacles(pairs.geometry(slice(None)), is_of_body),
            points=points,
            point_weights=self._weights_with_frames(points, block_row),
        )

    def _friction_pairs(
        self,
        step: PairStep,
        block_row: Int64Array,
        *,
        side_weights: Array,
        geometry: BetweenBodies | WithObstacles,
        points: Int32Array,
        point_weights: Array,
    ) -> FrictionPairs:
        """Return pairs that rub, with what follows from their points and the start of the step."""
        partner = self._partner(step.pairs.points)
        return FrictionPairs(
            step=step,
            block_rows=self._block_rows_of(points, block_row),
            side_weights=side_weights,
            geometry=geometry,
            start=geometry.at(step.x0[points], step.pairs.parameters),
            points=points,
            point_weights=point_weights,
            is_moved=(block_row[points] >= 0).astype(float),
            coefficient=self._coefficient[partner],
            has_shared_coefficient=self._has_shared_coefficient[partner],
            creep=self._slip_velocity * float(self._system.h),
        )

    def _with_frames(self, points: Int32Array) -> Int32Array:
        """Return the points (n, 8) of pairs with obstacles: their own, and the obstacle's frame."""
        obstacle = self._partner(points) - len(self._mesh.bodies)
        first = self._mesh.frames[obstacle]
        return np.hstack([points, first[:, None] + np.arange(FRAME_SIZE)]).astype(np.int32)

    def _weights_with_frames(self, points: Int32Array, block_row: Int64Array) -> Array:
        """Return the weights (n, 4, 8) [-] of points (n, 8), those of a pair with an obstacle and
        of its frame, in the four of the pair: a point of a body is itself, one of an obstacle a sum
        of the vectors of its rigid body; zero where nothing moves it."""
        own = points[:, :4]
        is_of_body = own < self._points.body_count
        weights = np.zeros((*own.shape, 4 + FRAME_SIZE))
        weights[:, range(4), range(4)] = is_of_body
        frame_rows = np.repeat(block_row[points[:, None, 4:]], 4, axis=1)
        rows = np.broadcast_to(own[:, :, None], frame_rows.shape)
        is_of_frame = (frame_rows >= 0) & ~is_of_body[:, :, None]
        if is_of_frame.any():
            entries = self._points.weights[rows[is_of_frame], frame_rows[is_of_frame]]
            weights[:, :, 4:][is_of_frame] = np.asarray(entries).ravel()
        return weights
