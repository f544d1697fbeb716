"""Signals, after which a run ends with its step."""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any

from mpi4py import MPI

# the last is what mpirun hands on to its ranks, which it kills soon after the others
SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1)


class Interrupted(SystemExit):
    """A run that ended because of a signal, with all its files closed; ends the program with code 128 + signal."""

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.signal = signal.Signals(number)


class Listener:
    """Notes SIGTERM, SIGINT and SIGUSR1 as long as it is entered; a second one has its usual effect."""

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
