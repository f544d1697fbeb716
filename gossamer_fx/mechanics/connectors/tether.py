"""Tethers: ropes whose length changes in a step, along a given history or against the friction of a
brake.

With the distance l of the ends and the natural length L the stretch is y = l - L, the stored energy
½ k y² for y > 0. In a step from (l0, L0) to (l1, L1) the mean tension T_mean is the average of T(y)
over y0 ≤ y ≤ y1, so that exactly

    given L(t)   y1 = l1 - L1, T = k y     T_mean Δl = Δψ + T_mean ΔL   the reel supplies -T_mean ΔL
    brake B      y1 = l1 - L0, T ≤ B       T_mean Δl = Δψ + B ΔL        the brake dissipates B ΔL

with ΔL = max(y1 - B/k, 0).  In both cases T_mean is the derivative of a convex potential of l1.  At
the length `total_length` the reel is empty: the rope pays out no more, and T may exceed B.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.algebra.point_measures import Gather, PointMeasure, PointMeasures, add_blocks
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import InputError, check, check_positive
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.model.body import Array, Port
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.frames import LineBetween
from gossamer_fx.mechanics.connectors.spring import Stiffness, half_distance_squared, length_of
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    HistoryVariables,
)
from gossamer_fx.mechanics.terms.point_energies import BetweenPoints, Stencil

# Change of the stretch over the length, below which the mean tension is that of the trapezoidal
# rule. The quotient area/change would be a small difference of large numbers there.
ROUND_OFF = 1e-9


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Tether(LineBetween):
    """A rope without mass from a reel at one of two points: tension k (l - L) beyond its length L,
    else none.

    Either L is a function of time, and the work of the reel counts as supplied (negative while it
    pays out under tension), or a brake holds the reel and slips where the tension would exceed B:
    the loss B ΔL counts as dissipated.  A brake torque M on a reel of radius r is B = M/r.  Energy
    closes exactly; momentum and angular momentum are kept.

    Args:
        a, b: ports of bodies; one of them may be a `Ground`.
        stiffness: k [N/m] at every length, positive.
        length: L [m], a positive number with a `brake_force`, else a function of time [s].
        brake_force: B [N], positive; None: no brake.
        total_length: [m] that a braked reel has in all; default: without end.
        name: name in messages and output.

    Raises:
        InputError: a length that is not positive, a brake in addition to a function, a number
            without a brake.

    Example:
        >>> reel = hub.port((0.0, 0.0, 0.1))
        >>> braked = gx.connectors.Tether(
        ...     reel, mass.port(), stiffness=1e3, length=1.1, brake_force=2.0, total_length=5.0
        ... )
        >>> driven = gx.connectors.Tether(
        ...     reel, mass.port(), stiffness=1e3, length=lambda t: 1.1 + 0.2 * t, name="winch"
        ... )
    """

    stiffness: Stiffness
    length: float | Callable[[float], float]
    brake_force: float | None = None
    total_length: float = math.inf
    name: str = "tether"

    def __post_init__(self) -> None:
        super().__post_init__()
        if callable(self.length):
            check(
                self.brake_force is None,
                f"Tether '{self.name}': its length is given as a function; leave the brake out.",
            )
            return
        check_positive(self, "length", "m")
        check(
            self.brake_force is not None,
            f"Tether '{self.name}': its length is a number; give a brake, or a function of time, "
            "or take a Rope.",
        )
        check_positive(self, "brake_force", "N")
        check(
            self.total_length >= self.length,
            f"Tether '{self.name}': total_length is {self.total_length!r} m; "
            f"give {self.length:g} m or more.",
        )

    def terms(self, start: State) -> Iterable[Term]:
        measure = half_distance_squared(self.a, self.b)
        given = self.length
        if not callable(given):
            # `__post_init__` refuses a number without a brake.
            assert self.brake_force is not None
            yield PaidOutRope(
                name=self.name,
                measure=measure,
                stiffness=self.stiffness,
                length=given,
                history=None,
                brake=self.brake_force,
                total_length=self.total_length,
            )
            return
        # One of the ends is a port: `Between` refuses two points of the ground.
        comm = next(port.body.comm for port in (self.a, self.b) if isinstance(port, Port))

        def history(t: float) -> float:
            """Length L [m] at a time t [s]; the same on every rank, and positive."""
            what = f"Length of '{self.name}' at t = {t:.6g} s"
            length = float(ask_numbers(comm, what, lambda: given(t)))
            if length <= 0:
                raise InputError(f"{what} is {length:g} m; give a function that is positive.")
            return length

        yield PaidOutRope(self.name, measure, self.stiffness, history(0.0), history)


class PaidOutRopes(BetweenPoints, HistoryVariables, CompiledTerms["PaidOutRope"]):
    """All `PaidOutRope` terms of a scene, as arrays over the n ropes that this rank evaluates.

    Methods without a text here are described in `terms.assembly`.

    Attributes:
        length: natural lengths L (n,) [m] at the start of the step.
    """

    def __init__(self, terms: Sequence[PaidOutRope], system: Assembly) -> None:
        # A brake sets the length at the end of a step, and none between its ends.
        check(
            not system.rule.takes_mid_strain,
            f"'{terms[0].name}': "
            "a rope that is paid out has forces by its lengths at the ends of a step; "
            "run its scene with Midpoint.",
        )
        self._system = system
        self.terms = terms
        self._at = PointMeasures(system.numbering, system.bodies, [term.measure for term in terms])
        self._gather = Gather(system.numbering, [self._at.indices])
        mine = [terms[i] for i in self._at.owner]
        self._k = np.array([term.stiffness for term in mine], dtype=float)
        brakes = np.array([term.brake for term in mine], dtype=float)
        self._total_length = np.array([term.total_length for term in mine], dtype=float)
        self.length = np.array([term.length for term in mine], dtype=float)
        # Histories L(t) of the terms that have one, by the index of the term.
        self._given = []
        for i, term in enumerate(terms):
            if term.history is not None:
                self._given.append((i, term.history))
        # Force [N] and stretch [m] at which a brake slips; zero for a rope without a brake.
        self._has_brake = np.isfinite(brakes)
        self._brake_force = np.where(self._has_brake, brakes, 0.0)
        self._yield_stretch = self._brake_force / self._k
        self._braked_terms = [i for i, term in enumerate(terms) if np.isfinite(term.brake)]
        self.losses = [terms[i].name for i in self._braked_terms]
        # Natural lengths (n,) [m] at the end of the step before its slip: L1 of a rope with a
        # history, L0 of one with a brake.
        self._next_length = self.length
        self._stencil = Stencil(self._at, self, dissipates=False, rule=system.rule)
        # Distances of the ends (n,) [m] at the start of the step; set by the first `commit`.
        self._start_distance: Array = np.zeros(self._at.n)
        # Mean tensions (n,) [N] of the last accepted step.
        self._mean_tension: Array = np.zeros(self._at.n)
        self._has_begun = False

    # ---- a step ----------------------------------------------------------------------------------

    def begin_step(self, t: float) -> None:
        system = self._system
        # The length is that of the end of the step, also where the forces are those of its middle.
        end = system.time + system.h
        # NaN marks the terms without a history, whose ropes start from their present length.
        lengths = np.full(len(self.terms), np.nan)
        for i, history in self._given:
            lengths[i] = history(end)
        given = lengths[self._at.owner]
        self._next_length = np.where(np.isfinite(given), given, self.length)

    def commit(self) -> None:
        # Unknowns (n, D) of the ends of this rank's n ropes.
        q = self._gather(self._system.q0)[0]
        length = self._distances(q)
        self._mean_tension, _ = self._tension(length)
        # First call: a rope whose tension exceeds its brake pays out at once, as if before the run.
        before_slip = self._next_length if self._has_begun else self.length
        self.length = before_slip + self._slip(length)
        self._has_begun = True
        self._next_length = self.length
        # The accepted end is the start of the next step.
        self._start_distance = length
        self._stencil.keep(q)

    def add_forces(self, r: PETSc.Vec) -> None:
        q = self._gather(self._system.q1)[0]
        indices = self._at.indices.ravel()
        forces = self._stencil.force(q).ravel()
        r.setValues(indices, forces, addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def add_tangents(self, A: PETSc.Mat) -> None:
        q = self._gather(self._system.q1)[0]
        add_blocks(A, self._at.indices, self._at.indices, self._stencil.tangent(q))

    def average(self, e0: Array, e1: Array) -> tuple[Array, Array]:
        """Mean stress T_mean/l_mean (n, 1) [N/m] of a step for each of n ropes with the measures e
        = ½ l², and its derivative by e1; l_mean is the mean distance of the ends."""
        # Distances l0, l1 [m] of the ends; T (n,) [N]: mean tension; slope [N/m]: dT/dl1.
        l0 = length_of(e0)
        l1 = length_of(e1)
        T, slope = self._tension(l1)
        l_mean = (l0 + l1) / 2
        stress = T / l_mean
        # dl1/de1 = 1/l1, and dl_mean/dl1 = ½.
        derivative = (slope - T / l_mean / 2) / l_mean / l1
        return stress[:, None], derivative[:, None, None]

    def supplied(self) -> float:
        l1 = self._distances(self._gather(self._system.q1)[0])
        T, _ = self._tension(l1)
        # Zero for ropes with a brake, whose slip is dissipated.
        paid_out = self._next_length - self.length
        return float(np.sum(-T * paid_out))

    def dissipated(self) -> Array:
        if not self._braked_terms:
            return np.zeros(0)
        slip = self._slip(self._distances(self._gather(self._system.q1)[0]))
        loss = self._brake_force * slip
        of_terms = np.bincount(self._at.owner, loss, len(self.terms)).astype(float)
        return of_terms[self._braked_terms]

    def energies(self) -> dict[str, float]:
        found = dict.fromkeys((term.name for term in self.terms), 0.0)
        energies = self._k * np.maximum(self._start_distance - self.length, 0.0) ** 2 / 2
        for i, energy in zip(self._at.owner, energies, strict=True):
            found[self.terms[i].name] += float(energy)
        return found

    # ---- history variables -----------------------------------------------------------------------

    def lengths(self) -> Array:
        """Natural length L (n,) [m] of the rope of each term, the same on every rank."""
        return self._of_terms(self.length)

    def tensions(self, *, mean: bool) -> Array:
        """Tension (n,) [N] of the rope of each term, the mean of the last step or that at its end,
        the same on every rank."""
        at_end = self._k * np.maximum(self._start_distance - self.length, 0.0)
        return self._of_terms(self._mean_tension if mean else at_end)

    def stresses_of_step(self, term: PaidOutRope) -> Array:
        # As in `average`: the tension over the mean distance of the ends.
        start, end = (self._gather(q)[0] for q in (self._system.previous, self._system.q0))
        stress = 2 * self._mean_tension / (self._distances(start) + self._distances(end))
        return stress[self._at.owner == self.terms.index(term), None]

    def _of_terms(self, values: Array) -> Array:
        """Values (n,) of the ropes of this rank as those of each term, the same on every rank."""
        found = np.zeros(len(self.terms))
        found[self._at.owner] = values
        return np.asarray(self._system.comm.allreduce(found))

    def get_history(self) -> dict[str, Any]:
        return {
            "lengths": self.lengths().tolist(),
            "mean tensions": self.tensions(mean=True).tolist(),
        }

    def shape_history(self) -> dict[str, Any] | None:
        # A rope whose length is given over time has the one of the time at which a scene starts.
        return None if self._given else self.get_history()

    def set_history(self, state: dict[str, Any]) -> None:
        self.length = np.array(state["lengths"])[self._at.owner]
        self._next_length = self.length
        # That of the step before, which lengths do not tell.
        self._mean_tension = np.array(state["mean tensions"])[self._at.owner]

    # ---- the law ---------------------------------------------------------------------------------

    def _distances(self, q: Array) -> Array:
        """Distances l (n,) [m] of the ends at unknowns q (n, D)."""
        return length_of(self._at.strain(q))

    def _room(self) -> Array:
        """Lengths (n,) [m] that remain on the reels; zero without a brake."""
        remaining = np.maximum(self._total_length - self.length, 0.0)
        return np.where(self._has_brake, remaining, 0.0)

    def _slip(self, l1: Array) -> Array:
        """Lengths ΔL (n,) [m] that brakes let out in a step that ends with the distances l1 (n,)
        [m]; zero without a brake, as there is no room."""
        stretch = l1 - self._next_length
        return np.clip(stretch - self._yield_stretch, 0.0, self._room())

    def _pull(self, y: Array) -> Array:
        """Tensions (n,) [N] at the stretches y (n,) [m] from the natural lengths at the start of
        the step: k y, but no more than the brake force as long as rope remains on the reel, and
        zero if slack."""
        slip = np.clip(y - self._yield_stretch, 0.0, self._room())
        return self._k * np.maximum(y - slip, 0.0)

    def _tension(self, l1: Array) -> tuple[Array, Array]:
        """Mean tension T_mean (n,) [N] of a step to the distances l1 (n,) [m], averaged exactly
        over its stretch, and dT_mean/dl1 (n,) [N/m]."""
        # Stretches [m] at the end, before the slip of the step, and at its start.
        y1 = l1 - self._next_length
        y0 = self._start_distance - self.length
        # Backward Euler takes the tension at the end of the step.
        if self._system.rule.acts_at_end:
            y0 = y1
        end_of_slip = self._yield_stretch + self._room()
        slips = self._has_brake & (y1 > self._yield_stretch) & (y1 < end_of_slip)
        # dT/dy at the end.
        slope = np.where((y1 > 0) & ~slips, self._k, 0.0)

        # The area under T from y0 to y1 by the trapezoidal rule between the corners of T, where T
        # is linear, so that it is exact.  Corners outside the path are moved to its ends and add
        # nothing.
        low = np.minimum(y0, y1)
        high = np.maximum(y0, y1)
        corners = [0 * y0, self._yield_stretch, end_of_slip]
        corners_of_path = [np.clip(corner, low, high) for corner in corners]
        y = np.sort([low, *corners_of_path, high], axis=0)
        pull = np.array([self._pull(each) for each in y])
        area = np.sum((pull[1:] + pull[:-1]) / 2 * np.diff(y, axis=0), axis=0)

        path = high - low
        is_far = ROUND_OFF * np.maximum(self._start_distance, l1) < path
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
        measure: e = ½|x_a - x_b|² [m²] of the two points.
        stiffness: k [N/m].
        length: L [m] at the start.
        history: L(t) [m], the same on every rank; without it a brake holds the rope.
        brake: B [N], at which the brake slips; infinite: there is no brake, as with a history.
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
