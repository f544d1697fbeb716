"""The derivative of friction with respect to the start of a step, for gradients of a run.

Problem.  Directions, normals and points of contact of a pair are those of the start of a step.  The
force of friction is therefore not the same in the reversed step, which gives the derivative of all
other forces (`sensitivity.backward`).

Idea.  The backward pass needs products with one vector μ only.  With the symbols of
`friction_pairs` the product of μ and the force of a pair is

    W = c N g(|w|) w·P,    P_i = Dm_i(q_mid) μ,                                                 (1)

c the coefficient.  Its derivatives by the weights of r and t, by the normal and by N are formulas.

Algorithm.

    1. ∂W/∂x0 at constant weights, from w = m(x1) - m(x0) and from the middle of the step.
    2. ∂W/∂N ∂N/∂x0: the normal force is that of the contact potential, whose derivative by the
       start is the tangent of its reversed step, and `contact.contact_gradient`.
    3. ∂W/∂(weights, normal): they are functions of the start, differentiated by complex steps.

Limits: friction is piecewise smooth.  Where a pair changes between sticking and sliding, or presses
no more, the derivative is that of the side on which the step is.
"""

from __future__ import annotations

import numpy as np

from gossamer_fx.mechanics.contact.contact_step import evaluate, forces_by_origin, reversed_pairs
from gossamer_fx.mechanics.contact.contract import Array
from gossamer_fx.mechanics.contact.friction.friction_pairs import (
    SMALLEST_SLIDING,
    FrictionPairs,
    FrictionStep,
    grip_of,
    parameters_at_start,
)
from gossamer_fx.mechanics.contact.pairs import parameter_derivatives_of

# Size of complex steps, whose square is below the round-off of any number.
COMPLEX_STEP = 1e-30


def add_product_with_start_derivative(
    group: FrictionPairs, step: FrictionStep, μ: Array, found: Array
) -> None:
    """Add (∂f/∂x0)ᵀ μ of the friction forces f of this rank's pairs to `found` (m, 3).  μ (m, 3)
    are adjoint displacements of the points, x0 the points at the start of the step."""
    normal_force, forces = group.normal_forces(step)
    presses = normal_force > 0
    # Most active pairs are near without a force.
    if not presses.any():
        return
    part = group.rows(presses)
    product = _Product(part, step, μ, normal_force[presses], forces[presses])
    np.add.at(found, part.points, product.at_constant_weights())
    np.add.at(found, part.pairs.points, product.through_normal_force())
    np.add.at(found, part.points, product.through_geometry())


def work_by_coefficient(group: FrictionPairs, step: FrictionStep, μ: Array) -> Array:
    """Return ∂W/∂c (n,) of each pair: the product of μ (m, 3) and its friction force (1), over the
    coefficient c."""
    normal_force, forces = group.normal_forces(step)
    return _Product(group, step, μ, normal_force, forces).by_coefficient()


class _Product:
    """W of (1) for n pairs with k points each, and its derivatives by the start of the step.

    r [m] and t_i [-] are sums of the points of a pair times weights, which are fixed at the start
    of the step; r(μ) and t(μ) are the same sums of μ.  W has the unit [U] of the objective of the
    gradient, and μ [U/N].  The private attributes are

        _μ                μ (n, k, 3) [U/N] at the points of each pair
        _N, _forces       normal forces (n,) [N]; forces (n, 4, 3) [N] of the contact potential
        _r_of_μ, _t_of_μ  r(μ) (n, 3) and t(μ) (n, 2, 3)
        _P, _power        P (n, 2) [U/N] of (1); w·P (n,) [m U/N]
        _grip             g and its derivative
        _by_P, _by_w      ∂W/∂P (n, 2) [N] and ∂W/∂w (n, 2) [U/m]
        _of_parameters    d(u, v)/dx0 (n, 2, 4, 3) [1/m] of the closest points

    Args:
        normal_force: N (n,) [N].
        forces: of the contact potential on the four points of the pairs (n, 4, 3) [N].
    """

    def __init__(
        self, group: FrictionPairs, step: FrictionStep, μ: Array, normal_force: Array, forces: Array
    ) -> None:
        self._group = group
        self._step = step
        self._N = normal_force
        self._forces = forces
        self._sliding = group.sliding(step)
        self._grip = grip_of(self._sliding.w, step.creep)
        self._μ = μ[group.points]
        self._of_parameters = parameter_derivatives_of(
            group.pairs, step.x0[group.pairs.points], parameters_at_start(group.pairs)
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
        size = np.maximum(self._grip.ratio * step.creep, SMALLEST_SLIDING * step.creep)
        bend = pressing * self._grip.slope / size * self._power
        self._by_w = (pressing * self._grip.factor)[:, None] * self._P + bend[:, None] * sliding.w

    def by_coefficient(self) -> Array:
        """∂W/∂c = N g w·P (n,)."""
        return self._N * self._grip.factor * self._power

    def at_constant_weights(self) -> Array:
        """Return the part of ∂W/∂x0 (n, k, 3) by the points in w and in the middle of the step. The
        weights of r and t, the normals and the normal forces are held constant."""
        group = self._group
        r_start, t_start = group.vectors_at(self._step.x0)
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
        pairs = reversed_pairs(group.pairs, self._step.x1)
        tangents = evaluate(
            pairs,
            self._step.x1,
            self._step.x0,
            group.law,
            self._step.alpha,
            tangents_by_pair=True,
            push_back=0.0,
        ).tangents
        by_start = np.asarray(tangents).reshape(-1, 4, 3, 4, 3)
        weight = group.coefficient * self._grip.factor * self._power
        # N = -Σ side_k n·F_k, so this is ∂W/∂F (n, 4, 3).
        by_force = -weight[:, None, None] * group.side_weights[:, :, None]
        by_force = by_force * group.start.normal[:, None]
        found: Array = np.einsum("nkc,nkcld->nld", by_force, by_start)
        step = self._step
        by_origin = forces_by_origin(group.pairs, step.x0, step.x1, group.law, step.alpha)
        by_parameters = np.einsum("nkc,nikc->ni", by_force, by_origin)
        found += np.einsum("ni,nikc->nkc", by_parameters, self._of_parameters)
        return found

    def through_geometry(self) -> Array:
        """Return the part (n, k, 3) [U/m] of ∂W/∂x0 through the weights of r and t and through the
        normal, which are functions of the points x0 at the start of the step.  W is differentiated
        by weights and normal, then these by x0."""
        group = self._group
        step = self._step
        sliding = self._sliding
        x0 = step.x0[group.points]
        x1 = step.x1[group.points]
        x_mid = (x0 + x1) / 2
        displacement = x1 - x0
        r_start, t_start = group.vectors_at(step.x0)
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
        x0 = self._step.x0[group.points]
        count, width, _ = x0.shape
        unknowns = 3 * width
        parameters = parameters_at_start(group.pairs)
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
