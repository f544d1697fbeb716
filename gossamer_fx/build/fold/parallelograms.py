"""The map `Miura`: rows of parallelograms."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from gossamer_fx.build.fold.fold_map import FoldMap, Gap, Length
from gossamer_fx.core.checks.arguments import check_arguments
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
        """In the code u and v are the coordinates of the points in parallelograms, p their folded
        positions."""
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
