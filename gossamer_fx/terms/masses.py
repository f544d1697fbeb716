"""Kinetic energies of bodies: constant mass matrices, and what they make of a turning frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from gossamer_fx.algebra.numbering import GlobalIndices
from gossamer_fx.forms.compilation import compile_form
from gossamer_fx.forms.kinematics import Expr
from gossamer_fx.model.body import Array, Body, MeshBody
from gossamer_fx.model.parameters import Parameter
from gossamer_fx.model.roles import Mass, MassForms, OnMeshes
from gossamer_fx.terms.assembly import Assembly, CompiledTerms, Compiler


class Masses(OnMeshes, Mass, MassForms, CompiledTerms["KineticEnergy"]):
    """All `KineticEnergy` terms of a scene."""

    def __init__(self, terms: Sequence[KineticEnergy], system: Assembly) -> None:
        self._system = system
        self._terms = terms

    def mass_forms(self, body: Body) -> list[fem.Form]:
        found = []
        for term in self._terms:
            if term.body is body:
                at = self._system.fields[term.body]
                found.append(compile_form(term.mass(at.dq, at.w)))
        return found

    def kinetic_forms(self, body: Body, v: Expr, w: Expr) -> list[ufl.Form]:
        return [term.mass(v, w) for term in self._terms if term.body is body]

    def add_mass(self, M: PETSc.Mat) -> None:
        for body in dict.fromkeys(term.body for term in self._terms):
            self._system.block(body).assemble(M, self.mass_forms(body))

    def add_gyroscopic(self, G: PETSc.Mat, spin: tuple[float, float, float]) -> None:
        for term in self._terms:
            at = self._system.fields[term.body]
            ω = fem.Constant(at.q0.function_space.mesh, tuple(float(c) for c in spin))
            v = [
                ufl.cross(ω, ufl.as_vector([at.dq[i + j] for j in range(3)]))
                for i in range(0, len(at.dq), 3)
            ]
            turned = ufl.as_vector([vector[j] for vector in v for j in range(3)])
            self._system.block(term.body).assemble(G, [compile_form(2 * term.mass(turned, at.w))])


@dataclass(frozen=True, eq=False)
class KineticEnergy:
    """Kinetic energy ½ v·Mv with the constant mass matrix `mass(v, w)`, a bilinear form."""

    body: MeshBody
    mass: Callable[[Expr, Expr], ufl.Form]
    parameters: tuple[Parameter, ...] = ()
    compiler: ClassVar[Compiler] = Masses


class NodeMasses(Mass, CompiledTerms["NodeKineticEnergy"]):
    """All `NodeKineticEnergy` terms of a scene."""

    def __init__(self, terms: Sequence[NodeKineticEnergy], system: Assembly) -> None:
        self._system = system
        self._terms = terms

    def add_mass(self, M: PETSc.Mat) -> None:
        for rows, mass in self._nodes():
            M.setValues(rows, rows, np.kron(mass, np.eye(3)), addv=PETSc.InsertMode.ADD_VALUES)

    def add_gyroscopic(self, G: PETSc.Mat, spin: tuple[float, float, float]) -> None:
        for rows, mass in self._nodes():
            turned = np.kron(2 * mass, np.cross(np.eye(3), np.asarray(spin)))
            G.setValues(rows, rows, turned, addv=PETSc.InsertMode.ADD_VALUES)

    def _nodes(self) -> Iterator[tuple[GlobalIndices, Array]]:
        """Global indices and mass (s, s) of every owned node."""
        for term in self._terms:
            rows = self._system.block(term.body).rows.reshape(-1, term.body.block.size)
            yield from zip(rows, term.mass, strict=True)


@dataclass(frozen=True, eq=False)
class NodeKineticEnergy:
    """Kinetic energy ½ Σ_ij mass[i, j] v_i·v_j of a body without mesh, v_i the rates of a node's vectors.

    `mass` (n, s, s) for the n owned nodes of s vectors: kg for positions, kg m and kg m² with directors.
    """

    body: Body
    mass: Array
    compiler: ClassVar[Compiler] = NodeMasses
