"""Derivatives of the parameters of closest points with respect to the points of a pair.

The closest points of two sides minimise φ(u, v) = |z|², z = r + u a + v b, over a triangle or a
square, with the vectors r, a, b of `contact.potential`.  Where the minimum is in the interior both
parameters are free; on a side of the domain one combination of them is; at a corner none.  With the
free directions D (2, f), the stationarity Dᵀ(a·z, b·z) = 0 gives

    d(u, v) = -D (Dᵀ H D)⁻¹ Dᵀ d(a·z, b·z),    H = [[a·a, a·b], [a·b, b·b]]                      (1)

where the right side is taken at constant (u, v).
"""

from __future__ import annotations

import numpy as np

from gossamer_fx.contact.arrays import Array, ByteArray
from gossamer_fx.contact.pair_table import PairKind

# r, a, b as combinations of the four points, by kind of pair; those of `kernels/pair_geometry.h`.
TRIANGLE_VECTORS = np.array([[1.0, -1, 0, 0], [0, 1, -1, 0], [0, 1, 0, -1]])
EDGE_VECTORS = np.array([[1.0, 0, -1, 0], [-1, 1, 0, 0], [0, 0, 1, -1]])

# Distance of u + v from one up to which the closest point is on the third side of a triangle: the
# round-off of the sum.  The other sides have exact zeros and ones.
ON_THIRD_SIDE = 1e-14

# Least determinant of H, over the product of its diagonal, for which both parameters are free: a
# and b are parallel below it, as `SAFE_SINE_SQUARED` of the kernels says.
SAFE_SINE_SQUARED = 1e-14


def parameter_derivatives(kind: ByteArray, x: Array, parameters: Array) -> Array:
    """Return the derivatives (n, 2, 4, 3) [1/m] of (u, v) with respect to the points of n pairs.

    Zero for walls, which have no parameters, and where the closest points are corners.

    The closest points minimise |z|² with z = r + u a + v b, the vector between the sides [m]. H (n,
    2, 2) [m²] is the matrix of products of a and b.

    Args:
        kind: of each pair (n,), a `PairKind`.
        x: points (n, 4, 3) [m].
        parameters: (u, v) (n, 2) of the closest points there.
    """
    is_edges = kind == PairKind.EDGE_EDGE
    vectors = np.where(is_edges[:, None, None], EDGE_VECTORS, TRIANGLE_VECTORS)
    r, a, b = np.einsum("nik,nkc->inc", vectors, x)
    u, v = parameters.T
    z = r + u[:, None] * a + v[:, None] * b
    of_z = vectors[:, 0] + u[:, None] * vectors[:, 1] + v[:, None] * vectors[:, 2]
    # d(a·z) and d(b·z) by the points, at constant parameters.
    of_slopes = np.empty((len(kind), 2, 4, 3))
    for row, side in enumerate((a, b)):
        of_side = vectors[:, 1 + row]
        of_slopes[:, row] = of_side[:, :, None] * z[:, None] + of_z[:, :, None] * side[:, None]
    H = np.empty((len(kind), 2, 2))
    H[:, 0, 0] = (a * a).sum(axis=1)
    H[:, 1, 1] = (b * b).sum(axis=1)
    H[:, 0, 1] = H[:, 1, 0] = (a * b).sum(axis=1)
    inverse = _inverse_on_free_directions(kind, H, parameters)
    found: Array = -np.einsum("nij,njkc->nikc", inverse, of_slopes)
    return found


def _inverse_on_free_directions(kind: ByteArray, H: Array, parameters: Array) -> Array:
    """Return D (Dᵀ H D)⁻¹ Dᵀ (n, 2, 2) of (1) for H (n, 2, 2) and parameters (n, 2).

    D (2, f) are the directions in which the parameters (u, v) of the closest points are free; the
    result is zero at corners. H [m²] has the products of the vectors a and b of a pair.

    Args:
        kind: of each pair (n,), a `PairKind`.
    """
    u, v = parameters.T
    is_edges = kind == PairKind.EDGE_EDGE
    is_triangle = kind == PairKind.POINT_TRIANGLE
    on_third_side = is_triangle & (np.abs(u + v - 1) <= ON_THIRD_SIDE)
    first_is_free = (u > 0) & np.where(is_edges, u < 1, ~on_third_side)
    second_is_free = (v > 0) & np.where(is_edges, v < 1, ~on_third_side)
    inverse = np.zeros_like(H)
    determinant = H[:, 0, 0] * H[:, 1, 1] - H[:, 0, 1] ** 2
    is_safe = determinant > SAFE_SINE_SQUARED * H[:, 0, 0] * H[:, 1, 1]

    both = first_is_free & second_is_free & is_safe
    inverse[both] = np.linalg.inv(H[both])
    first_alone = first_is_free & ~second_is_free & ~on_third_side
    inverse[first_alone, 0, 0] = 1 / H[first_alone, 0, 0]
    second_alone = second_is_free & ~first_is_free & ~on_third_side
    inverse[second_alone, 1, 1] = 1 / H[second_alone, 1, 1]
    # Between the corners of the third side, along (1, -1).
    inside = on_third_side & (u > 0) & (v > 0)
    along = np.array([1.0, -1.0])
    curvature = np.einsum("i,nij,j->n", along, H[inside], along)
    inverse[inside] = np.outer(along, along) / curvature[:, None, None]
    return inverse
