"""Bending moment along the rim of a plate."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

import ufl
from dolfinx.mesh import meshtags

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.forms.compilation import constant
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.plate import Plate
from gossamer_fx.mechanics.terms.loads import Load


@check_arguments
@dataclass(frozen=True, eq=False)
class EdgeMoment:
    """A moment per reference length about the deformed edge of a plate: δW = ∫ m n·w,n ds.

    n is the normal of the plate, and w,n the derivative of the test function across the edge.

    Args:
        body: a plate.
        edges: name of curves on its rim.
        moment: m [N], a number or a function of time [s]; positive where it lifts the plate's rim
            towards the normal of its mesh, as positive curvature does.
        name: name in messages and output.

    Raises:
        InputError: edges inside the plate.

    Example:
        >>> gx.loads.EdgeMoment(plate, "right", moment=0.1).name
        'plate/right moment'
    """

    body: Plate
    edges: str
    _: KW_ONLY
    moment: float | Callable[[float], float]
    name: str = ""

    def __post_init__(self) -> None:
        edges = self.body.mesh.curve(self.edges, "EdgeMoment")
        check_on_all(
            self.body.comm,
            bool(self.body.mesh.edges.is_boundary[edges].all()),
            f"EdgeMoment: the group '{self.edges}' has edges inside '{self.body.name}'; "
            "name a part of its rim.",
        )
        if not self.name:
            object.__setattr__(self, "name", f"{self.body.name}/{self.edges} moment")
        check(
            callable(self.moment) or math.isfinite(self.moment),
            f"EdgeMoment '{self.name}': moment is {self.moment!r} N; "
            "give a finite number or a function of time.",
        )

    def requires(self) -> Iterable[Any]:
        yield self.body

    def terms(self, start: State) -> Iterable[Term]:
        plate = self.body
        value = self.moment
        domain = plate.mesh.domain
        edges = plate.mesh.curve(self.edges, "EdgeMoment")
        tags = meshtags(domain, 1, edges, edges * 0 + 1)
        # The normal is a quotient of polynomials, for which no degree is exact; a flat plate of
        # order 2 needs 1.
        measure = ufl.Measure("ds", domain, subdomain_data=tags, metadata={"quadrature_degree": 3})
        ds = measure(1)
        # A function of time is evaluated first by `at`, before any step.
        m = constant(domain, 0.0 if callable(value) else value)

        def at(t: float) -> None:
            """Set the moment per length [N] to its value at a time t [s]."""
            if callable(value):
                source = f"EdgeMoment '{self.name}' at t = {t:.6g} s"
                m.value = float(ask_numbers(plate.comm, source, lambda: value(t)))

        # A couple on the rotation of the edge: the slope of the virtual displacement across the
        # edge, along the normal of the deformed plate.
        def work(x: Expr, w: Expr) -> ufl.Form:
            return m * ufl.dot(plate.bending.edge_normal(x), plate.bending.slope(w)) * ds

        yield Load(self.name, plate, work, follows=True, at=at)
