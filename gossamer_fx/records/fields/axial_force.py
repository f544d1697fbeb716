"""Tension and strain along cables and beams: functions with values at their Gauss points."""

from __future__ import annotations

from collections.abc import Callable

import basix.ufl
import numpy as np
import ufl
from basix import LagrangeVariant
from dolfinx import fem
from mpi4py import MPI

from gossamer_fx.core.forms.backend import interpolation_points
from gossamer_fx.core.forms.compilation import compile_expression, compile_form, constant
from gossamer_fx.core.forms.kinematics import Expr, line_derivative
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.cable import Curve
from gossamer_fx.records.fields.body_shape import At, BodyShape
from gossamer_fx.solve.system.system import System


def axial_strain(shape: BodyShape) -> Expr:
    """The strain of which the tension is a function: λ - 1 of a cable, Γ of a beam.

    The initial strain is contained in it, the thermal strain is not.
    """
    return shape.body.axial_strain(shape.elastic_strain())


def tension(shape: BodyShape) -> Expr:
    """The axial force [N] of a cable or beam, negative for compression."""
    return shape.body.axial_force(shape.q_acting, shape.stress())


def stretch(shape: BodyShape) -> Expr:
    """The present length |x'| of a cable or beam over the stress-free one."""
    dq = line_derivative(shape.q)
    # Beams have directors behind the positions.
    dx = ufl.as_vector([dq[0], dq[1], dq[2]])
    return ufl.sqrt(ufl.dot(dx, dx))


class GaussValues:
    """A quantity of a cable or beam at the Gauss points of its cells, and its mean along the line.

    Elements of order 2 take their strains at two Gauss points.  Between and beyond these points
    the strain that follows from the coordinates is not that of the body: a beam that bends without
    a change of length would show tension at the nodes.  Therefore the quantity is a discontinuous
    polynomial through its values at these points.

    Args:
        quantity: function that returns the expression of the quantity on a shape, e.g. `tension`.
        at: when stresses are taken, see `body_shape`.

    Attributes:
        function: the quantity, set by `update`.
    """

    def __init__(
        self, system: System, body: Curve, quantity: Callable[[BodyShape], Expr], at: At
    ) -> None:
        """Compile the quantity; `update` computes it.  Collective."""
        self._shape = BodyShape(system, body, at)
        self._comm = system.comm
        mesh = body.mesh.domain
        element = basix.ufl.element(
            "Lagrange",
            "interval",
            body.order - 1,
            lagrange_variant=LagrangeVariant.gl_isaac,
            discontinuous=True,
        )
        self.function = fem.Function(fem.functionspace(mesh, element))
        points = interpolation_points(self.function.function_space)
        self._expression = compile_expression(quantity(self._shape), points)
        # UFL cannot integrate a plain number over a mesh: this constant of the mesh is one.
        unit = constant(mesh, 1.0)
        self._forms = [
            compile_form(self.function * body.dx),
            compile_form(unit * body.dx),
        ]

    def update(self) -> None:
        """Set the function to the accepted state, ghosts included.  Collective."""
        self._shape.update()
        self.function.interpolate(self._expression)
        self.function.x.scatter_forward()

    def mean(self) -> float:
        """The mean along the stress-free line, the same on every rank.  Collective."""
        integral = self._sum(self._forms[0])
        length = self._sum(self._forms[1])
        return integral / length

    def extremes(self) -> tuple[float, float]:
        """The least and the largest value, the same on every rank.  Collective."""
        values = self.own_values()
        least = self._comm.allreduce(float(values.min(initial=np.inf)), op=MPI.MIN)
        largest = self._comm.allreduce(float(values.max(initial=-np.inf)), op=MPI.MAX)
        return least, largest

    def own_values(self) -> Array:
        """Values (n, k) at the k Gauss points of each of the n cells that this rank owns."""
        space = self.function.function_space
        cells = space.mesh.topology.index_map(1).size_local
        return self.function.x.array[space.dofmap.list[:cells]]

    def _sum(self, form: fem.Form) -> float:
        """The integral of a form over the cells of all ranks."""
        return float(self._comm.allreduce(fem.assemble_scalar(form)))


class CurrentLength:
    """The length ∫ |x'| dS [m] of a cable or beam in the accepted state."""

    def __init__(self, system: System, body: Curve) -> None:
        """Compile the length as a form.  Collective."""
        self._shape = BodyShape(system, body)
        self._comm = system.comm
        self._form = compile_form(stretch(self._shape) * body.mass_dx)

    def __call__(self) -> float:
        """The length [m], the same on every rank.  Collective."""
        self._shape.update()
        return float(self._comm.allreduce(fem.assemble_scalar(self._form)))
