"""The active set: which candidates take part in a step, from which gap on they have energy, and how
stiff they are; the history variables that a step takes over from those before, and that a
checkpoint holds.

Stiffness is given, or enough to stop pairs that begin to touch, or to carry the loads of an
equilibrium.  A pair whose sides close at a speed v has to take up their kinetic energy within the
activation distance.  A given stiffness that is too small for that is warned of once.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.named_rows import NamedRows
from gossamer_fx.mechanics.contact.contact_step import ContactLaw
from gossamer_fx.mechanics.contact.contract import (
    Array,
    Int32Array,
    Int64Array,
    MaskArray,
)
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.narrow_phase.ccd import find_violations
from gossamer_fx.mechanics.contact.pairs import (
    ActivePairs,
    CandidatePairs,
    PairDistances,
    approach_bounds,
    closest_points,
    is_boundary,
    stencils_of,
)
from gossamer_fx.mechanics.terms.assembly import Assembly, HistoryVariables

LOG = logging.getLogger("gossamer_fx")


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
    """

    activation_distance: Array = field(default_factory=_no_numbers)
    has_begun: bool = False
    identifier: Int64Array = field(default_factory=_no_identifiers)
    stiffness: Array = field(default_factory=_no_numbers)
    reference_speed: float = 0.0
    restored: int = 0
    _own_points: Int64Array = field(default_factory=_no_identifiers)

    def share(self, own_points: Int64Array) -> None:
        """Let this rank store the activation distances [m] of some points only; together the ranks
        have all.  `own_points`: numbers (p,) of these points among those of all ranks."""
        self._own_points = own_points

    def get_history(self) -> dict[str, Any]:
        # Arrays of the history are replaced, and never written to.
        points = self._own_points if self.has_begun else _no_identifiers()
        return {
            "has begun": self.has_begun,
            "activation distance": NamedRows(points, self.activation_distance[:, None]),
            "stiffness": NamedRows(self.identifier, self.stiffness[:, None]),
            "reference speed": self.reference_speed,
        }

    def shape_history(self) -> dict[str, Any]:
        # The reference speed is that of the first step of a run.
        return self.get_history() | {"reference speed": 0.0}

    def set_history(self, state: dict[str, Any]) -> None:
        self.has_begun = state["has begun"]
        self.activation_distance = _no_numbers()
        if self.has_begun:
            distances = state["activation distance"].of(self._own_points)
            self.activation_distance = distances[:, 0]
        self.identifier = state["stiffness"].names
        self.stiffness = state["stiffness"].values[:, 0]
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
        history.share(own_numbers)
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


@dataclass(frozen=True, eq=False)
class Selection:
    """Which candidates take part in a step.

    Attributes:
        start: distances of all n candidates at the start of the step.
        v: velocities (m, 3) [m/s] of the points, from which its end was predicted.
        active: mask (n,) of those that take part.
        solved: distances at both ends of the step as it was last solved; None before that.
    """

    start: PairDistances
    v: Array
    active: MaskArray
    solved: StepDistances | None = None

    def distances_at(self, candidates: CandidatePairs, x: Array) -> PairDistances | None:
        """Return the distances of candidates at points x (m, 3), if x is an end of the step as it
        was solved; else None."""
        if self.solved is None:
            return None
        for distances in (self.solved.start, self.solved.end):
            if distances.candidates is candidates and np.array_equal(distances.x, x):
                return distances
        return None


def activate(
    candidates: CandidatePairs, activation_distance: Array, stiffness: Array, law: ContactLaw
) -> ActivePairs:
    """Return n candidates as active pairs of a stiffness k (n,) [J], with the width and offset that
    let their energy reach up to the activation distance (n,) [m]."""
    width = np.empty(len(candidates))
    offset = np.empty(len(candidates))
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
        stiffness=stiffness,
        width=width,
        offset=offset,
    )


# A pair with the area density σ and the closing speed v is stopped within the activation distance d
# if its stiffness K d² per area is this multiple of σ v²; the derived stiffness is just that.
STOPPING_FACTOR = 4


class StiffnessWarning:
    """Warns if K d² < 4 σ v²: layers then come so near each other that no step is short enough.

    Args:
        names: of bodies and obstacles.

    Attributes:
        was_given: whether the warning was given.
    """

    def __init__(
        self, activation_distance: float, names: Sequence[str], comm: MPI.Intracomm
    ) -> None:
        self._activation_distance = activation_distance
        self._names = names
        self._comm = comm
        self.was_given = False

    def check(self, stiffness: float, bodies: Int32Array, density: Array, speed: Array) -> None:
        """Warn once, in the log, if the given stiffness [N/m³] cannot stop a contact pair;
        collective.  Of all ranks' pairs the one is named that needs most.

        `bodies`: numbers (n, 2) of both sides; `density`: area density of the lighter one (n,)
        [kg/m²]; `speed`: closing speed (n,) [m/s].
        """
        if self.was_given:
            return
        needed = STOPPING_FACTOR * density * speed**2
        present = stiffness * self._activation_distance**2
        largest = 0.0
        message = ""
        if len(needed) and needed.max() > present:
            row = int(needed.argmax())
            largest = float(needed[row])
            one, other = (self._names[number] for number in bodies[row])
            message = (
                f"Contact: a stiffness of {stiffness:.3g} N/m³ is too soft to stop '{one}' "
                f"and '{other}', which close at {speed[row]:.3g} m/s; "
                f"give {largest / self._activation_distance**2:.2g} N/m³ at least, or leave it out."
            )
        _, message = max(self._comm.allgather((largest, message)))
        self.was_given = bool(message)
        if message and self._comm.rank == 0:
            LOG.warning(message)


# Closing speed over that at the start of the step: a pair may be faster when it meets.
SPEED_RESERVE = 1.25

# The reference speed crosses this part of the activation distance in the first step: a pair that
# hardly moves is not so soft that a step compresses it altogether.
REFERENCE_WAY = 0.5

# Part of a step over which the closing speed is a difference quotient.
SHORT_TIME = 1e-3

# Pressure of pairs that are closed by the whole activation distance, over that of the loads of an
# equilibrium, of which a small area may have to carry much.
STATIC_FACTOR = 10.0

# Mean energy of pairs over their stiffness from which an equilibrium stiffens them: they are closed
# to about 0.3 of the activation distance, two surfaces with a barrier to 0.56.
CLOSED_ENERGY = 0.25

# By how much they are stiffened at once, and in all: bodies between rigid boundaries stay closed,
# however stiff contact is.
STIFFENING = 10.0
MAX_STIFFENING = 1e6

# No density: divisions by smaller ones are meaningless.
TINY = 1e-300


class PairStiffness:
    """Chooses k [J] of pairs that begin to touch.

    Attributes:
        given: K [N/m³], or None.
        static_pressure: pressure [N/m²] of the loads and the prestress of an equilibrium; zero in
            dynamics.
    """

    def __init__(
        self,
        mesh: CollisionMesh,
        stiffness: float | None,
        activation_distance: float,
        system: Assembly,
    ) -> None:
        self._mesh = mesh
        self.given = stiffness
        self._activation_distance = activation_distance
        self._system = system
        self._warning = StiffnessWarning(activation_distance, mesh.names, system.comm)
        self._density: Array | None = None
        self.static_pressure = 0.0
        self._stiffening = 1.0  # of an equilibrium, see `stiffen`

    def reference_speed(self, step: float) -> float:
        """Return the least closing speed [m/s] for which stiffness is derived; `step` is the length
        of the first step [s]."""
        return REFERENCE_WAY * self._activation_distance / step

    def choose(
        self,
        pairs: CandidatePairs,
        squared_distance: Array,
        x0: Array,
        v: Array,
        reference_speed: float,
    ) -> Array:
        """Return the stiffness k (n,) [J] of contact pairs that begin to touch; collective.

        It is the given one, warned of once if it cannot stop the pairs; else in an equilibrium that
        which carries the static pressure; else that which stops the closing speed.  All are
        proportional to the area for which a pair stands.  In a cell of order 2 one point, of the
        many between its nodes, has to stop the mass of a node: its area counts as often as there
        are points to a node.  Without that the ball of `contact/geometry/test_curved_cells.py`
        takes a tenth more iterations, and fails where a cell has 144 pieces.
        `squared_distance`: of the closest points at x0 (n,); `reference_speed`: closing speed [m/s]
        that is assumed at least.
        """
        sides = np.column_stack([pairs.points[:, 0], pairs.second_point])
        bodies = self._mesh.body[sides]
        density = self.densities()[bodies]
        rate = self._rate_of_distance(pairs, squared_distance, x0, v)
        if self.given is not None:
            # In an equilibrium there is nothing to stop.
            if not self._system.rule.is_static:
                self._warning.check(
                    self.given,
                    bodies=bodies,
                    density=density.min(axis=1),
                    speed=np.maximum(-rate, 0),
                )
            return self.given * self._activation_distance**2 * pairs.area
        if self.static_pressure:
            pressure = STATIC_FACTOR * self._stiffening * self.static_pressure
            return pressure * self._activation_distance * pairs.area
        # The density that acts between two free sides, twice the harmonic sum; that of one side,
        # doubled, against an obstacle.
        both_sides = 2 / np.maximum((1 / density).sum(axis=1), TINY)
        speed = np.maximum(reference_speed, SPEED_RESERVE * np.abs(rate))
        stopped_area = self._mesh.points_per_node[bodies].max(axis=1) * pairs.area
        return self._stiffening * STOPPING_FACTOR * both_sides * speed**2 * stopped_area

    def set_static_load(self, force: float, tensions: Mapping[str, float]) -> None:
        """Derive the pressure that contact may have to carry in an equilibrium from the norm of all
        loads [N], and from tensions by the names of bodies: of films [N/m], of lines [N].
        Collective.

        A pressure p on nodes that stand for the areas A is the force p |A|.  A tension T presses
        on an obstacle of the radius R by T/R.  Edges of the length l keep off it if l²/8 R < d, so
        that T d/l² is about the largest pressure that a mesh can have.
        """
        mesh = self._mesh
        comm = self._system.comm
        is_own = mesh.shared.is_own
        body = mesh.known.points.body[is_own]
        area = mesh.known.points.area[is_own]
        radius = mesh.radius[: len(is_own)][is_own]
        # Loads are those of nodes.
        squares = comm.allreduce(float(area @ (mesh.points_per_node[body] * area)))
        pressure = force / math.sqrt(squares)
        for k in range(len(mesh.bodies)):
            tension = tensions.get(mesh.names[k], 0.0)
            if tension <= 0:
                continue
            of_body = area[body == k]
            own_sums = np.array([of_body.sum(), radius[body == k].sum(), float(len(of_body))])
            total, radii, count = comm.allreduce(own_sums)
            squared_length = total / count
            if mesh.bodies[k].space.mesh.topology.dim == 1:
                # The area of a node is that of a strip as wide as the line.
                width = 2 * radii / count
                squared_length = (squared_length / width) ** 2
                tension = tension / width
            pressure = max(pressure, tension * self._activation_distance / squared_length)
        self.static_pressure = pressure

    def stiffen(self, mean_energy: float) -> bool:
        """Stiffen pairs of an equilibrium if their mean energy over their stiffness [-] says that
        they are nearly closed; return whether they were stiffened."""
        if mean_energy < CLOSED_ENERGY or self._stiffening >= MAX_STIFFENING:
            return False
        self._stiffening *= STIFFENING
        return True

    def densities(self) -> Array:
        """Return the area density (k,) [kg/m²] of bodies and obstacles, computed once."""
        if self._density is None:
            self._density = self._mesh.body_densities(self._system)
        return self._density

    def rescale(self, stiffness: float) -> float:
        """Give the contact another K [N/m³]; return it over the one before."""
        assert self.given is not None, "only a given stiffness is changed"
        factor = stiffness / self.given
        self.given = stiffness
        return factor

    def masses_changed(self) -> None:
        """Forget the densities; they are computed again when they are needed."""
        self._density = None

    def _rate_of_distance(
        self, pairs: CandidatePairs, squared_distance: Array, x0: Array, v: Array
    ) -> Array:
        """Return by how much the distances of contact pairs grow (n,) [m/s]; negative where they
        close. It is a difference quotient over a thousandth of the step."""
        duration = SHORT_TIME * self._system.h
        later, _ = closest_points(pairs, np.ascontiguousarray(x0 + duration * v))
        rate = np.empty(len(pairs))
        for stencil, rows in stencils_of(pairs.kind):
            change = stencil.distance(later[rows]) - stencil.distance(squared_distance[rows])
            rate[rows] = change / duration
        return rate
