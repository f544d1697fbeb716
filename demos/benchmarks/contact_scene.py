"""A film thrown at another: the same places, speeds and constants for every program, and what is asked of the end."""

from __future__ import annotations

import numpy as np

SIZE, DISTANCE, SPEED = 0.2, 1e-3, 2.0
E, NU, DENSITY, THICKNESS = 1e7, 0.3, 1400.0, 1e-4
SIGMA = DENSITY * THICKNESS
LAME = (
    E * THICKNESS / (2 * (1 + NU)),
    E * THICKNESS * NU / (1 - NU**2),
)  # of plane stress, over the thickness [N/m]


def grid(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (p, 3) and triangles (t, 3) of a square film about the origin."""
    a = np.linspace(-SIZE / 2, SIZE / 2, n + 1)
    x, y = np.meshgrid(a, a, indexing="ij")
    number = np.arange(x.size).reshape(x.shape)
    p, q, r, s = (
        c.ravel() for c in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    )
    return np.stack([x, y, 0 * x], axis=2).reshape(-1, 3), np.vstack(
        [np.stack([p, q, r], 1), np.stack([p, r, s], 1)]
    )


def thrown(X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places and velocities of the upper film, of its stress-free places (p, 3): turned about z, and turning."""
    c, s = np.cos(0.4), np.sin(0.4)
    x = X @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + np.array([0.02, 0.01, 2e-3])
    return x, np.cross([0, 0, 5.0], X) + np.array([0.2, 0.1, -SPEED])


def films(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Stress-free places, places, velocities (p, 3) of both, and triangles (t, 3)."""
    X, triangles = grid(n)
    x, v = thrown(X)
    return (
        np.vstack([X, X]),
        np.vstack([X, x]),
        np.vstack([0 * X, v]),
        np.vstack([triangles, triangles + len(X)]),
    )


def elastic_energy(X: np.ndarray, x: np.ndarray, triangles: np.ndarray) -> float:
    """[J], of Newton's neo-Hookean membrane: ½ μ (tr FᵀF - 2) + ½ (λ + μ)(J - 1 - μ/(λ + μ))², zero at rest."""
    D = np.stack([X[triangles[:, k]] - X[triangles[:, 0]] for k in (1, 2)], axis=2)[:, :2]
    d = np.stack([x[triangles[:, k]] - x[triangles[:, 0]] for k in (1, 2)], axis=2)
    F = d @ np.linalg.inv(D)
    C = np.einsum("nci,ncj->nij", F, F)
    μ, λ = LAME[0], LAME[0] + LAME[1]
    α = 1 + μ / λ
    J = np.sqrt(np.linalg.det(C))
    ψ = μ / 2 * (np.trace(C, axis1=1, axis2=2) - 2) + λ / 2 * ((J - α) ** 2 - (1 - α) ** 2)
    return float((ψ * np.abs(np.linalg.det(D)) / 2).sum())


def pierced(x: np.ndarray, triangles: np.ndarray) -> int:
    """How many edges pierce triangles, by all pairs."""
    edges = np.unique(
        np.sort(triangles[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2), axis=1), axis=0
    )
    count = 0
    a, b, c = (x[triangles[:, k]] for k in range(3))
    for p, q in edges:
        apart = ~((triangles == p) | (triangles == q)).any(axis=1)
        M = np.stack([np.broadcast_to(x[q] - x[p], a.shape), a - b, a - c], axis=2)
        good = apart & (np.abs(np.linalg.det(M)) > 1e-30)
        s, u, v = np.linalg.solve(M[good], (a - x[p])[good][..., None])[..., 0].T
        count += int(((s > 0) & (s < 1) & (u > 0) & (v > 0) & (u + v < 1)).sum())
    return count
