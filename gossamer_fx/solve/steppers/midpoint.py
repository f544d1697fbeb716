"""The energy-conserving midpoint rule."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field
from typing import Any

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import Inadmissible, NotConverged
from gossamer_fx.mechanics.terms.discrete_gradient import EndPoint as EndPoint
from gossamer_fx.mechanics.terms.discrete_gradient import PathAverage as PathAverage
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule
from gossamer_fx.solve.solvers.convergence import Tolerances
from gossamer_fx.solve.solvers.newton import Newton
from gossamer_fx.solve.steppers.stepping import Step, Stepper, StepSolver, check_step
from gossamer_fx.solve.system.system import System

# Number of tangents at the start of a step without geometric stiffness, where a step is delayed.
# Only a step whose iteration has failed is, and those that follow, so that steps which converge at
# once pay nothing.  Of 10 steps of a packed sail that failed, 20 solved 8; 3 and 8 solved 5 and 7
# of these.
GEOMETRIC_STIFFNESS_DELAY = 20

# Converged steps in a row after which steps are no longer delayed.
DELAYED_STEPS = 20


@check_arguments
@dataclass(frozen=True)
class Midpoint(Stepper):
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


class MidpointSolver(StepSolver):
    """Makes steps of the midpoint rule on a compiled system, one at a time; the rule has no history
    variables."""

    def __init__(self, system: System, tolerances: Tolerances) -> None:
        self._system = system
        self.newton = Newton(system, tolerances)
        # Distributed vectors: predicted increment of the coordinates [m], and velocity at the end
        # of the step [m/s].
        self._increment = system.unknowns.numbering.vector()
        self._v1 = system.unknowns.numbering.vector()
        # Local error of positions over h³ q''': with the acceleration at the end of the step for
        # its mean it is ½ - 1/6, with that of its middle, or the mean of both ends, ¼ - 1/6.
        self.error_constant = 1 / 3 if system.unknowns.rule.acts_at_end else 1 / 12
        self._delayed_steps = 0  # converged steps in a row until steps are no longer delayed

    def get_history(self) -> dict[str, Any]:
        # The name is part of the format of checkpoint files; it was once a level of 0 to 3.
        return {"care": self._delayed_steps}

    def set_history(self, state: dict[str, Any]) -> None:
        self._delayed_steps = state["care"]

    def step(self, h: float) -> Step:
        """Solve a step of length h [s].

        An iteration that fails is repeated once: with tangents at its start without geometric
        stiffness, the part proportional to the stress, or with it, if the first attempt was
        without.  After a failure with it the next steps, also of a shorter length, begin without.
        An inadmissible solution is not retried: the same one would be found.  Collective.
        """
        is_delayed = self._delayed_steps > 0
        try:
            step = self._attempt(h, is_delayed)
        except Inadmissible:
            raise
        except NotConverged:
            self._delayed_steps = 0 if is_delayed else DELAYED_STEPS
            try:
                return self._attempt(h, not is_delayed)
            except NotConverged:
                self._delayed_steps = DELAYED_STEPS
                raise
        # Also where the step is not accepted: this is about iterations, not about the state.
        self._delayed_steps = max(self._delayed_steps - 1, 0)
        return step

    def _attempt(self, h: float, is_delayed: bool) -> Step:
        """Solve a step of length h [s] by Newton's method, at first without geometric stiffness if
        `is_delayed`.  Collective."""
        system = self._system
        self.newton.geometric_stiffness_delay = GEOMETRIC_STIFFNESS_DELAY * is_delayed
        # The vector of unknowns in which the iteration starts.
        y = system.equations.begin_step(h)
        # Predictor of constant velocity, p = h v0, which w [m] corrects; its inertia is M (v1 -
        # v0)/h = (2/h²) M w.
        system.unknowns.v0.copy(self._increment)
        self._increment.scale(h)
        system.equations.set_inertia(2 / h**2)
        w, _, iterations = self.newton.solve(self._increment, y)
        # v1 = 2 (q1 - q0)/h - v0 with q1 - q0 = h v0 + w.
        self._v1.waxpy(2 / h, w, system.unknowns.v0)
        return Step(h, self._v1, iterations)
