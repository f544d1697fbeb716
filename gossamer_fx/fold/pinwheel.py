"""The map `Star`: a ring whose pleats wind round a polygonal hub, as spinning discs are folded."""

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
AJAR = 0.01


@check_arguments
@dataclass(frozen=True)
class Star(FoldMap):
    """A ring outside a regular polygon of n sides, folded to a roll round it that stands on edge.

    From corner k the sides of the polygon, drawn on, bound a sector of angle 2π/n, which is folded about its bisector:
    with polar coordinates (ρ, ψ) about the corner and ψ' the angle from the nearer bound

        s = k a + ρ cos ψ'   along the circumference,   z = -ρ sin ψ'.

    The bounds are valleys at z = 0, the bisectors mountains below.  The roll has corners at columns s = const of the
    mesh, `column` apart, which are edges of the mesh of `gossamer_fx.meshes.sails.pinwheel`.  Layers are `gap`
    apart: they wind outwards at 2 gap a side.  Their corners are in line, and the outermost layer has its
    length: those within are slack.

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

    Source: of the pattern, Guest & Pellegrino, "Inextensional wrapping of flat membranes", Proc. First Int. Seminar on
    Structural Morphology (1992) 203.
    """

    called: ClassVar[str] = "fold.Star"
    n: int
    side: float
    _: KW_ONLY
    columns: int
    reach: int
    gap: float = 0.0

    def __post_init__(self) -> None:
        self._check(self.n >= 3, f"n is {self.n!r}; give a polygon of at least 3 sides.")
        self._check(
            1 <= self.columns <= self.reach,
            f"columns is {self.columns!r} and reach {self.reach!r}; give 1 column a side or more, and no less in all.",
        )
        self._check_positive("side")
        self._check_not_negative("gap")
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
        """Of the corners of the innermost layer [m]."""
        outermost = self.column / 2 / math.sin(math.pi / self.n / self.columns)
        return outermost - 2 * self.gap * self.reach / self.columns

    def pressed(self) -> Star:
        return replace(self, gap=0.0)

    def ajar(self) -> Star:
        return _Open(self.n, self.side, columns=self.columns, reach=self.reach)

    def place(self, X: Array, side: Array) -> Array:
        k, s, down, second = self._unrolled(X)
        i = np.floor(s / self.column + 1e-9)
        part = (s / self.column - i)[:, None]
        full = np.maximum((i + np.array([[0.0], [1.0]])) * self.column, 1e-300) * math.tan(
            math.pi / self.n
        )
        p = [self._corner(k, i + j, down / full[j], second) for j in range(2)]
        return np.column_stack([(1 - part) * p[0] + part * p[1], -down])

    def _unrolled(self, X: Array) -> tuple[Array, Array, Array, Array]:
        """Of points (n, 3): corner k, way s - k a from it, depth -z, and whether they are behind the bisector.

        Points within the hub's polygon have no coordinates.
        """
        step, apothem = 2 * math.pi / self.n, self.side / 2 / math.tan(math.pi / self.n)
        found = [np.full(len(X), np.nan) for _ in range(4)]
        # corner k is where side k ends, side 0 at y = -apothem; far bounds belong to the next corner, if they reach it
        for k, closed in [(k, closed) for closed in (False, True) for k in range(self.n)]:
            c, d = math.cos(step * k), math.sin(step * k)
            x, y = c * X[:, 0] + d * X[:, 1] - self.side / 2, c * X[:, 1] - d * X[:, 0] + apothem
            ρ, ψ = np.hypot(x, y), np.arctan2(y, x)
            tiny = np.minimum(1e-9 * (1 + self.side / np.maximum(ρ, 1e-9 * self.side)), 10.0)
            here = (ψ > -tiny) & (ψ < step + (tiny if closed else -tiny)) & np.isnan(found[0])
            ψ = np.clip(ψ, 0, step)
            nearer = np.minimum(ψ, step - ψ)
            behind = ψ > step / 2 + 1e-9
            values = np.full(len(X), k), ρ * np.cos(nearer), ρ * np.sin(nearer), behind
            for known, new in zip(found, values, strict=True):
                known[here] = new[here]
        return found[0], found[1], found[2], found[3]

    def _corner(
        self,
        k: Array,
        column: Array,
        depth: Array,
        second: Array,
    ) -> Array:
        """Positions (n, 2) on columns, at depths from 0 (z = 0) to 1 (the bisector)."""
        j = column / self.columns
        layer = 2 * j - np.where(second > 0, 2 - depth, depth) * np.minimum(j, 1.0)
        angle = 2 * math.pi / self.n * (k + j + 0.5)
        r = self.radius + self.gap * layer
        result: Array = r[:, None] * np.stack([np.sin(angle), -np.cos(angle)], axis=1)
        return result


class _Open(Star):
    """Layers are so far apart that no fold is shut."""

    @property
    def _ajar(self) -> float:
        return AJAR * self.radius * self.columns / self.reach

    def pressed(self) -> Star:
        return self

    def place(self, X: Array, side: Array) -> Array:
        return Star(
            self.n, self.side, columns=self.columns, reach=self.reach, gap=self._ajar
        ).place(X, side)
