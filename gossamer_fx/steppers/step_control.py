"""Steps as long as Newton's iteration and the accuracy allow."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np
from petsc4py import PETSc

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.solvers.failures import NotConverged
from gossamer_fx.steppers.history import History
from gossamer_fx.steppers.stepping import StepSolver, step_failure
from gossamer_fx.system.system import System

SAFETY = 0.9


@check_arguments
@dataclass(frozen=True)
class StepControl:
    """Lets steps grow and shrink; the stepper's `dt` is the first.

    After a step of length h the next one is

        h · min(iterations/i, 0.9 (error/ε)^⅓, growth),    at least cut · h,

    i the Newton iterations that it took and ε its local error.  That of the midpoint rule, h³ q⃛/12, is taken from
    the mean accelerations of this step and the one before (no further solve), and measured as the root mean square
    over the mass, ε² = e·Me/m.  A step that fails, or whose error is too large, is made anew, shorter.  Energy,
    momenta and masses are conserved for every sequence of steps.

    Args:
        target_iterations: target of Newton iterations a step.
        error: largest local error of a step [m]; none: errors are not looked at.
        max_factor: largest ratio of a step to the one before; of film that strikes itself or snaps straight fewer
            steps fail with 1.1.
        min_factor: smallest ratio, and that after a failure.
        min_step: step [s] below which the run fails; default 1e-6 dt.
        max_step: [s]; default without limit.

    Source: the error constant is that of the trapezoidal rule, Hairer, Nørsett & Wanner, Solving Ordinary Differential
    Equations I (1993) §II.4, which has the choice of the step, too.
    """

    _: KW_ONLY
    target_iterations: int = 15
    error: float | None = None
    max_factor: float = 1.5
    min_factor: float = 0.5
    min_step: float | None = None
    max_step: float = math.inf

    def __post_init__(self) -> None:
        check(
            self.target_iterations >= 1,
            f"StepControl: target_iterations is {self.target_iterations!r}; aim at one or more.",
        )
        for name in ("error", "min_step", "max_step"):
            value = getattr(self, name)
            check(
                value is None or value > 0,
                f"StepControl: {name} is {value!r}; give a positive number.",
            )
        check(
            self.max_factor >= 1, f"StepControl: max_factor is {self.max_factor!r}; give 1 or more."
        )
        check(
            0 < self.min_factor < 1,
            f"StepControl: min_factor is {self.min_factor!r}; give a number between 0 and 1.",
        )

    def start(self, system: System, solver: StepSolver, dt: float) -> ControlledSteps:
        check(
            dt <= self.max_step,
            f"StepControl: max_step is {self.max_step!r} s, but the first step is {dt!r} s.",
        )
        return ControlledSteps(self, system, solver, dt)


class ControlledSteps:
    """Steps that a `StepControl` chooses."""

    def __init__(self, control: StepControl, system: System, solver: StepSolver, dt: float) -> None:
        self._control, self._system, self._solver = control, system, solver
        self._smallest = control.min_step or 1e-6 * dt
        self.wanted, self.iterations, self.substeps = dt, 0, 0
        self.vectors: dict[str, PETSc.Vec] = {}
        self._estimate: LocalError | None = None
        if control.error is not None:
            self._estimate = LocalError(system)
            self._history = History(system, [solver])
            self.vectors = {"acceleration": self._estimate.acceleration}

    def advance(self, h: float) -> None:
        """Go on by h, or by less.

        Raises:
            StepFailure: the smallest step failed.
        """
        if self._estimate:
            self._history.keep()
            self._estimate.begin()
        growth = self._control.max_factor
        while True:
            try:
                iterations = self._solver.step(h)
            except NotConverged as failure:
                factor, reason = self._control.min_factor, str(failure)
            else:
                self.iterations += iterations
                factor = self._factor(iterations, h)
                if factor > 0:
                    break
                factor, reason = -factor, f"its local error is above {self._control.error:.3g} m"
            self.substeps += 1
            growth, self.wanted, h = 1.0, factor * h, factor * h
            if h < self._smallest:
                raise step_failure(self._system, h, reason)
        if self._estimate:
            self._estimate.accept()
        proposed = h * min(factor, growth)
        if factor < 1 or proposed > self.wanted:
            self.wanted = min(proposed, self._control.max_step)

    def _factor(self, iterations: int, h: float) -> float:
        """Of the next step over this one of length h; negative if this one must be made anew, and has been undone."""
        control = self._control
        factor = control.target_iterations / max(iterations, 1)
        if self._estimate and control.error is not None:
            error = self._estimate(h)
            by_error = SAFETY * (control.error / error) ** (1 / 3) if error > 0 else math.inf
            if error > control.error:
                self._history.go_back()
                return -max(by_error, control.min_factor)
            factor = min(factor, by_error)
        return max(factor, control.min_factor)

    def get_state(self) -> dict[str, Any]:
        return {"wanted": self.wanted, "before": self._estimate.before if self._estimate else 0.0}

    def set_state(self, state: dict[str, Any]) -> None:
        self.wanted = state["wanted"]
        if self._estimate:
            self._estimate.before = state["before"]


class LocalError:
    """RMS [m] of e = h³/12 · 2 (a - a₋)/(h + h₋), a and a₋ the mean accelerations of a step and the one before."""

    def __init__(self, system: System) -> None:
        self._system = system
        self.acceleration, self._v, self._a, self._e, self._Me = (
            system.numbering.vector() for _ in range(5)
        )
        self.before = 0.0  # h₋; 0: there is none
        self._mass = self._total_mass()
        check(
            self._mass > 0,
            "StepControl: nothing in the scene has mass, whose error could be measured; leave error out.",
        )

    def _total_mass(self) -> float:
        """[kg]"""
        system, x = self._system, self._a
        with x as values:
            for body in system.bodies:
                values[system.block(body).owned].reshape(-1, body.block.size)[:, 0] = 1.0
        system.M.mult(x, self._Me)
        return float(x.dot(self._Me))

    def begin(self) -> None:
        """Start a step."""
        self._system.v0.copy(self._v)

    def __call__(self, h: float) -> float:
        """Of the step of length h that was made; zero if there was none before."""
        a, system = self._a, self._system
        a.waxpy(-1.0, self._v, system.v0)
        a.scale(1 / h)
        self._h = h
        if not self.before:
            return 0.0
        self._e.waxpy(-1.0, self.acceleration, a)
        system.M.mult(self._e, self._Me)
        return (
            h**3
            / 6
            / (h + self.before)
            * float(np.sqrt(max(self._e.dot(self._Me), 0.0) / self._mass))
        )

    def accept(self) -> None:
        """The step stands."""
        self._a.copy(self.acceleration)
        self.before = self._h
