"""Sails of n trapezoids, each folded to a strip, in arms between them: the fold of IKAROS."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
import numpy.typing as npt

from gossamer_fx.build.fold.fold_map import FoldMap
from gossamer_fx.build.fold.folding import Gap, Length
from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.model.body import Array

# Round-off of a point's column, in columns: a node on a column must not count as left of it.
COLUMN_ROUND_OFF = 1e-9

# By how much a turn back is shorter than the one that encloses it, over the distance of layers.
STAGGER = 5.0

# Thickness of the layers over the radius of the hub at which mountains and valleys are
# distinguished: far above round-off, and small enough for the shape to stay the same.
AJAR = 1e-2


@check_arguments
@dataclass(frozen=True)
class Ikaros(FoldMap):
    """n trapezoids round a hub, each folded at rows parallel to its edges into a strip that stands
    on edge.

    With s along the rows of a trapezoid, y their distance from the centre and C the strip's line
    round the hub and out,

        x = (C(s) + η(s, y) n(s), zigzag(y))

    C has corners at columns of the mesh: 2 `bends` chords on the hub, then a radial arm, which two
    trapezoids share (n = 4 is the cross of IKAROS), or an arm that is `wound` on, round the hub.
    Layers are η = gap (y/pitch - |s|/column) from the seam, on the hub with `hub_gap` for `gap`.
    Their corners there are in line, and the outermost layer has its length: those within, nearer to
    the hub, are slack.  Edges of the mesh of `gossamer_fx.meshes.sails.trapezoids` are on all fold
    lines.

    Args:
        n: trapezoids, at least 3.
        inner, outer: rows of the inner and outer edges, which are inner pitch and outer pitch from
            the centre.
        pitch: between folds [m].
        bends: corners on the hub between the middle of a trapezoid and its end; less than `inner`.
        gap: distance of the layers of an arm [m].
        hub_gap: distance of the layers on the hub [m].
        ramp: length of an arm in which the one grows to the other [m].
        wound: whether the arms go on round the hub, all towards greater angles, as before they were
            let out: `hub_gap` is then the distance of all layers.  One half of each arm turns back
            where it leaves its own trapezoid.
        out: columns of the tips that stand out from the roll.

    Raises:
        InputError: a number is out of its range.

    Example:
        >>> folds = gx.fold.Ikaros(4, 4, outer=12, pitch=0.05, bends=2)
        >>> round(folds.radius, 3)
        0.128
    """

    called: ClassVar[str] = "fold.Ikaros"
    n: Annotated[int, Range(3)]
    inner: int
    _: KW_ONLY
    outer: int
    pitch: Length
    bends: int = 2
    gap: Gap = 0.0
    hub_gap: Gap = 0.0
    ramp: Length = 1.0
    wound: bool = False
    out: int = 0

    def __post_init__(self) -> None:
        self._check(
            0 < self.inner < self.outer,
            f"rows from {self.inner!r} to {self.outer!r}; give inner above 0, below outer.",
        )
        self._check(
            1 <= self.bends < self.inner,
            f"bends is {self.bends!r}; give at least 1 and less than inner, {self.inner!r}.",
        )
        self._check(
            0 <= self.out < self._arm_columns,
            f"out is {self.out!r}; give at least 0 columns, "
            f"less than an arm's {self._arm_columns}.",
        )
        self._check(
            self.wound or not self.out, "out is of arms that are wound; give wound=True, too."
        )
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
        """Radius of the corners of the innermost layer on the hub [m]."""
        # A column of the outermost layer is a chord of its circle, and is not stretched.
        angle_of_column = math.pi / self.n / self.bends
        outermost = self.column / 2 / math.sin(angle_of_column / 2)
        return outermost - self.hub_gap * self._layers

    @property
    def _layers(self) -> float:
        """Thickness of all that lies on the hub, in layers."""
        if self.wound:
            return self._height_of_roll
        return self.outer

    def pressed(self) -> Ikaros:
        """The same fold with layers that touch."""
        return replace(self, gap=0.0, hub_gap=0.0)

    def ajar(self) -> Ikaros:
        """The same fold, loose enough to distinguish mountains and valleys."""
        pressed = self.pressed()
        gap = AJAR * pressed.radius / pressed._layers
        return replace(pressed, gap=gap, hub_gap=gap)

    def place(self, X: Array, side: Array) -> Array:
        """Folded positions, see `FoldMap.place`; a sail has one sheet, `side` does not count.

        In the code u is the coordinate along the trapezoid in columns, i the column before the
        point, and p (n, 2) [m] the position in the frame of the trapezoid."""
        # The trapezoid of each point, and its turn from the one whose middle is at negative y.
        angle = np.arctan2(X[:, 1], X[:, 0]) + np.pi / 2
        trapezoid = np.round(angle / (2 * np.pi / self.n))
        turn = 2 * np.pi * trapezoid / self.n
        cos = np.cos(turn)
        sin = np.sin(turn)
        along = cos * X[:, 0] + sin * X[:, 1]
        outward = sin * X[:, 0] - cos * X[:, 1]

        # Rows and columns of the flat sail; a point lies between the columns i and i + 1.
        row = outward / self.pitch
        z = self._height(row - self.inner)
        u = along / self.column
        i = np.floor(u + COLUMN_ROUND_OFF)
        fraction = (u - i)[:, None]
        if self.wound:
            back = u < -self.bends - COLUMN_ROUND_OFF
            at_column = self._wound(i, row, back)
            at_next = self._wound(i + 1, row, back)
        else:
            layer = np.maximum(row - np.abs(u), 0.0)
            at_column = self._corner(i, layer)
            at_next = self._corner(i + 1, layer)
        p = (1 - fraction) * at_column + fraction * at_next

        # Turned back to the trapezoid.
        x = cos * p[:, 0] - sin * p[:, 1]
        y = sin * p[:, 0] + cos * p[:, 1]
        return np.column_stack([x, y, z])

    def _height(self, row: Array) -> Array:
        """z (n,) [m] of rows (n,), counted from the inner edge: a zigzag, -pitch/2 at even rows and
        pitch/2 at odd ones."""
        return self.pitch * (np.abs(np.remainder(row + 1, 2) - 1) - 0.5)

    def _corner(self, i: Array, layer: Array) -> Array:
        """Where a folded strip has its corners, seen from above: positions (n, 2) [m] in the frame
        of a trapezoid whose middle is at (0, -radius).

        Column i (n,) is 0 in the middle of the trapezoid; up to `bends` on either side it is on the
        hub, beyond on a radial arm.  Layers (n,) count from the innermost one.
        """
        side = np.sign(i)
        far = np.maximum(np.abs(i) - self.bends, 0) * self.column
        # The gap changes smoothly from that on the hub to that of the arm, over the length `ramp`.
        w = np.clip(far / self.ramp, 0, 1)  # share of this length
        gap = self.hub_gap + (self.gap - self.hub_gap) * w * w * (3 - 2 * w)
        η = gap * layer  # distance from the innermost layer [m]

        # Unit vectors: `out` along the arm, `across` perpendicular to it, `radial` from the axis of
        # the hub
        half = math.pi / self.n
        cos = np.full_like(i, -math.cos(half))
        sin = np.full_like(i, -math.sin(half))
        out = np.stack([side * math.sin(half), cos], axis=1)
        across = np.stack([-side * math.cos(half), sin], axis=1)
        on_arm = (self.radius + far)[:, None] * out + η[:, None] * across

        angle = half * i / self.bends
        radial = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
        on_hub = (self.radius + η)[:, None] * radial
        is_on_hub = np.abs(i) < self.bends
        return np.where(is_on_hub[:, None], on_hub, on_arm)

    # ---- wound arms: heights count in layers -----------------------------------------------------

    @property
    def _arm_columns(self) -> int:
        """Number of columns of an arm, from the hub to its tip."""
        return self.outer - self.bends

    def _rise(self, p: Array) -> Array:
        """Layers of film (n,) between the hub and the seam of a strip that is wound round it, at p
        ≥ 0 columns (n,) from where its trapezoid begins.

        A trapezoid takes 2 `bends` columns of the circumference, on which both halves of its arm
        lie, as many layers each as the arm has columns.  Over these columns a strip rises linearly,
        by the layers of one half and one more.  At the first column of the next trapezoid it is
        above both halves of all that it has passed.
        """
        columns_of_trapezoid = 2 * self.bends
        # 0 on the columns of the first trapezoid, the last of them included.
        passed = np.ceil(p / columns_of_trapezoid) - 1
        # Columns on the present trapezoid, from one: at the first the strip has not yet risen.
        columns = np.maximum(p - columns_of_trapezoid * passed, 1.0)
        below = passed * (2 * self._arm_columns + 1)
        return below + (self._arm_columns + 1) * (columns - 1) / (columns_of_trapezoid - 1)

    @property
    def _height_of_roll(self) -> float:
        """Height of the highest strip of the roll of wound arms, in layers."""
        j = np.arange(1, self._arm_columns - self.out + 1)
        # Of the strip as it goes out, and of its half that has turned back.
        front = self._rise(j + 2.0 * self.bends) + self._arm_columns - j
        back = self._rise(1.0 * j) + 2 * self._arm_columns + 1
        highest = max(front.max(), back.max())
        return float(highest)

    def _wound(self, i: Array, row: Array, back: npt.NDArray[np.bool_]) -> Array:
        """Where columns of a folded strip are in the roll, if its arms are wound round the hub:
        positions (n, 2) [m] in the frame of the trapezoid, whose middle is at (0, -radius).

        The strip and its half that turned back (`back`, at the column -bends) lie above each other
        with their outer edges together, the seams outside.  Of the turns, which enclose each other,
        the inner ones are shorter.  Tips stand out radially; outer layers bend outwards earlier, so
        that layers stay apart and none is stretched.

        Column i (n,) is 0 in the middle of the trapezoid, `row` (n,) counts from the centre of the
        sail.  N is the number of columns on an arm, p the column on the hub, counted from where the
        trapezoid begins, and r [m] the distance from the axis of the hub.
        """
        N = self._arm_columns
        corner = self.outer - self.out  # column from which on the tip stands out
        side = np.where(back, -1, 1)
        # Columns from where the trapezoid begins; those of a standing tip are at its corner.
        columns = np.where(back, -self.bends - i, self.bends + i)
        p = np.minimum(columns, corner + side * self.bends)
        from_seam = np.maximum(row - np.maximum(np.abs(i), self.bends), 0.0)

        # Heights, in layers.
        seam = self._rise(p) + np.where(back, 2 * N + 1, 0)
        # A half turns back at its column 0, in the middle of the layers of both halves.
        is_turn = p < 0.5
        beyond = np.maximum(np.abs(i) - corner, 0.0)
        on_tip = seam - self.out - 1
        on_strip = np.where(beyond > 0, on_tip, seam + side * from_seam)
        layer = np.where(is_turn, N + 0.5, on_strip)
        r = self.radius + self.hub_gap * layer + self.column * beyond

        def at(p: Array) -> Array:
            """Unit vectors (n, 2) from the axis to points of the hub, p columns on."""
            angle = math.pi / self.n * (p / self.bends - 1)
            return np.stack([np.sin(angle), -np.cos(angle)], axis=1)

        # Turns end this part of a column before the next one.
        stagger = STAGGER * self.hub_gap / self.column * (row - self.inner)
        short = np.where(is_turn, stagger, 0.0)[:, None]
        direction = (1 - short) * at(p) + short * at(p + 1)
        # Outer layers of a standing tip bend outwards earlier.
        is_standing = (np.abs(i) >= corner) & (self.out > 0)
        height_in_tip = self.hub_gap * (self.out + 1 + side * from_seam)
        early = np.where(is_standing, height_in_tip, 0.0)
        quarter_turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
        across = at(p) @ quarter_turn
        return r[:, None] * direction - early[:, None] * across
