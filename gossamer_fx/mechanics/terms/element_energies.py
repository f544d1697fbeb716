"""Energies and dissipation ∫ψ(e(q)) dx on meshes, solved by a mixed iteration in strains.

Problem.  A film's strain is quadratic in the coordinates.  Newton's iteration on the coordinates
alone sees, after each update, stresses of the second-order strain that the update brings with it.
In a stiff, thin film they are many times the stresses of the solution, and the iteration zigzags.

Idea (D. Magisano, L. Leonetti & G. Garcea, Int. J. Numer. Meth. Eng. 109 (2017) 1237).  The strain
ê at the quadrature points is a separate unknown, which is condensed at each point.  In the next
iterate ê follows the *linearised* strain, so that the second-order part never produces stress.  At
convergence ê is the true strain, and the solution is that of the original equations.

Algorithm, for one iteration.  S(ê) is the stress of the step by the stress rule
(`terms.discrete_gradient`), D = dS/dê, and w any variation of the coordinates.

1. Residual, with the stress S + D (e(q1) - ê) that is linear about ê:

       ∫ (S + D (e(q1) - ê))·De(q_mid)[w] dx                                                     (1)

2. Tangent:

       ∫ D De(q1)[δ]·De(q_mid)[w] + α (γ S + (1-γ) S⁺)·D²e[δ, w] dx                              (2)

   γ is the share of the geometric stiffness: 1, except in initial iterations without it (see
   `solvers.newton`).  S⁺ is the tensile part of S at rest, and zero in time steps.  In time
   steps S⁺ would cost a thrown plate 50 % more iterations, and rejected steps.
3. Solve for the update δ of the coordinates.  The strain linearised about the last iterate is

       e_lin = e(q1) - ½ D²e[δ, δ]                                                               (3)

   after the update.  It is ê of the next iteration, except where the strain is chosen.
4. Choice of strains, in laws with several states.  Where a film changes its state, the linearised
   stress

       σ = S + D (e_lin - ê)                                                                     (4)

   of a point may be far from the stress of the linearised strain.  There the new ê is chosen
   between two strains, e_lin and that which has the stress σ:

       (D + k I)(ê - e_lin) = σ - S(e_lin),    |ê - e_lin| <= |e_lin - ê_before|                 (5)

   with k a fraction of the largest stiffness.  Stiff points then follow the strain, soft points the
   stress.
5. Evaluate S and D at the new ê once at all points.  The forms of 1 and 2 only read them.

How S and D are evaluated.  Compiled expressions, of which a path that stays in one state of the
film (taut, wrinkled or slack) has a separate one; it costs a third to a sixth of the general one.
Laws with several states are evaluated by a C kernel (`terms.law_kernel`), which also chooses the
strains.  Both, and the residual, are loops of `forms.cell_loops`, without copies of functions.

Terms that share a measure.  The stiffness and the viscous damping of a film have the same measure
e. The forms (1) and (2) are linear in S and D, so such terms share one form of the sum of their
stresses: a cell then has one kernel and one entry into the matrix, and not one for each term.
Viscous stresses are linear in the strain, so that (1) has the stress at e(q1) whatever ê is.  The
forms compute them from the strains of the term that they share the form with; nothing more is
stored for them.

Cost.  The law is evaluated once at each point and iteration, as in Newton's method on the
coordinates. ê, S and D are stored: 15 numbers at each quadrature point of a film.  (5) is one
linear system of the size of the strain at each point that asks for it.

Limits.  (3) is exact for quadratic measures.  Those of beams, which are not, are linearised at the
last iterate, and have a discrete derivative in place of De(q_mid).  The choice of strains changes
the iterates and not the solution: at its end ê = e(q1) to the tolerance of the iteration.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc
from ufl.algorithms.renumbering import renumber_indices

from gossamer_fx.core.checks.errors import InputError
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.forms.cell_loops import assembly, tabulation
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import Piece, energy_gradient, with_derivative
from gossamer_fx.core.model.body import Array, Body, MeshBody
from gossamer_fx.core.model.terms import Parameter
from gossamer_fx.mechanics.materials.film import ROUND_OFF, CLaw
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
)
from gossamer_fx.mechanics.terms.coordinates import Coordinates
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule

if TYPE_CHECKING:
    from gossamer_fx.mechanics.terms.law_kernel import PointLaw
    from gossamer_fx.mechanics.terms.thermal_strain import ThermalStrain


class ElementEnergies(Differentiable, CompiledTerms["StoredEnergy | ViscousDissipation"]):
    """All `StoredEnergy` and `ViscousDissipation` terms of a scene.

    Attributes:
        relaxes: whether stresses follow from strains by rates of history variables.
    """

    relaxes: ClassVar[bool] = False
    forces_are_forms = True
    has_shape_derivative = True

    def __init__(
        self, terms: Sequence[StoredEnergy | ViscousDissipation], system: Assembly
    ) -> None:
        """Compile forces, tangents and energies of all terms on meshes.  Collective."""
        self._system = system
        self._stored: list[StoredForces] = []
        self._viscous: list[ViscousForces] = []
        for term in terms:
            at = system.coordinates[term.body]
            if isinstance(term, StoredEnergy):
                self._stored.append(StoredForces(term, at, system.rule))
            else:
                self._viscous.append(self._viscous_forces(term, at, system.rule))
        self.elements: list[ElementForces] = [*self._stored, *self._viscous]
        self._forms: list[ElementForms] = []
        # One vector for each body, its array, and what assembles all of its terms to it.
        arrays: dict[Body, Any] = {}
        self._vectors: list[tuple[Coordinates, slice, la.Vector, Array]] = []
        for body in dict.fromkeys(term.body for term in terms):
            at = system.coordinates[body]
            dofmap = at.q0.function_space.dofmap
            b = la.vector(dofmap.index_map, dofmap.index_map_bs)
            arrays[body] = b.array
            self._vectors.append((at, system.block(body).owned, b, arrays[body]))
        self._assemble: list[Callable[[], None]] = []
        for alike in _with_one_measure(self.elements):
            _share_strains(alike)
            at = system.coordinates[alike[0].term.body]
            forms = ElementForms(alike, at, system.rule)
            self._forms.append(forms)
            self._assemble.append(assembly(forms.residual, arrays[forms.body]))
        self.losses = [force.term.name for force in self._viscous]

    def _viscous_forces(
        self, term: ViscousDissipation, at: Coordinates, rule: StressRule
    ) -> ViscousForces:
        """The stresses of a term; `loads.branches` overrides this for those with history."""
        return ViscousForces(term, at, rule)

    def begin_step(self, t: float) -> None:
        for at, _, _, _ in self._vectors:
            at.h.value = self._system.h
        for force in self._stored:
            force.begin_step(self._system.time + self._system.h)

    def take_time(self, t: float) -> None:
        """Take the thermal strains at the end of a step, t [s]."""
        for force in self._stored:
            if force.thermal is not None:
                force.thermal.set_end(t)

    def update(self, linearly: bool) -> None:
        """Set the strains ê of the iterate q1: `linearly` those of the mixed iteration, else the
        true ones."""
        for force in self._stored:
            if linearly:
                force.linearise()
            else:
                force.evaluate()

    def branches_of(self, body: MeshBody) -> list[Any]:
        """The forces of branches of a body, as of one that relaxes, whose stresses fields add."""
        return []

    def add_forces(self, r: PETSc.Vec) -> None:
        """Add the internal forces of all terms on meshes at the present iterate to the residual.
        Collective."""
        for _, _, _, array in self._vectors:
            array[:] = 0
        for force in self._stored:
            force.respond()
        for assemble in self._assemble:
            assemble()
        values = r.array
        for at, owned, b, array in self._vectors:
            b.scatter_reverse(la.InsertMode.add)
            at.add_forces(array, values[owned])

    def tangent_forms(self, body: Body) -> list[fem.Form]:
        for force in self._stored:
            if force.term.body is body:
                force.respond()
        return [forms.tangent for forms in self._forms if forms.body is body]

    def inadmissible(self) -> str:
        for force in self._stored:
            if force.term.area_vector is None:
                continue
            if self._system.comm.allreduce(force.overturned_area()) > 0:
                return f"cells of '{force.term.body.name}' have turned over"
        return ""

    def dissipated(self) -> Array:
        # The pseudo-time of a search for rest is none in which a power acts.
        if self._system.rule.is_static:
            return np.zeros(len(self._viscous))
        return np.array([force.dissipated() for force in self._viscous])

    def supplied(self) -> float:
        """Work [J] of heat on thermal strains in the step, this rank's share."""
        return sum(force.heat() for force in self._stored)

    def commit(self) -> None:
        for force in self._stored:
            force.commit()

    def energies(self) -> dict[str, float]:
        """This rank's share of the stored energy [J] of the last accepted state, by name."""
        return {force.term.name: force.energy() for force in self._stored}

    def without_gradient(self) -> str:
        """Laws that are written in C have no derivatives, and therefore no gradient in time
        steps."""
        # At rest the stress is the derivative of the density, which is in UFL for all laws.
        if self._system.rule.is_static:
            return ""
        for force in self._stored:
            if force.term.c_law is not None:
                return (
                    f"the law of '{force.term.name}' is written in C, without derivatives; "
                    "use one of UFL"
                )
        return ""

    def unstrained_films(self) -> list[str]:
        """Names of films with several states that have points without strain in the accepted state,
        where the stress has a kink: it has no derivative by the positions there.  Collective."""
        found = [force.term.name for force in self._stored if force.has_unstrained_points()]
        names: list[str] = self._system.comm.allreduce(found)
        return sorted(set(names))

    def residual_forms(self, body: Body, w: Expr) -> list[ufl.Form]:
        return [force.residual_form(w) for force in self.elements if force.term.body is body]

    def energy_forms(self, body: Body) -> list[ufl.Form]:
        return [force.energy_form() for force in self._stored if force.term.body is body]


# De(q0, q1)[w] (m,) of a measure that is not quadratic, a function of q0, q1 and w: it is e1 - e0
# for w = q1 - q0, and zero for w = ω × ½(q0 + q1), so that forces have no moment.
DiscreteDerivative = Callable[[Expr, Expr, Expr], Expr]


@dataclass(frozen=True, eq=False)
class StoredEnergy:
    """Stored energy ∫ψ(e(q)) dx: `measure` is quadratic in q, or has a `discrete_derivative`;
    `density` ψ is a function of the strain alone.

    `pieces` cuts the path between two strains where ψ is not smooth; `pulling` is the part of a
    stress of which the geometric stiffness is positive; `c_law` computes stresses in place of
    derivatives of `density`; `thermal` is subtracted from the measure; `parameters` are
    coefficients of the density and of the thermal strain; `area_vector` of a film at q, if the film
    must not turn over within a step.
    """

    name: str
    body: MeshBody
    measure: Callable[[Expr], Expr]
    density: Callable[[Expr], Expr]
    dx: ufl.Measure
    quadratic: bool = False
    pieces: Callable[[Expr, Expr], list[Piece]] | None = None
    pulling: Callable[[Expr], Expr] | None = None
    discrete_derivative: DiscreteDerivative | None = None
    c_law: CLaw | None = None
    thermal: ThermalStrain | None = None
    parameters: tuple[Parameter, ...] = ()
    area_vector: Callable[[Expr], Expr] | None = None
    compiler: ClassVar[Compiler] = ElementEnergies


@dataclass(frozen=True, eq=False)
class ViscousDissipation:
    """Dissipation: stress φ'(ė) against the rate of the measure; φ is quadratic and convex, the
    loss 2∫∫φ(ė) dx dt.

    `measure` is quadratic in q, or has a `discrete_derivative`; `density` is φ as a function of its
    rate; `parameters` are coefficients of φ.
    """

    name: str
    body: MeshBody
    measure: Callable[[Expr], Expr]
    density: Callable[[Expr], Expr]
    dx: ufl.Measure
    parameters: tuple[Parameter, ...] = ()
    discrete_derivative: DiscreteDerivative | None = None
    compiler: ClassVar[Compiler] = ElementEnergies


class ElementForces(ABC):
    """Stresses of one term on a mesh, in UFL.

    Attributes:
        measure: the measure (m,) of the term at the configuration q of its strain: q1, or q_mid if
            the stress rule asks for the strain there.
        S: stress (m,) at the quadrature points at the strain ê.
        D: its derivatives (m, m) by that strain.
        linear_stress: S + D (e(q) - ê).
    """

    term: StoredEnergy | ViscousDissipation
    measure: Expr
    S: Expr
    D: Expr
    linear_stress: Expr

    @abstractmethod
    def residual_form(self, w: Expr) -> ufl.Form:
        """The forces of the converged step, ∫ S_mean·De(q_mid)[w] dx [J], with its true strains.
        The compiled residual reads strains and stresses as numbers at points; here they are
        expressions, so that UFL can derive them with respect to anything."""


class ViscousForces(ElementForces):
    """Stresses and loss of one `ViscousDissipation`, with the damping stress

        σ = φ'((e - e0)/h)

    for the strain e and that of the start of the step, e0; h is the length of the step.
    """

    term: ViscousDissipation

    def __init__(self, term: ViscousDissipation, at: Coordinates, rule: StressRule) -> None:
        """Write the stresses down, and compile the loss.  Collective."""
        self.term = term
        self._at = at
        self._rule = rule
        self.measure = term.measure(at.q1)
        self._set_stresses(_linearised(term, self.measure, at), term.measure(at.q0))
        change = self.measure - term.measure(at.q0)
        self._work = compile_form(self._loss(change) * term.dx)

    def share_strains(self, stored: StoredForces) -> None:
        """Use the strains at the quadrature points that a stored energy with the same measure
        keeps."""
        self._set_stresses(stored.strain_variable, stored.strain_at_start)

    def _set_stresses(self, strain: Expr, start: Expr) -> None:
        """Set S, D and the linear stress from the strain ê (m,), which is linear in the last
        update, and e0 (m,), at the start of the step."""
        change = ufl.variable(strain - start)
        σ = self._stress(change)
        self.S = σ
        self.D = ufl.diff(σ, change)
        self.linear_stress = self._stress(self.measure - start)

    def _stress(self, change: Expr) -> Expr:
        """The damping stress of a change of strain within the step, to which it is proportional."""
        return energy_gradient(self.term.density, change / self._at.h)

    def _loss(self, change: Expr) -> Expr:
        """The loss of a change of strain within the step, per unit of the mesh."""
        return ufl.dot(self._stress(change), change)

    def dissipated(self) -> float:
        """Energy [J] dissipated in the step, this rank's share; asked before the step is
        accepted."""
        return float(fem.assemble_scalar(self._work))

    def residual_form(self, w: Expr) -> ufl.Form:
        at = self._at
        at_middle = _variation(self.term, at, w, self._rule)
        change = self.measure - self.term.measure(at.q0)
        return ufl.dot(self._stress(change), at_middle) * self.term.dx


class StoredForces(ElementForces):
    """Strains, stresses and energy of one `StoredEnergy`, compiled.

    Attributes:
        strain_variable: ê (m,) at the quadrature points.
        strain_at_start: strain (m,) there at the start of the step.
        thermal: thermal strain that is subtracted from the measure of the term; None without
            expansion.
    """

    term: StoredEnergy

    def __init__(self, term: StoredEnergy, at: Coordinates, rule: StressRule) -> None:
        """Compile strains, stresses and energy; residual and tangent are those of `ElementForms`.
        Collective."""
        self.term = term
        self._at = at
        self._rule = rule
        self.thermal: ThermalStrain | None = term.thermal
        self.measure = term.measure(at.mid if rule.takes_mid_strain else at.q1)
        e = self._acting_strain()
        self._size = m = e.ufl_shape[0]
        mesh = at.q1.function_space.mesh
        self._metadata = term.dx.metadata()

        # Strains at the quadrature points: at the start of the step, at its present iterate (ê),
        # and at the start of the step before.
        self.strain_at_start = self._at_points(mesh, m)
        self.strain_variable = self._at_points(mesh, m)
        self._strain_before = self.strain_at_start.x.array.copy()
        # Stress S (m,) of the step and its derivatives D (m, m) by the strain at its end, row after
        # row, and whether they are those of the present ê.
        self._has_response = False
        self._response = self._at_points(mesh, m + m * m)
        self.S = ufl.as_vector([self._response[i] for i in range(m)])
        self.D = ufl.as_matrix(
            [[self._response[m + i * m + j] for j in range(m)] for i in range(m)]
        )
        self.linear_stress = self.S + ufl.dot(self.D, e - self.strain_variable)

        # Before the law, so that a missing compiler is not blamed on this body.
        self._set_true_strain = tabulation(e, self.strain_variable)
        # Only laws with several states need the kernel, and the choice of strains.
        self._law: PointLaw | None = None
        strain = ufl.variable(self.strain_variable)
        if term.quadratic:
            stress = rule.stress(term, self.strain_at_start, strain)
            self._set_response = tabulation(with_derivative(stress, strain), self._response)
            self._energy = compile_form(term.density(self.strain_at_start) * term.dx)
        else:
            self._compile_law(term, rule, mesh)
        if self.thermal is not None:
            expansion = self.thermal.end - self.thermal.start
            self._work_of_expansion = compile_form(ufl.dot(self.linear_stress, expansion) * term.dx)
        # The start of the next step, where that is not ê of the step that is solved.
        self._set_strain_of_end: Callable[[], None] | None = None
        if rule.takes_mid_strain:
            self._set_strain_of_end = tabulation(self._strain_at_end(), self.strain_at_start)
        if term.area_vector is not None:
            turn = ufl.inner(term.area_vector(at.q0), term.area_vector(at.q1))
            is_over = ufl.conditional(ufl.lt(turn, 0.0), 1.0, 0.0)
            self._overturned = compile_form(is_over * term.dx)
        linear_strain = self.strain_variable if self._law is None else self._linear_strain
        self._set_linear_strain = tabulation(_linearised(term, e, at), linear_strain)

    def _acting_strain(self) -> Expr:
        """Strain (m,) whose stress acts, at q1 or q_mid: the measure less the thermal strain."""
        if not self._rule.takes_mid_strain:
            return self._strain_at_end()
        if self.thermal is None:
            return self.measure
        return self.measure - (self.thermal.start + self.thermal.end) / 2

    def _strain_at_end(self) -> Expr:
        """The measure of the term at q1, less the thermal strain."""
        measure = self.term.measure(self._at.q1)
        if self.thermal is None:
            return measure
        return measure - self.thermal.end

    def _at_points(self, mesh: Any, *shape: int) -> fem.Function:
        """A function with values of a shape at each quadrature point."""
        element = quadrature_element(mesh, self._metadata, shape)
        return fem.Function(fem.functionspace(mesh, element))

    def _compile_law(self, term: StoredEnergy, rule: StressRule, mesh: Any) -> None:
        """Compile the C kernel of a law with several states, as taut, wrinkled and slack, and its
        energy.  `RuntimeError`: dolfinx numbers quadrature points differently than the kernel
        expects."""
        from gossamer_fx.mechanics.terms.law_kernel import (
            PointLaw,
            PointValues,
            law_functions,
        )

        m = self._size
        rows = cell_nodes(self.strain_variable.function_space)
        # The kernel uses the same rows for all of its arrays.  The strain at the start of the step
        # is `strain_at_start`, that of the iterate `strain_variable`.
        if not np.array_equal(rows, cell_nodes(self._response.function_space)):
            raise RuntimeError("dolfinx numbers the points of strains and responses differently.")
        values = PointValues(
            start=self.strain_at_start.x.array.reshape(-1, m),
            strain=self.strain_variable.x.array.reshape(-1, m),
            response=self._response.x.array.reshape(-1, m + m * m),
            rows=rows,
        )
        try:
            functions = law_functions(term, rule, self.strain_at_start, self.strain_variable)
        except InputError as error:
            # The rule knows neither the body nor its law.
            raise InputError(f"'{term.body.name}': {error}") from error
        self._law = PointLaw(
            functions,
            values,
            np.arange(len(rows), dtype=np.int32),
            # At rest the pseudo-time steps are short enough without the choice.
            may_choose=not rule.acts_at_end,
        )
        self._linear_strain = self._at_points(mesh, m)
        self._linear_strains = self._linear_strain.x.array.reshape(-1, m)
        density = self._at_points(mesh)
        self._set_density = self._law.density_in(density.x.array)
        self._energy = compile_form(density * term.dx)

    # ---- the course of a step --------------------------------------------------------------------

    def overturned_area(self) -> float:
        """Undeformed area [m²] of this rank's film whose other side the step shows, for terms with
        an `area_vector`."""
        return float(fem.assemble_scalar(self._overturned))

    def begin_step(self, end: float) -> None:
        """Start a step that ends at the time `end` [s], with the thermal strain there."""
        if self.thermal is not None:
            self.thermal.set_end(end)
        if self._law is not None:
            self._law.begin_step()

    def commit(self) -> None:
        """Take the strain at the end of the accepted step as that at the start of the next one."""
        self._strain_before[:] = self.strain_at_start.x.array
        if self._set_strain_of_end is None:
            self.strain_at_start.x.array[:] = self.strain_variable.x.array
        else:
            self._set_strain_of_end()
        if self.thermal is not None:
            self.thermal.commit()

    def linearise(self) -> None:
        """Set the strain ê at the quadrature points for the next iterate of Newton's method.

        It follows from the strain of the last iterate and its linear change.  A law with several
        states (taut, wrinkled, slack) chooses ê and evaluates stresses here; for others stresses
        are evaluated when they are needed.
        """
        if self._law is not None:
            # The first guess is the strain of the last step's start: a film that flutters
            # alternates from step to step.
            self._law.linearise(
                linear_strain=self._linearised_strains,
                first_guess=lambda: self._strain_before.reshape(-1, self._size),
            )
            self._has_response = True
            return
        self._set_linear_strain()
        self._has_response = False

    def evaluate(self) -> None:
        """Set ê to the true strain of q1."""
        self._set_true_strain()
        self._has_response = False

    def respond(self) -> None:
        """Evaluate stress S and its derivative D by the strain at all quadrature points, once for
        one strain.

        They are stored, m + m² numbers a point for m strains, in the unit of the density (per area
        [N/m], per length [N]), for residual and tangent.  States that are only accepted or
        restored, as in the reversed run of a gradient, need strains and no stresses.
        """
        if self._has_response:
            return
        self._has_response = True
        if self._law is not None:
            self._law.respond()
        else:
            self._set_response()

    def _linearised_strains(self) -> Array:
        """The strains (q, m) linearised about the last iterate."""
        self._set_linear_strain()
        return self._linear_strains

    # ---- the energy balance ----------------------------------------------------------------------

    def energy(self) -> float:
        """Stored energy [J] of the last accepted state, this rank's share."""
        if self._law is not None:
            self._set_density()
        return float(fem.assemble_scalar(self._energy))

    def heat(self) -> float:
        """Energy [J] that heat supplies in the step, -∫ S_mean·Δe_th dx; this rank's share."""
        if self.thermal is None:
            return 0.0
        self.respond()
        return -float(fem.assemble_scalar(self._work_of_expansion))

    # ---- sensitivities ---------------------------------------------------------------------------

    def residual_form(self, w: Expr) -> ufl.Form:
        # Strains that the rule takes (e0 and e1), without thermal strain.
        at = self._at
        term = self.term
        e0 = term.measure(at.q0)
        if self.thermal is not None:
            e0 -= self.thermal.start
        e1 = ufl.variable(self._acting_strain())
        S_mean = self._rule.stress(term, e0, e1)
        return ufl.dot(S_mean, _variation(term, at, w, self._rule)) * term.dx

    def energy_form(self) -> ufl.Form:
        """The stored energy at q1."""
        return self.term.density(self._strain_at_end()) * self.term.dx

    def has_unstrained_points(self) -> bool:
        """Whether the law has several states, and this rank a point without strain, also none that
        was given at first, at the start of the step."""
        if self._law is None or getattr(self.term.body, "initial_strain", None) is not None:
            return False
        strains = self.strain_at_start.x.array.reshape(-1, self._size)
        return bool((np.abs(strains).max(axis=1) < ROUND_OFF).any())

    @property
    def strain(self) -> Array:
        """ê at the quadrature points, owned and ghost, flattened."""
        return self.strain_variable.x.array


class ElementForms:
    """Residual and tangent of terms that have one measure and domain of integration on one body, as
    one form each: (1) and (2) of the module with the sums of S, D and S + D (e - ê) of the terms.
    """

    def __init__(self, forces: Sequence[ElementForces], at: Coordinates, rule: StressRule) -> None:
        """Compile residual and tangent of the mixed iteration, in which the strain is a separate
        unknown.  Collective."""
        term = forces[0].term
        self.body = term.body
        stored = [force for force in forces if isinstance(force, StoredForces)]
        # Thermal strain does not depend on the coordinates, so that all terms have these
        # variations.
        in_step = _variation(term, at, at.w, rule)
        along_update = ufl.derivative(forces[0].measure, at.q1, at.dq)
        S = _sum([force.S for force in forces])
        D = _sum([force.D for force in forces])
        stress = _sum([force.linear_stress for force in forces])
        self.residual = compile_form(ufl.dot(stress, in_step) * term.dx)
        stress_in_tangent = at.γ * S
        for force in stored:
            if force.term.pulling is not None and rule.is_static:
                stress_in_tangent += (1 - at.γ) * force.term.pulling(force.S)
        material = ufl.dot(ufl.dot(D, along_update), in_step)
        geometric = ufl.dot(stress_in_tangent, ufl.derivative(in_step, at.q1, at.dq))
        self.tangent = compile_form((material + geometric) * term.dx)


def _with_one_measure(elements: Sequence[ElementForces]) -> list[list[ElementForces]]:
    """Group terms on the same body that have equal measures and domains of integration.  Measures
    are compared as UFL expressions: those of a film and of its damping are different functions in
    Python.  Damping takes the strain at q1 with every stress rule."""
    groups: list[list[ElementForces]] = []
    for force in elements:
        alike = next((group for group in groups if _is_alike(group[0], force)), None)
        if alike is None:
            groups.append([force])
        else:
            alike.append(force)
    return groups


def _share_strains(alike: Sequence[ElementForces]) -> None:
    """Let viscous stresses read the strains at the points that a stored energy keeps, if one has
    their measure.  The strain of a heated body does not serve: it is the measure less the thermal
    strain."""
    stored = [force for force in alike if isinstance(force, StoredForces)]
    if not stored or stored[0].thermal is not None:
        return
    for force in alike:
        if isinstance(force, ViscousForces):
            force.share_strains(stored[0])


def _is_alike(one: ElementForces, other: ElementForces) -> bool:
    """Whether two terms may share residual and tangent."""
    if one.term.body is not other.term.body or one.term.dx != other.term.dx:
        return False
    # UFL gives the free indices of each expression new numbers.
    return renumber_indices(one.measure) == renumber_indices(other.measure)


def _variation(
    term: StoredEnergy | ViscousDissipation, at: Coordinates, w: Expr, rule: StressRule
) -> Expr:
    """De[w] (m,) of the measure of a term, with De[q1 - q0] = e1 - e0 if the rule conserves energy:
    for quadratic measures that is De(q_mid)."""
    if term.discrete_derivative is not None and rule.conserves:
        return term.discrete_derivative(at.q0, at.q1, w)
    first_variation = ufl.derivative(term.measure(at.q1), at.q1, w)
    return ufl.replace(first_variation, {at.q1: at.mid})


def _sum(expressions: Sequence[Expr]) -> Expr:
    """The sum of one or more UFL expressions, without a zero in front."""
    return sum(expressions[1:], expressions[0])


def _linearised(term: StoredEnergy | ViscousDissipation, e: Expr, at: Coordinates) -> Expr:
    """The strain (3) of the module, which is linear in the last update δ of q1, of a strain e (m,)
    of q1.  A measure that is not quadratic is evaluated where the update began."""
    if term.discrete_derivative is None:
        second_variation = ufl.derivative(ufl.derivative(e, at.q1, at.δ), at.q1, at.δ)
        return e - second_variation / 2
    linear = e + ufl.derivative(e, at.q1, at.δ)
    return ufl.replace(linear, {at.q1: at.q1 - at.δ})


def thermal_strain_of(system: Assembly, body: Body) -> ThermalStrain | None:
    """The thermal strain of a body in a compiled scene; None without thermal expansion."""
    for term in system.terms:
        if isinstance(term, StoredEnergy) and term.body is body and term.thermal is not None:
            return term.thermal
    return None


def quadrature_element(mesh: Any, metadata: dict[str, Any], shape: tuple[int, ...]) -> Any:
    """An element of values at the points at which a measure with this metadata is integrated."""
    return basix.ufl.quadrature_element(
        mesh.basix_cell(), value_shape=shape, degree=metadata["quadrature_degree"], scheme="default"
    )
