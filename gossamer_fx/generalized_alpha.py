"""The generalised-α method: a second stepper on the same system, for comparison.  It does not conserve."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from petsc4py import PETSc

from gossamer_fx.discrete_gradient import gradient
from gossamer_fx.errors import check
from gossamer_fx.kinematics import Expr
from gossamer_fx.newton import Newton, Tolerances
from gossamer_fx.parts import Stored
from gossamer_fx.system import System


@dataclass(frozen=True)
class WeightedStrain:
    """Stress ψ' of the strain (1-α) e0 + α e1, at the configuration of the same weights."""

    alpha: float

    def stress(self, part: Stored, e0: Expr, e1: Expr) -> Expr:
        return gradient(part.density, (1 - self.alpha) * e0 + self.alpha * e1)


@dataclass(frozen=True)
class GeneralizedAlpha:
    """Generalised-α method (Chung & Hulbert, J. Appl. Mech. 60 (1993) 371, doi:10.1115/1.2900803): second order.

        M ((1-α_m) a1 + α_m a0) + f(q_{1-α_f}) = F
        q1 = q0 + h v0 + h² ((½-β) a0 + β a1),   v1 = v0 + h ((1-γ) a0 + γ a1)

    α_m = (2ρ-1)/(ρ+1), α_f = ρ/(ρ+1), γ = ½ - α_m + α_f, β = ¼(1 - α_m + α_f)².

    Args:
        dt: step [s].
        spectral_radius: ρ in [0, 1] of high frequencies; 1 damps none, 0 annihilates them in a step.

    It loses or gains energy, and has no place for multipliers or gas: scenes with them are refused.
    """

    dt: float
    spectral_radius: float = 0.8
    tolerances: Tolerances = field(default_factory=Tolerances)

    def __post_init__(self) -> None:
        check(
            math.isfinite(self.dt) and self.dt > 0,
            f"GeneralizedAlpha: dt is {self.dt!r}; give a positive step in seconds.",
        )
        check(
            0 <= self.spectral_radius <= 1,
            f"GeneralizedAlpha: spectral_radius is {self.spectral_radius!r}; it lies between 0 and 1.",
        )

    @property
    def rule(self) -> WeightedStrain:
        return WeightedStrain(1 / (self.spectral_radius + 1))

    def start(self, system: System) -> GeneralizedAlphaSolver:
        check(
            system.constraints is None and not system.borders,
            "GeneralizedAlpha has no place for joints, rigid bodies, beams or gas; use Midpoint.",
        )
        return GeneralizedAlphaSolver(system, self.spectral_radius, self.tolerances)


class GeneralizedAlphaSolver:
    """One step at a time on a compiled system."""

    def __init__(self, system: System, ρ: float, tolerances: Tolerances) -> None:
        self._system = system
        self._αm, αf = (2 * ρ - 1) / (ρ + 1), ρ / (ρ + 1)
        self._γ, self._β = 0.5 - self._αm + αf, (1 - self._αm + αf) ** 2 / 4
        self.newton = Newton(system, tolerances)
        self._a0, self._a1, self._v1, self._base = (system.numbering.vector() for _ in range(4))
        self._started = False

    def _first_acceleration(self) -> None:
        """M a0 = F - f(q0)."""
        system, r = self._system, self._base
        system.inertia(0.0, system.q0)
        system.residual(system.begin(1e-9), r)
        r.scale(-1.0)
        ksp = PETSc.KSP().create(system.comm)
        ksp.setOperators(system.M)
        ksp.setType("preonly")
        ksp.getPC().setType("lu")
        ksp.getPC().setFactorSolverType("mumps")
        ksp.solve(r, self._a0)
        self._started = True

    def step(self, h: float) -> int:
        """Advance by h; returns Newton's iterations.  Nothing has changed if it raises `NotConverged`."""
        system, β, γ, αm = self._system, self._β, self._γ, self._αm
        if not self._started:
            self._first_acceleration()
        y = system.begin(h)
        base, a1 = self._base, self._a1
        base.waxpy(h, system.v0, system.q0)
        base.axpy(h**2 * (0.5 - β), self._a0)
        # (1-αm) a1 + αm a0 = c (q1 - a), and the start of the iteration, q1 for a1 = a0
        predictor = self._v1
        predictor.waxpy(h**2 * β, self._a0, base)
        a = base.copy()
        a.axpy(-(h**2) * β * αm / (1 - αm), self._a0)
        system.inertia((1 - αm) / (β * h**2), a)
        _, iterations = self.newton.solve(predictor, y)
        a1.waxpy(-1.0, base, system.q1)
        a1.scale(1 / (β * h**2))
        self._v1.waxpy(h * (1 - γ), self._a0, system.v0)
        self._v1.axpy(h * γ, a1)
        system.accept(self._v1)
        a1.copy(self._a0)
        return iterations
