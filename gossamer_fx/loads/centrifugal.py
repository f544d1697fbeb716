"""A body seen from a frame that turns with it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import ufl
from dolfinx import fem

from gossamer_fx.errors import check
from gossamer_fx.kinematics import Expr
from gossamer_fx.parts import Kinetic, MeshBody, Part, Supplied


@dataclass(frozen=True, eq=False)
class Centrifugal:
    """Centrifugal force in a frame that turns about the origin; δW = ∫ρ ((ω×x)×ω)·w.

    For equilibria of spinning films and cables and the modes about them; `modes` adds the Coriolis force.

    Args:
        body: a film or cable, whose coordinates are positions.
        spin: ω [rad/s].
    """

    body: MeshBody
    spin: tuple[float, float, float]
    name: str = "centrifugal"

    def __post_init__(self) -> None:
        check(
            self.body.block.size == 3,
            f"Centrifugal '{self.name}': '{self.body.name}' has directors; only films and cables are taken.",
        )

    def requires(self) -> Iterable[Any]:
        yield self.body

    def parts(self) -> Iterable[Part]:
        ω = fem.Constant(self.body.space.mesh, tuple(float(c) for c in self.spin))
        for part in self.body.parts():
            if isinstance(part, Kinetic):
                yield Supplied(self.name, self.body, _work(part, ω), follows=True)


def _work(inertia: Kinetic, ω: Expr) -> Any:
    return lambda x, w: inertia.mass(ufl.cross(ufl.cross(ω, x), ω), w)
