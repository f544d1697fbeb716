"""End of a run in which nothing goes on: a function of the user that never returns, say."""

from __future__ import annotations

import os
import sys
import threading
import time
import traceback
from pathlib import Path
from typing import TYPE_CHECKING

from gossamer_fx.records.outputs.output import Output

if TYPE_CHECKING:
    from mpi4py import MPI

    from gossamer_fx.solve.view import StateView

# Seconds for which a rank that is not in the user's file waits for one that is, to name its line.
_GRACE = 2.0

# Times per allowed time at which the time without progress is compared with it.
_LOOKS = 20


class NoProgress(Output):
    """Output that ends the program on all ranks if no step is completed for a time.

    It runs in a thread, which a function that is written in Python cannot stop.

    Args:
        comm: the ranks, all of which end.
        seconds: longest time without a completed step [s], also before the first one.
        scene: the user's file, whose line is named.
    """

    times = ()

    def __init__(self, comm: MPI.Intracomm, seconds: float, scene: Path) -> None:
        self._comm = comm
        self._seconds = seconds
        self._scene = scene.resolve()
        self._since = time.monotonic()
        self._after = "before the first step"
        self._closed = threading.Event()
        self._main = threading.get_ident()
        threading.Thread(target=self._wait, daemon=True).start()

    def open(self, run: StateView) -> None:
        """Count the time from the start of the run."""
        self._since = time.monotonic()

    def record(self, run: StateView, last: bool) -> None:
        """Count the time from this step."""
        self._since = time.monotonic()
        self._after = f"after step {run.step}"

    def close(self, run: StateView) -> None:
        """Let the program take any time from now on."""
        self._closed.set()

    def _wait(self) -> None:
        while not self._closed.wait(self._seconds / _LOOKS):
            if time.monotonic() - self._since > self._seconds:
                self._end()

    def _line(self) -> int | None:
        """The line of the user's file in which this rank is."""
        frames = traceback.extract_stack(sys._current_frames()[self._main])
        lines = [f.lineno for f in frames if Path(f.filename).resolve() == self._scene]
        return lines[-1] if lines else None

    def _end(self) -> None:
        """Say where this rank is, and end all."""
        line = self._line()
        where = ""
        if line is None:
            time.sleep(_GRACE * self._comm.size)
        else:
            where = (
                f" '{self._scene.name}', line {line}, has not returned on rank {self._comm.rank};"
            )
            time.sleep(_GRACE * self._comm.rank / self._comm.size)
        sys.stderr.write(
            f"gossamer: No step has been completed for {self._seconds:g} s, {self._after};{where} "
            "correct it, or give a longer time with --no-progress-after, and go on from a "
            "checkpoint, if there is one, with --restart.\n"
        )
        sys.stderr.flush()
        if self._comm.size > 1:
            self._comm.Abort(1)
        os._exit(1)
