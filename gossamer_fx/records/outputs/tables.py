"""Tables of a run: rows that survive a crash, the ledger, probes in a file and in memory."""

from __future__ import annotations

import csv
import errno
import io
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import at_least, check_arguments
from gossamer_fx.core.checks.csv_tables import safe_cells
from gossamer_fx.core.checks.errors import check, on_rank_zero, write_on_all
from gossamer_fx.core.checks.lookups import check_known
from gossamer_fx.core.checks.strange_files import open_file, open_to_write, write_new
from gossamer_fx.core.model.body import Array
from gossamer_fx.records.outputs.output import (
    Continued,
    Every,
    Output,
    Probe,
    Schedule,
    Times,
    check_probe,
    evaluate_probe,
    make_parent,
)
from gossamer_fx.solve.view import StateView


class Table:
    """A CSV file that rank 0 writes row by row; a row is in it completely or not at all.

    Attributes:
        end: length of the file after the last complete row [bytes].
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.end = 0
        self._rows = 0  # complete rows, without the head
        self._head: Sequence[str] = ()  # columns that are written with the first row

    def create(self, comm: MPI.Intracomm, head: Sequence[str]) -> None:
        """Begin an empty table; an older file is kept until the first row.  Collective."""
        make_parent(comm, self.path, file=True)
        self.end = 0
        self._rows = 0
        self._head = head

    def append(self, comm: MPI.Intracomm, row: Iterable[Any]) -> None:
        """Add a row to the file.  Collective."""
        lines = _csv_line(row)
        # The head comes with the first row, so that a run that fails before keeps an older file.
        if self._head:
            lines = _csv_line(self._head) + lines

        def write() -> None:
            if comm.rank == 0:
                if self._head:
                    write_new(self.path, b"")
                append_bytes(self.path, self.end, lines)

        write_on_all(comm, self.path, write)
        self._head = ()
        self.end = comm.bcast(self.end + len(lines))
        self._rows += 1

    def cursor(self) -> dict[str, int]:
        """What the table holds: `end` in bytes, and the number of `rows`."""
        return {"end": self.end, "rows": self._rows}

    def cut(self, comm: MPI.Intracomm, head: Sequence[str], cursor: Mapping[str, int]) -> None:
        """Go on with a table as it was at a cursor; later rows are cut off.  Collective.

        Args:
            cursor: position that `cursor` returned: length `end` [bytes] and number of `rows`.
        """
        make_parent(comm, self.path, file=True)
        on_rank_zero(comm, lambda: self._cut(head, cursor["end"], cursor["rows"]))
        self.end = cursor["end"]
        self._rows = cursor["rows"]

    def _cut(self, head: Sequence[str], end: int, rows: int) -> None:
        """Cut off the bytes after `end`, if the file is the one that the checkpoint knows; on one
        rank.

        Nothing is changed if a check fails. A file that does not exist counts as empty.

        Args:
            end: length of the file that is kept [bytes].
        """
        content = b""
        if self.path.is_file():
            with open_file(self.path, self.path.parent) as file:
                content = file.read()
        check(
            len(content) >= end,
            f"'{self.path}' is shorter than it was when the checkpoint was written, {len(content)} "
            f"instead of {end} "
            "bytes; put back a copy of it, or start again.",
        )
        first_line = _csv_line(head)
        check(
            content.startswith(first_line),
            f"'{self.path}' has other columns than this run; restart with the same ones, or give "
            "another name.",
        )
        kept = content[:end]
        check(
            kept.endswith(b"\n") and kept.count(b"\n") == rows + first_line.count(b"\n"),
            f"'{self.path}' was replaced since the checkpoint was written, when it had {rows} "
            "rows; put back a copy of it, or start again.",
        )
        os.truncate(self.path, end)


def append_bytes(path: Path, end: int, content: bytes) -> None:
    """Write bytes at a position of a file; if the disk has no room for all of them, none is written
    and OSError raised.

    Args:
        end: position [bytes] at which `content` begins, normally the end of the file.
    """
    # Without a buffer, a full disk is noticed here and not when the file is closed.
    with open_to_write(path, "r+b") as file:
        file.seek(end)
        try:
            if file.write(content) != len(content):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError:
            file.truncate(end)
            raise


# Units at the end of heads of the energy balance and of gas.
UNIT = re.compile(r" \[(J|kg m/s|kg m²/s|kg|kg/s|Pa|K|m³)\]$")


def without_units(head: Iterable[str]) -> list[str]:
    """Names of columns without their units, but for the first one, which rows are over."""
    names = list(head)
    return [*names[:1], *(UNIT.sub("", column) for column in names[1:])]


def _csv_line(values: Iterable[Any]) -> bytes:
    """A row of a CSV file, with its line break, in UTF-8."""
    entries = []
    for value in safe_cells(values):
        if isinstance(value, float):
            # The type of NumPy would be part of its representation.
            entries.append(repr(float(value)))
        else:
            entries.append(value)
    line = io.StringIO()
    csv.writer(line).writerow(entries)
    # Names may contain half of a surrogate pair, e.g. from a file name, which has no UTF-8.
    return line.getvalue().encode(errors="backslashreplace")


class TableOutput(Continued):
    """An output of a table, with a row for each step or time at which it is due.

    Args:
        path: of the file.
        schedule: when rows are written; the first and the last state always.
    """

    def __init__(self, path: str | Path, schedule: Schedule) -> None:
        self.path = Path(path)
        self.schedule = schedule
        self._table = Table(self.path)
        self._since: float | None = None  # time [s] of the last call of `record`

    @property
    def times(self) -> Sequence[float]:
        """Times that the run must meet [s]."""
        return self.schedule.times

    @property
    def writes(self) -> Sequence[Path]:
        return [self.path]

    def values(self, run: StateView) -> dict[str, Any]:
        """Values of the present state by the names of columns; the same on every rank.
        Collective."""
        raise NotImplementedError

    def _row(self, run: StateView) -> dict[str, Any]:
        """The value on the axis, the number of the step, and the values, by names of columns."""
        return self._with_axis(run, self.values(run))

    def _with_axis(self, run: StateView, values: dict[str, Any]) -> dict[str, Any]:
        """Values with the one on the axis and the number of the step, by names of columns."""
        row = {run.axis.column: float(run.time), "step": run.step}
        for name in row:
            check(
                name not in values,
                f"'{self.path}' would have two columns '{name}'; give one of them another name.",
            )
        return row | values

    def open(self, run: StateView) -> None:
        make_parent(run.comm, self.path)
        # A probe that fails must do so before the first step, and before an older table is lost.
        self._table.create(run.comm, list(self._first_row(run)))

    def _first_row(self, run: StateView) -> dict[str, Any]:
        """A row before the first state is computed, for its names.  Collective."""
        return self._row(run)

    def cursor(self) -> dict[str, Any]:
        return self._table.cursor()

    def resume(self, run: StateView, cursor: dict[str, Any]) -> None:
        """Continue after a restart: remove rows after the cursor."""
        self._table.cut(run.comm, list(self._row(run)), cursor)
        self._since = run.time

    def record(self, run: StateView, last: bool) -> None:
        is_due = self.schedule.due(run.step, run.time, last, self._since)
        self._since = run.time
        if is_due:
            self._table.append(run.comm, self._row(run).values())

    def close(self, run: StateView) -> None:
        """Nothing to close: each row is written completely."""


# Beginning of the columns of single causes of dissipation; readers of the table know them by it.
LOST = "dissipated "


@check_arguments
class Ledger(TableOutput):
    """CSV file with a row for every step: energies [J], momenta, gas masses [kg], closing errors,
    iterations.

    The first column is the time [s], or the load parameter of a path of equilibria.

    `energy_error` is (H - H0) - (supplied - dissipated) over the largest energy so far; it is zero
    at rest, while all energies are round-off.  H is the kinetic and stored energy, including that
    of the gas; supplied and dissipated energies are sums from the start.  If several items
    dissipate, each has a column in addition to the sum.  Equilibria have their `residual`, the
    unbalanced force over the load.

    Args:
        path: of the file.

    Raises:
        InputError: when the run is made: the folder cannot be made or written.

    Example:
        >>> thrown = gx.PointMass(2.0, comm=comm, name="thrown mass")
        >>> ledger = gx.Ledger(folder / "ledger.csv")
        >>> throw = gx.Simulation(gx.Scene(thrown), gx.Midpoint(dt=0.1), outputs=[ledger])
        >>> throw.run(until=0.3)
        >>> (folder / "ledger.csv").read_text().splitlines()[0][:42]
        'time,step,iterations,substeps,kinetic [J],'
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__(path, Schedule())

    def values(self, run: StateView) -> dict[str, Any]:
        """The present state as columns by name, with their units.

        `energy_error` and `mass_error` are relative, and left out where no energy is conserved.
        Columns of gas are left out if there is no gas.  Collective; the same on every rank.
        """
        t = run.totals
        account = run.account
        row: dict[str, Any] = {
            "iterations": account.last_iterations,
            "substeps": account.rejected,
            "kinetic [J]": t.kinetic,
        }
        row |= {f"stored {name} [J]": energy for name, energy in t.stored.items()}
        row |= {"supplied [J]": t.supplied, "dissipated [J]": t.dissipated}
        if len(t.losses) > 1:
            row |= {f"{LOST}{name} [J]": loss for name, loss in t.losses.items()}
        row |= account.columns
        if account.balance is not None:
            row |= {"energy_error": account.balance.energy_error}
        for axis, linear in zip("xyz", t.momentum, strict=True):
            row[f"momentum {axis} [kg m/s]"] = linear
        for axis, angular in zip("xyz", t.angular_momentum, strict=True):
            row[f"angular momentum {axis} [kg m²/s]"] = angular
        if t.mass:
            row |= {"gas mass [kg]": t.mass, "gas mass supplied [kg]": t.mass_supplied}
            if account.balance is not None:
                row |= {"mass_error": account.balance.mass_error}
        return row


@check_arguments
class Probes(TableOutput):
    """CSV file with values of probes: columns time [s] or load parameter, step, and one for each
    probe.

    Args:
        path: of the file.
        probes: functions of the run that return a number, the same on every rank, by the names of
            their columns; see `gx.probes`.
        every: steps between two rows, 1 by default; the first and the last state are always
            recorded.
        times: at which rows are written instead [s]; not together with `every`.

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
        probes: Annotated[Mapping[str, Probe], at_least(1)],
        *,
        every: Every | None = None,
        times: Times = (),
    ) -> None:
        super().__init__(path, Schedule.of("Probes", every, times))
        self.probes = dict(probes)
        for name in self.probes:
            check(
                name not in ("time", "step"),
                f"Probe '{name}' has the name of a column that exists; rename it.",
            )

    def _first_row(self, run: StateView) -> dict[str, Any]:
        for name, probe in self.probes.items():
            check_probe(run, f"Probe '{name}'", probe)
        return self._with_axis(run, dict.fromkeys(self.probes))

    def values(self, run: StateView) -> dict[str, Any]:
        found = {}
        for name, probe in self.probes.items():
            found[name] = evaluate_probe(run, f"Probe '{name}'", probe)
        return found


@check_arguments
class Series(Output):
    """Values of probes at the start and after every step, as arrays for scripts.

    `series[name]` is the array (n,) of the values of a probe, and `series.time` that of the times
    [s]; the same on every rank.  `outputs.Probes` writes the same values to a file.

    Args:
        probes: functions of the run that return a number, the same on every rank, by name.

    Raises:
        InputError: a probe is not a function; in the run, it fails, or does not return the same
            finite number on every rank; `series[name]` of an unknown name.

    Example:
        >>> ball = gx.PointMass(2.0, comm=comm, name="ball")
        >>> series = gx.Series({"height": gx.probes.Position(ball.port(), "z")})
        >>> scene = gx.Scene(ball, gx.Gravity(ball, (0.0, 0.0, -9.81)))
        >>> gx.Simulation(scene, gx.Midpoint(dt=0.1), outputs=[series]).run(until=0.2)
        >>> [round(z, 4) for z in series["height"].tolist()]
        [0.0, -0.0491, -0.1962]
    """

    times: Sequence[float] = ()

    def __init__(self, probes: Mapping[str, Probe]) -> None:
        self.probes = dict(probes)
        self._rows: list[list[float]] = []

    def open(self, run: StateView) -> None:
        """Nothing to prepare; rows of an earlier run with the same series are kept."""

    def record(self, run: StateView, last: bool) -> None:
        row = [run.time]
        for name, probe in self.probes.items():
            row.append(evaluate_probe(run, f"Probe '{name}'", probe))
        self._rows.append(row)

    def close(self, run: StateView) -> None:
        """Nothing to close."""

    @property
    def time(self) -> Array:
        """Times [s] of the start and of every step so far, (n,)."""
        return self._column(0)

    def __getitem__(self, name: str) -> Array:
        """Values (n,) of a probe at the times of `time`; an unknown name is refused."""
        check_known("The series", "probe", name, self.probes)
        return self._column(1 + list(self.probes).index(name))

    def _column(self, k: int) -> Array:
        """The values of a column, (n,); the first one is the time."""
        return np.array([row[k] for row in self._rows])
