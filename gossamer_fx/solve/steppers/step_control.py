"""Steps as long as Newton's iteration and the accuracy allow.

Problem.  A structure that deploys is quiet at one time and hits itself at another; a constant step
is either too long for the one or too short for the other.

Idea.  The midpoint rule conserves energy, momenta and masses for every sequence of steps, so that
the length may be chosen by cost and accuracy alone.

Algorithm, for a step of length h that took i Newton iterations.

1. Estimate the local error of the stepper,

       e = C h³ q''',    q''' ≈ 2 (a - a_)/(h + h_)                                           (1)

   from the mean accelerations a = (v1 - v0)/h of this step and a_ of the one before, whose length
   is h_.  C is the error constant of the stepper: 1/12 of the midpoint rule, 1/12 + (α_m - α_f)²/4
   of the generalised-α method, 1/3 with the stress at the end of a step.  It is measured as root
   mean square over the mass of each connected part, of which the largest counts,

       ε = max √(eᵀ M e/m),    m the mass of the part                                         (2)

   so that a heavy body far away does not hide the error of a light one.

2. If ε exceeds the tolerance, drop the step and repeat it with h times

       max(0.9 (tolerance/ε)^(1/3), min_factor)                                                  (3)

3. If Newton's iteration fails, repeat the step with h times `min_factor`.
4. Otherwise the next step is h times

       max(min(target iterations/i, 0.9 (tolerance/ε)^(1/3), max_factor), min_factor)            (4)

   A step that was repeated does not let the next one grow.  ε counts as at least that of the step
   before times (h/h_)³: the third derivative of an oscillation vanishes for moments.

Source: Hairer, Nørsett & Wanner, Solving Ordinary Differential Equations I (1993), section II.4,
for the choice (3), (4).

Cost.  The estimate (1) costs one product with M and no further solve.

Limits.  The estimate exists from the second step on, and is that of smooth motion: impacts within a
step show only as a large difference of the accelerations.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.checks.arguments import Range, check_arguments, positive
from gossamer_fx.core.checks.errors import NotConverged, check
from gossamer_fx.core.checks.relations import rising
from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.steppers.stepping import (
    Carrier,
    Control,
    Step,
    Stepping,
    StepSolver,
    step_failure,
)
from gossamer_fx.solve.system.connected_parts import Labels, connected
from gossamer_fx.solve.system.system import System

# Factor in (3) and (4), so that the next step does not fail by a small growth of the error.
SAFETY_FACTOR = 0.9

# Smallest step over the first, unless given: a run whose steps are a million times shorter will not
# end.
SMALLEST_STEP_RATIO = 1e-6


@check_arguments(rising("min_step", "max_step"))
@dataclass(frozen=True)
class StepControl(Control):
    """Lets steps grow and shrink; the stepper's `dt` is the first step.

    See the module for the rule.  Energy, momenta and masses are conserved for every sequence of
    steps.

    Args:
        target_iterations: target of Newton iterations a step.
        error: largest local error of a step [m], as root mean square over the mass of each
            connected part of the scene; None: errors are not estimated.
        max_factor: largest ratio of a step to the one before.  For film that hits itself or snaps
            straight, 1.1 leads to fewer rejected steps.
        min_factor: smallest ratio of a step to the one before, and the ratio after a failure.
        min_step: shortest step [s], below which the run fails; default 1e-6 dt.
        max_step: longest step [s]; default without limit.

    Raises:
        InputError: a value is out of its range.

    Example:
        >>> control = gx.StepControl(max_factor=2.0)
        >>> run = gx.Simulation(gx.Scene(hub), gx.Midpoint(dt=0.1), control=control)
        >>> run.run(until=1.5)
        >>> run.step
        4
    """

    _: KW_ONLY
    target_iterations: Annotated[int, Range(1)] = 15
    error: Annotated[float, positive("m")] | None = None
    max_factor: Annotated[float, Range(1.0)] = 1.5
    min_factor: Annotated[float, Range(0.0, 1.0, above=True, below=True)] = 0.5
    min_step: Annotated[float, positive("s")] | None = None
    max_step: Annotated[float, positive("s")] = math.inf

    def start(self, system: System, solver: StepSolver, dt: float) -> ControlledSteps:
        """The steps of a run of a compiled system, whose lengths this control chooses, the first of
        them dt [s].  Errors cannot be measured without mass.  Collective."""
        check(
            dt <= self.max_step,
            f"StepControl: max_step is {self.max_step!r} s, but the first step is {dt!r} s.",
        )
        return ControlledSteps(self, system, solver, dt)


class ControlledSteps(Stepping, Carrier):
    """The steps of a run whose lengths a `StepControl` chooses; see `Stepping` for the
    attributes."""

    def __init__(self, control: StepControl, system: System, solver: StepSolver, dt: float) -> None:
        super().__init__(solver, dt)
        self._control = control
        self._system = system
        self._smallest = control.min_step or SMALLEST_STEP_RATIO * dt
        self.vectors: dict[str, PETSc.Vec] = {}
        self._local_error: LocalError | None = None
        self._tolerance = math.inf  # of the local error [m]
        # Local error of the last accepted step over the third power of its length [m/s³].
        self._error_rate = 0.0
        if control.error is not None:
            self._tolerance = control.error
            self._local_error = LocalError(system, _error_constant(solver))
            self.vectors = {"acceleration": self._local_error.acceleration}

    def advance(self, h: float) -> None:
        """Make a step of h [s], or a shorter one where Newton's iteration fails or the local error
        is above its tolerance, and choose the `wanted` length of the next one.  Collective."""
        growth = self._control.max_factor
        measured = 0.0
        while True:
            try:
                step = self.solve(h)
            except NotConverged as failure:
                factor = self._control.min_factor
                reason = str(failure)
            else:
                error = 0.0
                if self._local_error:
                    measured = self._local_error.measure(step)
                    # Where the third derivative of an oscillation changes its sign, the one before
                    # still counts: it grows again within the next step.
                    error = max(measured, self._error_rate * h**3)
                if not error > self._tolerance:
                    factor = self._next_factor(step.iterations, error)
                    break
                factor = max(self._factor_by_error(error), self._control.min_factor)
                reason = f"its local error is above {self._tolerance:.3g} m"
            self.substeps += 1
            # The step after a rejected one does not grow: it would probably be rejected, too.
            growth = 1.0
            h = factor * h
            self.wanted = h
            if h < self._smallest:
                raise step_failure(self._system, h, reason)
        self.accept(step)
        if self._local_error:
            self._local_error.commit()
            self._error_rate = measured / h**3
        proposed = h * min(factor, growth)
        # h may be shorter than wanted to meet a time.  That alone must not shorten the next step.
        if factor < 1 or proposed > self.wanted:
            self.wanted = min(proposed, self._control.max_step)

    def _factor_by_error(self, error: float) -> float:
        """Ratio of step lengths that brings a local error [m] below the tolerance, with safety."""
        if error > 0:
            return float(SAFETY_FACTOR * (self._tolerance / error) ** (1 / 3))
        return math.inf

    def _next_factor(self, iterations: int, error: float) -> float:
        """Ratio (4) of the next step to an accepted one, before `max_factor` limits it."""
        by_iterations = self._control.target_iterations / max(iterations, 1)
        factor = min(by_iterations, self._factor_by_error(error))
        return max(factor, self._control.min_factor)

    def get_history(self) -> dict[str, Any]:
        """The wanted length of the next step [s], and the last one [s], zero without estimates."""
        length_before = 0.0
        if self._local_error:
            length_before = self._local_error.length_before
        return {"wanted": self.wanted, "before": length_before, "error rate": self._error_rate}

    def set_history(self, state: dict[str, Any]) -> None:
        # A restart may bring another limit.
        self.wanted = min(state["wanted"], self._control.max_step)
        if self._local_error:
            self._local_error.length_before = state["before"]
            # Checkpoints of older versions do not have it.
            self._error_rate = state.get("error rate", 0.0)


def _error_constant(solver: StepSolver) -> float:
    """The constant C of (1) of a stepper; `InputError` if it has none."""
    constant = getattr(solver, "error_constant", None)
    check(
        isinstance(constant, float) and constant > 0,
        f"StepControl: error needs the constant of the local error of {type(solver).__name__}; "
        "give it an attribute error_constant, or leave error out.",
    )
    assert constant is not None
    return float(constant)


class LocalError:
    """Estimates the local error (1), (2) of a stepper with the error constant C.

    Call `measure` for each step that is solved, before it is accepted, and `commit` if it is.  It
    has the mean acceleration a_ [m/s²] of the last accepted step, and its length h_ [s], zero
    before the first step.
    """

    def __init__(self, system: System, constant: float = 1 / 12) -> None:
        self._system = system
        self._constant = constant
        self.acceleration = system.unknowns.numbering.vector()
        self.length_before = 0.0
        self._mean_acceleration = system.unknowns.numbering.vector()
        self._change = system.unknowns.numbering.vector()
        self._scratch = system.unknowns.numbering.vector()
        # e·M e of the unit translation e of all bodies along x, in which directors and multipliers
        # do not move.
        with self._change as values:
            for body in system.unknowns.bodies:
                nodes = values[system.unknowns.block(body).owned].reshape(-1, body.block.size)
                nodes[:, 0] = 1.0
        # Of all parts: which are connected is seen in the tangent of the first step.
        self._parts: Labels | None = None
        along_x = self._change.array_r.copy()
        system.unknowns.M.mult(self._change, self._scratch)
        self._masses_along_x: Array = along_x * self._scratch.array_r
        check(
            system.comm.allreduce(float(self._masses_along_x.sum())) > 0,
            "StepControl: nothing in the scene has mass, whose error could be measured; "
            "leave error out.",
        )

    def measure(self, step: Step) -> float:
        """Local error ε [m] of a step that is not yet accepted, by (1) and (2); zero for the first
        step of a run.  Collective."""
        h = step.length
        mean = self._mean_acceleration
        mean.waxpy(-1.0, self._system.unknowns.v0, step.velocities)
        mean.scale(1 / h)
        self._length = h
        if not self.length_before:
            return 0.0
        self._change.waxpy(-1.0, self.acceleration, mean)
        self._system.unknowns.M.mult(self._change, self._scratch)
        squares = self._sums(self._change.array_r * self._scratch.array_r)
        masses = self._sums(self._masses_along_x)
        # A part of multipliers only has no mass; round-off may make the square of a vanishing
        # change negative.
        has_mass = masses > 0
        mean_squares = np.maximum(squares[has_mass], 0.0) / masses[has_mass]
        largest = math.sqrt(float(mean_squares.max(initial=0.0)))
        return 2 * self._constant * h**3 / (h + self.length_before) * largest

    def _sums(self, values: Array) -> Array:
        """Sums of the values (n,) of this rank's unknowns over each connected part, (parts,).
        Collective."""
        comm = self._system.comm
        if self._parts is None:
            labels = connected(self._system, self._system.matrices.A, with_zeros=True)
            known = np.unique(np.concatenate(comm.allgather(np.unique(labels))))
            self._parts = np.searchsorted(known, labels).astype(np.int64)
            self._part_count = len(known)
        sums = np.bincount(self._parts, values, self._part_count).astype(float)
        comm.Allreduce(MPI.IN_PLACE, sums)
        return sums

    def commit(self) -> None:
        """Take the step that was measured last as the one before the next."""
        self._mean_acceleration.copy(self.acceleration)
        self.length_before = self._length
