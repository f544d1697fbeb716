"""Strips, sheets and flat tubes bent along rows of edges: accordions and rolls."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np

from gossamer_fx.build.fold.fold_map import FoldMap
from gossamer_fx.build.fold.folding import Gap, Length
from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.model.body import Array, Indices

# Share of the length: points that differ by less are the same.
SAME = 1e-7

# Length of the sum of two unit normals below which it has no direction: two pieces that are folded
# back on each other.
SMALLEST_NORMAL = 1e-9

# Share of its angles at which the mountains and valleys of an accordion are distinguished: no fold
# is shut then.
AJAR = 0.5

# Largest number of rows at which a strip is bent: each is solved for.
Bends = Annotated[int, Range(1, 100_000)]


@dataclass(frozen=True)
class Bent:
    """A line along x from the origin that is bent at corners x (m,) [m]; its pieces have the
    directions `rise` (m + 1,) [rad] against the x axis."""

    corners: Array
    rise: Array

    @cached_property
    def _knots(self) -> tuple[Array, Array, Array]:
        """Starts of the m + 1 pieces: coordinates x (m + 1,) [m] on the straight line, positions (m
        + 1, 2) [m] on the bent one, and unit tangents (m + 1, 2).
        """
        tangents = np.stack([np.cos(self.rise), np.sin(self.rise)], axis=1)
        x = np.concatenate([[0.0], self.corners])
        steps = np.diff(x)[:, None] * tangents[:-1]
        positions = np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
        return x, positions, tangents

    def at(self, x: Array) -> tuple[Array, Array]:
        """Positions (n, 2) [m] of points x (n,) [m] of the straight line after it is bent, and unit
        normals (n, 2).  Beyond its ends the first and last piece go on.  At a corner the normal is
        the mean of both pieces, zero where these are folded back on each other."""
        starts, positions, tangents = self._knots
        last = len(tangents) - 1
        size = max(float(np.abs(starts).max()), float(np.abs(x).max(initial=0.0)))
        tolerance = SAME * size
        # The pieces just after and just before a point; they differ at corners only.
        after = np.clip(np.searchsorted(starts, x + tolerance, side="right") - 1, 0, last)
        before = np.clip(np.searchsorted(starts, x - tolerance, side="right") - 1, 0, last)
        t_after = tangents[after]
        t_before = tangents[before]
        normal = np.stack(
            [
                -t_after[:, 1] - t_before[:, 1],
                t_after[:, 0] + t_before[:, 0],
            ],
            axis=1,
        )
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        safe_length = np.where(length > SMALLEST_NORMAL, length, 1.0)
        # Positions on the bent line
        p = positions[after] + (x - starts[after])[:, None] * t_after
        return p, normal / safe_length


@dataclass(frozen=True)
class Strip(FoldMap):
    """A strip of a length [m] along x from x = 0, bent across: the common part of accordions and
    rolls.  Two sheets, one on each side of the strip, may be apart; the map of one sheet alone is
    isometric."""

    length: Length

    @property
    def bent(self) -> Bent:
        """The bent line of the strip: m corners, and the directions of its m + 1 pieces."""
        raise NotImplementedError

    def place(self, X: Array, side: Array) -> Array:
        """Folded positions, see `FoldMap.place`: on the bent line, two sheets apart by `thickness`
        along its normal and by `shift` along z."""
        p, normal = self.bent.at(X[:, 0])
        p = p + (side * self.thickness(X))[:, None] * normal
        z = p[:, 1] + side * self.shift(X)
        return np.stack([p[:, 0], X[:, 1], z], axis=1)

    def film_length(self) -> float:
        """Length [m] of the film that the map needs."""
        return self.length

    def thickness(self, X: Array) -> Array:
        """Half of the distance (n,) [m] of the sheets."""
        return np.zeros(len(X))

    def shift(self, X: Array) -> Array:
        """By how much (n,) [m] the upper sheet is moved along z, and the lower one against it."""
        return np.zeros(len(X))

    def label(self, X: Array) -> Indices:
        """Number (n,), from 1, of the corner of `bent` that is nearest to each point X (n, 3) [m]
        of the flat strip."""
        distances = np.abs(X[:, :1] - self.bent.corners)
        return distances.argmin(axis=1).astype(np.int32) + 1

    def _check_width(self) -> None:
        """Raise `InputError` if a map opens two sheets, by `opening` or `lift`, without a `width`;
        maps have some of these fields."""
        opened = any(getattr(self, what, 0.0) for what in ("opening", "lift"))
        self._check(
            not opened or getattr(self, "width", 0.0) > 0,
            "sheets that are opened need the width of the film.",
        )

    def _across(self, X: Array) -> Array:
        """Share (n,) of an opening at X (n, 3): one on the centre line, zero at the seams |y| =
        width/2.  Only for maps that open sheets: the others may have the width zero."""
        width = getattr(self, "width", 1.0)
        return np.cos(np.pi * np.clip(X[:, 1] / width, -0.5, 0.5))


# Most panels: beyond a million a film of one metre has folds of a micrometre.
MAX_FOLDS = 10**6

# Excess of a distance over its limit that is round-off of the distance.
ROUND_OFF = 1e-12


@check_arguments
@dataclass(frozen=True)
class Zigzag(Strip):
    """Accordion of equal panels in a strip, a sheet or a flat tube along x, folded at rows of edges
    across.

    Panels rise and fall in turn by `angle` against the x axis: each fold has the angle 2 `angle`,
    and the strip is length cos(angle) long.  With `bends` > 1 a fold is bent at so many rows,
    `spacing` apart: a fold with a radius.

    Two sheets are opened to a pillow between folds, and where they are folded shifted against each
    other across the panels, so that the outer one lies round the inner one; both vanish at seams
    and ends.  That costs strain energy of the order (opening/width)⁴ and (lift/width)².

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
    panels: Annotated[int, Range(2, MAX_FOLDS)] = 2
    _: KW_ONLY
    # At π/2 panels are pressed shut.
    angle: Annotated[float, Range(0.0, math.pi / 2, "rad", above=True)] = 1.4
    width: Gap = 0.0
    opening: Gap = 0.0
    lift: Gap = 0.0
    bends: Bends = 1
    spacing: Gap = 0.0

    def __post_init__(self) -> None:
        self._check_width()
        self._check(
            (self.spacing > 0) == (self.bends > 1),
            "spacing is the distance of several bends; give both or none.",
        )
        panel_length = self.length / self.panels
        self._check(
            (self.bends - 1) * self.spacing < panel_length,
            f"{self.bends} bends of {self.spacing:g} m take more than a panel of {panel_length:g} "
            "m; give less.",
        )

    @cached_property
    def bent(self) -> Bent:
        """Line of the strip seen from the side: c = (`panels` - 1) `bends` corners, since each fold
        is bent at `bends` rows of edges by equal angles, and directions (c + 1,) from -`angle` to
        `angle`."""
        # The rows of a fold lie symmetrically about its middle.
        rows = (np.arange(self.bends) - (self.bends - 1) / 2) * self.spacing
        folds = self.length * np.arange(1, self.panels) / self.panels
        # The first panel rises; folds turn down and up in turn, each row by an equal part.
        sense = (-1.0) ** np.arange(self.panels - 1)
        turned = 1 - 2 * np.arange(1, self.bends + 1) / self.bends
        rise = np.concatenate([[1.0], np.outer(sense, turned).ravel()])
        corners = (folds[:, None] + rows).ravel()
        return Bent(corners, self.angle * rise)

    def pressed(self) -> Zigzag:
        """The same fold of one sheet: an isometric map."""
        return replace(self, opening=0.0, lift=0.0)

    def ajar(self) -> Zigzag:
        """The same fold, open enough to distinguish mountains and valleys."""
        return replace(self, angle=AJAR * self.angle)

    def thickness(self, X: Array) -> Array:
        """Half of the distance (n,) [m] of the sheets at points (n, 3) [m] of the flat strip: a
        pillow between folds, zero at folds and seams, and everywhere without `opening`."""
        if not self.opening:
            return np.zeros(len(X))
        along = np.abs(np.sin(np.pi * X[:, 0] / self.length * self.panels))
        return self.opening * along * self._across(X)

    def shift(self, X: Array) -> Array:
        """Shift (n,) [m] of the upper sheet along z, of the lower one against it: `lift` at all
        folds, on the centre line, growing from zero at both ends of the strip."""
        if not self.lift:
            return np.zeros(len(X))
        from_end = np.minimum(X[:, 0], self.length - X[:, 0])
        ramp = np.clip(from_end / self.length * self.panels, 0, 1)
        return self.lift * ramp * self._across(X)

    def label(self, X: Array) -> Indices:
        """Number (n,), from 1, of the fold that is nearest to each point X (n, 3): its `bends` rows
        count as one."""
        return np.asarray((super().label(X) - 1) // self.bends + 1, dtype=np.int32)


@check_arguments
@dataclass(frozen=True)
class Roll(Strip):
    """A strip or flat tube along x rolled up about y, its end x = length inside; bent at equally
    spaced rows of edges.

    The piece before the first bend lies along the x axis.  Radii grow from `radius` by `pitch` a
    turn.

    Two sheets are apart by twice `opening` between seams and ends.  They differ in length then: an
    opening of 0.1 mm costs some mJ.

    Args:
        length: of the strip [m].
        bends: number of rows at which it is bent: at `flat` and equally spaced from there to its
            end.
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
    bends: Bends = 10
    _: KW_ONLY
    radius: Length = 0.02
    pitch: Gap = 2e-3
    flat: float | None = None
    width: Gap = 0.0
    opening: Gap = 0.0

    def __post_init__(self) -> None:
        self._check_width()
        self._check(
            self.flat is None or 0 < self.flat < self.length,
            f"flat is {self.flat!r} m; give a part of the length, above zero.",
        )
        spacing = float(np.diff(self._rows).max())
        # A row turns by 2 asin(spacing/2r): at two thirds of the radius that is 39°, 9 rows a turn.
        self._check(
            spacing <= (1 + ROUND_OFF) * 2 * self.radius / 3,
            f"rows {spacing:.3g} m apart do not go round a radius of {self.radius:g} m; "
            "give more bends or a larger radius.",
        )

    @property
    def _rows(self) -> Array:
        """Coordinates x (bends + 1,) [m] of the rows at which the strip is bent, and of its end."""
        flat = self.flat
        if flat is None:
            flat = self.length / (self.bends + 1)
        return np.linspace(flat, self.length, self.bends + 1)

    @cached_property
    def bent(self) -> Bent:
        """Line of the strip seen from the side, bent at `bends` corners.

        Between the corners each piece is a chord of the circle round the axis of the roll, whose
        radius grows from the inside outwards.  A chord is at most two thirds of the radius, as
        `__post_init__` has checked.  The first piece has the direction 0; each later one is that of
        the piece before plus the angle of the corner, so that it exceeds 2π after a turn.
        """
        rows = self._rows
        # From the innermost piece outwards, as the radius grows in this direction.  `angle` [rad]
        # is the sum of the angles of the chords so far, seen from the axis of the roll.
        angle = 0.0
        angles = []
        for chord in np.diff(rows)[::-1]:
            angles.append(angle)
            radius = self.radius + self.pitch * angle / (2 * math.pi)
            angle += 2 * math.asin(chord / 2 / radius)
        # The piece before the first bend lies along x.
        rise = angle - np.array([angle, *angles[::-1]])
        return Bent(rows[:-1], rise)

    def pressed(self) -> Roll:
        """The same roll of one sheet: an isometric map."""
        return replace(self, opening=0.0)

    def thickness(self, X: Array) -> Array:
        """Half of the distance (n,) [m] of the sheets: zero at seams and ends, it grows to
        `opening` over a tenth of the length from each end."""
        if not self.opening:
            return np.zeros(len(X))
        from_end = np.minimum(X[:, 0], self.length - X[:, 0])
        ramp = np.clip(from_end / (self.length / 10), 0, 1)
        return self.opening * ramp * self._across(X)
