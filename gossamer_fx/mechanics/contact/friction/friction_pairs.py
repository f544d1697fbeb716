"""Coulomb friction of pairs: a stress against how far their points slide on each other.

Problem.  Sliding is a motion along the surfaces, which turn; a law in terms of displacements would
see rotations as sliding and would not conserve angular momentum.

Idea.  Let r lead from a point of one side to a point of the other, both fixed in the material, and
let t1, t2 be two directions fixed in the material: edges of the pair, or axes of an obstacle.  The
measures

    m_i = r·t_i                                                                                (1)

are quadratic in the coordinates and do not change when the pair moves and turns as a whole.  At the
start their gradients with respect to r are two unit directions across the normal.

Algorithm, for a step of length h from q0 to q1:

    1. The pair slides by w = m(q1) - m(q0), in two components.                                (2)
    2. Its stress is S = μ N φ(|w|/(h v_s)) w/|w|,  φ(y) = 2y - y² for y < 1, else 1.          (3)
       N is the mean normal force of the same step, v_s the speed below which it may creep.
    3. The force on the points is Dm(q_mid)ᵀ S.

S·w ≥ 0 is what the step dissipates.  Momentum and angular momentum stay: the moment of two opposite
forces at a distance is carried by the directions.

Geometry.  r and t_i are combinations of the points of a pair, with weights that are computed from
the points at the start of a step (`SlidingGeometry`).  The functions that do it accept complex
points, so that a complex step differentiates them: lengths are square roots of sums of squares, and
nothing takes an absolute value.

Limits: the tangent plane is that of the start of the step.  Where two edges meet in one plane, side
by side, only the direction along them has friction.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gossamer_fx.mechanics.contact.contact_step import ContactLaw, PairState, evaluate
from gossamer_fx.mechanics.contact.contract import (
    Array,
    ByteArray,
    Int32Array,
    Int64Array,
    MaskArray,
    Sides,
)
from gossamer_fx.mechanics.contact.geometry.collision_mesh import FRAME_SIZE
from gossamer_fx.mechanics.contact.pairs import (
    SIDES,
    TINY,
    ActivePairs,
    PairRows,
    PairTable,
    gap_weights_of,
    lengths_of,
    stencils_of,
)

# Sine of the angle to the normal, or to the other direction, below which an edge gives no direction
# to slide along.
SMALLEST_SINE = 1e-3

# Relative difference up to which two candidates for a direction count as equally good.
TIE = 1e-6

# Two edges of a pair as combinations of its four points: two sides of the triangle, or one of each
# side.
EDGE_WEIGHTS = np.array(
    [[[0, 1, -1, 0], [0, 1, 0, -1]], [[-1, 1, 0, 0], [0, 0, 1, -1]]], dtype=float
)


def unit_vectors(vectors: Array) -> Array:
    """Return vectors (n, 3) of length one; those without a length stay zero."""
    return vectors / np.maximum(lengths_of(vectors), TINY)[:, None]


def orthonormal_combinations(vectors: Array, lengths: Array) -> Array:
    """Return combinations of two vectors (n, 2, 3) [m], parts of edges, that are orthonormal.

    The vector that is more of its edge comes first; of the other one its part along the first is
    taken away.  `lengths`: of the edges (n, 2) [m].  A vector that is shorter than a thousandth of
    its edge (`SMALLEST_SINE`) gives no direction, and its combination is zero.  Returns
    coefficients (n, 2, 2) [1/m]: row i has those of both vectors in direction i.
    """
    count = len(vectors)
    combinations = np.zeros((count, 2, 2), dtype=vectors.dtype)
    if not count:
        return combinations
    rows = np.arange(count)
    length = lengths_of(vectors)
    kept = length / np.maximum(lengths, TINY)
    # Round-off must not choose between edges that are equally good, as both sides of a triangle
    # below its point are: a complex step has to find the directions that it differentiates.
    first = np.where(kept[:, 1].real > (1 + TIE) * kept[:, 0].real, 1, 0)
    second = 1 - first
    first_length = length[rows, first]
    has_first = first_length > SMALLEST_SINE * lengths[rows, first]
    scale = np.where(has_first, 1 / np.maximum(first_length, TINY), 0)
    combinations[rows, 0, first] = scale
    direction = vectors[rows, first] * scale[:, None]
    along = (vectors[rows, second] * direction).sum(axis=1)
    across = vectors[rows, second] - along[:, None] * direction
    across_length = lengths_of(across)
    has_second = has_first & (across_length > SMALLEST_SINE * lengths[rows, second])
    across_scale = np.where(has_second, 1 / np.maximum(across_length, TINY), 0)
    combinations[rows, 1, second] = across_scale
    combinations[rows, 1, first] = -across_scale * along * scale
    return combinations


@dataclass(frozen=True)
class SlidingGeometry(PairRows):
    """Where n pairs slide, between k points each.

    Attributes:
        normal: unit normal at the start (n, 3).
        gap_weights: weights (n, k) of the points in the vector r across the gap.
        direction_weights: weights (n, 2, k) of the points in the two directions t [1/m], so that t
            are unit vectors at the start.
    """

    normal: Array
    gap_weights: Array
    direction_weights: Array


@dataclass(frozen=True)
class BetweenBodies(PairRows):
    """Geometry of n pairs between bodies, which slide along two edges of the pair.

    Attributes:
        kind: of each pair (n,), the number of its stencil.
    """

    kind: ByteArray

    def repeated(self, times: int) -> BetweenBodies:
        """The same pairs, each `times` times in a row."""
        return BetweenBodies(np.repeat(self.kind, times))

    def at(self, x: Array, parameters: Array) -> SlidingGeometry:
        """Return normals and weights for the points x (n, 4, 3) [m] at the start of a step, with
        the parameters (u, v) (n, 2) of their closest points; both may be complex."""
        gap_weights = gap_weights_of(self.kind, parameters)
        edge_weights = EDGE_WEIGHTS[SIDES[self.kind]]
        gap = np.einsum("nk,nkc->nc", gap_weights, x)
        edges = np.einsum("nik,nkc->nic", edge_weights, x)
        normal = unit_vectors(gap)
        along_normal = np.einsum("nic,nc->ni", edges, normal)
        across = edges - along_normal[:, :, None] * normal[:, None]
        # With half of its part along the gap taken off an edge, the gradient of r·t by r, which is
        # t plus what t changes by r, is across the normal.
        gap_length = np.maximum(lengths_of(gap), TINY)
        half = along_normal / (2 * gap_length[:, None])
        corrected = edge_weights - half[:, :, None] * gap_weights[:, None]
        # Edges are neither unit vectors nor perpendicular to each other.
        combinations = orthonormal_combinations(across, lengths_of(edges))
        directions = np.einsum("nij,njk->nik", combinations, corrected)
        return SlidingGeometry(normal, gap_weights, directions)


@dataclass(frozen=True)
class WithObstacles:
    """Geometry of n pairs with an obstacle, which slide along two of its axes.

    r leads from the point of the obstacle that lies where the body's point is, fixed in the
    obstacle's frame: so a ball on a rigid body rolls.

    Attributes:
        pairs: the pairs.
        is_of_body: which of the four points of each pair are of its body (n, 4).
    """

    pairs: PairTable
    is_of_body: MaskArray

    def rows(self, which: Any) -> WithObstacles:
        """Some of the pairs, given by indices or by a mask (n,)."""
        return WithObstacles(self.pairs.geometry(which), self.is_of_body[which])

    def repeated(self, times: int) -> WithObstacles:
        """The same pairs, each `times` times in a row."""
        return self.rows(np.repeat(np.arange(len(self.pairs)), times))

    def at(self, x: Array, parameters: Array) -> SlidingGeometry:
        """Return normals and weights for the points x (n, 8, 3) at the start of a step, with the
        parameters (u, v) (n, 2) of their closest points; both may be complex.  The points are the
        four of each pair [m], and origin [m] and three axes [-] of the obstacle."""
        pair_points = x[:, :4]
        origin = x[:, 4]
        axes = x[:, 5:]
        weights = gap_weights_of(self.pairs.kind, parameters)
        # All weights of the body have one sign, which makes them a mean of its points.
        sign = np.where((weights.real * self.is_of_body).sum(axis=1) < 0, -1, 1)
        towards = weights * sign[:, None]
        of_body = towards * self.is_of_body
        touched = np.einsum("nk,nkc->nc", of_body, pair_points)
        normal = unit_vectors(self._towards_body(towards, pair_points, parameters))

        # Two directions across the normal, in the axes of the obstacle: the first is also across
        # the axis that is farthest from the normal.
        in_axes = np.einsum("nic,nc->ni", axes, normal)
        # Of axes that are equally far it is the first one, also in a complex step.
        nearness = np.abs(in_axes.real) + TIE * np.arange(3)
        farthest_axis = np.eye(3)[nearness.argmin(axis=1)]
        first = unit_vectors(np.cross(in_axes, farthest_axis))
        directions = np.zeros((len(x), 2, 4 + FRAME_SIZE), dtype=x.dtype)
        directions[:, 0, 5:] = first
        directions[:, 1, 5:] = np.cross(in_axes, first)
        position = np.einsum("nic,nc->ni", axes, touched - origin)
        from_frame = np.hstack([-np.ones((len(x), 1)), -position])
        return SlidingGeometry(normal, np.hstack([of_body, from_frame]), directions)

    def _towards_body(self, weights: Array, x: Array, parameters: Array) -> Array:
        """Return a vector (n, 3) from each pair's obstacle towards its body. The weights (n, 4) are
        those of the vector between closest points x (n, 4, 3) [m], for pairs that are not of
        boundaries."""
        found: Array = np.einsum("nk,nkc->nc", weights, x)
        shapes = self.pairs.shapes
        for stencil, rows in stencils_of(self.pairs.kind):
            if stencil.sides == Sides.POINT_BOUNDARY:
                _, gradient = stencil.derivatives(x[rows], parameters[rows], shapes[rows])
                found[rows] = gradient[:, 0]
        return found


# Sliding that changes by less than this part of itself from one iterate to the next goes on
# steadily, though its direction may have turned round before.
STEADY_CHANGE = 0.1

# Sliding over the creep h v_s, below which a direction w/|w| is not divided by zero.
SMALLEST_SLIDING = 1e-9


@dataclass(frozen=True)
class FrictionStep:
    """A step of length h as friction sees it.

    Attributes:
        x0, x1: points (m, 3) [m] at the start and at the end.
        creep: h v_s [m], sliding up to which friction grows.
        alpha: weight of the end in the configuration where normal forces act.
        geometric_share: share of the geometric stiffness in tangents.
    """

    x0: Array
    x1: Array
    creep: float
    alpha: float
    geometric_share: float = 1.0


@dataclass(frozen=True)
class Sliding(PairRows):
    """How n pairs slide in a step: w (n, 2) [m], and the vectors r (n, 3) [m] and directions t (n,
    2, 3) [-] in its middle and at its end."""

    w: Array
    r_mid: Array
    t_mid: Array
    r_end: Array
    t_end: Array


@dataclass(frozen=True)
class Grip:
    """The factor g of S = μ N g w.

    Attributes:
        ratio: |w|/(h v_s) (n,) [-].
        factor: g (n,) [1/m].
        slope: its derivative by |w| (n,) [1/m²].
    """

    ratio: Array
    factor: Array
    slope: Array


@dataclass
class FrictionPairs:
    """n pairs that may rub, between k points each.

    Attributes:
        pairs: the pairs whose normal force presses.
        law: of their normal force.
        side_weights: weights (n, 4) of the pairs' points in the force on the pressed side.
        geometry: how r and t follow from the points at the start.
        start: normals, and weights of r and t, at the start of this step.
        points: numbers (n, k) of the points of which r and t are combinations.
        point_weights: weights (n, 4, k) of these points in the four points of the pair.
        coefficient: μ (n,).
        block_rows: block row (n, k) that moves each of these points.
        block_index: of the blocks that they couple (n, k k); set once the pattern is known.
    """

    pairs: ActivePairs
    law: ContactLaw
    side_weights: Array
    geometry: BetweenBodies | WithObstacles
    start: SlidingGeometry
    points: Int32Array
    point_weights: Array
    coefficient: Array
    block_rows: Int64Array
    block_index: Int32Array = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int32))

    def __post_init__(self) -> None:
        self._last_sliding: Array | None = None
        self._is_steady: MaskArray = np.ones(len(self.points), dtype=bool)

    def __len__(self) -> int:
        return len(self.points)

    # ---- forces ----

    def loss(self, step: FrictionStep) -> float:
        """Return the energy [J] that friction dissipates in a step: the sum of S·w over the pairs
        of this rank, with the stress S = μ N g w (n, 2) [N] and the sliding w (n, 2) [m]."""
        w = self.sliding(step).w
        normal_force, _ = self.normal_forces(step)
        grip = grip_of(w, step.creep)
        return float(np.sum(self.coefficient * normal_force * grip.factor * (w * w).sum(axis=1)))

    def add_forces(self, step: FrictionStep, point_forces: Array) -> None:
        """Add the friction forces [N] of this rank's pairs in a step to those on points (m, 3).
        They follow from the stress S = μ N g w (n, 2) [N], with the sliding w (n, 2) [m]."""
        sliding = self.sliding(step)
        normal_force, _ = self.normal_forces(step)
        grip = grip_of(sliding.w, step.creep)
        stress = (self.coefficient * normal_force * grip.factor)[:, None] * sliding.w
        np.add.at(point_forces, self.points, self._forces(stress, sliding))

    def vectors_at(self, x: Array) -> tuple[Array, Array]:
        """Return the vectors r (n, 3) [m] and directions t (n, 2, 3) [-] at points x (m, 3) [m]."""
        at = x[self.points]
        r = np.einsum("nk,nkc->nc", self.start.gap_weights, at)
        t = np.einsum("nik,nkc->nic", self.start.direction_weights, at)
        return r, t

    def sliding(self, step: FrictionStep) -> Sliding:
        """Return how the pairs slide in a step: the change w of the measures m_i = r·t_i.  The
        change of a product is computed from its factors in the middle, without cancellation."""
        r_start, t_start = self.vectors_at(step.x0)
        r_end, t_end = self.vectors_at(step.x1)
        r_mid = (r_start + r_end) / 2
        t_mid = (t_start + t_end) / 2
        by_directions = np.einsum("nc,nic->ni", r_mid, t_end - t_start)
        by_gaps = np.einsum("nic,nc->ni", t_mid, r_end - r_start)
        return Sliding(by_directions + by_gaps, r_mid, t_mid, r_end, t_end)

    def rows(self, which: Any) -> FrictionPairs:
        """Return some of the pairs, given by indices or by a mask (n,), without their blocks."""
        return FrictionPairs(
            pairs=self.pairs.rows(which),
            law=self.law,
            side_weights=self.side_weights[which],
            geometry=self.geometry.rows(which),
            start=self.start.rows(which),
            points=self.points[which],
            point_weights=self.point_weights[which],
            coefficient=self.coefficient[which],
            block_rows=self.block_rows[which],
        )

    def normal_forces(self, step: FrictionStep) -> tuple[Array, Array]:
        """Return N (n,) [N], zero for pairs that do not press, and the forces (n, 4, 3) [N] of the
        contact potential on the points of the pairs."""
        normal_force, _, forces = self._pressing(step)
        return normal_force, forces

    def _pressing(self, step: FrictionStep, tangents: bool = False) -> tuple[Array, Array, Array]:
        """Return the normal forces with which the two sides of pairs press on each other, their
        derivatives if `tangents` are wanted, and the forces from which they follow.

        N (n,) [N] is the component along the unit normal at the start of the step; zero for pairs
        that do not press.  Its derivative (n, k, 3) [N/m] is that by the k points of each pair at
        the end, an empty array without `tangents`.  The forces (n, 4, 3) [N] on the points are
        those of the contact potential, without friction.
        """
        response = evaluate(
            self.pairs,
            step.x0,
            step.x1,
            self.law,
            step.alpha,
            by_pair=True,
            tangents_by_pair=tangents,
        )
        forces = np.asarray(response.forces).reshape(-1, 4, 3)
        pressure = -np.einsum("nk,nc,nkc->n", self.side_weights, self.start.normal, forces)
        presses = (response.state == PairState.TOUCHES) & (pressure > 0)
        derivative = np.zeros((0, 4, 3))
        if tangents:
            derivative = -np.einsum(
                "nk,nc,nkcld,n->nld",
                self.side_weights,
                self.start.normal,
                np.asarray(response.tangents).reshape(-1, 4, 3, 4, 3),
                presses.astype(float),
                optimize=True,
            )
            derivative = np.einsum("npd,npk->nkd", derivative, self.point_weights)
        return np.where(presses, pressure, 0.0), derivative, forces

    def _forces(self, stress: Array, sliding: Sliding) -> Array:
        """Return the friction forces (n, k, 3) [N] on the k points of each pair: the stress S (n,
        2) [N] times the gradient of sliding in the middle of the step."""
        on_gaps = np.einsum("ni,nic->nc", stress, sliding.t_mid)
        on_directions = np.einsum("ni,nik->nk", stress, self.start.direction_weights)
        by_gaps = self.start.gap_weights[:, :, None] * on_gaps[:, None]
        return by_gaps + on_directions[:, :, None] * sliding.r_mid[:, None]

    # ---- tangents ----

    def add_tangents(self, step: FrictionStep, is_moved: Array, blocks: Array) -> None:
        """Add the derivative [N/m] of the forces of `add_forces` with respect to the end of the
        step to the blocks (b, 9); `is_moved` is 1 for points (m,) with unknowns, else 0.

        The sliding is compared with that of the previous call, to find pairs whose sliding turned
        round: call it once for each Newton iterate.  Forces need not have been added before.
        """
        sliding = self.sliding(step)
        self._update_steadiness(sliding.w)
        normal_force, of_normal_force, _ = self._pressing(step, tangents=True)
        # Most pairs within reach do not press: their blocks are zero, and cost as much as others.
        rows = np.flatnonzero(normal_force)
        if len(rows):
            pressing = self.rows(rows)
            pressing.block_index = self.block_index[rows]
            pressing._is_steady = self._is_steady[rows]
            pressing._add_blocks(
                step,
                sliding.rows(rows),
                normal_force=normal_force[rows],
                of_normal_force=of_normal_force[rows],
                is_moved=is_moved,
                blocks=blocks,
            )

    def _add_blocks(
        self,
        step: FrictionStep,
        sliding: Sliding,
        *,
        normal_force: Array,
        of_normal_force: Array,
        is_moved: Array,
        blocks: Array,
    ) -> None:
        """Do what `add_tangents` does, for pairs that press.  `normal_force`: N (n,) [N];
        `of_normal_force`: its derivative (n, k, 3) [N/m] with respect to the k points of each pair
        at the end of the step."""
        grip = grip_of(sliding.w, step.creep)
        pressing = self.coefficient * normal_force
        K = self._material_part(sliding, grip, pressing, step.creep)

        # Geometric part: S·D²m, with D²m the constant second derivative of the measures m_i = r·t_i
        # by the points, which couples the weights of r and of t.
        stress = (pressing * grip.factor)[:, None] * sliding.w
        of_directions = np.einsum("ni,nik->nk", stress, self.start.direction_weights)
        one = self.start.gap_weights[:, :, None] * of_directions[:, None]
        other = of_directions[:, :, None] * self.start.gap_weights[:, None]
        # The middle of the step, in which friction acts, has half of the end.
        share = step.geometric_share / 2
        K += share * (one + other)[..., None, None] * np.eye(3)

        # The normal force changes, too.
        per_normal_force = (self.coefficient * grip.factor)[:, None] * sliding.w
        forces = self._forces(per_normal_force, sliding)
        K += np.einsum("nka,nlb->nklab", forces, of_normal_force)

        moved = is_moved[self.points]
        K *= (moved[:, :, None] * moved[:, None])[..., None, None]
        np.add.at(blocks, self.block_index, K.reshape(*self.block_index.shape, 9))

    def _material_part(self, sliding: Sliding, grip: Grip, pressing: Array, creep: float) -> Array:
        """Return the tangent (n, k, k, 3, 3) [N/m] of the friction force between the k points of
        each pair for constant directions and normal forces: Dm_midᵀ (∂S/∂w) Dm_end, with the stress
        S = μ N g w and the gradient Dm of the measures.  `pressing`: μ N (n,) [N]."""
        w = sliding.w
        # Beyond the creep, friction is constant and its slope negative: a full Newton step
        # overshoots where the sliding has turned round.  There g alone leads near the solution,
        # slowly and safely.
        is_reliable = self._is_steady | (grip.ratio < 1)
        size = np.maximum(grip.ratio * creep, SMALLEST_SLIDING * creep)
        bend = np.where(is_reliable, grip.slope / size, 0.0)
        square = w[:, :, None] * w[:, None]
        derivative = grip.factor[:, None, None] * np.eye(2) + bend[:, None, None] * square
        derivative = pressing[:, None, None] * derivative
        middle = self._gradient(sliding.r_mid, sliding.t_mid)
        end = self._gradient(sliding.r_end, sliding.t_end)
        return np.einsum("nika,nij,njlb->nklab", middle, derivative, end, optimize=True)

    def _update_steadiness(self, w: Array) -> None:
        """Note in `_is_steady` (n,) which pairs have not turned round in the iterates of the step;
        one that did counts as steady again once its sliding w (n, 2) [m] changes little."""
        last = self._last_sliding
        if last is not None:
            self._is_steady &= (last * w).sum(axis=1) >= 0
            change = np.linalg.norm(w - last, axis=1)
            self._is_steady |= change < STEADY_CHANGE * np.linalg.norm(w, axis=1)
        self._last_sliding = w

    def _gradient(self, r: Array, t: Array) -> Array:
        """Return the gradient Dm (n, 2, k, 3) of both measures r·t_i by the k points of each pair,
        where the vectors are r and t."""
        by_gaps = self.start.gap_weights[:, None, :, None] * t[:, :, None]
        return by_gaps + self.start.direction_weights[..., None] * r[:, None, None]


def parameters_at_start(pairs: ActivePairs) -> Array:
    """Return (u, v) (n, 2) of the closest points of pairs at the start of their step."""
    assert pairs.start is not None, "a step has the starts of its pairs"
    return pairs.start[:, :2]


def grip_of(w: Array, creep: float) -> Grip:
    """Return the factor g of the friction stress S = μ N g w for the sliding w (n, 2) [m], and its
    derivative by |w|; finite also for w = 0.  `creep`: h v_s [m], up to which friction grows.

    g |w| = φ(|w|/creep) with φ(y) = 2y - y² for y < 1, else 1.
    """
    ratio = np.linalg.norm(w, axis=1) / creep
    beyond = np.maximum(ratio, 1)
    factor = np.where(ratio < 1, 2 - ratio, 1 / beyond) / creep
    slope = np.where(ratio < 1, -1.0, -1 / beyond**2) / creep**2
    return Grip(ratio, factor, slope)
