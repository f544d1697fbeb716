"""Signals that end a run after the step that is being made."""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any

from mpi4py import MPI

# mpirun passes SIGUSR1 and SIGUSR2 on to its ranks; after the other two it kills them before a long
# step ends.
SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1, signal.SIGUSR2)

# The exit code of a program that a signal ends is this number plus that of the signal.
EXIT_CODE_OFFSET = 128


class Interrupted(SystemExit):
    """A run ended because of a signal, with all its files closed.

    If it is not caught, it ends the program with the code 128 + number of the signal.

    Attributes:
        signal: the signal.  SIGUSR2, by which the launcher hands on Ctrl-C, is a SIGINT.

    Example:
        >>> import signal
        >>> gx.run.Interrupted(signal.SIGINT).code
        130
    """

    def __init__(self, number: int) -> None:
        if number == signal.SIGUSR2:
            number = signal.SIGINT
        super().__init__(EXIT_CODE_OFFSET + number)
        self.signal = signal.Signals(number)


class Listener:
    """Context in which `SIGNALS` are noted instead of having their usual effect.
    A second signal of the same kind has its usual effect, so that a step that never ends can be
    stopped."""

    def __init__(self) -> None:
        self._noted = 0
        self._usual: dict[int, Any] = {}  # handlers outside the context

    def __enter__(self) -> Listener:
        # Python lets only the main thread set handlers; a run in another thread is not interrupted.
        if threading.current_thread() is threading.main_thread():
            self._usual = {number: signal.signal(number, self._note) for number in SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        for number in self._usual:
            self._restore_handler(number)

    def _note(self, number: int, frame: FrameType | None) -> None:
        """Note a signal; called by Python."""
        self._noted = number
        self._restore_handler(number)

    def _restore_handler(self, number: int) -> None:
        """Give a signal its usual effect."""
        usual = self._usual[number]
        # None: the handler was not set by Python, and Python cannot set it again.
        if usual is None:
            usual = signal.SIG_DFL
        signal.signal(number, usual)

    def heard(self, comm: MPI.Intracomm) -> int:
        """The number of a signal that any rank has received, or zero; the same on every rank."""
        return int(comm.allreduce(self._noted, op=MPI.MAX))
