"""The stiffness ψ''(e) of films at the start of each step, for losses that follow the state of the
film."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, cast

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc

from gossamer_fx.core.forms.backend import interpolation_points, tabulate
from gossamer_fx.core.forms.compilation import compile_expression, compile_form
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.forms.strain_path import gradient
from gossamer_fx.core.model.body import Array, MeshBody
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
)
from gossamer_fx.mechanics.terms.element_energies import thermal_strain_of

STRAINS = 3  # E11, E22, 2 E12


class PresentStiffnesses(Differentiable, CompiledTerms["PresentStiffness"]):
    """All `PresentStiffness` terms of a scene: evaluated whenever a state is accepted."""

    reversible = False
    forces_are_forms = True

    def __init__(self, terms: Sequence[PresentStiffness], system: Assembly) -> None:
        """Compile the stiffness C = ∂S/∂e [N/m] at the present strain, for each term.  Collective.

        Such a term adds no force: it has C for the damping of a film that follows its
        stiffness. C is evaluated later, when a state is accepted.

        Args:
            terms: of the scene.
            system: the compiled scene.

        Raises:
            InputError: no C compiler was found.
        """
        self._system = system
        self._terms = terms
        self._made = []
        for term in terms:
            entries = self._entries(term, system.coordinates[term.body].q0)
            points = interpolation_points(term.values.function_space)
            cells = term.body.space.mesh.topology.index_map(2)
            every = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
            self._made.append((term, compile_expression(entries, points), every))
        # Of gradients, made at the first use.
        self._products: list[_StartProduct] | None = None

    def _entries(self, term: PresentStiffness, q: Expr) -> Expr:
        """The nine entries of C at coordinates q of the body, row by row, as a UFL vector."""
        strain = term.measure(q)
        thermal = thermal_strain_of(self._system, term.body)
        if thermal is not None:
            strain -= thermal.start
        e = ufl.variable(strain)
        C = ufl.diff(gradient(term.density, e), e)
        return ufl.as_vector([C[i, j] for i in range(STRAINS) for j in range(STRAINS)])

    def commit(self) -> None:
        for term, expression, cells in self._made:
            tabulate(expression, term.values, cells)

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
    """(∂f/∂C ∂C/∂q0)ᵀ μ of the forces f that use the stiffness C of one term, compiled.

    Args:
        term: whose stiffness it is.
        stand_in: function in place of q0, so that other parts of the forces are not derived.
        entries: of C at this function.
        system: the compiled scene, with the forms of all forces.

    Attributes:
        μ: the adjoint vector as a function on the body.
    """

    def __init__(
        self, term: PresentStiffness, stand_in: fem.Function, entries: Expr, system: Assembly
    ) -> None:
        """Compile the derivatives of all forms with C.  Collective.

        Raises:
            InputError: no C compiler was found.
        """
        self.term = term
        self.μ = fem.Function(term.body.space)
        self._stand_in = stand_in
        self._forms = []
        test = ufl.TestFunction(term.body.space)
        # All kinds are compiled when a gradient asks.
        for kind in cast(Any, system).differentiable:
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
        element = basix.ufl.quadrature_element(
            mesh.basix_cell(),
            value_shape=(STRAINS**2,),
            degree=self.dx.metadata()["quadrature_degree"],
            scheme="default",
        )
        object.__setattr__(self, "values", fem.Function(fem.functionspace(mesh, element)))

    @property
    def matrix(self) -> Expr:
        """C for forms with the measure `dx`."""
        n = STRAINS
        return ufl.as_matrix([[self.values[n * i + j] for j in range(n)] for i in range(n)])
