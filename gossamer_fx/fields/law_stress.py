"""The stress of a film in its cells, for fields that are made of it."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.fields.body_shape import BodyShape
from gossamer_fx.forms.backend import interpolation_points, tabulate
from gossamer_fx.forms.compilation import compile_expression
from gossamer_fx.forms.kinematics import Expr
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.terms.discrete_gradient import EndPoint, gradient
from gossamer_fx.terms.element_energies import StoredEnergy, quadrature_element

# One point in each cell, its midpoint.
MIDPOINT = {"quadrature_degree": 1}
# Components of a strain or stress, and of a response: stress and its derivative by the strain.
STRAINS = 3
RESPONSE = STRAINS + STRAINS**2


class CellStress:
    """The stress (S11, S22, S12) [N/m] of a film at the midpoints of its cells.

    The stress of a law in UFL is the derivative of its energy.  That of a law in C is computed by the law:
    in UFL it would take minutes to compile.

    Args:
        shape: of the film.

    Attributes:
        expression: the stress, to be evaluated at the midpoints after `update`.
    """

    def __init__(self, shape: BodyShape) -> None:
        film = shape.body
        strain = shape.elastic_strain()
        self.expression: Expr
        self._has_c_law = film.law.c_law(film.constants, film.comm) is not None
        if self._has_c_law:
            self._evaluate_in_c(shape, strain)
        else:
            self.expression = gradient(film.density, strain)

    def _evaluate_in_c(self, shape: BodyShape, strain: Expr) -> None:
        """Make the law at the midpoints, and the functions that it reads and writes."""
        # Imported here: laws in UFL do not need the kernel.
        from gossamer_fx.terms.law_kernel.functions import law_functions
        from gossamer_fx.terms.law_kernel.point_law import PointLaw, PointValues

        film = shape.body
        mesh = film.space.mesh
        cells = mesh.topology.index_map(mesh.topology.dim)
        self._cells = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)

        def at_midpoints(size: int) -> fem.Function:
            element = quadrature_element(mesh, MIDPOINT, (size,))
            return fem.Function(fem.functionspace(mesh, element))

        # The law has two strains, of which the end of a step counts here.
        start = at_midpoints(STRAINS)
        self._strain = at_midpoints(STRAINS)
        response = at_midpoints(RESPONSE)
        points = interpolation_points(self._strain.function_space)
        self._strain_expression = compile_expression(strain, points)
        energy = StoredEnergy(
            film.name,
            film,
            film.measure,
            film.density,
            film.dx,
            c_law=film.law.c_law(film.constants, film.comm),
        )
        values = PointValues(
            start=start.x.array.reshape(-1, STRAINS),
            strain=self._strain.x.array.reshape(-1, STRAINS),
            response=response.x.array.reshape(-1, RESPONSE),
            rows=cell_nodes(self._strain.function_space),
        )
        functions = law_functions(energy, EndPoint(), start, self._strain)
        self._law = PointLaw(functions, values, self._cells, may_choose=False)
        self.expression = ufl.as_vector([response[i] for i in range(STRAINS)])

    def update(self) -> None:
        """Evaluate the law for the coordinates of the shape."""
        if not self._has_c_law:
            return
        tabulate(self._strain_expression, self._strain, self._cells)
        # Numbers of the law may have changed.
        self._law.begin_step()
        self._law.respond()
