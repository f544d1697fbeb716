"""Loads on mesh bodies, compiled: their force at q̄ and their work over a step."""

from __future__ import annotations

import ufl
from dolfinx import fem, la

from gossamer_fx.forms.compilation import compile_form
from gossamer_fx.model.terms import Array, Load
from gossamer_fx.terms.discrete_gradient import Coordinates


class LoadForces:
    """A `Load` part, compiled: its force at q̄ and its work over the step."""

    def __init__(self, part: Load, at: Coordinates) -> None:
        self.part, self._at = part, at
        δW = part.work(at.mid, at.w)
        self.form = compile_form(δW)
        self.tangent = compile_form(-ufl.derivative(δW, at.q1, at.dq)) if part.follows else None
        dofmap = at.q0.function_space.dofmap
        self.force = la.vector(dofmap.index_map, dofmap.index_map_bs)
        self._changes = part.follows or part.at is not None
        self._assembled = False

    def assemble(self) -> None:
        if self._changes or not self._assembled:
            self.force.array[:] = 0
            fem.assemble_vector(self.force.array, self.form)
            self.force.scatter_reverse(la.InsertMode.add)
            self._assembled = True

    def path_average(self) -> Array:
        """The force whose product with Δq is the work of the step, owned and ghost.

        The midpoint rule does its work with the force at q̄.  Of a force at the end of the step, the work along the
        straight path is taken, by Simpson's rule: exact for forces that are at most cubic in q, such as pressure.
        """
        end: Array = self.force.array.copy()
        α = self._at.α
        if not self.part.follows or α.value != 1:
            return end
        average = end / 6
        for weight, place in ((1 / 6, 0.0), (4 / 6, 0.5)):
            α.value = place
            self.assemble()
            average += weight * self.force.array
        α.value = 1.0
        self.force.array[:] = end
        return average
