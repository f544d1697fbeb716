"""The active set: which candidates take part in a step, and from which gap on they have energy; the
history variables that a step takes over from those before, and that a checkpoint holds.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.mechanics.contact.contract import Array, Int64Array, MaskArray
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.narrow_phase.ccd import find_violations
from gossamer_fx.mechanics.contact.narrow_phase.closest_points import PairDistances, approach_bounds
from gossamer_fx.mechanics.contact.pair_table import CandidatePairs
from gossamer_fx.mechanics.contact.stencils import is_boundary
from gossamer_fx.mechanics.terms.assembly import HistoryVariables


def _no_numbers() -> Array:
    return np.zeros(0)


def _no_identifiers() -> Int64Array:
    return np.zeros(0, dtype=np.int64)


@dataclass
class ContactHistory(HistoryVariables):
    """History variables of one contact.

    Energy is conserved if a pair that has energy has a constant stiffness, and if the activation
    distance of a pair changes only while it has none.

    Attributes:
        activation_distance: gap (p,) [m] below which the pairs of a point have energy, of the p
            points for which this rank stores it; before `share` of all points.
        has_begun: whether the activation distances are known, as from the first state on.
        identifier: of pairs that have energy (k,), sorted; at least those of this rank.
        stiffness: k [J] of these pairs (k,).
        reference_speed: least closing speed [m/s] for which stiffness is chosen; zero before the
            first step.
        restored: how often a state was restored, which is not part of the state itself.
        comm: of the contact, once it is known.
    """

    activation_distance: Array = field(default_factory=_no_numbers)
    has_begun: bool = False
    identifier: Int64Array = field(default_factory=_no_identifiers)
    stiffness: Array = field(default_factory=_no_numbers)
    reference_speed: float = 0.0
    restored: int = 0
    comm: MPI.Intracomm | None = None
    _own_points: Int64Array = field(default_factory=_no_identifiers)

    def share(self, comm: MPI.Intracomm, own_points: Int64Array) -> None:
        """Let this rank store the activation distances [m] of some points only; together the ranks
        have all.  `own_points`: numbers (p,) of these points among those of all ranks."""
        self.comm = comm
        self._own_points = own_points
        # A state that was set before is that of all points.
        if self.has_begun:
            self.activation_distance = self.activation_distance[own_points]

    def get_history(self) -> dict[str, Any]:
        """Return the history variables of all ranks for a checkpoint, the same on every rank;
        collective."""
        identifier = self.identifier
        stiffness = self.stiffness
        activation_distance = self.activation_distance
        if self.comm is not None and self.comm.size > 1:
            of_ranks = self.comm.allgather((identifier, stiffness))
            identifiers = np.concatenate([part for part, _ in of_ranks])
            # Two ranks may hold the same pair; its stiffness is the same on both.
            identifier, first = np.unique(identifiers, return_index=True)
            stiffness = np.concatenate([part for _, part in of_ranks])[first]
            of_points = self.comm.allgather((self._own_points, activation_distance))
            numbers = np.concatenate([part for part, _ in of_points])
            # All ranks have the points of obstacles, with the same values.
            _, first = np.unique(numbers, return_index=True)
            activation_distance = np.concatenate([part for _, part in of_points])[first]
        return {
            "activation distance": activation_distance.tolist(),
            "identifier": identifier.tolist(),
            "stiffness": stiffness.tolist(),
            "reference speed": self.reference_speed,
        }

    def shape_history(self) -> dict[str, Any]:
        # The reference speed is that of the first step of a run.
        return self.get_history() | {"reference speed": 0.0}

    def set_history(self, state: dict[str, Any]) -> None:
        """Restore the history variables that `get_history` returned, on any number of ranks."""
        of_all_points = np.array(state["activation distance"], dtype=float)
        self.has_begun = len(of_all_points) > 0
        self.activation_distance = of_all_points
        if self.comm is not None and self.has_begun:
            self.activation_distance = of_all_points[self._own_points]
        self.identifier = np.array(state["identifier"], dtype=np.int64)
        self.stiffness = np.array(state["stiffness"], dtype=float)
        self.reference_speed = float(state["reference speed"])
        # The contact set compares this number, and computes again what follows from the history.
        self.restored += 1

    def keep(self, identifier: Int64Array, stiffness: Array) -> None:
        """Take the stiffness (n,) [J] of the pairs that have energy in the accepted state."""
        order = np.argsort(identifier)
        self.identifier = identifier[order]
        self.stiffness = stiffness[order]

    def keep_some(self, which: MaskArray) -> None:
        """Forget all pairs but some (mask (k,)): a checkpoint has the pairs of all ranks."""
        self.identifier = self.identifier[which]
        self.stiffness = self.stiffness[which]

    def stiffness_of(self, identifier: Int64Array) -> tuple[MaskArray, Array]:
        """Return the mask (n,) of the pairs that have energy already, and their stiffness (n,) [J];
        that of the others has no meaning."""
        if not len(self.identifier):
            return np.zeros(len(identifier), dtype=bool), np.zeros(len(identifier))
        row = np.searchsorted(self.identifier, identifier)
        # An identifier beyond the last one gets the last row, where it is found to differ.
        row = np.minimum(row, len(self.identifier) - 1)
        return self.identifier[row] == identifier, self.stiffness[row]


# Activation distance of a point over its gap at the start of a run, and in the course of it.
# Layers that are packed closer than contact begins have no energy at first, and get their distance
# back as they part.
INITIAL_ACTIVATION = 0.9
GROWN_ACTIVATION = 0.999

# Gap over the activation distance from which a pair takes no part in a step.
FAR = 1.5

# Part of the change of a gap in a step by which its end may be wrong, as the step is only
# predicted.
PREDICTION_MARGIN = 0.3

# Gaps over the activation distance up to which a pair is active that is near at the start of a
# step, and up to which one that was left out has to be added at its end.
NEAR_AT_START = 1.05
NEAR_AT_END = 1.02


class Activation:
    """Activation distances: gaps [m] below which pairs have energy; a history variable of points.

    The history has those of the points that a rank owns, this object those of the m points that it
    knows, which a search changes.

    Args:
        largest: activation distance of the contact [m].
    """

    def __init__(self, mesh: CollisionMesh, history: ContactHistory, largest: float) -> None:
        self._mesh = mesh
        self._history = history
        self._largest = largest
        self._own, own_numbers = mesh.own_points()
        history.share(mesh.comm, own_numbers)
        # Of the m points that this rank knows.
        self._of_points = history.activation_distance
        self.forget_pairs()

    def forget_pairs(self) -> None:
        """Free what is known about pairs."""
        # Their distances, and the objects from which they follow: computed again with either.
        self._candidates: CandidatePairs | None = None
        self._used: Array | None = None
        self._of_pairs: Array = np.zeros(0)

    def begin(self, nearest: Array) -> None:
        """Choose the distances of a run, given the gap (m,) [m] of points to what is nearest. They
        are nine tenths of the gap where layers are nearer to each other than that, so that they
        have no energy at first."""
        self._keep(np.minimum(self._largest, INITIAL_ACTIVATION * nearest))
        self._history.has_begun = True

    def grow(self, nearest: Array) -> None:
        """Let the distances grow with the gaps (m,) [m] of points to what is nearest. No pair has
        energy between the present distance and its gap, so that growth costs none."""
        possible = np.minimum(self._largest, GROWN_ACTIVATION * nearest)
        grown = np.maximum(self._of_points, possible)
        # Without growth the array stays the same object, for which pairs' distances are known.
        if not np.array_equal(grown, self._of_points):
            self._keep(grown)

    def _keep(self, of_points: Array) -> None:
        """Take new distances (m,) [m] of the points that this rank knows, which are the same on
        all ranks that know a point; write those of the points that it owns to the history."""
        self._of_points = of_points
        self._history.activation_distance = of_points
        if self._mesh.comm.size > 1:
            self._history.activation_distance = of_points[self._own]

    def update_points(self) -> None:
        """Read the distances of the points that this rank knows since a search; collective."""
        of_own = self._history.activation_distance
        # The only rank knows the same points as before.
        if self._mesh.comm.size == 1:
            self._of_points = of_own
            return
        self._own, _ = self._mesh.own_points()
        if self._history.has_begun:
            of_points = np.empty(self._mesh.points.count)
            of_points[self._own] = of_own
            self._mesh.shared.spread(of_points[: self._mesh.points.body_count])
            self._of_points = of_points

    def of(self, candidates: CandidatePairs) -> Array:
        """Return the gap (n,) [m] below which each pair has energy: the least of those of its
        points. Of a point and a boundary that of the point counts alone.  The same array is
        returned as long as nothing has changed."""
        if candidates is not self._candidates or self._of_points is not self._used:
            self._candidates = candidates
            self._used = self._of_points
            first, second, third, fourth = self._of_points[candidates.points.T]
            # Four arrays at a time: a minimum along the short axis takes four times as long.
            least = np.minimum(np.minimum(first, second), np.minimum(third, fourth))
            self._of_pairs = np.where(is_boundary(candidates.kind), first, least)
        return self._of_pairs


class StepDistances:
    """Distances of all candidates in one step from x0 to x1.

    Args:
        far: gap [m] from which a pair takes no part in a step.

    Attributes:
        start: distances at the start.
        end: distances at the end; gaps of pairs that stay far are lower bounds.
        approach: by how much pairs can come closer (n,) [m].
    """

    def __init__(self, start: PairDistances, x1: Array, far: float) -> None:
        candidates = start.candidates
        self.start = start
        self.approach = approach_bounds(candidates, start.x, x1)
        # Boundaries have an infinite bound; their gap is always computed.
        with np.errstate(invalid="ignore"):
            lower_bound = start.gap - self.approach
            stays_far = lower_bound - PREDICTION_MARGIN * self.approach > far
        self.end = PairDistances(candidates, x1, lower_bound)
        self.end.make_exact((~stays_far).nonzero()[0])

    def violations(self, activation_distance: Array, among: MaskArray) -> np.ndarray:
        """Return the indices (k,) of contact pairs that all but pass through each other in the
        step. These are pairs whose gap falls below a tenth of its value at the start, or of the
        activation distance if that is less; see `find_violations`. `among`: mask (n,) of the pairs
        that are asked for; boundaries are left out in any case."""
        return find_violations(
            self.start.candidates,
            self.start.x,
            self.end.x,
            gap=self.start.gap,
            activation_distance=activation_distance,
            approach=self.approach,
            among=among,
        )

    def may_touch(self, activation_distance: Array) -> MaskArray:
        """Return the mask (n,) of the candidates that are near at the start, may be near at the
        end, or would pass through."""
        start = self.start.gap
        end = self.end.gap
        is_near = start < NEAR_AT_START * activation_distance
        uncertainty = PREDICTION_MARGIN * np.abs(end - start)
        is_near |= end < FAR * activation_distance + uncertainty
        is_near[self.violations(activation_distance, among=~is_near)] = True
        return is_near

    def missing(self, activation_distance: Array, active: MaskArray) -> MaskArray:
        """Return the mask (n,) of the candidates that are near at the end of the step or would pass
        through, but are not among those that take part, `active` (mask (n,))."""
        left_out = ~active
        is_missing = (self.end.gap < NEAR_AT_END * activation_distance) & left_out
        is_missing[self.violations(activation_distance, among=left_out)] = True
        return is_missing
