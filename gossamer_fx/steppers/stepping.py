"""How a run makes its steps: what a stepper is, and steps of one length."""

from __future__ import annotations

import math
from typing import Protocol, runtime_checkable

from gossamer_fx.checks.errors import StepFailure, check
from gossamer_fx.solvers.failures import NotConverged
from gossamer_fx.solvers.newton import Newton
from gossamer_fx.system.system import System
from gossamer_fx.terms.discrete_gradient import StressRule

ROUND_OFF = 1e-10  # relative difference of a step from the wanted one that comes from summing times


class StepSolver(Protocol):
    """A time stepper at work on a system."""

    newton: Newton

    def step(self, h: float) -> int:
        """Advance by h, return the iterations; raise `NotConverged` and change nothing."""
        ...


@runtime_checkable
class Stepper(Protocol):
    """A time stepper: its step, and the rule by which it takes stresses."""

    @property
    def dt(self) -> float: ...

    @property
    def rule(self) -> StressRule: ...

    def start(self, system: System) -> StepSolver: ...


class Stepping(Protocol):
    """A choice of steps at work: the length `wanted` [s] for the next, and what was done so far."""

    wanted: float
    iterations: int
    substeps: int

    def advance(self, h: float) -> None:
        """Go on by h, or by less.

        Raises:
            StepFailure: it did not converge, also not in smaller steps; those that did are kept.
        """
        ...


@runtime_checkable
class Control(Protocol):
    """A choice of the lengths of steps."""

    def start(self, system: System, solver: StepSolver, dt: float) -> Stepping:
        """Choose the steps of a run, of which the first has the length dt [s]."""
        ...


class EqualSteps:
    """Steps of one length; one that does not converge is made of two halves, and so on."""

    def __init__(self, system: System, solver: StepSolver, dt: float, halvings: int) -> None:
        check(
            halvings >= 0,
            f"halvings is {halvings!r}; give the number of times that a step may be halved, or zero.",
        )
        self._system, self._solver, self._halvings = system, solver, halvings
        self.wanted, self.iterations, self.substeps = dt, 0, 0

    def advance(self, h: float) -> None:
        self._attempt(h, self._halvings)

    def _attempt(self, h: float, halvings: int) -> None:
        failure = None
        try:
            self.iterations += self._solver.step(h)
        except NotConverged as error:
            failure = str(error)
        # here, so that the error of a half does not show the errors of all that it is a half of
        if failure is not None:
            if halvings == 0:
                raise step_failure(self._system, h, failure)
            self.substeps += 1
            self._attempt(h / 2, halvings - 1)
            self._attempt(h / 2, halvings - 1)


def even_step(left: float, wanted: float) -> float:
    """The length of steps that meet a time `left` seconds away, each no longer than wanted, or hardly so.

    It is the wanted one itself if it differs by round-off, so that a run does not depend on where it was to end.
    """
    even = left / math.ceil(left / wanted - 1e-6)
    return wanted if abs(even - wanted) <= ROUND_OFF * wanted else even


def step_failure(system: System, h: float, reason: object) -> StepFailure:
    """The error of a step of length h that cannot be made smaller."""
    return StepFailure(
        f"The step at t = {system.time:.9g} s failed, also in sub-steps of {h:.3g} s: {reason}."
    )
