"""Energies and dissipation ∫ψ(e(q)) dx on meshes, solved by a mixed iteration in strains.

Problem.  A film's strain is quadratic in the coordinates.  Newton's iteration on the coordinates alone
sees, after each update, stresses of the second-order strain that the update brings with it.  In a stiff,
thin film they are many times the stresses of the solution, and the iteration zigzags.

Idea (D. Magisano, L. Leonetti & G. Garcea, IJNME 109 (2017) 1237, doi:10.1002/nme.5328).  The strain ê at
the quadrature points is a separate unknown, which is condensed at each point.  In the next iterate ê
follows the *linearised* strain, so that the second-order part never produces stress.  At convergence ê is
the true strain, and the solution is that of the original equations.

Algorithm.  S(ê) is the stress of the step by the stress rule (`terms.discrete_gradient`), D = dS/dê:

1. residual    ∫ (S + D (e(q1) - ê))·De(q_mid)[w] dx
2. tangent     ∫ D De(q1)[δ]·De(q_mid)[w] + α (γ S + (1-γ) S⁺)·D²e[δ, w] dx
               γ is the share of the geometric stiffness, 1 except in initial iterations without it
               (see `solvers.newton`).  S⁺ is the tensile part of S at rest (α = 1), and zero in time
               steps: there it costs a thrown plate half as many iterations again, and rejected steps.
3. update      ê = e(q1) - ½ D²e[δ, δ], the strain linearised about the last iterate
4. response    (S, D) are evaluated once an iteration at all points, by compiled expressions; the forms of
               1 and 2 only read them.  A path that stays in one state of the film (taut, wrinkled or
               slack) has a separate expression, which costs a third to a sixth of the general one.

Choice of strains.  Where a film changes its state, the linearised stress σ = S + D (e_lin - ê) of a point
may be far from the stress of the linearised strain.  There ê is chosen between the strain e_lin and the
strain that has the stress σ:

    (D + k I)(ê - e_lin) = σ - S(e_lin),    |ê - e_lin| <= |e_lin - ê_before|                       (5)

with k a fraction of the largest stiffness.  Stiff points then follow the strain and soft points the stress.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, ClassVar

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc

from gossamer_fx.forms.backend import evaluate, interpolation_points, tabulate
from gossamer_fx.forms.compilation import compile_expression, compile_form
from gossamer_fx.forms.kinematics import Expr
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.forms.strain_path import Piece, gradient
from gossamer_fx.model.body import Array, Body, Indices, MeshBody
from gossamer_fx.model.parameters import Parameter
from gossamer_fx.model.roles import (
    Dissipation,
    Forces,
    IterateObserver,
    OnMeshes,
    ResidualForms,
    Reversible,
    StateObserver,
    StepObserver,
    StoredEnergies,
    TangentForms,
)
from gossamer_fx.terms.assembly import Assembly, CompiledTerms
from gossamer_fx.terms.coordinates import Coordinates
from gossamer_fx.terms.discrete_gradient import StressRule

# k of equation (5), as a fraction of the largest stiffness at the point.
STRAIN_CHOICE_STIFFNESS = 0.03
# Relative error of the linearised stress from which a strain is chosen by (5).
STRAIN_CHOICE_TRIGGER = 0.1
# How often in a step a strain may be chosen at one point without the error falling: beyond that the point
# would cycle, or creep where the film is almost slack.
MAX_FRUITLESS_CHOICES = 5
# A choice is fruitless unless the error falls below this part of the last one.
FRUITFUL_ERROR_RATIO = 0.9


class ElementEnergies(
    OnMeshes,
    StepObserver,
    IterateObserver,
    StateObserver,
    Forces,
    TangentForms,
    StoredEnergies,
    Dissipation,
    ResidualForms,
    Reversible,
    CompiledTerms,
):
    """All `StoredEnergy` and `ViscousDissipation` terms of a scene."""

    def __init__(
        self, terms: Sequence[StoredEnergy | ViscousDissipation], system: Assembly
    ) -> None:
        self._system = system
        self.elements = [ElementForces(t, system.fields[t.body], system.rule) for t in terms]
        self._dissipating = [
            force for force in self.elements if isinstance(force.term, ViscousDissipation)
        ]
        self.losses = [force.term.name for force in self._dissipating]
        # One vector for each body, to which all of its terms are assembled.
        self._forces = {term.body: _vector_of(system.fields[term.body]) for term in terms}

    def begin_step(self, t: float) -> None:
        for force in self.elements:
            self._system.fields[force.term.body].h.value = self._system.h
            force.begin_step()

    def update(self, linearly: bool) -> None:
        for force in self.elements:
            if linearly:
                force.linearise()
            else:
                force.evaluate()

    def add_forces(self, r: PETSc.Vec) -> None:
        for b in self._forces.values():
            b.array[:] = 0
        for force in self.elements:
            fem.assemble_vector(self._forces[force.term.body].array, force.residual)
        with r as values:
            for body, b in self._forces.items():
                b.scatter_reverse(la.InsertMode.add)
                owned = self._system.block(body).owned
                self._system.fields[body].add_forces(b.array, values[owned])

    def tangent_forms(self, body: Body) -> list[fem.Form]:
        return [force.tangent for force in self.elements if force.term.body is body]

    def dissipated(self) -> Array:
        return np.array([force.dissipated() for force in self._dissipating])

    def commit(self) -> None:
        for force in self.elements:
            force.commit()

    def energies(self) -> dict[str, float]:
        return {f.term.name: f.energy() for f in self.elements if isinstance(f.term, StoredEnergy)}

    def residual_forms(self, body: Body, w: Expr) -> list[ufl.Form]:
        return [force.residual_form(w) for force in self.elements if force.term.body is body]

    def energy_forms(self, body: Body) -> list[ufl.Form]:
        return [
            force.energy_form()
            for force in self.elements
            if force.term.body is body and isinstance(force.term, StoredEnergy)
        ]


@dataclass(frozen=True, eq=False)
class StoredEnergy:
    """Stored energy ∫ψ(e(q)) dx: `measure` is quadratic in q, `density` ψ is a function of the strain alone.

    `pieces` cuts the path between two strains where ψ is not smooth; `pulling` is the part of a stress of which the
    geometric stiffness is positive; `parameters` are coefficients of the density.
    """

    name: str
    body: MeshBody
    measure: Callable[[Expr], Expr]
    density: Callable[[Expr], Expr]
    dx: ufl.Measure
    quadratic: bool = False
    pieces: Callable[[Expr, Expr], list[Piece]] | None = None
    pulling: Callable[[Expr], Expr] | None = None
    parameters: tuple[Parameter, ...] = ()
    compiler: ClassVar[type[CompiledTerms]] = ElementEnergies


@dataclass(frozen=True, eq=False)
class ViscousDissipation:
    """Dissipation: stress φ'(ė) against the rate of the measure; φ is quadratic and convex, the loss 2∫∫φ(ė) dx dt."""

    name: str
    body: MeshBody
    measure: Callable[[Expr], Expr]
    density: Callable[[Expr], Expr]
    dx: ufl.Measure
    parameters: tuple[Parameter, ...] = ()
    compiler: ClassVar[type[CompiledTerms]] = ElementEnergies


class ElementForces:
    """Forces, tangent and energy of one `StoredEnergy` or `ViscousDissipation`, compiled.

    Args:
        term: what it computes.
        at: the coordinates of the body in a step.
        rule: the stress rule.

    Attributes:
        residual, tangent: the compiled forms 1 and 2 of the module.
    """

    def __init__(
        self, term: StoredEnergy | ViscousDissipation, at: Coordinates, rule: StressRule
    ) -> None:
        self.term = term
        self._at = at
        self._rule = rule
        e = term.measure(at.q1)
        self._size = m = e.ufl_shape[0]
        mesh = at.q1.function_space.mesh
        self._metadata = term.dx.metadata()
        topology = mesh.topology.index_map(mesh.topology.dim)
        self._cells = np.arange(topology.size_local + topology.num_ghosts, dtype=np.int32)

        self._e0 = self._at_points(mesh, m)
        self._strain_variable = self._at_points(mesh, m)
        self._strain_before = self._e0.x.array.copy()
        # S and D, row after row.
        self._response = self._at_points(mesh, m + m * m)
        S = ufl.as_vector([self._response[i] for i in range(m)])
        D = ufl.as_matrix([[self._response[m + i * m + j] for j in range(m)] for i in range(m)])
        self._points = interpolation_points(self._e0.function_space)

        self._compile_response(at, rule)
        second_variation = ufl.derivative(ufl.derivative(e, at.q1, at.δ), at.q1, at.δ)
        linearised = e - second_variation / 2
        self._true_strain = compile_expression(e, self._points)
        self._linearised_strain = compile_expression(linearised, self._points)
        self._compile_forms(e, S, D, at, rule)

        # Only laws with several states need the choice of strains; a quadratic one has no second state, and
        # at rest (α = 1) the pseudo-time steps are short enough without it.
        has_states = isinstance(term, StoredEnergy) and not term.quadratic
        self._may_choose = has_states and rule.alpha == 0.5
        if self._may_choose:
            self._compile_choice(linearised, S, D, mesh)
        self._iterates = 0
        self._chooses = self._may_choose

    def _at_points(self, mesh: Any, size: int) -> fem.Function:
        """A function with `size` values at each quadrature point."""
        element = quadrature_element(mesh, self._metadata, (size,))
        return fem.Function(fem.functionspace(mesh, element))

    def _compile_response(self, at: Coordinates, rule: StressRule) -> None:
        """Expressions for (S, D): one for every path, and cheaper ones for paths within one state."""
        term = self.term
        strain = ufl.variable(self._strain_variable)
        if isinstance(term, StoredEnergy):
            S_mean = rule.stress(term, self._e0, strain)
            cases = rule.cases(term, self._e0, strain)
            self._energy = compile_form(term.density(self._e0) * term.dx)
        else:
            S_mean = gradient(term.density, (strain - self._e0) / at.h)
            cases = []
            S = ufl.as_vector([self._response[i] for i in range(self._size)])
            self._work = compile_form(ufl.dot(S, self._strain_variable - self._e0) * term.dx)
        # The first serves every point.
        stresses = [S_mean, *(stress for _, stress in cases)]
        self._responses = [
            compile_expression(with_derivative(stress, strain), self._points) for stress in stresses
        ]
        if cases:
            self._case = compile_expression(first_that_holds(cases), self._points)

    def _compile_forms(self, e: Expr, S: Expr, D: Expr, at: Coordinates, rule: StressRule) -> None:
        """Residual and tangent of the mixed iteration."""
        term = self.term
        first_variation = ufl.derivative(e, at.q1, at.w)
        at_middle = ufl.replace(first_variation, {at.q1: at.mid})
        along_update = ufl.derivative(e, at.q1, at.dq)
        second_variation = ufl.derivative(first_variation, at.q1, at.dq)
        stress = S + ufl.dot(D, e - self._strain_variable)
        self.residual = compile_form(ufl.dot(stress, at_middle) * term.dx)
        stress_in_tangent = at.γ * S
        if isinstance(term, StoredEnergy) and term.pulling is not None and rule.alpha == 1.0:
            stress_in_tangent += (1 - at.γ) * term.pulling(S)
        material = ufl.dot(ufl.dot(D, along_update), at_middle)
        geometric = at.α * ufl.dot(stress_in_tangent, second_variation)
        self.tangent = compile_form((material + geometric) * term.dx)

    def _compile_choice(self, linearised: Expr, S: Expr, D: Expr, mesh: Any) -> None:
        """Expressions for the choice of strains, equation (5) of the module."""
        m = self._size
        # The linearised strain and stress, the largest stiffness, and |e_lin - ê|, before ê is changed.
        self._forecast = self._at_points(mesh, 2 * m + 2)
        change = linearised - self._strain_variable
        stiffness = _largest(D[i, i] for i in range(m))
        stress = S + ufl.dot(D, change)
        forecast = [*linearised, *stress, stiffness, ufl.sqrt(ufl.dot(change, change))]
        self._make_forecast = compile_expression(ufl.as_vector(forecast), self._points)
        # k of (5) where the error of the forecast stress is large, zero elsewhere; and that error.
        forecast_stress = [self._forecast[m + i] for i in range(m)]
        error = _largest(abs(S[i] - forecast_stress[i]) for i in range(m))
        size = _largest(abs(s) for i in range(m) for s in (S[i], forecast_stress[i]))
        k = STRAIN_CHOICE_STIFFNESS * ufl.max_value(stiffness, self._forecast[2 * m])
        is_far = ufl.conditional(ufl.gt(error, STRAIN_CHOICE_TRIGGER * size), 1.0, 0.0)
        judgement = ufl.as_vector([is_far * k, error])
        self._judge_forecast = compile_expression(judgement, self._points)
        # By cell and point: the error where a strain was chosen last, and the fruitless choices.
        self._last_error = np.full((len(self._cells), len(self._points)), np.inf)
        self._fruitless = np.zeros(self._last_error.shape, dtype=int)

    # ---- the course of a step --------------------------------------------------------------------------

    def begin_step(self) -> None:
        """Start a step: nothing is known of its stress yet."""
        self._iterates = 0
        self._chooses = self._may_choose
        if self._may_choose:
            self._last_error[:] = np.inf
            self._fruitless[:] = 0

    def commit(self) -> None:
        """End a step: the strain of its end is that of the next one's start."""
        self._strain_before[:] = self._e0.x.array
        self._e0.x.array[:] = self._strain_variable.x.array

    def linearise(self) -> None:
        """Take ê from the strain at the last iterate and its linear change, then the response."""
        if not self._chooses:
            self._tabulate(self._linearised_strain, self._strain_variable)
            self._respond()
        elif self._iterates == 0:
            # The first guess is the strain of the last step's start: a film that flutters alternates from
            # step to step.
            self._strain_variable.x.array[:] = self._strain_before
            self._respond()
        else:
            self._choose()
        self._iterates += 1

    def evaluate(self) -> None:
        """Take the true strain e(q1) for ê, then the response."""
        self._tabulate(self._true_strain, self._strain_variable)
        self._respond()

    def _choose(self) -> None:
        """Choose ê between the linearised strain and the one with the linearised stress, by (5)."""
        m = self._size
        mesh = self._strain_variable.function_space.mesh
        self._tabulate(self._make_forecast, self._forecast)
        forecast = self._forecast.x.array.reshape(-1, 2 * m + 2)
        strain = self._strain_variable.x.array.reshape(-1, m)
        strain[:] = forecast[:, :m]
        self._respond()

        judgement = evaluate(self._judge_forecast, mesh, self._cells)
        k, error = np.moveaxis(judgement.reshape(*self._last_error.shape, 2), 2, 0)
        self._fruitless += (k > 0) & (error > FRUITFUL_ERROR_RATIO * self._last_error)
        self._last_error[:] = np.where(k > 0, error, np.inf)
        is_chosen = (k > 0) & (self._fruitless < MAX_FRUITLESS_CHOICES)
        early = self._iterates <= MAX_FRUITLESS_CHOICES
        self._chooses = early or bool(is_chosen.any())

        far = cell_nodes(self._strain_variable.function_space)[is_chosen]
        response = self._response.x.array.reshape(-1, m + m * m)[far]
        S, D = np.split(response, [m], axis=1)
        K = D.reshape(-1, m, m) + k[is_chosen][:, None, None] * np.eye(m)
        missing_stress = forecast[far, m : 2 * m] - S
        change = np.linalg.solve(K, missing_stress[..., None])[..., 0]
        # No farther than the linearised strain itself has moved; the floor avoids 0/0.
        allowed = forecast[far, -1] / np.maximum(np.linalg.norm(change, axis=1), 1e-300)
        strain[far] += np.minimum(1, allowed)[:, None] * change
        self._respond(self._cells[is_chosen.any(axis=1)])

    def _respond(self, cells: Indices | None = None) -> None:
        """Evaluate (S, D) in some cells (or all), by the cheapest expression for all points of a cell."""
        if cells is None:
            cells = self._cells
        general, *special = self._responses
        if special:
            case = evaluate(self._case, self._strain_variable.function_space.mesh, cells)
            is_uniform = (case == case[:, :1]).all(axis=1)
            case_of_cell = np.where(is_uniform, case[:, 0], 0)
            for k, expression in enumerate(special, 1):
                self._tabulate(expression, self._response, cells[case_of_cell == k])
            cells = cells[case_of_cell == 0]
        self._tabulate(general, self._response, cells)

    def _tabulate(
        self, expression: fem.Expression, at_points: fem.Function, cells: Indices | None = None
    ) -> None:
        """Evaluate an expression at the quadrature points of some cells (or all)."""
        if cells is None:
            cells = self._cells
        tabulate(expression, at_points, cells)

    # ---- the energy balance ------------------------------------------------------------------------------

    def energy(self) -> float:
        """Stored energy [J] of the last accepted state, this rank's share."""
        return float(fem.assemble_scalar(self._energy))

    def dissipated(self) -> float:
        """Energy [J] dissipated in the step, this rank's share; asked before `commit`."""
        return float(fem.assemble_scalar(self._work))

    # ---- sensitivities ---------------------------------------------------------------------------------

    def residual_form(self, w: Expr) -> ufl.Form:
        """The forces of the converged step, ∫ S̄·De(q_mid)[w] dx, with its true strains.

        The compiled residual reads strains and stresses as numbers at points; here they are expressions,
        so that UFL can derive them with respect to anything.
        """
        at = self._at
        term = self.term
        e0 = term.measure(at.q0)
        e1 = ufl.variable(term.measure(at.q1))
        if isinstance(term, StoredEnergy):
            S_mean = self._rule.stress(term, e0, e1)
        else:
            S_mean = gradient(term.density, (e1 - e0) / at.h)
        first_variation = ufl.derivative(term.measure(at.q1), at.q1, w)
        at_middle = ufl.replace(first_variation, {at.q1: at.mid})
        return ufl.dot(S_mean, at_middle) * term.dx

    def energy_form(self) -> ufl.Form:
        """The stored energy at q1."""
        return self.term.density(self.term.measure(self._at.q1)) * self.term.dx

    @property
    def strain(self) -> Array:
        """Strains at the quadrature points, owned and ghost, flattened."""
        array: Array = self._strain_variable.x.array
        return array


def first_that_holds(cases: Sequence[tuple[Expr, Expr]]) -> Expr:
    """The number, from one, of the first case whose condition holds, or zero."""
    which: Expr = ufl.as_ufl(0.0)
    for k, (holds, _) in reversed(list(enumerate(cases, 1))):
        which = ufl.conditional(holds, float(k), which)
    return which


def with_derivative(S: Expr, e: Expr) -> Expr:
    """S and dS/de, row after row, as one vector."""
    m = S.ufl_shape[0]
    D = ufl.diff(S, e)
    return ufl.as_vector([S[i] for i in range(m)] + [D[i, j] for i in range(m) for j in range(m)])


def _vector_of(at: Coordinates) -> la.Vector:
    """An assembly vector of the space of a body, owned and ghost nodes."""
    dofmap = at.q0.function_space.dofmap
    return la.vector(dofmap.index_map, dofmap.index_map_bs)


def _largest(numbers: Iterable[Expr]) -> Expr:
    return reduce(ufl.max_value, numbers)


def quadrature_element(mesh: Any, metadata: dict[str, Any], shape: tuple[int, ...]) -> Any:
    """An element of values at the points at which a measure with this metadata is integrated."""
    return basix.ufl.quadrature_element(
        mesh.basix_cell(), value_shape=shape, degree=metadata["quadrature_degree"], scheme="default"
    )
