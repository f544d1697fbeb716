"""The largest stress of a film as a smooth function, for gradients.

The largest value over the film has a kink wherever its location jumps.  A mean with a large
exponent p has not,

    J = (1/A ∫ ⟨σ⟩^p dA)^(1/p) <= max σ,    ∂J = J/p (∂F/F - ∂A/A),    F = ∫ ⟨σ⟩^p dA          (1)

with the positive part ⟨σ⟩ of the stress and the stress-free area A.  It is below the largest one by
the factor (a/A)^(1/p) if a is the area of the largest stress: by 11 % for p = 20 and a tenth of the
film.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
import ufl
from dolfinx import fem, la
from petsc4py import PETSc

from gossamer_fx.core.checks.arguments import Range, check_arguments, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.lookups import check_in_scene
from gossamer_fx.core.forms.compilation import compile_form, constant
from gossamer_fx.core.model.state import HasSystem
from gossamer_fx.mechanics.bodies.membrane import FullFilm, Membrane
from gossamer_fx.records.fields.best_surface import cells_of
from gossamer_fx.records.fields.body_shape import BodyShape
from gossamer_fx.records.fields.fields import FIELDS
from gossamer_fx.records.probes.films import MEASURES, Measure
from gossamer_fx.records.probes.objective import Objective
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import ForSystem

# Stress [Pa] over which powers are taken at first: those of any stress are then within the range of
# numbers.
USUAL_STRESS = 1e6


@check_arguments
class SmoothStress(Objective):
    """Smooth maximum of the stress of a film, (∫⟨σ⟩^p dA/A)^(1/p), as a result with derivatives.

    It is the `largest_stress` for p → ∞, and below it otherwise: ask both.

    Args:
        film: a film that is not reduced.
        exponent: p.  The larger, the nearer to the largest stress, and the less smooth.
        limit: what the material bears [Pa]; with it the result is a ratio.
        group: of cells of the film's mesh, e.g. without the corners, where the stress of the
            continuum has no bound; empty: the whole film.
        measure: "principal", the larger principal stress, or "von Mises".

    Raises:
        InputError: a number out of its range, a group that the mesh does not have; when called: the
            film is not in the scene, or has no tension.

    Example:
        >>> pulled = gx.Membrane(mesh, law, displacement=lambda X: 1e-3 * X, name="film")
        >>> equilibrium = gx.Equilibrium(gx.Scene(pulled))
        >>> smooth = gx.analysis.SmoothStress(pulled)
        >>> f"{smooth(equilibrium) / 1e6:.2f} MPa"
        '3.79 MPa'
    """

    def __init__(
        self,
        film: FullFilm,
        *,
        exponent: Annotated[float, Range(2.0, 60.0)] = 20.0,
        limit: Annotated[float, positive("Pa")] | None = None,
        group: str = "",
        measure: Measure = "principal",
    ) -> None:
        cells_of(film, group)  # refuses a group that the mesh does not have
        self.film = film
        self.unit = "Pa" if limit is None else "1"
        self._over = limit or 1.0
        self._forms = ForSystem(lambda system: _StressForms(system, film, group, measure, exponent))

    def _in(self, system: System) -> _StressForms:
        is_in_scene = self.film in system.unknowns.bodies
        check_in_scene(f"SmoothStress: '{self.film.name}'", is_in_scene)
        forms = self._forms(system)
        forms.update(self._over)
        return forms

    def __call__(self, run: HasSystem) -> float:
        """The stress [Pa], or its ratio to the limit, at the end of the last step."""
        return self._in(run.system).value / self._over

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add the derivative by the positions."""
        forces = self._in(system).slope()
        with by_position as values:
            owned = system.unknowns.block(self.film).owned
            system.unknowns.coordinates[self.film].add_forces(forces, values[owned])

    def forms(self, system: System) -> list[ufl.Form]:
        """Forms with the derivatives (1) by parameters."""
        return self._in(system).terms


class _StressForms:
    """Forms of (1) for one compiled scene.

    Attributes:
        value: J [Pa].
        terms: forms whose derivatives at given constants are those of J over the limit.
    """

    def __init__(
        self, system: System, film: Membrane, group: str, measure: Measure, exponent: float
    ) -> None:
        """Compile the forms.  Collective."""
        self._comm = system.comm
        self._shape = BodyShape(system, film, "end")
        self._exponent = exponent
        mesh = film.space.mesh
        expression = FIELDS[MEASURES[measure]].expression
        assert expression is not None
        stress = expression(self._shape)
        # Scale of the stress, and the factors of ∂F and of ∂A.
        self._scale = constant(mesh, USUAL_STRESS)
        self._of_powers = constant(mesh, 0.0)
        self._of_area = constant(mesh, 0.0)
        inside = fem.Function(fem.functionspace(mesh, ("Discontinuous Lagrange", 0)))
        inside.x.array[cells_of(film, group)] = 1.0
        inside.x.scatter_forward()
        p = constant(mesh, exponent)
        power = ufl.max_value(stress / self._scale, 0.0) ** p
        self._powers = compile_form(inside * power * film.dx)
        self._area = compile_form(inside * film.dx)
        self.terms = [self._of_powers * inside * power * film.dx, self._of_area * inside * film.dx]
        test = ufl.TestFunction(film.space)
        self._slope = compile_form(ufl.derivative(self.terms[0], self._shape.q, test))
        dofs = film.space.dofmap
        self._vector = la.vector(dofs.index_map, dofs.index_map_bs)
        self.value = 0.0

    def _sum(self, form: fem.Form) -> float:
        return float(self._comm.allreduce(fem.assemble_scalar(form)))

    def update(self, over: float) -> None:
        """Take the present state, with the derivatives of J over a limit [Pa].  Collective."""
        self._shape.update()
        area = self._sum(self._area)
        self._scale.value = USUAL_STRESS
        # With the stress itself as the scale no power is too small or too large.
        for _ in range(2):
            powers = self._sum(self._powers)
            check(powers > 0, "SmoothStress: the film has no tension, so that there is no maximum.")
            self.value = float(self._scale.value) * (powers / area) ** (1 / self._exponent)
            self._scale.value = self.value
        powers = self._sum(self._powers)
        self._of_powers.value = self.value / (self._exponent * powers * over)
        self._of_area.value = -self.value / (self._exponent * area * over)

    def slope(self) -> np.ndarray:
        """The derivative (n,) by the coordinates of this rank's nodes, ghosts included.
        Collective."""
        self._vector.array[:] = 0
        fem.assemble_vector(self._vector.array, self._slope)
        self._vector.scatter_reverse(la.InsertMode.add)
        found: np.ndarray = self._vector.array
        return found
