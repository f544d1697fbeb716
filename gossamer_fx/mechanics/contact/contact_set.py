"""One contact in the course of the steps: the stages of contact, one after the other.

A step from x0 to x1 goes through

    update_active_set   broad phase, if points have left their bounds; gaps at x0; growth of
                        activation distances; active set for the predicted end
    add_forces,         potential and friction of the active pairs, in each Newton iteration
    add_tangents
    extend_active_set   after the iteration: pairs that are near at its end and were left out
    inadmissible        what must not be in a solution
    commit              energy and history of the accepted end

x0 and x1 (m, 3) [m] are the points that this rank knows, at the start and at the end.  All methods
are collective.
"""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.checks.errors import Inadmissible
from gossamer_fx.core.forms.c_source import c_library
from gossamer_fx.mechanics.contact.active_set import (
    FAR,
    Activation,
    ContactHistory,
    PairStiffness,
    Selection,
    StepDistances,
    activate,
)
from gossamer_fx.mechanics.contact.assembly import BlockAssembly
from gossamer_fx.mechanics.contact.broad_phase.candidates import (
    Candidates,
    CandidateSearch,
    StepPoints,
    nearest_gaps,
)
from gossamer_fx.mechanics.contact.contact_step import (
    PUSH_BACK,
    ContactLaw,
    ContactStep,
    PairStep,
    StepForces,
    StepTangent,
    begin_at,
    energy_of_pairs,
    groups_of,
)
from gossamer_fx.mechanics.contact.contract import Array, Int32Array, MaskArray
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.geometry.contact_points import ContactPoints
from gossamer_fx.mechanics.contact.geometry.curved_cells import ALLOWED_DISTANCE
from gossamer_fx.mechanics.contact.kernels.library import HEADER
from gossamer_fx.mechanics.contact.narrow_phase.ccd import KEPT_GAP, LargeTurns
from gossamer_fx.mechanics.contact.narrow_phase.intersections import (
    refuse_coincident,
    refuse_intersections,
    refuse_points_inside,
)
from gossamer_fx.mechanics.contact.pairs import (
    TINY,
    ActivePairs,
    CandidatePairs,
    PairDistances,
    StepPairs,
    closest_points,
    is_boundary,
)
from gossamer_fx.mechanics.terms.assembly import Assembly, CouplingBlocks

if TYPE_CHECKING:
    # A scene without friction does not load it.
    from gossamer_fx.mechanics.contact.friction.friction import Friction

LOG = logging.getLogger("gossamer_fx")

# Way of a node in one Newton update, over the activation distance, at most.  Longer updates put
# layers on the wrong side of others, and the iteration does not come back.
MAX_UPDATE = 4.0

# How far the motion of an obstacle may be from a straight and uniform one in a step, over the
# activation distance.  A jump of half of this distance is refused, however short the step is.
MAX_DEVIATION = 0.25

# Way of an obstacle in a pseudo-step of an equilibrium that is allowed at any gap, over the
# activation distance.
MIN_STATIC_WAY = 0.05

# Scaled distance beyond the range of a pair up to which a run tape records it: when the step is
# made again, its points differ by round-off.
SCALED_MARGIN = 1e-6


@dataclass(frozen=True, eq=False)
class AcceptedState:
    """A contact in the accepted state of the system.

    Attributes:
        time: [s].
        x: points (m, 3) [m] that this rank knows.
        step: the step of a run that led here; None: there is none, or it is not known.
        version: `history.restored` when the state was accepted: with another number the history is
            not that of the step.
    """

    time: float
    x: Array
    step: ContactStep | None = None
    version: int = 0


class StepRules(ABC):
    """What steps of a run and pseudo-steps of an equilibrium do not have in common.

    Args:
        points: of the contact.
        activation_distance: of the contact [m].
    """

    def __init__(self, points: ContactPoints, system: Assembly, activation_distance: float) -> None:
        self._points = points
        self._system = system
        self._activation_distance = activation_distance

    @abstractmethod
    def refuse_motions(self) -> None:
        """Refuse a step in which contact cannot follow the motion of an obstacle; collective.

        Raises:
            Inadmissible: the step is then tried in parts.
            InputError: the motion of an obstacle raises or returns other than three numbers.
        """

    @abstractmethod
    def refuse_ways(self, step: StepDistances, activation_distance: Array) -> None:
        """Refuse a step that is predicted to lead to the wrong side of something; collective.
        `activation_distance`: of each candidate (n,) [m].

        Raises:
            Inadmissible: see `refuse_motions`.
        """

    @abstractmethod
    def velocities(self, x0: Array, start_time: float, end_time: float) -> Array:
        """Return the velocities (m, 3) [m/s] that predict the end of the step; collective."""

    @abstractmethod
    def stiffness(self, known: Array, has_energy: MaskArray, chosen: Array) -> Array:
        """Return the stiffness (n,) [J] of pairs, of which some had energy with a `known` one and
        the others were given a `chosen` one."""

    @abstractmethod
    def commit(self, step: ContactStep | None) -> tuple[ContactStep | None, ContactStep | None]:
        """Return the present step after a step was accepted, and the one that led to the accepted
        state."""

    @abstractmethod
    def find_turns(self, turns: LargeTurns, start: PairDistances, x1: Array) -> str:
        """Report a body that turns too far in a step to x1, or return an empty clause."""


class StepsInTime(StepRules):
    """Steps of a run."""

    def refuse_motions(self) -> None:
        limit = MAX_DEVIATION * self._activation_distance
        self._points.refuse_jumps(self._system.time, self._system.h, limit)

    def refuse_ways(self, step: StepDistances, activation_distance: Array) -> None:
        """Nothing is refused: the active set is extended, or the solution refused."""

    def velocities(self, x0: Array, start_time: float, end_time: float) -> Array:
        return self._points.rates(self._system.v0, start_time, self._system.h)

    def stiffness(self, known: Array, has_energy: MaskArray, chosen: Array) -> Array:
        # The stiffness of pairs that have energy is constant: with another one energy would appear.
        return np.where(has_energy, known, chosen)

    def commit(self, step: ContactStep | None) -> tuple[ContactStep | None, ContactStep | None]:
        return None, step

    def find_turns(self, turns: LargeTurns, start: PairDistances, x1: Array) -> str:
        return turns.find(start, x1)


class PseudoSteps(StepRules):
    """Pseudo-steps of an equilibrium, which have no motion in time."""

    def refuse_motions(self) -> None:
        """A motion has no speed here; `refuse_ways` sees its length."""

    def refuse_ways(self, step: StepDistances, activation_distance: Array) -> None:
        """Refuse a pseudo-step in which obstacles pass through bodies as these are: Newton's
        iteration would start on the wrong side."""
        start = step.start
        prescribed = self._points.prescribed
        ways = np.linalg.norm(step.end.x[prescribed] - start.x[prescribed], axis=1)
        if ways.max(initial=0.0) <= MIN_STATIC_WAY * self._activation_distance:
            return
        candidates = start.candidates
        kept = KEPT_GAP * np.minimum(start.gap, activation_distance)
        is_behind = is_boundary(candidates.kind) & (step.end.gap < kept)
        everything = np.ones(len(candidates), dtype=bool)
        passed = step.violations(activation_distance, among=everything)
        if self._system.comm.allreduce(bool(is_behind.any() or len(passed))):
            raise Inadmissible(
                f"an obstacle moves by {ways.max():.3g} m, through bodies that it has to move"
            )

    def velocities(self, x0: Array, start_time: float, end_time: float) -> Array:
        # Only obstacles move, from where they were in the accepted state.
        moved = self._points.at(self._system.q0, end_time) - x0
        return np.asarray(moved / self._system.h)

    def stiffness(self, known: Array, has_energy: MaskArray, chosen: Array) -> Array:
        # No energy has to be conserved, and the load may have grown.
        return np.maximum(np.where(has_energy, known, chosen), chosen)

    def commit(self, step: ContactStep | None) -> tuple[ContactStep | None, ContactStep | None]:
        # The residual of the accepted state is asked for, too: whether it is in equilibrium.
        return step, None

    def find_turns(self, turns: LargeTurns, start: PairDistances, x1: Array) -> str:
        # Nothing turns on a way.
        return ""


class ContactSet:
    """The pairs of one contact on this rank, and what a step does with them.

    Attributes:
        mesh, law, activation_distance, history, system, friction: as given.
        pair_stiffness: stiffness of pairs that begin to touch.
        activation: gaps below which pairs have energy.
        search: finds candidate pairs.
        accepted: the contact in the accepted state.
        step: the present step; None between steps, except in statics.
        forces: of the last residual, or of a state that was set.
    """

    def __init__(
        self,
        mesh: CollisionMesh,
        law: ContactLaw,
        activation_distance: float,
        stiffness: float | None,
        history: ContactHistory,
        system: Assembly,
        friction: Friction | None = None,
    ) -> None:
        c_library(HEADER, system.comm)
        for stencil in dict.fromkeys(one.boundary.stencil for one in mesh.boundaries):
            stencil.prepare(system.comm)
        self.mesh = mesh
        self.law = law
        self.activation_distance = activation_distance
        self.history = history
        self.system = system
        self.friction = friction
        self.search = CandidateSearch(mesh, activation_distance)
        self.pair_stiffness = PairStiffness(mesh, stiffness, activation_distance, system)
        self.activation = Activation(mesh, history, activation_distance)
        no_points = np.zeros((mesh.points.count, 3))
        self.accepted = AcceptedState(time=0.0, x=no_points)
        self.step: ContactStep | None = None
        self.forces = StepForces.zero(no_points)
        rules = PseudoSteps if system.rule.is_static else StepsInTime
        self._rules: StepRules = rules(mesh.points, system, activation_distance)
        self._assembly = BlockAssembly(mesh.points, system)
        self._tangent: StepTangent | None = None  # of the present step, at the last iterate
        self._candidates: Candidates | None = None  # of the last search
        # Of the present step, or the last one; None if its pairs are those of a run tape, which are
        # complete.
        self._selection: Selection | None = None
        self._closest = math.inf
        self._has_warned_of_curvature = False
        self._turns = LargeTurns(mesh, activation_distance, system)
        # Energy [J] of the accepted state, with `history.restored` of the time at which it was
        # computed: another number means that it is not that of the present history.
        self._energy = 0.0
        self._energy_version = history.restored

    @property
    def points(self) -> ContactPoints:
        return self.mesh.points

    @property
    def candidates(self) -> CandidatePairs:
        """The candidate pairs of this rank."""
        return self._found().pairs

    def _found(self) -> Candidates:
        """The result of the last search."""
        assert self._candidates is not None, "the first `commit` finds candidates"
        return self._candidates

    @property
    def closest(self) -> float:
        """Least gap [m] at the start of any step so far; collective."""
        return float(self.system.comm.allreduce(self._closest, op=MPI.MIN))

    # ---- states ----

    def _set_initial_state(self) -> None:
        """Check the first state of a run, and choose the activation distances of its points.

        Raises:
            InputError: layers intersect or coincide, or a point is inside a box.
        """
        x = self._search_at_rest()
        # Intersections first: gaps between layers that intersect mean nothing.
        refuse_intersections(self.mesh, x, self.system.comm)
        refuse_points_inside(self.mesh, x)
        gap = PairDistances.of(self.candidates, x).gap
        nearest = nearest_gaps(self.candidates, gap, self.mesh)
        refuse_coincident(self.mesh, x, nearest, self.activation_distance)
        self.activation.begin(nearest)

    def commit(self) -> None:
        """Take the accepted coordinates q0 as the start of the next step, and update the history.

        Raises:
            InputError: in the first call, if layers intersect or coincide, or a point is inside a
                box.
        """
        history = self.history
        step = self.step
        # `system.time` is still the old one when terms commit.
        time = self.system.time if step is None else step.end_time
        self._take_state(time)
        if not history.has_begun:
            self._take_state(self.system.time)
            self._set_initial_state()
        # If a state was restored since the energy was computed, its history is not that of these
        # pairs.
        if step is not None and history.restored == self._energy_version:
            pairs = step.pairs
            parameters = self._known_parameters(pairs)
            self._energy, scaled = energy_of_pairs(pairs, self.accepted.x, self.law, parameters)
            has_energy = scaled < 1
            history.keep(pairs.identifier[has_energy], pairs.stiffness[has_energy])
            self._check_curvature(pairs.points[has_energy])
        present, accepted = self._rules.commit(step)
        self.accepted = replace(self.accepted, step=accepted, version=history.restored)
        self._begin(present)

    def _check_curvature(self, points: Int32Array) -> None:
        """Warn once if a curved surface of order 2 is too far from the flat pieces as which it
        touches; collective.  `points`: of the pairs (n, 4) that have energy."""
        if self._has_warned_of_curvature or max(self.mesh.piece_counts) == 1:
            return
        distances = self.mesh.distances_from_pieces(self.accepted.x)[points]
        farthest = self.mesh.comm.allreduce(float(distances.max(initial=0.0)), op=MPI.MAX)
        if farthest <= ALLOWED_DISTANCE * self.activation_distance:
            return
        self._has_warned_of_curvature = True
        if self.mesh.comm.rank == 0:
            LOG.warning(
                "Contact between %s: where it presses, a curved surface of order 2 is up to %.2g m "
                "from the flat pieces as which it touches, more than a quarter of the distance of "
                "%.2g m, and may be inside of what it touches by as much; give smaller cells, or a "
                "larger distance.",
                ", ".join(f"'{name}'" for name in self.mesh.names),
                farthest,
                self.activation_distance,
            )

    def _take_state(self, time: float) -> Array:
        """Take q0 as the accepted state at a time [s]; return its points (m, 3) [m].
        Collective."""
        x = self.points.at(self.system.q0, time)
        self.accepted = replace(self.accepted, time=time, x=x)
        return x

    def save_active_set(self) -> ActivePairs | None:
        """Return the pairs of the last accepted step that have energy at one of its ends. The
        others have neither force nor tangent."""
        step = self.accepted.step
        # On several ranks a search changes which points a rank knows, and with them the rows of
        # pairs.
        if step is None or self.system.comm.size > 1:
            return None
        pairs = step.pairs
        # Starts have squared distances with rounded edges.
        scaled_at_start = (pairs.start[:, 3] - pairs.offset) / pairs.width
        _, scaled_at_end = energy_of_pairs(pairs, self.accepted.x, self.law)
        is_near = np.minimum(scaled_at_start, scaled_at_end) < 1 + SCALED_MARGIN
        return pairs.rows(is_near)

    def load_active_set(self, pairs: ActivePairs | None) -> None:
        """Start a step from the accepted state, with pairs that were recorded, or searched."""
        if pairs is None:
            self.update_active_set()
            return
        self._selection = None
        self._set_reference_speed()
        end_time = self.system.time + self.system.h
        # The step was accepted: whatever separates fast in it does not count as passed.
        self._begin(self._step_of(self._from_start(pairs), end_time, push_back=0.0))

    def activate_present(self) -> None:
        # First of all: after a restore it searches candidates, of which the pairs are taken.
        self.stored_energy()
        self._selection = None
        pairs = self._from_start(self.pairs_with_energy())
        self._begin(self._step_of(pairs, self.system.time))

    def _from_start(self, pairs: ActivePairs) -> StepPairs:
        """Return pairs of a step from the accepted state."""
        x = self.accepted.x
        return begin_at(pairs, x, *closest_points(pairs, x))

    def _known_parameters(self, pairs: ActivePairs) -> Array | None:
        """Return (u, v) (n, 2) of pairs of the last step in the accepted state; None: they are to
        be computed."""
        selection = self._selection
        if selection is None:
            return None
        distances = selection.distances_at(self.candidates, self.accepted.x)
        if distances is None:
            return None
        # A search at the end of the step may have made other candidates than those of the pairs.
        if not np.array_equal(self.candidates.identifier[selection.active], pairs.identifier):
            return None
        return distances.closest_points(selection.active)[1]

    def stored_energy(self) -> float:
        """Return the energy [J] of this rank's pairs in the accepted state; collective.

        The first call after a state was restored searches candidates again, and retains of the
        history, which a checkpoint has for all ranks, the pairs of this rank.
        """
        history = self.history
        if history.restored != self._energy_version:
            self._energy_version = history.restored
            self.accepted = replace(self.accepted, time=self.system.time)
            x = self._search_at_rest()
            history.keep_some(np.isin(history.identifier, self.candidates.identifier))
            pairs = self.pairs_with_energy()
            self._energy, _ = energy_of_pairs(pairs, x, self.law)
            self.forces = StepForces.of_state(pairs, x, self.law)
        return self._energy if len(history.identifier) else 0.0

    def pairs_with_energy(self) -> ActivePairs:
        """Return this rank's pairs that have energy at q0; after `stored_energy`."""
        active = np.isin(self.candidates.identifier, self.history.identifier)
        _, stiffness = self.history.stiffness_of(self.candidates.identifier[active])
        return self._activated(active, stiffness)

    def last_step(self) -> ContactStep | None:
        """Return the step that led to the accepted state; after `stored_energy`.  None if that is
        not known, as of a state that was restored, and in statics."""
        if self.accepted.version != self.history.restored:
            return None
        return self.accepted.step

    # ---- the active set of a step ----

    def _set_reference_speed(self) -> None:
        """Take the least closing speed from the length of the first step of a run, also where it is
        made again: without it derivatives would take the stiffness of its pairs for one by their
        speed."""
        if not self.history.reference_speed:
            self.history.reference_speed = self.pair_stiffness.reference_speed(self.system.h)

    def update_active_set(self) -> None:
        """Find the pairs that may touch in the step.

        Those take part that are near at the end that is predicted from the velocities.

        Raises:
            Inadmissible: the motion of an obstacle jumps in the step, which is then tried in parts.
            InputError: the motion of an obstacle raises or returns other than three numbers.
        """
        system = self.system
        self.stored_energy()
        end_time = system.time + system.h
        self._rules.refuse_motions()
        self._set_reference_speed()
        points = self._predicted(end_time)
        # The present list is complete while all points are within their bounds.
        found = self._found()
        is_complete = found.hold(points.x, system.time) and found.hold(points.end, end_time)
        if not is_complete:
            points = self._search(lambda: self._predicted(end_time))
        self.search.begin_step()
        start = None
        if self._selection is not None:
            # The end of a step is the start of the next one.
            start = self._selection.distances_at(self.candidates, points.x)
        if start is None:
            start = PairDistances.of(self.candidates, points.x)
        self._grow_activation(start.gap)
        activation_distance = self.activation.of(self.candidates)
        # For the predicted end; `extend_active_set` corrects it after the solution.
        step = StepDistances(start, points.end, FAR * self.activation_distance)
        self._rules.refuse_ways(step, activation_distance)
        active = step.may_touch(activation_distance)
        self._select(Selection(start, points.v, active), end_time)

    def _predicted(self, end_time: float) -> StepPoints:
        """Return the points of the present step, at the end as without forces; collective."""
        x = self.accepted.x
        v = self._rules.velocities(x, self.accepted.time, end_time)
        return StepPoints(x, v, np.ascontiguousarray(x + self.system.h * v))

    def set_static_load(self, force: float, tensions: Mapping[str, float]) -> None:
        self.pair_stiffness.set_static_load(force, tensions)

    def stiffen(self) -> bool:
        """Stiffen all pairs if those with energy are nearly closed in the accepted state of an
        equilibrium: supports or obstacles press them, whose forces are not known before.  Return
        whether they were stiffened; not if the stiffness is given."""
        if self.pair_stiffness.given is not None:
            return False
        own_sums = np.array([self.stored_energy(), self.history.stiffness.sum()])
        energy, stiffness = self.system.comm.allreduce(own_sums)
        return self.pair_stiffness.stiffen(float(energy / max(stiffness, TINY)))

    def _search(self, read: Callable[[], StepPoints]) -> StepPoints:
        """Find candidates for the present step, of which `read` returns the points.  The search may
        change which points this rank knows: they are read again, and returned."""
        system = self.system
        time = self.accepted.time

        def read_again() -> StepPoints:
            self._take_state(time)
            return read()

        # The tables of the last search are freed before the next one makes its own.
        self._selection = None
        self.activation.forget_pairs()
        self._candidates = self.search.find(read_again, system.time, system.h)
        points = read_again()
        if system.comm.size > 1:
            self.forces = StepForces.zero(points.x)
        self.activation.update_points()
        return points

    def _search_at_rest(self) -> Array:
        """Find candidates about the points of the accepted state, as if they did not move; return
        these points (m, 3) [m]."""
        time = self.accepted.time
        self._candidates = self.search.find_at_rest(lambda: self._take_state(time), time)
        if self.system.comm.size > 1:
            # Rows of pairs and forces are those of points that this rank knew before.
            self._begin(None)
            self.forces = StepForces.zero(self.accepted.x)
        self.activation.update_points()
        return self.accepted.x

    def _grow_activation(self, gap: Array) -> None:
        """Let activation distances grow with the gaps (n,) [m] at the start of the step;
        collective."""
        near = np.where(gap < FAR * self.activation_distance, gap, np.inf)
        nearest = nearest_gaps(self.candidates, near, self.mesh)
        self._closest = min(self._closest, float(nearest.min(initial=np.inf)))
        self.activation.grow(nearest)

    def _activated(self, active: MaskArray, stiffness: Array) -> ActivePairs:
        """Return the candidates of a mask (n,) as active pairs with a stiffness (k,) [J]."""
        activation_distance = self.activation.of(self.candidates)[active]
        return activate(self.candidates.rows(active), activation_distance, stiffness, self.law)

    def _select(self, selection: Selection, end_time: float) -> None:
        """Begin a step with the candidates that a selection has: choose their stiffness and the
        tangent's pattern.  Collective."""
        active = selection.active
        x0 = self.accepted.x
        candidates = self.candidates.rows(active)
        squared_distance, parameters = selection.start.closest_points(active)
        has_energy, known = self.history.stiffness_of(candidates.identifier)
        chosen = self.pair_stiffness.choose(
            candidates, squared_distance, x0, selection.v, self.history.reference_speed
        )
        pairs = self._activated(active, self._rules.stiffness(known, has_energy, chosen))
        self._selection = selection
        self._begin(self._step_of(begin_at(pairs, x0, squared_distance, parameters), end_time))

    def _step_of(
        self, pairs: StepPairs, end_time: float, push_back: float = PUSH_BACK
    ) -> ContactStep:
        """Return the step with some pairs from the accepted state to a time [s]; collective."""
        alpha = self.system.rule.alpha
        of_pairs = PairStep(pairs, self.accepted.x, self.law, alpha, push_back)
        groups = groups_of(of_pairs, self.points)
        if self.friction is not None:
            groups += self.friction.groups(of_pairs)
        pattern = self._assembly.couple([group.block_rows for group in groups])
        return ContactStep(of_pairs, self.accepted.time, end_time, groups, pattern)

    def _begin(self, step: ContactStep | None) -> None:
        """Take a step as the present one; the tangent of another one is not known yet."""
        if step is not self.step:
            self._tangent = None
        self.step = step

    def exchange_ends(self) -> None:
        """Reverse the step: the accepted state and time of the system are its new start. Gradients
        need the reversed step."""
        step = self.step
        if step is None:
            return
        time = self.system.time
        x = self._take_state(time)
        self._begin(step.reversed(x, time, time + self.system.h))

    def extend_active_set(self) -> bool:
        """Add pairs that are near at the end of a step, or were passed on the way; return whether
        there were any on any rank.  They were left out because the end was only predicted.  A step
        with recorded pairs is complete."""
        selection = self._selection
        if selection is None:
            return False
        assert self.step is not None, "a step begins with `update_active_set`"
        end_time = self.step.end_time
        x1 = self.end_points()
        if not self._found().hold(x1, end_time):
            identifier = self.candidates.identifier[selection.active]
            points = self._search(lambda: replace(self._predicted(end_time), end=self.end_points()))
            x1 = points.end
            active = np.isin(self.candidates.identifier, identifier)
            start = PairDistances.of(self.candidates, points.x)
            selection = Selection(start, points.v, active)
            if self.system.comm.size > 1:
                # The points of the pairs have other numbers now; forces are those of the last
                # residual.
                self._select(selection, end_time)
                self.forces = self._forces_at(x1)
        step = StepDistances(selection.start, x1, FAR * self.activation_distance)
        selection = replace(selection, solved=step)
        self._selection = selection
        activation_distance = self.activation.of(self.candidates)
        missing = step.missing(activation_distance, selection.active)
        if not self.system.comm.allreduce(bool(missing.any())):
            return False
        # Pairs are only added: taking some out could alternate without an end.
        active = selection.active | missing | step.may_touch(activation_distance)
        self._select(replace(selection, active=active), end_time)
        return True

    def end_points(self) -> Array:
        """Return the points (m, 3) [m] at the end of the step, as iterated."""
        assert self.step is not None, "a step begins with `update_active_set`"
        return self.points.at(self.system.q1, self.step.end_time)

    def inadmissible(self) -> str:
        """Report what passed through something else in the step, or all but did: a clause that
        names two bodies and a point [m] near which they meet, or a body that turns too far; empty
        if the step is admissible.  The same on every rank."""
        comm = self.system.comm
        x1 = self.end_points()
        assert self._selection is not None, "a recorded step was accepted"
        solved = self._selection.solved
        # It has the gaps at both ends of the step as `extend_active_set` last saw it.  What is
        # added here is found below.
        if comm.allreduce(solved is None or not np.array_equal(x1, solved.end.x)):
            self.extend_active_set()
        selection = self._selection
        solved = selection.solved
        assert solved is not None
        candidates = self.candidates
        behind_boundaries = is_boundary(candidates.kind) & (solved.end.gap <= 0)
        passed = np.isin(candidates.identifier, self._forces_at(x1).identifiers_of_passed())
        violations = solved.violations(self.activation.of(candidates), among=selection.active)
        rows = [violations, np.flatnonzero(passed), np.flatnonzero(behind_boundaries)]
        wrong = np.concatenate(rows)
        message = ""
        if len(wrong):
            first = int(wrong[0])
            point = candidates.points[first, 0]
            one = self.mesh.name_of(point)
            other = self.mesh.name_of(candidates.second_point[first])
            x, y, z = x1[point]
            message = f"'{one}' would pass through '{other}' near ({x:.4g}, {y:.4g}, {z:.4g}) m"
        message = next(filter(None, comm.allgather(message)), "")
        return message or self._rules.find_turns(self._turns, selection.start, x1)

    def limit_update(self, update: Array) -> None:
        """Shorten a Newton update in place, node by node, to `MAX_UPDATE` activation distances."""
        longest = MAX_UPDATE * self.activation_distance
        for body in self.mesh.bodies:
            owned = self.system.block(body).owned
            # Most updates are so small that no coordinate comes near the limit.
            of_body = update[owned]
            largest = max(of_body.max(initial=0.0), -of_body.min(initial=0.0))
            if math.sqrt(3) * largest < longest:
                continue
            rows = of_body.reshape(-1, body.block.size)
            x, y, z = rows[:, :3].T
            way = np.sqrt(x * x + z * z + y * y)
            # A whole node keeps the direction of its update.
            if way.max(initial=0.0) > longest:
                rows *= np.minimum(1.0, longest / np.maximum(way, TINY))[:, None]

    # ---- forces ----

    def _forces_at(self, x1: Array) -> StepForces:
        """Return the forces of the present step at its end x1 (m, 3) [m]: those of the last
        residual if they are."""
        assert self.step is not None, "forces are those of a step"
        if self.forces.step is self.step and bool((self.forces.x1 == x1).all()):
            return self.forces
        return self.step.forces(x1)

    def add_forces(self, r: PETSc.Vec) -> None:
        if self.step is not None:
            self.forces = self.step.forces(self.end_points())
            self.points.add(self.forces.on_points, r)

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the blocks on the diagonal of the tangent [N/m]; `coupling_matrices` has the others.
        Between steps zeros reserve these blocks in the pattern."""
        step = self.step
        if step is None:
            self._assembly.reserve_diagonal(A)
            return
        forces = self._forces_at(self.end_points())
        self._tangent = step.tangent(forces, self.system.geometric, last=self._tangent)
        step.pattern.add_diagonal(A, self._tangent.blocks)

    def coupling_matrices(self, diagonal: PETSc.Vec | None) -> list[PETSc.Mat]:
        tangent = self._tangent
        if tangent is None:
            return []
        entries = tangent.entries
        if diagonal is not None:
            entries = tangent.pattern.strong(entries, diagonal)
        coupling = tangent.pattern.matrix(entries)
        return [] if coupling is None else [coupling]

    def coupling_blocks(self) -> CouplingBlocks | None:
        tangent = self._tangent
        return None if tangent is None else tangent.pattern.blocks(tangent.entries)

    # ---- energy balance of a step ----

    def supplied(self) -> float:
        """Return the work [J] of prescribed obstacles in the step, this rank's share."""
        prescribed = self.points.prescribed
        if self.step is None or not len(prescribed):
            return 0.0
        displacement = self.end_points()[prescribed] - self.step.x0[prescribed]
        return float(np.sum(self.forces.on_points[prescribed] * displacement))

    def dissipated(self) -> Array:
        """Return the energy [J] that friction dissipates in the step, this rank's share."""
        if self.friction is None:
            return np.zeros(0)
        if self.step is None:
            return np.zeros(1)
        return np.array([self.step.loss(self.end_points())])
