"""One contact at work: which pairs are near, how stiff they are, and whether a step may stand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.contact.assembly import BlockAssembly
from gossamer_fx.contact.broad_phase.candidates import Candidates
from gossamer_fx.contact.broad_phase.trajectory_bounds import RigidDrift, TrajectoryBounds
from gossamer_fx.contact.geometry.collision_mesh import WALLS, CollisionMesh
from gossamer_fx.contact.history import ContactHistory
from gossamer_fx.contact.kernels.library import Array, Bytes, library
from gossamer_fx.contact.narrow_phase.initial_check import refuse_coincident, refuse_intersections
from gossamer_fx.contact.potential import (
    IN_SPHERE,
    PASSED,
    PLANE,
    ContactPairs,
    act,
    energy,
    squared_distances,
    starts,
)
from gossamer_fx.contact.stiffness_warning import StiffnessWarning

START = (
    0.9  # distance of a point at which contact begins, over that of the nearest to it at the start
)
GROWN = 0.999  # the same in the course of the run
MARGIN = 0.3  # part of its way by which a point may miss the place where it was expected
FAR = 1.5  # distance from which a pair is none of a step, over that at which contact begins
HORIZON = 32  # steps for which one search may serve, at most
REACH = 4.0  # way of a node in one of Newton's updates, over d̂, at most


class ContactSet:
    """The pairs of one contact on this rank.

    `law` BARRIER or PENALTY; `distance` d̂ [m]; `stiffness` K [N/m³] or None: c = 4 σ v² by pairs, v the closing speed
    with a reserve of a quarter, and not below that at which a pair is compressed within a step.
    """

    def __init__(
        self,
        bodies: CollisionMesh,
        law: int,
        distance: float,
        stiffness: float | None,
        memory: ContactHistory,
        system: Any,
    ) -> None:
        self.bodies, self.points, self.memory = bodies, bodies.points, memory
        self.law, self._d, self._K, self._system = law, distance, stiffness, system
        self._comm: MPI.Intracomm = system.comm
        self._softness = StiffnessWarning(stiffness or 0.0, distance, bodies.names, system.comm)
        memory.comm = self._comm
        library(self._comm)
        self.blocks = BlockAssembly(self.points, system)
        self._alpha = system.rule.alpha
        self._horizon, self._age, self._t1 = 4, 0, 0.0
        self._density: Array | None = None
        self._seen = memory.restored
        self.near: ContactPairs | None = None
        self.searches = 0
        self.friction: Any = None  # a `Friction`, if there is any
        self.force: Array = np.zeros(
            (self.points.m, 3)
        )  # on points, of this rank's pairs, in the last step
        self.closest = math.inf  # least distance [m] at the start of a step so far
        self._known: list[tuple[Candidates, Array, Array]] = []  # gaps of candidates at points
        self._distances: tuple[Any, Any, Array] = (None, None, np.zeros(0))

    # ---- search -----------------------------------------------------------------------------------------------------

    def _find(self, x0: Array, v: Array | None = None, x1: Array | None = None) -> None:
        """Candidates for the way from x0 to x1, at velocities v, and some steps more, or about x0; collective."""
        if self._age:
            self._horizon = (
                min(2 * self._horizon, HORIZON) if self._age >= self._horizon else max(self._age, 1)
            )
        at, h, start = self.bodies.surface.vertices, self._system.h, self._system.time
        v, duration = (np.zeros_like(x0), 0.0) if v is None else (v, (self._horizon + 1e-6) * h)
        drift = RigidDrift.of(x0[at], v[at], start)
        rates, margin = v - drift.rates(x0), np.full(len(x0), np.inf)  # walls have no place
        margin[at] = self._d / 2 + MARGIN * duration * np.linalg.norm(rates[at], axis=1)
        if x1 is not None:
            missed = drift.undone(x1, self._t1) - (x0 + (self._t1 - start) * rates)
            margin += np.linalg.norm(missed, axis=1)
        self.found = Candidates.find(
            self.bodies, TrajectoryBounds(drift, x0, rates, margin, duration), self._d
        )
        self._age = 0
        self.searches += 1

    # ---- a step -----------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Take the initial state: distances of points; what cannot be right is refused."""
        system = self._system
        x = self.points.at(system.q0, system.time)
        refuse_intersections(self.bodies, x, self._comm)
        self._find(x)
        least = self.found.least(self.found.gaps(x), self._comm, self.points.m)
        refuse_coincident(self.bodies, x, least, self._d)
        self.memory.distance = np.minimum(self._d, START * least)
        self.x0 = x

    def keep(self) -> None:
        """q0 is the start of the next step."""
        system, memory = self._system, self.memory
        self.x0 = self.points.at(system.q0, system.time if self.near is None else self._t1)
        if not len(memory.distance):
            self.start()
        if self.near is not None and memory.restored == self._seen:
            self.energy, X = energy(self.near, self.x0, self.law)
            busy = X < 1
            order = np.argsort(self.near.names[busy])
            memory.names = self.near.names[busy][order]
            memory.stiffness = self.near.k[busy][order]
        self.near = None

    def energy_now(self) -> float:
        """Stored energy [J] of this rank's pairs at q0."""
        memory = self.memory
        if memory.restored != self._seen:
            self._seen = memory.restored
            self.x0 = self.points.at(self._system.q0, self._system.time)
            kind, nodes = self.bodies.numbers(memory.names)
            own = self._owned(kind, nodes)
            memory.names, memory.stiffness = memory.names[own], memory.stiffness[own]
            self._find(self.x0)
            pairs = self._select(np.isin(self.found.names, memory.names))
            self.energy = energy(pairs, self.x0, self.law)[0]
        return self.energy if len(memory.names) else 0.0

    def _owned(
        self, kind: npt.NDArray[np.uint8], nodes: npt.NDArray[np.int32]
    ) -> npt.NDArray[np.bool_]:
        return self.points.owned(nodes[:, 0])

    def touching(self) -> ContactPairs:
        """This rank's pairs that have energy in the accepted state; after `energy_now`."""
        return self._select(np.isin(self.found.names, self.memory.names))

    def search(self) -> None:
        """Find what may come near in the step."""
        system = self._system
        self.energy_now()
        t1 = system.time + system.h
        v = self.points.rates(system.v0, system.time, system.h)
        x1 = np.ascontiguousarray(self.x0 + system.h * v)
        if self._density is None:
            self._density = self.bodies.masses(system)
        if not self.memory.speed:
            self.memory.speed = 0.5 * self._d / system.h
        self._t1 = t1
        if not (self.found.course.holds(self.x0, system.time) and self.found.course.holds(x1, t1)):
            self._find(self.x0, v, x1)
        self._age += 1
        self._gap0 = self._gaps_at_start()
        least = self.found.least(
            np.where(self._gap0 < FAR * self._d, self._gap0, np.inf), self._comm, self.points.m
        )
        self.closest = min(self.closest, float(least.min(initial=np.inf)))
        grown = np.maximum(self.memory.distance, np.minimum(self._d, GROWN * least))
        if not np.array_equal(grown, self.memory.distance):
            self.memory.distance = grown
        self._take(self._selection(x1), v)

    def _gaps_at_start(self) -> Array:
        """Of all candidates at x0; of those that are far, less than that may be said."""
        for found, x, gaps in self._known:
            if found is self.found and np.array_equal(x, self.x0):
                return gaps
        return self.found.gaps(self.x0)

    def _gaps_at(self, x1: Array) -> tuple[Array, Array]:
        """The same at the end of a step, and by how much the pairs may come nearer until there."""
        way = self.found.approach(self.x0, x1)
        with np.errstate(invalid="ignore"):  # walls: their gaps less infinity
            gaps = self._gap0 - way
            near = np.flatnonzero(~(gaps - MARGIN * way > FAR * self._d))
        gaps[near] = self.found.gaps(x1, near)
        return gaps, way

    def _begins(self) -> Array:
        """Where contact of the candidates begins (n,) [m]."""
        if self._distances[0] is not self.found or self._distances[1] is not self.memory.distance:
            self._distances = (
                self.found,
                self.memory.distance,
                self.found.distance(self.memory.distance),
            )
        return self._distances[2]

    def _selection(self, x1: Array) -> npt.NDArray[np.bool_]:
        """Which candidates are near at x0, or may be at about x1."""
        d, (gap1, way) = self._begins(), self._gaps_at(x1)
        near = (self._gap0 < 1.05 * d) | (gap1 < FAR * d + MARGIN * np.abs(gap1 - self._gap0))
        near[self.found.refused(self.x0, x1, self._gap0, d, way, ~near)] = True
        return near

    def _select(self, near: npt.NDArray[np.bool_], v: Array | None = None) -> ContactPairs:
        """The pairs of some candidates; stiffness follows their closing speed unless they have energy."""
        pairs = self.found.pairs(near, self._begins(), self.law)
        known, k = self.memory.stiffness_of(pairs.names)
        if v is not None:
            k = np.where(known, k, self._stiffness(near, v))
        pairs.k = k
        return pairs

    def _stiffness(self, near: npt.NDArray[np.bool_], v: Array) -> Array:
        """k (n,) [J] of pairs at the beginning of contact."""
        found, area = self.found, self.found.area[near]
        assert self._density is not None
        sides = np.column_stack([found.nodes[near, 0], found.second[near]])
        σ = 2 / np.maximum((1 / self._density[sides]).sum(axis=1), 1e-300)
        rate = self._rate(near, v)
        if self._K is not None:
            self._softness.look(
                self.bodies.body[sides], self._density[sides].min(axis=1), np.maximum(-rate, 0)
            )
            return self._K * self._d**2 * area
        return 4 * σ * np.maximum(self.memory.speed, 1.25 * np.abs(rate)) ** 2 * area

    def _rate(self, near: npt.NDArray[np.bool_], v: Array) -> Array:
        """That of the distance (n,) [m/s] at the beginning of a step, taken over a short time."""
        τ = 1e-3 * self._system.h
        s0, s1 = (
            squared_distances(
                np.ascontiguousarray(self.found.nodes[near]), self.found.kind[near], x
            )
            for x in (self.x0, np.ascontiguousarray(self.x0 + τ * v))
        )
        kind, way = self.found.kind[near], np.sqrt(np.abs(s1)) - np.sqrt(np.abs(s0))
        rate: Array = np.select([kind == PLANE, kind >= IN_SPHERE], [s1 - s0, -way], way) / τ
        return rate

    def _take(self, near: npt.NDArray[np.bool_], v: Array) -> None:
        """Work with these candidates in the step."""
        self._v, self._mask = v, near
        self.near = pairs = self._select(near, v)
        # those between nodes of bodies alone, and those with points of obstacles
        simple: npt.NDArray[np.bool_] = np.asarray((pairs.nodes < self.points.n).all(axis=1))
        self._plain_pairs, self._mixed_pairs = pairs.some(simple), pairs.some(~simple)
        self._starts = starts(self._plain_pairs, self.x0)
        vectors, self._expansion = self.points.expanded(self._mixed_pairs.nodes)
        rubbing = [] if self.friction is None else self.friction.take(pairs, self.x0, self.law)
        self._slots, self._mixed_slots, *of_friction = self.blocks.lay_out(
            self._plain_pairs.nodes, vectors, *rubbing
        )
        if self.friction is not None:
            self.friction.place(of_friction)
        self._state: Bytes | None = None
        self._end = self.x0

    def limit(self, update: Array) -> None:
        """Let no node go farther in an iteration than some distances of contact; the update (n,) changes in place."""
        for index in self.bodies.indices:
            rows = update[self._system.numbering.owned(index)].reshape(
                -1, self._system.bodies[index].block.size
            )
            way = np.linalg.norm(rows[:, :3], axis=1)
            rows *= np.minimum(1.0, REACH * self._d / np.maximum(way, 1e-300))[:, None]

    def widen(self) -> bool:
        """After a step was solved: whether a pair that is near now or was on the way was left out, and is taken in."""
        x1 = self.points.at(self._system.q1, self._t1)
        if not self.found.course.holds(x1, self._t1):
            names = self.found.names[self._mask]
            self._find(self.x0, self._v, x1)
            self._gap0 = self.found.gaps(self.x0)
            self._mask = np.isin(self.found.names, names)
        gap1, self._way = self._gaps_at(x1)
        self._known = [(self.found, self.x0, self._gap0), (self.found, x1, gap1)]
        begins, left_out = self._begins(), ~self._mask
        missed = (gap1 < 1.02 * begins) & left_out
        missed[self.found.refused(self.x0, x1, self._gap0, begins, self._way, left_out)] = True
        if not self._comm.allreduce(bool(missed.any())):
            return False
        self._take(self._mask | missed | self._selection(x1), self._v)
        return True

    def inadmissible(self) -> str:
        """In words, what passed through something else in the step, or all but did; else nothing."""
        x1 = self.points.at(self._system.q1, self._t1)
        if self._comm.allreduce(not np.array_equal(x1, self._known[1][1])):
            self.widen()  # what it takes in is found below
        found, gap1 = self.found, self._known[1][2]
        behind_walls = np.flatnonzero((found.kind >= WALLS) & (gap1 <= 0))
        through = found.refused(self.x0, x1, self._gap0, self._begins(), self._way, self._mask)
        assert self.near is not None
        pushed = self.near.names[act(self.near, self.x0, x1, self.law, self._alpha).state == PASSED]
        wrong = np.concatenate(
            [through, np.flatnonzero(np.isin(found.names, pushed)), behind_walls]
        )
        words = ""
        if len(wrong):
            i = int(wrong[0])
            a, b = (
                self.bodies.names[self.bodies.body[p]] for p in (found.nodes[i, 0], found.second[i])
            )
            x, y, z = x1[found.nodes[i, 0]]
            words = f"'{a}' would pass through '{b}' near ({x:.4g}, {y:.4g}, {z:.4g}) m"
        return next(filter(None, self._comm.allgather(words)), "")

    # ---- forces -----------------------------------------------------------------------------------------------------

    def add_forces(self, r: PETSc.Vec) -> None:
        if self.near is None:
            return
        self.force = np.zeros((self.points.m, 3))
        self._end = x1 = self.points.at(self._system.q1, self._t1)
        states = [
            act(pairs, self.x0, x1, self.law, self._alpha, force=self.force, start=start).state
            for pairs, start in ((self._plain_pairs, self._starts), (self._mixed_pairs, None))
        ]
        self._state = states[0]
        if self.friction is not None:
            self.friction.add_forces(self.x0, x1, self.force)
        self.acting = sum(int((state > 0).sum()) for state in states)
        self.points.add(self.force, r)

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add what is on the diagonal; `coupling` has the rest."""
        if self.near is None:
            self.blocks.reserve(A)
            return
        x1, γ = self.points.at(self._system.q1, self._t1), self._system.geometric
        state = self._state if np.array_equal(x1, self._end) else None
        self.blocks.values[:] = 0
        act(
            self._plain_pairs, self.x0, x1, self.law, self._alpha, start=self._starts, state=state,
            slots=self._slots, values=self.blocks.values, geometric=γ,
        )  # fmt: skip
        if len(self._mixed_pairs):
            of_pairs = act(
                self._mixed_pairs,
                self.x0,
                x1,
                self.law,
                self._alpha,
                each=True,
                tangents=True,
                geometric=γ,
            )
            self._spread(of_pairs.tangents)
        if self.friction is not None:
            self.friction.add_tangents(self.x0, x1, self.blocks.values)
        self.blocks.add_diagonal(A)

    def coupling(self, diagonal: PETSc.Vec | None) -> PETSc.Mat | None:
        return None if self.near is None else self.blocks.coupling(diagonal)

    def _spread(self, tangents: Array | None) -> None:
        """Add tangents (n, 144) of pairs with points of obstacles to the blocks of the vectors behind them."""
        assert tangents is not None
        T, K = self._expansion, tangents.reshape(-1, 4, 3, 4, 3)
        blocks = np.einsum("npi,npaqb,nqj->nijab", T, K, T, optimize=True)
        np.add.at(
            self.blocks.values, self._mixed_slots, blocks.reshape(*self._mixed_slots.shape, 9)
        )

    def supplied(self) -> float:
        """Work [J] of prescribed obstacles in the step, on this rank."""
        if self.near is None or not len(self.points.prescribed):
            return 0.0
        at = self.points.prescribed
        x1 = self.points.at(self._system.q1, self._t1)
        return float(np.sum(self.force[at] * (x1[at] - self.x0[at])))

    def dissipated(self) -> float:
        """Loss [J] of the step by friction, on this rank."""
        if self.near is None or self.friction is None:
            return 0.0
        return self.friction.loss(self.x0, self.points.at(self._system.q1, self._t1))
