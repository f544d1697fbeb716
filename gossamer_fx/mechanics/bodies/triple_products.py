"""Energies that are triple products (u×v)·s of three vectors linear in the coordinates: those of
rest curvatures.

They are cubic, so the gradient at q_mid = ½ (q0 + q1) keeps both momenta but not the energy: with Δ
the change of a quantity from q0 to q1

    Δ((u×v)·s) = ∂((u×v)·s)(q_mid)·Δq + ¼ (Δu×Δv)·Δs.

The missing energy is given back at every quadrature point along the gradients g_i' at q_mid of six
invariants of the three vectors,

    g = (½ u·u, u·v, ½ v·v, u·s, v·s, (u×v)·s),    force = missing Σ (g_i'·Δq) g_i' / Σ (g_i'·Δq)²:

all are invariant to rigid motions, so the momenta stay, and one of them changes in every motion
that is not rigid.  The tangent leaves this part out: it is of third order in the step.

A function of time c, on which one of the three vectors depends linearly, such as a temperature, has
the value (1 - α) c0 + α c1 in a step from c0 to c1.  With the energy E(q; c) what changes c
supplies

    (1 - α) (E(q1; c1) - E(q1; c0)) + α (E(q0; c1) - E(q0; c0)),

which is for α = ½ the change of the energy less the work of the forces, exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import ufl
from dolfinx import fem

from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import MeshBody
from gossamer_fx.mechanics.terms.assembly import Compiler
from gossamer_fx.mechanics.terms.coordinates import Coordinates
from gossamer_fx.mechanics.terms.discrete_gradient import gonzalez_correction
from gossamer_fx.mechanics.terms.energies_in_time import Change, EnergiesInTime, StepForms, Varying

# Lower bound of the divisor Σ (g_i'·Δq)², which vanishes in a step without motion.  The vectors are
# dimensionless, so that changes of 1e-12, the root of this, are round-off.
SMALLEST = 1e-24

Vectors = tuple[Expr, Expr, Expr]


class TripleProductEnergies(EnergiesInTime["TripleProductEnergy"]):
    """All `TripleProductEnergy` terms of a scene."""

    def _step_forms(self, term: TripleProductEnergy, at: Coordinates) -> StepForms:
        # The vectors u, v, s are evaluated at the configuration `mid` in which forces act, along
        # the test function (δ) and along the trial function (dq).
        residual = ufl.Form([])
        tangent = ufl.Form([])
        for scale, vectors, dx in term.products:
            mid = vectors(at.mid)
            δ = vectors(at.w)
            dq = vectors(at.dq)
            force = _gradient(mid, δ)
            if self._system.rule.conserves:
                force += _defect(mid, vectors(at.q1 - at.q0), δ)
            residual += scale * force * dx
            tangent += at.α * scale * _second(mid, dq, δ) * dx
        energy = term.energy(at.q0)
        if term.varying is None:
            return StepForms(residual, tangent, energy)
        # Symbols are those of the end: forces take the value in the step, the energy at q0 that of
        # the start.
        after = term.varying.function
        before = fem.Function(after.function_space)
        in_step = {after: (1 - at.α) * before + at.α * after}
        at_start = {after: before}
        energy_at_end = term.energy(at.q1)
        by_end = energy_at_end - ufl.replace(energy_at_end, at_start)
        by_start = energy - ufl.replace(energy, at_start)
        return StepForms(
            residual=ufl.replace(residual, in_step),
            tangent=ufl.replace(tangent, in_step),
            energy=ufl.replace(energy, at_start),
            change=Change(term.varying, before, (1 - at.α) * by_end + at.α * by_start),
        )


@dataclass(frozen=True, eq=False)
class TripleProductEnergy:
    """Stored energy Σ ∫ scale (u×v)·s, and a constant.

    Args:
        products: for each the scale, [J/m²] or at edges [J/m]; the dimensionless vectors (u, v, s)
            as a linear function of the coordinates; and the measure, of cells or interior edges.
        constant: energy [J] that does not depend on the coordinates, a form.
        varying: a function of time on which one vector of each product depends linearly.
    """

    name: str
    body: MeshBody
    products: Sequence[tuple[Expr, Callable[[Expr], Vectors], ufl.Measure]]
    constant: ufl.Form
    varying: Varying | None = None
    compiler: ClassVar[Compiler] = TripleProductEnergies

    def energy(self, x: Expr) -> ufl.Form:
        """The energy [J] at coordinates x."""
        energy = self.constant
        for scale, vectors, dx in self.products:
            energy += scale * _triple(*vectors(x)) * dx
        return energy


def _triple(u: Expr, v: Expr, s: Expr) -> Expr:
    return ufl.dot(ufl.cross(u, v), s)


def _gradient(X: Vectors, δ: Vectors) -> Expr:
    """Derivative of the triple product of X along δ."""
    u, v, s = X
    du, dv, ds = δ
    return _triple(du, v, s) + _triple(u, dv, s) + _triple(u, v, ds)


def _second(X: Vectors, a: Vectors, b: Vectors) -> Expr:
    """Second derivative of the triple product of X along two directions, dimensionless."""
    # au is the part of a that belongs to u, and so on.
    u, v, s = X
    au, av, as_ = a
    bu, bv, bs = b
    pairs = (
        _triple(au, bv, s),
        _triple(bu, av, s),
        _triple(au, v, bs),
        _triple(bu, v, as_),
    )
    return sum(pairs) + _triple(u, av, bs) + _triple(u, bv, as_)


def _invariants(X: Vectors, δ: Vectors) -> list[Expr]:
    """Derivatives along δ of ½ u·u, ½ v·v, u·v, u·s, v·s and (u×v)·s, which do not change in rigid
    motions."""
    # du is the change of u along δ, and so on.
    u, v, s = X
    du, dv, ds = δ
    return [
        ufl.dot(u, du),
        ufl.dot(v, dv),
        ufl.dot(u, dv) + ufl.dot(du, v),
        ufl.dot(u, ds) + ufl.dot(du, s),
        ufl.dot(v, ds) + ufl.dot(dv, s),
        _gradient(X, δ),
    ]


def _defect(mid: Vectors, Δ: Vectors, δ: Vectors) -> Expr:
    """Force density that gives back the energy which the midpoint rule misses of a triple product.

    The energy changes by the gradient at mid-step times the changes Δ of the three vectors, and ¼
    (Δu×Δv)·Δs.  This remainder is distributed along the changes of six invariants (Gonzalez's
    correction), so that no moment arises.  δ are the derivatives along the test function.
    """
    # A cubic function changes by its gradient in the middle times the step, and a quarter of its
    # value at the step: u·(v × s) of the three changes.
    missing = _triple(*Δ) / 4
    # Along invariants of rotations only, so that the correction has no moment.
    coefficients = gonzalez_correction(missing, _invariants(mid, Δ), SMALLEST)
    along = _invariants(mid, δ)
    return sum(c * direction for c, direction in zip(coefficients, along, strict=True))
