"""The contact potential: energy, forces and tangents of pairs, conserving in every step.

Problem.  A time step of this package conserves energy and momenta exactly if energies are functions
of measures that are quadratic in the coordinates (`terms.discrete_gradient`).  The distance of two
primitives, e.g. of a point and a triangle, is not such a measure: it depends on where the closest
points are, and they move.

Idea.  A pair is three vectors, linear in its four points: r between the two sides, a and b along
them. Points of the two sides are r + u a + v b apart.  The squared distance of the sides

    s(e) = min over (u, v) of φ(u, v)·e,    e = (r·r, r·a, r·b, a·a, a·b, b·b),
                                            φ = (1, 2u, 2v, u², 2uv, v²)                        (0)

is a minimum of functions that are linear in the six quadratic measures e.  A minimum of linear
functions is concave.  An energy k b(x), x = (s - offset)/width, of a falling convex b is therefore
convex in e, and can be treated as any stored energy.

    law       b(x), zero for x ≥ 1
    BARRIER   (1 - x)³/(4x)     nothing gets through, whatever the stiffness
    PENALTY   (1 - √x)²/2       its force is linear in the distance; of boundaries and cones
                                (1 - x)²/2, whose stencils say `is_linear`

Algorithm, for a step from e0 = e(q0) to e1 = e(q1) with the change Δe = e1 - e0:

    1. The stress of the step is S = k (b(x1) - b(x0))/(s1 - s0) φ_mean.                        (1)
    2. φ_mean = ∫₀¹ φ dτ along e0 + τ Δe, by two Gauss points; of edges by two in each quarter.  (2)
    3. Gauss points leave an error in (2).  A multiple of W Δe is added to φ_mean such that
       φ_mean·Δe = s1 - s0.  W is diagonal: 1 over the squared size of each measure, with the
       activation distance for r and the mean lengths in the step for a and b.                  (3)
    4. The force on the points is De(q_mid)ᵀ S.  Since De(q_mid)(q1 - q0) = Δe, its work is
       k (b(x1) - b(x0)); it has no resultant and no moment, as e does not change in rigid motions.

Parallel edges.  Their closest points are anywhere along them and jump when they turn.  Adding
ε ((u - ½)² + (v - ½)²), ε = ROUNDING width, to the form rounds s and leaves it concave.  Where
edges cross, s may then be ε/2; the offset of barriers is larger by this much, so that they are
infinite there.  Where closest points run along such edges in a step, (2) has a large error. Without
W its correction would go along Δ(a·a), by far the largest number in Δe: as a force along the edges,
three times the one across them where edges hardly stretch, and of the other sign where they do so
the other way.  Newton's iteration then alternates: 5 of 7 rejected steps of a packed sail.

Iterates of Newton's method may pass through something.  Such pairs are pushed back by a parabola of
the signed distance (`kernels/pass_through.h`).  For edges with a barrier, x must not fall below a
fiftieth of its value at the start of the step.  Below it b is continued as a parabola of x, so that
the iteration has a finite force; a step that ends there is refused.

Cost: three searches for closest points for each pair and evaluation, nine for edges, at e1 and at
the Gauss points; those of e0 are known from the start of the step.  All is in C, and pairs out of
range are left out.

Limits: the tangent of a step is not symmetric, since (3) treats both ends differently from the
middle. The measures at the Gauss points are those of no configuration, so that their closest points
follow from the measures alone.

References: the discrete energy rule, Simo & Tarnow, Z. angew. Math. Phys. 43 (1992) 757,
doi:10.1007/BF00913408; barriers of distances, Li et al., "Incremental potential contact", ACM
Trans. Graph. 39 (2020) 49, doi:10.1145/3386569.3392425.
"""

from __future__ import annotations

from dataclasses import replace
from enum import IntEnum
from typing import Any

import numpy as np

from gossamer_fx.core.forms.c_source import CStruct
from gossamer_fx.mechanics.contact.contract import Array, ByteArray, Int32Array
from gossamer_fx.mechanics.contact.kernels.library import library
from gossamer_fx.mechanics.contact.pairs import (
    ROUNDING,
    ActivePairs,
    CandidatePairs,
    closest_points,
    is_boundary,
    pair_list_fields,
    stencils_of,
)
from gossamer_fx.mechanics.terms.discrete_gradient import acts_at_end

# Stiffness by which pairs that passed through are pushed back, over their own: more than the
# parabola of the pair, so that the next iterate comes back to the right side.
PUSH_BACK = 4.0


class ContactLaw(IntEnum):
    """How the energy grows with falling distance; the numbers are those of `kernels/contact.h`."""

    BARRIER = 0
    PENALTY = 1


class PairState(IntEnum):
    """What a pair does in a step; the numbers are those of `kernels/contact.h`."""

    NO_CONTACT = 0
    TOUCHES = 1
    PASSED = 2


def activate(
    candidates: CandidatePairs, activation_distance: Array, law: ContactLaw
) -> ActivePairs:
    """Return n candidates as active pairs, with the width and offset that let their energy reach up
    to the activation distance (n,) [m].  Their stiffness is zero and `start` is None."""
    count = len(candidates)
    width = np.empty(count)
    offset = np.empty(count)
    is_barrier = law == ContactLaw.BARRIER
    for stencil, rows in stencils_of(candidates.kind):
        width[rows], offset[rows] = stencil.energy_range(
            activation_distance[rows], candidates.radius[rows], candidates.shapes[rows], is_barrier
        )
    return ActivePairs(
        kind=candidates.kind,
        points=candidates.points,
        shape=candidates.shape,
        identifier=candidates.identifier,
        stiffness=np.zeros(count),
        width=width,
        offset=offset,
    )


def pair_starts(pairs: ActivePairs, x: Array, squared_distance: Array, parameters: Array) -> Array:
    """Return the column `start` (n, 4) of contact pairs, which the energy rule needs from the start
    of a step: u, v [-], distance [m], squared distance with rounded edges [m²].  The distance of
    boundaries is not used.  `squared_distance` and `parameters`: of `closest_points` at x."""
    # The compiled C library of contact, which checks the arrays that it gets
    c = library()
    count = len(pairs)
    start = np.empty((count, 4))
    c.lib.pair_starts(
        _active_pairs(pairs, None, ContactLaw.BARRIER).pointer,
        c.array("x", x, "float64", (len(x), 3)),
        c.array("s", np.ascontiguousarray(squared_distance), "float64", (count,)),
        c.array("parameters", np.ascontiguousarray(parameters), "float64", (count, 2)),
        c.array("start", start, "float64", (count, 4), writable=True),
    )
    return start


def reversed_pairs(pairs: ActivePairs, x: Array) -> ActivePairs:
    """Return pairs of the reversed step, which starts at the points x (m, 3) [m].

    The closest points of the original start stay the origin of their vectors: the force depends on
    that origin, by the correction (3) along the change of the measures.
    """
    start = pair_starts(pairs, x, *closest_points(pairs, x))
    if pairs.start is not None:
        start[:, :2] = pairs.start[:, :2]
    return replace(pairs, start=start)


def energy_of_pairs(
    pairs: ActivePairs, x: Array, law: ContactLaw, parameters: Array | None = None
) -> tuple[float, Array]:
    """Return the energy [J] of all contact pairs in one configuration, and the scaled distance of
    each (n,) [-], which is below one where a pair has energy.  `parameters`: (u, v) (n, 2) of the
    closest points at x; None: they are computed."""
    # The compiled C library of contact, which checks the arrays that it gets
    c = library()
    count = len(pairs)
    if parameters is None:
        _, parameters = closest_points(pairs, x)
    scaled_distance = np.empty(count)
    energy = c.lib.stored_energy(
        _active_pairs(pairs, None, law).pointer,
        c.array("x", x, "float64", (len(x), 3)),
        c.array("parameters", parameters, "float64", (count, 2)),
        c.array("scaled_distance", scaled_distance, "float64", (count,), writable=True),
    )
    return float(energy), scaled_distance


def unit_energies(pairs: ActivePairs, scaled_distance: Array, law: ContactLaw) -> Array:
    """Return b(x) (n,) of contact pairs [-]: their energy over their stiffness."""
    c = library()
    count = len(pairs)
    energy = np.empty(count)
    c.lib.unit_energies(
        _active_pairs(pairs, None, law).pointer,
        c.array("scaled_distance", scaled_distance, "float64", (count,)),
        c.array("energy", energy, "float64", (count,), writable=True),
    )
    return energy


class PairEvaluation:
    """Forces and tangents of n contact pairs in a step, for one iterate after the other: what C
    reads and writes is prepared once.

    Args:
        point_count: m, the number of points.
        alpha: weight of the end in the configuration where forces act; where the rule of the step
            takes forces at its end alone, its start is not used.
        state: array (n,) for what each pair does; None: a new one.
        point_forces: array (m, 3) [N] to which the forces are added.
        block_index, blocks: rows (n, 16) of `blocks` for each two points of a pair, and the array
            (b, 9) [N/m] to which the tangents are added.
        by_pair, tangents_by_pair: whether forces and tangents of each pair are wanted.

    Attributes:
        pairs: that are evaluated.
        state: of each pair (n,), a `PairState`; each call overwrites this array and the next ones.
        forces: on the four points of each pair (n, 12) [N], or None.
        tangents: their derivatives (n, 144) [N/m] by the end of the step, or None.
    """

    def __init__(
        self,
        pairs: ActivePairs,
        point_count: int,
        law: ContactLaw,
        alpha: float,
        *,
        state: ByteArray | None = None,
        point_forces: Array | None = None,
        block_index: Int32Array | None = None,
        blocks: Array | None = None,
        by_pair: bool = False,
        tangents_by_pair: bool = False,
    ) -> None:
        # The compiled C library of contact, which checks the arrays that it gets
        c = library()
        count = len(pairs)
        shape = (point_count, 3)
        self.state = np.empty(count, dtype=np.uint8) if state is None else state
        # What is None is not computed: C gets a null pointer for it.
        self.forces = np.empty((count, 12)) if by_pair else None
        self.tangents = np.empty((count, 144)) if tangents_by_pair else None
        self.pairs = pairs
        self._is_state = acts_at_end(alpha)
        # In statics the force is the gradient at the end, whose closest points it needs.
        self._needs_start = pairs.start is None or self._is_state
        self._start = np.empty((count, 4)) if self._needs_start else np.asarray(pairs.start)
        self._x0 = np.empty(shape)
        self._x1 = np.empty(shape)
        step = {
            "x0": c.array("x0", self._x0, "float64", shape),
            "x1": c.array("x1", self._x1, "float64", shape),
            "alpha": alpha,
            "is_state": self._is_state,
            "geometric_share": 1.0,
            "push_back": PUSH_BACK,
        }

        def written(name: str, values: Array | None, shape: tuple[int, ...]) -> Any:
            return c.array(name, values, "float64", shape, writable=True)

        block_count = 0 if blocks is None else len(blocks)
        response = {
            "state": c.array("state", self.state, "uint8", (count,), writable=True),
            "state_is_known": False,
            "point_forces": written("point_forces", point_forces, shape),
            "block_index": c.array("block_index", block_index, "int32", (count, 16)),
            "blocks": written("blocks", blocks, (block_count, 9)),
            "pair_forces": written("forces", self.forces, (count, 12)),
            "pair_tangents": written("tangents", self.tangents, (count, 144)),
        }
        self._table = _active_pairs(pairs, self._start, law)
        self._step = c.struct("contact_step", step)
        self._response = c.struct("contact_response", response)
        self._evaluate = c.lib.evaluate_pairs

    def __call__(
        self,
        x0: Array,
        x1: Array,
        *,
        push_back: float = PUSH_BACK,
        geometric_share: float = 1.0,
        is_known: bool = False,
    ) -> None:
        """Compute what is wanted in a step from points x0 to x1 (m, 3) [m].

        `push_back`: stiffness of pairs that passed through, over their own [-]; zero for a step
        that was accepted, whose pairs are then treated alike in both directions of time.
        `geometric_share`: of the geometric stiffness in tangents [-], which may make them
        indefinite.  `is_known`: whether states are those of an earlier call for this step.
        """
        if not self.state.size:
            return
        self._x0[:] = x0
        self._x1[:] = x1
        if self._needs_start:
            base = self._x1 if self._is_state else self._x0
            self._start[:] = pair_starts(self.pairs, base, *closest_points(self.pairs, base))
        step = self._step.pointer
        step.geometric_share = geometric_share
        step.push_back = push_back
        self._response.pointer.state_is_known = is_known
        self._evaluate(self._table.pointer, step, self._response.pointer)


def evaluate(
    pairs: ActivePairs,
    x0: Array,
    x1: Array,
    law: ContactLaw,
    alpha: float,
    *,
    push_back: float = PUSH_BACK,
    **wanted: Any,
) -> PairEvaluation:
    """Compute forces and tangents of contact pairs once, see `PairEvaluation`."""
    evaluation = PairEvaluation(pairs, len(x0), law, alpha, **wanted)
    evaluation(x0, x1, push_back=push_back)
    return evaluation


def _active_pairs(pairs: ActivePairs, start: Array | None, law: ContactLaw) -> CStruct:
    """Return the C structure of n active pairs with the numbers of the energy law."""
    c = library()
    count = len(pairs)
    return c.struct(
        "active_pairs",
        {
            "list": pair_list_fields(pairs),
            "stiffness": c.array("stiffness", pairs.stiffness, "float64", (count,)),
            "width": c.array("width", pairs.width, "float64", (count,)),
            "offset": c.array("offset", pairs.offset, "float64", (count,)),
            "start": c.array("start", start, "float64", (count, 4)),
            "rounding": ROUNDING,
            "law": int(law),
        },
    )


# Change of the origin, as a part of the sides, in the central difference for ∂F/∂(u0, v0).  Its
# errors, of 1e-8 and less, are those of a small part of the force.
ORIGIN_DIFFERENCE = 1e-4


def forces_by_origin(
    pairs: ActivePairs, x0: Array, x1: Array, law: ContactLaw, alpha: float
) -> Array:
    """Return ∂F/∂(u0, v0) (n, 2, 4, 3) [N] of the forces on the points of n pairs in a step, by a
    central difference; u0, v0 are the closest points of the start, between which r leads."""
    assert pairs.start is not None, "a step has the starts of its pairs"
    found = np.zeros((len(pairs), 2, 4, 3))
    for parameter in range(2):
        for sign in (1.0, -1.0):
            start = pairs.start.copy()
            start[:, parameter] += sign * ORIGIN_DIFFERENCE
            moved = replace(pairs, start=start)
            response = evaluate(moved, x0, x1, law, alpha, by_pair=True, push_back=0.0)
            forces = np.asarray(response.forces).reshape(-1, 4, 3)
            found[:, parameter] += sign * forces / (2 * ORIGIN_DIFFERENCE)
    found[is_boundary(pairs.kind)] = 0.0
    return found
