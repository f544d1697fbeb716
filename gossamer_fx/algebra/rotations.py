"""Cross products as matrices, rotations about axes, and triads."""

from __future__ import annotations

import numpy as np

from gossamer_fx.model.body import Array
from gossamer_fx.model.ports import unit


def cross_matrices(a: Array) -> Array:
    """[a]× (..., 3, 3) of vectors (..., 3), with [a]× b = a × b."""
    result = np.zeros((*a.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        result[..., i, j], result[..., j, i] = -a[..., k], a[..., k]
    return result


def rotations(axes: Array, angle: float) -> Array:
    """Rotations (..., 3, 3) by an angle [rad] about unit vectors (..., 3): Rodrigues' formula."""
    K = cross_matrices(axes)
    result: Array = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    return result


def perpendicular_pair(n: Array) -> tuple[Array, Array]:
    """Two unit vectors that form a right-handed triad (p, q, n) with the unit vector n."""
    p = unit(np.cross(n, np.eye(3)[np.argmin(np.abs(n))]))
    return p, np.cross(n, p)
