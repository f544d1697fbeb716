"""Cross products as matrices, rotations about axes, and right-handed triads."""

from __future__ import annotations

import numpy as np

from gossamer_fx.core.model.body import Array, unit


def cross_matrices(a: Array) -> Array:
    """Skew matrices [a]× (..., 3, 3) of vectors, such that [a]× b = a × b.

    Args:
        a: vectors (..., 3), in any unit, which the matrices have, too.

    >>> import numpy as np
    >>> cross_matrices(np.array([1.0, 0.0, 0.0])) @ np.array([0.0, 1.0, 0.0])
    array([0., 0., 1.])
    """
    result = np.zeros((*a.shape, 3))
    cyclic_permutations = (
        (0, 1, 2),
        (1, 2, 0),
        (2, 0, 1),
    )
    for i, j, k in cyclic_permutations:
        result[..., i, j] = -a[..., k]
        result[..., j, i] = a[..., k]
    return result


def rotations(axes: Array, angle: float) -> Array:
    """Rotation matrices (..., 3, 3) about axes (..., 3), by Rodrigues' formula.

    Args:
        axes: unit vectors (..., 3), dimensionless; that they have unit length is not checked.
        angle: angle [rad], counterclockwise about each axis.

    >>> import numpy as np
    >>> quarter_turn = rotations(np.array([0.0, 0.0, 1.0]), np.pi / 2)
    >>> np.round(quarter_turn @ np.array([1.0, 0.0, 0.0]), 12)
    array([0., 1., 0.])
    """
    K = cross_matrices(axes)
    sine_part = np.sin(angle) * K
    cosine_part = (1 - np.cos(angle)) * K @ K
    result: Array = np.eye(3) + sine_part + cosine_part
    return result


def perpendicular_pair(n: Array) -> tuple[Array, Array]:
    """Two unit vectors p and q (3,) that form a right-handed triad (p, q, n) with n.

    Args:
        n: unit vector (3,), dimensionless; that its length is one is not checked.

    >>> import numpy as np
    >>> p, q = perpendicular_pair(np.array([0.0, 0.0, 1.0]))
    >>> float(np.cross(p, q)[2])
    1.0
    """
    # The coordinate axis that is farthest from n gives the best conditioned cross product.
    farthest = np.argmin(np.abs(n))
    axis = np.eye(3)[farthest]
    p = unit(np.cross(n, axis))
    q = np.cross(n, p)
    return p, q
