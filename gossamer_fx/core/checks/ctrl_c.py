"""Ctrl-C in the commands: one sentence at any time, also while the libraries are loaded.

The launcher hands Ctrl-C on to several ranks as SIGUSR2 (`gossamer_fx/app/cli/launch.py`).
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

Handler = Callable[[int, FrameType | None], object]

# The exit code of a program that a signal ends is this number plus that of the signal.
EXIT_CODE_OFFSET = 128

# What a command says that was stopped before its steps or after them.
STOPPED = "stopped by Ctrl-C; nothing is left to go on from."

# Variables in which Open MPI and MPICH tell a rank its number.
_RANKS = ("OMPI_COMM_WORLD_RANK", "PMI_RANK")

# Libraries that are being loaded, one within the other, and whether Ctrl-C has come meanwhile.
_loading = 0
_has_come = False


class CtrlC(KeyboardInterrupt):
    """Ctrl-C, as a signal that all ranks get; a function of the user that raises KeyboardInterrupt
    does so on its own rank."""


def end_at_ctrl_c() -> None:
    """Let Ctrl-C end this command in a sentence while its parts are loaded: it has written nothing
    yet."""
    _handle(_end, signal.default_int_handler)
    # The launcher lets Ctrl-C wait until now.
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def raise_at_ctrl_c() -> None:
    """Let Ctrl-C raise `CtrlC` from now on."""
    _handle(_raise, _end)


def usual_ctrl_c() -> None:
    """Give Ctrl-C its usual effect, for a script of the user."""
    _handle(signal.default_int_handler, _end)
    if signal.getsignal(signal.SIGUSR2) is signal.default_int_handler:
        signal.signal(signal.SIGUSR2, signal.SIG_DFL)


@contextmanager
def loading() -> Iterator[None]:
    """Context in which a library is loaded: Ctrl-C within it is raised at its end, as a library
    may catch it."""
    global _loading, _has_come
    _loading += 1
    try:
        yield
    finally:
        _loading -= 1
        if _has_come and not _loading:
            _has_come = False
            raise CtrlC


def is_first_rank() -> bool:
    """Whether this process is the first rank, or the only one, by the variables of MPI."""
    return all(os.environ.get(name, "0") == "0" for name in _RANKS)


def _handle(handler: Handler, before: Handler) -> None:
    """Set a handler of the signals by which Ctrl-C comes."""
    # A shell lets what it starts in the background ignore Ctrl-C.
    if signal.getsignal(signal.SIGINT) is before:
        signal.signal(signal.SIGINT, handler)
    if any(name in os.environ for name in _RANKS):
        signal.signal(signal.SIGUSR2, handler)


def _end(number: int, frame: FrameType | None) -> None:
    """End this process at once; one rank says why."""
    if is_first_rank():
        os.write(2, f"gossamer: {STOPPED}\n".encode())
    os._exit(EXIT_CODE_OFFSET + signal.SIGINT)


def _raise(number: int, frame: FrameType | None) -> None:
    """Raise `CtrlC`, or note it while a library is loaded."""
    global _has_come
    if not _loading:
        raise CtrlC
    _has_come = True
