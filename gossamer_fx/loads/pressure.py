"""Prescribed pressure on a film."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

import ufl

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.checks.user_functions import ask_numbers
from gossamer_fx.forms.compilation import constant
from gossamer_fx.forms.kinematics import area_vector
from gossamer_fx.model.parameters import Parameter
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.loads import Load


@check_arguments
@dataclass(frozen=True, eq=False)
class Pressure:
    """A pressure along the deformed normal of a film: δW = p ∫n·w da.

    Args:
        body: a film or plate.
        pressure: p [Pa], positive along the normal of the mesh; a number or a function of time [s].
        name: name in messages and output.

    Raises:
        InputError: a number that is not finite.

    Example:
        >>> gx.Pressure(film, lambda t: 100.0 * min(t, 1.0)).name
        'pressure'
    """

    # suction is a negative pressure
    USUAL: ClassVar = {"pressure": (-1e9, 1e9, "Pa")}

    body: Membrane
    pressure: float | Callable[[float], float]
    _: KW_ONLY
    name: str = "pressure"

    def __post_init__(self) -> None:
        check(
            callable(self.pressure) or math.isfinite(self.pressure),
            f"Pressure '{self.name}': pressure is {self.pressure!r} Pa; give a finite number or a function of time.",
        )

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        film, value = self.body, self.pressure
        p = constant(film.space.mesh, 0.0 if callable(value) else value)
        dx = ufl.Measure(
            "dx", film.space.mesh, metadata={"quadrature_degree": 2 * (film.order - 1) + film.order}
        )

        def at(t: float) -> None:
            if callable(value):
                p.value = ask_numbers(
                    film.comm, f"Pressure '{self.name}' at t = {t:.6g} s", lambda: value(t)
                )

        yield Load(
            self.name,
            film,
            lambda x, w: p * ufl.dot(area_vector(film.deformation(x)), w) * dx,
            follows=True,
            at=at if callable(value) else None,
            parameters=() if callable(value) else (Parameter("pressure", "Pa", p),),
        )
