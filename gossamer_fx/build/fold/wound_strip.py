"""The map `Spiral`: a strip that is folded lengthwise and wound round a hub."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, replace
from typing import Annotated, ClassVar

import numpy as np

from gossamer_fx.build.fold.fold_map import FoldMap, Gap, Length
from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.model.body import Array

# Thickness of the roll over its radius at which mountains and valleys are distinguished: far above
# round-off, and small enough for the shape to stay the same.
AJAR = 1e-2

# Round-off of a point's column, in columns: a node on a column must not count as left of it.
COLUMN_ROUND_OFF = 1e-9


@check_arguments
@dataclass(frozen=True)
class Spiral(FoldMap):
    """A strip [0, length] × [0, rows pitch] folded at rows along x to a height `pitch`, and wound
    round a hub about z.

    Rows and columns are edges of the mesh; the strip begins at (radius, 0, 0) and winds in the
    sense of z, with corners at columns, of which `around` make a turn.  Layer λ = y/pitch is `gap`
    outside of the one before, and a turn rows + 1 gaps outside of the last one.  Corners are in
    line, and the outermost layer has its length: those within are slack.

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
    length: Length
    columns: Annotated[int, Range(1)]
    _: KW_ONLY
    around: Annotated[int, Range(6)]
    rows: Annotated[int, Range(1)]
    pitch: Length
    gap: Gap = 0.0

    def film_sizes(self) -> tuple[float, ...]:
        """Length and width [m] of the film that the map needs."""
        return (self.length, self.rows * self.pitch)

    def __post_init__(self) -> None:
        self._check(
            self.radius > 0,
            f"gap is {self.gap:g} m: the layers leave no room for a hub; give less.",
        )

    @property
    def radius(self) -> float:
        """Radius of the corners of the innermost layer [m]."""
        # A column of the outermost layer is a chord of its circle, and is not stretched.
        outermost = self.length / self.columns / 2 / math.sin(math.pi / self.around)
        return outermost - self.gap * self._layers

    @property
    def _layers(self) -> float:
        """Number of gaps from the innermost corner to the outermost one."""
        return self.rows + (self.rows + 1) * self.columns / self.around

    def pressed(self) -> Spiral:
        """The same fold with layers that touch."""
        return replace(self, gap=0.0)

    def ajar(self) -> Spiral:
        """The same fold, loose enough to distinguish mountains and valleys."""
        pressed = self.pressed()
        return replace(pressed, gap=AJAR * pressed.radius / pressed._layers)

    def place(self, X: Array, side: Array) -> Array:
        """In the code u is the coordinate along the strip in columns, i the column before a point,
        p (n, 2) [m] its position seen along the axis of the hub."""
        layer = X[:, 1] / self.pitch
        z = self.pitch * np.abs(np.remainder(layer + 1, 2) - 1)
        # A point lies between the columns i and i + 1, on the chord between their corners.
        u = X[:, 0] / self.length * self.columns
        i = np.floor(u + COLUMN_ROUND_OFF)
        fraction = (u - i)[:, None]
        at_column = self._corner(i, layer)
        at_next = self._corner(i + 1, layer)
        p = (1 - fraction) * at_column + fraction * at_next
        return np.column_stack([p, z])

    def _corner(self, i: Array, layer: Array) -> Array:
        """Corners (n, 2) [m] of the wound strip at whole columns i (n,), seen along the axis of the
        hub, in layers (n,) from the innermost one of the turn."""
        turns = i / self.around
        # Distance from the axis of the hub [m]
        r = self.radius + self.gap * (layer + (self.rows + 1) * turns)
        angle = 2 * math.pi * turns
        return r[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
