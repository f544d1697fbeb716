"""Damping of films, plates, cables and beams, off unless it is an item of the scene; its loss
counts as dissipated.

With `tension_only` a film loses energy in proportion to the stiffness ψ''(e) that it has at the
start of each step, see `PresentStiffness`; ψ is the energy density of the strains e.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated, Any, ClassVar

import ufl
from dolfinx import fem, la
from petsc4py import PETSc

from gossamer_fx.core.checks.arguments import check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.relations import at_most_one, both_or_none, some
from gossamer_fx.core.forms.cell_loops import tabulation
from gossamer_fx.core.forms.compilation import compile_form, constant
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import energy_gradient
from gossamer_fx.core.model.body import Array, MeshBody
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import OnBody, Parameter, Term
from gossamer_fx.mechanics.bodies.beam import Beam
from gossamer_fx.mechanics.bodies.cable import Cable
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
)
from gossamer_fx.mechanics.terms.element_energies import (
    ViscousDissipation,
    quadrature_element,
    thermal_strain_of,
)

Body = Membrane | Cable | Beam


@check_arguments(
    both_or_none("loss_factor", "frequency"),
    at_most_one("stiffness_factor", "loss_factor"),
    some("mass_factor", "stiffness_factor", "loss_factor"),
)
@dataclass(frozen=True, eq=False)
class Damping(OnBody):
    """Mass- and stiffness-proportional damping of a film, plate, cable or beam; its loss counts as
    dissipated.

    A mode of angular frequency ω loses the fraction ζ = α/(2ω) + β ω/2 of critical damping; its
    loss factor is η = 2 ζ.  A loss factor that does not depend on the frequency is
    `gx.loads.flat_damping`.

    Args:
        body: a film, plate, cable or beam.
        mass_factor: α [1/s]; force -α ρt v per area, or -α μ v per length.  It slows every motion,
            rigid ones, too.
        stiffness_factor: β [s]; stress β C Ė with the elastic matrix C of the taut film, cable or
            beam (Kelvin-Voigt).  Rigid motions are free.  The bending of a plate is not damped.
        loss_factor: η in place of β, at the `frequency`: β = η/(2π f).  Of films see
            `gossamer_fx.presets.films`.
        frequency: f [Hz], of the motion that is to be damped as measured; slower ones lose less,
            faster ones more.
        tension_only: whether C is the stiffness ψ''(e) that a film has at the start of each step:
            in full where it is taut, along the folds where it is wrinkled, nearly zero where it is
            slack.
        name: name in messages and output.

    Raises:
        InputError: factors that are negative or both zero, a loss factor without a frequency or
            with a stiffness factor, `tension_only` of another body than a film or without a
            stiffness factor.

    Example:
        >>> gx.Damping(film, stiffness_factor=1e-4, tension_only=True).name
        'damping'
        >>> f"{gx.Damping(film, loss_factor=0.01, frequency=1e3).damping_time:.2g} s"
        '1.6e-06 s'
    """

    body: Body
    _: KW_ONLY
    mass_factor: Annotated[float, not_negative("1/s")] = 0.0
    stiffness_factor: Annotated[float, not_negative("s")] = 0.0
    loss_factor: Annotated[float, positive()] | None = None
    frequency: Annotated[float, positive("Hz")] | None = None
    tension_only: bool = False
    name: str = "damping"

    def __post_init__(self) -> None:
        what = f"Damping '{self.name}'"
        check(
            not self.tension_only or (isinstance(self.body, Membrane) and self.damping_time > 0),
            f"{what}: tension_only is for the stiffness damping of films; "
            "leave it out, or give both.",
        )

    @property
    def damping_time(self) -> float:
        """β [s], given as `stiffness_factor` or by the loss factor."""
        if self.loss_factor is None or self.frequency is None:
            return self.stiffness_factor
        return self.loss_factor / (2 * math.pi * self.frequency)

    def terms(self, start: State) -> Iterable[Term]:
        """Dissipation by the mass and by the stiffness, for factors above zero; with `tension_only`
        also the stiffness of the film at the start of each step, as a term."""
        body = self.body
        both = self.mass_factor > 0 and self.damping_time > 0
        # Two terms need two names in the energy balance; one alone keeps that of the item.
        by_mass = f"{self.name} (mass)" if both else self.name
        by_stiffness = f"{self.name} (stiffness)" if both else self.name
        if self.mass_factor > 0:
            # Constants, so that other factors need no new kernel.
            α = constant(body.space.mesh, self.mass_factor)
            inertia = ufl.as_vector(_inertia(body))
            yield ViscousDissipation(
                by_mass,
                body,
                lambda x: x,
                lambda v: α / 2 * sum(inertia[i] * v[i] ** 2 for i in range(len(inertia))),
                body.mass_dx,
                parameters=(Parameter("mass_factor", "1/s", α),),
            )
        if self.damping_time > 0:
            β = constant(body.space.mesh, self.damping_time)
            factor = (Parameter("stiffness_factor", "s", β),)
            if self.tension_only and isinstance(body, Membrane):
                stiffness = PresentStiffness(body, body.measure, body.density, body.dx)
                yield stiffness
                C = stiffness.matrix
                viscous = lambda e_rate: β / 2 * ufl.dot(e_rate, ufl.dot(C, e_rate))  # noqa: E731
                yield ViscousDissipation(by_stiffness, body, body.measure, viscous, body.dx, factor)
                return
            # The energy ψ of the taut body at the rates of its measures: β ψ(ė) is the dissipation
            # potential of the Kelvin-Voigt stress β C ė.
            measure, energy = _unwrinkled(body)
            yield ViscousDissipation(
                by_stiffness,
                body,
                measure,
                lambda e_rate: β * energy(e_rate),
                body.dx,
                factor,
                discrete_derivative=body.discrete_derivative,
            )


def _inertia(body: Body) -> list[Expr]:
    """Inertia, per area of a film or per length of the mesh of a cable or beam, of each of a node's
    numbers: [kg/m²] or [kg/m] for the position, [kg m] for the directors of a beam."""
    if isinstance(body, Membrane):
        return [body.area_density] * 3
    c = body.constants
    if isinstance(body, Cable):
        return [body.per_mesh_length(c.line_density)] * 3
    # Of the position and both directors of a beam's section.
    return [c.line_density] * 3 + [c.rotary2] * 3 + [c.rotary3] * 3


def _unwrinkled(body: Body) -> tuple[Callable[[Expr], Expr], Callable[[Expr], Expr]]:
    """The strain measure of a body, a function of positions [m], and its stored energy as it is in
    tension, a function of the measure: per area [J/m²] of films, per length of the mesh [J/m] of
    cables and beams."""
    if isinstance(body, Membrane):
        # A wrinkled film would have no stiffness across its wrinkles, and their flutter no damping.
        linear = body.law.unwrinkled()
        return body.measure, lambda e: linear.energy(e, body.constants)
    if isinstance(body, Cable):
        stiffness = body.per_mesh_length(body.constants.EA)
        return body.measure, lambda e: stiffness / 2 * e[0] ** 2
    return body.measure, body.density


STRAINS = 3  # E11, E22, 2 E12


def stiffness_entries(density: Callable[[Expr], Expr], strain: Expr) -> Expr:
    """The nine entries of the stiffness ψ''(e) [N/m] of a film of energy density ψ at a strain e
    (3,), row by row."""
    e = ufl.variable(strain)
    C = ufl.diff(energy_gradient(density, e), e)
    return ufl.as_vector([C[i, j] for i in range(STRAINS) for j in range(STRAINS)])


def matrix_of(entries: Any) -> Expr:
    """The matrix (3, 3) of nine entries, row by row."""
    n = STRAINS
    return ufl.as_matrix([[entries[n * i + j] for j in range(n)] for i in range(n)])


class PresentStiffnesses(Differentiable, CompiledTerms["PresentStiffness"]):
    """All `PresentStiffness` terms of a scene: evaluated whenever a state is accepted."""

    reversible = False
    forces_are_forms = True

    def __init__(self, terms: Sequence[PresentStiffness], system: Assembly) -> None:
        """Compile the stiffness C = ∂S/∂e [N/m] of each term, for the damping of a film that
        follows its stiffness; it is evaluated when a state is accepted, and adds no force.
        Collective."""
        self._system = system
        self._terms = terms
        # Functions that fill `values` of each term.
        self._evaluations = []
        for term in terms:
            entries = self._entries(term, system.coordinates[term.body].q0)
            self._evaluations.append(tabulation(entries, term.values))
        # Of gradients, made at the first use.
        self._products: list[_StartProduct] | None = None

    def _entries(self, term: PresentStiffness, q: Expr) -> Expr:
        """The nine entries of C at coordinates q of the body, row by row, as a UFL vector."""
        strain = term.measure(q)
        thermal = thermal_strain_of(self._system, term.body)
        if thermal is not None:
            strain -= thermal.start
        return stiffness_entries(term.density, strain)

    def commit(self) -> None:
        """Evaluate C in the accepted state, the start of the next step."""
        for evaluate in self._evaluations:
            evaluate()

    # ---- sensitivities ---------------------------------------------------------------------------

    def expressions(self) -> dict[fem.Function, Expr]:
        found = {}
        for term in self._terms:
            found[term.values] = self._entries(term, self._system.coordinates[term.body].q0)
        return found

    def exchange_ends(self) -> None:
        """Keep C: that of the reversed step is the one of the step."""

    def add_start_derivatives(
        self, μ: PETSc.Vec, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add (∂f/∂C ∂C/∂q0)ᵀ μ of the forces f that use the stiffness C of the start of the step.
        Collective."""
        system = self._system
        if self._products is None:
            self._products = []
            for term in self._terms:
                stand_in = fem.Function(term.body.space)
                entries = self._entries(term, stand_in)
                self._products.append(_StartProduct(term, stand_in, entries, system))
        for product in self._products:
            body = product.term.body
            owned = system.block(body).owned
            at = system.coordinates[body]
            at.take(product.μ, μ.array_r[owned])
            forces = product.assemble(at.q0)
            with by_position as values:
                at.add_forces(forces, values[owned])


class _StartProduct:
    """(∂f/∂C ∂C/∂q0)ᵀ μ of the forces f that use the stiffness C of one term, compiled; μ is the
    adjoint vector as a function on the body."""

    def __init__(
        self, term: PresentStiffness, stand_in: fem.Function, entries: Expr, system: Assembly
    ) -> None:
        """Compile the derivatives of all forms with C; `stand_in` is a function in place of q0, so
        that other parts of the forces are not derived, and `entries` those of C at it.  Collective.
        """
        self.term = term
        self.μ = fem.Function(term.body.space)
        self._stand_in = stand_in
        self._forms = []
        test = ufl.TestFunction(term.body.space)
        # Gradients make this object: all kinds have compiled their forms by then.
        for kind in system.compiled:
            if not isinstance(kind, Differentiable):
                continue
            for form in kind.residual_forms(term.body, self.μ):
                if any(function is term.values for function in form.coefficients()):
                    with_entries = ufl.replace(form, {term.values: entries})
                    self._forms.append(compile_form(ufl.derivative(with_entries, stand_in, test)))
        dofs = term.body.space.dofmap
        self._vector = la.vector(dofs.index_map, dofs.index_map_bs)

    def assemble(self, q0: fem.Function) -> Array:
        """Return the product on the nodes of this rank, owned and ghost; q0 at the start."""
        self._stand_in.x.array[:] = q0.x.array
        self._vector.array[:] = 0
        for form in self._forms:
            fem.assemble_vector(self._vector.array, form)
        self._vector.scatter_reverse(la.InsertMode.add)
        return self._vector.array


@dataclass(frozen=True, eq=False)
class PresentStiffness:
    """C = ψ''(e) at the quadrature points of a body in the accepted state, as a matrix (3, 3) for
    forms."""

    body: MeshBody
    measure: Callable[[Expr], Expr]
    density: Callable[[Expr], Expr]
    dx: ufl.Measure
    values: Any = field(init=False)
    compiler: ClassVar[Compiler] = PresentStiffnesses

    def __post_init__(self) -> None:
        """Make the function that stores the stiffness C (3, 3) [N/m], as nine numbers, at the
        quadrature points of `dx`.
        """
        mesh = self.body.space.mesh
        element = quadrature_element(mesh, self.dx.metadata(), (STRAINS**2,))
        object.__setattr__(self, "values", fem.Function(fem.functionspace(mesh, element)))

    @property
    def matrix(self) -> Expr:
        """C for forms with the measure `dx`."""
        return matrix_of(self.values)
