"""Ropes whose length changes in a step: along a given history, or against the friction of a brake.

With the distance l of the ends and the natural length L the stretch is y = l - L, the stored energy
½ k y² for y > 0. In a step from (l0, L0) to (l1, L1) the mean tension T_mean is the average of T(y)
over y0 ≤ y ≤ y1, so that exactly

    given L(t)   y1 = l1 - L1, T = k y     T_mean Δl = Δψ + T_mean ΔL   the reel supplies -T_mean ΔL
    brake B      y1 = l1 - L0, T ≤ B       T_mean Δl = Δψ + B ΔL        the brake dissipates B ΔL

with ΔL = max(y1 - B/k, 0).  Both are the slope of a convex potential of l1.  The rope on the reel
ends at the length `total_length`; from there on the rope is stretched beyond B.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.algebra.point_measures import Gather, PointMeasure, PointMeasures, add_blocks
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    HistoryVariables,
)
from gossamer_fx.mechanics.terms.point_energies import Stencil

# [m²] Lower bound of e = ½ l², so that a rope whose ends coincide has no division by zero.
SMALLEST_MEASURE = 1e-300

# Change of the stretch over the length, below which the mean tension is that of the trapezoidal
# rule. The quotient area/change would be a small difference of large numbers there.
ROUND_OFF = 1e-9


class PaidOutRopes(HistoryVariables, CompiledTerms["PaidOutRope"]):
    """All `PaidOutRope` terms of a scene, as arrays over those of this rank."""

    def __init__(self, terms: Sequence[PaidOutRope], system: Assembly) -> None:
        """Compile all ropes with a reel: arrays and indices that stay the same in a run.
        Collective.

        Args:
            terms: the ropes of the scene, in the same order on all ranks.
            system: the compiled scene, which has the numbering of the unknowns.

        Raises:
            InputError: the stress rule takes the strain in the middle of the step.
        """
        # The length of a rope between the ends of a step is not known to its brake.
        check(
            not system.rule.takes_mid_strain,
            f"'{terms[0].name}': a rope that is paid out has forces by its lengths at the ends of "
            "a step; run its scene with Midpoint.",
        )
        self._system = system
        self.terms = terms
        self._at = PointMeasures(system.numbering, system.bodies, [term.measure for term in terms])
        self._gather = Gather(system.numbering, [self._at.indices])
        mine = [terms[i] for i in self._at.owner]
        self._k = np.array([term.stiffness for term in mine], dtype=float)
        self._brake = np.array([term.brake for term in mine], dtype=float)
        self._total_length = np.array([term.total_length for term in mine], dtype=float)
        self.length = np.array([term.length for term in mine], dtype=float)
        self._given = []
        for i, term in enumerate(terms):
            if term.history is not None:
                self._given.append((i, term.history))
        # Stretch at which a brake slips [m].  A rope without a brake never slips: its entry is not
        # read.
        self._brakes = np.isfinite(self._brake)
        self._yield = np.where(self._brakes, self._brake, 0.0) / self._k
        self._braked = [i for i, term in enumerate(terms) if np.isfinite(term.brake)]
        self.losses = [terms[i].name for i in self._braked]
        # L1 of a step with a history.
        self._next = self.length
        self._stencil = Stencil(self._at, self, False, system.rule)
        # Distances of the ends [m] at the start of the step; set by the first `commit`.
        self._l: Array = np.zeros(self._at.n)
        self._begun = False

    # ---- a step ----------------------------------------------------------------------------------

    def begin_step(self, t: float) -> None:
        """Evaluate the given natural lengths [m] of ropes at the end of the step that begins.

        Raises:
            InputError: on all ranks, if a user's function of time does not return a positive
                length.
        """
        system = self._system
        # The length is that of the end of the step, also where the forces are those of its middle.
        end = system.time + system.h
        lengths = np.full(len(self.terms), np.nan)
        for i, history in self._given:
            lengths[i] = history(end)
        given = lengths[self._at.owner]
        self._next = np.where(np.isfinite(given), given, self.length)

    def commit(self) -> None:
        """Make the accepted coordinates the start of the next step, and update the natural lengths
        [m].

        Collective.  A brake that slips has let out rope in the accepted step, and a reel with a
        given length as much as that says.  The first call is at the initial state, where ropes that
        are tighter than their brake allows become longer.
        """
        # Unknowns (n, D) of the ends of this rank's n ropes.
        q = self._gather(self._system.q0)[0]
        length = self._lengths(q)
        if self._begun:
            self.length = self._next + self._slip(length)
        else:
            # A rope that is too short at the start has slipped before: no tension exceeds its
            # brake.
            self.length = self.length + self._slip(length)
            self._begun = True
        self._next = self.length
        # Distances of the ends [m] at the start of the next step.
        self._l = length
        self._stencil.keep(q)

    def add_forces(self, r: PETSc.Vec) -> None:
        """Add the forces [N] of all ropes to r."""
        q = self._gather(self._system.q1)[0]
        indices = self._at.indices.ravel()
        forces = self._stencil.force(q).ravel()
        r.setValues(indices, forces, addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def add_tangents(self, A: PETSc.Mat) -> None:
        """Add the tangents [N/m] of all ropes to A."""
        q = self._gather(self._system.q1)[0]
        add_blocks(A, self._at.indices, self._at.indices, self._stencil.tangent(q))

    def average(self, e0: Array, e1: Array) -> tuple[Array, Array]:
        """Mean stress S_mean = T_mean/l_mean of a step for each of n ropes, and its derivative.

        T_mean [N] is the mean tension, l_mean = (l0 + l1)/2 [m] the mean distance of the ends.
        With e = ½ l², S_mean (e1 - e0) is the work T_mean (l1 - l0) [J]."""
        # Distances l0, l1 [m] of the ends; T (n,) [N]: mean tension; slope [N/m]: dT/dl1.
        l0 = np.sqrt(2 * np.maximum(e0[:, 0], SMALLEST_MEASURE))
        l1 = np.sqrt(2 * np.maximum(e1[:, 0], SMALLEST_MEASURE))
        T, slope = self._tension(l1)
        l_mean = (l0 + l1) / 2
        stress = T / l_mean
        # dl1/de1 = 1/l1, and dl_mean/dl1 = ½.
        derivative = (slope - T / l_mean / 2) / l_mean / l1
        return stress[:, None], derivative[:, None, None]

    def supplied(self) -> float:
        """Work [J] that the reels with a given length supply on this rank in the step."""
        l1 = self._lengths(self._gather(self._system.q1)[0])
        T, _ = self._tension(l1)
        paid_out = self._next - self.length
        return float(np.sum(-T * paid_out))

    def dissipated(self) -> Array:
        """Energy [J] that each term with a brake dissipates on this rank in the step."""
        if not self._braked:
            return np.zeros(0)
        slip = self._slip(self._lengths(self._gather(self._system.q1)[0]))
        loss = np.where(self._brakes, self._brake, 0.0) * slip
        of_terms = np.bincount(self._at.owner, loss, len(self.terms)).astype(float)
        return of_terms[self._braked]

    def energies(self) -> dict[str, float]:
        """This rank's share of the stored energy [J] at the start of the step, by name."""
        found = dict.fromkeys((term.name for term in self.terms), 0.0)
        energies = self._k * np.maximum(self._l - self.length, 0.0) ** 2 / 2
        for i, energy in zip(self._at.owner, energies, strict=True):
            found[self.terms[i].name] += float(energy)
        return found

    # ---- history variables -----------------------------------------------------------------------

    def lengths(self) -> Array:
        """Natural length L (n,) [m] of the rope of each term, the same on every rank."""
        found = np.zeros(len(self.terms))
        found[self._at.owner] = self.length
        return np.asarray(self._system.comm.allreduce(found))

    def tensions(self) -> Array:
        """Tension (n,) [N] of the rope of each term in the accepted state, the same on every
        rank."""
        found = np.zeros(len(self.terms))
        found[self._at.owner] = self._k * np.maximum(self._l - self.length, 0.0)
        return np.asarray(self._system.comm.allreduce(found))

    def get_state(self) -> dict[str, Any]:
        """The lengths L [m], for a restart."""
        return {"lengths": self.lengths().tolist()}

    def set_state(self, state: dict[str, Any]) -> None:
        self.length = np.array(state["lengths"])[self._at.owner]
        self._next = self.length

    # ---- the law ---------------------------------------------------------------------------------

    def _lengths(self, q: Array) -> Array:
        """Distances l (n,) [m] of the ends at unknowns q (n, D)."""
        e = self._at.strain(q)[:, 0]
        distances: Array = np.sqrt(2 * np.maximum(e, SMALLEST_MEASURE))
        return distances

    def _room(self) -> Array:
        """Lengths (n,) [m] that remain on the reels; zero without a brake."""
        remaining = np.maximum(self._total_length - self.length, 0.0)
        return np.where(self._brakes, remaining, 0.0)

    def _slip(self, l1: Array) -> Array:
        """Lengths ΔL (n,) [m] that brakes let out in a step that ends with the distances l1 (n,)
        [m]."""
        beyond = np.clip(l1 - self._next - self._yield, 0.0, self._room())
        slip: Array = np.where(self._brakes, beyond, 0.0)
        return slip

    def _pull(self, y: Array) -> Array:
        """Tensions (n,) [N] of ropes in a step, as a function of their stretch.

        They are k y, but no more than the brake force B as long as rope remains on the reel, and
        zero for a slack rope.

        Args:
            y: distances of the ends less natural lengths (n,) [m] at the start of the step.
        """
        slip = np.clip(y - self._yield, 0.0, self._room())
        beyond = np.where(self._brakes, slip, 0.0)
        pull: Array = self._k * np.maximum(y - beyond, 0.0)
        return pull

    def _tension(self, l1: Array) -> tuple[Array, Array]:
        """Mean tension of a step for each of n ropes, averaged exactly over its stretch, and the
        derivative.

        With backward Euler it is the tension at the end of the step.  The stretch, distance less
        natural length, is y0 [m] at the start of the step and y1 [m] at its end.

        Args:
            l1: distances of the ends (n,) [m] at the end of the step, of this rank's ropes.

        Returns:
            T_mean (n,) [N] and dT_mean/dl1 (n,) [N/m].
        """
        # The distance at the start of the step is the attribute `_l`.
        y1 = l1 - self._next
        y0 = self._l - self.length
        # Backward Euler takes the tension at the end of the step.
        if self._system.rule.acts_at_end:
            y0 = y1
        end_of_slip = self._yield + self._room()
        slips = self._brakes & (y1 > self._yield) & (y1 < end_of_slip)
        slope = np.where((y1 > 0) & ~slips, self._k, 0.0)

        # The area under T from y0 to y1 by the trapezoidal rule between the corners of T, where T
        # is linear, so that it is exact.  Corners outside the path are moved to its ends and add
        # nothing.
        low = np.minimum(y0, y1)
        high = np.maximum(y0, y1)
        corners = [0 * y0, self._yield, end_of_slip]
        corners_of_path = [np.clip(corner, low, high) for corner in corners]
        y = np.sort([low, *corners_of_path, high], axis=0)
        pull = np.array([self._pull(each) for each in y])
        area = np.sum((pull[1:] + pull[:-1]) / 2 * np.diff(y, axis=0), axis=0)

        path = high - low
        is_far = ROUND_OFF * np.maximum(self._l, l1) < path
        safe_path = np.where(is_far, path, 1.0)
        safe_change = np.where(is_far, y1 - y0, 1.0)
        pull0 = self._pull(y0)
        pull1 = self._pull(y1)
        T = np.where(is_far, area / safe_path, (pull0 + pull1) / 2)
        derivative = np.where(is_far, (pull1 - T) / safe_change, slope / 2)
        return T, derivative


@dataclass(frozen=True, eq=False)
class PaidOutRope:
    """A rope between two points, whose length is given or held by a brake.

    Args:
        name: in the energy balance and in messages.
        measure: e = ½|x_a - x_b|² [m²] of the two points.
        stiffness: k [N/m].
        length: L [m] at the start.
        history: L(t) [m], the same on every rank; without it a brake holds the rope.
        brake: B [N], at which the brake slips; infinite with a history.
        total_length: L [m] at which the reel is empty.
    """

    name: str
    measure: PointMeasure
    stiffness: float
    length: float
    history: Callable[[float], float] | None = None
    brake: float = np.inf
    total_length: float = np.inf
    compiler: ClassVar[Compiler] = PaidOutRopes
