"""A CSV file with values of probes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.records.outputs.output import Probe, Table, evaluate_probe, make_parent
from gossamer_fx.records.outputs.schedule import Schedule
from gossamer_fx.solve.view import StateView


@check_arguments
class Probes:
    """CSV file with values of probes: columns time [s] or load parameter, step, and one for each
    probe.

    Args:
        path: of the file.
        probes: functions of the run that return a number, the same on every rank, by the names of
            their columns; see `gx.probes`.
        every: steps between two rows; the first and the last state are always recorded.
        times: at which rows are written instead [s].

    Raises:
        InputError: a probe is not a function, or has the name of another column; before the first
            step and in the run: a probe fails, or does not return the same finite number on every
            rank.

    Example:
        >>> ball = gx.PointMass(2.0, comm=comm, name="ball")
        >>> height = gx.probes.Position(ball.port(), "z")
        >>> table = gx.outputs.Probes(folder / "ball.csv", {"height": height}, every=2)
        >>> gx.Simulation(gx.Scene(ball), gx.Midpoint(dt=0.1), outputs=[table]).run(until=0.2)
        >>> (folder / "ball.csv").read_text().splitlines()
        ['time,step,height', '0.0,0,0.0', '0.2,2,0.0']
    """

    def __init__(
        self,
        path: str | Path,
        probes: Mapping[str, Probe],
        *,
        every: int = 1,
        times: Sequence[float] = (),
    ) -> None:
        self.path = Path(path)
        self.probes = dict(probes)
        self.schedule = Schedule(every, tuple(times))
        check(
            bool(self.probes),
            f"Probes '{path}': there is none; give a dict of names and functions of the run.",
        )
        for name, probe in self.probes.items():
            check(
                callable(probe),
                f"Probe '{name}' is {probe!r}; give a function of the run that returns a number.",
            )
            check(
                name not in ("time", "step"),
                f"Probe '{name}' has the name of a column that exists; rename it.",
            )
        self._table = Table(self.path)

    @property
    def times(self) -> Sequence[float]:
        """Times that the run must meet [s]."""
        return self.schedule.times

    @property
    def writes(self) -> Sequence[Path]:
        return [self.path]

    def open(self, run: StateView) -> None:
        make_parent(run.comm, self.path)
        # A probe that fails must do so before the first step, and before an older table is lost.
        self._row(run)
        self._table.create(run.comm, self._head(run))

    def cursor(self) -> dict[str, Any]:
        return self._table.cursor()

    def resume(self, run: StateView, cursor: dict[str, Any]) -> None:
        """Continue after a restart: remove rows after the cursor."""
        self._row(run)
        self._table.cut(run.comm, self._head(run), cursor)

    def _head(self, run: StateView) -> list[str]:
        """Names of the columns."""
        first = run.axis.column
        check(
            first not in self.probes,
            f"Probe '{first}' has the name of a column that exists; rename it.",
        )
        return [first, "step", *self.probes]

    def _row(self, run: StateView) -> list[float]:
        """The values of all probes."""
        row = []
        for name, probe in self.probes.items():
            row.append(evaluate_probe(run, f"Probe '{name}'", probe))
        return row

    def record(self, run: StateView, last: bool) -> None:
        if self.schedule.due(run.step, run.time, last):
            row = [float(run.time), run.step, *self._row(run)]
            self._table.append(run.comm, row)

    def close(self, run: StateView) -> None:
        """Nothing to close: each row is written completely."""
