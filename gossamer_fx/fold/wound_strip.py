"""The map `Spiral`: a strip that is folded lengthwise and wound round a hub."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, replace
from typing import ClassVar

import numpy as np

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.fold.fold_map import FoldMap
from gossamer_fx.model.body import Array

# Thickness of the roll over its radius at which mountains and valleys are distinguished: far above
# round-off, and small enough for the shape to stay the same.
AJAR = 1e-2


@check_arguments
@dataclass(frozen=True)
class Spiral(FoldMap):
    """A strip [0, length] × [0, rows pitch] folded at rows along x to a height `pitch`, and wound round a hub about z.

    Rows and columns are edges of the mesh; the strip begins at (radius, 0, 0) and winds in the sense of z, with corners
    at columns, of which `around` make a turn.  Layer λ = y/pitch is `gap` outside of the one before, and a turn
    rows + 1 gaps outside of the last one.  Corners are in line, and the outermost layer has its length: those within
    are slack.

    Args:
        length: [m].
        columns: their number.
        around: columns in a turn, at least 6.
        rows: number of panels side by side.
        pitch: their width [m].
        gap: distance of layers [m].

    Raises:
        InputError: a number is out of its range.

    Example:
        >>> folds = gx.fold.Spiral(2.0, 24, around=12, rows=4, pitch=0.05)
        >>> round(folds.radius, 3)
        0.161
    """

    called: ClassVar[str] = "fold.Spiral"
    length: float
    columns: int
    _: KW_ONLY
    around: int
    rows: int
    pitch: float
    gap: float = 0.0

    def film_sizes(self) -> tuple[float, ...]:
        return (self.length, self.rows * self.pitch)

    def __post_init__(self) -> None:
        self._check_positive("length", "pitch")
        for what, least in (("columns", 1), ("around", 6), ("rows", 1)):
            value = getattr(self, what)
            self._check(value >= least, f"{what} is {value!r}; give at least {least}.")
        self._check_not_negative("gap")
        self._check(
            self.radius > 0,
            f"gap is {self.gap:g} m: the layers leave no room for a hub; give less.",
        )

    @property
    def radius(self) -> float:
        """Of the corners of the innermost layer [m]."""
        layers = self.rows + (self.rows + 1) * self.columns / self.around
        return self.length / self.columns / 2 / math.sin(math.pi / self.around) - self.gap * layers

    def pressed(self) -> Spiral:
        return replace(self, gap=0.0)

    def ajar(self) -> Spiral:
        return _Open(**vars(self.pressed()))

    def place(self, X: Array, side: Array) -> Array:
        layer = X[:, 1] / self.pitch
        z = self.pitch * np.abs(np.remainder(layer + 1, 2) - 1)
        u = X[:, 0] / self.length * self.columns
        i = np.floor(u + 1e-9)
        part = (u - i)[:, None]
        p = (1 - part) * self._corner(i, layer) + part * self._corner(i + 1, layer)
        return np.column_stack([p, z])

    def _corner(self, i: Array, layer: Array) -> Array:
        turns = i / self.around
        r = self.radius + self.gap * (layer + (self.rows + 1) * turns)
        angle = 2 * math.pi * turns
        corner: Array = r[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return corner


class _Open(Spiral):
    """Layers are so far apart that no fold is shut."""

    def pressed(self) -> Spiral:
        return self

    def place(self, X: Array, side: Array) -> Array:
        layers = self.rows + (self.rows + 1) * self.columns / self.around
        return replace(Spiral(**vars(self)), gap=AJAR * self.radius / layers).place(X, side)
