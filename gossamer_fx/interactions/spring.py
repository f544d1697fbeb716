"""Springs between points."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gossamer_fx.errors import check
from gossamer_fx.parts import Part, PointStored, Port


@dataclass(frozen=True)
class Quadratic:
    """ψ(e) = ½ k e²."""

    k: float

    def energy(self, e: float) -> float:
        return self.k * e * e / 2

    def average(self, e0: float, e1: float) -> tuple[float, float]:
        return self.k * (e0 + e1) / 2, self.k / 2


@dataclass(frozen=True, eq=False)
class AxialSpring:
    """A spring to ground that feels one direction: ψ = ½ k (n·(x - x0))².

    Args:
        port: the point x.
        stiffness: k [N/m].
        direction: n; only its direction counts.
        origin: x0 [m], where the spring is at rest.
    """

    port: Port
    stiffness: float
    direction: tuple[float, float, float]
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    name: str = "spring"

    def __post_init__(self) -> None:
        check(self.stiffness > 0, f"AxialSpring '{self.name}': stiffness is {self.stiffness!r} N/m; give a positive one.")
        check(any(self.direction), f"AxialSpring '{self.name}': direction has no length; give its axis.")

    def requires(self) -> Iterable[Any]:
        yield self.port.body

    def parts(self) -> Iterable[Part]:
        n = np.asarray(self.direction, dtype=float)
        n /= np.linalg.norm(n)
        yield PointStored(
            self.name, (self.port,), np.zeros((3, 3)), n, -float(n @ np.asarray(self.origin)), Quadratic(self.stiffness)
        )
