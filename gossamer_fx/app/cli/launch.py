"""Start a program on several MPI ranks, hand on signals to it, and shorten the output of mpirun:
python3 -m gossamer_fx.app.cli.launch RANKS PROGRAM ...

Signals.  Open MPI's mpirun kills the ranks 0.2 s after a SIGTERM or SIGINT, which is too short for
a step.  So it does not get them: the first one is handed on as SIGUSR1, or SIGUSR2 for Ctrl-C,
which mpirun passes to all ranks and at which a run ends with its step and a checkpoint; a second
one has its usual effect.  A SIGUSR1 is handed on as it is.

Output.  Messages of mpirun that only repeat that a rank has failed are removed.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from threading import Thread
from types import FrameType
from typing import BinaryIO, cast

from gossamer_fx.app.cli.script import BEHIND_THE_DOOR
from gossamer_fx.core.checks.door import check_temporary_folder
from gossamer_fx.core.checks.ending import TERMINATED, end_with_parent

# Open MPI puts each of its messages between two lines of dashes.
RULE = b"-" * 74
# How the messages begin that follow an error which a rank has already explained.  Lines are broken
# where the names of hosts and programs allow, so any white space stands for any other.
REPETITIONS = (
    b"prterun detected that one or more processes exited with non-zero status",
    b"mpirun detected that one or more processes exited with non-zero status",
    b"Primary job terminated normally, but",
    b"MPI_ABORT was invoked on rank",
    b'prterun has exited due to process rank N with PID N on node N calling "abort"',
)
# What is in the line by which a rank explains why it ends; a search for an equilibrium warns that
# it "was stopped by SIGTERM".
EXPLANATIONS = (b"gossamer: ", b"Traceback (most recent call last)", b" was stopped by ")
# Messages of one line, which are written in one piece:
# 1. of MPICH about MPI_Abort; it writes nothing about a code that is not zero;
# 2. of PMIx, which starts Open MPI's ranks, where a rank that has ended cannot be told that others
#    have.
LINES = re.compile(
    rb"Abort\(\d+\) on node \d+ [^\n]*application called MPI_Abort[^\n]*\n"
    rb"|\[\S+:\d+\] PMIX ERROR: PMIX_ERR_UNREACH in file [^\n]*\n"
)
# Bytes of a message: FIRST are compared to pass on at once what is certainly not a repetition, and
# with DECIDED it is known whether a message is one.
FIRST = 12
DECIDED = 400


class MessageFilter:
    """Passes on the output of mpirun without the messages that repeat an error.

    A rank that fails explains why in one sentence and ends with a code that is not zero.  Open MPI
    then writes that a process has ended with such a code, or has called MPI_Abort, as MPICH does,
    and hides the sentence.  Other messages, e.g. that a rank was killed, are passed on.  If the
    ranks themselves write nothing, everything is passed on.

    Args:
        write: takes the bytes that are passed on.

    Attributes:
        is_explained: whether a rank has written an error.
    """

    def __init__(self, write: Callable[[bytes], object]) -> None:
        self._write = write
        self._waiting = b""
        self._removed = b""
        self._anything_passed = False
        self._after_message = False
        self.is_explained = False
        self._last_line = b""

    def feed(self, data: bytes) -> None:
        """Take more output; what cannot be part of a message is passed on at once."""
        # Open MPI 5 ends the last of its messages with a zero byte
        waiting = self._waiting + data.replace(b"\0", b"")
        # first, as another process may write its line in the middle of a message
        self._removed += b"".join(LINES.findall(waiting))
        self._waiting = LINES.sub(b"", waiting)
        while self._advance():
            pass

    def close(self) -> None:
        """Pass on what still waits; if nothing was passed on, what was removed, too."""
        self._pass_on(self._waiting)
        self._waiting = b""
        if not self._anything_passed:
            self._write(self._removed)

    def _advance(self) -> bool:
        """Pass on or remove the next part of the output of mpirun that waits in the filter.

        Open MPI puts a message between two lines of dashes.  A message that only repeats that a
        rank has failed is removed; other text is passed on.

        Returns:
            False if more output is needed to decide.
        """
        if self._after_message and self._waiting:
            # the line ends with the message
            if self._waiting.startswith(b"\n"):
                self._remove(1)
            self._after_message = False
        begin = self._waiting.find(RULE)
        if begin < 0:
            unfinished = len(self._waiting) - len(self._waiting.rstrip(b"-"))
            self._take(len(self._waiting) - unfinished)
            return False
        self._take(begin)
        body = self._waiting[len(RULE) :]
        end = body.find(RULE)
        if end < 0:
            is_other = not _may_repeat(body) or (len(body) >= DECIDED and not _repeats(body))
            if is_other:
                self._take(len(RULE))
            return is_other
        if _repeats(body[:end]):
            self._remove(end + 2 * len(RULE))
            self._after_message = True
        else:
            # the second line of dashes may begin another message
            self._take(end + len(RULE))
        return True

    def _remove(self, length: int) -> None:
        self._removed += self._waiting[:length]
        self._waiting = self._waiting[length:]

    def _take(self, length: int) -> None:
        """Pass on the first bytes that wait."""
        self._pass_on(self._waiting[:length])
        self._waiting = self._waiting[length:]

    def _pass_on(self, data: bytes) -> None:
        if data:
            self._write(data)
        self._anything_passed |= bool(data.strip())
        self._last_line = (self._last_line + data)[-max(len(data), FIRST) - FIRST :]
        if any(beginning in self._last_line for beginning in EXPLANATIONS):
            self.is_explained = True


def _may_repeat(body: bytes) -> bool:
    """Whether the beginning of a message, of any length, may be that of a repetition."""
    first = b" ".join(body.split())[:FIRST]
    return any(begin.startswith(first) for begin in REPETITIONS)


def _repeats(body: bytes) -> bool:
    """Whether a message is one of `REPETITIONS`."""
    words = b" ".join(body.split())
    # numbers and names of a process, which differ from run to run
    words = re.sub(rb"rank \d+ with PID \d+ on node \S+", b"rank N with PID N on node N", words)
    return words.startswith(REPETITIONS)


def write_to_stderr(data: bytes) -> None:
    """Write bytes to standard error at once."""
    sys.stderr.buffer.write(data)
    sys.stderr.buffer.flush()


def copy_without_repetitions(source: BinaryIO, messages: MessageFilter) -> None:
    """Copy the output of mpirun until its end, as it comes, without messages that repeat an error.

    Args:
        source: binary stream that is read, e.g. the standard error of mpirun.
        messages: what passes on the output.
    """
    while data := source.read1():  # type: ignore[attr-defined]
        messages.feed(data)
    messages.close()


# The command of this package, for a child: without the current folder, whose files could stand for
# numpy and the like.
OWN_COMMAND = ("-P", "-m", "gossamer_fx")

# In a child before its program starts.
end_child_with_parent = partial(end_with_parent, signal.SIGTERM)

# The signals that mpirun gets instead of those that this process gets first.
_HANDED_ON: dict[int, int] = {
    signal.SIGTERM: signal.SIGUSR1,
    signal.SIGINT: signal.SIGUSR2,
    signal.SIGUSR1: signal.SIGUSR1,
}
_SYSTEM_PREFIXES = ("/usr", "/usr/local")
# Time [s] to wait for the last output of the ranks after mpirun has ended: a rank that it could not
# end may hold the pipe open for ever.
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

    The first signal is handed on as `_HANDED_ON` says, and a run ends with its step; a second one
    has its usual effect.

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
    try:
        check_temporary_folder()
    except OSError as error:
        print(f"gossamer: {error}", file=sys.stderr)
        return 1
    # A terminal sends Ctrl-C to all processes of the group: mpirun has a separate one, which cannot
    # read from the terminal.
    stdin = None
    if os.isatty(0):
        stdin = subprocess.DEVNULL
    folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
    terminated = Path(folder.name) / "terminated"
    run = subprocess.Popen(
        [mpirun, "-n", str(ranks), sys.executable, *program],
        stdin=stdin,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=end_child_with_parent,
        env=child_environment() | {TERMINATED: str(terminated)},
    )
    heard: list[int] = []

    def hand_on(number: int, frame: FrameType | None) -> None:
        """Pass a signal to mpirun: the first one as one at which a run ends with its step."""
        heard.append(number)
        if number == signal.SIGTERM:
            terminated.touch()
        if len(heard) == 1:
            run.send_signal(_HANDED_ON[number])
        else:
            run.send_signal(number)

    for number in _HANDED_ON:
        signal.signal(number, hand_on)
    messages = MessageFilter(write_to_stderr)
    copied = (cast(BinaryIO, run.stderr), messages)
    words = Thread(target=copy_without_repetitions, args=copied, daemon=True)
    words.start()
    code = run.wait()
    words.join(_LAST_WORDS)
    folder.cleanup()
    if code and not heard and not messages.is_explained:
        print(
            f"gossamer: the ranks have ended with the code {code} and without a word; if the "
            "program does not ask for that, a rank has ended by itself: look for os._exit, or for "
            "a library that breaks off, in what it called, and go on from the last checkpoint, "
            "if there is one, with --restart.",
            file=sys.stderr,
            flush=True,
        )
    if code and heard and not messages.is_explained:
        print(
            f"gossamer: the ranks have ended by {signal.Signals(heard[-1]).name}; go on from the "
            "last checkpoint, if there is one, with --restart.",
            file=sys.stderr,
            flush=True,
        )
    if code < 0:
        return 128 - code
    if heard and code:
        return 128 + heard[0]
    return code


def launch_alike(jobs: int, program: Sequence[str]) -> int:
    """Run a Python program in several processes that share its work, and wait for all.

    The first one alone writes to the terminal.  Any of them may die: the others go on.  Signals are
    handed on to all of them, and they end with this process.

    Args:
        jobs: number of processes, each without MPI.
        program: what follows `python3` on a command line.

    Returns:
        Zero if one of them came to the end, otherwise the smallest exit code, or number of a
        signal.
    """
    runs: list[subprocess.Popen[bytes]] = []

    def hand_on(number: int, frame: FrameType | None) -> None:
        for run in runs:
            run.send_signal(number)

    for number in _HANDED_ON:
        signal.signal(number, hand_on)
    for job in range(jobs):
        # In a separate session a process does not get Ctrl-C of a terminal a second time.
        run = subprocess.Popen(
            [sys.executable, *program],
            stdout=subprocess.DEVNULL if job else None,
            start_new_session=True,
            preexec_fn=end_child_with_parent,
            env=child_environment(),
        )
        runs.append(run)
    return min(abs(run.wait()) for run in runs)


def main(words: Sequence[str]) -> int:
    """Start a program on several ranks: `gossamer mpi RANKS PROGRAM ...`.

    Args:
        words: the number of ranks, at least one, then what follows `python3` on a command line.

    Returns:
        Exit code of the program; 2, with a message, if the words have another form.
    """
    complete = len(words) >= 2 and len(words[0]) < 10
    if not complete or not words[0].isdecimal() or int(words[0]) < 1:
        print(
            "gossamer: mpi needs a number of ranks, then a script: ./gossamer mpi 2 script.py; "
            f"got '{' '.join(words)}'.",
            file=sys.stderr,
        )
        return 2
    program = list(words[1:])
    if program[0].endswith(".py") and not Path(program[0]).exists():
        print(f"gossamer: there is no script '{program[0]}'; give its path.", file=sys.stderr)
        return 2
    if program[0].endswith(".py"):
        program = [*BEHIND_THE_DOOR, *program]
    return launch(int(words[0]), program)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
