"""Energies of folds: rotational springs between the cells on both sides of edges, as arrays over points of the edges.

With ψ = ½ k (θ - θr)² at each point the force of a step is m̄ G, G the discrete gradient of
`dihedral_angle` and m̄ the mean moment along the path from θ0 to θ1, so that m̄ G·ΔX = ∫ m dθ.
A fold that yields holds |θ - θr| ≤ φ: beyond it the rest
angle θr slips along, at the constant moment k φ, and what the step dissipates, k φ |Δθr|, closes the balance exactly.

θ is continuous from step to step: a fold that is more than half a turn from flat, or pressed shut
at ±π, retains its sign and its number of turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from petsc4py import PETSc

from gossamer_fx.algebra import dihedral_angle
from gossamer_fx.algebra.point_measures import Gather, add_blocks
from gossamer_fx.model.body import Array, Body, Indices, MeshBody
from gossamer_fx.model.parameters import Parameter
from gossamer_fx.model.roles import (
    CellFields,
    Dissipation,
    Forces,
    GradientLimits,
    HistoryVariables,
    PointParameters,
    Reversible,
    StateObserver,
    StepCheck,
    StepHistory,
    StoredEnergies,
    Tangents,
)
from gossamer_fx.terms.assembly import Assembly, CompiledTerms, Compiler

Names = np.ndarray[Any, np.dtype[np.int64]]

SHUT = np.radians(1.0)  # from half a turn: there the positions do not tell the sign of a fold
FARTHEST = 0.95 * np.pi  # that a fold may turn in a step: at half a turn its sense is not known


class CreaseEnergies(
    StateObserver,
    Forces,
    Tangents,
    StepCheck,
    StoredEnergies,
    Dissipation,
    CellFields,
    HistoryVariables,
    PointParameters,
    GradientLimits,
    StepHistory,
    Reversible,
    CompiledTerms["CreaseEnergy"],
):
    """All `CreaseEnergy` terms of a scene; those with as many nodes a point are one array."""

    def __init__(self, terms: Sequence[CreaseEnergy], system: Assembly) -> None:
        self._system, self.terms = system, terms
        groups: dict[int, list[int]] = {}
        for i, term in enumerate(terms):
            groups.setdefault(term.nodes.shape[1], []).append(i)
        self._arrays = [_Points(terms, of, system) for of in groups.values()]
        self._gather = Gather(system.numbering, [points.indices for points in self._arrays])
        self._yielding = [i for i, term in enumerate(terms) if np.isfinite(term.slip)]
        self.losses = [terms[i].name for i in self._yielding]
        # Numbers of terms that were changed after the compilation, by the identity of the term.
        self._numbers: dict[tuple[int, str], float] = {}

    def commit(self) -> None:
        for points, q in zip(self._arrays, self._gather(self._system.q0), strict=True):
            points.keep(q)

    def add_forces(self, r: PETSc.Vec) -> None:
        for points, q in zip(self._arrays, self._gather(self._system.q1), strict=True):
            r.setValues(
                points.indices.ravel(), points.forces(q).ravel(), addv=PETSc.InsertMode.ADD_VALUES
            )
        r.assemble()

    def add_tangents(self, A: PETSc.Mat) -> None:
        for points, q in zip(self._arrays, self._gather(self._system.q1), strict=True):
            add_blocks(
                A, points.indices, points.indices, points.tangents(q, self._system.geometric)
            )

    def inadmissible(self) -> str:
        far = [
            points.turned(q)
            for points, q in zip(self._arrays, self._gather(self._system.q1), strict=True)
        ]
        worst, name = max(self._system.comm.allgather(max(far, default=(0.0, ""))))
        return (
            ""
            if worst < FARTHEST
            else f"'{name}' turns by {np.degrees(worst):.0f}° in one step: its sense is lost"
        )

    def dissipated(self) -> Array:
        if not self._yielding:
            return np.zeros(0)
        found = np.zeros(len(self.terms))
        for points, q in zip(self._arrays, self._gather(self._system.q1), strict=True):
            found += np.bincount(points.owner, points.loss(q), len(self.terms))
        return found[self._yielding]

    def energies(self) -> dict[str, float]:
        found = dict.fromkeys((term.name for term in self.terms), 0.0)
        for points in self._arrays:
            for i, energy in zip(points.of, points.energies(), strict=True):
                found[self.terms[i].name] += float(energy)
        return found

    def angles(self, term: CreaseEnergy) -> tuple[Array, Array]:
        """Angle and rest angle (n,) [rad] at q0 of this rank's points of a term."""
        i = next(k for k, known in enumerate(self.terms) if known is term)
        points = next(p for p in self._arrays if i in p.of)
        here = points.owner == i
        return points.θ[here], points.rest[here]

    def cell_values(self, field: str, body: Body) -> tuple[Indices, Array] | None:
        mine = [term for term in self.terms if term.body is body]
        if field != "fold_angle" or not mine:
            return None
        cells = np.concatenate([term.cells.ravel() for term in mine])
        return cells, np.concatenate([np.repeat(self.angles(term)[0], 2) for term in mine])

    # ---- sensitivities ---------------------------------------------------------------------------------

    def get_number(self, term: CreaseEnergy, key: str) -> Array:
        given = term.rest if key == "rest" else term.moment_per_angle
        return np.atleast_1d(self._numbers.get((id(term), key), given))

    def set_number(self, term: CreaseEnergy, key: str, value: Array) -> None:
        before = float(self.get_number(term, key)[0])
        now = float(value[0])
        points, i = self._find(term)
        points.set_number(i, key, before, now)
        self._numbers[id(term), key] = now

    def work_by_number(self, term: CreaseEnergy, key: str, w: PETSc.Vec) -> Array:
        points, i = self._find(term)
        k = self._arrays.index(points)
        q = self._gather(self._system.q1)[k]
        by_number = points.forces_by_number(q, key, float(self.get_number(term, "stiffness")[0]))
        work = np.sum(by_number * self._gather(w)[k], axis=1)
        return np.array([work[points.owner == i].sum()])

    def energy_by_number(self, term: CreaseEnergy, key: str) -> Array:
        points, i = self._find(term)
        q = self._gather(self._system.q1)[self._arrays.index(points)]
        by_number = points.energy_by_number(q, key, float(self.get_number(term, "stiffness")[0]))
        return np.array([by_number[points.owner == i].sum()])

    def without_gradient(self) -> str:
        for i in self._yielding:
            return f"'{self.terms[i].name}' yields, so that its rest angle depends on the path; give it no yield_angle"
        return ""

    def save_history(self) -> list[Array]:
        return [points.θ.copy() for points in self._arrays]

    def load_history(self, saved: list[Array]) -> None:
        for points, angles in zip(self._arrays, saved, strict=True):
            points.θ = angles.copy()

    def _find(self, term: CreaseEnergy) -> tuple[_Points, int]:
        """The array of points of a term, and the number of the term."""
        i = next(k for k, known in enumerate(self.terms) if known is term)
        return next(points for points in self._arrays if i in points.of), i

    def get_state(self) -> dict[str, Any]:
        """The points whose angle or rest angle is not what positions and input tell, by the names of their edges."""
        unusual = [row for points in self._arrays for row in points.unusual()]
        return {
            "points": sorted(row for rows in self._system.comm.allgather(unusual) for row in rows)
        }

    def set_state(self, state: dict[str, Any]) -> None:
        told = {tuple(place): (turns, rest) for place, turns, rest in state["points"]}
        for points in self._arrays:
            points.recall(told)


@dataclass(frozen=True, eq=False)
class CreaseEnergy:
    """Stored energy Σ ½ k (θ - θr)² over n points of folds, and what they dissipate where they yield.

    nodes (n, k)    local nodes of the body; a point is evaluated on one rank
    cells (n, 2)    local cells on the left and on the right
    maps (n, 3, k)  the vectors along the fold, into the left and into the right panel are maps · positions of the nodes
    stiffness (n,)  k [N m/rad] of the part of the fold that the point stands for
    rest            θr [rad] at the start
    slip            φ [rad], infinite for a fold that does not yield
    shut            sign of the angle of a fold that starts pressed shut
    names (n, 3)    numbers that tell the points apart on any number of ranks
    """

    name: str
    body: MeshBody
    nodes: Indices
    cells: Indices
    maps: Array
    stiffness: Array
    rest: float
    slip: float
    shut: int
    names: Names
    moment_per_angle: float = 1.0  # k [N m/m/rad], to which `stiffness` is proportional
    parameters: tuple[Parameter, ...] = (
        Parameter("stiffness", "N m/m/rad", "stiffness"),
        Parameter("rest_angle", "rad", "rest"),
    )
    compiler: ClassVar[Compiler] = CreaseEnergies


class _Points:
    """The points of some terms on this rank, and their state: θ and the rest angle at the start of the step."""

    def __init__(self, terms: Sequence[CreaseEnergy], of: list[int], system: Assembly) -> None:
        self.of, self._α = of, float(system.rule.alpha)
        self._names = [terms[i].name for i in of]
        counts = [len(terms[i].nodes) for i in of]
        self.owner = np.repeat(of, counts)
        self._maps = np.concatenate([terms[i].maps for i in of])
        self._k = np.concatenate([terms[i].stiffness for i in of])
        self._slip, self._shut, self._first_rest = (
            np.repeat(np.array([getattr(terms[i], what) for i in of], dtype=float), counts)
            for what in ("slip", "shut", "rest")
        )
        self._places = np.concatenate([terms[i].names for i in of])
        self.indices = np.concatenate([_unknowns(system, terms[i]) for i in of])
        self.rest = self._first_rest.copy()
        self._begun = False

    def vectors(self, q: Array) -> Array:
        """X (n, 3, 3)."""
        result: Array = self._maps @ q.reshape(len(q), q.shape[1] // 3, 3)
        return result

    def keep(self, q: Array) -> None:
        """Unknowns at the start of a step, which were those at the end of the last one."""
        X = self.vectors(q)
        if self._begun:
            θ1 = self._end(X)
            self.rest = self.rest + self._slipped(θ1)
            self.θ = θ1
        else:
            self.θ = self._principal(X)
            self.rest = np.clip(self.rest, self.θ - self._slip, self.θ + self._slip)
            self._begun = True
        self._X = X

    def forces(self, q: Array) -> Array:
        """(n, D)"""
        X = self.vectors(q)
        θ1 = self._end(X)
        return self._to_nodes((self._moment(θ1)[0])[:, None, None] * self._direction(X, θ1))

    def tangents(self, q: Array, geometric: float) -> Array:
        """(n, D, D); of the part that the moment has, `geometric` counts."""
        X = self.vectors(q)
        n, θ1 = len(X), self._end(X)
        m, slope = self._moment(θ1)
        G, g = self._direction(X, θ1).reshape(n, 9), dihedral_angle.gradient(X).reshape(n, 9)
        K = slope[:, None, None] * G[:, :, None] * g[:, None, :]
        if geometric:
            dG = (
                dihedral_angle.gradient_derivative(X)
                if self._α == 1.0
                else dihedral_angle.discrete_gradient_derivative(self._X, X, self.θ, θ1)
            )
            K = K + (geometric * m)[:, None, None] * dG.reshape(n, 9, 9)
        B = self._maps
        blocks = np.einsum("nvk,nvcwd,nwl->nkcld", B, K.reshape(n, 3, 3, 3, 3), B, optimize=True)
        return blocks.reshape(n, 3 * B.shape[2], 3 * B.shape[2])

    def forces_by_number(self, q: Array, key: str, stiffness: float) -> Array:
        """Derivatives (n, D) of the forces of folds that do not yield; their moment is k (θ_mean - θr)."""
        X = self.vectors(q)
        θ1 = self._end(X)
        moment = -self._k
        if key == "stiffness":
            moment = self._moment(θ1)[0] / stiffness
        return self._to_nodes(moment[:, None, None] * self._direction(X, θ1))

    def energy_by_number(self, q: Array, key: str, stiffness: float) -> Array:
        """Derivatives (n,) of ½ k (θ - θr)² at the end of the step."""
        angle = self._end(self.vectors(q)) - self.rest
        if key == "stiffness":
            energy: Array = self._k * angle**2 / (2 * stiffness)
            return energy
        return -self._k * angle

    def set_number(self, i: int, key: str, before: float, now: float) -> None:
        """Change the stiffness or the rest angle of term i."""
        here = self.owner == i
        if key == "stiffness":
            self._k = np.where(here, self._k * (now / before), self._k)
        else:
            self.rest = np.where(here, now, self.rest)
            self._first_rest = np.where(here, now, self._first_rest)

    def turned(self, q: Array) -> tuple[float, str]:
        """The largest change of angle in the step, and whose it is."""
        change = np.abs(self._end(self.vectors(q)) - self.θ)
        i = int(change.argmax()) if len(change) else -1
        return (
            (float(change[i]), self._names[self.of.index(self.owner[i])]) if i >= 0 else (0.0, "")
        )

    def loss(self, q: Array) -> Array:
        """What each point (n,) takes in the step."""
        limit = np.where(np.isfinite(self._slip), self._slip, 0.0)
        return self._k * limit * np.abs(self._slipped(self._end(self.vectors(q))))

    def energies(self) -> Array:
        """Of each term, at the start of the step."""
        ψ = self._k * (self.θ - self.rest) ** 2 / 2
        return np.array([ψ[self.owner == i].sum() for i in self.of])

    def unusual(self) -> list[tuple[list[int], int, float | None]]:
        turns = np.rint((self.θ - self._principal(self._X)) / (2 * np.pi)).astype(int)
        moved = self.rest != self._first_rest
        return [
            (
                [int(self.owner[i]), *self._places[i].tolist()],
                int(turns[i]),
                float(self.rest[i]) if moved[i] else None,
            )
            for i in np.flatnonzero(moved | (turns != 0))
        ]

    def recall(self, told: dict[tuple[int, ...], tuple[int, float | None]]) -> None:
        """Take the state from what was unusual, by place; the positions are set."""
        self.θ, self.rest = self._principal(self._X), self._first_rest.copy()
        places: Any = self._places.tolist()
        for i, place in enumerate(places):
            turns, rest = told.get((int(self.owner[i]), *place), (0, None))
            self.θ[i] += 2 * np.pi * turns
            if rest is not None:
                self.rest[i] = rest

    def _principal(self, X: Array) -> Array:
        """The angle in [-π, π]; near its ends with the sign of a fold that is pressed shut."""
        θ = dihedral_angle.angle(X)
        wrong = (np.pi - np.abs(θ) < SHUT) & (θ * self._shut < 0)
        return np.where(wrong, θ + 2 * np.pi * self._shut, θ)

    def _end(self, X: Array) -> Array:
        """The angle of X that is within half a turn of that at the start."""
        return self.θ + np.remainder(dihedral_angle.angle(X) - self.θ + np.pi, 2 * np.pi) - np.pi

    def _direction(self, X: Array, θ1: Array) -> Array:
        """G (n, 3, 3)."""
        if self._α == 1.0:
            return np.asarray(dihedral_angle.gradient(X))
        return np.asarray(dihedral_angle.discrete_gradient(self._X, X, self.θ, θ1))

    def _slipped(self, θ1: Array) -> Array:
        """By how much the rest angle moves."""
        u = θ1 - self.rest
        return np.sign(u) * np.maximum(np.abs(u) - self._slip, 0.0)

    def _moment(self, θ1: Array) -> tuple[Array, Array]:
        """Mean moment of the step, or with α = 1 that at its end, and its derivative with respect to θ1."""
        slipped = self._slipped(θ1)
        at_end = θ1 - self.rest - slipped  # the elastic part of the angle
        if self._α == 1.0:
            return self._k * at_end, self._k * (slipped == 0)
        Δ = np.abs(θ1 - self.θ)
        # of the path, the part on which the fold slips: there the moment is that at the end, before it grows linearly
        part = np.where(
            slipped == 0, 0.0, np.minimum(np.abs(slipped) / np.where(Δ > 0, Δ, 1.0), 1.0)
        )
        mean = part * at_end + (1 - part) * (self.θ - self.rest + at_end) / 2
        return self._k * mean, self._k * (1 - part) ** 2 / 2

    def _to_nodes(self, F: Array) -> Array:
        forces: Array = np.swapaxes(self._maps, 1, 2) @ F
        return forces.reshape(len(F), 3 * forces.shape[1])


def _unknowns(system: Assembly, term: CreaseEnergy) -> Any:
    """Global indices (n, D) of the positions of a term's nodes."""
    nodes = term.body.block.index_map.local_to_global(term.nodes.ravel().astype(np.int32))
    return (
        system.block(term.body)
        .to_global(nodes)[:, :3]
        .reshape(len(term.nodes), 3 * term.nodes.shape[1])
    )
