"""Uniform gravity."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import ufl
from dolfinx import fem

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.parts import Part, Supplied


@dataclass(frozen=True, eq=False)
class Gravity:
    """Acceleration `g` [m/s²] of a film; δW = ∫ρt g·w dA."""

    body: Membrane
    g: tuple[float, float, float] = (0.0, 0.0, -9.80665)
    name: str = "gravity"

    def requires(self) -> Iterable[Any]:
        yield self.body

    def parts(self) -> Iterable[Part]:
        body = self.body
        g = fem.Constant(body.space.mesh, tuple(float(c) for c in self.g))
        yield Supplied(self.name, body, lambda x, w: body.area_density * ufl.dot(g, w) * body.mass_dx)
