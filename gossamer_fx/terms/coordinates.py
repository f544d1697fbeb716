"""The coordinates of a body on a mesh, as functions."""

from __future__ import annotations

import ufl
from dolfinx import fem

from gossamer_fx.forms.compilation import constant


class Coordinates:
    """The coordinates of one mesh body in a step: start q0, end q1, increment δ of the iteration, step h.

    γ is how much of the geometric stiffness the tangent has: 1, or 0 in a careful start of the iteration.
    """

    def __init__(self, space: fem.FunctionSpace, alpha: float) -> None:
        self.q0, self.q1, self.δ = (fem.Function(space) for _ in range(3))
        self.α = constant(space.mesh, alpha)
        self.h = constant(space.mesh, 1.0)
        self.γ = constant(space.mesh, 1.0)
        self.mid = (1 - self.α) * self.q0 + self.α * self.q1
        self.w, self.dq = ufl.TestFunction(space), ufl.TrialFunction(space)
