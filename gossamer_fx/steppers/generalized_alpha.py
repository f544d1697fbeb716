"""The generalised-α method: a second stepper on the same system, for comparison.  It does not conserve."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, field
from typing import Any

from petsc4py import PETSc

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.solvers import factorisation
from gossamer_fx.solvers.failures import NotConverged
from gossamer_fx.solvers.newton import Newton
from gossamer_fx.solvers.tolerances import Tolerances
from gossamer_fx.system.system import System
from gossamer_fx.terms.discrete_gradient import EndPoint

BEGINNING = (
    1e-3  # of the first step: in it rates are seen well above round-off, and little is moved
)


@check_arguments
@dataclass(frozen=True)
class GeneralizedAlpha:
    """Generalised-α method (Chung & Hulbert, J. Appl. Mech. 60 (1993) 371, doi:10.1115/1.2900803), second order.

    Equilibrium and constraints hold at the end of the step, with an acceleration-like a of its own (Arnold & Brüls,
    Multibody Syst. Dyn. 18 (2007) 185, doi:10.1007/s11044-007-9084-0, whose q̈ is v̇ here):

        M v̇1 + f(q1) + De(q1)ᵀλ1 = F1,   e(q1) = 0
        (1-α_m) a1 + α_m a0 = (1-α_f) v̇1 + α_f v̇0
        q1 = q0 + h v0 + h² ((½-β) a0 + β a1),   v1 = v0 + h ((1-γ) a0 + γ a1)

    α_m = (2ρ-1)/(ρ+1), α_f = ρ/(ρ+1), γ = ½ - α_m + α_f, β = ¼(1 - α_m + α_f)².

    Args:
        dt: step [s].
        spectral_radius: ρ in [0, 1] of high frequencies; 1 damps none, 0 annihilates them in a step.

    It loses or gains energy.  Damping and feedback are of first order, as their rates are those of the step before its
    end; the ledger books loads that vary with the values that they have there.
    """

    dt: float
    spectral_radius: float = 0.8
    _: KW_ONLY
    tolerances: Tolerances = field(default_factory=Tolerances)

    def __post_init__(self) -> None:
        check(
            math.isfinite(self.dt) and self.dt > 1e-100,
            f"GeneralizedAlpha: dt is {self.dt!r}; give a positive step in seconds.",
        )
        check(
            0 <= self.spectral_radius <= 1,
            f"GeneralizedAlpha: spectral_radius is {self.spectral_radius!r}; it lies between 0 and 1.",
        )

    @property
    def rule(self) -> EndPoint:
        """Which stress acts in a step."""
        return EndPoint()

    def start(self, system: System) -> GeneralizedAlphaSolver:
        return GeneralizedAlphaSolver(system, self.spectral_radius, self.tolerances)


class GeneralizedAlphaSolver:
    """One step at a time on a compiled system."""

    def __init__(self, system: System, ρ: float, tolerances: Tolerances) -> None:
        self._system = system
        self._αm, self._αf = (2 * ρ - 1) / (ρ + 1), ρ / (ρ + 1)
        self._γ, self._β = 0.5 - self._αm + self._αf, (1 - self._αm + self._αf) ** 2 / 4
        self.newton = Newton(system, tolerances)
        self._a0, self._a1, self._acceleration, self._v1 = (
            system.numbering.vector() for _ in range(4)
        )
        self._increment, self._offset = system.numbering.vector(), system.numbering.vector()
        self.vectors = {"acceleration": self._a0, "rate": self._acceleration}
        self._started = False

    def get_state(self) -> dict[str, Any]:
        return {"started": self._started}

    def set_state(self, state: dict[str, Any]) -> None:
        self._started = state["started"]

    def _first_acceleration(self, h: float) -> None:
        """M v̇0 + De(q0)ᵀλ = F - f(q0, v0), De(q0) v̇0 = -D²e[v0, v0]; and a0 = v̇0.

        Forces that depend on rates are those of a small part of the first step, of length h, made with v0.
        """
        system, r, A = self._system, self._increment, self._system.M.copy()
        system.set_inertia(0.0)
        y = system.begin_step(BEGINNING * h)
        system.v0.copy(r)
        r.scale(BEGINNING * h)
        held = system.predict(r)
        r.zeroEntries()
        with r as w:
            w[system.supports.held] = held
        system.set_increment(r, None)
        system.residual(y, r)
        if system.constraints:
            with r as values:
                values[system.constraints.owned] = 0
            system.constraints.add_curvature(system.v0, r)
            system.constraints.add_tangents(A)
            A.assemble()
        system.supports.clear(A, 1.0)
        r.scale(-1.0)
        problem = factorisation.solve(A, r, self._acceleration)
        if problem:
            raise NotConverged(f"no acceleration to start with, {problem}")
        self._drop_multipliers(self._acceleration)
        self._acceleration.copy(self._a0)
        self._started = True

    def _drop_multipliers(self, a: PETSc.Vec) -> None:
        """They have no rate."""
        if self._system.constraints:
            with a as values:
                values[self._system.constraints.owned] = 0

    def step(self, h: float) -> int:
        """Advance by h; returns Newton's iterations.  Nothing has changed if it raises `NotConverged`."""
        system, αm, αf, β, γ = self._system, self._αm, self._αf, self._β, self._γ
        if not self._started:
            self._first_acceleration(h)
        y = system.begin_step(h)
        # q1 - q0 = h v0 + h² a0/2 + w, so that a1 = a0 + w/(β h²) and v̇1 = c (w + offset)
        c = (1 - αm) / ((1 - αf) * β * h**2)
        increment, offset = self._increment, self._offset
        self._a0.copy(increment)
        increment.scale(h**2 / 2)
        increment.axpy(h, system.v0)
        self._a0.copy(offset)
        offset.scale(β * h**2 + αm / (1 - αf) / c)
        offset.axpy(-αf / (1 - αf) / c, self._acceleration)
        system.set_inertia(c, offset)
        w, _, iterations = self.newton.solve(increment, y)
        self._acceleration.waxpy(1.0, w, offset)
        self._acceleration.scale(c)
        self._a1.waxpy(1 / (β * h**2), w, self._a0)
        for rate in (self._acceleration, self._a1):
            self._drop_multipliers(rate)
        self._v1.waxpy(h * (1 - γ), self._a0, system.v0)
        self._v1.axpy(h * γ, self._a1)
        system.commit(self._v1)
        self._a1.copy(self._a0)
        return iterations
