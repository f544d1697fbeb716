"""Ropes whose length changes in a step: along a given history, or against the friction of a brake.

With the distance l of the ends and the natural length L the stretch is y = l - L, the stored energy ½ k y² for y > 0.
In a step from (l0, L0) to (l1, L1) the mean tension T̄ is the average of T(y) over y0 ≤ y ≤ y1, so that

    given L(t)   y1 = l1 - L1, T = k y       T̄ Δl = Δψ + T̄ ΔL     -T̄ ΔL is supplied by the reel
    brake B      y1 = l1 - L0, T ≤ B         T̄ Δl = Δψ + B ΔL      B ΔL is dissipated, ΔL = max(y1 - B/k, 0)

exactly.  Both are the slope of a convex potential of l1.  The rope on the reel ends at the length `most`; from
there on the rope is stretched beyond B.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from petsc4py import PETSc

from gossamer_fx.algebra.point_measures import Gather, PointMeasure, PointMeasures, add_blocks
from gossamer_fx.model.body import Array
from gossamer_fx.model.roles import (
    Dissipation,
    Forces,
    HistoryVariables,
    StateObserver,
    StepObserver,
    StoredEnergies,
    Supply,
    Tangents,
)
from gossamer_fx.terms.assembly import Assembly, CompiledTerms, Compiler
from gossamer_fx.terms.point_energies import Stencil


class PaidOutRopes(
    StepObserver,
    StateObserver,
    Forces,
    Tangents,
    StoredEnergies,
    Supply,
    Dissipation,
    HistoryVariables,
    CompiledTerms["PaidOutRope"],
):
    """All `PaidOutRope` terms of a scene, as arrays over those of this rank."""

    def __init__(self, terms: Sequence[PaidOutRope], system: Assembly) -> None:
        self._system, self._terms = system, terms
        self._at = PointMeasures(system.numbering, system.bodies, [term.measure for term in terms])
        self._gather = Gather(system.numbering, [self._at.indices])
        mine = [terms[i] for i in self._at.owner]
        self._k, self._brake, self._most, self.length = (
            np.array([getattr(term, what) for term in mine], dtype=float)
            for what in ("stiffness", "brake", "most", "length")
        )
        self._given = [
            (i, term.history) for i, term in enumerate(terms) if term.history is not None
        ]
        self._yield = np.where(np.isfinite(self._brake), self._brake, 0.0) / self._k
        self._brakes = np.isfinite(self._brake)
        self._braked = [i for i, term in enumerate(terms) if np.isfinite(term.brake)]
        self.losses = [terms[i].name for i in self._braked]
        self._next = self.length  # L1 of a step with a history
        self._stencil = Stencil(self._at, self, False, system.rule.alpha)
        self._l: Array = np.zeros(self._at.n)
        self._begun = False

    # ---- a step -----------------------------------------------------------------------------------------------------

    def begin_step(self, t: float) -> None:
        system, lengths = self._system, np.full(len(self._terms), np.nan)
        end = t if system.rule.alpha == 1.0 else system.time + system.h
        for i, history in self._given:
            lengths[i] = history(end)
        given = lengths[self._at.owner]
        self._next = np.where(np.isfinite(given), given, self.length)

    def commit(self) -> None:
        q = self._gather(self._system.q0)[0]
        length = self._lengths(q)
        if self._begun:
            self.length = self._next + self._slip(length)
        else:  # no brake is pulled harder than it holds
            self.length = self.length + self._slip(length)
            self._begun = True
        self._next = self.length
        self._l = length
        self._stencil.keep(q)

    def add_forces(self, r: PETSc.Vec) -> None:
        q = self._gather(self._system.q1)[0]
        r.setValues(
            self._at.indices.ravel(),
            self._stencil.force(q).ravel(),
            addv=PETSc.InsertMode.ADD_VALUES,
        )
        r.assemble()

    def add_tangents(self, A: PETSc.Mat) -> None:
        q = self._gather(self._system.q1)[0]
        add_blocks(A, self._at.indices, self._at.indices, self._stencil.tangent(q))

    def average(self, e0: Array, e1: Array) -> tuple[Array, Array]:
        """S̄ = T̄/l̄ (n, 1) with S̄·Δe = T̄ Δl, and dS̄/de1 (n, 1, 1): what the stencil asks for."""
        l0, l1 = (np.sqrt(2 * np.maximum(e[:, 0], 1e-300)) for e in (e0, e1))
        T, slope = self._tension(l1)
        mean = (l0 + l1) / 2
        return (T / mean)[:, None], ((slope - T / mean / 2) / mean / l1)[:, None, None]

    def supplied(self) -> float:
        T = self._tension(self._lengths(self._gather(self._system.q1)[0]))[0]
        return float(np.sum(-T * (self._next - self.length)))

    def dissipated(self) -> Array:
        if not self._braked:
            return np.zeros(0)
        slip = self._slip(self._lengths(self._gather(self._system.q1)[0]))
        loss = np.where(self._brakes, self._brake, 0.0) * slip
        return np.bincount(self._at.owner, loss, len(self._terms)).astype(float)[self._braked]

    def energies(self) -> dict[str, float]:
        found = dict.fromkeys((term.name for term in self._terms), 0.0)
        for i, energy in zip(
            self._at.owner, self._k * np.maximum(self._l - self.length, 0.0) ** 2 / 2, strict=True
        ):
            found[self._terms[i].name] += float(energy)
        return found

    # ---- what the coordinates do not tell ---------------------------------------------------------------------------

    def lengths(self) -> Array:
        """L [m] of all terms, the same on every rank."""
        found = np.zeros(len(self._terms))
        found[self._at.owner] = self.length
        return np.asarray(self._system.comm.allreduce(found))

    def tensions(self) -> Array:
        """T [N] of all terms in the accepted state, the same on every rank."""
        found = np.zeros(len(self._terms))
        found[self._at.owner] = self._k * np.maximum(self._l - self.length, 0.0)
        return np.asarray(self._system.comm.allreduce(found))

    def get_state(self) -> dict[str, Any]:
        return {"lengths": self.lengths().tolist()}

    def set_state(self, state: dict[str, Any]) -> None:
        self.length = np.array(state["lengths"])[self._at.owner]
        self._next = self.length

    # ---- the law ----------------------------------------------------------------------------------------------------

    def _lengths(self, q: Array) -> Array:
        l: Array = np.sqrt(2 * np.maximum(self._at.strain(q)[:, 0], 1e-300))  # noqa: E741
        return l

    def _room(self) -> Array:
        """Lengths that remain on the reels [m]."""
        return np.where(self._brakes, np.maximum(self._most - self.length, 0.0), 0.0)

    def _slip(self, l1: Array) -> Array:
        """ΔL (n,) of the brakes when the ends come to the distance l1."""
        slip: Array = np.where(
            self._brakes, np.clip(l1 - self._next - self._yield, 0.0, self._room()), 0.0
        )
        return slip

    def _pull(self, y: Array) -> Array:
        """T(y): k y, but no more than B as long as there is room."""
        beyond = np.where(self._brakes, np.clip(y - self._yield, 0.0, self._room()), 0.0)
        pull: Array = self._k * np.maximum(y - beyond, 0.0)
        return pull

    def _tension(self, l1: Array) -> tuple[Array, Array]:
        """T̄ (n,) of a step to the distance l1, and its derivative: T is linear between its corners."""
        y1 = l1 - self._next
        y0 = y1 if self._system.rule.alpha == 1.0 else self._l - self.length
        stiff = (y1 > 0) & ~(self._brakes & (y1 > self._yield) & (y1 < self._yield + self._room()))
        slope = np.where(stiff, self._k, 0.0)
        low, high = np.minimum(y0, y1), np.maximum(y0, y1)
        corners = [0 * y0, self._yield, self._yield + self._room()]
        y = np.sort([low, *(np.clip(corner, low, high) for corner in corners), high], axis=0)
        pull = np.array([self._pull(each) for each in y])
        Δ = high - low
        area = np.sum((pull[1:] + pull[:-1]) / 2 * np.diff(y, axis=0), axis=0)
        far = 1e-9 * np.maximum(self._l, l1) < Δ
        safe = np.where(far, Δ, 1.0)
        T = np.where(far, area / safe, (self._pull(y0) + self._pull(y1)) / 2)
        derivative = np.where(far, (self._pull(y1) - T) / np.where(far, y1 - y0, 1.0), slope / 2)
        return T, derivative


@dataclass(frozen=True, eq=False)
class PaidOutRope:
    """A rope between the two points of `measure`, e = ½|x_a - x_b|², with the stiffness k [N/m].

    length    L [m] at the start
    history   L(t) [m], the same on every rank; none: a brake holds it
    brake     B [N], at which it slips; infinite with a history
    most      L [m] at which a brake has nothing left
    """

    name: str
    measure: PointMeasure
    stiffness: float
    length: float
    history: Callable[[float], float] | None = None
    brake: float = np.inf
    most: float = np.inf
    compiler: ClassVar[Compiler] = PaidOutRopes
