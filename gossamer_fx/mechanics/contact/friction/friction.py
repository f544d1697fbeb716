"""Friction of one contact: which pairs rub in a step, and between which of their points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gossamer_fx.mechanics.contact.contact_step import ContactLaw
from gossamer_fx.mechanics.contact.contract import (
    Array,
    ContactAssembly,
    Int32Array,
    Int64Array,
    Sides,
)
from gossamer_fx.mechanics.contact.friction.friction_pairs import (
    BetweenBodies,
    FrictionPairs,
    FrictionStep,
    WithObstacles,
    parameters_at_start,
)
from gossamer_fx.mechanics.contact.geometry.collision_mesh import FRAME_SIZE, CollisionMesh
from gossamer_fx.mechanics.contact.pairs import SIDES, ActivePairs


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
        law: ContactLaw,
        system: ContactAssembly,
    ) -> None:
        self._mesh = mesh
        self._points = mesh.points
        self._law = law
        self._system = system
        self._slip_velocity = slip_velocity
        own = [None] * len(mesh.bodies) + list(of_obstacles)
        # By the number of a body or obstacle: whether it takes the common coefficient, and the one
        # that it takes.
        self._has_shared_coefficient = np.array([one is None for one in own])
        self._coefficient = np.array([coefficient if one is None else one for one in own])
        self._groups: list[FrictionPairs] = []

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

    def begin_step(self, pairs: ActivePairs, x0: Array) -> list[Int64Array]:
        """Choose the contact pairs of a step that have friction, those of this rank whose
        coefficient is above zero, and the two directions in which each slides.

        Returns the block rows (n, k), vectors of three unknowns, that each group of pairs couples;
        their block indices have to be given to `set_block_index` before tangents are asked for.
        """
        # A search may have changed which points this rank knows.
        self._block_row = self._block_row_of_points()
        self._is_moved = (self._block_row >= 0).astype(float)
        pairs = pairs.rows(self._coefficient_of(pairs.points) > 0)
        with_obstacle = np.asarray((pairs.points >= self._points.body_count).any(axis=1))
        groups = (
            self._between_bodies(pairs.rows(~with_obstacle), x0),
            self._with_obstacles(pairs.rows(with_obstacle), x0),
        )
        # Groups differ in the number of points of a pair, which are columns of arrays.
        self._groups = [group for group in groups if len(group)]
        return [group.block_rows for group in self._groups]

    def set_block_index(self, block_index: Sequence[Int32Array]) -> None:
        """Set the block index (n, k k) of each group's blocks."""
        for group, of_group in zip(self._groups, block_index, strict=True):
            group.block_index = of_group

    def add_forces(self, x0: Array, x1: Array, point_forces: Array) -> None:
        """Add the forces [N] of a step from x0 to x1 to those on points (m, 3)."""
        step = self._step(x0, x1)
        for group in self._groups:
            group.add_forces(step, point_forces)

    def add_tangents(self, x0: Array, x1: Array, blocks: Array) -> None:
        """Add the derivative [N/m] of the forces with respect to x1 to the blocks (b, 9)."""
        step = self._step(x0, x1)
        for group in self._groups:
            group.add_tangents(step, self._is_moved, blocks)

    def loss(self, x0: Array, x1: Array) -> float:
        """Return the dissipated energy [J] of a step, this rank's share."""
        step = self._step(x0, x1)
        return sum(group.loss(step) for group in self._groups)

    # ---- sensitivities ----

    def add_product_with_start_derivative(
        self, x0: Array, x1: Array, μ: Array, found: Array
    ) -> None:
        """Add (∂f/∂x0)ᵀ μ of the forces f of a step to `found` (m, 3); μ (m, 3) on the points."""
        from gossamer_fx.mechanics.contact.friction.start_derivative import (
            add_product_with_start_derivative,
        )

        step = self._step(x0, x1)
        for group in self._groups:
            add_product_with_start_derivative(group, step, μ, found)

    def work_by_coefficient(self, x0: Array, x1: Array, μ: Array) -> float:
        """Return μ·∂f/∂c [J] by the coefficient c of bodies with each other, this rank's share.
        Pairs with obstacles that have their own coefficient do not count."""
        from gossamer_fx.mechanics.contact.friction.start_derivative import work_by_coefficient

        step = self._step(x0, x1)
        work = 0.0
        for group in self._groups:
            is_shared = self._has_shared_coefficient[self._partner(group.pairs.points)]
            work += float(work_by_coefficient(group, step, μ)[is_shared].sum())
        return work

    def works(self, x0: Array, x1: Array, μ: Array) -> tuple[Int64Array, Array]:
        """Return identifiers (n,) of pairs that may rub, and the work μ·f (n,) [J] of the friction
        of each."""
        from gossamer_fx.mechanics.contact.friction.start_derivative import work_by_coefficient

        step = self._step(x0, x1)
        identifiers: list[Int64Array] = [np.zeros(0, dtype=np.int64)]
        works: list[Array] = [np.zeros(0)]
        for group in self._groups:
            identifiers.append(group.pairs.identifier)
            works.append(group.coefficient * work_by_coefficient(group, step, μ))
        return np.concatenate(identifiers), np.concatenate(works)

    @property
    def coefficient(self) -> float:
        """Coefficient of bodies with each other, and with obstacles that do not have one."""
        return float(self._coefficient[0])

    def set_coefficient(self, coefficient: float) -> None:
        """Give bodies, and obstacles without an own coefficient, another coefficient."""
        self._coefficient[self._has_shared_coefficient] = coefficient

    def _step(self, x0: Array, x1: Array) -> FrictionStep:
        """A step from points x0 to x1 (m, 3) [m] with the length and the weights of the system."""
        return FrictionStep(
            x0,
            x1,
            creep=self._slip_velocity * float(self._system.h),
            alpha=self._system.rule.alpha,
            geometric_share=self._system.geometric,
        )

    # ---- what rubs on what ----

    def _partner(self, points: Int32Array) -> np.ndarray:
        """Return for pairs with points (n, 4) the number (n,) of the obstacle, or of one of the
        bodies: obstacles have the higher numbers."""
        return self._mesh.body[points].max(axis=1)

    def _coefficient_of(self, points: Int32Array) -> Array:
        """Return μ (n,) of pairs with points (n, 4); that of the obstacle if there is one."""
        return self._coefficient[self._partner(points)]

    def _block_rows_of(self, points: Int32Array) -> Int64Array:
        """Return the block rows (n, k) of points (n, k); a point that nothing moves repeats that of
        a body's point in the same row."""
        block_rows = self._block_row[points]
        is_of_body = points < self._points.body_count
        of_body = points[np.arange(len(points)), is_of_body.argmax(axis=1)]
        return np.where(block_rows >= 0, block_rows, of_body[:, None])

    def _between_bodies(self, pairs: ActivePairs, x0: Array) -> FrictionPairs:
        """Return the friction of contact pairs between bodies, which slide along two edges of the
        pair."""
        points = pairs.points
        is_edges = (SIDES[pairs.kind] == Sides.EDGE_EDGE)[:, None]
        geometry = BetweenBodies(pairs.kind)
        return FrictionPairs(
            pairs=pairs,
            law=self._law,
            side_weights=np.where(is_edges, [1.0, 1, 0, 0], [1.0, 0, 0, 0]),
            geometry=geometry,
            start=geometry.at(x0[points], parameters_at_start(pairs)),
            points=points,
            point_weights=np.broadcast_to(np.eye(4), (len(points), 4, 4)),
            coefficient=self._coefficient_of(points),
            block_rows=self._block_rows_of(points),
        )

    def _with_obstacles(self, pairs: ActivePairs, x0: Array) -> FrictionPairs:
        """Return the friction of contact pairs with an obstacle, which slide along two of its axes.
        The vector r of a pair, whose products with the two directions measure its sliding, leads
        from the point of the obstacle that lies where the body's point is, fixed in the obstacle's
        frame: so a ball on a rigid body rolls."""
        is_of_body = np.asarray(pairs.points < self._points.body_count)
        points = self._with_frames(pairs.points)
        geometry = WithObstacles(pairs.geometry(slice(None)), is_of_body)
        return FrictionPairs(
            pairs=pairs,
            law=self._law,
            side_weights=is_of_body.astype(float),
            geometry=geometry,
            start=geometry.at(x0[points], parameters_at_start(pairs)),
            points=points,
            point_weights=self._weights_with_frames(points),
            coefficient=self._coefficient_of(pairs.points),
            block_rows=self._block_rows_of(points),
        )

    def _with_frames(self, points: Int32Array) -> Int32Array:
        """Return the points (n, 8) of pairs with obstacles: their own, and the obstacle's frame."""
        obstacle = self._partner(points) - len(self._mesh.bodies)
        first = self._mesh.frames[obstacle]
        return np.hstack([points, first[:, None] + np.arange(FRAME_SIZE)]).astype(np.int32)

    def _weights_with_frames(self, points: Int32Array) -> Array:
        """Return the weights (n, 4, 8) [-] of points (n, 8), those of a pair with an obstacle and
        of its frame, in the four of the pair: a point of a body is itself, one of an obstacle a sum
        of the vectors of its rigid body; zero where nothing moves it."""
        own = points[:, :4]
        is_of_body = own < self._points.body_count
        weights = np.zeros((*own.shape, 4 + FRAME_SIZE))
        weights[:, range(4), range(4)] = is_of_body
        frame_rows = np.repeat(self._block_row[points[:, None, 4:]], 4, axis=1)
        rows = np.broadcast_to(own[:, :, None], frame_rows.shape)
        is_of_frame = (frame_rows >= 0) & ~is_of_body[:, :, None]
        if is_of_frame.any():
            entries = self._points.weights[rows[is_of_frame], frame_rows[is_of_frame]]
            weights[:, :, 4:][is_of_frame] = np.asarray(entries).ravel()
        return weights
