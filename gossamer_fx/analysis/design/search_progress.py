"""Progress of a search for an equilibrium, on the standard error."""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass

from mpi4py import MPI

from gossamer_fx.records.outputs.progress import TERMINAL_INTERVAL, StatusLine

# Wall time [s] before the first line: a search that is shorter says nothing.
QUIET_SECONDS = 3.0


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
    """Writes lines about a search that takes more than a few seconds, on rank 0."""

    def __init__(self, comm: MPI.Intracomm, unknowns: int, is_wanted: bool) -> None:
        self._writes = is_wanted and comm.rank == 0
        self._unknowns = unknowns
        self._line = StatusLine(sys.stderr, TERMINAL_INTERVAL, QUIET_SECONDS)

    def update(self, state: SearchState) -> None:
        """Write a line if enough time has passed."""
        if not self._writes or not self._line.is_due():
            return
        elapsed = time.monotonic() - self._line.started
        remaining = elapsed / max(state.iterations, 1) * max(state.limit - state.iterations, 0)
        residual = f"residual {state.residual:.1e} of {state.tolerance:.0e}"
        if math.isinf(state.residual):
            residual = "no pseudo-step has converged yet"
        self._line.write(
            f"equilibrium of {self._unknowns} unknowns: {residual}, "
            f"iteration {state.iterations} of at most {state.limit}, "
            f"pseudo-step {state.steps} of {state.step:.1e} s, "
            f"pseudo-time {state.pseudo_time:.1e} s, "
            f"{elapsed:.0f} s so far, at most {remaining:.0f} s left"
        )

    def close(self) -> None:
        self._line.close()
