"""Directions across the normal of a pair, as combinations of vectors that are fixed in the
material."""

from __future__ import annotations

import numpy as np

from gossamer_fx.mechanics.contact.arrays import Array
from gossamer_fx.mechanics.contact.stencils import TINY, lengths_of

# Sine of the angle to the normal, or to the other direction, below which an edge gives no direction
# to slide along.
SMALLEST_SINE = 1e-3

# Relative difference up to which two candidates for a direction count as equally good.
TIE = 1e-6

# Two edges of a pair as combinations of its four points: two sides of the triangle, or one of each
# side.
EDGE_WEIGHTS = np.array(
    [[[0, 1, -1, 0], [0, 1, 0, -1]], [[-1, 1, 0, 0], [0, 0, 1, -1]]], dtype=float
)


def unit_vectors(vectors: Array) -> Array:
    """Return vectors (n, 3) of length one; those without a length stay zero."""
    unit: Array = vectors / np.maximum(lengths_of(vectors), TINY)[:, None]
    return unit


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
