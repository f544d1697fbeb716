"""Progress of a run on the terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import IO

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.records.fields.units import energy_words
from gossamer_fx.records.outputs.output import Output
from gossamer_fx.solve.view import Account, StateView

# Wall time [s] between two lines: on a terminal, where each replaces the one before, and in any
# other stream: a log file must stay short.
TERMINAL_INTERVAL = 0.5
FILE_INTERVAL = 10.0

# Columns of a terminal that are overwritten, so that nothing of a longer line before is left.
LINE_WIDTH = 150

TINY = 1e-300  # against division by zero


class StatusLine:
    """On a terminal one line that changes, in any other stream a line now and then.

    Args:
        stream: the terminal, or e.g. a log file.
        interval: wall time between two lines on a terminal [s].
        quiet: wall time before the first line [s].
    """

    def __init__(self, stream: IO[str], interval: float, quiet: float = 0.0) -> None:
        self.stream = stream
        self.is_terminal = stream.isatty()
        self.started = time.monotonic()
        self._interval = interval if self.is_terminal else max(interval, FILE_INTERVAL)
        self._next = self.started + quiet
        self._has_line = False  # whether an unfinished line is on the terminal

    def is_due(self) -> bool:
        """Whether enough time has passed since the last line."""
        return time.monotonic() >= self._next

    def write(self, words: str) -> None:
        """Write a line, in place of the one before on a terminal."""
        self._next = time.monotonic() + self._interval
        if self.is_terminal:
            self.stream.write("\r" + words.ljust(LINE_WIDTH))
            self._has_line = True
        else:
            self.stream.write(words + "\n")
        self.stream.flush()

    def close(self) -> None:
        """End the line on a terminal."""
        if self._has_line:
            self.stream.write("\n")
            self.stream.flush()
            self._has_line = False


@check_arguments
class Progress(Output):
    """Shows time, step, iterations and energy error of a run on rank 0, and a summary at its end.

    A terminal shows one line with the length of the step and the remaining wall time; any other
    stream gets a line every ten seconds.

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

    def __init__(self, stream: IO[str] | None = None, seconds: float = TERMINAL_INTERVAL) -> None:
        check(
            not getattr(stream, "closed", False), "Progress: stream is closed; give an open file."
        )
        self._stream = stream or sys.stderr
        self._interval = seconds

    def open(self, run: StateView) -> None:
        """Print the size of the scene and the time of its compilation."""
        self._start = run.time
        self._line = StatusLine(self._stream, self._interval)
        self._print(
            run,
            f"{run.system.unknowns.numbering.size} unknowns, "
            f"compiled in {run.account.compile_seconds:.1f} s\n",
        )

    def _print(self, run: StateView, text: str) -> None:
        """Write a text on rank 0."""
        if run.comm.rank == 0:
            self._stream.write(text)
            self._stream.flush()

    def record(self, run: StateView, last: bool) -> None:
        """Write a line on rank 0 if enough wall time has passed since the last one.  Collective."""
        # The energy error is collective, and clocks differ: rank 0 decides for all ranks.
        if not run.comm.bcast(last or self._line.is_due()):
            return
        words = self._words(run)
        if run.comm.rank == 0:
            self._line.write(words)

    def _words(self, run: StateView) -> str:
        """Time, step, iterations and energy error; on a terminal also the length of the step [s],
        and the share of the run that is made with the wall time that is left [s].  Collective."""
        account = run.account
        words = f"{run.axis.symbol} = {run.time:.6g} of {account.until:.6g} {run.axis.unit}   "
        words += f"step {run.step}   iterations {account.last_iterations}   "
        words += energy_balance(account)
        # Before the first step, no step has a length that could be shown.
        if self._line.is_terminal and run.step:
            share = (run.time - self._start) / max(account.until - self._start, TINY)
            elapsed = time.monotonic() - self._line.started
            left = elapsed * (1 - share) / max(share, TINY)
            words += f"   h {run.system.unknowns.h:.2g} s   {100 * share:.0f}%, {left:.0f} s left"
        return words

    def close(self, run: StateView) -> None:
        """Print a summary: steps, iterations, wall times [s], and closing errors."""
        self._line.close()
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
