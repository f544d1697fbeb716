"""Derivatives of the parameters of closest points with respect to the points of a pair.

The closest points of two sides minimise φ(u, v) = |z|², z = r + u a + v b, over a triangle or a
square, with the vectors r, a, b of `contact_step`.  Where the minimum is in the interior both
parameters are free; on a side of the domain one combination of them is; at a corner none.  With the
free directions D (2, f), the stationarity Dᵀ(a·z, b·z) = 0 gives

    d(u, v) = -D (Dᵀ H D)⁻¹ Dᵀ d(a·z, b·z),    H = [[a·a, a·b], [a·b, b·b]]                      (1)

where the right side is taken at constant (u, v).
"""

from __future__ import annotations

import numpy as np

from gossamer_fx.mechanics.contact.contract import Array, Sides

# r, a, b as combinations of the four points, by sides; those of `kernels/stencils.c`.
VECTORS = {
    Sides.POINT_TRIANGLE: np.array([[1.0, -1, 0, 0], [0, 1, -1, 0], [0, 1, 0, -1]]),
    Sides.EDGE_EDGE: np.array([[1.0, 0, -1, 0], [-1, 1, 0, 0], [0, 0, 1, -1]]),
}

# Distance of u + v from one up to which the closest point is on the third side of a triangle: the
# round-off of the sum.  The other sides have exact zeros and ones.
ON_THIRD_SIDE = 1e-14

# Least determinant of H, over the product of its diagonal, for which both parameters are free: a
# and b are parallel below it, as `SAFE_SINE_SQUARED` of the kernels says.
SAFE_SINE_SQUARED = 1e-14


def parameter_derivatives(
    sides: Sides, x: Array, parameters: Array, taper: Array | None = None
) -> Array:
    """Return the derivatives (n, 2, 4, 3) [1/m] of (u, v) with respect to the points of n pairs.
    Zero where the closest points are corners. The closest points minimise |z|² with z = r + u a + v
    b, the vector between the sides [m]. H (n, 2, 2) [m²] is the matrix of products of a and b.
    `taper`: T (n,) [m] of cones, which minimise |z| - T v instead."""
    # r, a, b as combinations of the points (3, 4), then as vectors (n, 3, 3).
    weights = VECTORS[sides]
    vectors = np.einsum("ik,nkc->nic", weights, x)
    # z = r + u a + v b.
    ones = np.ones((len(x), 1))
    factors = np.hstack([ones, parameters])
    weights_of_z = np.einsum("ni,ik->nk", factors, weights)
    z = np.einsum("ni,nic->nc", factors, vectors)
    along = vectors[:, 1:]
    # d(a·z) and d(b·z) by the points, at constant parameters.
    by_sides = np.einsum("ik,nc->nikc", weights[1:], z)
    by_z = np.einsum("nk,nic->nikc", weights_of_z, along)
    H = np.einsum("nic,njc->nij", along, along)
    if taper is not None:
        # The derivatives of |z| are those of |z|²/2 over |z|, but for a term that is left where z
        # is not normal to the side: (side·z)/|z| is T along the axis of a cone, and zero along the
        # edge.
        normal = z / np.linalg.norm(z, axis=1)[:, None]
        along_normal = np.stack([np.zeros_like(taper), taper], axis=1)
        H = H - np.einsum("ni,nj->nij", along_normal, along_normal)
        of_length = np.einsum("nk,nc->nkc", weights_of_z, normal)
        by_z = by_z - np.einsum("ni,nkc->nikc", along_normal, of_length)
    inverse = inverse_on_free_directions(sides, H, parameters)
    return -np.einsum("nij,njkc->nikc", inverse, by_sides + by_z)


def inverse_on_free_directions(sides: Sides, H: Array, parameters: Array) -> Array:
    """Return D (Dᵀ H D)⁻¹ Dᵀ (n, 2, 2) of (1) for H (n, 2, 2) and parameters (n, 2). D (2, f) are
    the directions in which the parameters (u, v) of the closest points are free; the result is zero
    at corners. H [m²] has the products of the vectors a and b of a pair."""
    u = parameters[:, 0]
    v = parameters[:, 1]
    aa = H[:, 0, 0]
    bb = H[:, 1, 1]
    # Parameters of edges lie in a square, those of triangles below the third side.
    is_triangle = sides == Sides.POINT_TRIANGLE
    on_third_side = is_triangle & (np.abs(u + v - 1) <= ON_THIRD_SIDE)
    u_is_free = (u > 0) & (u < 1) & ~on_third_side
    v_is_free = (v > 0) & (v < 1) & ~on_third_side
    inverse = np.zeros_like(H)

    determinant = np.linalg.det(H)
    is_safe = determinant > SAFE_SINE_SQUARED * aa * bb
    both = u_is_free & v_is_free & is_safe
    inverse[both] = np.linalg.inv(H[both])

    only_u = u_is_free & ~v_is_free & ~on_third_side
    inverse[only_u, 0, 0] = 1 / aa[only_u]
    only_v = v_is_free & ~u_is_free & ~on_third_side
    inverse[only_v, 1, 1] = 1 / bb[only_v]

    # Between the corners of the third side, along (1, -1).
    inside = on_third_side & (u > 0) & (v > 0)
    along = np.array([1.0, -1.0])
    curvature = np.einsum("i,nij,j->n", along, H[inside], along)
    projector = np.outer(along, along)
    inverse[inside] = projector / curvature[:, None, None]
    return inverse
