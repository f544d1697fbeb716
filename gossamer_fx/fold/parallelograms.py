"""Miura's fold."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from gossamer_fx.fold.fold_map import FoldMap
from gossamer_fx.model.terms import Array


@dataclass(frozen=True)
class Miura(FoldMap):
    """Miura's fold of a sheet into parallelograms with sides a and b and an angle γ between them.

    On the flat sheet the lines x = i b sin γ are straight, those across run in zigzag through the points
    (i b sin γ, j a + b cos γ (i odd)).  Parallelograms make an angle θ with the plane; then

        height  H = a sin θ sin γ                     along y  L = a √(1 - sin²θ sin²γ)
        along x  S = b cos θ tan γ/√(1 + cos²θ tan²γ)   shift  V = b/√(1 + cos²θ tan²γ)

    Args:
        a, b: sides [m], a along y.
        gamma: γ [rad], between 0 and π/2.
        theta: θ [rad], above 0 (flat) and below π/2 (pressed shut).

    Raises:
        InputError: numbers out of these ranges.

    Source: Schenk & Guest, Proc. Natl. Acad. Sci. 110 (2013) 3276, doi:10.1073/pnas.1217998110, equations 1 to 4.
    """

    called: ClassVar[str] = "fold.miura"
    a: float
    b: float
    gamma: float
    theta: float

    def __post_init__(self) -> None:
        self._check_positive("a", "b")
        for what in ("gamma", "theta"):
            value = getattr(self, what)
            self._check(0 < value < math.pi / 2, f"{what} is {value!r} rad; give a number between 0 and π/2.")

    @cached_property
    def sizes(self) -> tuple[float, float, float, float]:
        """H, S, L, V [m]."""
        c, s, g = math.cos(self.theta), math.sin(self.theta) * math.sin(self.gamma), math.tan(self.gamma)
        root = math.sqrt(1 + (c * g) ** 2)
        return self.a * s, self.b * c * g / root, self.a * math.sqrt(1 - s * s), self.b / root

    def place(self, X: Array, side: Array) -> Array:
        H, S, L, V = self.sizes
        u = X[:, 0] / (self.b * math.sin(self.gamma))
        v = (X[:, 1] - self.b * math.cos(self.gamma) * _wave(u)) / self.a
        return np.stack([S * u, L * v + V * _wave(u), H * _wave(v)], axis=1)

    def pressed(self) -> Miura:
        return replace(self)


def _wave(u: Array) -> Array:
    """The triangular wave: 0 at even numbers, 1 at odd ones."""
    wave: Array = 1 - np.abs(np.remainder(u, 2) - 1)
    return wave
