"""The stiffness ψ''(e) of films at the start of each step, for losses that follow the state of the
film."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.forms.backend import interpolation_points, tabulate
from gossamer_fx.forms.compilation import compile_expression
from gossamer_fx.forms.kinematics import Expr
from gossamer_fx.forms.strain_path import gradient
from gossamer_fx.model.body import MeshBody
from gossamer_fx.model.roles import OnMeshes, StateObserver
from gossamer_fx.terms.assembly import Assembly, CompiledTerms, Compiler
from gossamer_fx.terms.element_energies import thermal_strain_of

STRAINS = 3  # E11, E22, 2 E12


class PresentStiffnesses(OnMeshes, StateObserver, CompiledTerms["PresentStiffness"]):
    """All `PresentStiffness` terms of a scene: evaluated whenever a state is accepted."""

    def __init__(self, terms: Sequence[PresentStiffness], system: Assembly) -> None:
        """Compile the stiffness C = ∂S/∂e [N/m] at the present strain, for each term.  Collective.

        Args:
            terms: each stores C at the quadrature points of one film; `commit` sets it.
            system: the equations of the scene, with coordinates and thermal strains at the start of
                a step.
        """
        self._made = []
        for term in terms:
            strain = term.measure(system.fields[term.body].q0)
            thermal = thermal_strain_of(system, term.body)
            if thermal is not None:
                strain -= thermal.start
            e = ufl.variable(strain)
            S = gradient(term.density, e)
            C = ufl.diff(S, e)
            entries = ufl.as_vector([C[i, j] for i in range(STRAINS) for j in range(STRAINS)])
            points = interpolation_points(term.values.function_space)
            cells = term.body.space.mesh.topology.index_map(2)
            every = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
            self._made.append((term, compile_expression(entries, points), every))

    def commit(self) -> None:
        for term, expression, cells in self._made:
            tabulate(expression, term.values, cells)


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
