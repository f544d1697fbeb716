"""Progress of a search for an equilibrium, on the standard error."""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass

from mpi4py import MPI

# Wall time [s] before the first line: a search that is shorter says nothing.
QUIET_SECONDS = 3.0

# Wall time [s] between two lines: on a terminal, where each replaces the one before, and in a file.
TERMINAL_INTERVAL = 0.5
FILE_INTERVAL = 10.0

# Columns of a terminal that are overwritten, so that nothing of a longer line before is left.
LINE_WIDTH = 150


@dataclass(frozen=True)
class SearchState:
    """Where a search stands after a pseudo-step: Newton iterations so far and at most,
    pseudo-steps, the length of the next one [s], the sum of those that succeeded [s], the
    unbalanced force over the load, and the value that it must reach."""

    iterations: int
    limit: int
    steps: int
    step: float
    pseudo_time: float
    residual: float
    tolerance: float


class SearchProgress:
    """Writes lines about a search that takes more than a few seconds, on rank 0.  A terminal shows
    one line that changes; any other stream gets a line every ten seconds."""

    def __init__(self, comm: MPI.Intracomm, unknowns: int, is_wanted: bool) -> None:
        self._writes = is_wanted and comm.rank == 0
        self._unknowns = unknowns
        self._stream = sys.stderr
        self._is_terminal = self._stream.isatty()
        self._interval = FILE_INTERVAL
        if self._is_terminal:
            self._interval = TERMINAL_INTERVAL
        self._started = time.monotonic()
        self._next = self._started + QUIET_SECONDS
        self._has_line = False  # whether an unfinished line is on the terminal

    def update(self, state: SearchState) -> None:
        """Write a line if enough time has passed."""
        now = time.monotonic()
        if not self._writes or now < self._next:
            return
        self._next = now + self._interval
        words = self._words(state, now - self._started)
        if self._is_terminal:
            self._stream.write("\r" + words.ljust(LINE_WIDTH))
            self._has_line = True
        else:
            self._stream.write(words + "\n")
        self._stream.flush()

    def _words(self, state: SearchState, elapsed: float) -> str:
        """The line about a state after some wall time [s]."""
        seconds_per_iteration = elapsed / max(state.iterations, 1)
        remaining = seconds_per_iteration * max(state.limit - state.iterations, 0)
        residual = f"residual {state.residual:.1e} of {state.tolerance:.0e}"
        if math.isinf(state.residual):
            residual = "no pseudo-step has converged yet"
        return (
            f"equilibrium of {self._unknowns} unknowns: {residual}, "
            f"iteration {state.iterations} of at most {state.limit}, "
            f"pseudo-step {state.steps} of {state.step:.1e} s, "
            f"pseudo-time {state.pseudo_time:.1e} s, "
            f"{elapsed:.0f} s so far, at most {remaining:.0f} s left"
        )

    def close(self) -> None:
        if self._has_line:
            self._stream.write("\n")
            self._stream.flush()
            self._has_line = False
