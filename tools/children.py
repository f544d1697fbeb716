"""Run a program as a child of this one, as if this process had been replaced."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from types import FrameType

HANDED_ON = (signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2)


def run_child(command: Sequence[str], environment: Mapping[str, str] | None = None) -> int:
    """Run a command; signals are handed on to it.

    Returns:
        Its exit code; 128 + signal if a signal ended it.
    """
    child: subprocess.Popen[bytes] | None = None
    early: list[int] = []

    def hand_on(number: int, frame: FrameType | None) -> None:
        if child is None:
            early.append(number)
        else:
            child.send_signal(number)

    for number in HANDED_ON:
        signal.signal(number, hand_on)
    # A terminal sends Ctrl-C to the child itself; a second one would be taken for impatience.
    if any(os.isatty(stream) for stream in (0, 1, 2)):
        signal.signal(signal.SIGINT, lambda number, frame: None)
    else:
        signal.signal(signal.SIGINT, hand_on)
    # mpirun of MPICH talks with its ranks by a file that they inherit
    child = subprocess.Popen(command, env=environment, close_fds=False)
    for signal_before_the_start in early:
        child.send_signal(signal_before_the_start)
    code = child.wait()
    if code < 0:
        return 128 - code
    return code
