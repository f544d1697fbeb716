"""The energy-conserving midpoint rule."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, field
from typing import Any

from petsc4py import PETSc

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.solvers.failures import Inadmissible, NotConverged
from gossamer_fx.solvers.newton import Newton
from gossamer_fx.solvers.tolerances import Tolerances
from gossamer_fx.system.system import System
from gossamer_fx.terms.discrete_gradient import PathAverage, StressRule

# Tangents of a step without geometric stiffness: at first none, and more each time that the iteration fails.  After
# `PATIENCE` steps that succeed there are fewer again; where none of these numbers helps, none is tried for as long.
CAREFUL, PATIENCE = (0, 3, 8, 20), 20


@check_arguments
@dataclass(frozen=True)
class Midpoint:
    """Implicit midpoint rule with path-averaged stress: second order in `dt` [s].

        (q1 - q0)/h = (v0 + v1)/2
        M (v1 - v0)/h + De(q̄)ᵀ S̄ = F̄

    Conserves energy, momentum and angular momentum to the tolerance of the nonlinear solve, for every step size and
    every sequence of them (Simo & Tarnow, ZAMP 43 (1992) 757, with the stress of `discrete_gradient.PathAverage`).

    `subdomains`, "bddc" or "fetidp", solves a single body by domain decomposition, each rank a subdomain.
    """

    dt: float
    rule: StressRule = field(default_factory=PathAverage)
    _: KW_ONLY
    tolerances: Tolerances = field(default_factory=Tolerances)
    subdomains: str | None = None

    def __post_init__(self) -> None:
        check(
            math.isfinite(self.dt) and self.dt > 1e-100,
            f"Midpoint: dt is {self.dt!r}; give a positive step in seconds.",
        )

    def start(self, system: System) -> MidpointSolver:
        return MidpointSolver(system, self.tolerances, self.subdomains)


class MidpointSolver:
    """One step at a time on a compiled system."""

    def __init__(
        self, system: System, tolerances: Tolerances, subdomains: str | None = None
    ) -> None:
        self._system = system
        self.newton = Newton(system, tolerances, subdomains=subdomains)
        self._increment, self._v1 = system.numbering.vector(), system.numbering.vector()
        self._care = 0  # index in CAREFUL
        self._easy = 0  # steps since it was raised
        self._useless = 0  # steps for which care need not be tried, as it did not help before
        self.vectors: dict[str, PETSc.Vec] = {}

    def get_state(self) -> dict[str, Any]:
        return {"care": self._care, "easy": self._easy, "useless": self._useless}

    def set_state(self, state: dict[str, Any]) -> None:
        self._care, self._easy, self._useless = state["care"], state["easy"], state["useless"]

    def step(self, h: float) -> int:
        """Advance by h; returns Newton's iterations.  Nothing has changed if it raises `NotConverged`.

        A step whose iteration fails is tried again with more careful starts, before it is given up; one that ended with
        what cannot be is not, as it would end there again.
        """
        while True:
            self.newton.careful = CAREFUL[self._care]
            try:
                iterations = self._attempt(h)
            except Inadmissible:
                self._easy = 0
                raise
            except NotConverged:
                self._easy = 0
                if self._useless or self._care + 1 == len(CAREFUL):
                    self._care, self._useless = 0, PATIENCE
                    raise
                self._care += 1
            else:
                self._easy, self._useless = self._easy + 1, max(self._useless - 1, 0)
                if self._care and self._easy >= PATIENCE:
                    self._care, self._easy = self._care - 1, 0
                return iterations

    def _attempt(self, h: float) -> int:
        system = self._system
        y = system.begin_step(h)
        system.v0.copy(self._increment)
        self._increment.scale(h)
        system.set_inertia(2 / h**2)
        w, _, iterations = self.newton.solve(self._increment, y)
        self._v1.waxpy(2 / h, w, system.v0)  # 2 (q1 - q0)/h - v0 with q1 - q0 = h v0 + w
        system.commit(self._v1)
        return iterations
