"""The coordinates of a body on a mesh, as functions, and how they follow from its unknowns."""

from __future__ import annotations

from collections.abc import Iterable

import ufl
from dolfinx import fem
from petsc4py import PETSc

from gossamer_fx.core.algebra.numbering import NumberedBlock
from gossamer_fx.core.forms.compilation import constant
from gossamer_fx.core.model.body import Array


class Coordinates:
    """The coordinates of one mesh body in a step, as the symbols of its forms.

    The unknowns are the values at the owned nodes; a reduced body has others, and overrides the
    three methods.

    Attributes:
        q0, q1: coordinates at the start and at the end of the step.
        δ: increment of the iteration.
        α: the forces are those at q_mid = (1 - α) q0 + α q1; ½ for the midpoint rule.
        mid: q_mid.
        h: step [s].
        γ: factor of the geometric stiffness of compressive stresses in the tangent: 1, or 0 in the
            initial iterations.
        w, dq: test and trial functions.
    """

    def __init__(self, space: fem.FunctionSpace, alpha: float) -> None:
        """Make the functions and constants of one step on the space of the coordinates: positions
        [m] and, for beams, section axes [-].  `alpha` is α.  Collective."""
        self.q0 = fem.Function(space)
        self.q1 = fem.Function(space)
        self.δ = fem.Function(space)
        # Constants, as a number in a form would be compiled into its kernel.
        self.α = constant(space.mesh, alpha)
        self.h = constant(space.mesh, 1.0)
        self.γ = constant(space.mesh, 1.0)
        self.mid = (1 - self.α) * self.q0 + self.α * self.q1
        self.w = ufl.TestFunction(space)
        self.dq = ufl.TrialFunction(space)

    def take(self, function: fem.Function, unknowns: Array) -> None:
        """Set a function, ghosts included, from this rank's unknowns of the body."""
        vector = function.x
        vector.array[: unknowns.size] = unknowns
        vector.scatter_forward()

    def add_forces(self, b: Array, forces: Array) -> None:
        """Add an assembled vector b, of owned and ghost nodes, to the forces on this rank's
        unknowns."""
        forces += b[: forces.size]

    def assemble(self, A: PETSc.Mat, forms: Iterable[fem.Form], block: NumberedBlock) -> None:
        """Add bilinear forms to the body's diagonal block of A."""
        block.assemble(A, forms)
