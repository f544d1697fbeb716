"""Start a program on several MPI ranks: python3 -m gossamer_fx.app.cli.launch RANKS PROGRAM ...

Open MPI's mpirun kills the ranks 0.2 s after a SIGTERM or SIGINT, which is too short for a step.
So it does not get them: the first one is handed on as SIGUSR1, or SIGUSR2 for Ctrl-C, which mpirun
passes to all ranks and at which a run ends with its step and a checkpoint; a second one has its
usual effect.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Thread
from types import FrameType
from typing import BinaryIO, cast

from gossamer_fx.app.cli.mpi_messages import copy_without_repetitions

# The command of this package, for a child: without the current folder, whose files could stand for
# numpy and the like.
OWN_COMMAND = ("-P", "-m", "gossamer_fx")

# What is handed on as what.
_HANDED_ON: dict[int, int] = {signal.SIGTERM: signal.SIGUSR1, signal.SIGINT: signal.SIGUSR2}
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)
_SYSTEM_PREFIXES = ("/usr", "/usr/local")
# s that the last words of the ranks may take after mpirun has ended: one that it could not end may
# hold the pipe open for ever
_LAST_WORDS = 10.0


def find_mpirun() -> str | None:
    """The mpirun that belongs to this Python, or None.

    That of the virtual or conda environment of this Python, if it has one: the environment need not
    be activated.  Else the first one on PATH.
    """
    beside = Path(sys.executable).with_name("mpirun")
    if sys.prefix not in _SYSTEM_PREFIXES and os.access(beside, os.X_OK):
        return str(beside)
    return shutil.which("mpirun")


def child_environment() -> dict[str, str]:
    """The environment of a child that finds this package where the parent has found it."""
    home = str(Path(__file__).parents[3])
    paths = [home, os.environ.get("PYTHONPATH", "")]
    return os.environ | {"PYTHONPATH": os.pathsep.join(path for path in paths if path)}


def launch(ranks: int, program: Sequence[str]) -> int:
    """Run a Python program on several MPI ranks, and wait for its end.

    The first SIGTERM or SIGINT is handed on as `_HANDED_ON` says, and a run ends with its step; a
    second one has its usual effect.

    Args:
        ranks: how many.
        program: what follows `python3` on a command line.

    Returns:
        Its exit code; 128 + signal if a signal ended it; 1 if mpirun is missing, with a message on
        standard error.
    """
    mpirun = find_mpirun()
    if mpirun is None:
        print(
            f"gossamer: there is no mpirun in the folder of {sys.executable} or on PATH, which "
            f"{ranks} ranks need; install the MPI of mpi4py, or activate its environment.",
            file=sys.stderr,
        )
        return 1
    # A terminal sends Ctrl-C to all processes of the group: mpirun has a separate one, which cannot
    # read from the terminal.
    stdin = None
    if os.isatty(0):
        stdin = subprocess.DEVNULL
    run = subprocess.Popen(
        [mpirun, "-n", str(ranks), sys.executable, *program],
        stdin=stdin,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=end_with_parent,
        env=child_environment(),
    )
    heard: list[int] = []

    def hand_on(number: int, frame: FrameType | None) -> None:
        """Pass a signal to mpirun: the first one as one at which a run ends with its step."""
        heard.append(number)
        if len(heard) == 1:
            run.send_signal(_HANDED_ON[number])
        else:
            run.send_signal(number)

    for number in _HANDED_ON:
        signal.signal(number, hand_on)
    streams = (cast(BinaryIO, run.stderr), sys.stderr.buffer)
    words = Thread(target=copy_without_repetitions, args=streams, daemon=True)
    words.start()
    code = run.wait()
    words.join(_LAST_WORDS)
    if code < 0:
        return 128 - code
    if heard and code:
        return 128 + heard[0]
    return code


def launch_alike(jobs: int, program: Sequence[str]) -> int:
    """Run a Python program in several processes that share its work, and wait for all.

    The first one alone writes to the terminal.  Any of them may die: the others go on.

    Args:
        jobs: number of processes, each without MPI.
        program: what follows `python3` on a command line.

    Returns:
        Zero if one of them came to the end, otherwise the smallest exit code, or number of a
        signal.

    Raises:
        KeyboardInterrupt: after Ctrl-C, once the processes have been asked to end.
    """
    command = [sys.executable, *program]
    environment = child_environment()
    runs = [subprocess.Popen(command, env=environment)]
    for _ in range(1, jobs):
        runs.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, env=environment))
    try:
        return min(abs(run.wait()) for run in runs)
    except KeyboardInterrupt:
        for run in runs:
            run.terminate()
        raise


def end_with_parent() -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGTERM)


def main(words: Sequence[str]) -> int:
    """Start a program on several ranks: `gossamer mpi RANKS PROGRAM ...`.

    Args:
        words: the number of ranks, at least one, then what follows `python3` on a command line.

    Returns:
        Exit code of the program; 2, with a message, if the words have another form.
    """
    complete = len(words) >= 2
    if not complete or not words[0].isdecimal() or int(words[0]) < 1:
        print(
            "gossamer: mpi needs a number of ranks, then a script: ./gossamer mpi 2 script.py; "
            f"got '{' '.join(words)}'.",
            file=sys.stderr,
        )
        return 2
    return launch(int(words[0]), words[1:])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
