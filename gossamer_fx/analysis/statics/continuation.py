"""The search for a static equilibrium, also of films that wrinkle, from a first guess that need not
be near, and its progress on the standard error.

Problem.  Without inertia the tangent of slack or wrinkled film is singular or indefinite, and
Newton's iteration for De(q)ᵀψ'(e(q)) = F(q) converges only from a state close to the solution.

Idea.  Pseudo-transient continuation (Kelley & Keyes, SIAM J. Numer. Anal. 35 (1998) 508,
doi:10.1137/S0036142996304796): backward Euler steps from rest, with stress and loads at their end,

    M (q1 - q0)/h² + De(q1)ᵀψ'(e(q1)) = F(q1)                                                 (1)

The mass is the only regularisation.  With growing pseudo-steps h, (1) becomes the equation of
equilibrium.

Algorithm.

1. Solve (1) by Newton's iteration (`solvers.newton`) to the relative tolerance `inner_tolerance`.
2. If it fails, shorten h, and let a ceiling for h grow slowly from below the step that failed.  If
   it took few iterations, let h grow up to the ceiling.
3. Repeat until the unbalanced force without inertia is `tolerance` times the external force.
   Obstacles that move, move in a pseudo-step as far as bodies may stay where they are.
4. Solve once more without inertia, to see whether the tangent is regular.

A plate, or any film that resists compression, has an indefinite tangent until its wrinkles are
nearly those at rest.  Therefore a pseudo-step that fails is repeated with the geometric stiffness
of tension only.  This tangent bounds that of the energy from above, so that the iteration is slow
but goes down in energy.  If it helps, the following pseudo-steps use it from the start
(`_TensionOnly`).

Cost.  A spinning film takes 7 pseudo-steps of one iteration each, a clamped plate under pressure 5
to 7 with 8 to 11 iterations in all; plates that wrinkle take many more.

Progress.  A search of more than three seconds writes lines on the standard error
(`SearchProgress`). SIGINT (Ctrl-C) and SIGTERM end it after the present pseudo-step, whose state
is then that of the system.

Limits.  The path passes through states that are not in equilibrium, so that of several equilibria
the one that is found depends on the first guess and on the pseudo-steps.
"""

from __future__ import annotations

import logging
import math
import sys
import time
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.statics.prestress import PrestressOfScene, likely_tensions
from gossamer_fx.analysis.statics.remedies import (
    PressedFilm,
    collapsing_pressures,
    measure_pressed_films,
    remedies,
)
from gossamer_fx.core.checks.arguments import Range, check_arguments, positive
from gossamer_fx.core.checks.ending import Interrupted, Listener
from gossamer_fx.core.checks.errors import Inadmissible, NoEquilibrium, NotConverged
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.terms.element_energies import StoredEnergy
from gossamer_fx.records.outputs.progress import TERMINAL_INTERVAL, StatusLine
from gossamer_fx.solve.solvers.convergence import Tolerances
from gossamer_fx.solve.solvers.newton import Newton
from gossamer_fx.solve.system.residual_sizes import out_of_balance
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.view import chamber_states

# Wall time [s] before the first line: a search that is shorter says nothing.
QUIET_SECONDS = 3.0


@dataclass(frozen=True)
class SearchState:
    """Where a search stands after a pseudo-step: Newton iterations so far and at most,
    pseudo-steps, the length of the next one [s], the sum of those that succeeded [s], the
    unbalanced force over the load, and the value that it must reach."""

    iterations: int
    limit: int
    steps: int
    step: float
    pseudo_time: float
    residual: float
    tolerance: float


class SearchProgress:
    """Writes lines about a search that takes more than a few seconds, on rank 0."""

    def __init__(self, comm: MPI.Intracomm, unknowns: int, is_wanted: bool) -> None:
        self._writes = is_wanted and comm.rank == 0
        self._unknowns = unknowns
        self._line = StatusLine(sys.stderr, TERMINAL_INTERVAL, QUIET_SECONDS)

    def update(self, state: SearchState) -> None:
        """Write a line if enough time has passed."""
        if not self._writes or not self._line.is_due():
            return
        elapsed = time.monotonic() - self._line.started
        remaining = elapsed / max(state.iterations, 1) * max(state.limit - state.iterations, 0)
        residual = f"residual {state.residual:.1e} of {state.tolerance:.0e}"
        if math.isinf(state.residual):
            residual = "no pseudo-step has converged yet"
        self._line.write(
            f"equilibrium of {self._unknowns} unknowns: {residual}, "
            f"iteration {state.iterations} of at most {state.limit}, "
            f"pseudo-step {state.steps} of {state.step:.1e} s, "
            f"pseudo-time {state.pseudo_time:.1e} s, "
            f"{elapsed:.0f} s so far, at most {remaining:.0f} s left"
        )

    def close(self) -> None:
        """End the line on a terminal; a second call has no effect."""
        self._line.close()


# Displacement of a body over the size of the scene beyond which it is not held: without supports it
# moves farther with every pseudo-step.
MAX_RELATIVE_DISPLACEMENT = 1e3

# Size of the scene [m] that is assumed if all coordinates are smaller.
MIN_SCENE_SIZE = 1e-3

# Largest round-off of the inner forces, over the load, that may count as equilibrium.  In a slender
# beam or cable the forces are known to fewer digits than `Continuation.tolerance`.
MAX_ROUND_OFF = 1e-3

# Tangents at the start of a pseudo-step with the geometric stiffness of tension only: all of them.
ALL_TANGENTS = 10**6

# Largest number of pseudo-steps for which the geometric stiffness of tension only is used, or not
# tried.
MAX_DELAY_STEPS = 16

# Pseudo-steps over the first one.  Above the largest the inertia is round-off; below the smallest
# the continuation has failed.
MAX_STEP_RATIO = 1e9
MIN_STEP_RATIO = 1e-6

# Part of the way to the time that is asked for, below which obstacles do not move, but jump.
MIN_WAY_RATIO = 1e-6

# A pseudo-step that fails is cut to this share of its way, supports and obstacles included, and to
# `cut_factor` of its length.  A strip of rubber that is stretched to twice and three times its
# length at once takes 52 to 203 iterations with a quarter, 54 to 125 with an eighth, 41 to 196 with
# a sixteenth; a half fails.
ADVANCE_CUT = 1 / 8

# Tolerance of the equations of scalar unknowns and of constraints in a pseudo-step, and at the end.
INNER_TOLERANCE = 1e-8
FINAL_TOLERANCE = 1e-10

# The residual that Newton's iteration without inertia must reach, over that of the equilibrium, and
# the number of iterations that it has: a regular tangent needs two or three.
FINAL_REDUCTION = 1e-2
FINAL_ITERATIONS = 10

# Smallest load [N]: against division by zero, and so that a tolerance times it is still a number of
# a size that `Tolerances` accepts.
TINY = 1e-80

LOG = logging.getLogger("gossamer_fx")


# With a tolerance of 1 or more, the first guess would already be an equilibrium.
Fraction = Annotated[float, Range(0.0, 1.0, above=True, below=True)]


@check_arguments
@dataclass(frozen=True)
class Continuation:
    """How an equilibrium is approached; see the module for the algorithm.

    Args:
        tolerance: unbalanced force over that of loads and supports (Euclidean norms) at which
            equilibrium is reached.  The forces in a slender beam or cable may be known to fewer
            digits; their round-off is then enough.
        first_step: first pseudo-step [s]; about the time in which the load moves the film by its
            own size.
        growth_factor: factor of the pseudo-step after at most `fast_iterations` iterations.
        fast_iterations: Newton iterations up to which a pseudo-step grows.
        cut_factor: factor of the pseudo-step after a failure.
        cap_growth: growth per step of the ceiling that a failure leaves, below the pseudo-step that
            failed; its third power after a step of at most `fast_iterations`/3 iterations.
        inner_tolerance: relative residual to which a pseudo-step is solved.
        max_iterations: Newton iterations after which a pseudo-step has failed.
        total_iterations: Newton iterations in all after which the search is given up.

    Raises:
        InputError: a value is out of its range.

    Example:
        >>> gx.analysis.Continuation(first_step=1e-2).growth_factor
        1.6
    """

    _: KW_ONLY
    tolerance: Fraction = 1e-8
    first_step: Annotated[float, positive("s")] = 2e-3
    growth_factor: Annotated[float, Range(1.0, above=True)] = 1.6
    fast_iterations: Annotated[int, positive()] = 12
    cut_factor: Fraction = 0.5
    cap_growth: Annotated[float, positive()] = 1.1
    inner_tolerance: Fraction = 0.1
    max_iterations: Annotated[int, positive()] = 25
    total_iterations: Annotated[int, positive()] = 1000


class Search:
    """Looks for equilibria of a compiled scene, from its present state, by pseudo-steps.

    Attributes:
        options: how to look for them.
        newton: solver of the pseudo-steps.
        prestress: of the parts that have one.
        reached: time [s] of the loads and prescribed positions of the present state.
        iterations, steps, cuts: Newton iterations, pseudo-steps and failed ones of the last search.
    """

    def __init__(self, system: System, options: Continuation) -> None:
        self.system = system
        self.comm = system.comm
        self.options = options
        self.newton = Newton(system, Tolerances(), direct=True)
        self.prestress = PrestressOfScene(system)
        numbering = system.unknowns.numbering
        self._zero = numbering.vector()  # increment predicted, and velocity after a step
        self._residual = numbering.vector()
        self._start = numbering.vector()  # coordinates at the start of a search
        self._scene_size = max(system.unknowns.initial.extent(), MIN_SCENE_SIZE)
        self._resists_compression = any(
            isinstance(term, StoredEnergy) and term.pulling for term in system.unknowns.terms
        )
        self.reached = system.unknowns.time
        # Longest time [s] by which loads and obstacles advance in one pseudo-step.
        self._longest_advance = 0.0
        self.iterations = 0
        self.steps = 0
        self.cuts = 0

    def run(self, at: float, progress: bool) -> None:
        """Search under the loads of time `at` [s]; the state of the system is then the equilibrium.
        Raises what `Equilibrium.find` names.  Collective."""
        self.iterations = 0
        self.steps = 0
        self.cuts = 0
        self._longest_advance = abs(at - self.reached)
        self.system.unknowns.q0.copy(self._start)
        for kind in self.system.equations.compiled:
            kind.begin_search()
        if self.system.equations.active_sets:
            self._announce_load(at)
        self._warn_of_inward_normals(at)
        self._progress = SearchProgress(self.comm, self.system.unknowns.numbering.size, progress)
        try:
            with Listener() as signals:
                self._continue(at, signals)
        finally:
            self._progress.close()

    def _continue(self, at: float, signals: Listener) -> None:
        """Make pseudo-steps until the residual without inertia is small, under the loads of time
        `at` [s] and with contact that is stiff enough."""
        options = self.options
        tolerances = Tolerances(
            options.inner_tolerance,
            scalars=INNER_TOLERANCE,
            constraint=INNER_TOLERANCE,
            max_iterations=options.max_iterations,
        )
        h = options.first_step
        ceiling = math.inf
        residual = math.inf
        round_off = 0.0
        pseudo_time = 0.0
        reason = "none"
        tension_only = _TensionOnly(self._resists_compression)
        is_stiffened = False
        while (
            is_stiffened
            or self.reached != at
            or residual > max(options.tolerance, min(round_off, MAX_ROUND_OFF))
        ):
            self.newton.geometric_stiffness_delay = 0
            if tension_only.is_active:
                self.newton.geometric_stiffness_delay = ALL_TANGENTS
            try:
                used = self.step(h, at, tolerances)
            except NotConverged as failure:
                self.cuts += 1
                reason = str(failure)
                self._shorten_advance(at)
                if not tension_only.retry_after_failure():
                    ceiling = h * math.sqrt(options.cut_factor)
                    h = h * options.cut_factor
            else:
                tension_only.note_success()
                pseudo_time += h
                self._check_displacement()
                residual, load = self.unbalanced()
                round_off = self.newton.round_off / load
                # Contact whose stiffness was raised is not in equilibrium yet.
                stiffened = [
                    active_set.stiffen() for active_set in self.system.equations.active_sets
                ]
                is_stiffened = any(stiffened)
                # A pseudo-step need not be solved better than the equilibrium; half, for safety.
                tolerances = replace(tolerances, absolute=options.tolerance * load / 2)
                is_very_fast = used <= options.fast_iterations // 3
                exponent = 1
                if is_very_fast:
                    # The ceiling is far too low for such a step: let it rise within a few steps.
                    exponent = 3
                ceiling *= options.cap_growth**exponent
                if used <= options.fast_iterations:
                    h = min(h * options.growth_factor, ceiling, MAX_STEP_RATIO * options.first_step)
            self._progress.update(
                SearchState(
                    iterations=self.iterations,
                    limit=options.total_iterations,
                    steps=self.steps,
                    step=h,
                    pseudo_time=pseudo_time,
                    residual=residual,
                    tolerance=options.tolerance,
                )
            )
            self._leave_on_signal(signals, residual)
            is_exhausted = max(self.iterations, self.steps) > options.total_iterations
            if is_exhausted or h < MIN_STEP_RATIO * options.first_step:
                raise NoEquilibrium(
                    f"No equilibrium after {self.iterations} Newton iterations in {self.steps} "
                    f"pseudo-steps: {self._unbalanced_words(residual)}, "
                    f"pseudo-step {h:.1e} s; last failure: {reason}."
                    f"{remedies(self.system, chamber_states(self.system), self._pressed_films)}"
                )

    def _unbalanced_words(self, residual: float) -> str:
        """How far the search has come, from the residual over the load.  Collective."""
        if math.isinf(residual):
            return "no pseudo-step converged"
        return (
            f"the unbalanced force is {residual:.1e} of the load, "
            f"largest in {self.system.unknowns.locate(self._residual)}"
        )

    def _leave_on_signal(self, signals: Listener, residual: float) -> None:
        """End the search if a signal has come, with the state of the last pseudo-step in the
        system; `residual`, over the load, is for the log.  Collective."""
        number = signals.heard(self.comm)
        if not number:
            return
        self._progress.close()
        interrupted = Interrupted(number)
        unbalanced = self._unbalanced_words(residual)
        if self.comm.rank == 0:
            LOG.warning(
                "The search for an equilibrium was stopped by %s after %d Newton iterations "
                "in %d pseudo-steps: %s; the system has the state of the last pseudo-step.",
                interrupted.signal.name,
                self.iterations,
                self.steps,
                unbalanced,
            )
        raise interrupted

    def step(self, h: float, at: float, tolerances: Tolerances) -> int:
        """Make one pseudo-step (1) of length h [s], infinite for no inertia, under the loads of
        time `at` [s], or of one on the way there; return the number of Newton iterations.  If it
        fails the state of the system is unchanged."""
        system = self.system
        # Gas flows and dampers resist in the pseudo-time.  Without inertia it is so long that they
        # do not count.
        duration = h if math.isfinite(h) else self.options.first_step / MIN_STEP_RATIO
        time, y = self._begin_step(duration, at)
        system.equations.set_inertia(1 / h**2)
        self.newton.tolerances = tolerances
        self.steps += 1
        try:
            _, self._y, used = self.newton.solve(self._zero, y)
        except NotConverged:
            system.equations.set_end(system.unknowns.q0)
            raise
        finally:
            self.iterations += self.newton.iterations
            system.unknowns.time = time
        # The next pseudo-step starts from rest, too.
        system.commit(self._zero)
        system.unknowns.time = time
        self.reached = time
        self._longest_advance *= 2
        return used

    def _shorten_advance(self, at: float) -> None:
        """Let supports and obstacles move less far in the next pseudo-step than in the last one,
        and more slowly, as its length is cut by less.  In too short a pseudo-step inertia does not
        let a film follow its edge."""
        remaining = abs(at - self.reached)
        shorter = ADVANCE_CUT * min(self._longest_advance, remaining)
        if shorter > MIN_WAY_RATIO * remaining:
            self._longest_advance = shorter

    def _begin_step(self, duration: float, at: float) -> tuple[float, Array]:
        """Begin a pseudo-step at the latest time [s] on the way to `at` to which obstacles can move
        while bodies stay where they are: the advance is halved until they do.  Returns this time
        and the first guess of the scalar unknowns; raises `Inadmissible` if even a very short
        advance makes them penetrate."""
        remaining = at - self.reached
        while True:
            time = at
            if self._longest_advance < abs(remaining):
                time = self.reached + math.copysign(self._longest_advance, remaining)
            self.system.unknowns.time = time - duration
            try:
                return time, self.system.equations.begin_step(duration)
            except Inadmissible:
                self._longest_advance = abs(time - self.reached) / 2
                if self._longest_advance < MIN_WAY_RATIO * abs(remaining):
                    raise

    @property
    def unbalanced_forces(self) -> Array:
        """The forces [N] of the last `unbalanced`, of this rank's unknowns (n,)."""
        return self._residual.array_r.copy()

    def unbalanced(self) -> tuple[float, float]:
        """Residual without inertia over the external force, and the external force [N], in the
        state and with the scalar unknowns of the last pseudo-step that converged.  A thousand
        times the round-off of the inner forces replaces a smaller force: a scene without loads is
        in equilibrium when only round-off is left."""
        system = self.system
        system.equations.set_inertia(0.0)
        system.equations.residual(self._y, self._residual)
        external = float(system.equations.external_forces().norm())
        load = max(external, self.newton.round_off / MAX_ROUND_OFF, TINY)
        unbalanced, _ = out_of_balance(system.equations, self._residual)
        return unbalanced / load, load

    def solve_without_inertia(self, at: float) -> bool:
        """Whether Newton's iteration without inertia converges within ten iterations to a hundredth
        of the present residual, or of the tolerance if that is smaller.  If so, its solution is the
        new state of the system."""
        self.newton.geometric_stiffness_delay = 0
        residual, load = self.unbalanced()
        target = FINAL_REDUCTION * min(residual, self.options.tolerance) * load
        tolerances = Tolerances(
            relative=0.0, absolute=target, scalars=FINAL_TOLERANCE, max_iterations=FINAL_ITERATIONS
        )
        try:
            self.step(math.inf, at, tolerances)
        except NotConverged:
            return False
        return True

    @cached_property
    def _pressed_films(self) -> list[PressedFilm]:
        """What films under a pressure enclose, measured at the first search: no search changes to
        which side the normals of a stress-free shape point."""
        return measure_pressed_films(self.system)

    def _warn_of_inward_normals(self, at: float) -> None:
        """Warn of films that a pressure of time `at` [s] turns inside out: such a search takes
        hundreds of iterations."""
        for pressure in collapsing_pressures(self._pressed_films, at):
            if pressure.is_inwards and self.comm.rank == 0:
                LOG.warning("%s", pressure.words)

    def _announce_load(self, at: float) -> None:
        """Give contact the forces that it may have to carry, from which its stiffness follows:
        loads of time `at` [s], and tensions."""
        system = self.system
        duration = self.options.first_step
        system.unknowns.time = at - duration
        y = system.equations.begin_without_search(duration)
        system.unknowns.time = at
        system.equations.set_inertia(0.0)
        system.equations.set_end(system.unknowns.q0)
        system.equations.residual(y, self._residual)
        # Supports are left out: their reactions are those of the first guess.
        external = system.equations.external_forces()
        with external as values:
            values[system.unknowns.supports.held] = 0.0
        load, _ = out_of_balance(system.equations, external)
        tensions = self.prestress.tensions()
        if not load and not tensions:
            # Only obstacles and supports that move press on films, up to what these bear.
            tensions = likely_tensions(system)
        for active_set in system.equations.active_sets:
            active_set.set_static_load(load, tensions)

    def _check_displacement(self) -> None:
        """Check that nothing flies off: what is not held moves the farther, the longer the
        pseudo-step."""
        system = self.system
        displacement = np.abs(system.unknowns.q0.array_r - self._start.array_r)
        farthest = np.array(
            [
                displacement[system.unknowns.block(body).owned].max(initial=0.0)
                for body in system.unknowns.bodies
            ]
        )
        system.comm.Allreduce(MPI.IN_PLACE, farthest, op=MPI.MAX)
        k = int(farthest.argmax())
        if farthest[k] > MAX_RELATIVE_DISPLACEMENT * self._scene_size:
            raise NoEquilibrium(
                "No equilibrium: "
                f"'{system.unknowns.bodies[k].name}' has moved by {farthest[k]:.1e} m and moves "
                "on; hold it, or let the loads on it balance each other."
            )


class _TensionOnly:
    """Decides whether pseudo-steps have the geometric stiffness of tension only.

    It is tried after a failure.  The first time that it helps, it is dropped after one pseudo-step;
    each further failure doubles the number of pseudo-steps, up to `MAX_DELAY_STEPS`.  If it has
    never helped, it is not tried again for `MAX_DELAY_STEPS` pseudo-steps.  Without terms that
    resist compression it makes no difference, and is not possible.
    """

    def __init__(self, is_possible: bool) -> None:
        self._is_possible = is_possible
        self.is_active = False
        self._times_helped = 0
        self._remaining_steps = 0  # pseudo-steps until `is_active` may change

    def retry_after_failure(self) -> bool:
        """Adapt to a pseudo-step that failed; returns whether to repeat it with the same length."""
        has_helped = self._times_helped > 0
        if self.is_active:
            if not has_helped:
                self.is_active = False
                self._remaining_steps = MAX_DELAY_STEPS
            return False
        if not self._is_possible:
            return False
        if self._remaining_steps and not has_helped:
            return False
        self.is_active = True
        self._remaining_steps = min(2**self._times_helped, MAX_DELAY_STEPS)
        return True

    def note_success(self) -> None:
        """Adapt to a pseudo-step that converged."""
        self._remaining_steps = max(self._remaining_steps - 1, 0)
        if self.is_active and self._remaining_steps == 0:
            self._times_helped += 1
            self.is_active = False
