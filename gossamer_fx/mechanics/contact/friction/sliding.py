"""Where pairs slide: the vectors r and t of `friction_pairs` as combinations of points.

The weights follow from the points at the start of a step.  The functions accept complex points, so
that a complex step differentiates them: lengths are square roots of sums of squares, and nothing
takes an absolute value.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gossamer_fx.mechanics.contact.contract import (
    Array,
    ByteArray,
    MaskArray,
    Sides,
)
from gossamer_fx.mechanics.contact.geometry.collision_mesh import FRAME_SIZE
from gossamer_fx.mechanics.contact.pairs import (
    SIDES,
    TINY,
    PairRows,
    PairTable,
    gap_weights_of,
    lengths_of,
    stencils_of,
)

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
    return vectors / np.maximum(lengths_of(vectors), TINY)[:, None]


def orthonormal_combinations(vectors: Array, lengths: Array) -> Array:
    """Return combinations of two vectors (n, 2, 3) [m], parts of edges, that are orthonormal.

    The vector that is more of its edge comes first; of the other one its part along the first is
    taken away.  `lengths`: of the edges (n, 2) [m].  A vector that is shorter than a thousandth of
    its edge (`SMALLEST_SINE`) gives no direction, and its combination is zero.  Returns
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


@dataclass(frozen=True)
class SlidingGeometry(PairRows):
    """Where n pairs slide, between k points each.

    Attributes:
        normal: unit normal at the start (n, 3).
        gap_weights: weights (n, k) of the points in the vector r across the gap.
        direction_weights: weights (n, 2, k) of the points in the two directions t [1/m], so that t
            are unit vectors at the start.
    """

    normal: Array
    gap_weights: Array
    direction_weights: Array


@dataclass(frozen=True)
class BetweenBodies(PairRows):
    """Geometry of n pairs between bodies, which slide along two edges of the pair.

    Attributes:
        kind: of each pair (n,), the number of its stencil.
    """

    kind: ByteArray

    def repeated(self, times: int) -> BetweenBodies:
        """The same pairs, each `times` times in a row."""
        return BetweenBodies(np.repeat(self.kind, times))

    def at(self, x: Array, parameters: Array) -> SlidingGeometry:
        """Return normals and weights for the points x (n, 4, 3) [m] at the start of a step, with
        the parameters (u, v) (n, 2) of their closest points; both may be complex."""
        gap_weights = gap_weights_of(self.kind, parameters)
        edge_weights = EDGE_WEIGHTS[SIDES[self.kind]]
        gap = np.einsum("nk,nkc->nc", gap_weights, x)
        edges = np.einsum("nik,nkc->nic", edge_weights, x)
        normal = unit_vectors(gap)
        along_normal = np.einsum("nic,nc->ni", edges, normal)
        across = edges - along_normal[:, :, None] * normal[:, None]
        # With half of its part along the gap taken off an edge, the gradient of r·t by r, which is
        # t plus what t changes by r, is across the normal.
        gap_length = np.maximum(lengths_of(gap), TINY)
        half = along_normal / (2 * gap_length[:, None])
        corrected = edge_weights - half[:, :, None] * gap_weights[:, None]
        # Edges are neither unit vectors nor perpendicular to each other.
        combinations = orthonormal_combinations(across, lengths_of(edges))
        directions = np.einsum("nij,njk->nik", combinations, corrected)
        return SlidingGeometry(normal, gap_weights, directions)


@dataclass(frozen=True)
class WithObstacles:
    """Geometry of n pairs with an obstacle, which slide along two of its axes.

    r leads from the point of the obstacle that lies where the body's point is, fixed in the
    obstacle's frame: so a ball on a rigid body rolls.

    Attributes:
        pairs: the pairs.
        is_of_body: which of the four points of each pair are of its body (n, 4).
    """

    pairs: PairTable
    is_of_body: MaskArray

    def rows(self, which: Any) -> WithObstacles:
        """Some of the pairs, given by indices or by a mask (n,)."""
        return WithObstacles(self.pairs.geometry(which), self.is_of_body[which])

    def repeated(self, times: int) -> WithObstacles:
        """The same pairs, each `times` times in a row."""
        return self.rows(np.repeat(np.arange(len(self.pairs)), times))

    def at(self, x: Array, parameters: Array) -> SlidingGeometry:
        """Return normals and weights for the points x (n, 8, 3) at the start of a step, with the
        parameters (u, v) (n, 2) of their closest points; both may be complex.  The points are the
        four of each pair [m], and origin [m] and three axes [-] of the obstacle."""
        pair_points = x[:, :4]
        origin = x[:, 4]
        axes = x[:, 5:]
        weights = gap_weights_of(self.pairs.kind, parameters)
        # All weights of the body have one sign, which makes them a mean of its points.
        sign = np.where((weights.real * self.is_of_body).sum(axis=1) < 0, -1, 1)
        towards = weights * sign[:, None]
        of_body = towards * self.is_of_body
        touched = np.einsum("nk,nkc->nc", of_body, pair_points)
        normal = unit_vectors(self._towards_body(towards, pair_points, parameters))

        # Two directions across the normal, in the axes of the obstacle: the first is also across
        # the axis that is farthest from the normal.
        in_axes = np.einsum("nic,nc->ni", axes, normal)
        # Of axes that are equally far it is the first one, also in a complex step.
        nearness = np.abs(in_axes.real) + TIE * np.arange(3)
        farthest_axis = np.eye(3)[nearness.argmin(axis=1)]
        first = unit_vectors(np.cross(in_axes, farthest_axis))
        directions = np.zeros((len(x), 2, 4 + FRAME_SIZE), dtype=x.dtype)
        directions[:, 0, 5:] = first
        directions[:, 1, 5:] = np.cross(in_axes, first)
        position = np.einsum("nic,nc->ni", axes, touched - origin)
        from_frame = np.hstack([-np.ones((len(x), 1)), -position])
        return SlidingGeometry(normal, np.hstack([of_body, from_frame]), directions)

    def _towards_body(self, weights: Array, x: Array, parameters: Array) -> Array:
        """Return a vector (n, 3) from each pair's obstacle towards its body. The weights (n, 4) are
        those of the vector between closest points x (n, 4, 3) [m], for pairs that are not of
        boundaries."""
        found: Array = np.einsum("nk,nkc->nc", weights, x)
        shapes = self.pairs.shapes
        for stencil, rows in stencils_of(self.pairs.kind):
            if stencil.sides == Sides.POINT_BOUNDARY:
                _, gradient = stencil.derivatives(x[rows], parameters[rows], shapes[rows])
                found[rows] = gradient[:, 0]
        return found
