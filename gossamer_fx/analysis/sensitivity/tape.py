"""The tape of a run: states between its steps, from which each step can be made again.

A tape with room for all states keeps them all.  When they need more than the memory that it may
take, every second one is dropped, again and again, so that the states that stay are evenly spaced:
checkpoints.  The number of steps of a run is not known before its end, for which optimal schedules
such as Revolve ask.  The backward pass makes the dropped states again, by steps from the checkpoint
before:

    with room for m states, one further pass forwards serves m²/4 steps, two serve some m³/27 steps.

Steps that are made again agree with those of the run to the tolerance of Newton's method.  Source
of the levels: A. Griewank & A. Walther, Evaluating Derivatives, 2nd ed., SIAM 2008, chapter 12.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.checks.arguments import check_arguments, positive
from gossamer_fx.core.checks.errors import NotConverged, StepFailure, check, check_on_all
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.terms.discrete_gradient import PathAverage
from gossamer_fx.records.run.simulation import Simulation
from gossamer_fx.solve.steppers.history import MOTION, History, SavedState
from gossamer_fx.solve.steppers.midpoint import Midpoint

# Memory [bytes] that a tape may take on a rank, unless the user says otherwise.
DEFAULT_MEMORY = 4e9

# States for which every tape needs room: both ends of the run, and both ends of a step.
FEWEST_STATES = 4


@dataclass(frozen=True, eq=False)
class RecordedState:
    """An accepted state of a run, after `index` steps and at a time [s]; `h` [s] is the length of
    the step that led to it, zero for the first state.

    `active_sets` are those of the step that led to it, and `bytes` is what the state takes on this
    rank.
    """

    index: int
    h: float
    saved: SavedState
    active_sets: list[Any]
    bytes: int

    @property
    def time(self) -> float:
        return self.saved.time

    @property
    def q(self) -> Array:
        """Coordinates (n,) of this rank, with multipliers."""
        return self.saved.vectors["coordinates"]

    @property
    def v(self) -> Array:
        """Velocities (n,) of this rank."""
        return self.saved.vectors["velocities"]


@check_arguments
class RunTape:
    """Records the steps of a run from now on, for `gx.analysis.gradient`.

    It keeps coordinates and velocities of every accepted step, 16 bytes for each unknown and step,
    and what history variables and pairs of contact need.  Factors are not kept: the backward pass
    computes them again.  When the states need more than `memory`, only evenly spaced ones stay, and
    the backward pass makes the others again.  Steps that were undone, because of an event or a step
    control, leave the tape.

    Args:
        run: a `Simulation` with `Midpoint` steps.
        memory: what the tape may take on each rank [bytes].

    Attributes:
        states: those that are kept, from the one at the start of the recording to the last one.
        stride: number of steps between two states that are kept.
        bytes: memory of the states on this rank.
        history: saves and restores states of the run.

    Raises:
        InputError: another stepper or stress rule; no room for four states.

    Example:
        >>> run = gx.Simulation(gx.Scene(mass), gx.Midpoint(dt=0.1))
        >>> tape = gx.analysis.RunTape(run)
        >>> run.run(until=1.0)
        >>> len(tape.states)
        11
    """

    def __init__(
        self, run: Simulation, *, memory: Annotated[float, positive("bytes")] = DEFAULT_MEMORY
    ) -> None:
        stepper = run.stepper
        check(
            isinstance(stepper, Midpoint) and isinstance(stepper.rule, PathAverage),
            f"RunTape: the run makes steps of {stepper!r}, which are not the same backwards; "
            "use Midpoint(dt=...).",
        )
        self.system = run.system
        self.memory = memory
        self.stride = 1
        self._solver = run.solver
        self._recorders = run.stepping.recorders
        # Without that of the stepper: whether a step is tried with care says nothing about it.
        self.history = History(run.system)
        first = self._present(0, 0.0)
        check_on_all(
            self.system.comm,
            FEWEST_STATES * first.bytes <= memory,
            f"RunTape: memory is {memory:.3g} bytes; "
            f"four states need {FEWEST_STATES * first.bytes} bytes on a rank.",
        )
        self.states: list[RecordedState] = [first]
        # Counted along with the states: a sum over all of them in every step would grow with the
        # square of the number of steps.
        self.bytes = first.bytes
        # Lengths and ends [s] of all steps, of which the first entries stand for the first state.
        self._lengths = [0.0]
        self._times = [first.time]
        self._recorders.append(self._record)

    def close(self) -> None:
        """End the recording; the recorded steps stay."""
        if self._record in self._recorders:
            self._recorders.remove(self._record)

    @property
    def steps(self) -> int:
        """Number of recorded steps, whether their states are kept or not."""
        return len(self._lengths) - 1

    # ---- states ----------------------------------------------------------------------------------

    def restore(self, state: RecordedState) -> None:
        """Make a recorded state that of the system.  Collective."""
        # On several ranks PETSc keeps what was dropped in the step that was restored before this.
        PETSc.garbage_cleanup(self.system.comm)
        self.history.restore(state.saved)

    def _present(self, index: int, h: float) -> RecordedState:
        """The accepted state of the system after a step of length h [s], for the tape."""
        system = self.system
        active_sets = []
        if h > 0:
            active_sets = [compiled.save_active_set() for compiled in system.equations.active_sets]
        saved = self.history.save(MOTION)
        size = _bytes_of([saved, active_sets])
        return RecordedState(index, h, saved, active_sets, size)

    def _record(self) -> None:
        """Add the step that was accepted; called by the system on all ranks."""
        system = self.system
        start = system.unknowns.time - system.unknowns.h
        # A step that starts before the last state replaces steps that were undone.
        while self.steps and self._times[-1] > start + system.unknowns.h / 2:
            self._times.pop()
            self._lengths.pop()
        while self.states[-1].index > self.steps:
            self._drop_last()
        self._lengths.append(system.unknowns.h)
        self._times.append(system.unknowns.time)
        # The last state stays in any case, as the end of the run so far.
        if self.states[-1].index % self.stride:
            self._drop_last()
        state = self._present(self.steps, system.unknowns.h)
        self.states.append(state)
        self.bytes += state.bytes
        if self._is_over(self.memory):
            self._thin_out(self.memory)

    def _drop_last(self) -> None:
        """Drop the last state."""
        self.bytes -= self.states.pop().bytes

    def _is_over(self, memory: float) -> bool:
        """Whether the states need more memory [bytes] on any rank.  Collective."""
        return bool(self.system.comm.allreduce(self.bytes > memory, op=MPI.LOR))

    def _thin_out(self, memory: float) -> None:
        """Drop every second state until the rest needs no more memory [bytes]; both ends stay.
        Collective."""
        last = self.states[-1]
        while len(self.states) > 2 and self._is_over(memory):
            self.stride *= 2
            self.states = [state for state in self.states[:-1] if state.index % self.stride == 0]
            self.states.append(last)
            self.bytes = sum(state.bytes for state in self.states)

    # ---- steps that are made again ---------------------------------------------------------------

    def forwards(self) -> Iterator[RecordedState]:
        """All states in the order of time.  The system may be changed in between.  Collective."""
        yield self.states[0]
        for first, last in zip(self.states[:-1], self.states[1:], strict=True):
            state = first
            while state.index + 1 < last.index:
                state = self._advance(state, state.index + 1)
                yield state
            yield last

    def backwards(self, last: int) -> Iterator[tuple[RecordedState, RecordedState]]:
        """Start and end of the first `last` steps, last step first.  The system may be changed in
        between. States that were dropped are made again, within the memory of the tape.
        Collective."""
        if self.stride > 1:
            # Room for the states that are made again.
            self._thin_out(self.memory / 2)
        states = list(self.states)
        for first, end in zip(states[-2::-1], states[:0:-1], strict=True):
            if first.index < last:
                yield from self._between(first, end, last, self._free_states())

    def _free_states(self) -> int:
        """Number of states for which there is room on every rank; at least one.  Collective."""
        largest = max(state.bytes for state in self.states)
        count = int((self.memory - self.bytes) // max(largest, 1))
        fewest: int = self.system.comm.allreduce(count, op=MPI.MIN)
        return max(fewest, 1)

    def _between(
        self, first: RecordedState, end: RecordedState, last: int, free: int
    ) -> Iterator[tuple[RecordedState, RecordedState]]:
        """Steps from `first` to `end`, last step first, as far as they are among the first `last`
        ones; there is room for `free` states in between.  Collective."""
        count = end.index - first.index
        if count == 1:
            if end.index <= last:
                yield first, end
            return
        # All states between fit, or half of the room is for this level, the rest for those below.
        stride = 1
        if count - 1 > free:
            stride = math.ceil(count / (max(free // 2, 1) + 1))
        known = [first]
        while known[-1].index + stride < end.index:
            known.append(self._advance(known[-1], known[-1].index + stride))
        known.append(end)
        while len(known) > 1:
            below = max(free - (len(known) - 2), 1)
            yield from self._between(known[-2], known[-1], last, below)
            known.pop()

    def _advance(self, state: RecordedState, index: int) -> RecordedState:
        """Make the recorded steps again from a known state to a later one, and return that one.
        Collective."""
        system = self.system
        # These steps are accepted past `Stepping`: it has recorded and counted them already.
        self.restore(state)
        # The remainder of the increment is below the round-off of the coordinates, and is not in
        # recorded states.
        system.unknowns.increment.remainder.set(0.0)
        for k in range(state.index + 1, index + 1):
            try:
                self._solver.accept(self._solver.step(self._lengths[k]))
            except NotConverged as problem:
                raise StepFailure(
                    f"gradient: the step to t = {self._times[k]:.9g} s cannot be made again, "
                    f"{problem}; give the tape more memory."
                ) from problem
            system.unknowns.time = self._times[k]
        return self._present(index, self._lengths[index])


def _bytes_of(saved: Any) -> int:
    """Memory [bytes] of the arrays in lists, tuples, dictionaries and data classes."""
    if isinstance(saved, np.ndarray):
        return int(saved.nbytes)
    if isinstance(saved, Mapping):
        return sum(_bytes_of(part) for part in saved.values())
    if isinstance(saved, list | tuple):
        return sum(_bytes_of(part) for part in saved)
    if is_dataclass(saved):
        return sum(_bytes_of(getattr(saved, field.name)) for field in fields(saved))
    return 0
