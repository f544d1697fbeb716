"""Forces of a medium through which a body moves: its drag dissipates, and the work of a wind is
supplied."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Array, MeshBody
from gossamer_fx.mechanics.terms.assembly import Assembly, Compiler
from gossamer_fx.mechanics.terms.loads import Loads, at_rate, rate_of


class Drags(Loads):
    """All `FilmDrag` terms of a scene.

    With the velocity v = (q1 - q0)/h of a step h δW[v] is the work of the force on the way from q0
    to q1.  In a wind u it is the sum of h δW[v - u], which is lost, and h δW[u], which is supplied.
    """

    def __init__(self, terms: Sequence[FilmDrag], system: Assembly) -> None:
        """Compile the forms of forces, of losses and of the work of the wind.  Collective.

        Args:
            terms: forces against velocities, each on one body.
            system: the equations of the scene.

        Raises:
            InputError: no C compiler was found.
        """
        coordinates = [system.coordinates[term.body] for term in terms]
        loads = []
        for term, at in zip(terms, coordinates, strict=True):
            loads.append(at_rate(term, at))
        super().__init__(loads, system)
        self.losses = [term.name for term in terms]
        # The step is a constant of the forms: another one needs no new kernel.
        self._steps = [at.h for at in coordinates]
        self._lost: list[fem.Form] = []
        self._given: list[fem.Form] = []
        for term, at in zip(terms, coordinates, strict=True):
            # Mean velocity [m/s] of the step
            v = rate_of(at)
            relative = v
            if term.wind is not None:
                relative = v - term.wind
                # What the wind does at its own velocity is supplied; the rest is lost.  The two add
                # up to the work of the force, so that the balance of energy closes exactly.
                supplied = at.h * term.work(at.mid, v, term.wind)
                self._given.append(compile_form(supplied))
            lost = -at.h * term.work(at.mid, v, relative)
            self._lost.append(compile_form(lost))

    def begin_step(self, t: float) -> None:
        # Before the loads are assembled: their velocity is a difference over this step.
        for h in self._steps:
            h.value = self._system.h
        super().begin_step(t)

    def supplied(self) -> float:
        return float(sum(fem.assemble_scalar(form) for form in self._given))

    def dissipated(self) -> Array:
        return np.array([fem.assemble_scalar(form) for form in self._lost])


@dataclass(frozen=True, eq=False)
class FilmDrag:
    """A force against the velocity v - u in a medium that moves with the wind u.

    work    δW(x, v, w) at the positions x, linear in w; δW(x, v, v - u) is never positive
    wind    u [m/s]; none: the medium is at rest
    """

    name: str
    body: MeshBody
    work: Callable[[Expr, Expr, Expr], ufl.Form]
    wind: Expr | None = None
    compiler: ClassVar[Compiler] = Drags
