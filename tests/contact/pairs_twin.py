"""The equations of contact pairs in NumPy, one pair at a time, as `contact.pairs` states them: slow, easy to read."""

from __future__ import annotations

import numpy as np

from gossamer_fx.contact.potential import (
    BARRIER,
    EDGE_EDGE,
    IN_CYLINDER,
    IN_SPHERE,
    PLANE,
    POINT_TRIANGLE,
    ROUNDING,
    ContactPairs,
)

FIRST, SECOND = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]
ROWS = {
    POINT_TRIANGLE: [[1, -1, 0, 0], [0, 1, -1, 0], [0, 1, 0, -1]],
    EDGE_EDGE: [[1, 0, -1, 0], [-1, 1, 0, 0], [0, 0, 1, -1]],
    PLANE: [[1, -1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 0]],
    IN_SPHERE: [[1, -1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]],
    IN_CYLINDER: [[1, -1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
}
GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)


def gram(Y):
    """e (6,) of Y (3, 3)."""
    return np.array([Y[i] @ Y[j] for i, j in zip(FIRST, SECOND, strict=True)])


def weights(u, v):
    """φ (6,)."""
    return np.array([1, 2 * u, 2 * v, u * u, 2 * u * v, v * v])


def nearest(e, edges):
    """(u, v) of the minimum of φ·e over the triangle or square, by its interior, sides and corners."""
    _, ra, rb, aa, ab, bb = e
    F, g = np.array([[aa, ab], [ab, bb]]), np.array([ra, rb])
    candidates = []
    if np.linalg.det(F) > 1e-14 * aa * bb:
        z = np.linalg.solve(F, -g)
        if z.min() >= 0 and (z.max() <= 1 if edges else z.sum() <= 1):
            return z
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)] if edges else [(0, 0), (1, 0), (0, 1)]
    for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
        p, d = np.array(start, float), np.subtract(end, start)
        dd = d @ F @ d
        candidates.append(p + np.clip(-d @ (g + F @ p) / dd if dd > 0 else 0, 0, 1) * d)
    return min(candidates, key=lambda z: weights(*z) @ e)


class Pair:
    """One pair in one step: its distance as a function of e, with r moved to the nearest points of the start."""

    def __init__(self, pairs: ContactPairs, i: int, x0: np.ndarray, law: int) -> None:
        self.kind, self.law, self.nodes = int(pairs.kind[i]), law, pairs.nodes[i]
        self.k, self.S, self.offset = pairs.k[i], pairs.S[i], pairs.offset[i]
        self.edges = self.kind == EDGE_EDGE
        self.rounding = ROUNDING * self.S if self.edges else 0.0
        self.R, self.at = np.array(ROWS[self.kind], float), np.zeros(2)
        if self.kind <= EDGE_EDGE:
            self.at = nearest(gram(self.R @ x0[self.nodes]), self.edges)
            self.R[0] += self.at @ self.R[1:]

    def vectors(self, x):
        return self.R @ x[self.nodes]

    def distance(self, e):
        """s and φ = ds/de."""
        if self.kind == PLANE:
            return e[1], np.array([0, 1.0, 0, 0, 0, 0])
        if self.kind == IN_SPHERE:
            return -e[0], np.array([-1.0, 0, 0, 0, 0, 0])
        if self.kind == IN_CYLINDER:
            return -(e[1] ** 2) - e[2] ** 2, np.array([0, -2 * e[1], -2 * e[2], 0, 0, 0])
        whole = self._shift(e)
        u, v = nearest(whole + self.rounding * np.array([0.5, -0.5, -0.5, 1, 0, 1]), self.edges)
        φ = weights(u - self.at[0], v - self.at[1])
        return φ @ e + self.rounding * ((u - 0.5) ** 2 + (v - 0.5) ** 2), φ

    def _shift(self, e):
        """The measures of the vectors before r was moved."""
        G = np.zeros((3, 3))
        G[FIRST, SECOND] = G[SECOND, FIRST] = e
        T = np.eye(3)
        T[0, 1:] = -self.at
        return (T @ G @ T.T)[FIRST, SECOND]

    def density(self, x):
        """b(x)."""
        if x >= 1:
            return 0.0
        if self.law == BARRIER:
            return (1 - x) ** 3 / (4 * x)
        return (1 - (x if self.kind >= PLANE else np.sqrt(x))) ** 2 / 2

    def energy(self, x):
        s, _ = self.distance(gram(self.vectors(x)))
        return self.k * self.density((s - self.offset) / self.S)

    def force(self, x0, x1):
        """De(q̄)ᵀ S̄ (4, 3)."""
        Y0, Y1 = self.vectors(x0), self.vectors(x1)
        e0, e1 = gram(Y0), gram(Y1)
        Δ = e1 - e0
        s0, s1 = self.distance(e0)[0], self.distance(e1)[0]
        φ = sum(self.distance(e0 + τ * Δ)[1] for τ in GAUSS) / 2
        φ = φ + (s1 - s0 - φ @ Δ) / (Δ @ Δ) * Δ
        b0, b1 = (self.density((s - self.offset) / self.S) for s in (s0, s1))
        S = self.k * (b1 - b0) / (s1 - s0) * φ
        Q = np.zeros((3, 3))
        for m in range(6):
            Q[FIRST[m], SECOND[m]] += S[m]
            Q[SECOND[m], FIRST[m]] += S[m]
        return self.R.T @ Q @ (Y0 + Y1) / 2
