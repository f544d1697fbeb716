"""How a run makes its steps: the contracts of steppers and step controls, steps of equal length,
and the jump of velocities between two steps where a constraint begins to hold.

Plastic impacts (`switch_constraints`).  A latch that engages stops the motion against it at once.
The velocities v⁺ behind the impact are those nearest to the velocities v⁻ before it, in the metric
of the mass, that keep all constraints e = 0:

    M (v⁺ - v⁻) + Deᵀ Λ = 0,    De v⁺ = 0

The impulses Λ act along gradients of the constraints, so that momentum and angular momentum stay as
they are.  The loss is the kinetic energy of the jump, ½ (v⁺ - v⁻)·M (v⁺ - v⁻).  The velocities of
supports do not change; the work of those that move counts as supplied.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from petsc4py import PETSc

import gossamer_fx.solve.solvers.factorisation as factorisation
from gossamer_fx.core.checks.errors import NotConverged, StepFailure, check
from gossamer_fx.mechanics.terms.assembly import HistoryVariables
from gossamer_fx.mechanics.terms.discrete_gradient import StressRule
from gossamer_fx.solve.solvers.newton import Newton
from gossamer_fx.solve.system.system import System

# Relative difference of a step from the wanted one that the summation of times explains.
ROUND_OFF = 1e-10

# A last step may exceed the wanted length by this fraction instead of being divided into two.
ALLOWED_EXCESS = 1e-6

# Smaller steps [s] make 1/h² in the equations overflow.
SMALLEST_STEP = 1e-100


class Carrier(HistoryVariables):
    """A stepper or step control with history variables.

    Attributes:
        vectors: of the system, which are copied, not replaced, when a state is restored.
    """

    vectors: Mapping[str, PETSc.Vec] = MappingProxyType({})

    def get_history(self) -> dict[str, Any]:
        return {}

    def set_history(self, state: dict[str, Any]) -> None:
        return


@dataclass(frozen=True, eq=False)
class Step:
    """A step that is solved and not yet accepted: one that is dropped has changed no state.

    Its vectors belong to the stepper, which overwrites them in the next step.  The coordinates at
    its end are q1 of the system.

    Attributes:
        length: h [s].
        velocities: v1 [m/s] at its end.
        iterations: of Newton's method.
        vectors: those of the stepper at its end, by their names in `StepSolver.vectors`.
    """

    length: float
    velocities: PETSc.Vec
    iterations: int
    vectors: Mapping[str, PETSc.Vec] = MappingProxyType({})


class StepSolver(Carrier):
    """A time stepper at work on a system.

    Attributes:
        newton: the solver of its equations.
        error_constant: C of the local error C h³ q''' of positions in a step of length h, by which
            `StepControl` chooses steps.
    """

    newton: Newton
    error_constant: float

    @abstractmethod
    def step(self, h: float) -> Step:
        """Solve a step of length h [s] from the state of the system, and return it; the state does
        not change before `accept`.  Collective.

        A step calls `system.equations.begin_step(h)`, `system.equations.set_inertia(c, offset)` and
        `newton.solve(increment, y)`, in this order.

        Raises:
            NotConverged: the step failed; a shorter one may be tried.
            Inadmissible: the solution cannot be accepted.
        """

    def accept(self, step: Step) -> None:
        """Make the end of the step that was solved last the state of the system.  Collective."""
        for name, end in step.vectors.items():
            end.copy(self.vectors[name])
        self.newton.system.commit(step.velocities)


class Stepper(ABC):
    """A time stepper, such as `Midpoint`.

    Attributes:
        dt: its first step [s].
        rule: which stress acts in a step.
    """

    dt: float
    rule: StressRule

    @abstractmethod
    def start(self, system: System) -> StepSolver:
        """The stepper at work on a compiled system."""


def check_step(stepper: Stepper) -> None:
    """Refuse a step that is not a finite number above 1e-100 s."""
    check(
        math.isfinite(stepper.dt) and stepper.dt > SMALLEST_STEP,
        f"{type(stepper).__name__}: dt is {stepper.dt!r}; give a positive step in seconds.",
    )


class Stepping(ABC):
    """A sequence of steps of a run.

    Attributes:
        wanted: length of the next step [s], unless the run must meet an earlier time.
        iterations: Newton iterations of all solved steps, accepted or not.
        substeps: number of rejected steps.
        recorders: called after each accepted step.
    """

    def __init__(self, solver: StepSolver, wanted: float) -> None:
        self._solver = solver
        self.wanted = wanted
        self.iterations = 0
        self.substeps = 0
        self.recorders: list[Callable[[], None]] = []

    def solve(self, h: float) -> Step:
        """Solve a step of length h [s], and count its iterations; see `StepSolver.step`."""
        step = self._solver.step(h)
        self.iterations += step.iterations
        return step

    def accept(self, step: Step) -> None:
        """Accept the step that was solved last, and record it.  Collective."""
        self._solver.accept(step)
        for recorder in self.recorders:
            recorder()

    @abstractmethod
    def advance(self, h: float) -> None:
        """Advance the run by h [s], or by less.  Collective.

        Raises:
            StepFailure: the step failed, also in the smallest sub-steps; sub-steps that converged
                remain.
        """


class Control(ABC):
    """A choice of step lengths, such as `StepControl`."""

    @abstractmethod
    def start(self, system: System, solver: StepSolver, dt: float) -> Stepping:
        """The steps of a run, the first of which has the length dt [s]."""


class EqualSteps(Stepping):
    """Steps of equal length dt [s]; a step that fails is divided into halves, and these again, down
    to dt/2^halvings."""

    def __init__(self, system: System, solver: StepSolver, dt: float, halvings: int) -> None:
        check(
            halvings >= 0,
            f"halvings is {halvings!r}; "
            "give the number of times that a step may be halved, or zero.",
        )
        super().__init__(solver, dt)
        self._system = system
        self._halvings = halvings

    def advance(self, h: float) -> None:
        """Advance the run by h [s], in one step or in its halves.  Collective."""
        self._attempt(h, self._halvings)

    def _attempt(self, h: float, halvings: int) -> None:
        """Make a step of length h [s], or its halves if it fails, which may be halved again; adds
        to `iterations` and `substeps`.  Collective."""
        failure = None
        try:
            self.accept(self.solve(h))
        except NotConverged as error:
            failure = str(error)
        # Outside the except clause: the traceback of a failed half would otherwise show the errors
        # of all longer steps, too.
        if failure is not None:
            if halvings == 0:
                raise step_failure(self._system, h, failure)
            self.substeps += 1
            self._attempt(h / 2, halvings - 1)
            self._attempt(h / 2, halvings - 1)


def even_step(remaining: float, wanted: float) -> float:
    """Length [s] of equal steps that end in `remaining` seconds, each at most `wanted` [s]:
    `even_step(1.0, 0.3) == 0.25`.

    A step may exceed `wanted` by the fraction `ALLOWED_EXCESS`, so that round-off in the remaining
    time does not cost another step.  It is exactly `wanted` if it differs from that by round-off,
    so that the steps of a run do not depend on the times at which it is stopped and restarted.
    """
    # A rest shorter than the allowed excess is one short step.
    count = max(1, math.ceil(remaining / wanted - ALLOWED_EXCESS))
    even = remaining / count
    if abs(even - wanted) <= ROUND_OFF * wanted:
        return wanted
    return even


def step_failure(system: System, h: float, reason: object) -> StepFailure:
    """The error for a step whose smallest sub-step, of length h [s], failed."""
    return StepFailure(
        f"The step at t = {system.unknowns.time:.9g} s failed, also in sub-steps of {h:.3g} s: "
        f"{reason}."
    )


def switch_constraints(system: System) -> bool:
    """Engage and release the constraints, such as latches, whose time has come; returns whether one
    has engaged, so that velocities have changed.  The loss of each is added to the balance.

    `InputError`: a latch would hold what is held already, or something that moves has no mass.
    Collective.
    """
    assert system.equations.constraints is not None, (
        "the caller asks whether constraints can switch"
    )
    has_changed = False
    # One after the other, so that each has a loss.
    for name in system.equations.constraints.switch():
        system.balance.losses[name] += _project_velocities(system, name)
        has_changed = True
    return has_changed


def _project_velocities(system: System, name: str) -> float:
    """Replace the velocities v⁻ of the system by v⁺, see the module, when the constraint of this
    name engages; returns this rank's share of the loss [J].  The work of moving supports is added
    to `EnergyBalance.supplied_energy`.  Collective."""
    constraints = system.equations.constraints
    assert constraints is not None
    multipliers = constraints.owned
    # Without multipliers the tangent of the constraints is De and its transpose.
    q = system.unknowns.q0.copy()
    q.array[multipliers] = 0.0
    system.equations.set_end(q)
    A = system.unknowns.M.copy()
    constraints.add_tangents(A)
    A.assemble()
    system.equations.set_end(system.unknowns.q0)
    # A v⁻ has De v⁻ in the rows of the multipliers.
    right = A.createVecLeft()
    A.mult(system.unknowns.v0, right)
    right.scale(-1.0)
    with right as values:
        values[: multipliers.start] = 0.0
        values[system.unknowns.supports.held] = 0.0
    reduced = A.copy()
    system.unknowns.supports.clear(reduced, 1.0)
    jump = A.createVecRight()
    problem = factorisation.solve(reduced, right, jump)
    check(
        not problem,
        f"'{name}' cannot be engaged: the velocities behind the impact are not determined "
        f"({problem}); give all that moves mass.",
    )
    # The impulses on held coordinates.
    A.mult(jump, right)
    held = system.unknowns.supports.held
    system.balance.supplied_energy += float(system.unknowns.v0.array_r[held] @ right.array_r[held])
    jump.array[multipliers] = 0.0
    system.unknowns.v0.axpy(1.0, jump)
    system.unknowns.M.mult(jump, right)
    loss = float(jump.array_r @ right.array_r) / 2
    for thing in (q, A, reduced, right, jump):
        thing.destroy()
    return loss
