"""The run of a scene in time: the loop over steps, with outputs, events, checkpoints and signals.

Algorithm of `Simulation`.

1. Compile the scene, begin a step and undo it, so that errors of loads and motions come before any
   file.
2. Lock the files of the outputs, restore a checkpoint if there is one to restart from, open the
   outputs.
3. Step from one time that must be met to the next, in steps of equal length (`run`).
4. After each step: outputs record, then a checkpoint is written if it is due.

The order in 4 makes a restart exact: a checkpoint contains the positions of the outputs after its
step.

Errors and signals.  A step that fails leaves the state before it, which outputs record and a
checkpoint keeps; then the error is raised on all ranks.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gossamer_fx.core.checks.arguments import check_arguments, collective
from gossamer_fx.core.checks.ending import (
    Interrupted,
    Listener,
    abort_on_lone_error,
    agree_on_error,
)
from gossamer_fx.core.checks.errors import InputError, NotConverged, OutputFailure, check
from gossamer_fx.core.checks.relations import at_most_one, only_with
from gossamer_fx.core.model.state import Sampled
from gossamer_fx.records.outputs.output import Output, begin, cursors_of
from gossamer_fx.records.run.log import LOGGER
from gossamer_fx.solve.scene.scene import Scene
from gossamer_fx.solve.steppers.history import History
from gossamer_fx.solve.steppers.stepping import (
    Carrier,
    EqualSteps,
    Stepper,
    Stepping,
    even_step,
    switch_constraints,
)
from gossamer_fx.solve.system.totals import Totals
from gossamer_fx.solve.view import (
    TIME,
    Account,
    ClosingErrors,
    SteppedRun,
    chamber_state,
    chamber_states,
)

if TYPE_CHECKING:
    from gossamer_fx.mechanics.gas.contract import ChamberState
    from gossamer_fx.records.outputs.run_file import FileLocks
    from gossamer_fx.records.run.checkpoint import Checkpoints
    from gossamer_fx.records.run.events import Event, EventMonitor
    from gossamer_fx.records.run.undamped_films import UndampedFilms
    from gossamer_fx.solve.steppers.step_control import StepControl

# Counters that a checkpoint contains, and a restart continues.
_COUNTS = ("step", "iterations", "substeps", "last_iterations", "seconds")

# A time is met if it differs by less than this fraction of a step.
_SAME_TIME = 1e-9
# Most steps of equal length of a run: years, at a millisecond for each.
MAX_STEPS = 1e11
# Rejected steps are cut to 1/256 of their length at most, unless told otherwise.
HALVINGS = 8


@check_arguments(
    only_with("changes", "restart"),
    at_most_one("control", "halvings", give="the control a min_step instead"),
)
class Simulation(SteppedRun):
    """A run of a scene in time.

    Args:
        scene: bodies, gas, constraints, loads, contacts.
        stepper: time stepping rule, e.g. `Midpoint(dt=1e-3)`.
        outputs: e.g. `Series`, `Recording`, `Ledger`, `outputs.Progress`.
        halvings: how often a step that does not converge may be halved, 8 times by default;
            without a control, whose `min_step` limits that.
        control: adapts the length of steps; None: steps of the stepper's dt.
        events: `At` or `When`.
        checkpoints: where and how often the run is saved.
        restart: a checkpoint, or a folder, of which the newest is taken, from which the run
            continues.
        changes: names of items and events whose arguments are meant to differ from the
            checkpoint's.

    Attributes:
        axis: of records: the time.
        system: the compiled scene, with its state.
        step: number of steps that were made.
        iterations: Newton iterations of all steps.
        last_iterations: Newton iterations of the last step.
        substeps: rejected steps.
        seconds: wall time of all steps [s].
        compile_seconds: wall time of the compilation [s].
        output_seconds: wall time of outputs and checkpoints [s].
        first: energies, momenta and masses at the start.

    Raises:
        InputError: names what is wrong with the scene or the outputs, or the files that another run
            writes; nothing has been computed then.

    Example:
        >>> ball = gx.PointMass(2.0, position=(0.0, 0.0, 1.0), comm=comm, name="ball")
        >>> scene = gx.Scene(ball, gx.Gravity(ball, (0.0, 0.0, -9.81)))
        >>> fall = gx.Simulation(scene, gx.Midpoint(dt=0.05))
        >>> fall.run(until=0.4)
        >>> fall.step
        8
        >>> height = gx.probes.Position(ball.port(), "z")(fall)
        >>> round(height, 4)  # 1 - g t²/2
        0.2152
    """

    axis = TIME

    @collective
    def __init__(
        self,
        scene: Scene,
        stepper: Stepper,
        *,
        outputs: Sequence[Output] = (),
        halvings: int | None = None,
        control: StepControl | None = None,
        events: Sequence[Event] = (),
        checkpoints: Checkpoints | None = None,
        restart: str | Path | None = None,
        changes: Sequence[str] = (),
    ) -> None:
        """Compile the scene and open the outputs; with `restart`, read the checkpoint.
        Collective."""
        self.outputs = list(outputs)
        self.scene = scene
        self.stepper = stepper
        self.checkpoints = checkpoints
        self.comm = scene.comm
        started = time.perf_counter()
        self.system = scene.compile(stepper.rule)
        self.solver = stepper.start(self.system)
        self.stepping: Stepping
        if control is None:
            most = HALVINGS if halvings is None else halvings
            self.stepping = EqualSteps(self.system, self.solver, stepper.dt, most)
        else:
            self.stepping = control.start(self.system, self.solver, stepper.dt)
        self.compile_seconds = time.perf_counter() - started
        carriers: list[Carrier] = [self.solver]
        if isinstance(self.stepping, Carrier):
            carriers.append(self.stepping)
        self.history = History(self.system, carriers)
        self.step = 0
        self.iterations = 0
        self.substeps = 0
        self.last_iterations = 0
        self.seconds = 0.0
        self.output_seconds = 0.0
        self.until = 0.0
        self.first = self.system.balance.totals()
        self._totals = self.first
        # Residuals are compared with the largest energy so far, see `solvers.newton`.
        self.solver.newton.largest_energy = self.first.size
        self._monitor = self._monitor_of(events)
        self._sampled = [item for item in self.system.unknowns.items if isinstance(item, Sampled)]
        self._undamped: UndampedFilms | None = None
        # A restarted run has had its start: the events at the start, and the record of that state.
        self._started = restart is not None
        self.recorded = restart is not None  # whether the outputs have recorded the present state
        self._offered = restart is not None  # whether they were asked to, also if one failed
        self.cursors: list[tuple[str, dict[str, Any]]] = []
        self._try_step()
        # The description costs a pass over all meshes and arguments.
        self._description: dict[str, Any] = {}
        if restart is not None or checkpoints is not None:
            self._description = self.describe()
        self._locks = self._lock_files()
        self._control = control
        self._running = False
        try:
            cursors: list[tuple[str, dict[str, Any]]] = []
            if restart is not None:
                cursors = self._restart(restart, changes)
            if checkpoints is not None:
                checkpoints.open(self, self._description, restart)
            for output in self.outputs:
                begin(self, output, cursors)
        except Exception:
            self._release()
            raise

    def __repr__(self) -> str:
        """Where the run is; without energies, which are sums over all ranks."""
        names = ", ".join(f"'{body.name}'" for body in self.scene.bodies)
        return f"<Simulation of {names or 'gas'} at t = {self.time:.6g} s, step {self.step}>"

    def _try_step(self) -> None:
        """Begin a step and undo it: errors of loads, valves and motions come before files are
        made."""
        start = self.history.save()
        # Whether the first step converges is not of interest here.
        with suppress(NotConverged):
            self.system.equations.begin_step(self.stepping.wanted)
            self.system.equations.predict(self.system.unknowns.numbering.vector())
        self.history.restore(start)

    def _lock_files(self) -> FileLocks | None:
        """Lock all files and folders that this run writes; None if there are none.  Collective."""
        paths: list[Path] = []
        for output in self.outputs:
            paths += output.writes
        if self.checkpoints is not None:
            paths.append(self.checkpoints.folder)
        if not paths:
            return None
        # Imported here, as in the following functions: a run that writes nothing does not need it.
        from gossamer_fx.records.outputs.run_file import FileLocks

        return FileLocks(self.comm, paths)

    def _release(self) -> None:
        """Let other runs write the files of this one."""
        if self._locks is not None:
            self._locks.running = False
            self._locks.release()

    def _monitor_of(self, events: Sequence[Event]) -> EventMonitor | None:
        """The monitor of the events; None if there are none."""
        if not events:
            return None
        from gossamer_fx.records.run.events import EventMonitor

        return EventMonitor(self, events, self.history)

    def describe(self) -> dict[str, Any]:
        """Description of the scene at the start of the run, see `run.checkpoint`.  Collective."""
        from gossamer_fx.records.run.checkpoint import scene_of

        events = self._monitor.describe() if self._monitor else {}
        return scene_of(self, self.stepper, self.history, events)

    def _restart(
        self,
        restart: str | Path,
        changes: Sequence[str],
    ) -> list[tuple[str, dict[str, Any]]]:
        """Restore the state of a checkpoint, and return the cursors of its outputs.  Collective."""
        from gossamer_fx.records.run.checkpoint import read

        cursors = read(self, restart, self._description, changes)
        self.log(f"restarted at t = {self.time:.9g} s, step {self.step}")
        if self._monitor:
            self._monitor.repeat()
        return cursors

    # ---- the state of the run --------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time of the state [s]."""
        return self.system.unknowns.time

    @property
    def totals(self) -> Totals:
        """Energies [J], momenta and masses [kg] of the state.  Collective."""
        # Several outputs ask after each step; the sums are made once.
        if self._totals.time != self.time:
            self._totals = self.system.balance.totals()
        return self._totals

    @property
    def at_rest(self) -> bool:
        """Whether no energy of the run so far was larger than what round-off gives to a scene at
        rest."""
        return self.largest_energy <= self.solver.newton.round_off_energy

    @property
    def energy_error(self) -> float:
        """Closing error of the energy balance, over the largest energy at the end of a step so far;
        zero at rest."""
        if self.at_rest:
            return 0.0
        return self.energy_defect / self.largest_energy

    @property
    def energy_defect(self) -> float:
        """Closing error of the energy balance [J]: the energy that was gained since the start, less
        what was supplied and not dissipated."""
        now = self.totals
        return (now.energy - self.first.energy) - (now.supplied - now.dissipated)

    @property
    def largest_energy(self) -> float:
        """Largest energy so far [J]: kinetic and stored, or supplied and dissipated, whichever is
        more."""
        return max(self.solver.newton.largest_energy, self.totals.size)

    @property
    def mass_error(self) -> float:
        """Closing error of the gas masses, over the largest mass; 0 for a scene without gas."""
        now = self.totals
        if not now.mass:
            return 0.0
        missing = now.mass - self.first.mass - now.mass_supplied
        return missing / max(now.mass, self.first.mass)

    @property
    def account(self) -> Account:
        """Counters, wall times [s] and closing errors of the run so far.  Collective."""
        return Account(
            kind="run",
            method={"kind": type(self.stepper).__name__, "dt": self.stepper.dt},
            until=self.until,
            iterations=self.iterations,
            last_iterations=self.last_iterations,
            rejected=self.substeps,
            seconds=self.seconds,
            compile_seconds=self.compile_seconds,
            output_seconds=self.output_seconds,
            solver=self.solver.newton.summary(),
            balance=ClosingErrors(
                at_rest=self.at_rest,
                energy_error=self.energy_error,
                energy_defect=self.energy_defect,
                largest_energy=self.largest_energy,
                mass_error=self.mass_error,
            ),
        )

    @property
    def chambers(self) -> dict[str, ChamberState]:
        """States of the gas chambers and tanks by name; none if the scene has no gas."""
        return chamber_states(self.system)

    @check_arguments
    def chamber(self, name: str) -> ChamberState:
        """State of the gas in a chamber or tank.

        Args:
            name: of the chamber.

        Returns:
            `pressure` [Pa], `temperature` [K], `volume` [m³], `mass` [kg], `internal_energy` [J].

        Raises:
            InputError: the scene has no chamber of this name.
        """
        return chamber_state(self.system, name)

    # ---- running ---------------------------------------------------------------------------------

    @check_arguments
    @collective
    def run(self, until: float) -> None:
        """Advance to a time; may be called again with a later one.  `run.run(until=run.time +
        run.stepper.dt)` makes a single step.

        Steps are of equal length between the times that outputs and events ask for, so that these
        are met. SIGTERM, SIGINT and SIGUSR1 end the run after the present step, with a checkpoint
        if it writes any.

        Args:
            until: [s].

        Raises:
            InputError: `until` is not a time, or earlier than the present one; or a user's function
                failed.
            StepFailure: a step failed, also in sub-steps; the outputs are complete up to it.
            OutputFailure: a file could not be written; earlier records are kept.
            Interrupted: a signal came.
        """
        check(
            until >= self.time,
            f"until is {until!r} s, but the run is at t = {self.time:.9g} s; give a later time.",
        )
        check(
            not self._running,
            f"run: the run is at t = {self.time:.9g} s and goes on; an event cannot run it.",
        )
        steps = (until - self.time) / self.stepper.dt
        check(
            self._control is not None or steps <= MAX_STEPS,
            f"until is {until!r} s, {steps:.2g} steps of {self.stepper.dt:g} s away; give a larger "
            f"dt, or an earlier end, for {MAX_STEPS:g} steps at most.",
        )
        until = float(until)
        self.until = until
        if self._locks is not None:
            self._locks.acquire()
            self._locks.running = True
        # Signals are noted until all files are closed.
        with abort_on_lone_error(self.comm), Listener() as signals, ExitStack() as at_the_end:
            self._running = True
            at_the_end.callback(setattr, self, "_running", False)
            # Callbacks are called in reverse order: files are closed before they are released.
            at_the_end.callback(self._release)
            for output in self.outputs:
                at_the_end.callback(output.close, self)
            # Closing is collective: a rank that fails alone must end the program before it.
            with abort_on_lone_error(self.comm):
                self._start_and_go(until, signals)
                self._warn_of_undamped_films()
        signal = signals.heard(self.comm)
        if signal:
            self._leave(signal)

    def _start_and_go(self, until: float, signals: Listener) -> None:
        """Record the start, and step to a time or until a signal comes.  Collective.

        Args:
            until: end time [s].
        """
        ended = False
        if self._monitor is not None and not self._started:
            ended = self._monitor.start()
        self._started = True
        self._switch()
        if self.step == 0 and until > self.time:
            self._warn_of_sudden_starts(until)
        if not self.recorded:
            self._record(last=ended)
        # A signal may have come while the scene was made.
        if ended or signals.heard(self.comm):
            return
        times = {until}
        for output in self.outputs:
            times |= set(output.times)
        if self._monitor is not None:
            times |= set(self._monitor.times)
        milestones = sorted(t for t in times if self.time < t < until)
        self._go([*milestones, until], signals)

    def _warn_of_sudden_starts(self, until: float) -> None:
        """Warn of supports whose motion begins elsewhere than the body, or at another rate: the
        velocity would alternate from step to step.  Collective."""
        system = self.system
        first_step = min(self.stepping.wanted, until - self.time)
        sudden = system.unknowns.supports.sudden(
            system.unknowns.q0, system.unknowns.v0, self.time, first_step
        )
        for name, jump in sudden.items():
            if jump:
                LOGGER.warning(
                    "'%s' begins elsewhere than its body: a coordinate jumps by %.3g in the first "
                    "step, the length of which then sets its velocity; let the motion begin where "
                    "the body starts.",
                    name,
                    jump,
                )
                continue
            LOGGER.warning(
                "'%s' begins at another rate than the velocity of its body, so that the velocity "
                "will alternate from step to step; give the body the velocity or spin with which "
                "the motion begins, or let the motion begin smoothly.",
                name,
            )

    def _warn_of_undamped_films(self) -> None:
        """Warn of films that vibrate under the pressure of gas, undamped.  Collective."""
        if not self.chambers:
            return
        # Imported here, as scenes without gas must not pay for it.
        from gossamer_fx.records.run.undamped_films import UndampedFilms

        if self._undamped is None:
            self._undamped = UndampedFilms(self.system)
        self._undamped.warn(self.first, self.totals)

    def _go(self, milestones: Sequence[float], signals: Listener) -> None:
        """Step to each milestone in turn, a time that must be met.  Collective.

        Args:
            milestones: times [s] in increasing order; the last one is the end of the run.
        """
        for milestone in milestones:
            while True:
                remaining = milestone - self.time
                if remaining <= _SAME_TIME * self.stepping.wanted:
                    break
                try:
                    # The control may have changed the wanted length: divide the remaining time
                    # again.
                    h = even_step(remaining, self.stepping.wanted)
                    ended = self._advance(h, milestone)
                    ended = ended or signals.heard(self.comm) > 0
                    self._record(last=ended or self.time == milestones[-1])
                except Exception as error:
                    # `_save` is collective: all ranks must have the error.
                    agree_on_error(self.comm, error)
                    self._save()
                    raise
                if ended:
                    return

    def _record(self, last: bool) -> None:
        """Let the outputs record the state, and write a checkpoint if it is due.  Collective."""
        started = time.perf_counter()
        # If an output fails, a checkpoint must contain the positions in their files at which the
        # outputs were before this record.
        if self.checkpoints is not None:
            self.cursors = cursors_of(self.outputs)
        self._offered = True
        for output in self.outputs:
            output.record(self, last)
        self.recorded = True
        if self.checkpoints is not None:
            self.checkpoints.record(self, last)
        self.output_seconds += time.perf_counter() - started

    def _save(self) -> None:
        """After an error: let the outputs record the last good state, and write a checkpoint of it.

        If an output fails to record that state, the checkpoint contains the positions in their
        files at which the outputs were before that record; a restart removes what was written
        after them, and begins with recording the state.

        Nothing is raised for a file that cannot be written (`OutputFailure`), nor for a probe of an
        output that fails (`InputError`).  Collective.
        """
        # These errors are suppressed, as they would hide the one that ended the run.  A checkpoint
        # evaluates no probe, and raises no `InputError`.
        if not self._offered:
            with suppress(InputError, OutputFailure):
                self._record(last=True)
        if self.checkpoints is not None:
            with suppress(OutputFailure):
                self.checkpoints.record(self, last=True)

    def _advance(self, h: float, milestone: float = math.inf) -> bool:
        """Make a step and count it.  Collective.

        Args:
            h: length of the step [s]; a step control may make it shorter.
            milestone: time [s] that is set exactly if the step ends there but for round-off.
        """
        started = time.perf_counter()
        time_before = self.time
        stepping = self.stepping
        iterations = stepping.iterations
        substeps = stepping.substeps
        ended = False
        # Before the step is saved for a repetition, so that each sample is taken once.
        for item in self._sampled:
            h = item.before_step(self, h)
        try:
            if self._monitor:
                ended = self._monitor.advance(stepping, h)
            else:
                stepping.advance(h)
            self._switch()
        finally:
            self.last_iterations = stepping.iterations - iterations
            self.substeps += stepping.substeps - substeps
            # Sub-steps that were made before one failed count as a step, and the outputs record it.
            if self.time > time_before:
                self.iterations += self.last_iterations
                self.step += 1
                self.recorded = False
                self._offered = False
                newton = self.solver.newton
                newton.largest_energy = max(newton.largest_energy, self.totals.size)
            self.seconds += time.perf_counter() - started
        # Outputs and events that ask for this time must find it without the round-off of a sum of
        # steps.
        if abs(milestone - self.time) <= _SAME_TIME * stepping.wanted:
            self.system.unknowns.time = milestone
        return ended

    def _switch(self) -> None:
        """Engage and release latches for which an event or the user has asked.  Collective."""
        constraints = self.system.equations.constraints
        if constraints is None or not constraints.can_switch:
            return
        if switch_constraints(self.system):
            # `totals` compares times only, and the time is that before the impact.
            self._totals = self.system.balance.totals()

    def _leave(self, number: int) -> None:
        """Log where the run ended, and end the program."""
        interrupted = Interrupted(number)
        remedy = ""
        if self.checkpoints is not None and self.checkpoints.latest is not None:
            remedy = f"; restart from '{self.checkpoints.latest}'"
        LOGGER.warning(
            "stopped by %s at t = %.9g s, after step %d%s",
            interrupted.signal.name,
            self.time,
            self.step,
            remedy,
        )
        raise interrupted

    def log(self, words: str) -> None:
        """Write a line to the log, see `gx.run.log_to`."""
        LOGGER.info(words)

    # ---- checkpoints -----------------------------------------------------------------------------

    def get_history(self) -> dict[str, Any]:
        """Counters, first totals and events, for a checkpoint: numbers, words, lists, dictionaries.

        Energies are in J, times in s; the same on every rank.
        """
        events: dict[str, Any] = {"done": [], "last": []}
        if self._monitor:
            events = self._monitor.get_history()
        counts = {name: getattr(self, name) for name in _COUNTS}
        return {
            **counts,
            "first": self.first.as_data(),
            "largest energy": self.solver.newton.largest_energy,
            "round-off energy": self.solver.newton.round_off_energy,
            "recorded": self.recorded,
            "events": events,
        }

    def set_history(self, state: dict[str, Any]) -> None:
        """Restore the counters, energies and events of a checkpoint.  Collective.

        Args:
            state: what `get_history` returned.

        Raises:
            InputError: the probe of an event fails.
        """
        for name in _COUNTS:
            setattr(self, name, state[name])
        self.first = Totals.of_data(state["first"])
        self.solver.newton.largest_energy = state["largest energy"]
        self.solver.newton.round_off_energy = state["round-off energy"]
        # `totals` compares times only, and the restored state may have that of the start.
        self._totals = self.system.balance.totals()
        self.recorded = state["recorded"]
        if self._monitor:
            self._monitor.set_history(state["events"])
