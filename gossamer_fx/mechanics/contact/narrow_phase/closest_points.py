"""Closest points and distances of pairs, computed once for each set of points.

The squared distance s of a triangle pair or an edge pair is that of its closest points, which have
the parameters (u, v) on the two sides.  Of boundaries s is something else, which is linear in the
distance or bounded: of planes the signed distance itself [m]; inside spheres and cylinders minus
the squared distance from the middle.  The `gap` of a pair is its distance [m] less the radii of
both sides.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gossamer_fx.mechanics.contact.contract import Array, Int64Array, MaskArray
from gossamer_fx.mechanics.contact.kernels.library import library
from gossamer_fx.mechanics.contact.pair_table import CandidatePairs, PairTable, pair_list
from gossamer_fx.mechanics.contact.stencils import gaps_of

# Pairs whose gaps are computed at once: of all pairs at once the temporary arrays take more memory
# than what is kept.
PAIRS_AT_ONCE = 2**16


def closest_points(pairs: PairTable, x: Array) -> tuple[Array, Array]:
    """Return the squared distances s (n,) [m²] of contact pairs at points x (m, 3) [m], and the
    parameters (u, v) (n, 2) [-] of their closest points.

    Of boundaries s is what the module says.  The closest points of two edges are at u and v of
    their lengths; the one on a triangle is corner 0 + u (corner 1 - corner 0) + v (corner 2 -
    corner 0).  Boundaries have no parameters: zeros.
    """
    c = library()
    count = len(pairs)
    squared_distance = np.empty(count)
    parameters = np.empty((count, 2))
    c.lib.closest_points(
        pair_list(pairs).pointer,
        c.array("x", x, "float64", (len(x), 3)),
        c.array("squared_distance", squared_distance, "float64", (count,), writable=True),
        c.array("parameters", parameters, "float64", (count, 2), writable=True),
    )
    return squared_distance, parameters


def approach_bounds(pairs: PairTable, x0: Array, x1: Array) -> Array:
    """Return by how much (n,) [m] contact pairs can come closer at most while their points move
    straight from x0 to x1 (m, 3) [m]; infinite for boundaries."""
    # The compiled C library of contact, which checks the arrays that it gets
    c = library()
    points = len(x0)
    bound = np.empty(len(pairs))
    c.lib.approach_bounds(
        pair_list(pairs).pointer,
        c.array("x0", x0, "float64", (points, 3)),
        c.array("x1", x1, "float64", (points, 3)),
        c.array("bound", bound, "float64", (len(pairs),), writable=True),
    )
    return bound


class PairDistances:
    """Gaps of all candidates at one set of points x (m, 3).

    Far pairs need no closest points: their gap may be a lower bound that follows from an earlier
    state.  Closest points are computed for those that ask for them, and not kept: in packed layers
    less than one candidate in forty takes part in a step.

    Attributes:
        candidates: the n pairs.
        x: the points (m, 3) [m].
        gap: gaps (n,) [m], exact for those that were computed at first, else lower bounds.
    """

    def __init__(self, candidates: CandidatePairs, x: Array, lower_bound: Array) -> None:
        """Start with lower bounds of the gaps; `make_exact` replaces some of them. `lower_bound`:
        of each gap (n,) [m]; the array becomes `gap` and is changed in place."""
        self.candidates = candidates
        self.x = x
        self.gap = lower_bound

    @classmethod
    def of(cls, candidates: CandidatePairs, x: Array) -> PairDistances:
        """Compute all gaps at points x."""
        found = cls(candidates, x, np.empty(len(candidates)))
        found.make_exact()
        return found

    def make_exact(self, rows: Int64Array | None = None) -> None:
        """Replace the lower bounds of the gaps [m] of some pairs, by default of all, by the gaps;
        `rows`: indices (k,)."""
        count = len(self.candidates) if rows is None else len(rows)
        for first in range(0, count, PAIRS_AT_ONCE):
            some: Any = slice(first, first + PAIRS_AT_ONCE)
            if rows is not None:
                some = rows[some]
            geometry = self.candidates.geometry(some)
            squared_distance, _ = closest_points(geometry, self.x)
            self.gap[some] = gaps_of(geometry, squared_distance, self.candidates.radius[some])

    def closest_points(self, rows: MaskArray) -> tuple[Array, Array]:
        """Return squared distances s (k,) and parameters (k, 2) of the closest points of some pairs
        (mask (n,)), as the function of this name."""
        return closest_points(self.candidates.geometry(rows), self.x)
