"""Closest points of triangulated surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from gossamer_fx.core.model.body import Array

Numbers = npt.NDArray[np.int64]

# Pairs of a point and a triangle that are computed at once, which limits the memory.
PAIRS_AT_ONCE = 2_000_000


@dataclass(frozen=True, eq=False)
class ClosestPoints:
    """Closest points of a surface to n given points.

    Attributes:
        triangle: number (n,) of the triangle on which each lies.
        weights: barycentric coordinates (n, 3) in it.
        points: their positions (n, 3) [m].
        distance: (n,) [m].
    """

    triangle: Numbers
    weights: Array
    points: Array
    distance: Array


def closest_points(points: Array, triangles: Numbers, given: Array) -> ClosestPoints:
    """The closest points of triangles (m, 3) between points (k, 3) [m] to given ones (n, 3) [m]."""
    corners = points[triangles]
    centres = corners.mean(axis=1)
    reach = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    # The nearest corner limits the distance d.  The triangle of the closest point then has its
    # centre within d plus the distance from its centre to its farthest corner.
    used = np.unique(triangles)
    upper_bound, _ = KDTree(points[used]).query(given)
    tree = KDTree(centres)
    # With round-off, as the corners of the largest triangle are just this far from its centre.
    radius = (upper_bound + float(reach.max())) * (1 + 1e-9)
    candidates = tree.query_ball_point(given, radius, return_sorted=True)
    counts = np.array([len(found) for found in candidates])
    triangle = np.zeros(len(given), dtype=np.int64)
    weights = np.zeros((len(given), 3))
    begin = 0
    while begin < len(given):
        sums = np.cumsum(counts[begin:])
        end = begin + max(1, int(np.searchsorted(sums, PAIRS_AT_ONCE)))
        which = np.repeat(np.arange(begin, end), counts[begin:end])
        of_pair = np.concatenate(
            [np.asarray(found, dtype=np.int64) for found in candidates[begin:end]]
        )
        pair_weights = _weights_of_closest(corners[of_pair], given[which])
        position = np.einsum("nk,nkc->nc", pair_weights, corners[of_pair])
        squared = ((position - given[which]) ** 2).sum(axis=1)
        # The first of the sorted pairs of each point is its nearest one; of equally near triangles
        # that of the lowest number is taken.
        order = np.lexsort((of_pair, squared, which))
        _, first = np.unique(which[order], return_index=True)
        triangle[begin:end] = of_pair[order[first]]
        weights[begin:end] = pair_weights[order[first]]
        begin = end
    position = np.einsum("nk,nkc->nc", weights, corners[triangle])
    return ClosestPoints(
        triangle=triangle,
        weights=weights,
        points=position,
        distance=np.linalg.norm(position - given, axis=1),
    )


def _weights_of_closest(corners: Array, given: Array) -> Array:
    """Barycentric coordinates (n, 3) of the point of each triangle (n, 3, 3) [m] that is closest to
    a point (n, 3) [m]."""
    inside = barycentric(corners, given)
    best = inside.copy()
    # Outside of the triangle the closest point is on one of its sides.
    outside = (inside < 0).any(axis=1)
    least: Array = np.full(len(given), np.inf)
    least[~outside] = -1.0
    for first, second in ((0, 1), (1, 2), (2, 0)):
        start = corners[:, first]
        side = corners[:, second] - start
        along = np.einsum("nc,nc->n", given - start, side) / np.einsum("nc,nc->n", side, side)
        along = np.clip(along, 0.0, 1.0)
        distance = np.linalg.norm(start + along[:, None] * side - given, axis=1)
        is_nearer = distance < least
        weights = np.zeros((len(given), 3))
        weights[:, first] = 1 - along
        weights[:, second] = along
        best[is_nearer] = weights[is_nearer]
        least = np.where(is_nearer, distance, least)
    return best


def barycentric(corners: Array, given: Array) -> Array:
    """Barycentric coordinates (n, 3) of the projections of points (n, 3) [m] on the planes of
    triangles (n, 3, 3) [m]."""
    first = corners[:, 1] - corners[:, 0]
    second = corners[:, 2] - corners[:, 0]
    normal = np.cross(first, second)
    square = np.einsum("nc,nc->n", normal, normal)
    offset = given - corners[:, 0]
    at_first = np.einsum("nc,nc->n", np.cross(offset, second), normal) / square
    at_second = np.einsum("nc,nc->n", np.cross(first, offset), normal) / square
    return np.stack([1 - at_first - at_second, at_first, at_second], axis=1)
