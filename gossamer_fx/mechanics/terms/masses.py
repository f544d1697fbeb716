"""Kinetic energies of bodies: constant mass matrices, and what they make of a turning frame."""

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
from gossamer_fx.core.model.terms import Parameter
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
)


class Masses(Differentiable, CompiledTerms["KineticEnergy"]):
    """All `KineticEnergy` terms of a scene."""

    forces_are_forms = True
    has_shape_derivative = True

    def __init__(self, terms: Sequence[KineticEnergy], system: Assembly) -> None:
        self._system = system
        self._terms = terms

    def mass_forms(self, body: Body) -> list[fem.Form]:
        """Compiled bilinear forms of the mass [kg] of a body's terms."""
        found = []
        for term in self._terms:
            if term.body is body:
                at = self._system.coordinates[term.body]
                found.append(compile_form(term.mass(at.dq, at.w)))
        return found

    def kinetic_forms(self, body: Body, v: Expr, w: Expr) -> list[ufl.Form]:
        """Bilinear forms of the mass of a body's terms in UFL, not compiled, of velocities v [m/s]
        and test functions w."""
        return [term.mass(v, w) for term in self._terms if term.body is body]

    def add_mass(self, M: PETSc.Mat) -> None:
        """Add the mass [kg] of all terms to M."""
        # The forms of one body are assembled in one call.
        for body in dict.fromkeys(term.body for term in self._terms):
            self._system.block(body).assemble(M, self.mass_forms(body))

    def add_gyroscopic(self, G: PETSc.Mat, spin: tuple[float, float, float]) -> None:
        """Add the matrix [kg/s] of the Coriolis force 2 M (spin × v) in a turning frame.
        Collective."""
        for term in self._terms:
            at = self._system.coordinates[term.body]
            # ω: the spin as a constant, so that another one needs no new kernel.
            ω = fem.Constant(at.q0.function_space.mesh, tuple(float(c) for c in spin))
            # The components of a node are one or more vectors: its position, then directors.
            components = []
            for first in range(0, len(at.dq), 3):
                vector = ufl.as_vector([at.dq[first + j] for j in range(3)])
                turned_vector = ufl.cross(ω, vector)
                components += [turned_vector[j] for j in range(3)]
            turned = ufl.as_vector(components)
            gyroscopic = compile_form(2 * term.mass(turned, at.w))
            self._system.block(term.body).assemble(G, [gyroscopic])


@dataclass(frozen=True, eq=False)
class KineticEnergy:
    """Kinetic energy ½ v·Mv with the constant mass matrix `mass(v, w)`, a bilinear form."""

    body: MeshBody
    mass: Callable[[Expr, Expr], ufl.Form]
    parameters: tuple[Parameter, ...] = ()
    compiler: ClassVar[Compiler] = Masses
