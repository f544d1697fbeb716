"""Start a program on several MPI ranks: python3 -m gossamer_fx.cli.launch RANKS PROGRAM ...

Open MPI's mpirun kills the ranks 0.2 s after a SIGTERM or SIGINT, which is too short for a step.  So it does not get
them: the first one is handed on as SIGUSR1, which mpirun passes to all ranks and at which a run ends with its step and
a checkpoint; a second one has its usual effect.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from types import FrameType

_SIGNALS = (signal.SIGTERM, signal.SIGINT)
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG


def launch(ranks: int, program: Sequence[str]) -> int:
    """Run a Python program on some ranks; returns its exit code, 128 + signal if one ended it."""
    heard: list[int] = []

    def hand_on(number: int, frame: FrameType | None) -> None:
        heard.append(number)
        run.send_signal(signal.SIGUSR1 if len(heard) == 1 else number)

    # Ctrl-C of a terminal reaches all processes of the group: mpirun has one of its own, which a terminal does not read
    run = subprocess.Popen(
        ["mpirun", "-n", str(ranks), sys.executable, *program],
        stdin=subprocess.DEVNULL if os.isatty(0) else None,
        start_new_session=True,
        preexec_fn=_die_with_parent,
    )
    for number in _SIGNALS:
        signal.signal(number, hand_on)
    code = run.wait()
    return 128 + heard[0] if heard and code else code if code >= 0 else 128 - code


def launch_alike(jobs: int, program: Sequence[str]) -> int:
    """Run a Python program in several processes that share its work; returns zero if one of them came to the end.

    The first one alone speaks.  Any of them may die: those that are left go on.
    """
    command = [sys.executable, *program]
    runs = [
        subprocess.Popen(command, stdout=None if k == 0 else subprocess.DEVNULL)
        for k in range(jobs)
    ]
    try:
        return min(abs(run.wait()) for run in runs)
    except KeyboardInterrupt:
        for run in runs:
            run.terminate()
        raise


def _die_with_parent() -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGTERM)


if __name__ == "__main__":
    sys.exit(launch(int(sys.argv[1]), sys.argv[2:]))
