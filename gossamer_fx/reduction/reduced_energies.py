"""The stored energy of a reduced film: forces and tangents of its modes as products of full matrices.

    forces    f = Σ_a G_aᵀ N_a,         N_a = Σ_b S_ab F̄_b dA
    tangent   K = Σ_ac G_aᵀ T_ac G_c,   T_ac = (Σ_bd D_abcd F̄_b ⊗ F_d + α S_ac 1) dA

with the gradients G_a of the modes, see `mode_gradients`.  S and D are those of the mixed iteration of
`terms.element_energies`; what happens at the points is in `points`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from gossamer_fx.forms.backend import interpolation_points
from gossamer_fx.forms.compilation import compile_expression
from gossamer_fx.model.body import Array
from gossamer_fx.model.roles import (
    Forces,
    IterateObserver,
    StateObserver,
    StepObserver,
    StoredEnergies,
    Tangents,
)
from gossamer_fx.reduction.coordinates import ReducedCoordinates
from gossamer_fx.reduction.mode_gradients import mode_gradients, own_cells, points_and_areas
from gossamer_fx.reduction.points import GIVEN, LINEAR, TRUE, Law, Points
from gossamer_fx.terms.assembly import Assembly, CompiledTerms
from gossamer_fx.terms.discrete_gradient import StressRule
from gossamer_fx.terms.element_energies import (
    MAX_FRUITLESS_CHOICES,
    StoredEnergy,
    first_that_holds,
    quadrature_element,
    with_derivative,
)


class ReducedEnergies(
    StepObserver, IterateObserver, StateObserver, Forces, Tangents, StoredEnergies, CompiledTerms
):
    """All `ReducedEnergy` terms of a scene."""

    def __init__(self, terms: Sequence[ReducedEnergy], system: Assembly) -> None:
        self._system = system
        self._forces = [
            (term.body, ModeForces(term, coordinates_of(system, term), system.rule))
            for term in terms
        ]

    def begin_step(self, t: float) -> None:
        for _, force in self._forces:
            force.begin()

    def update(self, linearly: bool) -> None:
        for _, force in self._forces:
            force.move(linearly)

    def commit(self) -> None:
        for _, force in self._forces:
            force.points.keep()

    def energies(self) -> dict[str, float]:
        return {force.name: force.points.energy() for _, force in self._forces}

    def add_forces(self, r: PETSc.Vec) -> None:
        with r as values:
            for body, force in self._forces:
                owned = self._system.block(body).owned
                values[owned] += self._on_rank_zero(force.forces()).ravel()

    def add_tangents(self, A: PETSc.Mat) -> None:
        for body, force in self._forces:
            block = self._system.block(body)
            owned = block.owned
            K = self._on_rank_zero(force.tangents(self._system.geometric))
            if (
                A.getType() == PETSc.Mat.Type.SEQDENSE
            ):  # PETSc's way of entering numbers takes ten times as long
                A.getDenseArray()[owned, owned] += K
                continue
            A.setValues(block.rows, block.rows, K, addv=PETSc.InsertMode.ADD_VALUES)

    def _on_rank_zero(self, values: Array) -> Array:
        """The sum of all ranks' values on rank 0, which owns the coefficients, and nothing on the others."""
        comm = self._system.comm
        if comm.size == 1:
            return values
        total: Array = np.zeros_like(values) if comm.rank == 0 else np.zeros((0, 0))
        comm.Reduce(np.ascontiguousarray(values), total if comm.rank == 0 else None)
        return total


def coordinates_of(system: Assembly, term: ReducedEnergy) -> ReducedCoordinates:
    """The coordinates of a reduced film in a system."""
    at = system.fields[term.body]
    assert isinstance(at, ReducedCoordinates)
    return at


@dataclass(frozen=True, eq=False)
class ReducedEnergy(StoredEnergy):
    """The stored energy of a reduced film.

    modes    (n, r) at the owned and ghost nodes of the body's space
    weights  (cells,) of its own cells
    """

    modes: Array | None = None
    weights: Array | None = None
    compiler: ClassVar[type[CompiledTerms]] = ReducedEnergies


class ModeForces:
    """Forces and tangents of the modes on this rank's cells."""

    def __init__(self, term: ReducedEnergy, at: ReducedCoordinates, rule: StressRule) -> None:
        film: Any = term.body
        mesh, cells = film.space.mesh, own_cells(film)
        Q = fem.functionspace(mesh, quadrature_element(mesh, term.dx.metadata(), (3,)))
        strains = fem.Function(Q), fem.Function(Q)
        e0, e_chosen = strains[0], ufl.variable(strains[1])
        cases, points = rule.cases(term, e0, e_chosen), interpolation_points(Q)
        stresses = [rule.stress(term, e0, e_chosen), *(S for _, S in cases)]
        law = Law(
            strains,
            [compile_expression(with_derivative(S, e_chosen), points) for S in stresses],
            compile_expression(first_that_holds(cases), points) if cases else None,
            compile_expression(term.density(e0), points),
            cells,
        )
        at_points, dA = points_and_areas(film)
        assert term.modes is not None and term.weights is not None
        x = mesh.geometry.x[mesh.geometry.dofmap[cells]]
        G = mode_gradients(film, term.modes, at_points)
        self.name, self._at = term.name, at
        self.points = Points(law, x, dA * term.weights[:, None], G)
        self._switches = not term.quadratic and rule.alpha == 0.5
        self._known, self._chooses = 0, self._switches
        self._α = rule.alpha

    def begin(self) -> None:
        """Start a step."""
        self._known, self._chooses = 0, self._switches
        self.points.begin()

    def move(self, linearly: bool) -> None:
        """Strains after q1 was set, as those of `terms.element_energies.ElementForces` follow.

        But for the first ones, which go on as in the last step: a small basis has no modes that alternate from step to
        step, and a sail takes half an iteration less.
        """
        points = self.points
        points.move(self._at.end)
        if not linearly:
            points.set_strains(TRUE)
            return
        if not self._chooses:
            points.set_strains(LINEAR, self._at.change)
        elif not self._known:
            points.strain[:] = 2 * points.start - points.past
            points.set_strains(GIVEN)
        else:
            far = points.choose_strains(self._at.change)
            self._chooses = self._known <= MAX_FRUITLESS_CHOICES or far
        self._known += 1

    def forces(self) -> Array:
        """Forces (r, 3) on the coefficients."""
        return self.points.forces(self._α)

    def tangents(self, geometric: float) -> Array:
        """Their derivatives (3r, 3r), with a share of the `geometric` stiffness."""
        return self.points.stiffness(self._α, self._α * geometric)
