"""Energies of folds: rotational springs between the cells on both sides of edges.

Folds are rows (`terms.rows`) whose measure is the angle θ at points of the edges.  It is no
quadratic function of the positions: the force of a step is m_mean G, with G the discrete gradient
of `dihedral_angle`, so that m_mean G·ΔX is the work of the mean moment m_mean along the path from
θ0 to θ1.  With ψ = ½ k (θ - θr)², a fold that yields holds |θ - θr| ≤ φ: beyond it the rest angle
θr follows at the constant moment k φ.  The loss of the step, k φ |Δθr|, closes the energy balance
exactly.

θ is continuous from step to step: a fold that is more than half a turn from flat, or pressed shut
at ±π, retains its sign and its number of turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, cast

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.algebra import dihedral_angle
from gossamer_fx.core.algebra.named_rows import NamedRows
from gossamer_fx.core.algebra.numbering import Numbering
from gossamer_fx.core.algebra.point_measures import Measure, PointMeasures, Ports
from gossamer_fx.core.algebra.rank_exchange import hash_rows
from gossamer_fx.core.model.body import Array, Body, Indices, MeshBody
from gossamer_fx.core.model.terms import Parameter
from gossamer_fx.mechanics.terms.assembly import (
    Compiler,
    HistoryVariables,
    Shown,
)
from gossamer_fx.mechanics.terms.rows import (
    Response,
    RowGroup,
    RowsOf,
    RowTerms,
    Stencil,
    one_sided_average,
    positive_part,
)

Names = np.ndarray[Any, np.dtype[np.int64]]

# [rad] Distance from ±π below which a fold counts as pressed shut.  Positions do not show on which
# side of π such a fold is: its sign is that of the input.
SHUT = np.radians(1.0)

# [rad] Largest change of an angle in a step.  At half a turn the sense of the rotation is
# ambiguous; the margin of 5 % rejects a step before that.
FARTHEST = 0.95 * np.pi

PARAMETERS = (
    Parameter("stiffness", "N m/m/rad", "stiffness"),
    Parameter("rest_angle", "rad", "rest"),
)


# ---- laws ----------------------------------------------------------------------------------------


def elastic_fold(e0: Any, e1: Any, z0: Any, h: Any, numbers: Any) -> Response:
    """ψ = ½ k (θ - θr)², k [N m/rad] of the length that a point stands for."""
    k = numbers.stiffness * numbers.length
    u0 = e0[0] - numbers.rest
    u1 = e1[0] - numbers.rest
    return Response([k * (u0 + u1) / 2], energy=k * u1 * u1 / 2)


def yielding_fold(e0: Any, e1: Any, z0: Any, h: Any, numbers: Any) -> Response:
    """The same with a rest angle z0 that follows where |θ - θr| would exceed φ."""
    k = numbers.stiffness * numbers.length
    φ = numbers.yield_angle
    u0 = e0[0] - z0[0]
    u1 = e1[0] - z0[0]
    # The moment k u within ±k φ, averaged exactly
    mean = one_sided_average(u0 + φ, u1 + φ) - one_sided_average(u0 - φ, u1 - φ) - φ
    forth = positive_part(u1 - φ)
    back = positive_part(-u1 - φ)
    slipped = forth - back
    return Response(
        [k * mean],
        energy=k * (u1 - slipped) ** 2 / 2,
        loss=k * φ * (forth + back),
        history=[z0[0] + slipped],
    )


# ---- the measure ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class FoldMeasure(Measure):
    """Fold angles θ [rad] at n points of edges that this rank owns.

    Args:
        body: with the edges.
        nodes: local nodes (n, k) of the body; a point is evaluated on one rank.
        cells: local cells (n, 2) on the left and on the right.
        maps: (n, 3, k); maps · positions of the nodes are three vectors: along the fold, into the
            left panel, and into the right one.
        shut: sign of the angle of a fold that starts pressed shut.
        names: numbers (n, 3) that identify the points on any number of ranks.
    """

    body: MeshBody
    nodes: Indices
    cells: Indices
    maps: Array
    shut: int
    names: Names
    ports: Sequence[Ports] = ()

    @property
    def kind(self) -> int:
        """Meshes of different order have different numbers of nodes at a point."""
        return self.nodes.shape[1]

    @property
    def count(self) -> int:
        return len(self.nodes)

    @property
    def here(self) -> list[int]:
        return list(range(self.count))

    @staticmethod
    def arrays(
        numbering: Numbering, bodies: list[Body], measures: Sequence[FoldMeasure]
    ) -> FoldMeasures:
        return FoldMeasures(numbering, bodies, measures)


class FoldMeasures(PointMeasures):
    """Fold angles as arrays, functions of the vectors X = P q (n, 9) of n points: rows of (3, 3)
    along the fold, into the left and into the right panel.

    Attributes:
        shut: (n,) see `FoldMeasure`.
        names: (n, 3).
    """

    def __init__(
        self, numbering: Numbering, bodies: list[Body], measures: Sequence[FoldMeasure]
    ) -> None:
        counts = [measure.count for measure in measures]
        self.m = 1
        self.owner = np.repeat(np.arange(len(measures)), counts)
        self.shut = np.repeat([measure.shut for measure in measures], counts)
        self.names = np.concatenate([measure.names for measure in measures])
        indices: list[Any] = []
        maps = []
        for measure in measures:
            nodes = measure.nodes.ravel().astype(np.int32)
            of_body = measure.body.block.index_map.local_to_global(nodes)
            unknowns = numbering.to_global(bodies.index(measure.body), of_body)
            # The first three unknowns of a node are its position.
            width = 3 * measure.nodes.shape[1]
            indices.append(unknowns[:, :3].reshape(measure.count, width))
            maps.append(np.einsum("nvk,cd->nvckd", measure.maps, np.eye(3)))
        self.indices = np.concatenate(indices)
        self.n, self.D = self.indices.shape
        self._P = np.concatenate(maps).reshape(self.n, 9, self.D)
        self._z = np.zeros((self.n, self.D))
        self.share_unknowns = False
        self.is_linear = False
        self.each_is_linear = np.zeros(self.n, dtype=bool)

    def slope(self, Y: Array, on: Any = slice(None)) -> Array:
        """∂θ/∂X (n, 1, 9)."""
        gradient = np.asarray(dihedral_angle.gradient(folds(Y)))
        return gradient.reshape(len(Y), 1, 9)

    def principal(self, Y: Array) -> Array:
        """The angles (n,) [rad] of vectors Y (n, 9), in [-π, π]; that of a fold that is pressed
        shut has the sign of the input, and may be a little beyond."""
        θ = dihedral_angle.angle(folds(Y))
        wrong = (np.pi - np.abs(θ) < SHUT) & (θ * self.shut < 0)
        return np.where(wrong, θ + 2 * np.pi * self.shut, θ)


def folds(Y: Array) -> Array:
    """Vectors (n, 9) as arrays (n, 3, 3) with the three vectors of a fold as rows."""
    return Y.reshape(-1, 3, 3)


@dataclass
class FoldsAtEnd:
    """Folds at the end of a step, as iterated.

    Attributes:
        Y: vectors (n, 9).
        angles: (n, 1) [rad].
        gradient: discrete gradients (n, 1, 9) of the step; None until they are asked for.
    """

    Y: Array
    angles: Array
    gradient: Array | None = None


class FoldStencil(Stencil):
    """Folds with one law; `geometric` is the share of the geometric stiffness in their tangent."""

    at: FoldMeasures
    geometric = 1.0
    # A rest angle depends on the path, also on that to rest.
    advances_in_search = True

    def __init__(self, *arguments: Any) -> None:
        # Forces and tangent of one iterate need the same.
        self._at_end: FoldsAtEnd | None = None
        super().__init__(*arguments)

    def _start(self, Y0: Array, e0: Array) -> None:
        self._at_end = None
        super()._start(Y0, e0)

    def measured(self, Y: Array) -> Array:
        if not self._has_begun:
            return self.at.principal(Y)[:, None]
        return self._folds_at_end(Y).angles

    def _folds_at_end(self, Y: Array) -> FoldsAtEnd:
        """The folds of vectors Y (n, 9) at the end of the step."""
        if self._at_end is None or self._at_end.Y is not Y:
            # The angle within half a turn of that at the start of the step: a function of the
            # positions and of full turns, so that a state is restored to the last bit.
            shown = dihedral_angle.angle(folds(Y))[:, None]
            turns = np.rint((self.e0 - shown) / (2 * np.pi))
            self._at_end = FoldsAtEnd(Y, shown + 2 * np.pi * turns)
        return self._at_end

    def measured_at(self, q: Array) -> Array:
        return self.measured(self.at.vectors(q))

    def _slope_of_step(self, Y: Array, on: Any) -> Array:
        if not self._rule.conserves:
            return super()._slope_of_step(Y, on)
        at_end = self._folds_at_end(Y)
        if at_end.gradient is None:
            ends = self._ends(Y, slice(None))
            at_end.gradient = dihedral_angle.discrete_gradient(*ends).reshape(-1, 1, 9)
        return at_end.gradient[on]

    def _geometric(self, S: Array, Y: Array, on: Any) -> Array:
        if not self.geometric:
            return np.zeros((1, 1, 1))
        if self._rule.conserves:
            slopes = dihedral_angle.discrete_gradient_derivative(*self._ends(Y, on))
        else:
            middle = folds(self._middle(Y, on))
            slopes = self._rule.alpha * dihedral_angle.gradient_derivative(middle)
        stiffness: Array = (self.geometric * S[on])[:, :, None] * slopes.reshape(-1, 9, 9)
        return stiffness

    def _ends(self, Y: Array, on: Any) -> tuple[Array, Array, Array, Array]:
        """Folds (r, 3, 3) and their angles (r,) [rad] at both ends of a step to the vectors Y
        (n, 9)."""
        return folds(self._Y0[on]), folds(Y[on]), self.e0[on, 0], self.measured(Y)[on, 0]

    def turns(self) -> Array:
        """Full turns (n,) by which the angles at the start of the step differ from those that the
        positions show."""
        whole = (self.e0[:, 0] - self.at.principal(self._Y0)) / (2 * np.pi)
        found: Array = np.rint(whole)
        return found

    def recall(self, turns: Array, state: Array) -> None:
        """Set the angles from full turns (n,), and the state (n, z)."""
        angles = self.at.principal(self._Y0) + 2 * np.pi * turns
        self.state[:] = state
        self._start(self._Y0, angles[:, None])


# ---- in a scene ----------------------------------------------------------------------------------


class CreaseEnergies(HistoryVariables, Shown, RowTerms):
    """All `CreaseEnergy` terms of a scene.

    Methods without a text here are described in `terms.assembly`.
    """

    has_shape_derivative = False
    stencil_type = FoldStencil

    def has(self, term: object) -> bool:
        return any(known is term for known in self._terms)

    def add_tangents(self, A: PETSc.Mat) -> None:
        for _, stencil in self._points():
            stencil.geometric = self._system.geometric
        super().add_tangents(A)

    def _points(self) -> list[tuple[RowGroup, FoldStencil]]:
        """Groups of terms with one law, and their points."""
        return [(group, cast(FoldStencil, group.stencil)) for group in self._groups]

    def inadmissible(self) -> str:
        largest = (0.0, "")
        for group, q in self._at_end():
            stencil = group.stencil
            change = np.abs(stencil.measured_at(q) - stencil.e0)[:, 0]
            if len(change):
                i = int(change.argmax())
                largest = max(largest, (float(change[i]), group.terms[stencil.at.owner[i]].name))
        angle, name = max(self._system.comm.allgather(largest))
        if angle < FARTHEST:
            return ""
        return f"'{name}' turns by {np.degrees(angle):.0f}° in one step: its sense is lost"

    def angles(self, term: CreaseEnergy) -> tuple[Array, Array]:
        """Angle and rest angle (n,) [rad] at q0 of this rank's points of a term."""
        group, rows = self._find(term)
        angles = group.stencil.e0[rows, 0]
        if term.variables:
            return angles, group.stencil.state[rows, 0]
        return angles, np.full(len(angles), self.get_number(term, "rest")[0])

    def cell_values(self, field: str, body: Body) -> tuple[Indices, Array] | None:
        mine: list[Any] = [term for term in self._terms if term.measure.body is body]
        if field != "fold_angle" or not mine:
            return None
        # A point has a cell on the left and one on the right.
        cells = [term.measure.cells.ravel() for term in mine]
        values = [np.repeat(self.angles(term)[0], 2) for term in mine]
        return np.concatenate(cells), np.concatenate(values)

    def gradient_notes(self) -> list[str]:
        return [
            f"yielding of '{name}' is piecewise smooth: "
            "the gradient is that of the folds that slip in this run"
            for name in self.losses
        ]

    def without_gradient(self) -> str:
        # In a run rest angles are history variables.
        if not (self._system.rule.is_static and self.losses):
            return ""
        return (
            f"'{self.losses[0]}' yields, so that its rest angle depends on the path; "
            "give it no yield_angle"
        )

    # ---- history variables -----------------------------------------------------------------------

    def get_history(self) -> dict[str, Any]:
        """Fold angles that do not follow from positions and input: full turns of points, and rest
        angles [rad] of those that yield."""
        found: dict[str, Any] = {}
        for k, (group, stencil) in enumerate(self._points()):
            turns = stencil.turns()
            unusual = (stencil.state != self._given_state(group)).any(axis=1) | (turns != 0)
            values = np.column_stack([turns, stencil.state])
            found[f"points {k}"] = NamedRows(self._names(group)[unusual], values[unusual])
        return found

    def shape_history(self) -> dict[str, Any]:
        return self.get_history()

    def set_history(self, state: dict[str, Any]) -> None:
        for k, (group, stencil) in enumerate(self._points()):
            given = self._given_state(group)
            usual = np.column_stack([np.zeros(len(given)), given])
            values = state[f"points {k}"].of(self._names(group), otherwise=usual)
            stencil.recall(values[:, 0], values[:, 1:])

    def _given_state(self, group: RowGroup) -> Array:
        """The given history variables (n, z) of a group: the rest angle [rad] of what yields."""
        if not group.stencil.has_state:
            return np.zeros_like(group.stencil.state)
        given = np.array([self.get_number(term, "rest") for term in group.terms])
        return given[group.stencil.at.owner]

    def _names(self, group: RowGroup) -> Names:
        """Names (n,) of the points of a group: hashes of the number of the term in the scene, and
        of the numbers of the point."""
        in_scene = [next(i for i, one in enumerate(self._terms) if one is t) for t in group.terms]
        at = cast(FoldMeasures, group.stencil.at)
        rows = np.column_stack([np.array(in_scene, dtype=np.int64)[at.owner], at.names])
        names: Names = hash_rows(rows).view(np.int64)
        return names


@dataclass(frozen=True, eq=False)
class CreaseEnergy(RowsOf[FoldMeasure]):
    """Stored energy Σ ½ k (θ - θr)² over the points of a `FoldMeasure`, which may yield, with
    `elastic_fold` or `yielding_fold` as its law."""

    compiler: ClassVar[Compiler] = CreaseEnergies

    @property
    def stiffness(self) -> Array:
        """k (n,) [N m/rad] of the part of the fold that each point stands for."""
        return np.asarray(self.numbers["stiffness"]) * np.asarray(self.numbers["length"])

    def __post_init__(self) -> None:
        """Rest angles are checkpointed by the names of points (`CreaseEnergies`), as each rank
        lists its points only."""
