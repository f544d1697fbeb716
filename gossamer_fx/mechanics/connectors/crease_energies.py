"""Energies of folds: rotational springs between the cells on both sides of edges.

The springs are arrays over points of the edges.  With ψ = ½ k (θ - θr)² at each point the force of
a step is m_mean G, with G the discrete gradient of `dihedral_angle` and m_mean the mean moment
along the path from θ0 to θ1, so that m_mean G·ΔX = ∫ m dθ.  A fold that yields holds |θ - θr| ≤ φ:
beyond it the rest angle θr follows at the constant moment k φ.  The dissipation of the step, k φ
|Δθr|, closes the energy balance exactly.

θ is continuous from step to step: a fold that is more than half a turn from flat, or pressed shut
at ±π, retains its sign and its number of turns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.algebra import dihedral_angle
from gossamer_fx.core.algebra.point_measures import Gather, add_blocks
from gossamer_fx.core.model.body import Array, Body, Indices, MeshBody
from gossamer_fx.core.model.terms import Parameter
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
    HistoryVariables,
    Shown,
)

Names = np.ndarray[Any, np.dtype[np.int64]]

# [rad] Distance from ±π below which a fold counts as pressed shut.  Positions do not show on which
# side of π such a fold is: its sign is that of the input.
SHUT = np.radians(1.0)

# [rad] Largest change of an angle in a step.  At half a turn the sense of the rotation is
# ambiguous; the margin of 5 % rejects a step before that.
FARTHEST = 0.95 * np.pi


class CreaseEnergies(HistoryVariables, Differentiable, Shown, CompiledTerms["CreaseEnergy"]):
    """All `CreaseEnergy` terms of a scene; those with as many nodes a point are one array.

    Methods without a text here are described in `terms.assembly`.
    """

    reversible = False

    def __init__(self, terms: Sequence[CreaseEnergy], system: Assembly) -> None:
        self._system = system
        self.terms = terms
        # Terms of meshes of different order have different numbers of nodes.
        groups: dict[int, list[int]] = {}
        for i, term in enumerate(terms):
            groups.setdefault(term.nodes.shape[1], []).append(i)
        self._arrays = [_Points(terms, of, system) for of in groups.values()]
        self._gather = Gather(system.numbering, [points.indices for points in self._arrays])
        self._yielding = [i for i, term in enumerate(terms) if np.isfinite(term.slip)]
        self.losses = [terms[i].name for i in self._yielding]
        # Stiffnesses and rest angles that were changed after the compilation, by the identity of
        # the term and the key.
        self._numbers: dict[tuple[int, str], float] = {}

    def commit(self) -> None:
        for points, q in zip(self._arrays, self._gather(self._system.q0), strict=True):
            points.keep(q)

    def add_forces(self, r: PETSc.Vec) -> None:
        for points, q in self._at_end():
            indices = points.indices.ravel()
            forces = points.forces(q).ravel()
            r.setValues(indices, forces, addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def add_tangents(self, A: PETSc.Mat) -> None:
        for points, q in self._at_end():
            blocks = points.tangents(q, self._system.geometric)
            add_blocks(A, points.indices, points.indices, blocks)

    def inadmissible(self) -> str:
        rotations = [points.largest_rotation(q) for points, q in self._at_end()]
        largest = max(rotations, default=(0.0, ""))
        angle, name = max(self._system.comm.allgather(largest))
        if angle < FARTHEST:
            return ""
        return f"'{name}' turns by {np.degrees(angle):.0f}° in one step: its sense is lost"

    def dissipated(self) -> Array:
        if not self._yielding:
            return np.zeros(0)
        found = np.zeros(len(self.terms))
        for points, q in self._at_end():
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
        points, i = self._find(term)
        here = points.owner == i
        return points.θ[here], points.rest[here]

    def cell_values(self, field: str, body: Body) -> tuple[Indices, Array] | None:
        mine = [term for term in self.terms if term.body is body]
        if field != "fold_angle" or not mine:
            return None
        cells = []
        values = []
        for term in mine:
            angles, _ = self.angles(term)
            # A point has a cell on the left and one on the right.
            cells.append(term.cells.ravel())
            values.append(np.repeat(angles, 2))
        return np.concatenate(cells), np.concatenate(values)

    # ---- sensitivities ---------------------------------------------------------------------------

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
        """Derivative of w·forces by a parameter of a term; this rank's share.  Collective.

        The forces are those of the present step, from the accepted state to q1.  The derivative by
        the rest angle differs from that of w·forces in two cases:

        - A fold slips in the step.  Its rest angle in later steps then follows from the angle at
          the end of this step, and not from the given one.  In a backward pass the caller has
          already counted the derivative by the rest angle in those steps (`by_rest`); it is added
          here, because the caller subtracts all that this function returns.
        - The yield angle has moved the rest angle of a point at the start of the run.  It does not
          depend on the given one, and the point counts as zero (`follows_input`).
        """
        points, i = self._find(term)
        k = self._arrays.index(points)
        q = self._gather(self._system.q1)[k]
        by_number = points.forces_by_number(q, key, float(self.get_number(term, "stiffness")[0]))
        work = np.sum(by_number * self._gather(w)[k], axis=1)
        if key == "rest":
            # The share is 1 for points that slip; `by_rest` is zero without a backward pass.
            work += points.by_rest * points.forgotten_share(q)
            work *= points.follows_input
        return np.array([work[points.owner == i].sum()])

    def energy_by_number(self, term: CreaseEnergy, key: str) -> Array:
        points, i = self._find(term)
        q = self._gather(self._system.q1)[self._arrays.index(points)]
        by_number = points.energy_by_number(q, key, float(self.get_number(term, "stiffness")[0]))
        if key == "rest":
            by_number = by_number * points.follows_input
        return np.array([by_number[points.owner == i].sum()])

    def start_adjoint(self) -> None:
        for points in self._arrays:
            points.by_rest = np.zeros(len(points.rest))

    def add_energy_by_history(self, share: float) -> None:
        for points in self._arrays:
            points.by_rest = points.by_rest - share * points.energy_slope()

    def add_end_derivatives(self, by_position: PETSc.Vec) -> None:
        if not self._yielding:
            return
        for points, q in self._at_end():
            by_unknowns = points.slip_products(q)
            by_position.setValues(
                points.indices.ravel(), by_unknowns.ravel(), addv=PETSc.InsertMode.ADD_VALUES
            )
        by_position.assemble()

    def add_initial_derivatives(self, by_position: PETSc.Vec) -> None:
        if not self._yielding:
            return
        for points, q in zip(self._arrays, self._gather(self._system.q0), strict=True):
            by_unknowns = points.initial_products(q)
            by_position.setValues(
                points.indices.ravel(), by_unknowns.ravel(), addv=PETSc.InsertMode.ADD_VALUES
            )
        by_position.assemble()

    def add_start_derivatives(
        self, μ: PETSc.Vec, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        if not self._yielding:
            return
        displacements = self._gather(μ)
        for (points, q), of_points in zip(self._at_end(), displacements, strict=True):
            work = np.sum(points.forces_by_number(q, "rest", 1.0) * of_points, axis=1)
            points.by_rest = points.by_rest * (1 - points.forgotten_share(q)) - work

    def gradient_notes(self) -> list[str]:
        return [
            f"yielding of '{self.terms[i].name}' is piecewise smooth: "
            "the gradient is that of the folds that slip in this run"
            for i in self._yielding
        ]

    def exchange_ends(self) -> None:
        for points, q in zip(self._arrays, self._gather(self._system.q0), strict=True):
            points.exchange_ends(q)

    def without_gradient(self) -> str:
        # In a run rest angles are history variables.
        if not self._system.rule.is_static:
            return ""
        for i in self._yielding:
            return (
                f"'{self.terms[i].name}' yields, so that its rest angle depends on the path; "
                "give it no yield_angle"
            )
        return ""

    def save_history(self) -> list[tuple[Array, Array]]:
        """Angles and rest angles (n,) [rad] of each array of points at the start of the step."""
        return [(points.θ.copy(), points.rest.copy()) for points in self._arrays]

    def load_history(self, saved: list[tuple[Array, Array]]) -> None:
        for points, (angles, rest) in zip(self._arrays, saved, strict=True):
            points.θ = angles.copy()
            points.rest = rest.copy()

    def _find(self, term: CreaseEnergy) -> tuple[_Points, int]:
        """The array that has the points of a term, and the index of the term in the scene."""
        i = next(k for k, known in enumerate(self.terms) if known is term)
        points = next(points for points in self._arrays if i in points.of)
        return points, i

    def _at_end(self) -> Iterator[tuple[_Points, Array]]:
        """Each array of points with its unknowns (n, D) at the end of the step.  Collective."""
        unknowns = self._gather(self._system.q1)
        return zip(self._arrays, unknowns, strict=True)

    # ---- history variables -----------------------------------------------------------------------

    def get_history(self) -> dict[str, Any]:
        """Fold angles that do not follow from positions and input: those of points that have
        slipped or turned by more than half a turn.  Collective."""
        unusual = []
        for points in self._arrays:
            unusual += points.unusual()
        of_all_ranks = []
        for rows in self._system.comm.allgather(unusual):
            of_all_ranks += rows
        # Sorted, so that the file is the same for any number of ranks.
        return {"points": sorted(of_all_ranks)}

    def shape_history(self) -> dict[str, Any]:
        return self.get_history()

    def set_history(self, state: dict[str, Any]) -> None:
        stored = {tuple(name): (turns, rest) for name, turns, rest in state["points"]}
        for points in self._arrays:
            points.recall(stored)


@dataclass(frozen=True, eq=False)
class CreaseEnergy:
    """Stored energy Σ ½ k (θ - θr)² over n points of folds, which may yield.

    Args:
        nodes: local nodes (n, k) of the body; a point is evaluated on one rank.
        cells: local cells (n, 2) on the left and on the right.
        maps: (n, 3, k); maps · positions of the nodes are three vectors: along the fold, into the
            left panel, and into the right one.
        stiffness: k (n,) [N m/rad] of the part of the fold that the point stands for.
        rest: θr [rad] at the start.
        slip: φ [rad], infinite for a fold that does not yield.
        shut: sign of the angle of a fold that starts pressed shut.
        names: numbers (n, 3) that identify the points on any number of ranks.
        moment_per_angle: k [N m/m/rad] per length, to which `stiffness` is proportional.
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
    moment_per_angle: float = 1.0
    parameters: tuple[Parameter, ...] = (
        Parameter("stiffness", "N m/m/rad", "stiffness"),
        Parameter("rest_angle", "rad", "rest"),
    )
    compiler: ClassVar[Compiler] = CreaseEnergies


class _Points:
    """The n points on this rank of all terms with k nodes a point, and their history variables.

    Attributes:
        of: indices of these terms in the scene.
        owner: (n,) index of the term of each point.
        indices: (n, D) global indices of its unknowns, D = 3k.
        θ, rest: (n,) [rad] angle and rest angle at the start of the step, the accepted state; `_X`
            (n, 3, 3) are the vectors of the folds in it.
    """

    def __init__(self, terms: Sequence[CreaseEnergy], of: list[int], system: Assembly) -> None:
        self.of = of
        self._rule = system.rule
        mine = [terms[i] for i in of]
        self._names = [term.name for term in mine]
        counts = [len(term.nodes) for term in mine]

        def of_points(numbers: list[float]) -> Array:
            """One number of each term as an array (n,) over the points."""
            return np.repeat(np.array(numbers, dtype=float), counts)

        self.owner = np.repeat(of, counts)
        self._maps = np.concatenate([term.maps for term in mine])
        self._k = np.concatenate([term.stiffness for term in mine])
        self._slip = of_points([term.slip for term in mine])
        self._shut = of_points([term.shut for term in mine])
        self._first_rest = of_points([term.rest for term in mine])
        self._point_names = np.concatenate([term.names for term in mine])
        self.indices = np.concatenate([_unknowns(system, term) for term in mine])
        self.rest = self._first_rest.copy()
        self._begun = False
        # Moments and their derivatives (n,) of a step whose ends are exchanged.
        self._exchanged: tuple[Array, Array] | None = None
        # Of a backward pass: derivative (n,) [1/rad, times the unit of the result] of the result by
        # the rest angles at the end of the present step, through later steps.
        self.by_rest: Array = np.zeros(len(self.rest))
        # Which rest angles (n,) are at first those of the input, and not set by the yield angle.
        self.follows_input = np.ones(len(self.rest), dtype=bool)
        # Fold angles (n,) [rad] of the initial state.
        self._first_angles: Array = np.zeros(len(self.rest))

    def vectors(self, q: Array) -> Array:
        """X (n, 3, 3), dimensionless, at positions q (n, D) [m] of the nodes of n points.

        The rows are vectors along the fold, into the left and into the right panel.
        """
        positions = q.reshape(len(q), q.shape[1] // 3, 3)
        return self._maps @ positions

    def keep(self, q: Array) -> None:
        """Update fold angles and rest angles from the positions q (n, D) [m] at the start of a
        step.

        They were those at the end of the last step, so rest angles slip here.  The first call takes
        the angles of the initial state, and moves rest angles that are beyond the yield angle.
        """
        # X (n, 3, 3): vectors along the fold and into both panels; θ and θ1 (n,) [rad]: fold angles
        # at the start and the end of the last step.
        X = self.vectors(q)
        self._exchanged = None
        if self._begun:
            θ1 = self._end(X)
            self.rest = self.rest + self._slipped(θ1)
            self.θ = θ1
        else:
            self.θ = self._principal(X)
            # A fold that starts beyond its yield angle slips at once, as if before the run.
            self.rest = np.clip(self.rest, self.θ - self._slip, self.θ + self._slip)
            self.follows_input = self.rest == self._first_rest
            self._first_angles = self.θ.copy()
            self._begun = True
        self._X = X

    def forces(self, q: Array) -> Array:
        """Forces (n, D) [N] of a step to the unknowns q (n, D)."""
        X = self._strained(self.vectors(q))
        θ1 = self._end(X)
        moment, _ = self._moment(θ1)
        return self._to_nodes(moment[:, None, None] * self._direction(X, θ1))

    def tangents(self, q: Array, geometric: float) -> Array:
        """Derivatives (n, D, D) [N/m] of the forces of a step by the positions at its end."""
        # X (n, 3, 3): vectors along the fold and into both panels, θ1 (n,) [rad]: angles, both of
        # the configuration whose angle the rule takes.  G (n, 9): discrete gradient of the angle by
        # X, dG: its derivative, K (n, 9, 9): derivative of the forces on the vectors.
        X = self._strained(self.vectors(q))
        n = len(X)
        θ1 = self._end(X)
        # In a reversed step both are those that `exchange_ends` has stored.
        moment, slope = self._exchanged or self._moment(θ1)
        G = self._direction(X, θ1).reshape(n, 9)
        gradient = dihedral_angle.gradient(X).reshape(n, 9)
        K = slope[:, None, None] * G[:, :, None] * gradient[:, None, :]
        if geometric:
            if self._rule.conserves:
                dG = dihedral_angle.discrete_gradient_derivative(self._X, X, self.θ, θ1)
            else:
                dG = dihedral_angle.gradient_derivative(X)
            K = K + (geometric * moment)[:, None, None] * dG.reshape(n, 9, 9)
        if not self._rule.conserves:
            # The derivative of X by the vectors at the end, see `_strained`.
            K = self._rule.alpha * K
        maps = self._maps
        D = 3 * maps.shape[2]
        K_vectors = K.reshape(n, 3, 3, 3, 3)
        blocks = np.einsum("nvk,nvcwd,nwl->nkcld", maps, K_vectors, maps, optimize=True)
        return blocks.reshape(n, D, D)

    def forces_by_number(self, q: Array, key: str, stiffness: float) -> Array:
        """Derivatives (n, D) of the forces of a step by the stiffness or by the rest angle at its
        start. `stiffness` is that of the term per length, to which forces are proportional."""
        X = self.vectors(q)
        θ1 = self._end(X)
        # While a fold slips, its moment does not depend on the rest angle.
        moment = -self._k * (1 - self._slipping_share(θ1))
        if key == "stiffness":
            moment = self._moment(θ1)[0] / stiffness
        return self._to_nodes(moment[:, None, None] * self._direction(X, θ1))

    def exchange_ends(self, q: Array) -> None:
        """Let a step start where it ended, for gradients of a run.

        A fold that slips has another moment on the way back.  Its moment, and the derivative by the
        angle at the start, ½ k (1 - s²) for the share s of the path on which it slips, are kept for
        the tangent.
        """
        X = self.vectors(q)
        θ1 = self._end(X)
        moment, _ = self._moment(θ1)
        by_start = self._k * (1 - self._slipping_share(θ1) ** 2) / 2
        self._exchanged = moment, by_start
        self._X = X
        self.θ = θ1

    def forgotten_share(self, q: Array) -> Array:
        """1 (n,) for points that slip in a step to the positions q (n, D) [m], else 0.

        The rest angle of a fold that slips follows the angle at the end: θr = θ1 ∓ φ.
        """
        return np.asarray(self._slipped(self._end(self.vectors(q))) != 0, dtype=float)

    def slip_products(self, q: Array) -> Array:
        """Derivative (n, D) of the later steps by the positions q (n, D) at the end of a step,
        through the rest angles of folds that slip in it."""
        weight = self.by_rest * self.forgotten_share(q)
        gradient = np.asarray(dihedral_angle.gradient(self.vectors(q)))
        return self._to_nodes(weight[:, None, None] * gradient)

    def initial_products(self, q: Array) -> Array:
        """Derivative (n, D) of the steps by the initial positions q (n, D), through the rest angles
        of folds that start beyond their yield angle; zero of folds that have moved since."""
        is_set = ~self.follows_input & (self.θ == self._first_angles)
        gradient = np.asarray(dihedral_angle.gradient(self.vectors(q)))
        return self._to_nodes((self.by_rest * is_set)[:, None, None] * gradient)

    def energy_slope(self) -> Array:
        """Derivative k (θ - θr) (n,) [N m/rad] of the stored energy at the start of a step by the
        angle; by the rest angle it has the opposite sign."""
        return self._k * (self.θ - self.rest)

    def energy_by_number(self, q: Array, key: str, stiffness: float) -> Array:
        """Derivatives (n,) of the stored energies ½ k (θ - θr)² [J] at the end of a step, with the
        rest angle at its start."""
        angle = self._end(self.vectors(q)) - self.rest
        if key == "stiffness":
            return self._k * angle**2 / (2 * stiffness)
        return -self._k * angle

    def set_number(self, i: int, key: str, before: float, now: float) -> None:
        """Change the stiffness [N m/m/rad] or the rest angle [rad] of term i from a value to
        another one."""
        here = self.owner == i
        if key == "stiffness":
            self._k = np.where(here, self._k * (now / before), self._k)
        else:
            self.rest = np.where(here, now, self.rest)
            self._first_rest = np.where(here, now, self._first_rest)

    def largest_rotation(self, q: Array) -> tuple[float, str]:
        """Largest change of a fold angle [rad] in a step on this rank, and its crease's name."""
        change = np.abs(self._end(self.vectors(q)) - self.θ)
        if len(change) == 0:
            return 0.0, ""
        i = int(change.argmax())
        name = self._names[self.of.index(self.owner[i])]
        return float(change[i]), name

    def loss(self, q: Array) -> Array:
        """Dissipation k φ |Δθr| (n,) [J] of the points in a step to the unknowns q (n, D)."""
        # A fold without a yield angle never slips; ∞ · 0 would be NaN.
        limit = np.where(np.isfinite(self._slip), self._slip, 0.0)
        θ1 = self._end(self.vectors(q))
        return self._k * limit * np.abs(self._slipped(θ1))

    def energies(self) -> Array:
        """Stored energy [J] of each term in `of`, at the start of the step."""
        ψ = self._k * (self.θ - self.rest) ** 2 / 2
        return np.array([ψ[self.owner == i].sum() for i in self.of])

    def unusual(self) -> list[tuple[list[int], int, float | None]]:
        """Points whose fold angle or rest angle does not follow from positions and input: the term
        and the numbers that name the point on any number of ranks, the number of full turns of its
        angle, and its rest angle [rad], or None where that is the one of the input."""
        full_turns = (self.θ - self._principal(self._X)) / (2 * np.pi)
        turns = np.rint(full_turns).astype(int)
        has_slipped = self.rest != self._first_rest
        found = []
        for i in np.flatnonzero(has_slipped | (turns != 0)):
            name = [int(self.owner[i]), *self._point_names[i].tolist()]
            rest = None
            if has_slipped[i]:
                rest = float(self.rest[i])
            found.append((name, int(turns[i]), rest))
        return found

    def recall(self, stored: dict[tuple[int, ...], tuple[int, float | None]]) -> None:
        """Set fold angles and rest angles from a checkpoint, once positions are those of the
        restored state: by the name of a point what `unusual` listed; all others get the values of
        the input."""
        self.θ = self._principal(self._X)
        self.rest = self._first_rest.copy()
        names: Any = self._point_names.tolist()
        for i, name in enumerate(names):
            turns, rest = stored.get((int(self.owner[i]), *name), (0, None))
            self.θ[i] += 2 * np.pi * turns
            if rest is not None:
                self.rest[i] = rest

    def _principal(self, X: Array) -> Array:
        """The angle (n,) [rad] of vectors X, in [-π, π]; that of a fold that is pressed shut gets
        the sign of the input, and may be a little beyond."""
        θ = dihedral_angle.angle(X)
        wrong = (np.pi - np.abs(θ) < SHUT) & (θ * self._shut < 0)
        return np.where(wrong, θ + 2 * np.pi * self._shut, θ)

    def _end(self, X: Array) -> Array:
        """Angle (n,) [rad] of X that is within half a turn of that at the start of the step."""
        change = dihedral_angle.angle(X) - self.θ
        return self.θ + np.remainder(change + np.pi, 2 * np.pi) - np.pi

    def _strained(self, X: Array) -> Array:
        """Vectors (n, 3, 3) of the folds whose angle gives the moment: X of the end of the step if
        the rule averages the moment over it; else those in the configuration in which forces act.
        """
        if self._rule.conserves:
            return X
        α = self._rule.alpha
        return (1 - α) * self._X + α * X

    def _direction(self, X: Array, θ1: Array) -> Array:
        """G (n, 3, 3), dimensionless: discrete gradient of the angle by the vectors X of
        `_strained`; with a stress rule that does not conserve, the gradient there."""
        if self._rule.conserves:
            return np.asarray(dihedral_angle.discrete_gradient(self._X, X, self.θ, θ1))
        return np.asarray(dihedral_angle.gradient(X))

    def _slipped(self, θ1: Array) -> Array:
        """Change (n,) [rad] of the rest angle in a step to the angle θ1 (n,) [rad]: by how much
        θ1 - rest is beyond the yield angle on either side, with its sign."""
        u = θ1 - self.rest
        return np.sign(u) * np.maximum(np.abs(u) - self._slip, 0.0)

    def _moment(self, θ1: Array) -> tuple[Array, Array]:
        """Mean moments (n,) [N m] of a step over the path of θ, and their derivatives (n,) [N
        m/rad] by the angle θ1 at the end.  A stress rule that does not conserve takes the moment at
        θ1."""
        slipped = self._slipped(θ1)
        elastic_start = self.θ - self.rest
        elastic_end = θ1 - self.rest - slipped
        if not self._rule.conserves:
            return self._k * elastic_end, self._k * (slipped == 0)
        # While the fold slips, the moment is that at the end; before, it grows linearly.
        share = self._slipping_share(θ1)
        mean = share * elastic_end + (1 - share) * (elastic_start + elastic_end) / 2
        return self._k * mean, self._k * (1 - share) ** 2 / 2

    def _slipping_share(self, θ1: Array) -> Array:
        """Share (n,) of the path of a step to the angles θ1 (n,) [rad] on which folds slip."""
        slipped = self._slipped(θ1)
        path = np.abs(θ1 - self.θ)
        divisor = np.where(path > 0, path, 1.0)
        # The bound of 1 is for round-off.
        share = np.minimum(np.abs(slipped) / divisor, 1.0)
        return np.where(slipped == 0, 0.0, share)

    def _to_nodes(self, F: Array) -> Array:
        """Forces (n, D) on the nodes of forces F (n, 3, 3) on the vectors X."""
        forces: Array = np.swapaxes(self._maps, 1, 2) @ F
        return forces.reshape(len(F), 3 * forces.shape[1])


def _unknowns(system: Assembly, term: CreaseEnergy) -> Any:
    """Global indices (n, D) of the positions of a term's nodes."""
    n, k = term.nodes.shape
    local_nodes = term.nodes.ravel().astype(np.int32)
    nodes = term.body.block.index_map.local_to_global(local_nodes)
    # The first three unknowns of a node are its position.
    positions = system.block(term.body).to_global(nodes)[:, :3]
    return positions.reshape(n, 3 * k)
