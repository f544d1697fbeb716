"""Piecewise linear forces of cords and bars, by the corners of measured curves.

Equations (1) to (3) are those of `tabulated_cable`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.cable import MIN_SQUARED_STRETCH, CableLaw, TensionOnly
from gossamer_fx.mechanics.terms.point_energies import one_sided_average, one_sided_energy


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of a piecewise linear force, equations (1) and (2) of `tabulated_cable`.

    Attributes:
        strains: x_i (n,).
        sides: s_i (n,), 1 or -1.
        slope_changes: c_i (n,) [N].
        stiffness: slope [N] at zero strain in tension.
    """

    strains: Array
    sides: Array
    slope_changes: Array
    stiffness: float

    def force(self, x: Array) -> Array:
        """N(x) [N] of strains of any shape."""
        forces = self.slope_changes * self.sides * np.maximum(self._beyond(x), 0.0)
        return forces.sum(axis=-1)

    def energy(self, x: Array) -> Array:
        """W(x) [J/m] of strains of any shape."""
        return (self.slope_changes * one_sided_energy(self._beyond(x))).sum(axis=-1)

    def average(self, x0: Array, x1: Array) -> tuple[Array, Array]:
        """N [N] averaged over the path from x0 to x1, of any shape, and its derivative by x1."""
        mean, slope = one_sided_average(self._beyond(x0), self._beyond(x1))
        force = (self.slope_changes * self.sides * mean).sum(axis=-1)
        stiffness = (self.slope_changes * slope).sum(axis=-1)
        return force, stiffness

    def _beyond(self, x: Array) -> Array:
        """How far strains are beyond each corner, with a last axis of n corners."""
        return self.sides * (x[..., None] - self.strains)


@dataclass(frozen=True, eq=False)
class TabulatedBars:
    """Energy L W(x) of bars with natural lengths L [m], as a function of ε = ½(λ² - 1).

    It is the `terms.discrete_gradient.PointDensity` of tapes.
    """

    corners: Corners
    lengths: Array

    def strain(self, e: Array) -> Array:
        """Engineering strains (n,) of ε (n, 1)."""
        return _stretch(e[:, 0]) - 1

    def energy(self, e: Array) -> Array:
        return self.lengths * self.corners.energy(self.strain(e))

    def mean_force(self, x0: Array, x1: Array) -> tuple[Array, Array]:
        """Force [N] averaged over the path between engineering strains (n,), and its derivative by
        x1."""
        return self.corners.average(x0, x1)

    def average(self, e0: Array, e1: Array) -> tuple[Array, Array]:
        # Stretches λ0, λ1 (n,) at the start and the end; D is the derivative of S by e1.
        λ0 = _stretch(e0[:, 0])
        λ1 = _stretch(e1[:, 0])
        mean_stretch = (λ0 + λ1) / 2
        force, stiffness = self.mean_force(λ0 - 1, λ1 - 1)
        S = self.lengths * force / mean_stretch
        # d/dε1 = d/dλ1 / λ1 of equation (3) of `tabulated_cable`
        D = self.lengths * (stiffness - force / (2 * mean_stretch)) / mean_stretch / λ1
        return S[:, None], D[:, None, None]


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
        stiffness=float(in_tension[0]),
    )


def linear_corners(law: CableLaw) -> Corners:
    """The corner at zero of a force that is linear in the engineering strain, on both sides or in
    tension only."""
    sides = np.array([1.0] if isinstance(law, TensionOnly) else [1.0, -1.0])
    return Corners(np.zeros(len(sides)), sides, np.full(len(sides), law.EA), law.EA)


def _stretch(ε: Array) -> Array:
    """λ of ε = ½(λ² - 1)."""
    return np.sqrt(np.maximum(1 + 2 * ε, MIN_SQUARED_STRETCH))
