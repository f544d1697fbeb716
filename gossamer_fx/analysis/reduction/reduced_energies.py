"""The stored energy of a reduced film: forces and tangents of its modes as products of full
matrices.

    forces    f = Σ_a G_aᵀ N_a,         N_a = Σ_b S_ab F_mean_b dA                               (1)
    tangent   K = Σ_ac G_aᵀ T_ac G_c,   T_ac = (Σ_bd D_abcd F_mean_b ⊗ F_d + α S_ac 1) dA        (2)

G are the gradients of the modes (`mode_gradients`), F and F_mean the gradients at q1 and at q_mid.
The stress S and its derivatives D are those of the mixed iteration in strains, which
`terms.element_energies` describes; `points` evaluates them at the quadrature points.

Each rank has the points of the sampled cells that it owns.  Sums over ranks go to rank 0, which
owns the unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from gossamer_fx.analysis.reduction.coordinates import ReducedCoordinates
from gossamer_fx.analysis.reduction.mode_gradients import (
    mode_gradients,
    own_cells,
    points_and_areas,
)
from gossamer_fx.analysis.reduction.points import Points
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.terms.assembly import Assembly, CompiledTerms, Compiler
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule
from gossamer_fx.mechanics.terms.element_energies import StoredEnergy, quadrature_element
from gossamer_fx.mechanics.terms.law_kernel import LawFunctions, law_functions


class ReducedEnergies(CompiledTerms["ReducedEnergy"]):
    """All `ReducedEnergy` terms of a scene, compiled."""

    def __init__(self, terms: Sequence[ReducedEnergy], system: Assembly) -> None:
        """Make the forces of the modes of each term.

        Raises:
            InputError: the stress rule takes the strain in the middle of the step.
        """
        check(
            not system.rule.takes_mid_strain,
            f"'{terms[0].name}': a reduced film has forces by its strains at the ends of a step; "
            "run its scene with Midpoint.",
        )
        self._system = system
        self._forces = []
        for term in terms:
            forces = ModeForces(term, coordinates_of(system, term), system.rule)
            self._forces.append((term.body, forces))

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
        """Add the dense blocks (3r, 3r) [N/m] of the reduced films to the system's matrix.
        Collective.

        K is the sum over ranks of the stiffness (3r, 3r) of the r modes; on ranks other than 0 it
        is empty. The matrix is not assembled here."""
        for body, force in self._forces:
            block = self._system.block(body)
            K = self._on_rank_zero(force.tangents(self._system.geometric))
            # PETSc takes ten times as long to enter a full block number by number.
            if A.getType() == PETSc.Mat.Type.SEQDENSE:
                A.getDenseArray()[block.owned, block.owned] += K
            else:
                A.setValues(block.rows, block.rows, K, addv=PETSc.InsertMode.ADD_VALUES)

    def _on_rank_zero(self, values: Array) -> Array:
        """The sum over all ranks on rank 0, which owns the coefficients; an empty array on the
        others."""
        comm = self._system.comm
        if comm.size == 1:
            return values
        own = np.ascontiguousarray(values)
        if comm.rank == 0:
            total: Array = np.zeros_like(values)
            comm.Reduce(own, total)
            return total
        comm.Reduce(own, None)
        return np.zeros((0, 0))


def coordinates_of(system: Assembly, term: ReducedEnergy) -> ReducedCoordinates:
    """The coordinates of a reduced film in a system."""
    coordinates = system.coordinates[term.body]
    # Its body is a reduced film, which makes such coordinates.
    assert isinstance(coordinates, ReducedCoordinates)
    return coordinates


@dataclass(frozen=True, eq=False)
class ReducedEnergy(StoredEnergy):
    """The stored energy of a reduced film.

    Args:
        modes: φ (n, r) at the owned and ghost nodes of the body's space.
        weights: ξ (cells,) of the cells that this rank owns.

    The other arguments are those of `StoredEnergy`.
    """

    modes: Array | None = None
    weights: Array | None = None
    compiler: ClassVar[Compiler] = ReducedEnergies


class ModeForces:
    """Forces (1) and tangents (2) of the modes on this rank's cells.

    Args:
        term: the stored energy.
        at: coordinates of the reduced film.
        rule: stress rule of the time stepping.

    Attributes:
        name: of the energy in the energy balance.
        points: the quadrature points.
    """

    def __init__(self, term: ReducedEnergy, at: ReducedCoordinates, rule: StressRule) -> None:
        assert term.modes is not None and term.weights is not None
        film: Any = term.body
        reference_points, dA = points_and_areas(film)
        self.name = term.name
        self.points = Points(
            _compiled_law(term, rule),
            own_cells(film),
            dA=dA * term.weights[:, None],
            G=mode_gradients(film, term.modes, reference_points),
            # A quadratic energy has one linear stress: there is nothing to choose.
            may_choose=not term.quadratic and not rule.acts_at_end,
        )
        self._at = at
        self._alpha = rule.alpha

    def begin(self) -> None:
        self.points.law.begin_step()

    def move(self, linearly: bool) -> None:
        """Set the strains at the quadrature points after the end q1 of the step was set.

        Args:
            linearly: True: strains are linearised about the last iterate of Newton's method, as
                `terms.element_energies` describes; False: the true strains of q1.
        """
        self.points.move(self._at.end)
        if linearly:
            self.points.linearise(self._at.change)
        else:
            self.points.set_true_strains()

    def forces(self) -> Array:
        """Forces (r, 3) [N] on the coefficients."""
        return self.points.forces(self._alpha)

    def tangents(self, geometric: float) -> Array:
        """Derivatives (3r, 3r) [N/m] of the forces by q1, with a share of the geometric
        stiffness."""
        return self.points.stiffness(self._alpha, self._alpha * geometric)


def _compiled_law(term: ReducedEnergy, rule: StressRule) -> LawFunctions:
    """Compile the functions of a law at the quadrature points."""
    film: Any = term.body
    mesh = film.space.mesh
    Q = fem.functionspace(mesh, quadrature_element(mesh, term.dx.metadata(), (3,)))
    return law_functions(term, rule, start=fem.Function(Q), strain=fem.Function(Q))
