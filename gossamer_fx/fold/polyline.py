"""Strips, sheets and flat tubes bent along rows of edges: accordions and rolls."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.fold.fold_map import FoldMap
from gossamer_fx.model.body import Array, Indices

# Share of the length: points that differ by less are the same.
SAME = 1e-7
# Share of its angles at which the mountains and valleys of an accordion are distinguished: no fold is
# shut then.
AJAR = 0.5

# Largest number of rows at which a strip is bent: each is solved for.
MAX_BENDS = 100_000


@dataclass(frozen=True)
class Bent:
    """A line along x that is bent at `corners` (m,) [m]: piece i, of m + 1, rises against the x axis by rise[i] [rad].

    Before the first corner it begins at the origin.
    """

    corners: Array
    rise: Array

    @cached_property
    def _knots(self) -> tuple[Array, Array, Array]:
        """Coordinates x (m + 1,) on the straight line where pieces begin, there (m + 1, 2), and tangents (m + 1, 2)."""
        t = np.stack([np.cos(self.rise), np.sin(self.rise)], axis=1)
        x = np.concatenate([[0.0], self.corners])
        return x, np.vstack([[0.0, 0.0], np.cumsum(np.diff(x)[:, None] * t[:-1], axis=0)]), t

    def at(self, x: Array) -> tuple[Array, Array]:
        """Positions (n, 2) of points x (n,) of the straight line, and unit normals; at corners the mean of both."""
        begin, there, t = self._knots
        tiny = SAME * max(float(np.abs(begin).max()), float(np.abs(x).max(initial=0.0)))
        i = np.clip(np.searchsorted(begin, x + tiny, side="right") - 1, 0, len(t) - 1)
        before = np.clip(np.searchsorted(begin, x - tiny, side="right") - 1, 0, len(t) - 1)
        normal = np.stack([-t[i, 1] - t[before, 1], t[i, 0] + t[before, 0]], axis=1)
        size = np.linalg.norm(normal, axis=1, keepdims=True)
        return there[i] + (x - begin[i])[:, None] * t[i], normal / np.where(size > 1e-9, size, 1.0)


@dataclass(frozen=True)
class Strip(FoldMap):
    """What accordions and rolls have in common: a `length` [m] along x from x = 0, and the room between two sheets.

    Nothing but a sheet on each side of it differs from the isometric `pressed` map.
    """

    length: float

    @property
    def bent(self) -> Bent:
        """The bent line of the strip."""
        raise NotImplementedError

    def place(self, X: Array, side: Array) -> Array:
        p, normal = self.bent.at(X[:, 0])
        p = p + (side * self.thickness(X))[:, None] * normal
        return np.stack([p[:, 0], X[:, 1], p[:, 1] + side * self.shift(X)], axis=1)

    def film_sizes(self) -> tuple[float, ...]:
        return (self.length,)

    def thickness(self, X: Array) -> Array:
        """Half of the distance (n,) [m] of the sheets."""
        return np.zeros(len(X))

    def shift(self, X: Array) -> Array:
        """By how much (n,) [m] the upper sheet is moved along z, and the lower one against it."""
        return np.zeros(len(X))

    def label(self, X: Array) -> Indices:
        corners = self.bent.corners
        nearest: Indices = np.abs(X[:, :1] - corners).argmin(axis=1).astype(np.int32) + 1
        return nearest

    def _check_strip(self, lengths: tuple[str, ...]) -> None:
        self._check_positive("length")
        self._check_not_negative(*lengths)
        opened = any(getattr(self, what, 0.0) for what in ("opening", "lift"))
        self._check(
            not opened or getattr(self, "width", 0.0) > 0,
            "sheets that are opened need the width of the film.",
        )

    def _across(self, X: Array) -> Array:
        """One on the centre line, zero at the seams |y| = width/2."""
        result: Array = np.cos(np.pi * np.clip(X[:, 1] / getattr(self, "width", 1.0), -0.5, 0.5))
        return result


@check_arguments
@dataclass(frozen=True)
class Zigzag(Strip):
    """Accordion of equal panels in a strip, a sheet or a flat tube along x, folded at rows of edges across.

    Panels rise and fall in turn by `angle` against the x axis: each fold has the angle 2 `angle`, and the strip is
    length cos(angle) long.  With `bends` > 1 a fold is bent at so many rows, `spacing` apart: a fold with a radius.

    Two sheets are opened to a pillow between folds, and where they are folded shifted against each other across the
    panels, so that the outer one lies round the inner one; both vanish at seams and ends.  That costs strain energy of
    the order (opening/width)⁴ and (lift/width)².

    Args:
        length: of the strip [m].
        panels: their number.
        angle: [rad], between 0 (flat) and π/2 (pressed shut, which contact does not allow).
        width: of a tube that is pressed flat, from seam to seam [m].
        opening: half of the largest distance of the sheets between folds [m].
        lift: half of their distance along z at the folds, on the centre line [m].
        bends: rows at which each fold is bent.
        spacing: distance of these rows [m].

    Raises:
        InputError: a number is out of its range, or folds overlap.

    Example:
        >>> folds = gx.fold.Zigzag(0.8, 4, angle=1.4, width=0.05, opening=1e-4)
        >>> flat = np.array([[0.8, 0.0, 0.0]])
        >>> round(float(folds.pressed().place(flat, np.zeros(1))[0, 0]), 3)
        0.136
    """

    called: ClassVar[str] = "fold.Zigzag"
    panels: int = 2
    _: KW_ONLY
    angle: float = 1.4
    width: float = 0.0
    opening: float = 0.0
    lift: float = 0.0
    bends: int = 1
    spacing: float = 0.0

    def __post_init__(self) -> None:
        self._check_strip(("width", "opening", "lift", "spacing"))
        self._check(self.panels >= 2, f"panels is {self.panels!r}; give at least 2.")
        self._check(
            0 < self.angle <= math.pi / 2,
            f"angle is {self.angle!r} rad; give a number above 0 and up to π/2, at which panels are pressed shut.",
        )
        self._check(
            1 <= self.bends <= MAX_BENDS,
            f"bends is {self.bends!r}; give between 1 and {MAX_BENDS}.",
        )
        self._check(
            (self.spacing > 0) == (self.bends > 1),
            "spacing is the distance of several bends; give both or none.",
        )
        self._check(
            (self.bends - 1) * self.spacing < self.length / self.panels,
            f"{self.bends} bends of {self.spacing:g} m take more than a panel of {self.length / self.panels:g} m; give "
            "less.",
        )

    @cached_property
    def bent(self) -> Bent:
        """The bent line of the strip."""
        rows = (np.arange(self.bends) - (self.bends - 1) / 2) * self.spacing
        folds = self.length * np.arange(1, self.panels) / self.panels
        sense = (-1.0) ** np.arange(self.panels - 1)  # up, then down
        part = 1 - 2 * np.arange(1, self.bends + 1) / self.bends
        rise = np.concatenate([[1.0], np.outer(sense, part).ravel()])
        return Bent((folds[:, None] + rows).ravel(), self.angle * rise)

    def pressed(self) -> Zigzag:
        return replace(self, opening=0.0, lift=0.0)

    def ajar(self) -> Zigzag:
        return replace(self, angle=AJAR * self.angle)

    def thickness(self, X: Array) -> Array:
        if not self.opening:
            return np.zeros(len(X))
        along = np.abs(np.sin(np.pi * X[:, 0] / self.length * self.panels))
        return self.opening * along * self._across(X)

    def shift(self, X: Array) -> Array:
        if not self.lift:
            return np.zeros(len(X))
        ramp = np.clip(np.minimum(X[:, 0], self.length - X[:, 0]) / self.length * self.panels, 0, 1)
        return self.lift * ramp * self._across(X)

    def label(self, X: Array) -> Indices:
        return np.asarray((super().label(X) - 1) // self.bends + 1, dtype=np.int32)


@check_arguments
@dataclass(frozen=True)
class Roll(Strip):
    """A strip or flat tube along x rolled up about y, its end x = length inside; bent at equally spaced rows of edges.

    The piece before the first bend lies along the x axis.  Radii grow from `radius` by `pitch` a turn.

    Two sheets are apart by twice `opening` between seams and ends.  They differ in length then: an opening of 0.1 mm
    costs some mJ.

    Args:
        length: of the strip [m].
        bends: number of rows at which it is bent: at `flat` and equally spaced from there to its end.
        radius: of the innermost turn [m].
        pitch: radial distance from turn to turn [m].
        flat: length that stays straight [m]; default one spacing of the rows, length/(bends + 1).
        width: of a tube that is pressed flat, from seam to seam [m].
        opening: half of the distance of the sheets [m].

    Raises:
        InputError: a number is out of its range, or rows are farther apart than two thirds of the
            radius.

    Example:
        >>> folds = gx.fold.Roll(0.5, 100, radius=0.02, pitch=1e-3)
        >>> folded = folds.place(np.array([[0.5, 0.0, 0.0]]), np.zeros(1))
    """

    called: ClassVar[str] = "fold.Roll"
    bends: int = 10
    _: KW_ONLY
    radius: float = 0.02
    pitch: float = 2e-3
    flat: float | None = None
    width: float = 0.0
    opening: float = 0.0

    def __post_init__(self) -> None:
        self._check_strip(("radius", "pitch", "width", "opening"))
        self._check(
            1 <= self.bends <= MAX_BENDS,
            f"bends is {self.bends!r}; give between 1 and {MAX_BENDS}.",
        )
        self._check(
            self.flat is None or 0 < self.flat < self.length,
            f"flat is {self.flat!r} m; give a part of the length, above zero.",
        )
        spacing = float(np.diff(self._rows).max())
        self._check(
            self.radius > 0 and spacing <= 2 * self.radius / 3,
            f"rows {spacing:.3g} m apart do not go round a radius of {self.radius:g} m; give more bends or a larger "
            "radius.",
        )

    @property
    def _rows(self) -> Array:
        """Rows at which it is bent, and the end (bends + 1,)."""
        flat = self.length / (self.bends + 1) if self.flat is None else self.flat
        return np.linspace(flat, self.length, self.bends + 1)

    @cached_property
    def bent(self) -> Bent:
        """The bent line of the strip."""
        rows = self._rows
        turn, turns = 0.0, []  # of the pieces, from the innermost one
        for edge in np.diff(rows)[::-1]:
            turns.append(turn)
            turn += 2 * math.asin(edge / 2 / (self.radius + self.pitch * turn / (2 * math.pi)))
        return Bent(rows[:-1], turn - np.array([turn, *turns[::-1]]))

    def pressed(self) -> Roll:
        return replace(self, opening=0.0)

    def thickness(self, X: Array) -> Array:
        if not self.opening:
            return np.zeros(len(X))
        ramp = np.clip(np.minimum(X[:, 0], self.length - X[:, 0]) / (self.length / 10), 0, 1)
        return self.opening * ramp * self._across(X)
