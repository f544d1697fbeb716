"""Directions across the normal of a pair, as combinations of vectors that are fixed in the
material."""

from __future__ import annotations

import numpy as np

from gossamer_fx.mechanics.contact.arrays import Array, ByteArray
from gossamer_fx.mechanics.contact.pair_table import PairKind

# Sine of the angle to the normal, or to the other direction, below which an edge gives no direction
# to slide along.
SMALLEST_SINE = 1e-3

# Relative difference up to which two candidates for a direction count as equally good.
TIE = 1e-6

# No length: divisions by smaller ones are meaningless, and their result is not used.
TINY = 1e-300

# Two edges of a pair as combinations of its four points: two sides of the triangle, or one of each
# side.
EDGE_WEIGHTS = np.array(
    [
        [[0, 1, -1, 0], [0, 1, 0, -1]],
        [[-1, 1, 0, 0], [0, 0, 1, -1]],
    ],
    dtype=float,
)


def lengths_of(vectors: Array) -> Array:
    """Return the lengths (...) of vectors (..., 3).

    Of complex vectors it is the analytic function of them, and not the norm: a complex step
    differentiates it.
    """
    length: Array = np.sqrt((vectors * vectors).sum(axis=-1))
    return length


def unit_vectors(vectors: Array) -> Array:
    """Return vectors (n, 3) of length one; those without a length stay zero."""
    unit: Array = vectors / np.maximum(lengths_of(vectors), TINY)[:, None]
    return unit


def gap_weights(kind: ByteArray, parameters: Array) -> Array:
    """Return the weights of a contact pair's four points in the vector from its second side to its
    first.

    It leads between the closest points of the start; of walls it is their first point.

    Args:
        kind: of the n pairs, a `PairKind`.
        parameters: (u, v) (n, 2) of the closest points.

    Returns:
        (n, 4) [-].
    """
    u = parameters[:, 0]
    v = parameters[:, 1]
    one = np.ones(len(u))
    of_triangles = np.column_stack([one, u + v - 1, -u, -v])
    of_edges = np.column_stack([1 - u, u, v - 1, -v])
    of_walls = np.array([1.0, 0, 0, 0])
    is_triangle = (kind == PairKind.POINT_TRIANGLE)[:, None]
    is_edges = (kind == PairKind.EDGE_EDGE)[:, None]
    weights: Array = np.select([is_triangle, is_edges], [of_triangles, of_edges], of_walls)
    return weights


def orthonormal_combinations(vectors: Array, lengths: Array) -> Array:
    """Return combinations of two vectors that are orthonormal.

    The vector that has kept more of its length comes first; of the other one what is along the
    first is taken away.

    Args:
        vectors: parts across the normal of two edges (n, 2, 3) [m].
        lengths: of the edges (n, 2) [m].  A part that is shorter than a thousandth of its edge
            gives no direction, and its combination is zero.

    Returns:
        coefficients (n, 2, 2) [1/m]: row i has those of both vectors in direction i.
    """
    count = len(vectors)
    combinations = np.zeros((count, 2, 2), dtype=vectors.dtype)
    if not count:
        return combinations
    rows = np.arange(count)
    length = lengths_of(vectors)
    kept = length / np.maximum(lengths, TINY)
    # Round-off must not choose between edges that are equally good, as both sides of a triangle
    # below its point are: a complex step has to find the directions that it differentiates.
    first = np.where(kept[:, 1].real > (1 + TIE) * kept[:, 0].real, 1, 0)
    second = 1 - first
    first_length = length[rows, first]
    has_first = first_length > SMALLEST_SINE * lengths[rows, first]
    scale = np.where(has_first, 1 / np.maximum(first_length, TINY), 0)
    combinations[rows, 0, first] = scale
    direction = vectors[rows, first] * scale[:, None]
    along = (vectors[rows, second] * direction).sum(axis=1)
    across = vectors[rows, second] - along[:, None] * direction
    across_length = lengths_of(across)
    has_second = has_first & (across_length > SMALLEST_SINE * lengths[rows, second])
    across_scale = np.where(has_second, 1 / np.maximum(across_length, TINY), 0)
    combinations[rows, 1, second] = across_scale
    combinations[rows, 1, first] = -across_scale * along * scale
    return combinations
