"""Events of a run: actions at a time, or when a probe passes a value.

Problem.  An instant at which a probe passes a value lies within a step, and must be found without a
step that the run does not keep.

Algorithm of `EventMonitor.advance`.

1. Commit the state, and make a step.
2. If a probe has passed its value, search the length of the step by false position, with a
   bisection in every third turn: undo the step and make it again with the length that is tried.
3. The step ends behind the instant, by the tolerance of the event at most; then the event acts.

Limits.  A probe that passes its value and returns within one step is not noticed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated, Any

from gossamer_fx.core.checks.arguments import check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import InputError
from gossamer_fx.core.checks.user_functions import ask
from gossamer_fx.records.outputs.output import Probe, evaluate_probe, of_item
from gossamer_fx.solve.steppers.history import History, SavedState
from gossamer_fx.solve.steppers.stepping import Stepping
from gossamer_fx.solve.view import SteppedRun

Action = Callable[[SteppedRun], object]

# Times that differ by less than this fraction of a step are the same.
SAME_TIME = 1e-9

# Default tolerance of an instant over the step of the stepper.
INSTANT_TOLERANCE = 1e-6

# A remainder of a step that counts as round-off, over its length.
STEP_ROUND_OFF = 1e-12

# Each third turn of the search is a bisection: false position alone approaches from one side only,
# and is slow for a probe that jumps.
BISECTION_INTERVAL = 3


@check_arguments
@dataclass(frozen=True, eq=False)
class At:
    """An event at a time, which a step meets exactly; e.g. to open a valve.

    Args:
        time: [s].
        then: called with the run.  It is called again after a restart, so it should set values and
            not add to them.
        stop: whether the run ends there.
        name: for the log.

    Raises:
        InputError: the time is negative or not finite, or `then` is not a function.

    Example:
        >>> gx.At(0.5, lambda run: run.log("half a second has passed")).time
        0.5
    """

    time: Annotated[float, not_negative("s")]
    then: Action | None = None
    _: KW_ONLY
    stop: bool = False
    name: str = "time"


@check_arguments
@dataclass(frozen=True, eq=False)
class When:
    """An event at the first time at which a probe exceeds a value; a step ends there.

    Args:
        probe: a function of the run that returns a number, the same on every rank; see `gx.probes`.
        value: that the probe passes, from below.
        falling: whether the probe passes the value from above.
        then: called with the run.  It is called again after a restart, so it should set values and
            not add to them.
        stop: whether the run ends there.
        tolerance: error of the instant [s]; default a millionth of the stepper's dt.
        name: for the log.

    Raises:
        InputError: the probe or `then` is not a function, or the tolerance is not positive.

    Example:
        >>> pressure = gx.probes.GasState(tank, "pressure")
        >>> empty = gx.When(pressure, 1e4, falling=True, stop=True, name="the tank is empty")
        >>> fall = gx.When(lambda run: run.time, 0.25)
        >>> fall.value
        0.25
    """

    probe: Probe
    value: float = 0.0
    _: KW_ONLY
    falling: bool = False
    then: Action | None = None
    stop: bool = False
    tolerance: Annotated[float, positive("s")] | None = None
    name: str = "event"


Event = At | When


@dataclass
class _StepWithEvents:
    """A step that is made again with other lengths.

    Attributes:
        start: time at its start [s].
        before: values of the probes at its start.
        state: the one at its start; None: nothing waits for an event.
    """

    start: float
    before: dict[When, float] = field(default_factory=dict)
    state: SavedState | None = None

    @property
    def waiting(self) -> list[When]:
        """Events that have not happened at the start of the step."""
        return list(self.before)


class EventMonitor:
    """The events of a run: makes its steps, and lets events act."""

    def __init__(self, run: SteppedRun, events: Sequence[Event], history: History) -> None:
        """Sort the events by kind, and evaluate the probes of `When` at the start.  Collective."""
        self._run = run
        self._history = history
        self._at = [event for event in events if isinstance(event, At)]
        self._when = [event for event in events if isinstance(event, When)]
        self._events: list[Event] = [*self._at, *self._when]
        self._done: list[int] = []  # indices in `_events`, in the order in which they happened
        self._last: dict[When, float] = {}  # values of the probes at the last look
        for event in self._when:
            self._last[event] = self._evaluate(event)

    @property
    def times(self) -> list[float]:
        """Times that the run must meet [s]."""
        return [event.time for event in self._at]

    def start(self) -> bool:
        """Let the events at the start of the run act; returns whether the run ends there."""
        return self._let_act([event for event in self._at if event.time == self._run.time])

    def advance(self, stepping: Stepping, h: float) -> bool:
        """Advance the run by a length of time, or to the first event, and let it act.  Collective.

        Args:
            h: length of the step [s].
        """
        run = self._run
        step = _StepWithEvents(run.time)
        for event in self._when:
            if self._events.index(event) not in self._done:
                step.before[event] = self._last[event]
        # A state that need not be restored need not be copied.
        if step.waiting:
            step.state = self._history.save()
        stepping.advance(h)
        try:
            passed = self._passed(step.waiting)
            if passed:
                passed = self._locate(stepping, step, passed)
        except InputError:
            # The probe cannot be evaluated here: the state before the step is the last good one.
            self._undo(step)
            raise
        tolerance = SAME_TIME * stepping.wanted
        arrived = [event for event in self._at if abs(run.time - event.time) <= tolerance]
        return self._let_act([*arrived, *passed])

    def _let_act(self, events: Sequence[Event]) -> bool:
        """Let those events act that have not yet happened; returns whether the run ends there."""
        new = [k for k, event in enumerate(self._events) if event in events and k not in self._done]
        for k in new:
            event = self._events[k]
            self._done.append(k)
            self._act(event, f"{event.name} at t = {self._run.time:.9g} s")
        return any(self._events[k].stop for k in new)

    def _evaluate(self, event: When) -> float:
        """The value of an event's probe now."""
        return evaluate_probe(self._run, f"When '{event.name}'", event.probe)

    def _passed(self, waiting: list[When]) -> list[When]:
        """Events whose probes have passed their values since the last call; notes in `_last` what
        the probes return now."""
        passed = []
        for event in waiting:
            before = self._last[event]
            self._last[event] = self._evaluate(event)
            if _excess(event, self._last[event]) > 0 >= _excess(event, before):
                passed.append(event)
        return passed

    def _locate(
        self,
        stepping: Stepping,
        step: _StepWithEvents,
        passed: list[When],
    ) -> list[When]:
        """Make a step again, with other lengths, until it ends at its first event.  Collective.

        Args:
            step: time [s] and values of the probes at the start of the step.

        Returns:
            The events that happen at the end that was found; its error is the smallest of their
            tolerances [s].
        """
        run = self._run
        # No event has happened after the length `shorter`, and some have after `longer`.
        shorter = 0.0
        longer = run.time - step.start
        default_tolerance = INSTANT_TOLERANCE * run.stepper.dt
        tolerance = min(event.tolerance or default_tolerance for event in passed)
        # Excesses of the probes after these lengths.
        left = {event: _excess(event, step.before[event]) for event in step.waiting}
        right = self._excesses(step.waiting)
        length = longer
        turn = 0
        while longer - shorter > tolerance:
            interval = longer - shorter
            guesses = []
            for event in passed:
                # The zero of the straight line between both ends.
                zero = interval * left[event] / (left[event] - right[event])
                guesses.append(shorter + zero)
            # The first event counts.  The guess is moved behind it, as the search ends when the
            # interval is shorter than the tolerance.
            length = min(guesses) + tolerance / 2
            is_inside = shorter + tolerance / 4 < length < longer - tolerance / 4
            if turn % BISECTION_INTERVAL == BISECTION_INTERVAL - 1 or not is_inside:
                length = (shorter + longer) / 2
            turn += 1
            passed_here = self._repeat_step(stepping, step, length)
            if passed_here:
                longer = length
                passed = passed_here
                right = self._excesses(step.waiting)
            else:
                shorter = length
                left = self._excesses(step.waiting)
        # The last length tried may have been too short.
        if length != longer:
            passed = self._repeat_step(stepping, step, longer)
        return passed

    def _excesses(self, events: list[When]) -> dict[When, float]:
        """Distances of the probes beyond the values of their events, at the last look."""
        return {event: _excess(event, self._last[event]) for event in events}

    def _repeat_step(
        self,
        stepping: Stepping,
        step: _StepWithEvents,
        length: float,
    ) -> list[When]:
        """Undo the step and make it again with another length; returns the events that it passes.

        Args:
            step: time [s] and values of the probes at the start of the step.
            length: of the step [s].
        """
        run = self._run
        self._undo(step)
        # A step control may advance by less than it is asked to.
        end = step.start + length
        while (remaining := end - run.time) > STEP_ROUND_OFF * length:
            stepping.advance(remaining)
        return self._passed(step.waiting)

    def _undo(self, step: _StepWithEvents) -> None:
        """Return to the start of a step, before which events wait.  Collective."""
        assert step.state is not None, "a step with waiting events begins with a saved state"
        self._history.restore(step.state)
        self._last |= step.before

    def _act(self, event: Event, words: str) -> None:
        """Log an event and call its action.  Collective."""
        run = self._run
        run.log(words)
        then = event.then
        if then is not None:
            what = f"{type(event).__name__} '{event.name}' at t = {run.time:.6g} s"
            ask(run.comm, what, lambda: then(run))

    def describe(self) -> dict[str, dict[str, Any]]:
        """Name and arguments of each event, by its key; of equal keys those of the last one."""
        items = self._run.scene.items
        return {_key(e): {"name": e.name, **of_item(e, items)} for e in self._events}

    def get_history(self) -> dict[str, Any]:
        """Keys of the events that have happened, and the last values of probes, for a
        checkpoint."""
        keys = [_key(event) for event in self._events]
        return {
            "done": [keys[k] for k in self._done],
            "last": [[_key(event), value] for event, value in self._last.items()],
        }

    def set_history(self, state: dict[str, Any]) -> None:
        """Restore what `get_history` returned: which events have happened, and the last values of
        probes.

        Events are found by their keys, as they may come in another order; a new event has not
        happened, and its probe is evaluated.  Collective.
        """
        # Of events with equal keys, each is found once.
        remaining = list(enumerate(self._events))
        self._done = []
        for key in state["done"]:
            for k, event in remaining:
                if _key(event) == key:
                    remaining.remove((k, event))
                    self._done.append(k)
                    break
        values = [(key, value) for key, value in state["last"]]
        for event in self._when:
            known = [pair for pair in values if pair[0] == _key(event)]
            if known:
                values.remove(known[0])
                self._last[event] = known[0][1]
            else:
                self._last[event] = self._evaluate(event)

    def repeat(self) -> None:
        """Call the actions of all events that have happened; after a restart.

        What they have set, such as the opening of a valve, is not in the checkpoint.
        """
        for k in self._done:
            event = self._events[k]
            self._act(event, f"again: {event.name}")


def _excess(event: When, value: float) -> float:
    """Distance of a value of the probe beyond that of the event, in the direction of the
    passage."""
    if event.falling:
        return event.value - value
    return value - event.value


def _key(event: Event) -> str:
    """Kind, name and value of an event in words, by which a restart finds it again."""
    if isinstance(event, At):
        return f"At {event.time:.12g} s '{event.name}'"
    passage = "exceeds"
    if event.falling:
        passage = "falls below"
    return f"When '{event.name}' {passage} {event.value:.12g}"
