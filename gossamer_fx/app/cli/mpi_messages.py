"""Removes from the output of mpirun what only repeats that a rank has failed."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import BinaryIO

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
# Messages of one line, which are written in one piece:
# 1. of MPICH about MPI_Abort; it writes nothing about a code that is not zero;
# 2. of PMIx, which starts Open MPI's ranks, where a rank that has ended cannot be told that others
#    have.
LINES = re.compile(
    rb"Abort\(\d+\) on node \d+ [^\n]*application called MPI_Abort[^\n]*\n"
    rb"|\[\S+:\d+\] PMIX ERROR: PMIX_ERR_UNREACH in file [^\n]*\n"
)
# By its first letters a message is one of the above or is certainly not; by this much of it, it is
# or is not.
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
    """

    def __init__(self, write: Callable[[bytes], object]) -> None:
        self._write = write
        self._waiting = b""
        self._removed = b""
        self._anything_passed = False
        self._after_message = False

    def feed(self, data: bytes) -> None:
        """Take more output; what cannot be part of a message is passed on at once."""
        # Open MPI 5 ends the last of its messages with a zero byte
        self._waiting += data.replace(b"\0", b"")
        while self._advance():
            pass

    def close(self) -> None:
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
            other = not _may_repeat(body) or (len(body) >= DECIDED and not _repeats(body))
            if other:
                self._take(len(RULE))
            return other
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
        taken = self._waiting[:length]
        self._removed += b"".join(LINES.findall(taken))
        self._pass_on(LINES.sub(b"", taken))
        self._waiting = self._waiting[length:]

    def _pass_on(self, data: bytes) -> None:
        if data:
            self._write(data)
        self._anything_passed |= bool(data.strip())


def _may_repeat(body: bytes) -> bool:
    first = b" ".join(body.split())[:FIRST]
    return any(begin.startswith(first) for begin in REPETITIONS)


def _repeats(body: bytes) -> bool:
    words = b" ".join(body.split())
    # numbers and names of a process, which differ from run to run
    words = re.sub(rb"rank \d+ with PID \d+ on node \S+", b"rank N with PID N on node N", words)
    return words.startswith(REPETITIONS)


def copy_without_repetitions(source: BinaryIO, target: BinaryIO) -> None:
    """Copy the output of mpirun until its end, as it comes, without messages that repeat an error.

    Args:
        source: binary stream that is read, e.g. the standard error of mpirun.
        target: binary stream that is written, and flushed each time.
    """

    def write(data: bytes) -> None:
        target.write(data)
        target.flush()

    messages = MessageFilter(write)
    while data := source.read1():  # type: ignore[attr-defined]
        messages.feed(data)
    messages.close()
