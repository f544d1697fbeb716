"""Energies that are quadratic in the coordinates of a body: ½ a(q, q), such as the bending of a
plate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import ufl
from dolfinx import fem
from petsc4py import PETSc

from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Body, MeshBody
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
)


class QuadraticEnergies(Differentiable, CompiledTerms["QuadraticEnergy"]):
    """All `QuadraticEnergy` terms of a scene: a constant matrix, and nothing in an iteration."""

    has_constant_stiffness = True
    forces_are_forms = True
    has_shape_derivative = True

    def __init__(self, terms: Sequence[QuadraticEnergy], system: Assembly) -> None:
        """Compile the bilinear forms of all quadratic energies.  Collective."""
        self._system = system
        self._terms = terms
        self._stiffness = []
        self._energies = []
        for term in terms:
            at = system.coordinates[term.body]
            self._stiffness.append((term.body, compile_form(term.form(at.dq, at.w))))
            self._energies.append((term.name, compile_form(term.form(at.q0, at.q0))))

    def add_stiffness(self, K: PETSc.Mat) -> None:
        """Add the matrices of the forms [N/m] to K, once: the system makes the forces of it."""
        for body, form in self._stiffness:
            self._system.block(body).assemble(K, [form])

    def residual_forms(self, body: Body, w: Expr) -> list[ufl.Form]:
        """Forms a(q_mid, w) of the forces on a body."""
        found = []
        for term in self._terms:
            if term.body is body:
                found.append(term.form(self._system.coordinates[term.body].mid, w))
        return found

    def energy_forms(self, body: Body) -> list[ufl.Form]:
        """Forms of the stored energy [J] of a body at the end of the step."""
        found = []
        for term in self._terms:
            if term.body is body:
                at = self._system.coordinates[term.body]
                found.append(0.5 * term.form(at.q1, at.q1))
        return found

    def energies(self) -> dict[str, float]:
        """This rank's share of the stored energy [J] at the start of the step, by name."""
        # Several terms may have one name, e.g. the bending of a plate and that of its clamped edge.
        found: dict[str, float] = {}
        for name, form in self._energies:
            found[name] = found.get(name, 0.0) + float(fem.assemble_scalar(form)) / 2
        return found


@dataclass(frozen=True, eq=False)
class QuadraticEnergy:
    """Stored energy ½ a(q, q) of a constant symmetric bilinear form a(q, w), which may have
    integrals over interior facets.

    The force at q_mid is linear, so that energy is conserved.  Momenta are conserved if a(q, q) is
    the same for all rigid motions of q.
    """

    name: str
    body: MeshBody
    form: Callable[[Expr, Expr], ufl.Form]
    compiler: ClassVar[Compiler] = QuadraticEnergies
