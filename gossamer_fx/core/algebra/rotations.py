"""Cross products as matrices, rotations about axes, and right-handed triads."""

from __future__ import annotations

import numpy as np

from gossamer_fx.core.model.body import Array, unit

# Components of a cross product: (a × b)[i] = a[NEXT[i]] b[LAST[i]] - a[LAST[i]] b[NEXT[i]].
NEXT = [1, 2, 0]
LAST = [2, 0, 1]


def cross_matrices(a: Array) -> Array:
    """Skew matrices [a]× (..., 3, 3) of vectors a (..., 3), in their unit, such that [a]× b = a ×
    b.

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
    """Rotation matrices (..., 3, 3) about unit vectors (..., 3), whose length is not checked, by an
    angle [rad], counterclockwise about each axis (Rodrigues' formula).

    >>> import numpy as np
    >>> quarter_turn = rotations(np.array([0.0, 0.0, 1.0]), np.pi / 2)
    >>> np.round(quarter_turn @ np.array([1.0, 0.0, 0.0]), 12)
    array([0., 1., 0.])
    """
    K = cross_matrices(axes)
    sine_part = np.sin(angle) * K
    cosine_part = (1 - np.cos(angle)) * K @ K
    return np.eye(3) + sine_part + cosine_part


def rotation_of(turn: Array) -> Array:
    """The rotation matrix (3, 3) of a rotation vector (3,) [rad]."""
    angle = float(np.linalg.norm(turn))
    # A rotation by nothing has no axis.
    if angle == 0:
        return np.eye(3)
    return rotations(turn / angle, angle)


def perpendicular_pair(n: Array) -> tuple[Array, Array]:
    """Two unit vectors p and q (3,) that form a right-handed triad (p, q, n) with a unit vector n
    (3,), whose length is not checked.

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
