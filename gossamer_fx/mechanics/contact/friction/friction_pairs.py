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
the points at the start of a step (`sliding.SlidingGeometry`).

Limits: the tangent plane is that of the start of the step.  Where two edges meet in one plane, side
by side, only the direction along them has friction.

Derivatives with respect to the start of a step, for gradients of a run.  Directions, normals and
points of contact of a pair are those of the start.  The force of friction is therefore not the same
in the reversed step, which gives the derivative of all other forces (`sensitivity.backward`).  The
backward pass needs products with one vector μ only; the product of μ and the force of a pair is

    W = c N g(|w|) w·P,    P_i = Dm_i(q_mid) μ,                                                 (4)

c the coefficient.

    1. ∂W/∂x0 at constant weights, from w = m(x1) - m(x0) and from the middle of the step.
    2. ∂W/∂N ∂N/∂x0: the normal force is that of the contact potential, whose derivative by the
       start is the tangent of its reversed step, and that of the origins (`contact_step`).
    3. ∂W/∂(weights, normal): they are functions of the start, differentiated by complex steps.

Friction is piecewise smooth.  Where a pair changes between sticking and sliding, or presses no
more, the derivative is that of the side on which the step is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gossamer_fx.mechanics.contact.assembly import PairBlocks
from gossamer_fx.mechanics.contact.contact_step import PairGroup, PairState
from gossamer_fx.mechanics.contact.contract import (
    Array,
    ByteArray,
    Int32Array,
    MaskArray,
)
from gossamer_fx.mechanics.contact.friction.sliding import (
    BetweenBodies,
    SlidingGeometry,
    WithObstacles,
)
from gossamer_fx.mechanics.contact.pairs import (
    PairRows,
    parameter_derivatives_of,
)

# Size of complex steps, whose square is below the round-off of any number.
COMPLEX_STEP = 1e-30

# Sliding that changes by less than this part of itself from one iterate to the next goes on
# steadily, though its direction may have turned round before.
STEADY_CHANGE = 0.1

# Sliding over the creep h v_s, below which a direction w/|w| is not divided by zero.
SMALLEST_SLIDING = 1e-9


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


@dataclass(frozen=True, eq=False)
class Steadiness:
    """How n pairs slid in the last iterate of a step.

    Attributes:
        w: sliding (n, 2) [m].
        is_steady: which of them (n,) have not turned round in the iterates of the step, or slide
            steadily again.
    """

    w: Array
    is_steady: MaskArray

    def after(self, w: Array) -> Steadiness:
        """Return that of the next iterate with the sliding w (n, 2) [m].  A pair that turned round
        counts as steady again once its sliding changes little."""
        is_steady = self.is_steady & ((self.w * w).sum(axis=1) >= 0)
        change = np.linalg.norm(w - self.w, axis=1)
        is_steady |= change < STEADY_CHANGE * np.linalg.norm(w, axis=1)
        return Steadiness(w, is_steady)


@dataclass(frozen=True, eq=False)
class FrictionPairs(PairGroup):
    """n pairs that may rub in a step, between k points each.  Their `step` gives the normal force
    that presses.

    Attributes:
        side_weights: weights (n, 4) of the pairs' points in the force on the pressed side.
        geometry: how r and t follow from the points at the start.
        start: normals, and weights of r and t, at the start of this step.
        points: numbers (n, k) of the points of which r and t are combinations.
        point_weights: weights (n, 4, k) of these points in the four points of the pair.
        is_moved: 1 for those of these points (n, k) that have unknowns, else 0.
        coefficient: μ (n,).
        has_shared_coefficient: whether it is that of bodies with each other (n,).
        creep: h v_s [m], sliding up to which friction grows.
    """

    side_weights: Array
    geometry: BetweenBodies | WithObstacles
    start: SlidingGeometry
    points: Int32Array
    point_weights: Array
    is_moved: Array
    coefficient: Array
    has_shared_coefficient: MaskArray
    creep: float

    # ---- forces ----

    def loss(self, x1: Array) -> float:
        """Return the energy [J] that friction dissipates in the step to x1 (m, 3) [m]: the sum of
        S·w over the pairs of this rank, with the stress S = μ N g w (n, 2) [N] and the sliding w
        (n, 2) [m]."""
        w = self.sliding(x1).w
        normal_force, _ = self.normal_forces(x1)
        grip = grip_of(w, self.creep)
        return float(np.sum(self.coefficient * normal_force * grip.factor * (w * w).sum(axis=1)))

    def add_forces(self, x1: Array, point_forces: Array) -> ByteArray:
        """Add the friction forces [N] of this rank's pairs to those on points (m, 3). They follow
        from the stress S = μ N g w (n, 2) [N], with the sliding w (n, 2) [m]."""
        sliding = self.sliding(x1)
        state, forces = self.step.forces(x1)
        normal_force = np.maximum(self._pressures(state, forces), 0.0)
        grip = grip_of(sliding.w, self.creep)
        stress = (self.coefficient * normal_force * grip.factor)[:, None] * sliding.w
        np.add.at(point_forces, self.points, self._forces(stress, sliding))
        return state

    def reversed(self, x1: Array) -> None:
        """Friction differs in the reversed step: `start_derivative` has what it gives there."""

    def vectors_at(self, x: Array) -> tuple[Array, Array]:
        """Return the vectors r (n, 3) [m] and directions t (n, 2, 3) [-] at points x (m, 3) [m]."""
        at = x[self.points]
        r = np.einsum("nk,nkc->nc", self.start.gap_weights, at)
        t = np.einsum("nik,nkc->nic", self.start.direction_weights, at)
        return r, t

    def sliding(self, x1: Array) -> Sliding:
        """Return how the pairs slide in the step to x1: the change w of the measures m_i = r·t_i.
        The change of a product is computed from its factors in the middle, without cancellation."""
        r_start, t_start = self.vectors_at(self.step.x0)
        r_end, t_end = self.vectors_at(x1)
        r_mid = (r_start + r_end) / 2
        t_mid = (t_start + t_end) / 2
        by_directions = np.einsum("nc,nic->ni", r_mid, t_end - t_start)
        by_gaps = np.einsum("nic,nc->ni", t_mid, r_end - r_start)
        return Sliding(by_directions + by_gaps, r_mid, t_mid, r_end, t_end)

    def rows(self, which: Any) -> FrictionPairs:
        """Return some of the pairs, given by indices or by a mask (n,)."""
        return FrictionPairs(
            step=self.step.rows(which),
            block_rows=self.block_rows[which],
            side_weights=self.side_weights[which],
            geometry=self.geometry.rows(which),
            start=self.start.rows(which),
            points=self.points[which],
            point_weights=self.point_weights[which],
            is_moved=self.is_moved[which],
            coefficient=self.coefficient[which],
            has_shared_coefficient=self.has_shared_coefficient[which],
            creep=self.creep,
        )

    def normal_forces(self, x1: Array) -> tuple[Array, Array]:
        """Return N (n,) [N], zero for pairs that do not press, and the forces (n, 4, 3) [N] of the
        contact potential on the points of the pairs.  N is the component along the unit normal at
        the start of the step."""
        state, forces = self.step.forces(x1)
        return np.maximum(self._pressures(state, forces), 0.0), forces

    def _pressures(self, state: ByteArray, forces: Array) -> Array:
        """Return the component (n,) [N] along the normal of forces (n, 4, 3) [N] on the pressed
        sides; zero for pairs that do not touch."""
        pressure = -np.einsum("nk,nc,nkc->n", self.side_weights, self.start.normal, forces)
        return np.where(state == PairState.TOUCHES, pressure, 0.0)

    def _by_end(self, tangents: Array) -> Array:
        """Return the derivative (n, k, 3) [N/m] of the normal forces of pairs that press, by the k
        points of each at the end.  `tangents`: of the contact potential (n, 4, 3, 4, 3)
        [N/m]."""
        by_pair_points = -np.einsum(
            "nk,nc,nkcld->nld", self.side_weights, self.start.normal, tangents, optimize=True
        )
        return np.einsum("npd,npk->nkd", by_pair_points, self.point_weights)

    def _forces(self, stress: Array, sliding: Sliding) -> Array:
        """Return the friction forces (n, k, 3) [N] on the k points of each pair: the stress S (n,
        2) [N] times the gradient of sliding in the middle of the step."""
        on_gaps = np.einsum("ni,nic->nc", stress, sliding.t_mid)
        on_directions = np.einsum("ni,nik->nk", stress, self.start.direction_weights)
        by_gaps = self.start.gap_weights[:, :, None] * on_gaps[:, None]
        return by_gaps + on_directions[:, :, None] * sliding.r_mid[:, None]

    # ---- derivatives ----

    def works(self, x1: Array, μ: Array) -> Array:
        return self.coefficient * self._works_by_coefficient(x1, μ)

    def work_by_coefficient(self, x1: Array, μ: Array) -> float:
        # Pairs with obstacles that have their own coefficient do not count.
        return float(self._works_by_coefficient(x1, μ)[self.has_shared_coefficient].sum())

    def _works_by_coefficient(self, x1: Array, μ: Array) -> Array:
        """Return the derivatives (n,) of `works` by the coefficients: W of (4) over c."""
        normal_force, forces = self.normal_forces(x1)
        return _Product(self, x1, μ, normal_force, forces).by_coefficient()

    def add_start_product(self, x1: Array, μ: Array, found: Array) -> None:
        normal_force, forces = self.normal_forces(x1)
        presses = normal_force > 0
        # Most active pairs are near without a force.
        if not presses.any():
            return
        part = self.rows(presses)
        product = _Product(part, x1, μ, normal_force[presses], forces[presses])
        np.add.at(found, part.points, product.at_constant_weights())
        np.add.at(found, part.step.pairs.points, product.through_normal_force())
        np.add.at(found, part.points, product.through_geometry())

    # ---- tangents ----

    def add_tangents(
        self, x1: Array, state: ByteArray, geometric_share: float, blocks: PairBlocks, last: Any
    ) -> Steadiness:
        """Add the derivative [N/m] of the forces of `add_forces` by x1 to blocks.  The sliding is
        compared with that of the last iterate, to find pairs whose sliding turned round."""
        sliding = self.sliding(x1)
        steadiness = Steadiness(sliding.w, np.ones(len(sliding.w), dtype=bool))
        if last is not None:
            steadiness = last.after(sliding.w)
        _, forces, tangents = self.step.forces_and_tangents(x1)
        normal_force = np.maximum(self._pressures(state, forces), 0.0)
        # Most pairs within reach do not press: their blocks are zero, and cost as much as others.
        rows = np.flatnonzero(normal_force)
        if len(rows):
            pressing = self.rows(rows)
            tangent = pressing._tangents(
                sliding.rows(rows),
                is_steady=steadiness.is_steady[rows],
                geometric_share=geometric_share,
                normal_force=normal_force[rows],
                of_normal_force=pressing._by_end(tangents[rows]),
            )
            blocks.rows(rows).add(tangent)
        return steadiness

    def _tangents(
        self,
        sliding: Sliding,
        *,
        is_steady: MaskArray,
        geometric_share: float,
        normal_force: Array,
        of_normal_force: Array,
    ) -> Array:
        """Return the derivatives (n, k, k, 3, 3) [N/m] of the friction forces of pairs that press
        between the k points of each.  `normal_force`: N (n,) [N]; `of_normal_force`: its derivative
        (n, k, 3) [N/m] with respect to the k points of each pair at the end of the step."""
        grip = grip_of(sliding.w, self.creep)
        pressing = self.coefficient * normal_force
        K = self._material_part(sliding, grip, pressing, is_steady)

        # Geometric part: S·D²m, with D²m the constant second derivative of the measures m_i = r·t_i
        # by the points, which couples the weights of r and of t.
        stress = (pressing * grip.factor)[:, None] * sliding.w
        of_directions = np.einsum("ni,nik->nk", stress, self.start.direction_weights)
        one = self.start.gap_weights[:, :, None] * of_directions[:, None]
        other = of_directions[:, :, None] * self.start.gap_weights[:, None]
        # The middle of the step, in which friction acts, has half of the end.
        share = geometric_share / 2
        K += share * (one + other)[..., None, None] * np.eye(3)

        # The normal force changes, too.
        per_normal_force = (self.coefficient * grip.factor)[:, None] * sliding.w
        forces = self._forces(per_normal_force, sliding)
        K += np.einsum("nka,nlb->nklab", forces, of_normal_force)

        moved = self.is_moved
        K *= (moved[:, :, None] * moved[:, None])[..., None, None]
        return K

    def _material_part(
        self, sliding: Sliding, grip: Grip, pressing: Array, is_steady: MaskArray
    ) -> Array:
        """Return the tangent (n, k, k, 3, 3) [N/m] of the friction force between the k points of
        each pair for constant directions and normal forces: Dm_midᵀ (∂S/∂w) Dm_end, with the stress
        S = μ N g w and the gradient Dm of the measures.  `pressing`: μ N (n,) [N]."""
        w = sliding.w
        # Beyond the creep, friction is constant and its slope negative: a full Newton step
        # overshoots where the sliding has turned round.  There g alone leads near the solution,
        # slowly and safely.
        is_reliable = is_steady | (grip.ratio < 1)
        size = np.maximum(grip.ratio * self.creep, SMALLEST_SLIDING * self.creep)
        bend = np.where(is_reliable, grip.slope / size, 0.0)
        square = w[:, :, None] * w[:, None]
        derivative = grip.factor[:, None, None] * np.eye(2) + bend[:, None, None] * square
        derivative = pressing[:, None, None] * derivative
        middle = self._gradient(sliding.r_mid, sliding.t_mid)
        end = self._gradient(sliding.r_end, sliding.t_end)
        return np.einsum("nika,nij,njlb->nklab", middle, derivative, end, optimize=True)

    def _gradient(self, r: Array, t: Array) -> Array:
        """Return the gradient Dm (n, 2, k, 3) of both measures r·t_i by the k points of each pair,
        where the vectors are r and t."""
        by_gaps = self.start.gap_weights[:, None, :, None] * t[:, :, None]
        return by_gaps + self.start.direction_weights[..., None] * r[:, None, None]


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


class _Product:
    """W of (4) for n pairs with k points each, and its derivatives by the start of the step.

    r [m] and t_i [-] are sums of the points of a pair times weights, which are fixed at the start
    of the step; r(μ) and t(μ) are the same sums of μ.  W has the unit [U] of the objective of the
    gradient, and μ [U/N].  The private attributes are

        _μ                μ (n, k, 3) [U/N] at the points of each pair
        _N, _forces       normal forces (n,) [N]; forces (n, 4, 3) [N] of the contact potential
        _r_of_μ, _t_of_μ  r(μ) (n, 3) and t(μ) (n, 2, 3)
        _P, _power        P (n, 2) [U/N] of (4); w·P (n,) [m U/N]
        _grip             g and its derivative
        _by_P, _by_w      ∂W/∂P (n, 2) [N] and ∂W/∂w (n, 2) [U/m]
        _of_parameters    d(u, v)/dx0 (n, 2, 4, 3) [1/m] of the closest points

    Args:
        normal_force: N (n,) [N].
        forces: of the contact potential on the four points of the pairs (n, 4, 3) [N].
    """

    def __init__(
        self, group: FrictionPairs, x1: Array, μ: Array, normal_force: Array, forces: Array
    ) -> None:
        self._group = group
        self._x0 = group.step.x0
        self._x1 = x1
        self._N = normal_force
        self._forces = forces
        self._sliding = group.sliding(x1)
        self._grip = grip_of(self._sliding.w, group.creep)
        self._μ = μ[group.points]
        pairs = group.step.pairs
        self._of_parameters = parameter_derivatives_of(
            pairs, self._x0[pairs.points], pairs.parameters
        )
        start = group.start
        self._r_of_μ = np.einsum("nk,nkc->nc", start.gap_weights, self._μ)
        self._t_of_μ = np.einsum("nik,nkc->nic", start.direction_weights, self._μ)
        sliding = self._sliding
        self._P = np.einsum("nc,nic->ni", self._r_of_μ, sliding.t_mid)
        self._P += np.einsum("nc,nic->ni", sliding.r_mid, self._t_of_μ)
        self._power = (sliding.w * self._P).sum(axis=1)
        pressing = group.coefficient * normal_force
        self._by_P = (pressing * self._grip.factor)[:, None] * sliding.w
        size = np.maximum(self._grip.ratio * group.creep, SMALLEST_SLIDING * group.creep)
        bend = pressing * self._grip.slope / size * self._power
        self._by_w = (pressing * self._grip.factor)[:, None] * self._P + bend[:, None] * sliding.w

    def by_coefficient(self) -> Array:
        """∂W/∂c = N g w·P (n,)."""
        return self._N * self._grip.factor * self._power

    def at_constant_weights(self) -> Array:
        """Return the part of ∂W/∂x0 (n, k, 3) by the points in w and in the middle of the step. The
        weights of r and t, the normals and the normal forces are held constant."""
        group = self._group
        r_start, t_start = group.vectors_at(self._x0)
        # ∂w_i/∂x0 = -(weights of r ⊗ t_i + weights of t_i ⊗ r), both at the start.
        found = -self._bilinear(self._by_w, r_start, t_start)
        # The middle has half of the start.
        found += self._bilinear(self._by_P, self._r_of_μ, self._t_of_μ) / 2
        return found

    def _bilinear(self, factors: Array, r: Array, t: Array) -> Array:
        """Σ_i factor_i (weights of r ⊗ t_i + weights of t_i ⊗ r) (n, k, 3), factors (n, 2)."""
        start = self._group.start
        on_gaps = np.einsum("ni,nic->nc", factors, t)
        on_directions = np.einsum("ni,nik->nk", factors, start.direction_weights)
        found: Array = start.gap_weights[:, :, None] * on_gaps[:, None]
        found += on_directions[:, :, None] * r[:, None]
        return found

    def through_normal_force(self) -> Array:
        """∂W/∂N ∂N/∂x0 (n, 4, 3) by the four points of each pair, at constant normal."""
        group = self._group
        _, _, by_start = group.step.reversed(self._x1).forces_and_tangents(self._x0)
        weight = group.coefficient * self._grip.factor * self._power
        # N = -Σ side_k n·F_k, so this is ∂W/∂F (n, 4, 3).
        by_force = -weight[:, None, None] * group.side_weights[:, :, None]
        by_force = by_force * group.start.normal[:, None]
        found: Array = np.einsum("nkc,nkcld->nld", by_force, by_start)
        by_origin = group.step.forces_by_origin(self._x1)
        by_parameters = np.einsum("nkc,nikc->ni", by_force, by_origin)
        found += np.einsum("ni,nikc->nkc", by_parameters, self._of_parameters)
        return found

    def through_geometry(self) -> Array:
        """Return the part (n, k, 3) [U/m] of ∂W/∂x0 through the weights of r and t and through the
        normal, which are functions of the points x0 at the start of the step.  W is differentiated
        by weights and normal, then these by x0."""
        group = self._group
        sliding = self._sliding
        x0 = self._x0[group.points]
        x1 = self._x1[group.points]
        x_mid = (x0 + x1) / 2
        displacement = x1 - x0
        r_start, t_start = group.vectors_at(self._x0)
        change_of_r = sliding.r_end - r_start
        change_of_t = sliding.t_end - t_start
        # w_i = r_mid·Δt_i + t_mid_i·Δr and P_i = r(μ)·t_mid_i + r_mid·t_i(μ), of which r and t are
        # linear in their weights.
        by_gap_weights = np.einsum("ni,nkc,nic->nk", self._by_w, x_mid, change_of_t)
        by_gap_weights += np.einsum("ni,nkc,nic->nk", self._by_w, displacement, sliding.t_mid)
        by_gap_weights += np.einsum("ni,nkc,nic->nk", self._by_P, self._μ, sliding.t_mid)
        by_gap_weights += np.einsum("ni,nkc,nic->nk", self._by_P, x_mid, self._t_of_μ)
        by_directions = np.einsum("ni,nkc,nc->nik", self._by_w, displacement, sliding.r_mid)
        by_directions += np.einsum("ni,nkc,nc->nik", self._by_w, x_mid, change_of_r)
        by_directions += np.einsum("ni,nkc,nc->nik", self._by_P, x_mid, self._r_of_μ)
        by_directions += np.einsum("ni,nkc,nc->nik", self._by_P, self._μ, sliding.r_mid)
        weight = group.coefficient * self._grip.factor * self._power
        by_normal = -weight[:, None] * np.einsum("nk,nkc->nc", group.side_weights, self._forces)
        return self._through_complex_steps(by_gap_weights, by_directions, by_normal)

    def _through_complex_steps(
        self, by_gap_weights: Array, by_directions: Array, by_normal: Array
    ) -> Array:
        """Return the derivative (n, k, 3) of W by the points at the start, from those by the
        weights of r (n, k), the weights of t (n, 2, k) and the normals (n, 3)."""
        group = self._group
        x0 = self._x0[group.points]
        count, width, _ = x0.shape
        unknowns = 3 * width
        parameters = group.step.pairs.parameters
        of_parameters = np.zeros((count, 2, unknowns))
        of_parameters[:, :, :12] = self._of_parameters.reshape(count, 2, 12)
        # One row for each pair and coordinate: the k-th row of a pair has its k-th coordinate
        # changed.
        steps = 1j * COMPLEX_STEP * np.eye(unknowns).reshape(unknowns, width, 3)
        points = (x0[:, None] + steps).reshape(-1, width, 3)
        moved = parameters[:, None] + 1j * COMPLEX_STEP * of_parameters.transpose(0, 2, 1)
        geometry = group.geometry.repeated(unknowns).at(points, moved.reshape(-1, 2))
        by_weights = geometry.gap_weights.imag.reshape(count, unknowns, width)
        by_t = geometry.direction_weights.imag.reshape(count, unknowns, 2, width)
        by_n = geometry.normal.imag.reshape(count, unknowns, 3)
        found = np.einsum("nk,njk->nj", by_gap_weights, by_weights)
        found += np.einsum("nik,njik->nj", by_directions, by_t)
        found += np.einsum("nc,njc->nj", by_normal, by_n)
        return found.reshape(count, width, 3) / COMPLEX_STEP
