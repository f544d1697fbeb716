"""Running a scene: the loop over steps, and what outputs look at."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from petsc4py import PETSc

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import InputError, OutputFailure, check
from gossamer_fx.checks.failures import NotConverged
from gossamer_fx.checks.lone_errors import abort_on_lone_error, agree_on_error
from gossamer_fx.outputs.output import Output, Writing, begin, cursors_of
from gossamer_fx.run.interruption import Interrupted, Listener
from gossamer_fx.run.log import LOGGER
from gossamer_fx.scene.scene import Scene
from gossamer_fx.steppers.history import History
from gossamer_fx.steppers.stepping import Control, EqualSteps, Stepper, Stepping, even_step
from gossamer_fx.system.totals import Totals

if TYPE_CHECKING:
    from gossamer_fx.gas.state import ChamberState
    from gossamer_fx.outputs.file_locks import FileLocks
    from gossamer_fx.run.checkpoint import Checkpoints
    from gossamer_fx.run.events import Event, EventMonitor
    from gossamer_fx.steppers.step_control import StepControl


_COUNTS = ("step", "iterations", "substeps", "last_iterations", "seconds")


@check_arguments
class Simulation:
    """A scene in time.

    Args:
        scene: what there is.
        stepper: e.g. `Midpoint(dt=1e-3)`.
        outputs: e.g. `VTX`, `Ledger`, `Probes`, `Picture`, `Progress`.
        halvings: how often a step that does not converge may be halved.
        control: lets steps grow and shrink; none: steps of the stepper's dt.
        events: `At` or `When` something happens.
        checkpoints: where the run is saved.
        restart: a checkpoint, or a folder of which the newest is taken: the run goes on from there.
        changes: names of the parts and events whose parameters are meant to differ from the checkpoint's.

    Raises:
        InputError: what is wrong with the scene or the outputs, or another run writes the same files; nothing has been
            computed then.
    """

    def __init__(
        self,
        scene: Scene,
        stepper: Stepper,
        *,
        outputs: Sequence[Output] = (),
        halvings: int = 8,
        control: StepControl | None = None,
        events: Sequence[Event] = (),
        checkpoints: Checkpoints | None = None,
        restart: str | Path | None = None,
        changes: Sequence[str] = (),
    ) -> None:
        self.outputs, events = (
            _several("outputs", outputs, Output),
            _several("events", events, object),
        )
        self.scene, self.stepper, self.checkpoints = scene, stepper, checkpoints
        check(
            control is None or isinstance(control, Control),
            f"control is {control!r}; give a StepControl, or None.",
        )
        check(
            restart is not None or not changes, "There are changes, but no restart; leave them out."
        )
        self.comm = scene.comm
        started = time.perf_counter()
        self.system = scene.compile(stepper.rule)
        self.solver = stepper.start(self.system)
        self.stepping: Stepping = EqualSteps(self.system, self.solver, stepper.dt, halvings)
        if control is not None:
            self.stepping = control.start(self.system, self.solver, stepper.dt)
        self.compile_seconds = time.perf_counter() - started
        self.history = History(self.system, [self.solver, self.stepping])
        self.step = self.iterations = self.substeps = self.last_iterations = 0
        self.seconds = self.output_seconds = 0.0
        self.until = 0.0
        self.first = self._totals = self.system.totals()
        self.solver.newton.energy = self.first.size
        self._watch = self._watch_for(events)
        # whether the first step was begun, the outputs have recorded the present state, or were asked to
        self._started = self.recorded = self._offered = restart is not None
        self.cursors: list[tuple[str, dict[str, Any]]] = []
        self._try_step()
        self._about = self.describe() if restart is not None or checkpoints is not None else {}
        self._locks = self._lock_files()
        try:
            cursors = [] if restart is None else self._restart(restart, changes)
            if checkpoints is not None:
                checkpoints.open(self, self._about, restart)
            for output in self.outputs:
                begin(self, output, cursors)
        except Exception:
            self._release()
            raise

    def _try_step(self) -> None:
        """Begin a step and go back: what is wrong with loads, valves and motions is told before files are made."""
        self.history.commit()
        with suppress(NotConverged):
            self.system.begin_step(self.stepping.wanted)
            self.system.predict(self.system.numbering.vector())
        self.history.rollback()

    def _lock_files(self) -> FileLocks | None:
        paths = [
            path for output in self.outputs if isinstance(output, Writing) for path in output.writes
        ]
        paths += [] if self.checkpoints is None else [self.checkpoints.folder]
        if not paths:
            return None
        from gossamer_fx.outputs.file_locks import FileLocks

        return FileLocks(self.comm, paths)

    def _release(self) -> None:
        if self._locks is not None:
            self._locks.running = False
            self._locks.release()

    def _watch_for(self, events: Sequence[Event]) -> EventMonitor | None:
        if not events:
            return None
        from gossamer_fx.run.events import EventMonitor

        return EventMonitor(self, events, self.history)

    def describe(self) -> dict[str, Any]:
        """What tells this run from others, at its start; for checkpoints."""
        from gossamer_fx.run.same_scene import scene_of

        return scene_of(self, self._watch.describe() if self._watch else [])

    def _restart(
        self, restart: str | Path, changes: Sequence[str]
    ) -> list[tuple[str, dict[str, Any]]]:
        """Take the state of a checkpoint; returns where its outputs stood."""
        from gossamer_fx.run.checkpoint import read

        cursors, unknown = read(self, restart, self._about, changes)
        words = f"; not compared with the checkpoint: {unknown}" if unknown else ""
        self.log(f"restarted at t = {self.time:.9g} s, step {self.step}{words}")
        if self._watch:
            self._watch.repeat()
        return cursors

    # ---- what outputs look at ----------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """[s]"""
        return self.system.time

    @property
    def totals(self) -> Totals:
        """Energies, momenta and masses now."""
        if self._totals.time != self.time:
            self._totals = self.system.totals()
        return self._totals

    @property
    def energy_error(self) -> float:
        """Closing error of the ledger, over the largest energy that a step so far has ended with."""
        now, first = self.totals, self.first
        largest = max(self.solver.newton.energy, now.size)
        missing = (now.energy - first.energy) - (now.supplied - now.dissipated)
        return missing / largest if largest else 0.0

    @property
    def mass_error(self) -> float:
        """Closing error of the gas masses, over the largest mass."""
        now, first = self.totals, self.first
        missing = now.mass - first.mass - now.mass_supplied
        return missing / max(now.mass, first.mass) if now.mass else 0.0

    @property
    def chambers(self) -> dict[str, ChamberState]:
        """States of the gas chambers and tanks by name; none if the scene has no gas."""
        return {
            name: state
            for border in self.system.scalar_unknowns
            for name, state in border.states().items()
        }

    def chamber(self, name: str) -> ChamberState:
        """State of the gas in a chamber: `pressure` [Pa], `temperature` [K], `volume` [m³], `mass` [kg],
        `internal_energy` [J].

        Raises:
            InputError: the scene has no such chamber.
        """
        chambers = self.chambers
        known = ", ".join(chambers) or "none"
        check(
            name in chambers,
            f"The scene has no chamber '{name}'; its chambers and tanks are: {known}.",
        )
        return chambers[name]

    # ---- running -----------------------------------------------------------------------------------------------

    def run(self, until: float) -> None:
        """Advance to the time `until` [s]; steps are evened out so that it and the outputs' times are met.

        SIGTERM, SIGINT and SIGUSR1 end it after the step that is being made, with a checkpoint if there are any.

        Raises:
            StepFailure: a step failed, also in sub-steps; the outputs are complete up to it.
            OutputFailure: a file could not be written; what was written before is kept.
            Interrupted: a signal came.
        """
        check(
            isinstance(until, Real) and not isinstance(until, bool) and math.isfinite(until),
            f"until is {until!r}; give the end time in seconds.",
        )
        check(
            until >= self.time,
            f"until is {until!r} s, but the run is at t = {self.time:.9g} s; give a later time.",
        )
        self.until = until = float(until)
        if self._locks is not None:
            self._locks.acquire()
            self._locks.running = True
        with abort_on_lone_error(self.comm), ExitStack() as at_the_end, Listener() as signals:
            at_the_end.callback(self._release)
            for output in self.outputs:
                at_the_end.callback(output.close, self)
            # all ranks have an error, before one closes files: closing is done together
            with abort_on_lone_error(self.comm):
                signal = self._start_and_go(until, signals)
        if signal:
            self._leave(signal)

    def _start_and_go(self, until: float, signals: Listener) -> int:
        """Record the start, and step; returns the number of a signal if one ended it, else zero."""
        ended = not self._started and self._watch is not None and self._watch.start()
        self._started = True
        if not self.recorded:
            self._record(last=ended)
        if ended:
            return 0
        times = [t for o in self.outputs for t in o.times] + (
            self._watch.times if self._watch else []
        )
        return self._go(sorted({t for t in times if self.time < t < until} | {until}), signals)

    def _go(self, milestones: Sequence[float], signals: Listener) -> int:
        """Step from milestone to milestone; returns the number of a signal if one ended it, else zero."""
        for milestone in milestones:
            while (left := milestone - self.time) > 1e-9 * self.stepping.wanted:
                try:
                    ended = self._advance(even_step(left, self.stepping.wanted), milestone)
                    signal = signals.heard(self.comm)
                    self._record(last=ended or signal > 0 or self.time == milestones[-1])
                except Exception as error:
                    agree_on_error(self.comm, error)
                    self._save()
                    raise
                if ended or signal:
                    return signal
        return 0

    def _record(self, last: bool) -> None:
        started = time.perf_counter()
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
        """After an error: the outputs see the good state if they have not, and a checkpoint keeps it.

        What cannot be written now must not hide the error.  If it is an output that fails, the checkpoint tells where
        the outputs stood before, and a restart begins with recording the state.
        """
        if not self._offered:
            with suppress(InputError, OutputFailure):
                self._record(last=True)
        if self.checkpoints is not None:
            with suppress(OutputFailure):
                self.checkpoints.record(self, last=True)

    def _advance(self, h: float, milestone: float = math.inf) -> bool:
        """One step of h, or less, up to a milestone; returns whether an event ends the run there."""
        started, before, stepping, ended = time.perf_counter(), self.time, self.stepping, False
        iterations, substeps = stepping.iterations, stepping.substeps
        try:
            if self._watch:
                ended = self._watch.advance(stepping, h)
            else:
                stepping.advance(h)
        finally:
            self.last_iterations = stepping.iterations - iterations
            self.substeps += stepping.substeps - substeps
            # sub-steps that were made before one failed are a step, too, and are seen by the outputs
            if self.time > before:
                self.iterations += self.last_iterations
                self.step += 1
                self.recorded = self._offered = False
                self.solver.newton.energy = max(self.solver.newton.energy, self.totals.size)
            self.seconds += time.perf_counter() - started
        if abs(milestone - self.time) <= 1e-9 * stepping.wanted:
            self.system.time = milestone
        PETSc.garbage_cleanup(
            self.comm
        )  # on several ranks what Python drops is kept until all ask for this
        return ended

    def _leave(self, number: int) -> None:
        """Say where the run ended, and end the program."""
        left = Interrupted(number)
        where = "" if self.checkpoints is None else f"; restart from '{self.checkpoints.latest}'"
        LOGGER.warning(
            "stopped by %s at t = %.9g s, after step %d%s",
            left.signal.name,
            self.time,
            self.step,
            where,
        )
        raise left

    def log(self, words: str) -> None:
        """Say something to those who listen to the log."""
        LOGGER.info(words)

    # ---- checkpoints -------------------------------------------------------------------------------------------

    def get_state(self) -> dict[str, Any]:
        """What a checkpoint keeps beside the history."""
        first = {
            name: v.tolist() if isinstance(v, np.ndarray) else v
            for name, v in asdict(self.first).items()
        }
        return {
            **{name: getattr(self, name) for name in _COUNTS},
            "first": first,
            "largest energy": self.solver.newton.energy,
            "recorded": self.recorded,
            "events": self._watch.get_state() if self._watch else {"done": [], "last": []},
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` returned."""
        for name in _COUNTS:
            setattr(self, name, state[name])
        first: dict[str, Any] = {
            n: np.array(v) if isinstance(v, list) else v for n, v in state["first"].items()
        }
        self.first = Totals(**first)
        self.solver.newton.energy, self._totals = state["largest energy"], self.system.totals()
        self.recorded = state["recorded"]
        if self._watch:
            self._watch.set_state(state["events"])


def _several[T](what: str, given: Sequence[T], kind: type) -> list[T]:
    """A list of things of a kind.

    Raises:
        InputError: it is one of them, or something else.
    """
    check(
        isinstance(given, Sequence)
        and not isinstance(given, str)
        and all(isinstance(one, kind) for one in given),
        f"{what} is {given!r}; give a list, e.g. {what}=[...].",
    )
    return list(given)
