"""Friction of one contact: which pairs rub in a step, and between which of their points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gossamer_fx.contact.arrays import Array, Int32Array, Int64Array
from gossamer_fx.contact.friction.friction_pairs import FrictionPairs, FrictionStep
from gossamer_fx.contact.friction.tangent_directions import (
    EDGE_WEIGHTS,
    TINY,
    gap_weights,
    orthonormal_combinations,
    unit_vectors,
)
from gossamer_fx.contact.geometry.collision_mesh import FRAME_SIZE, CollisionMesh
from gossamer_fx.contact.pair_table import ActivePairs, PairKind
from gossamer_fx.contact.potential import ContactLaw
from gossamer_fx.contact.system_view import ContactAssembly


class Friction:
    """Friction of one contact.

    Args:
        mesh: what touches; obstacles with friction have a frame.
        coefficient: μ of bodies with each other.
        of_obstacles: μ of each obstacle (k,) with bodies.
        slip_velocity: v_s [m/s] below which what sticks may creep.
        law: of the normal forces.
        system: with the step.
    """

    def __init__(
        self,
        mesh: CollisionMesh,
        coefficient: float,
        of_obstacles: Sequence[float],
        slip_velocity: float,
        law: ContactLaw,
        system: ContactAssembly,
    ) -> None:
        """List the coefficients of bodies and obstacles.

        Args:
            mesh: bodies and obstacles of a contact; obstacles with friction have an origin and
                axes.
            coefficient: μ [-] of bodies with each other.
            of_obstacles: μ [-] of each obstacle with bodies.
            slip_velocity: speed [m/s] below which what sticks may slide.
            law: of the normal forces.
            system: the equations of the scene, with the step.
        """
        self._mesh = mesh
        self._points = mesh.points
        self._law = law
        self._system = system
        self._slip_velocity = slip_velocity
        self._coefficient = np.array([coefficient] * len(mesh.bodies) + list(of_obstacles))
        self._groups: list[FrictionPairs] = []

    def _block_row_of_points(self) -> Int64Array:
        """Return the block row, a vector of three unknowns, that moves each point; -1 where none
        does.

        A frame, the origin and axes of an obstacle, is fixed in its rigid body, so that each of its
        vectors is one block row.

        Returns:
            (m,) numbers of block rows; those of walls and solids of obstacles are -1, too.
        """
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
        """Choose the contact pairs of a step that have friction, and the two directions in which
        each slides.

        Args:
            pairs: n pairs that take part, with the column `start` of their closest points.
            x0: points (m, 3) [m] at the start.

        Returns:
            for the pairs between bodies, and for those with obstacles, the block rows (n, k) that
            each pair couples in the tangent; a kind without pairs is left out.
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
        """Return the number (n,) of the obstacle of pairs, or of one of their bodies."""
        return self._mesh.body[points].max(axis=1)

    def _coefficient_of(self, points: Int32Array) -> Array:
        """Return μ (n,) of pairs with points (n, 4); that of the obstacle if there is one."""
        return self._coefficient[self._partner(points)]

    def _block_rows_of(self, points: Int32Array) -> Int64Array:
        """Return the block rows (n, k) of points; a point that nothing moves repeats one of a
        body."""
        block_rows = self._block_row[points]
        is_of_body = points < self._points.body_count
        of_body = points[np.arange(len(points)), is_of_body.argmax(axis=1)]
        return np.where(block_rows >= 0, block_rows, of_body[:, None])

    def _between_bodies(self, pairs: ActivePairs, x0: Array) -> FrictionPairs:
        """Return the friction of contact pairs between bodies, which slide along two edges of the
        pair.

        Args:
            pairs: n pairs of bodies only, with the column `start` of their closest points.
            x0: points (m, 3) [m] at the start of the step.
        """
        points = pairs.points
        r = gap_weights(pairs)
        edge_weights = EDGE_WEIGHTS[np.minimum(pairs.kind, PairKind.EDGE_EDGE)]
        gap = np.einsum("nk,nkc->nc", r, x0[points])
        edges = np.einsum("nik,nkc->nic", edge_weights, x0[points])
        normal = unit_vectors(gap)
        along_normal = np.einsum("nic,nc->ni", edges, normal)
        across = edges - along_normal[:, :, None] * normal[:, None]
        # With half of its part along the gap taken off an edge, the gradient of r·t by r, which is
        # t plus what t changes by r, is across the normal.
        gap_length = np.maximum(np.linalg.norm(gap, axis=1), TINY)
        half = along_normal / (2 * gap_length[:, None])
        corrected = edge_weights - half[:, :, None] * r[:, None]
        # Edges are neither unit vectors nor perpendicular to each other.
        combinations = orthonormal_combinations(across, np.linalg.norm(edges, axis=2))
        is_edges = (pairs.kind == PairKind.EDGE_EDGE)[:, None]
        return FrictionPairs(
            pairs=pairs,
            law=self._law,
            side_weights=np.where(is_edges, [1.0, 1, 0, 0], [1.0, 0, 0, 0]),
            normal=normal,
            points=points,
            gap_weights=r,
            direction_weights=np.einsum("nij,njk->nik", combinations, corrected),
            point_weights=np.broadcast_to(np.eye(4), (len(points), 4, 4)),
            coefficient=self._coefficient_of(points),
            block_rows=self._block_rows_of(points),
        )

    def _with_obstacles(self, pairs: ActivePairs, x0: Array) -> FrictionPairs:
        """Return the friction of contact pairs with an obstacle, which slide along two of its axes.

        The vector r of a pair, whose products with the two directions measure its sliding, leads
        from the point of the obstacle that lies where the body's point is, fixed in the obstacle's
        frame: so a ball on a rigid body rolls.

        Args:
            pairs: n pairs with the column `start` of their closest points, each with an obstacle
                that has a frame: an origin and three axes that move with it.
            x0: points (m, 3) [m] at the start of the step.
        """
        is_of_body = pairs.points < self._points.body_count
        weights = gap_weights(pairs)
        of_body = np.abs(weights) * is_of_body
        points = self._with_frames(pairs.points)
        origin = x0[points[:, 4]]
        axes = x0[points[:, 5:]]
        touched = np.einsum("nk,nkc->nc", of_body, x0[pairs.points])
        sign = np.where((weights * is_of_body).sum(axis=1) < 0, -1, 1)
        normal = unit_vectors(_towards_body(pairs, weights * sign[:, None], x0))

        # Two directions across the normal, in the axes of the obstacle: the first is also across
        # the axis that is farthest from the normal.
        in_axes = np.einsum("nic,nc->ni", axes, normal)
        farthest_axis = np.eye(3)[np.abs(in_axes).argmin(axis=1)]
        directions = np.zeros((len(points), 2, 4 + FRAME_SIZE))
        directions[:, 0, 5:] = unit_vectors(np.cross(in_axes, farthest_axis))
        directions[:, 1, 5:] = np.cross(in_axes, directions[:, 0, 5:])
        position = np.einsum("nic,nc->ni", axes, touched - origin)
        return FrictionPairs(
            pairs=pairs,
            law=self._law,
            side_weights=is_of_body.astype(float),
            normal=normal,
            points=points,
            gap_weights=np.hstack([of_body, -np.ones((len(points), 1)), -position]),
            direction_weights=directions,
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
        """Return how the four points of contact pairs with obstacles follow the unknowns that
        friction couples.

        Args:
            points: numbers (n, 8) of the four points of each pair and the four of its obstacle's
                frame.

        Returns:
            weights (n, 4, 8) [-]: a point of a body follows itself, one of an obstacle the vectors
            of its rigid body, and is zero where nothing moves it.
        """
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


def _towards_body(pairs: ActivePairs, weights: Array, x0: Array) -> Array:
    """Return a vector from the obstacle of each contact pair towards its body, of any length.

    Args:
        pairs: n active pairs with an obstacle.
        weights: (n, 4) of the pair's points in the vector between the closest points, for pairs
            that are not of walls.
        x0: points (m, 3) [m] at the start of the step.

    Returns:
        vectors (n, 3): the normal of a plane, for rooms the direction towards their middle.
    """
    x = x0[pairs.points]
    to_origin = x[:, 1] - x[:, 0]
    from_axis = np.einsum("nkc,nc->nk", x[:, 2:], to_origin)
    by_kind = {
        PairKind.POINT_PLANE: x[:, 2],
        PairKind.POINT_IN_SPHERE: to_origin,
        PairKind.POINT_IN_CYLINDER: np.einsum("nk,nkc->nc", from_axis, x[:, 2:]),
    }
    conditions = [(pairs.kind == kind)[:, None] for kind in by_kind]
    between_points = np.einsum("nk,nkc->nc", weights, x)
    return np.select(conditions, list(by_kind.values()), between_points)
