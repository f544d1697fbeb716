"""Sails of n trapezoids, each folded to a strip, in arms between them: the fold of IKAROS."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.fold.fold_map import FoldMap
from gossamer_fx.model.body import Array

# By how much a turn back is shorter than the one that encloses it, over the distance of layers.
STAGGER = 5.0
# Thickness of the layers over the radius of the hub at which mountains and valleys are distinguished:
# far above round-off, and small enough for the shape to stay the same.
AJAR = 1e-2


@check_arguments
@dataclass(frozen=True)
class Ikaros(FoldMap):
    """n trapezoids round a hub, each folded at rows parallel to its edges into a strip that stands on edge.

    With s along the rows of a trapezoid, y their distance from the centre and C the strip's line round the hub and out,

        x = (C(s) + η(s, y) n(s), zigzag(y))

    C has corners at columns of the mesh: 2 `bends` chords on the hub, then a radial arm, which two trapezoids share
    (n = 4 is the cross of IKAROS), or an arm that is `wound` on, round the hub.  Layers are η = gap (y/pitch -
    |s|/column) from the seam, on the hub with `hub_gap` for `gap`.  Their corners there are in line, and the outermost
    layer has its length: those within, nearer to the hub, are slack.  Edges of the mesh of
    `gossamer_fx.meshes.sails.trapezoids` are on all fold lines.

    Args:
        n: trapezoids, at least 3.
        inner, outer: rows of the inner and outer edges, which are inner pitch and outer pitch from the centre.
        pitch: between folds [m].
        bends: corners on the hub between the middle of a trapezoid and its end; less than `inner`.
        gap: distance of the layers of an arm [m].
        hub_gap: distance of the layers on the hub [m].
        ramp: length of an arm in which the one grows to the other [m].
        wound: whether the arms go on round the hub, all towards greater angles, as before they were let out: `hub_gap`
            is then the distance of all layers.  One half of each arm turns back where it leaves its own trapezoid.
        out: columns of the tips that stand out from the roll.

    Raises:
        InputError: a number is out of its range.

    Example:
        >>> folds = gx.fold.Ikaros(4, 4, outer=12, pitch=0.05, bends=2)
        >>> round(folds.radius, 3)
        0.128
    """

    called: ClassVar[str] = "fold.Ikaros"
    n: int
    inner: int
    _: KW_ONLY
    outer: int
    pitch: float
    bends: int = 2
    gap: float = 0.0
    hub_gap: float = 0.0
    ramp: float = 1.0
    wound: bool = False
    out: int = 0

    def __post_init__(self) -> None:
        self._check(self.n >= 3, f"n is {self.n!r}; give at least 3 trapezoids.")
        self._check(
            0 < self.inner < self.outer,
            f"rows from {self.inner!r} to {self.outer!r}; give inner above 0, below outer.",
        )
        self._check(
            1 <= self.bends < self.inner,
            f"bends is {self.bends!r}; give at least 1 and less than inner, {self.inner!r}.",
        )
        self._check(
            0 <= self.out < self._arm,
            f"out is {self.out!r}; give at least 0 columns, less than an arm's {self._arm}.",
        )
        self._check(
            self.wound or not self.out, "out is of arms that are wound; give wound=True, too."
        )
        self._check_positive("pitch", "ramp")
        self._check_not_negative("gap", "hub_gap")
        self._check(
            self.radius > 0,
            f"hub_gap is {self.hub_gap:g} m: the layers leave no room for a hub; give less.",
        )

    @property
    def column(self) -> float:
        """Distance of columns along a row [m]."""
        return math.tan(math.pi / self.n) * self.pitch

    @property
    def radius(self) -> float:
        """Of the corners of the innermost layer on the hub [m]."""
        layers = self._height_of_roll if self.wound else self.outer
        return self.column / 2 / math.sin(math.pi / self.n / self.bends / 2) - self.hub_gap * layers

    def pressed(self) -> Ikaros:
        return replace(self, gap=0.0, hub_gap=0.0)

    def ajar(self) -> Ikaros:
        return _Tilted(**vars(self.pressed()))

    def place(self, X: Array, side: Array) -> Array:
        k = np.round((np.arctan2(X[:, 1], X[:, 0]) + np.pi / 2) / (2 * np.pi / self.n))
        c, d = np.cos(2 * np.pi * k / self.n), np.sin(2 * np.pi * k / self.n)
        s, y = c * X[:, 0] + d * X[:, 1], d * X[:, 0] - c * X[:, 1]
        row = y / self.pitch
        z = self._height(row - self.inner)
        u = s / self.column
        i = np.floor(u + 1e-9)
        part = (u - i)[:, None]
        if self.wound:
            back = u < -self.bends - 1e-9
            p = (1 - part) * self._wound(i, row, back) + part * self._wound(i + 1, row, back)
        else:
            layer = np.maximum(row - np.abs(u), 0.0)
            p = (1 - part) * self._corner(i, layer) + part * self._corner(i + 1, layer)
        return np.column_stack([c * p[:, 0] - d * p[:, 1], d * p[:, 0] + c * p[:, 1], z])

    def _height(self, row: Array) -> Array:
        """z (n,) of rows counted from the inner edge."""
        wave: Array = self.pitch * (np.abs(np.remainder(row + 1, 2) - 1) - 0.5)
        return wave

    def _corner(self, i: Array, layer: Array) -> Array:
        """The line C (n, 2) at columns i, of layers, in the frame of a trapezoid whose middle is at (0, -radius)."""
        side, far = np.sign(i), np.maximum(np.abs(i) - self.bends, 0) * self.column
        w = np.clip(far / self.ramp, 0, 1)
        η = (self.hub_gap + (self.gap - self.hub_gap) * w * w * (3 - 2 * w)) * layer
        half = math.pi / self.n
        out = np.stack([side * math.sin(half), np.full_like(i, -math.cos(half))], axis=1)
        across = np.stack([-side * math.cos(half), np.full_like(i, -math.sin(half))], axis=1)
        on_arm = (self.radius + far)[:, None] * out + η[:, None] * across
        angle = half * i / self.bends
        on_hub = (self.radius + η)[:, None] * np.stack([np.sin(angle), -np.cos(angle)], axis=1)
        return np.where((np.abs(i) < self.bends)[:, None], on_hub, on_arm)

    # ---- wound arms: heights count in layers ------------------------------------------------------------------------

    @property
    def _arm(self) -> int:
        """Columns of an arm."""
        return self.outer - self.bends

    def _rise(self, p: Array) -> Array:
        """Height of a strip at p columns from where its trapezoid begins: a quarter (of n) on, it is above two halves.

        It lies on the hub at first, and leaves it to make room for the turns of the next trapezoid.
        """
        quarter = 2 * self.bends
        whole = np.ceil(p / quarter) - 1  # 0 in the first quarter, its end included
        rest = np.maximum(p - quarter * whole, 1.0)
        rise: Array = whole * (2 * self._arm + 1) + (self._arm + 1) * (rest - 1) / (quarter - 1)
        return rise

    @property
    def _height_of_roll(self) -> float:
        j = np.arange(1, self._arm - self.out + 1)
        front, back = (
            self._rise(j + 2.0 * self.bends) + self._arm - j,
            self._rise(1.0 * j) + 2 * self._arm + 1,
        )
        return float(max(front.max(), back.max()))

    def _wound(self, i: Array, row: Array, back: npt.NDArray[np.bool_]) -> Array:
        """Columns i of rows in the roll (n, 2); `back` where the strip has turned back at the column -bends.

        The strip and its half that turned back lie above each other with their outer edges together, the seams outside.
        Of the turns, which enclose each other, the inner ones are shorter.  Tips stand out radially; outer layers bend
        outwards `early`, so that layers stay apart and none is stretched.
        """
        N, corner, side = self._arm, self.outer - self.out, np.where(back, -1, 1)
        p = np.minimum(np.where(back, -self.bends - i, self.bends + i), corner + side * self.bends)
        of = np.maximum(row - np.maximum(np.abs(i), self.bends), 0.0)
        seam = self._rise(p) + np.where(back, 2 * N + 1, 0)
        turn = p < 0.5
        beyond = np.maximum(np.abs(i) - corner, 0.0)
        layer = np.where(turn, N + 0.5, np.where(beyond > 0, seam - self.out - 1, seam + side * of))
        r = self.radius + self.hub_gap * layer + self.column * beyond
        standing = (np.abs(i) >= corner) & (self.out > 0)
        early = np.where(standing, self.hub_gap * (self.out + 1 + side * of), 0.0)

        def at(p: Array) -> Array:
            angle = math.pi / self.n * (p / self.bends - 1)
            return np.stack([np.sin(angle), -np.cos(angle)], axis=1)

        short = np.where(turn, STAGGER * self.hub_gap / self.column * (row - self.inner), 0.0)[
            :, None
        ]
        across = at(p) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
        result: Array = (
            r[:, None] * ((1 - short) * at(p) + short * at(p + 1)) - early[:, None] * across
        )
        return result


class _Tilted(Ikaros):
    """Neighbouring panels are turned apart about their folds, so that none of these is shut."""

    def pressed(self) -> Ikaros:
        return self

    def place(self, X: Array, side: Array) -> Array:
        gap = AJAR * self.radius / (self._height_of_roll if self.wound else self.outer)
        return replace(Ikaros(**vars(self)), gap=gap, hub_gap=gap).place(X, side)
