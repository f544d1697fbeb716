"""What is said when the kernel ends a program for lack of memory.

A container or a batch system limits the memory of a group of processes (cgroup).  Where that is
used up the kernel kills one of them, which cannot say anything.  So where there is such a limit a
small child process waits for the end of this one, and says it.
"""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, NoReturn

from gossamer_fx.core.checks.ctrl_c import is_first_rank

# Where the groups are, by their names in /proc/self/cgroup, and in each the file of the limit and
# that which counts the processes that were killed: version 1, and two places of version 2.
_HOMES = (
    ("memory", Path("/sys/fs/cgroup/memory"), "memory.limit_in_bytes", "memory.oom_control"),
    ("", Path("/sys/fs/cgroup"), "memory.max", "memory.events"),
    ("", Path("/sys/fs/cgroup/unified"), "memory.max", "memory.events"),
)

# The end of a pipe that this process holds as long as it lives.
_alive: list[int] = []


class _Group(NamedTuple):
    """A group of processes whose memory is limited."""

    limit: int
    counter: Path

    def kills(self) -> int:
        """How many of its processes the kernel has ended for lack of memory."""
        found = re.search(r"^oom_kill (\d+)$", _text(self.counter), re.MULTILINE)
        return int(found[1]) if found else 0


def speak_if_killed() -> None:
    """Let a child process say a sentence if the kernel ends this one for lack of memory, where the
    memory of its group is limited; on the first rank."""
    if _alive or not is_first_rank():
        return
    group = _limited_group()
    if group is None:
        return
    before = group.kills()
    reader, writer = os.pipe()
    if not os.fork():
        os.close(writer)
        _wait(reader, group, before)
    os.close(reader)
    _alive.append(writer)


def _wait(reader: int, group: _Group, before: int) -> NoReturn:
    """Wait for the end of the parent of this process, and say why if it was killed."""
    try:
        # Neither Ctrl-C nor mpirun, which ends all of a group of processes, ends this one.
        os.setsid()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGUSR2):
            signal.signal(number, signal.SIG_IGN)
        # A program that reads the output waits for its end.
        nothing = os.open(os.devnull, os.O_RDWR)
        os.dup2(nothing, 0)
        os.dup2(nothing, 1)
        os.read(reader, 1)
        if group.kills() > before:
            words = (
                "gossamer: the system has ended this program, as the memory of its group of "
                f"processes, {group.limit >> 20} MiB, was used up; give it more, or take fewer "
                "cells, fields or ranks; a run goes on from its last checkpoint with --restart.\n"
            )
            os.write(2, words.encode())
    finally:
        os._exit(0)


def _limited_group() -> _Group | None:
    """The group of this process, if its memory, or that of a group around it, is limited to less
    than the machine has."""
    limit = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    found = None
    for line in _text(Path("/proc/self/cgroup")).splitlines():
        _, kinds, path = (line + "::").split(":")[:3]
        for kind, home, limit_name, counter_name in _HOMES:
            if kind not in kinds.split(","):
                continue
            own = home / path.lstrip("/")
            # In a container the path may be that outside of it.
            if not (own / counter_name).exists():
                own = home
            for group in _with_parents(own, home):
                words = _text(group / limit_name).strip()
                if words.isdecimal() and int(words) < limit:
                    limit = int(words)
                    found = _Group(limit, own / counter_name)
    return found


def _with_parents(group: Path, home: Path) -> Iterator[Path]:
    """A group and those around it."""
    yield group
    while group != home:
        group = group.parent
        yield group


def _text(path: Path) -> str:
    """The contents of a file of the kernel; nothing if it cannot be read."""
    try:
        return path.read_text()
    except OSError:
        return ""
