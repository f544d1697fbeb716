"""End points of ropes, springs and tapes over time, so that pictures show them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gossamer_fx.core.model.body import Array, Attached, Port
from gossamer_fx.mechanics.bodies.between import DrawnAsLines
from gossamer_fx.records.outputs.output import Table
from gossamer_fx.records.outputs.schedule import Schedule
from gossamer_fx.solve.view import StateView


class ConnectorLines:
    """CSV file with the two ends of each line of the connectors [m], six columns a line."""

    def __init__(self, path: Path, items: Sequence[object], schedule: Schedule) -> None:
        self.path = path
        self._schedule = schedule
        self._table = Table(path)
        self._columns: list[str] = []
        self._ends: list[Attached] = []
        number = 0
        for item in items:
            if not isinstance(item, DrawnAsLines):
                continue
            for pair in item.lines_to_draw:
                number += 1
                for end, letter in zip(pair, "ab", strict=True):
                    self._ends.append(end)
                    self._columns += [f"{number} {item.name} {letter}{axis}" for axis in "xyz"]

    def __bool__(self) -> bool:
        """Whether there is anything to write."""
        return bool(self._ends)

    @property
    def times(self) -> Sequence[float]:
        """Times that the run must meet [s]."""
        return self._schedule.times

    def open(self, run: StateView) -> None:
        self._table.create(run.comm, [run.axis.column, "step", *self._columns])

    def cursor(self) -> dict[str, Any]:
        return self._table.cursor()

    def resume(self, run: StateView, cursor: Mapping[str, Any]) -> None:
        self._table.cut(run.comm, [run.axis.column, "step", *self._columns], cursor)

    def record(self, run: StateView, last: bool) -> None:
        """Add a row with the end points of all lines [m] if it is due.  Collective."""
        if not self._schedule.due(run.step, run.time, last):
            return
        row: list[float] = [float(run.time), run.step]
        # Neighbouring bars of a tape share their points, and the position of each is a sum over all
        # ranks.
        known: dict[Any, Array] = {}
        for end in self._ends:
            key: Any = id(end)
            if isinstance(end, Port):
                key = (id(end.body), end.nodes, end.weights, end.vectors)
            if key not in known:
                known[key] = run.system.state.vector(end)
            row += [float(x) for x in known[key]]
        self._table.append(run.comm, row)

    def close(self, run: StateView) -> None:
        """Nothing to close: each row is written completely."""
