"""The equations of contact pairs in NumPy, one at a time, as `contact.contact_step` states them.

It is slow and easy to read: the C kernel has to agree with it.
"""

from __future__ import annotations

import numpy as np

from gossamer_fx.mechanics.contact.contact_step import ROUNDING, ContactLaw
from gossamer_fx.mechanics.contact.pairs import (
    ActivePairs,
    EdgeEdge,
    PointInCylinder,
    PointInSphere,
    PointPlane,
    PointTriangle,
)

# Which two of the vectors r, a, b make each measure.
FIRST = [0, 0, 0, 1, 1, 2]
# FIRST and SECOND: indices of the two vectors in each of the six products r·r, r·a, ..., b·b.
SECOND = [0, 1, 2, 1, 2, 2]

# r, a, b as combinations of the four points.
ROWS = {
    PointTriangle.number: [[1, -1, 0, 0], [0, 1, -1, 0], [0, 1, 0, -1]],
    EdgeEdge.number: [[1, 0, -1, 0], [-1, 1, 0, 0], [0, 0, 1, -1]],
    PointPlane.number: [[1, -1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 0]],
    PointInSphere.number: [[1, -1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]],
    PointInCylinder.number: [[1, -1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
}
# Two Gauss points integrate cubic functions; as in the kernel, edges have two in each quarter.
GAUSS_POINTS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)
POINTS_OF_EDGES = ((np.arange(4)[:, None] + GAUSS_POINTS) / 4).ravel()

# The rounding ε ((u - ½)² + (v - ½)²) as measures, but for a constant in the first.
ROUNDING_MEASURES = np.array([0.5, -0.5, -0.5, 1, 0, 1])


def measures_of(vectors: np.ndarray) -> np.ndarray:
    """Return e (6,) of r, a, b (3, 3)."""
    products = []
    for i, j in zip(FIRST, SECOND, strict=True):
        products.append(vectors[i] @ vectors[j])
    return np.array(products)


def weights(u: float, v: float) -> np.ndarray:
    """Return φ (6,)."""
    return np.array([1, 2 * u, 2 * v, u * u, 2 * u * v, v * v])


def closest_parameters(e: np.ndarray, is_edges: bool) -> np.ndarray:
    """Return the (u, v) of the least φ·e over the triangle or square: interior, sides and
    corners."""
    _, ra, rb, aa, ab, bb = e
    F = np.array([[aa, ab], [ab, bb]])
    g = np.array([ra, rb])
    # Parallel edges and slivers have a singular F: there the least value is on a side.
    if np.linalg.det(F) > 1e-14 * aa * bb:
        inner = np.linalg.solve(F, -g)
        # The unit square of two edges, or the triangle u + v <= 1.
        is_inside = inner.max() <= 1 if is_edges else inner.sum() <= 1
        if inner.min() >= 0 and is_inside:
            return inner
    # The least value on each side of the square or triangle.
    corners = [(0, 0), (1, 0), (0, 1)]
    if is_edges:
        corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
    following = corners[1:] + corners[:1]
    candidates = []
    for start, end in zip(corners, following, strict=True):
        corner = np.array(start, float)
        side = np.subtract(end, start)
        slope = side @ (g + F @ corner)
        curvature = side @ F @ side
        # A side without length is one point.
        t = 0.0
        if curvature > 0:
            t = np.clip(-slope / curvature, 0, 1)
        candidates.append(corner + t * side)
    return min(candidates, key=lambda z: weights(*z) @ e)


class PairTwin:
    """One pair in one step: its distance as a function of e, r moved to the closest points of
    x0."""

    def __init__(self, pairs: ActivePairs, row: int, x0: np.ndarray, law: ContactLaw) -> None:
        self.kind = int(pairs.kind[row])
        self.law = law
        self.points = pairs.points[row]
        self.stiffness = pairs.stiffness[row]
        self.width = pairs.width[row]
        self.offset = pairs.offset[row]
        self.is_edges = self.kind == EdgeEdge.number
        # Only distances of edges are rounded; their gradient jumps where the closest points do.
        self.rounding = ROUNDING * self.width if self.is_edges else 0.0
        self.R = np.array(ROWS[self.kind], float)
        self.base = np.zeros(2)
        if self.kind <= EdgeEdge.number:
            measures = measures_of(self.R @ x0[self.points])
            self.base = closest_parameters(measures, self.is_edges)
            # r from closest point to closest point: small numbers without cancellation.
            self.R[0] += self.base @ self.R[1:]

    def vectors(self, x: np.ndarray) -> np.ndarray:
        """Return r, a, b (3, 3)."""
        return self.R @ x[self.points]

    def distance(self, e: np.ndarray) -> tuple[float, np.ndarray]:
        """Return s and φ = ds/de."""
        if self.kind == PointPlane.number:
            return e[1], np.array([0, 1.0, 0, 0, 0, 0])
        if self.kind == PointInSphere.number:
            return -e[0], np.array([-1.0, 0, 0, 0, 0, 0])
        if self.kind == PointInCylinder.number:
            gradient = np.array([0, -2 * e[1], -2 * e[2], 0, 0, 0])
            return -(e[1] ** 2) - e[2] ** 2, gradient
        rounded = self._before_the_base_moved(e) + self.rounding * ROUNDING_MEASURES
        u, v = closest_parameters(rounded, self.is_edges)
        φ = weights(u - self.base[0], v - self.base[1])
        from_middle = (u - 0.5) ** 2 + (v - 0.5) ** 2
        return φ @ e + self.rounding * from_middle, φ

    def _before_the_base_moved(self, e: np.ndarray) -> np.ndarray:
        """Return the measures of the vectors before r was moved."""
        G = np.zeros((3, 3))
        G[FIRST, SECOND] = e
        G[SECOND, FIRST] = e
        T = np.eye(3)
        # Moving the base subtracts u a + v b from r.
        T[0, 1:] = -self.base
        return (T @ G @ T.T)[FIRST, SECOND]

    def energy_of(self, x: float) -> float:
        """Return b(x)."""
        if x >= 1:
            return 0.0
        # The barrier of the contact potential: C² at x = 1 and infinite at 0.
        if self.law == ContactLaw.BARRIER:
            return (1 - x) ** 3 / (4 * x)
        # Boundaries give a linear distance, pairs of surfaces a squared one.
        is_boundary = self.kind >= PointPlane.number
        scaled_gap = x if is_boundary else np.sqrt(x)
        return (1 - scaled_gap) ** 2 / 2

    def scaled(self, s: float) -> float:
        """Return the scaled distance of a squared distance."""
        return (s - self.offset) / self.width

    def energy(self, x: np.ndarray) -> float:
        """Return the energy [J] at points x (m, 3)."""
        s, _ = self.distance(measures_of(self.vectors(x)))
        return self.stiffness * self.energy_of(self.scaled(s))

    def force(self, x0: np.ndarray, x1: np.ndarray) -> np.ndarray:
        """Return the forces De(q_mid)ᵀ S (4, 3) of a step."""
        start = self.vectors(x0)
        end = self.vectors(x1)
        e0 = measures_of(start)
        e1 = measures_of(end)
        change = e1 - e0
        s0, _ = self.distance(e0)
        s1, _ = self.distance(e1)
        path = POINTS_OF_EDGES if self.is_edges else GAUSS_POINTS
        mean = np.mean([self.distance(e0 + τ * change)[1] for τ in path], axis=0)
        # Correction that makes the mean gradient do exactly the change s1 - s0.
        missing = s1 - s0 - mean @ change
        # Measures count by their sizes: of r the width, of a and b their mean squared length.
        sizes = self.width + np.array([0, e0[3] + e1[3], e0[5] + e1[5]]) / 2
        direction = change / (sizes[FIRST] * sizes[SECOND])
        mean = mean + missing / (change @ direction) * direction
        b0 = self.energy_of(self.scaled(s0))
        b1 = self.energy_of(self.scaled(s1))
        # Secant of the potential over the change of the distance.
        slope = (b1 - b0) / (s1 - s0)
        stress = self.stiffness * slope * mean
        Q = np.zeros((3, 3))
        for m in range(6):
            Q[FIRST[m], SECOND[m]] += stress[m]
            Q[SECOND[m], FIRST[m]] += stress[m]
        return self.R.T @ Q @ (start + end) / 2
