"""Piecewise linear forces of cords and bars, by the corners of measured curves.

Equations (1) to (3) are those of `tabulated_cable`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from gossamer_fx.core.laws.tracing import Number, at_most
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.cable import MIN_SQUARED_STRETCH
from gossamer_fx.mechanics.terms.rows import Response, one_sided_average, positive_part


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of a piecewise linear force, equations (1) and (2) of `tabulated_cable`.

    Strains in the methods are numbers, symbols of a law, or arrays of any shape.

    Attributes:
        strains: x_i (n,).
        sides: s_i (n,), 1 or -1.
        slope_changes: c_i (n,) [N].
    """

    strains: Sequence[Any] | Array
    sides: Sequence[Any] | Array
    slope_changes: Sequence[Any] | Array

    def _rows(self) -> Iterator[tuple[Any, Any, Any]]:
        return zip(self.strains, self.sides, self.slope_changes, strict=True)

    def force(self, x: Any) -> Any:
        """N(x) [N]."""
        return sum((c * s * positive_part(s * (x - corner)) for corner, s, c in self._rows()), 0.0)

    def energy(self, x: Any) -> Any:
        """W(x) [J/m]."""
        return sum((c * positive_part(s * (x - y)) ** 2 / 2 for y, s, c in self._rows()), 0.0)

    def average(self, x0: Any, x1: Any) -> Any:
        """N [N] averaged over the path from x0 to x1."""
        total = 0.0
        for corner, s, c in self._rows():
            total = total + c * s * one_sided_average(s * (x0 - corner), s * (x1 - corner))
        return total

    def of_side(self, side: int) -> Corners:
        """Those in tension (1) or in compression (-1)."""
        chosen = np.asarray(self.sides) == side
        columns = (self.strains, self.sides, self.slope_changes)
        return Corners(*(np.asarray(column)[chosen] for column in columns))

    def as_numbers(self, prefix: str = "") -> dict[str, Array]:
        """Numbers of `Rows`, from which a law makes the corners by `corners_in`."""
        return {f"{prefix}{name}": np.asarray(column)[None] for name, column in vars(self).items()}


def corners_in(numbers: Any, prefix: str = "") -> Corners:
    """The corners among the numbers of a law."""
    names = (f"{prefix}{field.name}" for field in fields(Corners))
    return Corners(*(getattr(numbers, name) for name in names))


def tabulated_bar(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """Energy L W(x) of a bar with the natural length L [m], as a function of e = ½(λ² - 1)."""
    corners = corners_in(numbers)
    λ0 = stretch_of(e0[0])
    λ1 = stretch_of(e1[0])
    L = numbers.length
    # Equation (3) of `tabulated_cable`
    stress = L * corners.average(λ0 - 1, λ1 - 1) / ((λ0 + λ1) / 2)
    return Response([stress], energy=L * corners.energy(λ1 - 1))


def corners_of(strain: Array, force: Array) -> Corners:
    """The corners of the force (1) of `tabulated_cable` through measured points (n,), which rise
    and have no force at zero strain: in tension from zero upwards, then in compression from zero
    downwards."""
    # The table is checked to have no force at zero strain, if only between two of its points.
    if not (strain == 0).any():
        at = int(np.searchsorted(strain, 0.0))
        strain = np.insert(strain, at, 0.0)
        force = np.insert(force, at, 0.0)
    slopes = np.diff(force) / np.diff(strain)
    zero = int(np.flatnonzero(strain == 0)[0])
    in_tension = slopes[zero:]
    # Compression is read from zero downwards, so that its first slope is that at zero.
    in_compression = slopes[:zero][::-1]
    strains = [strain[zero:-1], strain[1 : zero + 1][::-1]]
    changes = [np.diff(in_tension, prepend=0.0), np.diff(in_compression, prepend=0.0)]
    sides = [np.ones(len(in_tension)), -np.ones(len(in_compression))]
    slope_changes = np.concatenate(changes)
    # A point where the slope stays costs an operation at every quadrature point.
    is_corner = slope_changes != 0
    return Corners(
        strains=np.concatenate(strains)[is_corner],
        sides=np.concatenate(sides)[is_corner],
        slope_changes=slope_changes[is_corner],
    )


def stretch_of(ε: Number) -> Number:
    """λ of ε = ½(λ² - 1)."""
    square = 1 + 2 * ε
    return np.sqrt(at_most(square, MIN_SQUARED_STRETCH, holds=MIN_SQUARED_STRETCH, fails=square))
