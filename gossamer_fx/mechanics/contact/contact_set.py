"""One contact in the course of the steps: the stages of contact, one after the other.

A step from x0 to x1 goes through

    begin_step          broad phase, if points have left their bounds; gaps at x0; growth of
                        activation distances; active set for the predicted end
    add_forces,         potential and friction of the active pairs, in each Newton iteration
    add_tangents
    extend_active_set   after the iteration: pairs that are near at its end and were left out
    find_penetration    what must not be in a solution
    commit              energy and history of the accepted end
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.mechanics.contact.active_set import (
    FAR,
    Activation,
    StepDistances,
    grown_activation,
    initial_activation,
)
from gossamer_fx.mechanics.contact.arrays import Array, Int64Array, MaskArray
from gossamer_fx.mechanics.contact.broad_phase.candidates import (
    CandidateSearch,
    StepPoints,
    nearest_gaps,
)
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.history import ContactHistory
from gossamer_fx.mechanics.contact.kernels.library import library
from gossamer_fx.mechanics.contact.narrow_phase.closest_points import PairDistances, closest_points
from gossamer_fx.mechanics.contact.narrow_phase.initial_check import (
    refuse_coincident,
    refuse_intersections,
    refuse_points_inside,
)
from gossamer_fx.mechanics.contact.narrow_phase.large_turns import LargeTurns
from gossamer_fx.mechanics.contact.pair_stiffness import PairStiffness
from gossamer_fx.mechanics.contact.pair_table import ActivePairs, CandidatePairs, is_wall
from gossamer_fx.mechanics.contact.potential import (
    PUSH_BACK,
    ContactLaw,
    activate,
    energy_of_pairs,
    pair_starts,
)
from gossamer_fx.mechanics.contact.step_forces import StepForces
from gossamer_fx.mechanics.contact.system_view import ContactAssembly

if TYPE_CHECKING:
    # A scene without friction does not load it.
    from gossamer_fx.mechanics.contact.friction.friction import Friction

# Way of a node in one Newton update, over the activation distance, at most.  Longer updates put
# layers on the wrong side of others, and the iteration does not come back: docs/theory/contact.md
# has the figures.
MAX_UPDATE = 4.0

# How far the motion of an obstacle may be from a straight and uniform one in a step, over the
# activation distance.  A jump of half of this distance is refused, however short the step is.
MAX_DEVIATION = 0.25

# Scaled distance beyond the range of a pair up to which a tape records it, against the round-off of
# points that are placed again.
SCALED_MARGIN = 1e-6

# No length: divisions by smaller ones are meaningless.
TINY = 1e-300


class ContactSet:
    """The pairs of one contact on this rank.

    Args:
        mesh: what touches.
        law: of the energy.
        activation_distance: largest gap [m] at which pairs have energy.
        stiffness: K [N/m³], or None: derived from the closing speed of each pair.
        history: history variables, which a checkpoint may set at any time.
        system: with the step.
        friction: if there is any.

    Attributes:
        mesh, points, history, friction, system: the parts.
        pair_stiffness: stiffness of pairs that begin to touch.
        forces: of the active pairs.
        search: the candidate pairs.
        x0: points (m, 3) [m] at the start of the step.
        pairs: the active pairs of the step; None between steps, except in statics.
        has_given_stiffness: whether the stiffness is a number and not derived from closing speeds.
        closest: least gap [m] at the start of any step so far.
    """

    def __init__(
        self,
        mesh: CollisionMesh,
        law: ContactLaw,
        activation_distance: float,
        stiffness: float | None,
        history: ContactHistory,
        system: ContactAssembly,
        friction: Friction | None = None,
    ) -> None:
        """Make the stages of contact; the first `commit` finds the initial candidates.
        Collective."""
        library(system.comm)
        # History variables of points are kept by their owners: which points a rank knows changes.
        self._own, own_numbers = mesh.own_points()
        history.share(system.comm, own_numbers)
        self.mesh = mesh
        self.points = mesh.points
        self.history = history
        self.friction = friction
        self.law = law
        self.activation_distance = activation_distance
        self.system = system
        self._comm = system.comm
        self._is_static = system.rule.is_static
        self.search = CandidateSearch(mesh, activation_distance)
        self.has_given_stiffness = stiffness is not None
        self.pair_stiffness = PairStiffness(mesh, stiffness, activation_distance, system)
        self._activation = Activation()
        self.forces = StepForces(self.points, law, system, friction)
        self.pairs: ActivePairs | None = None
        self.closest = math.inf
        self._restored = history.restored
        self._turns = LargeTurns(mesh, activation_distance, system)
        self._start_time = 0.0  # of x0
        self._end_time = 0.0
        self._accepted_pairs: ActivePairs | None = None
        # Whether the pairs of the step are those of a tape, which are complete.
        self._is_recorded = False
        # Distances at both ends of the last step: its end is the start of the next one.
        self._known_distances: list[PairDistances] = []

    @property
    def candidates(self) -> CandidatePairs:
        """The candidate pairs of this rank."""
        return self.search.pairs

    # ---- states ----

    def set_initial_state(self) -> None:
        """Check the first state of a run, and choose the activation distances of its points.

        The activation distance of a point is the gap [m] below which its pairs have energy; it is
        at most nine tenths of the initial gap.  Collective.

        `x0` (m, 3) [m] are the points that this rank knows, at the start of the run.

        Raises:
            InputError: layers intersect or coincide, or a point of a body is inside a box.
        """
        system = self.system
        self._start_time = system.time
        self._search_at_rest()
        # Intersections first: gaps between layers that intersect mean nothing.
        refuse_intersections(self.mesh, self.x0, self._comm)
        refuse_points_inside(self.mesh, self.x0)
        gap = PairDistances.of(self.candidates, self.x0).gap
        nearest = nearest_gaps(self.candidates, gap, self.mesh)
        refuse_coincident(self.mesh, self.x0, nearest, self.activation_distance)
        self._keep_activation(initial_activation(self.activation_distance, nearest))
        self.history.has_begun = True

    def commit(self) -> None:
        """Take the accepted coordinates q0 as the start of the next step; update history variables.

        The first call finds the initial candidates.  Later ones note the stored energy [J], and
        which contact pairs have energy, with their stiffness [J].  Collective.

        `x0` (m, 3) [m] are set to the points that this rank knows, at q0. Between steps of a run
        `pairs` is then None.

        Raises:
            InputError: in the first call, if layers intersect or coincide, or a point is inside a
                box.
        """
        history = self.history
        is_step = self.pairs is not None
        time = self._end_time if is_step else self.system.time
        self.x0 = self.points.at(self.system.q0, time)
        self._start_time = time
        if not history.has_begun:
            self.set_initial_state()
        # A state that was restored since then has a separate history.
        if self.pairs is not None and history.restored == self._restored:
            parameters = self._known_parameters(self.pairs)
            self._energy, scaled = energy_of_pairs(self.pairs, self.x0, self.law, parameters)
            has_energy = scaled < 1
            identifier = self.pairs.identifier[has_energy]
            order = np.argsort(identifier)
            history.identifier = identifier[order]
            history.stiffness = self.pairs.stiffness[has_energy][order]
        self._accepted_pairs = self.pairs
        # In statics the residual of the accepted state is asked for, too: whether it is in
        # equilibrium.
        if not self._is_static:
            self.pairs = None

    def save_history(self) -> tuple[Array, Int64Array, Array, float]:
        history = self.history
        return (
            history.activation_distance,
            history.identifier,
            history.stiffness,
            history.reference_speed,
        )

    def load_history(self, saved: tuple[Array, Int64Array, Array, float]) -> None:
        history = self.history
        history.activation_distance, history.identifier, history.stiffness, speed = saved
        history.reference_speed = speed
        history.restored += 1

    def save_active_set(self) -> ActivePairs | None:
        """Return those contact pairs of the last accepted step that have energy at one of its ends.

        A tape, which records a run for its gradient, stores them.  The other pairs have neither
        force nor tangent.  The column `start` is left out: it follows from the points."""
        pairs = self._accepted_pairs
        # On several ranks a search changes which points a rank knows, and with them the rows of
        # pairs.
        if pairs is None or self._comm.size > 1:
            return None
        assert pairs.start is not None, "a step has the starts of its pairs"
        # Starts have squared distances with rounded edges; `x0` is the end of the accepted step.
        scaled_at_start = (pairs.start[:, 3] - pairs.offset) / pairs.width
        _, scaled_at_end = energy_of_pairs(pairs, self.x0, self.law)
        is_near = np.minimum(scaled_at_start, scaled_at_end) < 1 + SCALED_MARGIN
        return replace(pairs.rows(is_near), start=None)

    def load_active_set(self, pairs: ActivePairs | None) -> None:
        """Start a step from the accepted state, with contact pairs that were recorded; collective.

        Raises:
            Inadmissible: without pairs, if the motion of an obstacle jumps in the step.
        """
        if pairs is None:
            self.begin_step()
            return
        self._is_recorded = True
        self._end_time = self.system.time + self.system.h
        # The step was accepted: whatever separates fast in it does not count as passed.
        self.forces.push_back = 0.0
        self._activate(pairs)

    def activate_present(self) -> None:
        self.stored_energy()
        self._end_time = self.system.time
        self._activate(self.pairs_with_energy())

    def _activate(self, pairs: ActivePairs) -> None:
        """Let pairs without starts take part in a step from x0."""
        pairs = replace(pairs, start=pair_starts(pairs, self.x0, *closest_points(pairs, self.x0)))
        self.pairs = pairs
        self.forces.set_pairs(pairs, self.x0)

    def _known_parameters(self, pairs: ActivePairs) -> Array | None:
        """Return the parameters of contact pairs' closest points at the start x0 of the step, if
        known.

        Returns:
            (u, v) (n, 2) along the two sides of each pair; None: they are to be computed.
        """
        distances = self._distances_at(self.x0)
        if distances is None:
            return None
        # A search at the end of the step may have made other candidates than those of the pairs.
        if not np.array_equal(self.candidates.identifier[self._active], pairs.identifier):
            return None
        return distances.closest_points(self._active)[1]

    def _distances_at(self, x: Array) -> PairDistances | None:
        """Return the distances of the candidates, pairs that may touch, at some points, if known.

        Args:
            x: points (m, 3) [m].

        Returns:
            the distances; None: neither end of the last step is at these points.
        """
        for distances in self._known_distances:
            if distances.candidates is self.candidates and np.array_equal(distances.x, x):
                return distances
        return None

    def stored_energy(self) -> float:
        """Return the energy [J] of this rank's contact pairs in the accepted state; collective.

        After a checkpoint was restored, candidates are searched again, and the pairs of this rank
        are taken from those of all ranks.

        `x0` (m, 3) [m] are the points that this rank knows, in the accepted state. The sum over
        ranks is not taken; the energy is zero where no pair of this rank has any.
        """
        history = self.history
        if history.restored != self._restored:
            self._restored = history.restored
            self._start_time = self.system.time
            self._search_at_rest()
            # A checkpoint has the pairs of all ranks; those of this rank are among its candidates.
            own = np.isin(history.identifier, self.candidates.identifier)
            history.identifier = history.identifier[own]
            history.stiffness = history.stiffness[own]
            self._energy, _ = energy_of_pairs(self.pairs_with_energy(), self.x0, self.law)
        return self._energy if len(history.identifier) else 0.0

    def pairs_with_energy(self) -> ActivePairs:
        """Return this rank's pairs that have energy at q0; after `stored_energy`."""
        pairs = self._activated(np.isin(self.candidates.identifier, self.history.identifier))
        _, pairs.stiffness = self.history.stiffness_of(pairs.identifier)
        return pairs

    # ---- the active set of a step ----

    def begin_step(self) -> None:
        """Find the contact pairs that may touch in the step; collective.

        Candidates, all pairs that can come near in the next steps, are searched again if points
        have left the bounds of the last search.  Activation distances, the gaps [m] below which
        pairs have energy, grow as layers part.  The pairs that take part are those of the end that
        is predicted from the velocities.

        `x0` (m, 3) [m] are the points that this rank knows, `_v` (m, 3) [m/s] their velocities, at
        the start.

        Raises:
            Inadmissible: the motion of an obstacle jumps in the step, which is then tried in parts.
            InputError: the motion of an obstacle raises or returns other than three numbers.
            RuntimeError: more blocks of the tangent on this rank than 32 bits can number.
        """
        self._is_recorded = False
        self.forces.push_back = PUSH_BACK
        system = self.system
        self.stored_energy()
        self._end_time = system.time + system.h
        # An equilibrium has no motion in time.
        if not self._is_static:
            limit = MAX_DEVIATION * self.activation_distance
            self.points.refuse_jumps(system.time, system.h, limit)
        self._v = self.points.rates(system.v0, system.time, system.h)
        if not self.history.reference_speed:
            self.history.reference_speed = self.pair_stiffness.reference_speed(system.h)
        if not self._are_within_bounds(self._predicted_end()):
            # The present list is complete while all points are within their bounds.
            self._search(self._predicted_end)
        predicted = self._predicted_end()
        self.search.begin_step()
        self._start = self._distances_at(self.x0) or PairDistances.of(self.candidates, self.x0)
        self._grow_activation()
        # For the predicted end; `extend_active_set` corrects it after the solution.
        step = StepDistances(self._start, predicted, FAR * self.activation_distance)
        self._set_active(step.may_touch(self._activation_distances()))

    def set_static_load(self, force: float) -> None:
        """Take the norm [N] of all loads of an equilibrium, for which stiffness is derived."""
        of_owned = self.mesh.area[: self.points.body_count][self.mesh.shared.is_own]
        squares = self._comm.allreduce(float(of_owned @ of_owned))
        # A pressure p on nodes that stand for the areas A is the force p |A|.
        self.pair_stiffness.static_pressure = force / math.sqrt(squares)

    def _predicted_end(self) -> Array:
        """Return the points (m, 3) [m] at the end of a step without forces."""
        return np.ascontiguousarray(self.x0 + self.system.h * self._v)

    def _are_within_bounds(self, end: Array) -> bool:
        """Return whether the candidates are complete for a step from x0 to points (m, 3);
        collective."""
        search = self.search
        return search.holds(self.x0, self.system.time) and search.holds(end, self._end_time)

    def _search(self, end: Callable[[], Array]) -> None:
        """Find candidates, pairs that may touch in the next steps, for the present step;
        collective.

        The search may change which points this rank knows: whatever has a row for each point is
        asked for again.

        Sets `x0` (m, 3) [m] and `_v` (m, 3) [m/s], the points that this rank knows and their
        velocities at the start of the step, and the candidates.

        Args:
            end: returns the points (m, 3) [m] at the end of the step, as they are when it is
                called.
        """
        system = self.system

        def read() -> StepPoints:
            self.x0 = self.points.at(system.q0, self._start_time)
            self._v = self.points.rates(system.v0, self._start_time, system.h)
            return StepPoints(self.x0, self._v, end())

        self.search.find(read, system.time, system.h)
        self._take_points()

    def _search_at_rest(self) -> None:
        """Find candidate pairs about the points of the accepted state, as if they did not move.

        `x0` (m, 3) [m] has these points afterwards.  Collective.
        """

        def read() -> Array:
            self.x0 = self.points.at(self.system.q0, self._start_time)
            return self.x0

        self.search.find_at_rest(read, self._start_time)
        if self._comm.size > 1:
            # Rows of pairs and forces are those of points that this rank knew before.
            self.pairs = None
            self.forces.clear()
        self._take_points()

    def _take_points(self) -> None:
        """Read the activation distances [m] of the points that this rank knows since a search.

        On several ranks a search changes which points that are; owners hand out the values.
        Collective.
        """
        of_own = self.history.activation_distance
        # The only rank knows the same points as before.
        if self._comm.size == 1:
            self._activation_of_points = of_own
            return
        self._own, _ = self.mesh.own_points()
        if self.history.has_begun:
            of_points = np.empty(self.points.count)
            of_points[self._own] = of_own
            self.mesh.shared.spread(of_points[: self.points.body_count])
            self._activation_of_points = of_points

    def _keep_activation(self, of_points: Array) -> None:
        """Take new activation distances (m,) [m] of all points, which all ranks agree on."""
        self._activation_of_points = of_points
        self.history.activation_distance = of_points
        if self._comm.size > 1:
            self.history.activation_distance = of_points[self._own]

    def _grow_activation(self) -> None:
        """Let the activation distances of points grow with the gaps at the start of the step.

        They are the gaps [m] below which pairs have energy, at most that of the contact.
        `closest`, the least gap so far on all ranks, is updated.  Collective.
        """
        gap = self._start.gap
        near = np.where(gap < FAR * self.activation_distance, gap, np.inf)
        nearest = nearest_gaps(self.candidates, near, self.mesh)
        least = self._comm.allreduce(float(nearest.min(initial=np.inf)), op=MPI.MIN)
        self.closest = min(self.closest, least)
        present = self._activation_of_points
        grown = grown_activation(present, self.activation_distance, nearest)
        # Without growth the array stays the same object, for which pairs' distances are known.
        if not np.array_equal(grown, present):
            self._keep_activation(grown)

    def _activation_distances(self) -> Array:
        return self._activation.of(self.candidates, self._activation_of_points)

    def _activated(self, active: MaskArray) -> ActivePairs:
        """Return the candidates of a mask (n,) as active pairs without stiffness."""
        activation_distance = self._activation_distances()[active]
        return activate(self.candidates.rows(active), activation_distance, self.law)

    def _set_active(self, active: MaskArray) -> None:
        """Let some candidates, pairs that may touch in the next steps, take part in the step:
        choose their stiffness and the tangent's pattern.

        Collective.

        Sets `pairs`. `x0` (m, 3) [m] are the points that this rank knows, `_v` (m, 3) [m/s] their
        velocities, at the start of the step.

        Args:
            active: mask (n,) of the candidates.

        Raises:
            RuntimeError: more blocks of the tangent on this rank than 32 bits can number.
        """
        squared_distance, parameters = self._start.closest_points(active)
        pairs = self._activated(active)
        # The stiffness of pairs that have energy is constant: with another one energy would appear.
        has_energy, stiffness = self.history.stiffness_of(pairs.identifier)
        chosen = self.pair_stiffness.choose(
            self.candidates.rows(active),
            squared_distance,
            self.x0,
            self._v,
            self.history.reference_speed,
        )
        pairs.stiffness = np.where(has_energy, stiffness, chosen)
        if self._is_static:
            # In statics no energy has to be conserved, and the load may have grown.
            pairs.stiffness = np.maximum(stiffness, chosen)
        pairs.start = pair_starts(pairs, self.x0, squared_distance, parameters)
        self._active = active
        self.pairs = pairs
        self.forces.set_pairs(pairs, self.x0)

    def exchange_ends(self) -> None:
        """Reverse the step: the accepted state and time of the system are its new start; pairs
        stay.

        Gradients need the reversed step: its force is the same if pairs, stiffness and activation
        distances are.  Nothing changes between steps.  Friction differs, and is left out:
        `ContactGradient` has it.  Collective.

        `x0` (m, 3) [m] becomes the points at the accepted state, the former end.
        """
        pairs = self.pairs
        if pairs is None:
            return
        self.x0 = self.points.at(self.system.q0, self.system.time)
        self._start_time = self.system.time
        self._end_time = self.system.time + self.system.h
        self.pairs = self.forces.reverse(pairs, self.x0)

    def extend_active_set(self) -> bool:
        """Add contact pairs that are near at the end of a step, or were passed on the way.

        They were left out because the end was predicted only.  A step with recorded pairs is
        complete. Collective.

        `x0` and `x1` (m, 3) [m] are the points that this rank knows, at the start and at the end of
        the step. A step needs `begin_step` before.

        Raises:
            RuntimeError: more blocks of the tangent on this rank than 32 bits can number.
        """
        if self._is_recorded:
            return False
        x1 = self.end_points()
        if not self.search.holds(x1, self._end_time):
            identifier = self.candidates.identifier[self._active]
            self._search(self.end_points)
            x1 = self.end_points()
            self._start = PairDistances.of(self.candidates, self.x0)
            self._active = np.isin(self.candidates.identifier, identifier)
            if self._comm.size > 1:
                # The points of the pairs have other numbers now; forces are those of the last
                # residual.
                self._set_active(self._active)
                self.forces.compute(self.x0, x1)
        step = StepDistances(self._start, x1, FAR * self.activation_distance)
        self._solved = step
        self._known_distances = [step.start, step.end]
        activation_distance = self._activation_distances()
        missing = step.missing(activation_distance, self._active)
        if not self._comm.allreduce(bool(missing.any())):
            return False
        # Pairs are only added: taking some out could alternate without an end.
        self._set_active(self._active | missing | step.may_touch(activation_distance))
        return True

    def end_points(self) -> Array:
        """Return the points (m, 3) [m] at the end of the step, as iterated."""
        return self.points.at(self.system.q1, self._end_time)

    def find_penetration(self) -> str:
        """Report what passed through something else in the step, or all but did; collective.

        `x1` (m, 3) [m] are the points that this rank knows, at the end of the step.

        Returns:
            a clause that names two bodies and a point [m] near which they meet, or a body that
            turns too far; empty if the step is admissible.  The same on every rank.
        """
        x1 = self.end_points()
        # `_solved` has the gaps at both ends of the step as `extend_active_set` last saw it.  What
        # is added here is found below.
        if self._comm.allreduce(not np.array_equal(x1, self._solved.end.x)):
            self.extend_active_set()
        candidates = self.candidates
        behind_walls = is_wall(candidates.kind) & (self._solved.end.gap <= 0)
        passed = np.isin(candidates.identifier, self.forces.identifiers_of_passed(self.x0, x1))
        violations = self._solved.violations(self._activation_distances(), among=self._active)
        rows = [violations, np.flatnonzero(passed), np.flatnonzero(behind_walls)]
        wrong = np.concatenate(rows)
        message = ""
        if len(wrong):
            first = int(wrong[0])
            point = candidates.points[first, 0]
            one = self.mesh.name_of(point)
            other = self.mesh.name_of(candidates.second_point[first])
            x, y, z = x1[point]
            message = f"'{one}' would pass through '{other}' near ({x:.4g}, {y:.4g}, {z:.4g}) m"
        message = next(filter(None, self._comm.allgather(message)), "")
        # In an equilibrium nothing turns on a way.
        if message or self._is_static:
            return message
        return self._turns.find(self._start, x1)

    def limit_update(self, update: Array) -> None:
        """Shorten a Newton update in place, node by node, to a multiple of the gap where contact
        begins.

        The limit is `MAX_UPDATE` times the activation distance.  Longer updates put layers on the
        wrong side of others, and the iteration does not come back."""
        longest = MAX_UPDATE * self.activation_distance
        for body in self.mesh.bodies:
            owned = self.system.block(body).owned
            rows = update[owned].reshape(-1, body.block.size)
            way = np.linalg.norm(rows[:, :3], axis=1)
            # A whole node keeps the direction of its update.
            rows *= np.minimum(1.0, longest / np.maximum(way, TINY))[:, None]

    # ---- forces ----

    def add_forces(self, r: PETSc.Vec) -> None:
        """Add the forces [N] of the step to a residual; collective."""
        if self.pairs is None:
            return
        self.forces.compute(self.x0, self.end_points())
        self.points.add(self.forces.point_forces, r)

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the blocks on the diagonal of the tangent [N/m] to a matrix; `coupling` has the
        others.

        Collective.  Between steps it enters zeros, which reserve these blocks in the pattern."""
        if self.pairs is None:
            self.forces.reserve(A)
            return
        self.forces.add_tangents(A, self.x0, self.end_points())

    def coupling(self, diagonal: PETSc.Vec | None) -> PETSc.Mat | None:
        return None if self.pairs is None else self.forces.coupling(diagonal)

    # ---- energy balance of a step ----

    def supplied_work(self) -> float:
        """Return the work [J] of prescribed obstacles in the step, this rank's share."""
        prescribed = self.points.prescribed
        if self.pairs is None or not len(prescribed):
            return 0.0
        displacement = self.end_points()[prescribed] - self.x0[prescribed]
        return float(np.sum(self.forces.point_forces[prescribed] * displacement))

    def friction_loss(self) -> float:
        """Return the energy [J] that friction dissipates in the step, this rank's share."""
        if self.pairs is None or self.friction is None:
            return 0.0
        return self.friction.loss(self.x0, self.end_points())

    # ---- parameters ----

    @property
    def given_stiffness(self) -> float | None:
        """K [N/m³] of the contact; None if stiffness is derived from the closing speed."""
        return self.pair_stiffness.given

    def scale_stiffness(self, stiffness: float) -> None:
        """Give the contact another K [N/m³]; pairs that have energy follow."""
        assert self.pair_stiffness.given is not None, "only a given stiffness is changed"
        factor = stiffness / self.pair_stiffness.given
        self.pair_stiffness.given = stiffness
        self.history.stiffness = self.history.stiffness * factor
        # The energy at q0 is that of the new stiffness.
        self.history.restored += 1

    def masses_changed(self) -> None:
        self.pair_stiffness.masses_changed()
