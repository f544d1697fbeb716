"""The energy-conserving midpoint rule."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field
from typing import Any

from petsc4py import PETSc

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import Inadmissible, NotConverged
from gossamer_fx.mechanics.terms.discrete_gradient import EndPoint as EndPoint
from gossamer_fx.mechanics.terms.discrete_gradient import PathAverage as PathAverage
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule
from gossamer_fx.solve.solvers.convergence import Tolerances
from gossamer_fx.solve.solvers.newton import Newton
from gossamer_fx.solve.steppers.stepping import check_step
from gossamer_fx.solve.system.system import System

# Number of tangents at the start of a step without geometric stiffness, by delay level.  A failed
# iteration is repeated at the next level, so that steps which converge at once pay nothing.
GEOMETRIC_STIFFNESS_DELAYS = (0, 20)

# Converged steps in a row after which the delay level is lowered by one.  Where no level helped,
# delays are not tried again for as many steps: the repeated iterations would be wasted.
STEPS_PER_DELAY_LEVEL = 20


@check_arguments
@dataclass(frozen=True)
class Midpoint:
    """Implicit midpoint rule with path-averaged stress: second order in `dt`.

        (q1 - q0)/h = (v0 + v1)/2
        M (v1 - v0)/h + De(q_mid)ᵀ S_avg = F_mid,    q_mid = (q0 + q1)/2

    The stress S_avg is the average of ψ'(e) over the straight path from e(q0) to e(q1), see
    `terms.discrete_gradient`.  It conserves energy, momentum and angular momentum to the tolerance
    of the nonlinear solve, for every step size and every sequence of step sizes (Simo & Tarnow,
    ZAMP 43 (1992) 757, doi:10.1007/BF00913408).

    Args:
        dt: step [s].
        rule: stress in a step; the default conserves energy.
        tolerances: when a step counts as solved.

    Raises:
        InputError: dt is not a positive number.

    Example:
        >>> run = gx.Simulation(gx.Scene(hub), gx.Midpoint(dt=0.1))
        >>> run.run(until=1.0)
        >>> run.step
        10
    """

    dt: float
    rule: StressRule = field(default_factory=PathAverage)
    _: KW_ONLY
    tolerances: Tolerances = field(default_factory=Tolerances)

    def __post_init__(self) -> None:
        check_step(self)

    def start(self, system: System) -> MidpointSolver:
        """The rule at work on a compiled system, whose state is the initial one."""
        return MidpointSolver(system, self.tolerances)


class MidpointSolver:
    """Makes steps of the midpoint rule on a compiled system, one at a time; the rule has no history
    variables."""

    def __init__(self, system: System, tolerances: Tolerances) -> None:
        self._system = system
        self.newton = Newton(system, tolerances)
        # Distributed vectors: predicted increment of the coordinates [m], and velocity at the end
        # of the step [m/s].
        self._increment = system.numbering.vector()
        self._v1 = system.numbering.vector()
        self._delay_level = 0  # index in GEOMETRIC_STIFFNESS_DELAYS
        self._successes = 0  # converged steps in a row since the last change of level or failure
        self._steps_without_delay = 0  # steps for which delays are not tried, as they did not help
        self.vectors: dict[str, PETSc.Vec] = {}

    def get_history(self) -> dict[str, Any]:
        # The names are part of the format of checkpoint files.
        return {
            "care": self._delay_level,
            "easy": self._successes,
            "useless": self._steps_without_delay,
        }

    def set_history(self, state: dict[str, Any]) -> None:
        self._delay_level = state["care"]
        self._successes = state["easy"]
        self._steps_without_delay = state["useless"]

    def step(self, h: float) -> int:
        """Make a step of length h [s], and return its Newton iterations.

        An iteration that fails is repeated with more tangents at its start without geometric
        stiffness, the part proportional to the stress, before the step is given up; after recent
        failures of all of them only the present number is tried.  An inadmissible solution is not
        retried: the same one would be found.  Collective.
        """
        while True:
            self.newton.geometric_stiffness_delay = GEOMETRIC_STIFFNESS_DELAYS[self._delay_level]
            try:
                iterations = self._attempt(h)
            except Inadmissible:
                self._successes = 0
                raise
            except NotConverged:
                self._successes = 0
                if not self._raise_delay():
                    raise
            else:
                self._note_success()
                return iterations

    def _raise_delay(self) -> bool:
        """Let more tangents at the start of a step be without geometric stiffness, after a failure;
        False if the number is the largest one already, or if such delays did not help recently."""
        is_highest = self._delay_level + 1 == len(GEOMETRIC_STIFFNESS_DELAYS)
        if self._steps_without_delay or is_highest:
            self._delay_level = 0
            self._steps_without_delay = STEPS_PER_DELAY_LEVEL
            return False
        self._delay_level += 1
        return True

    def _note_success(self) -> None:
        """Count a converged step, and lower the delay level after enough of them."""
        self._successes += 1
        self._steps_without_delay = max(self._steps_without_delay - 1, 0)
        if self._delay_level and self._successes >= STEPS_PER_DELAY_LEVEL:
            self._delay_level -= 1
            self._successes = 0

    def _attempt(self, h: float) -> int:
        """Solve one step of length h [s] by Newton's method and, if it converges, commit it;
        returns the number of iterations.  Collective."""
        system = self._system
        # The vector of unknowns in which the iteration starts.
        y = system.begin_step(h)
        # Predictor of constant velocity, p = h v0, which w [m] corrects; its inertia is M (v1 -
        # v0)/h = (2/h²) M w.
        system.v0.copy(self._increment)
        self._increment.scale(h)
        system.set_inertia(2 / h**2)
        w, _, iterations = self.newton.solve(self._increment, y)
        # v1 = 2 (q1 - q0)/h - v0 with q1 - q0 = h v0 + w.
        self._v1.waxpy(2 / h, w, system.v0)
        system.commit(self._v1)
        return iterations
