"""Forces of a medium through which a body moves: its drag dissipates, and the work of a wind is supplied."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.forms.compilation import compile_form
from gossamer_fx.forms.kinematics import Expr
from gossamer_fx.model.body import Array, MeshBody
from gossamer_fx.model.roles import Dissipation
from gossamer_fx.terms.assembly import Assembly, Compiler
from gossamer_fx.terms.loads import Loads, at_rate, rate_of


class Drags(Loads, Dissipation):
    """All `FilmDrag` terms of a scene.

    With the velocity v = (q1 - q0)/h of a step h δW[v] is the work of the force on the way from q0 to q1.  In a wind u
    it is the sum of h δW[v - u], which is lost, and h δW[u], which is supplied.
    """

    def __init__(self, terms: Sequence[FilmDrag], system: Assembly) -> None:
        at = [system.fields[term.body] for term in terms]
        super().__init__(
            [at_rate(term, place) for term, place in zip(terms, at, strict=True)], system
        )
        self.losses, self._steps = [term.name for term in terms], [place.h for place in at]
        self._lost: list[fem.Form] = []
        self._given: list[fem.Form] = []
        for term, place in zip(terms, at, strict=True):
            h, x, v, u = place.h, place.mid, rate_of(place), term.wind
            self._lost.append(compile_form(-h * term.work(x, v, v if u is None else v - u)))
            if u is not None:
                self._given.append(compile_form(h * term.work(x, v, u)))

    def begin_step(self, t: float) -> None:
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
