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
from dolfinx import fem, la
from petsc4py import PETSc

from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Body, MeshBody
from gossamer_fx.mechanics.terms.assembly import Assembly, CompiledTerms, Compiler
from gossamer_fx.mechanics.terms.discrete_gradient import gonzalez_correction

# Lower bound of the divisor Σ (g_i'·Δq)², which vanishes in a step without motion.  The vectors are
# dimensionless, so that changes of 1e-12, the root of this, are round-off.
SMALLEST = 1e-24

Vectors = tuple[Expr, Expr, Expr]


@dataclass(frozen=True, eq=False)
class _Compiled:
    """Compiled forms of one term, and the array of its forces with ghosts."""

    body: MeshBody
    name: str
    residual: fem.Form
    tangent: fem.Form
    energy: fem.Form
    force: la.Vector
    changing: _Changing | None


@dataclass(frozen=True, eq=False)
class _Changing:
    """A function of time at both ends of the step, `varying.function` and `before`, and the form of
    the work [J] that its change supplies."""

    varying: Varying
    before: fem.Function
    supplied: fem.Form


class TripleProductEnergies(CompiledTerms["TripleProductEnergy"]):
    """All `TripleProductEnergy` terms of a scene."""

    def __init__(self, terms: Sequence[TripleProductEnergy], system: Assembly) -> None:
        # For each term: the vectors u, v, s are evaluated at the configuration `mid` in which
        # forces act, along the test function (δ) and along the trial function (dq).
        self._system = system
        self._compiled: list[_Compiled] = []
        for term in terms:
            at = system.coordinates[term.body]
            residual = ufl.Form([])
            tangent = ufl.Form([])
            energy = term.energy(at.q0)
            energy_at_end = term.energy(at.q1)
            for scale, vectors, dx in term.products:
                mid = vectors(at.mid)
                δ = vectors(at.w)
                dq = vectors(at.dq)
                force = _gradient(mid, δ)
                if system.rule.conserves:
                    force += _defect(mid, vectors(at.q1 - at.q0), δ)
                residual += scale * force * dx
                tangent += at.α * scale * _second(mid, dq, δ) * dx
            changing = None
            if term.varying is not None:
                after = term.varying.function
                before = fem.Function(after.function_space)
                # Symbols are those of the end: forces take the value in the step, the energy at q0
                # that of the start.
                in_step = {after: (1 - at.α) * before + at.α * after}
                residual = ufl.replace(residual, in_step)
                tangent = ufl.replace(tangent, in_step)
                at_start = {after: before}
                by_end = energy_at_end - ufl.replace(energy_at_end, at_start)
                by_start = energy - ufl.replace(energy, at_start)
                energy = ufl.replace(energy, at_start)
                supplied = compile_form((1 - at.α) * by_end + at.α * by_start)
                changing = _Changing(term.varying, before, supplied)
            compiled = _Compiled(
                body=term.body,
                name=term.name,
                residual=compile_form(residual),
                tangent=compile_form(tangent),
                energy=compile_form(energy),
                force=la.vector(term.body.block.index_map, term.body.block.size),
                changing=changing,
            )
            self._compiled.append(compiled)

    def begin_step(self, t: float) -> None:
        # The end of the step, not the time t of its forces.
        self.take_time(self._system.time + self._system.h)

    def take_time(self, t: float) -> None:
        """Set the functions of time at the end of the step, t [s]."""
        for changing in self._changing():
            changing.varying.set(changing.varying.function, t)

    def commit(self) -> None:
        """Take the functions of time at the end of the step as those at the start of the next."""
        for changing in self._changing():
            changing.before.x.array[:] = changing.varying.function.x.array

    def supplied(self) -> float:
        """Work [J] of what changes with time in the step, this rank's share."""
        return sum(float(fem.assemble_scalar(one.supplied)) for one in self._changing())

    def _changing(self) -> list[_Changing]:
        """The functions of time of those terms that have one."""
        return [one.changing for one in self._compiled if one.changing is not None]

    def add_forces(self, r: PETSc.Vec) -> None:
        for compiled in self._compiled:
            force = compiled.force
            # Assembly adds to what is there.
            force.array[:] = 0
            fem.assemble_vector(force.array, compiled.residual)
            force.scatter_reverse(la.InsertMode.add)
            owned = self._system.block(compiled.body).owned
            with r as values:
                values[owned] += force.array[: owned.stop - owned.start]

    def tangent_forms(self, body: Body) -> list[fem.Form]:
        return [compiled.tangent for compiled in self._compiled if compiled.body is body]

    def energies(self) -> dict[str, float]:
        """Stored energies [J] at q0 by name, this rank's share; terms of one name add up."""
        found: dict[str, float] = {}
        for compiled in self._compiled:
            energy = float(fem.assemble_scalar(compiled.energy))
            found[compiled.name] = found.get(compiled.name, 0.0) + energy
        return found


@dataclass(frozen=True, eq=False)
class Varying:
    """A function of time on which an energy depends.

    Attributes:
        function: symbol of it in the forms.
        set: gives a function of the same space its values at a time [s].
    """

    function: fem.Function
    set: Callable[[fem.Function, float], None]


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
