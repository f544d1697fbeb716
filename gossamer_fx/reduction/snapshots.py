"""Shapes of a film in memory, for `reduce`."""

from __future__ import annotations

from collections.abc import Sequence

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Array
from gossamer_fx.outputs.schedule import Schedule
from gossamer_fx.probes.run import Run


@check_arguments
class Snapshots:
    """Positions of a film's nodes in the course of a run, kept in memory; each rank has those of its own nodes.

    Args:
        body: whose shapes are kept.
        every: steps between two of them.
        times: or the times [s] of them.

    `positions` is a list of arrays (n, 3) [m].
    """

    def __init__(self, body: Membrane, every: int = 1, *, times: Sequence[float] = ()) -> None:
        self.body, self.schedule = body, Schedule(every, tuple(times))
        self.positions: list[Array] = []

    @property
    def times(self) -> Sequence[float]:
        return self.schedule.times

    def open(self, run: Run) -> None:
        check(
            self.body in run.system.bodies,
            f"Snapshots: '{self.body.name}' is not in the scene; give one of its films.",
        )
        self.positions.clear()

    def record(self, run: Run, last: bool) -> None:
        if self.schedule.due(run.step, run.time, last):
            self.positions.append(run.system.state[self.body].positions().copy())

    def close(self, run: Run) -> None:
        """Nothing is left to do."""
