"""Signals, after which a run ends with its step, and errors on a single rank."""

from __future__ import annotations

import signal
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from mpi4py import MPI

from gossamer_fx.checks.errors import InputError, OutputFailure, StepFailure

ON_ALL_RANKS = (InputError, StepFailure, OutputFailure)
PATIENCE, TAG = 10.0, 28531  # s that a rank with an error waits for the others; a message that nobody else sends
SIGNALS = (signal.SIGTERM, signal.SIGINT)


class Interrupted(SystemExit):
    """A run that ended because of a signal, with all its files closed; ends the program with code 128 + signal."""

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.signal = signal.Signals(number)


class Listener:
    """Notes SIGTERM and SIGINT as long as it is entered; a second one has its usual effect."""

    def __init__(self) -> None:
        self._noted, self._usual = 0, dict[int, Any]()

    def __enter__(self) -> Listener:
        if threading.current_thread() is threading.main_thread():  # others cannot
            self._usual = {number: signal.signal(number, self._note) for number in SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        for number in self._usual:
            self._give_back(number)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._noted = number
        self._give_back(number)

    def _give_back(self, number: int) -> None:
        usual = self._usual[number]
        signal.signal(number, signal.SIG_DFL if usual is None else usual)

    def heard(self, comm: MPI.Intracomm) -> int:
        """The number of a signal that any rank has had, else zero; the same on every rank."""
        return int(comm.allreduce(self._noted, op=MPI.MAX))


@contextmanager
def abort_on_lone_error(comm: MPI.Intracomm) -> Iterator[None]:
    """See that an error of one rank does not leave the others waiting for it: all have it, or the program ends."""
    try:
        yield
    except Exception as error:
        if comm.size > 1 and not isinstance(error, ON_ALL_RANKS):
            _wait_for_others(comm)
        raise


def _wait_for_others(comm: MPI.Intracomm) -> None:
    others = [r for r in range(comm.size) if r != comm.rank]
    told = [comm.isend(None, r, TAG) for r in others] + [comm.irecv(source=r, tag=TAG) for r in others]
    deadline = time.monotonic() + PATIENCE
    while not all(request.test()[0] for request in told):
        if time.monotonic() > deadline:
            traceback.print_exc()
            sys.stderr.write(f"gossamer: rank {comm.rank} failed alone; its error is above, and the run ends.\n")
            sys.stderr.flush()
            comm.Abort(1)
        time.sleep(1e-3)
