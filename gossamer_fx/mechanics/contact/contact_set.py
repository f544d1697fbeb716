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

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
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
    StepDistances,
)
from gossamer_fx.mechanics.contact.broad_phase.candidates import (
    CandidateSearch,
    StepPoints,
    nearest_gaps,
)
from gossamer_fx.mechanics.contact.contact_step import (
    PUSH_BACK,
    ContactLaw,
    activate,
    energy_of_pairs,
    pair_starts,
)
from gossamer_fx.mechanics.contact.contract import Array, ContactAssembly, Int64Array, MaskArray
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.geometry.contact_points import ContactPoints
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
    closest_points,
    is_boundary,
)
from gossamer_fx.mechanics.contact.step_forces import StepForces
from gossamer_fx.mechanics.terms.assembly import CouplingBlocks

if TYPE_CHECKING:
    # A scene without friction does not load it.
    from gossamer_fx.mechanics.contact.friction.friction import Friction

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


class ContactSet:
    """The pairs of one contact on this rank, and what a step does with them.

    Attributes:
        mesh, law, activation_distance, history, system: as given.
        pair_stiffness: stiffness of pairs that begin to touch.
        activation: gaps below which pairs have energy.
        search: the candidate pairs.
        forces: of the active pairs, with friction.
        pairs: the active pairs of the step; None between steps, except in statics.
        x0: points (m, 3) [m] at the start of the step.
    """

    x0: Array

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
        c_library(HEADER, system.comm)
        self.mesh = mesh
        self.law = law
        self.activation_distance = activation_distance
        self.history = history
        self.system = system
        self._is_static = system.rule.is_static
        self.search = CandidateSearch(mesh, activation_distance)
        self.pair_stiffness = PairStiffness(mesh, stiffness, activation_distance, system)
        self.activation = Activation(mesh, history, activation_distance)
        self.forces = StepForces(mesh.points, law, system, friction)
        self.pairs: ActivePairs | None = None
        self._closest = math.inf
        self._turns = LargeTurns(mesh, activation_distance, system)
        # Of the accepted state: its energy [J] and the pairs of the step that led to it, each with
        # `history.restored` of the time at which it was computed: another number means that it is
        # not that of the present history.
        self._energy = 0.0
        self._restored = history.restored
        self._accepted_pairs: ActivePairs | None = None
        self._pairs_restored = history.restored
        # Of the present step: its times [s], velocities (m, 3) [m/s], which candidates are active,
        # distances of all candidates at x0, and at both ends as last solved for.  `_start_time` is
        # that of x0: `system.time` is still the old one when terms commit, and an equilibrium sets
        # it back by one duration before each pseudo-step.
        self._start_time = 0.0
        self._end_time = 0.0
        self._v: Array = np.zeros((0, 3))
        self._active: MaskArray = np.zeros(0, dtype=bool)
        self._start: PairDistances | None = None
        self._solved: StepDistances | None = None
        # Whether the pairs of the step are those of a run tape, which are complete.
        self._is_recorded = False

    @property
    def points(self) -> ContactPoints:
        return self.mesh.points

    @property
    def friction(self) -> Friction | None:
        return self.forces.friction

    @property
    def candidates(self) -> CandidatePairs:
        """The candidate pairs of this rank."""
        return self.search.pairs

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
        self._search_at_rest()
        # Intersections first: gaps between layers that intersect mean nothing.
        refuse_intersections(self.mesh, self.x0, self.system.comm)
        refuse_points_inside(self.mesh, self.x0)
        gap = PairDistances.of(self.candidates, self.x0).gap
        nearest = nearest_gaps(self.candidates, gap, self.mesh)
        refuse_coincident(self.mesh, self.x0, nearest, self.activation_distance)
        self.activation.begin(nearest)

    def commit(self) -> None:
        """Take the accepted coordinates q0 as the start of the next step, and update the history.

        Raises:
            InputError: in the first call, if layers intersect or coincide, or a point is inside a
                box.
        """
        history = self.history
        pairs = self.pairs
        self._start_time = self.system.time if pairs is None else self._end_time
        self.x0 = self.points.at(self.system.q0, self._start_time)
        if not history.has_begun:
            self._start_time = self.system.time
            self._set_initial_state()
        # If a state was restored since the energy was computed, its history is not that of these
        # pairs.
        if pairs is not None and history.restored == self._restored:
            parameters = self._known_parameters(pairs)
            self._energy, scaled = energy_of_pairs(pairs, self.x0, self.law, parameters)
            has_energy = scaled < 1
            history.keep(pairs.identifier[has_energy], pairs.stiffness[has_energy])
        self._accepted_pairs = pairs
        self._pairs_restored = history.restored
        # In statics the residual of the accepted state is asked for, too: whether it is in
        # equilibrium.
        if not self._is_static:
            self.pairs = None

    def save_history(self) -> tuple[Array, Int64Array, Array, float]:
        """Return activation distances, identifiers, stiffness and reference speed of the history,
        arrays that are replaced and never changed."""
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
        """Return the pairs of the last accepted step that have energy at one of its ends. The
        others have neither force nor tangent.  The column `start` is left out: it follows from the
        points."""
        pairs = self._accepted_pairs
        # On several ranks a search changes which points a rank knows, and with them the rows of
        # pairs.
        if pairs is None or self.system.comm.size > 1:
            return None
        assert pairs.start is not None, "a step has the starts of its pairs"
        # Starts have squared distances with rounded edges; `x0` is the end of the accepted step.
        scaled_at_start = (pairs.start[:, 3] - pairs.offset) / pairs.width
        _, scaled_at_end = energy_of_pairs(pairs, self.x0, self.law)
        is_near = np.minimum(scaled_at_start, scaled_at_end) < 1 + SCALED_MARGIN
        return replace(pairs.rows(is_near), start=None)

    def load_active_set(self, pairs: ActivePairs | None) -> None:
        """Start a step from the accepted state, with pairs that were recorded, or searched."""
        if pairs is None:
            self.update_active_set()
            return
        self._is_recorded = True
        self._end_time = self.system.time + self.system.h
        # The step was accepted: whatever separates fast in it does not count as passed.
        self.forces.push_back = 0.0
        self._activate(pairs)

    def activate_present(self) -> None:
        # First of all: after a restore it searches candidates, of which the pairs are taken.
        self.stored_energy()
        self._end_time = self.system.time
        self._activate(self.pairs_with_energy())

    def _activate(self, pairs: ActivePairs) -> None:
        """Let pairs without starts take part in a step from x0."""
        pairs = replace(pairs, start=pair_starts(pairs, self.x0, *closest_points(pairs, self.x0)))
        self.pairs = pairs
        self.forces.set_pairs(pairs, self.x0)

    def _known_parameters(self, pairs: ActivePairs) -> Array | None:
        """Return (u, v) (n, 2) of pairs at x0; None: they are to be computed."""
        distances = self._distances_at(self.x0)
        if distances is None:
            return None
        # A search at the end of the step may have made other candidates than those of the pairs.
        if not np.array_equal(self.candidates.identifier[self._active], pairs.identifier):
            return None
        return distances.closest_points(self._active)[1]

    def _distances_at(self, x: Array) -> PairDistances | None:
        """Return the distances of the candidates at points x (m, 3), if x is an end of the last
        step that was solved; else None."""
        solved = self._solved
        if solved is None:
            return None
        # The end of a step is the start of the next one.
        for distances in (solved.start, solved.end):
            if distances.candidates is self.candidates and np.array_equal(distances.x, x):
                return distances
        return None

    def stored_energy(self) -> float:
        """Return the energy [J] of this rank's pairs in the accepted state; collective.

        The first call after a state was restored searches candidates again, and retains of the
        history, which a checkpoint has for all ranks, the pairs of this rank.
        """
        history = self.history
        if history.restored != self._restored:
            self._restored = history.restored
            self._start_time = self.system.time
            self._search_at_rest()
            history.keep_some(np.isin(history.identifier, self.candidates.identifier))
            pairs = self.pairs_with_energy()
            self._energy, _ = energy_of_pairs(pairs, self.x0, self.law)
            self.forces.take_state(pairs, self.x0)
        return self._energy if len(history.identifier) else 0.0

    def pairs_with_energy(self) -> ActivePairs:
        """Return this rank's pairs that have energy at q0; after `stored_energy`."""
        pairs = self._activated(np.isin(self.candidates.identifier, self.history.identifier))
        _, pairs.stiffness = self.history.stiffness_of(pairs.identifier)
        return pairs

    def pairs_of_last_step(self) -> ActivePairs | None:
        """Return this rank's pairs in the step that led to the accepted state; after
        `stored_energy`.  None if that is not known, as of a state that was restored, and in
        statics."""
        pairs = self._accepted_pairs
        if self._is_static or self._pairs_restored != self.history.restored:
            return None
        return pairs

    # ---- the active set of a step ----

    def update_active_set(self) -> None:
        """Find the pairs that may touch in the step.

        Those take part that are near at the end that is predicted from the velocities.

        Raises:
            Inadmissible: the motion of an obstacle jumps in the step, which is then tried in parts.
            InputError: the motion of an obstacle raises or returns other than three numbers.
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
        self._v = self._velocities()
        if not self.history.reference_speed:
            self.history.reference_speed = self.pair_stiffness.reference_speed(system.h)
        # The present list is complete while all points are within their bounds.
        is_complete = self.search.holds(self.x0, system.time) and self.search.holds(
            self._predicted_end(), self._end_time
        )
        if not is_complete:
            self._search(self._predicted_end)
        predicted = self._predicted_end()
        self.search.begin_step()
        self._start = self._distances_at(self.x0) or PairDistances.of(self.candidates, self.x0)
        self._grow_activation(self._start.gap)
        # For the predicted end; `extend_active_set` corrects it after the solution.
        step = StepDistances(self._start, predicted, FAR * self.activation_distance)
        if self._is_static:
            self._refuse_long_way(step)
        self._set_active(step.may_touch(self.activation.of(self.candidates)), self._start)

    def _velocities(self) -> Array:
        """Return the velocities (m, 3) [m/s] that predict the end of the step.  In an equilibrium
        only obstacles move, from where they were in the accepted state."""
        system = self.system
        if self._is_static:
            moved = self.points.at(system.q0, self._end_time) - self.x0
            return np.asarray(moved / system.h)
        return self.points.rates(system.v0, self._start_time, system.h)

    def _refuse_long_way(self, step: StepDistances) -> None:
        """Refuse a pseudo-step of an equilibrium in which obstacles pass through bodies as these
        are: Newton's iteration would start on the wrong side.

        Raises:
            Inadmissible: the way is longer than that which is always allowed.
        """
        start = step.start
        prescribed = self.points.prescribed
        ways = np.linalg.norm(step.end.x[prescribed] - start.x[prescribed], axis=1)
        if ways.max(initial=0.0) <= MIN_STATIC_WAY * self.activation_distance:
            return
        candidates = start.candidates
        activation_distance = self.activation.of(candidates)
        kept = KEPT_GAP * np.minimum(start.gap, activation_distance)
        is_behind = is_boundary(candidates.kind) & (step.end.gap < kept)
        everything = np.ones(len(candidates), dtype=bool)
        passed = step.violations(activation_distance, among=everything)
        if self.system.comm.allreduce(bool(is_behind.any() or len(passed))):
            raise Inadmissible(
                f"an obstacle moves by {ways.max():.3g} m, through bodies that it has to move"
            )

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

    def _predicted_end(self) -> Array:
        """Return the points (m, 3) [m] at the end of a step without forces."""
        return np.ascontiguousarray(self.x0 + self.system.h * self._v)

    def _search(self, end: Callable[[], Array]) -> None:
        """Find candidates for the present step, of which `end` returns the points (m, 3) [m]. The
        search may change which points this rank knows: whatever has a row for each point is asked
        for again."""
        system = self.system

        def read() -> StepPoints:
            self.x0 = self.points.at(system.q0, self._start_time)
            self._v = self._velocities()
            return StepPoints(self.x0, self._v, end())

        # The tables of the last search are freed before the next one makes its own.
        self._start = None
        self._solved = None
        self.activation.forget_pairs()
        self.search.find(read, system.time, system.h)
        self.activation.update_points()

    def _search_at_rest(self) -> None:
        """Find candidates about the points of the accepted state, as if they did not move."""

        def read() -> Array:
            self.x0 = self.points.at(self.system.q0, self._start_time)
            return self.x0

        self.search.find_at_rest(read, self._start_time)
        if self.system.comm.size > 1:
            # Rows of pairs and forces are those of points that this rank knew before.
            self.pairs = None
            self.forces.clear()
        self.activation.update_points()

    def _grow_activation(self, gap: Array) -> None:
        """Let activation distances grow with the gaps (n,) [m] at the start of the step;
        collective."""
        near = np.where(gap < FAR * self.activation_distance, gap, np.inf)
        nearest = nearest_gaps(self.candidates, near, self.mesh)
        self._closest = min(self._closest, float(nearest.min(initial=np.inf)))
        self.activation.grow(nearest)

    def _activated(self, active: MaskArray) -> ActivePairs:
        """Return the candidates of a mask (n,) as active pairs without stiffness."""
        activation_distance = self.activation.of(self.candidates)[active]
        return activate(self.candidates.rows(active), activation_distance, self.law)

    def _set_active(self, active: MaskArray, start: PairDistances) -> None:
        """Let candidates (mask (n,)) take part in the step, with their distances at its start:
        choose their stiffness and the tangent's pattern."""
        squared_distance, parameters = start.closest_points(active)
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
            pairs.stiffness = np.maximum(pairs.stiffness, chosen)
        pairs.start = pair_starts(pairs, self.x0, squared_distance, parameters)
        self._active = active
        self.pairs = pairs
        self.forces.set_pairs(pairs, self.x0)

    def exchange_ends(self) -> None:
        """Reverse the step: the accepted state and time of the system are its new start. Gradients
        need the reversed step: its force is the same if pairs, stiffness and activation distances
        are.  Friction differs, and is left out: `ContactGradient` has it."""
        pairs = self.pairs
        if pairs is None:
            return
        self.x0 = self.points.at(self.system.q0, self.system.time)
        self._start_time = self.system.time
        self._end_time = self.system.time + self.system.h
        self.pairs = self.forces.reverse(pairs, self.x0)

    def extend_active_set(self) -> bool:
        """Add pairs that are near at the end of a step, or were passed on the way; return whether
        there were any on any rank.  They were left out because the end was only predicted.  A step
        with recorded pairs is complete."""
        if self._is_recorded:
            return False
        x1 = self.end_points()
        assert self._start is not None, "a step begins with `update_active_set`"
        if not self.search.holds(x1, self._end_time):
            identifier = self.candidates.identifier[self._active]
            self._search(self.end_points)
            x1 = self.end_points()
            self._start = PairDistances.of(self.candidates, self.x0)
            self._active = np.isin(self.candidates.identifier, identifier)
            if self.system.comm.size > 1:
                # The points of the pairs have other numbers now; forces are those of the last
                # residual.
                self._set_active(self._active, self._start)
                self.forces.compute(self.x0, x1)
        step = StepDistances(self._start, x1, FAR * self.activation_distance)
        self._solved = step
        activation_distance = self.activation.of(self.candidates)
        missing = step.missing(activation_distance, self._active)
        if not self.system.comm.allreduce(bool(missing.any())):
            return False
        # Pairs are only added: taking some out could alternate without an end.
        may_touch = step.may_touch(activation_distance)
        self._set_active(self._active | missing | may_touch, self._start)
        return True

    def end_points(self) -> Array:
        """Return the points (m, 3) [m] at the end of the step, as iterated."""
        return self.mesh.points.at(self.system.q1, self._end_time)

    def inadmissible(self) -> str:
        """Report what passed through something else in the step, or all but did: a clause that
        names two bodies and a point [m] near which they meet, or a body that turns too far; empty
        if the step is admissible.  The same on every rank."""
        comm = self.system.comm
        x1 = self.end_points()
        # `_solved` has the gaps at both ends of the step as `extend_active_set` last saw it.  What
        # is added here is found below.
        if comm.allreduce(self._solved is None or not np.array_equal(x1, self._solved.end.x)):
            self.extend_active_set()
        solved = self._solved
        assert solved is not None and self._start is not None
        candidates = self.candidates
        behind_boundaries = is_boundary(candidates.kind) & (solved.end.gap <= 0)
        passed = np.isin(candidates.identifier, self.forces.identifiers_of_passed(self.x0, x1))
        violations = solved.violations(self.activation.of(candidates), among=self._active)
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
        # In an equilibrium nothing turns on a way.
        if message or self._is_static:
            return message
        return self._turns.find(self._start, x1)

    def limit_update(self, update: Array) -> None:
        """Shorten a Newton update in place, node by node, to `MAX_UPDATE` activation distances."""
        longest = MAX_UPDATE * self.activation_distance
        for body in self.mesh.bodies:
            owned = self.system.block(body).owned
            rows = update[owned].reshape(-1, body.block.size)
            x, y, z = rows[:, :3].T
            way = np.sqrt(x * x + z * z + y * y)
            # A whole node keeps the direction of its update.
            if way.max(initial=0.0) > longest:
                rows *= np.minimum(1.0, longest / np.maximum(way, TINY))[:, None]

    # ---- forces ----

    def add_forces(self, r: PETSc.Vec) -> None:
        if self.pairs is not None:
            self.forces.compute(self.x0, self.end_points())
            self.mesh.points.add(self.forces.point_forces, r)

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the blocks on the diagonal of the tangent [N/m]; `coupling_matrices` has the others.
        Between steps zeros reserve these blocks in the pattern."""
        if self.pairs is None:
            self.forces.assembly.reserve_diagonal(A)
            return
        self.forces.add_tangents(A, self.x0, self.end_points())

    def coupling_matrices(self, diagonal: PETSc.Vec | None) -> list[PETSc.Mat]:
        coupling = None if self.pairs is None else self.forces.assembly.coupling(diagonal)
        return [] if coupling is None else [coupling]

    def coupling_blocks(self) -> CouplingBlocks | None:
        return None if self.pairs is None else self.forces.assembly.coupling_blocks()

    # ---- energy balance of a step ----

    def supplied(self) -> float:
        """Return the work [J] of prescribed obstacles in the step, this rank's share."""
        prescribed = self.points.prescribed
        if self.pairs is None or not len(prescribed):
            return 0.0
        displacement = self.end_points()[prescribed] - self.x0[prescribed]
        return float(np.sum(self.forces.point_forces[prescribed] * displacement))

    def dissipated(self) -> Array:
        """Return the energy [J] that friction dissipates in the step, this rank's share."""
        friction = self.friction
        if friction is None:
            return np.zeros(0)
        if self.pairs is None:
            return np.zeros(1)
        return np.array([friction.loss(self.x0, self.end_points())])
