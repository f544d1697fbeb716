"""Progress of a run on the terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import IO, TYPE_CHECKING

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.records.fields.units import energy_words
from gossamer_fx.solve.view import Account, StateView

# Wall time [s] between two lines if the output is not a terminal: a log file must stay short.
LINE_INTERVAL = 10.0

if TYPE_CHECKING:
    from rich.progress import Progress as Bar


@check_arguments
class Progress:
    """Shows time, step, iterations and energy error of a run on rank 0, and a summary at its end.

    A terminal shows a bar with the length of the step and the remaining wall time; any other stream
    gets a line every ten seconds.

    Args:
        stream: default the standard error.
        seconds: least wall time between two updates [s].

    Example:
        >>> import io
        >>> lines = io.StringIO()
        >>> ball = gx.PointMass(2.0, comm=comm, name="ball")
        >>> progress = gx.outputs.Progress(lines)
        >>> gx.Simulation(gx.Scene(ball), gx.Midpoint(dt=0.1), outputs=[progress]).run(until=0.2)
        >>> lines.getvalue().startswith("3 unknowns, compiled in")
        True
    """

    times: Sequence[float] = ()

    def __init__(self, stream: IO[str] | None = None, seconds: float = 0.5) -> None:
        check(
            not getattr(stream, "closed", False), "Progress: stream is closed; give an open file."
        )
        self._stream = stream or sys.stderr
        self._pause = seconds
        self._shown = 0.0  # time of the last update, by the monotonic clock [s]
        self._bar: Bar | None = None

    def open(self, run: StateView) -> None:
        self._live = self._stream.isatty()
        if not self._live:
            self._pause = max(self._pause, LINE_INTERVAL)
        self._print(
            run,
            f"{run.system.numbering.size} unknowns, "
            f"compiled in {run.account.compile_seconds:.1f} s\n",
        )

    def _print(self, run: StateView, text: str) -> None:
        """Write a text on rank 0."""
        if run.comm.rank == 0:
            self._stream.write(text)
            self._stream.flush()

    def record(self, run: StateView, last: bool) -> None:
        """Update the terminal if enough wall time has passed since the last update.  Collective.

        `_shown` is the time of the last update and `_pause` the time between updates, both wall
        time [s]; `_live` tells whether a bar is drawn or lines are printed. Rank 0 alone writes."""
        now = time.monotonic()
        # The energy error is collective, and clocks differ: rank 0 decides for all ranks.
        is_early = now - self._shown < self._pause and not last
        if run.comm.bcast(is_early):
            return
        self._shown = now
        account = run.account
        balance = energy_balance(account)
        if self._live:
            self._draw(run, account, balance)
        else:
            where = f"{run.axis.symbol} = {run.time:.6g} of {account.until:.6g} {run.axis.unit}"
            counts = f"step {run.step}   iterations {account.last_iterations}   {balance}"
            self._print(run, f"{where}   {counts}\n")

    def _draw(self, run: StateView, account: Account, balance: str) -> None:
        """Update the bar on the terminal; only rank 0 draws."""
        if run.comm.rank > 0:
            return
        if self._bar is None:
            self._bar = _bar(self._stream)
            self._bar.add_task("")
            self._bar.start()
        words = f"{run.time:.4g}/{account.until:.4g} {run.axis.unit}  "
        # Before the first step, no step has a length that could be shown.
        if run.step:
            words += f"h {run.system.h:.2g} s  "
        words += f"step {run.step}  {account.last_iterations} it.  {balance}"
        self._bar.update(
            self._bar.task_ids[0], completed=run.time, total=account.until, description=words
        )
        self._bar.refresh()

    def close(self, run: StateView) -> None:
        """End the bar, and print a summary: steps, iterations, wall times [s], and closing
        errors."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
        steps = max(run.step, 1)
        account = run.account
        summary = (
            f"{run.step} steps in {account.seconds:.1f} s, {account.iterations / steps:.1f} "
            f"iterations a step, {account.rejected} steps rejected"
        )
        balance = account.balance
        if balance is not None and balance.at_rest:
            summary += "; at rest"
        elif balance is not None:
            # The relative error alone would hide a large error of the energy of a film next to the
            # energy of its gas.
            summary += (
                f"; energy closes to {balance.energy_error:.1e} of "
                f"{energy_words(balance.largest_energy)}, {balance.energy_defect:.1e} J"
            )
        if balance is not None and run.totals.mass:
            summary += f", gas mass to {balance.mass_error:.1e}"
        spent = f"{account.solver}; output {account.output_seconds:.1f} s"
        self._print(run, f"{summary}\n{spent}\n")


def energy_balance(account: Account) -> str:
    """The closing error of the energy in words; a share of energies that are round-off would mean
    nothing."""
    balance = account.balance
    if balance is None:
        return ""
    if balance.at_rest:
        return "at rest"
    return f"ledger {balance.energy_error:+.1e}"


def _bar(stream: IO[str]) -> Bar:
    """A progress bar of the library rich on a terminal; it is drawn only when it is told to
    refresh."""
    # Imported here, as runs without a terminal do not need it.
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    return Bar(
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=Console(file=stream),
        # A thread that refreshes the bar would write between the lines of other outputs.
        auto_refresh=False,
        expand=True,
    )
