"""The stored energy of a reduced film: forces and tangents of its modes as products of full matrices.

    forces    f = Σ_a G_aᵀ N_a,         N_a = Σ_b S_ab F̄_b dA
    tangent   K = Σ_ac G_aᵀ T_ac G_c,   T_ac = (Σ_bd D_abcd F̄_b ⊗ F_d + α S_ac 1) dA

with the gradients G_a of the modes, see `mode_gradients`.  S and D are those of the mixed iteration of
`terms.element_energies`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from gossamer_fx.forms.backend import evaluate
from gossamer_fx.forms.compilation import compile_expression
from gossamer_fx.forms.kinematics import Expr
from gossamer_fx.model.terms import Array, Assembly, CompiledTerms, Indices
from gossamer_fx.reduction.mode_gradients import (
    mode_gradients,
    own_cells,
    points_and_areas,
    project,
    strain_operator,
    stress_derivatives,
)
from gossamer_fx.terms.coordinates import Coordinates
from gossamer_fx.terms.discrete_gradient import StressRule
from gossamer_fx.terms.element_energies import Dissipation, ElementEnergies, ElementForces, StoredEnergy

FEW = 2000  # cells up to which one expression for all states takes less time than to sort cells by their states


class ReducedEnergies(ElementEnergies):
    """All `ReducedEnergy` terms of a scene."""

    made_of_forms = False

    def __init__(self, terms: Sequence[ReducedEnergy], system: Assembly) -> None:
        super().__init__(terms, system)
        self._reduced = [(k, force) for k, force in self.elements if isinstance(force, ModeForces)]

    def forces_of(self, term: StoredEnergy | Dissipation, at: Coordinates) -> ElementForces:
        return ModeForces(term, at, self._system.rule)

    def move(self, linearly: bool) -> None:
        super().move(linearly)
        for _, force in self._reduced:
            force.move()

    def keep(self) -> None:
        super().keep()
        for _, force in self._reduced:
            force.keep()

    def add_forces(self, r: PETSc.Vec) -> None:
        with r as values:
            for k, force in self._reduced:
                values[self._system.numbering.owned(k)] += self._on_rank_zero(force.forces()).ravel()

    def tangent_forms(self, k: int) -> list[fem.Form]:
        return []

    def add_tangents(self, A: PETSc.Mat) -> None:
        numbering = self._system.numbering
        for k, force in self._reduced:
            owned = numbering.owned(k)
            at = np.arange(owned.start, owned.stop, dtype=PETSc.IntType) + PETSc.IntType(numbering.start)
            A.setValues(at, at, self._on_rank_zero(force.tangents()), addv=PETSc.InsertMode.ADD_VALUES)

    def _on_rank_zero(self, values: Array) -> Array:
        """The sum of all ranks' values on rank 0, which owns the coefficients, and nothing on the others."""
        comm = self._system.comm
        if comm.size == 1:
            return values
        total: Array = np.zeros_like(values) if comm.rank == 0 else np.zeros((0, 0))
        comm.Reduce(np.ascontiguousarray(values), total if comm.rank == 0 else None)
        return total


@dataclass(frozen=True, eq=False)
class ReducedEnergy(StoredEnergy):
    """The stored energy of a reduced film.

    modes    (n, r) at the owned and ghost nodes of the body's space
    weights  (cells,) of its own cells
    """

    modes: Array | None = None
    weights: Array | None = None
    compiler: ClassVar[type[CompiledTerms]] = ReducedEnergies


class ModeForces(ElementForces):
    """Forces and tangents of the modes on this rank's cells."""

    def _compile_forces(self, at: Coordinates, rule: StressRule, e: Expr, S: Expr, D: Expr) -> None:
        term: Any = self.term
        film = term.body
        points, dA = points_and_areas(film)
        self._at, self._mesh = at, film.space.mesh
        self._own = own_cells(film)
        self._places = self._ê.function_space.dofmap.list[self._own].ravel()
        self._dA = (dA * term.weights[:, None]).ravel()
        self._G = mode_gradients(film, term.modes, points)
        self._deformation = compile_expression(film.deformation(at.q1), points)
        self.move()
        self.keep()

    def _respond(self, cells: Indices | None = None) -> None:
        if len(self._own) > FEW:
            super()._respond(cells)
        else:
            self._tabulate(self._responses[0], self._response, cells)

    def move(self) -> None:
        """q1 was set: F (2, 3, q) there."""
        values = evaluate(self._deformation, self._mesh, self._own).reshape(len(self._dA), 3, 2)
        self._F = np.ascontiguousarray(values.T)

    def keep(self) -> None:
        """The end of the step is the start of the next one."""
        self._F0 = self._F

    def _stress(self) -> tuple[Array, Array]:
        """S (3, q) and D (3, 3, q) times dA."""
        m = self._size
        values = self._response.x.array.reshape(-1, m + m * m)[self._places].T * self._dA
        return values[:m], values[m:].reshape(m, m, -1)

    def _middle(self) -> Array:
        """F̄ (2, 3, q), of where forces act."""
        α = float(self._at.α.value)
        middle: Array = (1 - α) * self._F0 + α * self._F
        return middle

    def forces(self) -> Array:
        """Forces (r, 3) on the coefficients."""
        F, (S, D) = self._F, self._stress()
        e = np.stack([((F[0] ** 2).sum(axis=0) - 1) / 2, ((F[1] ** 2).sum(axis=0) - 1) / 2, (F[0] * F[1]).sum(axis=0)])
        S = S + np.einsum("klq,lq->kq", D, e - self._ê.x.array.reshape(-1, self._size)[self._places].T)
        a, b = self._middle()
        N = np.stack([S[0] * a + S[2] * b, S[1] * b + S[2] * a]).T  # (q, 3, 2)
        q, _, r = self._G.shape
        total: Array = self._G.reshape(2 * q, r).T @ N.swapaxes(1, 2).reshape(2 * q, 3)
        return total

    def tangents(self) -> Array:
        """Their derivatives (3r, 3r)."""
        S, D = self._stress()
        share = float(self._at.α.value) * float(self._at.γ.value)
        B̄, B = strain_operator(self._middle()), strain_operator(self._F)
        return project(stress_derivatives(B̄, D, B, share * S), self._G)
