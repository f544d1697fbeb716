"""What happens in the course of a run: at a time, or when a probe passes a value."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import InputError, check
from gossamer_fx.checks.user_functions import ask
from gossamer_fx.outputs.arguments import of_item
from gossamer_fx.outputs.output import Probe, evaluate_probe
from gossamer_fx.steppers.history import History
from gossamer_fx.steppers.stepping import Stepping

if TYPE_CHECKING:
    from gossamer_fx.probes.run import Run

Action = Callable[["Run"], object]


@check_arguments
@dataclass(frozen=True, eq=False)
class At:
    """A time [s] that is met exactly, e.g. to open a valve.

    Args:
        time: [s].
        then: called with the run; after a restart once more, so let it set things, and add nothing.
        stop: whether the run ends there.
        name: in the log.
    """

    time: float
    then: Action | None = None
    _: KW_ONLY
    stop: bool = False
    name: str = "time"

    def __post_init__(self) -> None:
        check(
            isinstance(self.time, Real) and math.isfinite(self.time) and self.time >= 0,
            f"At '{self.name}': time is {self.time!r}; give seconds.",
        )
        _check_action(self)


@check_arguments
@dataclass(frozen=True, eq=False)
class When:
    """The first time at which a probe exceeds a value, located within the step: a step ends there.

    `When(gx.probes.GasState(bag, "pressure"), 1e4, stop=True)` ends a run at 10 kPa;
    `When(lambda run: area(run.time))` is where a valve of that area opens.

    Args:
        probe: a function of the run that returns a number, the same on every rank; see `Probes`.
        value: that it passes, from below.
        falling: it passes the value from above.
        then, stop, name: as those of `At`.
        tolerance: to which the instant is found [s]; default a millionth of the stepper's dt.
    """

    probe: Probe
    value: float = 0.0
    _: KW_ONLY
    falling: bool = False
    then: Action | None = None
    stop: bool = False
    tolerance: float | None = None
    name: str = "event"

    def __post_init__(self) -> None:
        check(
            callable(self.probe),
            f"When '{self.name}': {self.probe!r} is not a function of the run; give one.",
        )
        check(
            self.tolerance is None or self.tolerance > 0,
            f"When '{self.name}': tolerance is {self.tolerance!r} s; give a positive one.",
        )
        _check_action(self)


Event = At | When


def _check_action(event: Event) -> None:
    kind = type(event).__name__
    check(
        event.then is None or callable(event.then),
        f"{kind} '{event.name}': then is {event.then!r}; give a function of the run, or None.",
    )


class EventMonitor:
    """Events at work on a run."""

    def __init__(self, run: Run, events: Sequence[Event], history: History) -> None:
        self._run, self._history = run, history
        for event in events:
            check(
                isinstance(event, At | When),
                f"{event!r} is not an event; give At(...) or When(...).",
            )
        self._at = [e for e in events if isinstance(e, At)]
        self._when = [e for e in events if isinstance(e, When)]
        self._events: list[Event] = [*self._at, *self._when]
        self._done: list[int] = []  # numbers in `_events`, in the order in which they happened
        self._last = {e: evaluate_probe(run, f"When '{e.name}'", e.probe) for e in self._when}

    @property
    def times(self) -> list[float]:
        """That the run must meet."""
        return [e.time for e in self._at]

    def start(self) -> bool:
        """Let those of the start happen.  Returns whether the run ends there."""
        return self._happen([e for e in self._at if e.time == self._run.time])

    def advance(self, stepping: Stepping, h: float) -> bool:
        """Go on by h, or by less: to the first event.  Returns whether the run ends there."""
        run, waiting = self._run, [e for e in self._when if self._events.index(e) not in self._done]
        if waiting:
            self._history.commit()
        start, before = run.time, {e: self._last[e] for e in waiting}
        stepping.advance(h)
        try:
            happened = self._look(waiting)
            if happened:
                happened = self._locate(stepping, start, waiting, before, happened)
        except InputError:  # of a probe: the state before the step is the last good one
            self._history.rollback()
            self._last |= before
            raise
        arrived = [e for e in self._at if abs(run.time - e.time) <= 1e-9 * stepping.wanted]
        return self._happen([*arrived, *happened])

    def _happen(self, events: Sequence[Event]) -> bool:
        """Act on those that have not happened yet.  Returns whether the run ends there."""
        new = [k for k, e in enumerate(self._events) if e in events and k not in self._done]
        for k in new:
            self._done.append(k)
            self._act(self._events[k], f"{self._events[k].name} at t = {self._run.time:.9g} s")
        return any(self._events[k].stop for k in new)

    def _look(self, waiting: list[When]) -> list[When]:
        """Those that have just happened."""
        happened = []
        for e in waiting:
            before, self._last[e] = (
                self._last[e],
                evaluate_probe(self._run, f"When '{e.name}'", e.probe),
            )
            if _beyond(e, self._last[e]) > 0 >= _beyond(e, before):
                happened.append(e)
        return happened

    def _locate(
        self,
        stepping: Stepping,
        start: float,
        waiting: list[When],
        before: dict[When, float],
        happened: list[When],
    ) -> list[When]:
        """Repeat the step until it ends at its first event, by false position and bisection."""
        run, a, b, turn = self._run, 0.0, self._run.time - start, 0
        tolerance = min(e.tolerance or 1e-6 * run.stepper.dt for e in happened)
        left = {e: _beyond(e, before[e]) for e in waiting}
        right = {e: _beyond(e, self._last[e]) for e in waiting}
        here = b
        while b - a > tolerance:
            guesses = [a + (b - a) * left[e] / (left[e] - right[e]) for e in happened]
            here = min(guesses) + tolerance / 2
            if turn % 3 == 2 or not a + tolerance / 4 < here < b - tolerance / 4:
                here = (a + b) / 2
            turn += 1
            found = self._try(stepping, start, here, waiting, before)
            if found:
                b, happened, right = here, found, {e: _beyond(e, self._last[e]) for e in waiting}
            else:
                a, left = here, {e: _beyond(e, self._last[e]) for e in waiting}
        return happened if here == b else self._try(stepping, start, b, waiting, before)

    def _try(
        self,
        stepping: Stepping,
        start: float,
        length: float,
        waiting: list[When],
        before: dict[When, float],
    ) -> list[When]:
        """Repeat the step with another length; returns the events in it."""
        run = self._run
        self._history.rollback()
        self._last |= before
        while (left := start + length - run.time) > 1e-12 * length:
            stepping.advance(left)
        return self._look(waiting)

    def _act(self, event: Event, words: str) -> None:
        run, then = self._run, event.then
        run.log(words)
        if then is not None:
            ask(
                run.comm,
                f"{type(event).__name__} '{event.name}' at t = {run.time:.6g} s",
                lambda: then(run),
            )

    def describe(self) -> list[dict[str, Any]]:
        """What tells the events from others, for checkpoints; `key` is the same for those that are alike."""
        items = self._run.scene.items
        return [
            {"key": _key(event), "name": event.name, **of_item(event, items)}
            for event in self._events
        ]

    def get_state(self) -> dict[str, Any]:
        keys = [_key(event) for event in self._events]
        return {
            "done": [keys[k] for k in self._done],
            "last": [[_key(event), value] for event, value in self._last.items()],
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Events are found by what they are; one that is new has not happened."""
        left = list(enumerate(self._events))
        self._done = []
        for key in state["done"]:
            found = next(((k, e) for k, e in left if _key(e) == key), None)
            if found is not None:
                left.remove(found)
                self._done.append(found[0])
        known = [(key, value) for key, value in state["last"]]
        for event in self._when:
            mine = next((pair for pair in known if pair[0] == _key(event)), None)
            if mine is not None:
                known.remove(mine)
            now = (
                mine[1] if mine else evaluate_probe(self._run, f"When '{event.name}'", event.probe)
            )
            self._last[event] = now

    def repeat(self) -> None:
        """After a restart: act as before."""
        for k in self._done:
            self._act(self._events[k], f"again: {self._events[k].name}")


def _key(event: Event) -> str:
    """What an event is, in words."""
    if isinstance(event, At):
        return f"At {event.time:.12g} s '{event.name}'"
    return f"When '{event.name}' {'falls below' if event.falling else 'exceeds'} {event.value:.12g}"


def _beyond(event: When, value: float) -> float:
    """How far the probe is past the event's value."""
    return event.value - value if event.falling else value - event.value
