"""Prescribed pressure on a film."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any, ClassVar

import ufl

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.forms.compilation import constant
from gossamer_fx.core.forms.kinematics import Expr, area_vector
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Parameter, Term
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.terms.loads import Load


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

    # Suction is a negative pressure.  1e9 Pa tears any film: a value beyond it is one in a wrong
    # unit.
    USUAL: ClassVar = {"pressure": (-1e9, 1e9, "Pa")}

    body: Membrane
    pressure: float | Callable[[float], float]
    _: KW_ONLY
    name: str = "pressure"

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        film = self.body
        value = self.pressure
        mesh = film.space.mesh
        # p [Pa] is the given pressure; `at` below sets it at a time.
        p = constant(mesh, 0.0 if callable(value) else value)
        # A function of time belongs to its user; a gradient has the number that multiplies it.
        factor = constant(mesh, 1.0) if callable(value) else None
        pressure = p if factor is None else factor * p
        # Exact: the area vector is a product of two gradients, and w has the order of the film.
        degree = 2 * (film.order - 1) + film.order
        dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": degree})

        def at(t: float) -> None:
            """Set the pressure [Pa] to its value at a time t [s]."""
            if callable(value):
                source = f"Pressure '{self.name}' at t = {t:.6g} s"
                p.value = ask_numbers(film.comm, source, lambda: value(t))

        def work(x: Expr, w: Expr) -> ufl.Form:
            """δW [J] at positions x along test functions w."""
            # The area vector is n da/dA: the integral over the mesh is one over the deformed film.
            return pressure * ufl.dot(area_vector(film.deformation(x)), w) * dx

        if factor is not None:
            scale = (Parameter("factor", "", factor),)
            yield Load(self.name, film, work, follows=True, at=at, parameters=scale)
            return
        parameters = (Parameter("pressure", "Pa", p),)
        yield Load(self.name, film, work, follows=True, parameters=parameters)
