"""Energies and dissipation ∫ψ(e(q)) dx on meshes, by a mixed iteration.

Mixed iteration (Magisano, Leonetti & Garcea, IJNME 109 (2017) 1237, doi:10.1002/nme.5328): the strain e_chosen at the
quadrature points is a variable of its own, condensed:

    residual   ∫ (S̄(e_chosen) + D̄(e_chosen)(e(q1) - e_chosen))·De(q̄)[w] dx
    tangent    ∫ D̄ De(q1)[δ]·De(q̄)[w] + α (γ S̄ + (1-γ) S⁺)·D²e[δ, w] dx
               γ = 1 but for careful starts (see `solvers.newton`); S⁺ is the part of S̄ that pulls at rest (α = 1),
               and nothing in steps: there it costs a thrown plate half as many iterations again, and halvings
    update     e_chosen = e(q1) - ½ D²e[δ, δ]     the *linearised* strain of the last iterate

(S̄, D̄) are evaluated once an iteration, by compiled expressions, and the forms only read them.  A path that stays in one
state has an expression of its own, which costs a third to a sixth of the one for all paths.
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
from gossamer_fx.model.roles import (
    Dissipation,
    Forces,
    IterateObserver,
    OnMeshes,
    StateObserver,
    StepObserver,
    StoredEnergies,
    TangentForms,
)
from gossamer_fx.terms.assembly import Assembly, CompiledTerms
from gossamer_fx.terms.coordinates import Coordinates
from gossamer_fx.terms.discrete_gradient import StressRule

# Choice of the strain in the mixed iteration: its regularisation, as a fraction of the largest stiffness; the relative
# error of the linearised stress that triggers it; and how often in a step a point may be chosen for without that this
# error falls below a part of the last one's, as it may cycle, or creep where film is almost slack.
SURROUNDINGS, FAR, IDLE, FALLS = 0.03, 0.1, 5, 0.9


class ElementEnergies(
    OnMeshes,
    StepObserver,
    IterateObserver,
    StateObserver,
    Forces,
    TangentForms,
    StoredEnergies,
    Dissipation,
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
            force.begin()

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


@dataclass(frozen=True, eq=False)
class StoredEnergy:
    """Stored energy ∫ψ(e(q)) dx: `measure` is quadratic in q, `density` ψ is a function of the strain alone.

    `pieces` cuts the path between two strains where ψ is not smooth; `pulling` is the part of a stress of which the
    geometric stiffness is positive.
    """

    name: str
    body: MeshBody
    measure: Callable[[Expr], Expr]
    density: Callable[[Expr], Expr]
    dx: ufl.Measure
    quadratic: bool = False
    pieces: Callable[[Expr, Expr], list[Piece]] | None = None
    pulling: Callable[[Expr], Expr] | None = None
    compiler: ClassVar[type[CompiledTerms]] = ElementEnergies


@dataclass(frozen=True, eq=False)
class ViscousDissipation:
    """Dissipation: stress φ'(ė) against the rate of the measure; φ is quadratic and convex, the loss 2∫∫φ(ė) dx dt."""

    name: str
    body: MeshBody
    measure: Callable[[Expr], Expr]
    density: Callable[[Expr], Expr]
    dx: ufl.Measure
    compiler: ClassVar[type[CompiledTerms]] = ElementEnergies


class ElementForces:
    """Forces, tangent and energy of one `StoredEnergy` or `ViscousDissipation`, compiled."""

    def __init__(
        self, term: StoredEnergy | ViscousDissipation, at: Coordinates, rule: StressRule
    ) -> None:
        self.term = term
        q, δ = at.q1, at.δ
        e = term.measure(q)
        D2e_δδ = ufl.derivative(ufl.derivative(e, q, δ), q, δ)

        m = e.ufl_shape[0]
        mesh, metadata = at.q1.function_space.mesh, term.dx.metadata()
        Q = fem.functionspace(mesh, quadrature_element(mesh, metadata, (m,)))
        self._e0, self._e_chosen = fem.Function(Q), fem.Function(Q)
        self._response = fem.Function(
            fem.functionspace(mesh, quadrature_element(mesh, metadata, (m + m * m,)))
        )
        S = ufl.as_vector([self._response[i] for i in range(m)])
        D = ufl.as_matrix([[self._response[m + i * m + j] for j in range(m)] for i in range(m)])

        e_chosen = ufl.variable(self._e_chosen)
        if isinstance(term, StoredEnergy):
            S_mean = rule.stress(term, self._e0, e_chosen)
            cases = rule.cases(term, self._e0, e_chosen)
            self._energy = compile_form(term.density(self._e0) * term.dx)
        else:
            S_mean, cases = gradient(term.density, (e_chosen - self._e0) / at.h), []
            self._work = compile_form(ufl.dot(S, self._e_chosen - self._e0) * term.dx)
        points = interpolation_points(Q)
        stresses = [S_mean, *(S for _, S in cases)]  # the first serves every point
        self._responses = [
            compile_expression(with_derivative(S, e_chosen), points) for S in stresses
        ]
        if cases:
            self._case = compile_expression(first_that_holds(cases), points)
        self._strain = compile_expression(e, points)
        linearised = e - D2e_δδ / 2
        self._linearised = compile_expression(linearised, points)
        cells = mesh.topology.index_map(mesh.topology.dim)
        self._cells = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
        self._size = m
        self._switches = isinstance(term, StoredEnergy) and not term.quadratic and rule.alpha == 0.5
        if self._switches:
            self._expected = fem.Function(
                fem.functionspace(mesh, quadrature_element(mesh, metadata, (2 * m + 2,)))
            )
            change, stiffness = linearised - self._e_chosen, _largest(D[i, i] for i in range(m))
            σ = S + ufl.dot(D, change)
            numbers = [*linearised, *σ, stiffness, ufl.sqrt(ufl.dot(change, change))]
            self._expect = compile_expression(ufl.as_vector(numbers), points)
            σ = [self._expected[m + i] for i in range(m)]
            misses = _largest(abs(S[i] - σ[i]) for i in range(m))
            stress = _largest(abs(s) for i in range(m) for s in (S[i], σ[i]))
            resistance = SURROUNDINGS * ufl.max_value(stiffness, self._expected[2 * m])
            is_far = ufl.conditional(ufl.gt(misses, FAR * stress), 1.0, 0.0)
            self._resist = compile_expression(ufl.as_vector([is_far * resistance, misses]), points)
            self._missed = np.full(
                (len(self._cells), len(points)), np.inf
            )  # error of the stress where it was chosen
            self._idle = np.zeros(self._missed.shape, dtype=int)  # how often it did not fall
        self._before = self._e0.x.array.copy()
        self._known, self._chooses = 0, self._switches

        De = ufl.derivative(e, q, at.w)
        De_mid, De_dq = ufl.replace(De, {q: at.mid}), ufl.derivative(e, q, at.dq)
        D2e = ufl.derivative(De, q, at.dq)
        self.residual = compile_form(ufl.dot(S + ufl.dot(D, e - self._e_chosen), De_mid) * term.dx)
        held = at.γ * S
        if isinstance(term, StoredEnergy) and term.pulling is not None and rule.alpha == 1.0:
            held += (1 - at.γ) * term.pulling(S)
        self.tangent = compile_form(
            (ufl.dot(ufl.dot(D, De_dq), De_mid) + at.α * ufl.dot(held, D2e)) * term.dx
        )

    def begin(self) -> None:
        """Start a step: of its stress nothing is known yet."""
        self._known, self._chooses = 0, self._switches
        if self._switches:
            self._missed[:], self._idle[:] = np.inf, 0

    def commit(self) -> None:
        """End a step: the strain of its end is that of the next one's start."""
        self._before[:] = self._e0.x.array
        self._e0.x.array[:] = self._e_chosen.x.array

    def linearise(self) -> None:
        """e_chosen from the strain at the last iterate and its linear change by δ; then the stress."""
        if not self._chooses:
            self._tabulate(self._linearised, self._e_chosen)
            self._respond()
        elif not self._known:
            self._e_chosen.x.array[:] = self._before
            self._respond()
        else:
            self._choose()
        self._known += 1

    def evaluate(self) -> None:
        """e_chosen = e(q1): the true strain; then the stress."""
        self._tabulate(self._strain, self._e_chosen)
        self._respond()

    def _choose(self) -> None:
        """e_chosen between the linearised strain and the one that has the linearised stress; see the module."""
        m, mesh = self._size, self._e_chosen.function_space.mesh
        self._tabulate(self._expect, self._expected)
        expected, e = (
            self._expected.x.array.reshape(-1, 2 * m + 2),
            self._e_chosen.x.array.reshape(-1, m),
        )
        e[:] = expected[:, :m]
        self._respond()
        resistance, misses = np.moveaxis(
            evaluate(self._resist, mesh, self._cells).reshape(*self._missed.shape, 2), 2, 0
        )
        self._idle += (resistance > 0) & (misses > FALLS * self._missed)
        self._missed[:] = np.where(resistance > 0, misses, np.inf)
        is_far = (resistance > 0) & (self._idle < IDLE)
        self._chooses = self._known <= IDLE or bool(is_far.any())
        far = cell_nodes(self._e_chosen.function_space)[is_far]
        S, D = np.split(self._response.x.array.reshape(-1, m + m * m)[far], [m], axis=1)
        K = D.reshape(-1, m, m) + resistance[is_far][:, None, None] * np.eye(m)
        change = np.linalg.solve(K, (expected[far, m : 2 * m] - S)[..., None])[..., 0]
        room = expected[far, -1] / np.maximum(np.linalg.norm(change, axis=1), 1e-300)
        e[far] += np.minimum(1, room)[:, None] * change
        self._respond(self._cells[is_far.any(axis=1)])

    def _respond(self, cells: Indices | None = None) -> None:
        """(S̄, D̄) in some cells (or all), by the cheapest expression that serves all points of a cell."""
        cells, (general, *special) = self._cells if cells is None else cells, self._responses
        if special:
            case = evaluate(self._case, self._e_chosen.function_space.mesh, cells)
            case = np.where((case == case[:, :1]).all(axis=1), case[:, 0], 0)
            for k, expression in enumerate(special, 1):
                self._tabulate(expression, self._response, cells[case == k])
            cells = cells[case == 0]
        self._tabulate(general, self._response, cells)

    def _tabulate(
        self, expression: fem.Expression, at_points: fem.Function, cells: Indices | None = None
    ) -> None:
        """The expression at the quadrature points of some cells (or all)."""
        tabulate(expression, at_points, self._cells if cells is None else cells)

    def energy(self) -> float:
        """Owned share of the stored energy at the last accepted state."""
        return float(fem.assemble_scalar(self._energy))

    def dissipated(self) -> float:
        """Owned share of the energy that this part takes in the step; before `accept`."""
        return float(fem.assemble_scalar(self._work))

    @property
    def strain(self) -> Array:
        """Strains at the quadrature points, owned and ghost."""
        array: Array = self._e_chosen.x.array
        return array


def first_that_holds(cases: Sequence[tuple[Expr, Expr]]) -> Expr:
    """The number, from one, of the first case whose condition holds, or zero."""
    which: Expr = ufl.as_ufl(0.0)
    for k, (holds, _) in reversed(list(enumerate(cases, 1))):
        which = ufl.conditional(holds, float(k), which)
    return which


def with_derivative(S: Expr, e: Expr) -> Expr:
    """S and dS/de, row after row, as one vector."""
    m, D = S.ufl_shape[0], ufl.diff(S, e)
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
