"""One step of a contact: an immutable object with its pairs, which gives forces and tangents.

`ContactStep` has the active pairs at the start of a step.  `ContactStep.forces` takes the points at
its end, `ContactStep.tangent` the forces at the same end, and `ContactStep.reversed` gives the step
back.  Each returns a new object; nothing is changed.  The pairs are divided into groups, since
their tangents are assembled in different ways:

    BodyPairs        their four points are block rows of the system, so that the C kernel adds 3 x 3
                     blocks between them where they belong
    ObstaclePairs    points of obstacles are combinations of block rows; tangents are computed pair
                     by pair, and multiplied by the weights of these rows
    FrictionPairs    of `friction`: pairs that may rub

The contact potential: energy, forces and tangents of pairs, conserving in every step.

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

Origins.  The vector r of a pair leads between the closest points (u0, v0) of the start of the step.
The energy of the pair does not depend on this origin.  The force F of a step does, slightly: the
correction (3) is another one for another r.  The reversed step of a gradient keeps the origin, so
that this derivative is added to what the reversed step gives, with adjoint displacements μ:

    (∂F/∂(u0, v0) ∂(u0, v0)/∂x0)ᵀ μ                                                              (4)

It is a part of 1e-9 of a gradient where films touch slowly, and of up to 1e-2 of the derivative of
a single pair that crosses much of its activation distance in a step.

Limits: the tangent of a step is not symmetric, since (3) treats both ends differently from the
middle. The measures at the Gauss points are those of no configuration, so that their closest points
follow from the measures alone.

References: the discrete energy rule, Simo & Tarnow, Z. angew. Math. Phys. 43 (1992) 757,
doi:10.1007/BF00913408; barriers of distances, Li et al., "Incremental potential contact", ACM
Trans. Graph. 39 (2020) 49, doi:10.1145/3386569.3392425.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np

from gossamer_fx.core.forms.c_source import CStruct
from gossamer_fx.mechanics.contact.assembly import CouplingEntries, PairBlocks, TangentPattern
from gossamer_fx.mechanics.contact.contract import Array, ByteArray, Int32Array, Int64Array
from gossamer_fx.mechanics.contact.geometry.contact_points import ContactPoints
from gossamer_fx.mechanics.contact.kernels.library import library
from gossamer_fx.mechanics.contact.pairs import (
    ROUNDING,
    ActivePairs,
    StepPairs,
    closest_points,
    is_boundary,
    pair_list_fields,
    parameter_derivatives_of,
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


# ---- pairs in one state ----


def begin_at(pairs: ActivePairs, x: Array, squared_distance: Array, parameters: Array) -> StepPairs:
    """Return contact pairs of a step that starts at the points x (m, 3) [m].  `squared_distance`
    and `parameters`: of `closest_points` at x."""
    # The compiled C library of contact, which checks the arrays that it gets
    c = library()
    count = len(pairs)
    start = np.empty((count, 4))
    # The law has no part in this.
    c.lib.pair_starts(
        _active_pairs(pairs, None, ContactLaw.BARRIER).pointer,
        c.array("x", x, "float64", (len(x), 3)),
        c.array("s", np.ascontiguousarray(squared_distance), "float64", (count,)),
        c.array("parameters", np.ascontiguousarray(parameters), "float64", (count, 2)),
        c.array("start", start, "float64", (count, 4), writable=True),
    )
    return StepPairs(
        kind=pairs.kind,
        points=pairs.points,
        shape=pairs.shape,
        identifier=pairs.identifier,
        stiffness=pairs.stiffness,
        width=pairs.width,
        offset=pairs.offset,
        start=start,
    )


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


# ---- pairs in a step ----

# Change of the origin, as a part of the sides, in the central difference for ∂F/∂(u0, v0).  Its
# errors, of 1e-8 and less, are those of a small part of the force.
ORIGIN_DIFFERENCE = 1e-4

# Fields of `contact_response` that C computes if there is an array for them.
RESULTS = ("point_forces", "blocks", "pair_forces", "pair_tangents")


@dataclass(frozen=True, eq=False)
class PairStep:
    """n contact pairs in a step that starts at x0.  The methods take the points x1 (m, 3) [m] at
    its end.

    Attributes:
        pairs: that are evaluated.
        x0: points (m, 3) [m] at the start.
        alpha: weight of the end in the configuration where forces act; where the rule of the step
            takes forces at its end alone, its start is not used.
        push_back: stiffness of pairs that passed through, over their own [-]; zero for a step that
            was accepted, whose pairs are then treated alike in both directions of time.
    """

    pairs: StepPairs
    x0: Array
    law: ContactLaw
    alpha: float
    push_back: float = PUSH_BACK

    @classmethod
    def of_state(cls, pairs: ActivePairs, x: Array, law: ContactLaw) -> PairStep:
        """Return the step without length in the state x (m, 3) [m]: its forces are those of x."""
        return cls(begin_at(pairs, x, *closest_points(pairs, x)), x, law, alpha=1.0)

    def rows(self, which: Any) -> PairStep:
        """Return some of the pairs, given by indices or by a mask (n,)."""
        return replace(self, pairs=self.pairs.rows(which))

    def reversed(self, x1: Array) -> PairStep:
        """Return the reversed step, which starts at x1.

        The closest points of the original start stay the origin of the vectors: the force depends
        on that origin, by the correction (3) along the change of the measures.  Pairs that separate
        fast would count as passed when they approach as fast: none is pushed back.
        """
        pairs = begin_at(self.pairs, x1, *closest_points(self.pairs, x1))
        pairs.start[:, :2] = self.pairs.parameters
        return replace(self, pairs=pairs, x0=x1, push_back=0.0)

    def states(self, x1: Array) -> ByteArray:
        """Return what each pair does in the step (n,), a `PairState`."""
        return self._evaluate(x1, {})

    def add_forces(self, x1: Array, point_forces: Array) -> ByteArray:
        """Add the forces [N] to those on points (m, 3); return what each pair does, `states`."""
        return self._evaluate(x1, {"point_forces": point_forces})

    def forces(self, x1: Array) -> tuple[ByteArray, Array]:
        """Return what each pair does (n,), and the forces on its four points (n, 4, 3) [N]."""
        forces = np.empty((len(self.pairs), 12))
        state = self._evaluate(x1, {"pair_forces": forces})
        return state, forces.reshape(-1, 4, 3)

    def forces_and_tangents(self, x1: Array) -> tuple[ByteArray, Array, Array]:
        """Return what `forces` returns, and the derivatives of the forces by the points at the end
        (n, 4, 3, 4, 3) [N/m]."""
        forces = np.empty((len(self.pairs), 12))
        tangents = np.empty((len(self.pairs), 144))
        state = self._evaluate(x1, {"pair_forces": forces, "pair_tangents": tangents})
        return state, forces.reshape(-1, 4, 3), tangents.reshape(-1, 4, 3, 4, 3)

    def tangents(self, x1: Array, state: ByteArray, geometric_share: float) -> Array:
        """Return the derivatives of the forces by the points at the end (n, 4, 3, 4, 3) [N/m].
        `state`: what each pair does in the step to x1 (n,); `geometric_share`: of the geometric
        stiffness [-], which may make tangents indefinite."""
        tangents = np.empty((len(state), 144))
        results = {"pair_tangents": tangents}
        self._evaluate(x1, results, state=state, geometric_share=geometric_share)
        return tangents.reshape(-1, 4, 3, 4, 3)

    def add_tangents(
        self, x1: Array, state: ByteArray, geometric_share: float, blocks: PairBlocks
    ) -> None:
        """Add what `tangents` returns to blocks (b, 9) [N/m], sixteen of each pair."""
        results = {"blocks": blocks.values}
        self._evaluate(
            x1,
            results,
            block_index=blocks.index,
            state=state,
            geometric_share=geometric_share,
        )

    def forces_by_origin(self, x1: Array) -> Array:
        """Return ∂F/∂(u0, v0) (n, 2, 4, 3) [N] of the forces on the points of the pairs, by a
        central difference; u0, v0 are the closest points of the start, between which r leads."""
        found = np.zeros((len(self.pairs), 2, 4, 3))
        for parameter in range(2):
            for sign in (1.0, -1.0):
                start = self.pairs.start.copy()
                start[:, parameter] += sign * ORIGIN_DIFFERENCE
                moved = replace(self, pairs=replace(self.pairs, start=start), push_back=0.0)
                _, forces = moved.forces(x1)
                found[:, parameter] += sign * forces / (2 * ORIGIN_DIFFERENCE)
        found[is_boundary(self.pairs.kind)] = 0.0
        return found

    @cached_property
    def _table(self) -> CStruct:
        """The pairs as C takes them."""
        return _active_pairs(self.pairs, self.pairs.start, self.law)

    @cached_property
    def _call(self) -> _Call:
        """What a call of C takes."""
        c = library()
        nothing = c.ffi.NULL
        x1 = np.empty(self.x0.shape)
        state: ByteArray = np.empty(len(self.pairs), dtype=np.uint8)
        step = {
            "x0": c.array("x0", self.x0, "float64", (len(self.x0), 3)),
            "x1": c.array("x1", x1, "float64", x1.shape),
            "alpha": self.alpha,
            "is_state": acts_at_end(self.alpha),
            "geometric_share": 1.0,
            "push_back": self.push_back,
        }
        response = {
            "state": c.array("state", state, "uint8", state.shape, writable=True),
            "state_is_known": False,
            "block_index": nothing,
            **dict.fromkeys(RESULTS, nothing),
        }
        return _Call(
            x1, state, c.struct("contact_step", step), c.struct("contact_response", response)
        )

    def _evaluate(
        self,
        x1: Array,
        results: Mapping[str, Array],
        *,
        block_index: Int32Array | None = None,
        state: ByteArray | None = None,
        geometric_share: float = 1.0,
    ) -> ByteArray:
        """Let C compute the step to x1; return what each pair does.  `results`: arrays that it
        writes or adds to, by the fields of `contact_response`; fields without an array are not
        computed.  `state`: what each pair does, if that is known."""
        c = library()
        call = self._call
        if not len(call.state):
            return call.state
        call.x1[:] = x1
        if state is not None:
            call.state[:] = state
        call.step.pointer.geometric_share = geometric_share
        response = call.response.pointer
        response.state_is_known = state is not None
        if block_index is not None:
            response.block_index = c.array(
                "block_index", block_index, "int32", (len(call.state), 16)
            )
        for name, values in results.items():
            setattr(response, name, c.array(name, values, "float64", values.shape, writable=True))
        table = self._table
        if acts_at_end(self.alpha):
            # In statics the force is the gradient at the end, whose closest points it needs.
            table = PairStep.of_state(self.pairs, x1, self.law)._table
        c.lib.evaluate_pairs(table.pointer, call.step.pointer, response)
        for name in results:
            setattr(response, name, c.ffi.NULL)
        return call.state.copy()


@dataclass(frozen=True, eq=False)
class _Call:
    """Arguments of a call of C, with buffers for the end of the step and the states: they are made
    once, which takes longer than the evaluation of few pairs."""

    x1: Array
    state: ByteArray
    step: CStruct
    response: CStruct


# ---- groups of pairs ----


@dataclass(frozen=True, eq=False)
class PairGroup(ABC):
    """Pairs of a step whose forces and tangents are computed in one way.

    Attributes:
        step: the n pairs in the step, under the contact potential.
        block_rows: that each pair couples (n, w), vectors of three unknowns.
    """

    step: PairStep
    block_rows: np.ndarray

    @abstractmethod
    def add_forces(self, x1: Array, point_forces: Array) -> ByteArray:
        """Add the forces [N] of the step to x1 (m, 3) [m] to those on points (m, 3).  Return what
        each pair does (n,), a `PairState`."""

    @abstractmethod
    def add_tangents(
        self, x1: Array, state: ByteArray, geometric_share: float, blocks: PairBlocks, last: Any
    ) -> Any:
        """Add the derivatives [N/m] of the forces by x1 to blocks.

        `state`: what `add_forces` returned for x1; `geometric_share`: of the geometric stiffness;
        `last`: what this method returned at the last iterate of the step, None at the first one.
        """

    @abstractmethod
    def reversed(self, x1: Array) -> PairGroup | None:
        """Return the group of the reversed step from x1; None if it has no part in that."""

    def loss(self, x1: Array) -> float:
        """Return the energy [J] that the pairs dissipate in the step to x1."""
        return 0.0

    # Derivatives, for gradients of runs; μ (m, 3) are adjoint displacements of the points.

    @abstractmethod
    def works(self, x1: Array, μ: Array) -> Array:
        """Return the products (n,) of μ and the forces of each pair in the step to x1."""

    @abstractmethod
    def add_start_product(self, x1: Array, μ: Array, found: Array) -> None:
        """Add (∂f/∂x0)ᵀ μ of what `reversed` leaves out of the forces f to `found` (m, 3)."""

    def work_by_coefficient(self, x1: Array, μ: Array) -> float:
        """Return the derivative of the sum of `works` by the coefficient of friction of bodies with
        each other."""
        return 0.0


class PotentialPairs(PairGroup):
    """Pairs that have a contact potential."""

    def add_forces(self, x1: Array, point_forces: Array) -> ByteArray:
        return self.step.add_forces(x1, point_forces)

    def works(self, x1: Array, μ: Array) -> Array:
        _, forces = self.step.forces(x1)
        return np.asarray(np.einsum("nkc,nkc->n", forces, μ[self.step.pairs.points]))

    def add_start_product(self, x1: Array, μ: Array, found: Array) -> None:
        """Add (4), through the origins of the vectors, which the reversed step keeps."""
        state = replace(self.step, push_back=0.0).states(x1)
        step = self.step.rows((state == PairState.TOUCHES) & ~is_boundary(self.step.pairs.kind))
        pairs = step.pairs
        if not len(pairs):
            return
        by_parameters = np.einsum("nikc,nkc->ni", step.forces_by_origin(x1), μ[pairs.points])
        of_points = parameter_derivatives_of(pairs, step.x0[pairs.points], pairs.parameters)
        np.add.at(found, pairs.points, np.einsum("ni,nikc->nkc", by_parameters, of_points))


class BodyPairs(PotentialPairs):
    """Pairs between bodies, whose four points are block rows."""

    def add_tangents(
        self, x1: Array, state: ByteArray, geometric_share: float, blocks: PairBlocks, last: Any
    ) -> None:
        self.step.add_tangents(x1, state, geometric_share, blocks)

    def reversed(self, x1: Array) -> BodyPairs:
        return BodyPairs(self.step.reversed(x1), self.block_rows)


@dataclass(frozen=True, eq=False)
class ObstaclePairs(PotentialPairs):
    """Pairs with an obstacle, whose points are weighted sums of block rows.

    Attributes:
        row_weights: weights (n, 4, w) of the block rows of each pair in its points.
    """

    row_weights: Array

    def add_tangents(
        self, x1: Array, state: ByteArray, geometric_share: float, blocks: PairBlocks, last: Any
    ) -> None:
        weights = self.row_weights
        by_points = self.step.tangents(x1, state, geometric_share)
        by_rows = np.einsum("npi,npaqb,nqj->nijab", weights, by_points, weights, optimize=True)
        blocks.add(by_rows)

    def reversed(self, x1: Array) -> ObstaclePairs:
        return replace(self, step=self.step.reversed(x1))


def groups_of(step: PairStep, points: ContactPoints) -> list[PairGroup]:
    """Divide the pairs of a step into those between bodies and those with obstacles, and these by
    the number of their block rows."""
    groups: list[PairGroup] = []
    is_of_bodies = np.asarray((step.pairs.points < points.body_count).all(axis=1))
    # Most contacts have no obstacles, or touch none of them.
    if is_of_bodies.any():
        between_bodies = step.rows(is_of_bodies)
        groups.append(BodyPairs(between_bodies, between_bodies.pairs.points))
    if not is_of_bodies.all():
        with_obstacle = step.rows(~is_of_bodies)
        for moving in points.block_rows_of(with_obstacle.pairs.points):
            pairs = with_obstacle.rows(moving.pairs)
            groups.append(ObstaclePairs(pairs, moving.block_rows, moving.weights))
    return groups


# ---- the step ----


@dataclass(frozen=True, eq=False)
class StepForces:
    """Forces of a contact in a step, this rank's share.

    Attributes:
        step: of which they are; None: of a state that was set.
        x1: points (m, 3) [m] at its end.
        on_points: sums over pairs (m, 3) [N].
        states: what each pair does, for each group of the step.
    """

    step: ContactStep | None
    x1: Array
    on_points: Array
    states: Sequence[ByteArray] = ()

    @classmethod
    def zero(cls, x: Array) -> StepForces:
        """No forces on points x (m, 3) [m]."""
        return cls(None, x, np.zeros(x.shape))

    @classmethod
    def of_state(cls, pairs: ActivePairs, x: Array, law: ContactLaw) -> StepForces:
        """Return the forces in the state x (m, 3) [m] alone, without friction."""
        forces = cls.zero(x)
        PairStep.of_state(pairs, x, law).add_forces(x, forces.on_points)
        return forces

    def identifiers_of_passed(self) -> Int64Array:
        """Return the identifiers (k,) of pairs that passed through each other in the step."""
        passed = [np.zeros(0, dtype=np.int64)]
        if self.step is not None:
            for group, state in zip(self.step.groups, self.states, strict=True):
                passed.append(group.step.pairs.identifier[state == PairState.PASSED])
        return np.concatenate(passed)


@dataclass(frozen=True, eq=False)
class StepTangent:
    """Derivatives of the forces of a contact by the end of its step.

    Attributes:
        pattern: of the 3 x 3 blocks.
        blocks: sums (k, 9) [N/m] over the pairs of this rank, between node rows.
        of_groups: what the groups want to know at the next iterate.
    """

    pattern: TangentPattern
    blocks: Array
    of_groups: Sequence[Any]

    @cached_property
    def entries(self) -> CouplingEntries:
        """The couplings in this rank's node rows; collective when first asked for."""
        return self.pattern.entries(self.blocks)


@dataclass(frozen=True, eq=False)
class ContactStep:
    """One contact in a step, on this rank.

    Attributes:
        of_pairs: all active pairs in the step.
        start_time, end_time: of the step [s].
        groups: the pairs by what their tangents need, and those that may rub.
        pattern: of the tangent, with the block indices of each group.
    """

    of_pairs: PairStep
    start_time: float
    end_time: float
    groups: Sequence[PairGroup]
    pattern: TangentPattern

    @property
    def pairs(self) -> StepPairs:
        """The n active pairs."""
        return self.of_pairs.pairs

    @property
    def x0(self) -> Array:
        """The points (m, 3) [m] at the start."""
        return self.of_pairs.x0

    def forces(self, x1: Array) -> StepForces:
        """Return the forces, with friction, of the step to x1 (m, 3) [m]."""
        on_points = np.zeros(x1.shape)
        states = [group.add_forces(x1, on_points) for group in self.groups]
        return StepForces(self, x1, on_points, states)

    def tangent(
        self, forces: StepForces, geometric_share: float, last: StepTangent | None
    ) -> StepTangent:
        """Return the derivative of forces of this step by its end.  `geometric_share`: of the
        geometric stiffness; `last`: tangent at the last iterate of the step, None at the first
        one."""
        values = np.zeros((self.pattern.count, 9))
        before = [None] * len(self.groups) if last is None else last.of_groups
        parts = zip(self.groups, forces.states, self.pattern.index, before, strict=True)
        of_groups = [
            group.add_tangents(forces.x1, state, geometric_share, PairBlocks(index, values), known)
            for group, state, index, known in parts
        ]
        return StepTangent(self.pattern, self.pattern.between_nodes(values), of_groups)

    def loss(self, x1: Array) -> float:
        """Return the energy [J] that friction dissipates in the step to x1, this rank's share."""
        return sum(group.loss(x1) for group in self.groups)

    def reversed(self, x1: Array, start_time: float, end_time: float) -> ContactStep:
        """Return the step from its end x1 back to its start: its force is the same if pairs,
        stiffness and activation distances are.  Friction differs, and is left out."""
        kept = []
        index = []
        for group, of_group in zip(self.groups, self.pattern.index, strict=True):
            backwards = group.reversed(x1)
            if backwards is not None:
                kept.append(backwards)
                index.append(of_group)
        return ContactStep(
            of_pairs=self.of_pairs.reversed(x1),
            start_time=start_time,
            end_time=end_time,
            groups=kept,
            pattern=replace(self.pattern, index=index),
        )
