"""The maps `Miura`, rows of parallelograms, and `Star`, a ring whose pleats wind round a polygonal
hub, as spinning discs are folded.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np

from gossamer_fx.build.fold.fold_map import FoldMap
from gossamer_fx.build.fold.folding import Gap, Length
from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.model.body import Array

Segment = tuple[tuple[float, float], tuple[float, float]]


@check_arguments
@dataclass(frozen=True)
class Miura(FoldMap):
    """Miura's fold of a sheet into parallelograms with sides a and b and an angle γ between them.

    On the flat sheet the lines x = i b sin γ are straight, those across run in zigzag through the
    points (i b sin γ, j a + b cos γ (i odd)).  Parallelograms make an angle θ with the plane; then

        height  H = a sin θ sin γ                     along y  L = a √(1 - sin²θ sin²γ)
        along x  S = b cos θ tan γ/√(1 + cos²θ tan²γ)   shift  V = b/√(1 + cos²θ tan²γ)

    Two sheets, as of a tube that is pressed flat, are opened to a pillow in each parallelogram and
    shifted against each other along z, in which the folded sheet has no overhang; both vanish at
    seams.  A shift s keeps them s cos θ apart at fold lines.  Across a width w they cost strain
    energy of the order (opening/w)⁴ and (lift/w)².

    Args:
        a, b: sides [m], a along y.
        gamma: γ [rad], between 0 and π/2.
        theta: θ [rad], above 0 (flat) and below π/2 (pressed shut).
        opening: half of the largest distance of two sheets within a parallelogram [m].
        lift: half of their distance along z [m].

    Raises:
        InputError: a number is out of its range.

    Example:
        >>> folds = gx.fold.Miura(0.1, 0.1, gamma=1.0, theta=0.5)
        >>> folded = folds.place(np.array([[0.05, 0.05, 0.0]]), np.zeros(1))

    Source: Schenk & Guest, Proc. Natl. Acad. Sci. 110 (2013) 3276, doi:10.1073/pnas.1217998110,
    equations 1 to 4.
    """

    called: ClassVar[str] = "fold.Miura"
    a: Length
    b: Length
    _: KW_ONLY
    gamma: float
    theta: float
    opening: Gap = 0.0
    lift: Gap = 0.0

    def __post_init__(self) -> None:
        for what in ("gamma", "theta"):
            value = getattr(self, what)
            self._check(
                0 < value < math.pi / 2,
                f"{what} is {value!r} rad; give a number between 0 and π/2.",
            )

    @cached_property
    def sizes(self) -> tuple[float, float, float, float]:
        """Sizes of a folded parallelogram: height H, length S along x and L along y, shift V [m]
        (Schenk & Guest, equations 1 to 4)."""
        cos_θ = math.cos(self.theta)
        tan_γ = math.tan(self.gamma)
        sines = math.sin(self.theta) * math.sin(self.gamma)
        root = math.sqrt(1 + (cos_θ * tan_γ) ** 2)
        H = self.a * sines
        S = self.b * cos_θ * tan_γ / root
        L = self.a * math.sqrt(1 - sines * sines)
        V = self.b / root
        return H, S, L, V

    def lattice(self, X: Array) -> tuple[Array, Array]:
        """Column u (n,) and row v (n,) of points X (n, 3) of the flat sheet; fold lines are at
        whole numbers."""
        u = X[:, 0] / (self.b * math.sin(self.gamma))
        zigzag = self.b * math.cos(self.gamma) * _wave(u)
        v = (X[:, 1] - zigzag) / self.a
        return u, v

    def segments(self, low: tuple[float, float], high: tuple[float, float]) -> list[Segment]:
        """The fold lines that pass over a rectangle of the flat sheet between the corners `low` and
        `high` (x, y) [m], as the ends (x, y) [m] of straight segments; lines along x may reach
        beyond it."""
        # b is the length [m] of the sides that form the zigzags, a of those along y.
        width = self.b * math.sin(self.gamma)
        rise = self.b * math.cos(self.gamma)
        first_column = math.floor(low[0] / width)
        last_column = math.ceil(high[0] / width)
        # A zigzag rises from its row, so the one below the rectangle may reach into it.
        first_row = math.floor((low[1] - rise) / self.a)
        last_row = math.ceil(high[1] / self.a)

        segments = []
        for i in range(first_column, last_column + 1):
            segments.append(((i * width, low[1]), (i * width, high[1])))
        for i in range(first_column, last_column):
            for j in range(first_row, last_row + 1):
                start = (i * width, j * self.a + rise * (i % 2))
                end = ((i + 1) * width, j * self.a + rise * ((i + 1) % 2))
                segments.append((start, end))
        return segments

    @cached_property
    def axes(self) -> Array:
        """Unit directions (3, 3), as columns, into which those of x, of y and of the normal are
        folded in the first parallelogram."""
        H, S, L, V = self.sizes
        along = np.array([0.0, L, H]) / self.a
        # The side b of the parallelogram is at the angle γ to the side a.
        side_b = np.array([S, V, 0.0]) / self.b
        across = (side_b - math.cos(self.gamma) * along) / math.sin(self.gamma)
        normal = np.cross(across, along)
        return np.stack([across, along, normal], axis=1)

    def place(self, X: Array, side: Array) -> Array:
        """Folded positions, see `FoldMap.place`.  In the code u and v are the coordinates of the
        points in parallelograms, p their folded positions."""
        H, S, L, V = self.sizes
        u, v = self.lattice(X)
        p = np.stack([S * u, L * v + V * _wave(u), H * _wave(v)], axis=1)
        if self.opening or self.lift:
            # The upper side of the first parallelogram looks along its normal; those of its
            # neighbours look along mirrored ones.
            sense_u = _sense(u)
            sense_v = _sense(v)
            sense = np.stack([sense_u * sense_v, sense_v, np.ones(len(X))], axis=1)
            pillow = self.opening * np.abs(np.sin(math.pi * u) * np.sin(math.pi * v))
            p = p + (side * pillow)[:, None] * sense * self.axes[:, 2]
            p[:, 2] += side * self.lift
        return p

    def pressed(self) -> Miura:
        """The same fold of one sheet: an isometric map."""
        return replace(self, opening=0.0, lift=0.0)


def _wave(u: Array) -> Array:
    """The triangular wave: 0 at even numbers, 1 at odd ones."""
    return 1 - np.abs(np.remainder(u, 2) - 1)


def _sense(u: Array) -> Array:
    """Sign of the slope of `_wave`: 1 where it rises, -1 where it falls."""
    return np.where(np.remainder(u, 2) < 1, 1.0, -1.0)


# Thickness of the roll over its radius at which mountains and valleys are distinguished: far above
# round-off, and small enough for the shape to stay the same.
AJAR = 0.01

# Relative round-off of coordinates on the flat sheet: a point on a column or on a bound of a sector
# must not count as beyond it.
COORDINATE_ROUND_OFF = 1e-9

# [m] Lower bound of depths by which others are divided: at the corner of the hub both are zero.
SMALLEST_DEPTH = 1e-300


@check_arguments
@dataclass(frozen=True)
class Star(FoldMap):
    """A ring outside a regular polygon of n sides, folded to a roll round it that stands on edge.

    From corner k the sides of the polygon, drawn on, bound a sector of angle 2π/n, which is folded
    about its bisector: with polar coordinates (ρ, ψ) about the corner and ψ' the angle from the
    nearer bound

        s = k a + ρ cos ψ'   along the circumference,   z = -ρ sin ψ'.

    The bounds are valleys at z = 0, the bisectors mountains below.  The roll has corners at columns
    s = const of the mesh, `column` apart, which are edges of the mesh of
    `gossamer_fx.meshes.sails.pinwheel`.  Layers are `gap` apart: they wind outwards at 2 gap a
    side.  Their corners are in line, and the outermost layer has its length: those within are
    slack.

    Args:
        n: sides of the polygon, at least 3.
        side: their length a [m].
        columns: columns of the mesh in a side, at least 1.
        reach: columns of the mesh in a sector, at least as many.
        gap: distance of layers [m].

    Raises:
        InputError: a number is out of its range.

    Example:
        >>> folds = gx.fold.Star(6, 0.1, columns=2, reach=8)
        >>> round(folds.radius, 3)
        0.097

    Source: of the pattern, Guest & Pellegrino, "Inextensional wrapping of flat membranes", Proc.
    First Int. Seminar on Structural Morphology (1992) 203.
    """

    called: ClassVar[str] = "fold.Star"
    n: Annotated[int, Range(3)]
    side: Length
    _: KW_ONLY
    columns: int
    reach: int
    gap: Gap = 0.0

    def __post_init__(self) -> None:
        self._check(
            1 <= self.columns <= self.reach,
            f"columns is {self.columns!r} and reach {self.reach!r}; give 1 column a side or more, "
            "and no less in all.",
        )
        self._check(
            self.radius > 0,
            f"gap is {self.gap:g} m: the layers leave no room for a hub; give less.",
        )

    @property
    def column(self) -> float:
        """Distance of columns [m]."""
        return self.side / self.columns

    @property
    def radius(self) -> float:
        """Radius of the corners of the innermost layer [m]."""
        # A column of the outermost layer is a chord of its circle, and is not stretched.
        outermost = self.column / 2 / math.sin(math.pi / self.n / self.columns)
        return outermost - 2 * self.gap * self.reach / self.columns

    def pressed(self) -> Star:
        """The same fold with layers that touch."""
        return replace(self, gap=0.0)

    def ajar(self) -> Star:
        """The same fold, loose enough to distinguish mountains and valleys."""
        gap = AJAR * self.pressed().radius * self.columns / self.reach
        return replace(self, gap=gap)

    def place(self, X: Array, side: Array) -> Array:
        """Folded positions, see `FoldMap.place`; NaN for points within the polygon.  A ring has one
        sheet, so that `side` does not count."""
        # Of each point (m,): the corner k of the polygon at which its sector begins; its distance s
        # [m] from that corner along the nearer bound of the sector; its depth [m] below the bounds
        # of the sector in the roll; and 1 behind the bisector of the sector, else 0.
        k, s, down, is_behind = self._unrolled(X)
        # A point lies between the columns i and i + 1 from the corner, at this fraction of their
        # distance from column i.
        i = np.floor(s / self.column + COORDINATE_ROUND_OFF)
        fraction = (s / self.column - i)[:, None]
        slope = math.tan(math.pi / self.n)
        positions = []
        for j in range(2):
            depth_of_bisector = np.maximum((i + j) * self.column, SMALLEST_DEPTH) * slope
            positions.append(self._corner(k, i + j, down / depth_of_bisector, is_behind))
        # Positions (m, 2) [m] seen from above, on the chord between both columns.
        p = (1 - fraction) * positions[0] + fraction * positions[1]
        return np.column_stack([p, -down])

    def _unrolled(self, X: Array) -> tuple[Array, Array, Array, Array]:
        """Coordinates of points X (m, 3) [m] of the flat ring in the sector of the polygon's corner
        that they belong to, four arrays (m,); NaN for points within the polygon.

        They are the corner k, from 0, at which the sector begins; the distance [m] from that corner
        along the nearer of both bounds of the sector, s - k a; the distance [m] from that bound,
        the depth -z in the roll; and 1 behind the bisector of the sector, else 0.  In the code c
        and d are cosine and sine of the turn of a sector, ρ [m] and ψ [rad] the polar coordinates
        about the corner.
        """
        sector = 2 * math.pi / self.n
        apothem = self.side / 2 / math.tan(math.pi / self.n)
        corner = np.full(len(X), np.nan)
        distance = np.full(len(X), np.nan)
        depth = np.full(len(X), np.nan)
        is_behind = np.full(len(X), np.nan)
        # The far bound of a sector is the near one of the next, to which its points belong.  Only
        # those that no sector has taken so far are given to the far bound, in the second pass.
        passes = [(k, False) for k in range(self.n)] + [(k, True) for k in range(self.n)]
        for k, is_far_bound_included in passes:
            # Corner k is where side k ends; side 0 is at y = -apothem.
            c = math.cos(sector * k)
            d = math.sin(sector * k)
            x = c * X[:, 0] + d * X[:, 1] - self.side / 2
            y = c * X[:, 1] - d * X[:, 0] + apothem
            ρ = np.hypot(x, y)
            ψ = np.arctan2(y, x)
            # Round-off of a coordinate, of the order of 1e-9 of a side, as an angle about the
            # corner.  At the corner, where all angles are undetermined, it is 1 rad.
            safe_ρ = np.maximum(ρ, COORDINATE_ROUND_OFF * self.side)
            round_off = COORDINATE_ROUND_OFF * (1 + self.side / safe_ρ)
            end = sector - round_off
            if is_far_bound_included:
                end = sector + round_off
            here = (ψ > -round_off) & (ψ < end) & np.isnan(corner)
            ψ = np.clip(ψ, 0, sector)
            nearer = np.minimum(ψ, sector - ψ)
            corner[here] = k
            distance[here] = (ρ * np.cos(nearer))[here]
            depth[here] = (ρ * np.sin(nearer))[here]
            is_behind[here] = (ψ > sector / 2 + COORDINATE_ROUND_OFF)[here]
        return corner, distance, depth, is_behind

    def _corner(self, k: Array, column: Array, depth: Array, is_behind: Array) -> Array:
        """Horizontal positions (m, 2) [m] in the roll of points on columns, lines across the
        pleats: the corner k (m,) of their sector, the number of columns from it (m,), the depth
        (m,) from 0 at the bound of the sector (z = 0) to 1 at its bisector, and 1 behind the
        bisector, else 0, (m,)."""
        # Sides of the hub since the corner.  A pleat of two layers starts at the corner, and has
        # its whole thickness after the first side.
        j = column / self.columns
        from_outside = np.where(is_behind > 0, 2 - depth, depth)
        layer = 2 * j - from_outside * np.minimum(j, 1.0)
        angle = 2 * math.pi / self.n * (k + j + 0.5)
        # Distance from the axis [m]
        r = self.radius + self.gap * layer
        return r[:, None] * np.stack([np.sin(angle), -np.cos(angle)], axis=1)
