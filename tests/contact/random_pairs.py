"""Random and degenerate contact pairs for tests."""

from __future__ import annotations

import numpy as np

from gossamer_fx.contact.potential import (
    EDGE_EDGE,
    IN_CYLINDER,
    IN_SPHERE,
    PLANE,
    POINT_TRIANGLE,
    ContactPairs,
)


def near_pairs(kind: int, n: int, seed: int = 0, d: float = 0.1, rigid: bool = False):
    """n pairs of unit size at distances about d, and points of two states x0, x1 (4n, 3) of a step of about d."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, 4, 3))
    if kind == POINT_TRIANGLE:
        w = rng.dirichlet([1, 1, 1], n)
        normal = np.cross(x[:, 2] - x[:, 1], x[:, 3] - x[:, 1])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        x[:, 0] = np.einsum("nk,nkc->nc", w, x[:, 1:]) + d * rng.uniform(0.3, 1.4, (n, 1)) * normal
    elif kind == EDGE_EDGE:
        normal = np.cross(x[:, 1] - x[:, 0], x[:, 3] - x[:, 2])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        s, t = rng.uniform(-0.1, 1.1, (2, n, 1))
        gap = x[:, 0] + s * (x[:, 1] - x[:, 0]) - x[:, 2] - t * (x[:, 3] - x[:, 2])
        x[:, 2:] += (gap + d * rng.uniform(0.3, 1.4, (n, 1)) * normal)[:, None]
    else:
        x[:, 2] /= np.linalg.norm(x[:, 2], axis=1)[:, None]
        x[:, 3] -= np.einsum("nc,nc->n", x[:, 2], x[:, 3])[:, None] * x[:, 2]
        x[:, 3] /= np.linalg.norm(x[:, 3], axis=1)[:, None]
        if kind == PLANE:
            x[:, 0] = x[:, 1] + d * rng.uniform(0.3, 1.4, (n, 1)) * x[:, 2] + x[:, 3]
        else:
            length = 1 - d * rng.uniform(0.3, 1.4, (n, 1))
            x[:, 0] = x[:, 1] + length * x[:, 2]
            if kind == IN_CYLINDER:
                x[:, 0] += rng.normal(size=(n, 1)) * np.cross(x[:, 2], x[:, 3])
    y = x + 0.3 * d * rng.normal(size=(n, 4, 3)) * (
        1.0 if kind <= EDGE_EDGE else np.array([1.0, 1.0, 0, 0])[:, None]
    )
    nodes = np.arange(4 * n, dtype=np.int32).reshape(n, 4)
    offset, S = {
        PLANE: (0.0, d),
        IN_SPHERE: (-1.0, 1 - (1 - d) ** 2),
        IN_CYLINDER: (-1.0, 1 - (1 - d) ** 2),
    }.get(kind, (0.0, d * d))
    pairs = ContactPairs(
        nodes,
        np.full(n, kind, np.uint8),
        rng.uniform(0.5, 2.0, n),
        np.full(n, S),
        np.full(n, offset),
        np.arange(n),
    )
    return pairs, x.reshape(-1, 3), y.reshape(-1, 3)
