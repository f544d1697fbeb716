"""Whether a rank waits for others, for ever if one of them has ended.

mpi4py lets other threads of Python go on while it waits, so that one of them can see it.  Other
libraries, e.g. dolfinx and PETSc, do not.  Seen from another process a rank that waits takes its
share of a core, much of it in the system, since it yields its core again and again
(`yield_while_waiting`), but neither new memory nor files.
"""

from __future__ import annotations

import os
import sys
import threading
from itertools import islice
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

# Environment variable by which a rank of Open MPI yields its core while it waits, and that with its
# number.
_YIELDS = "OMPI_MCA_mpi_yield_when_idle"
_RANK = b"OMPI_COMM_WORLD_RANK="

# Of the time of a core that a rank which waits takes: the share in the system is 0.3 to 0.7 where
# it yields, 0.04 where it does not, and less where it computes.
_SYSTEM_SHARE = 0.15
# Ticks of the clock, of 10 ms, below which the share is not known.
_MIN_TICKS = 10
# Pages of memory that its other threads may take.
_FEW_PAGES = 20


def yield_while_waiting() -> None:
    """Let a rank yield its core while it waits, if MPI has not been loaded yet and the user does
    not say otherwise; the launcher does so, too."""
    if "mpi4py.MPI" not in sys.modules:
        os.environ.setdefault(_YIELDS, "1")


class Use(NamedTuple):
    """What a process has taken so far: ticks in its own code and in the system, pages of memory,
    calls that read or write files."""

    own: int
    system: int
    pages: int
    calls: int


def uses_of_ranks() -> dict[int, Use]:
    """What other ranks on this machine have taken, as far as they yield their cores and this is
    known: of the other children of the parent of this one, by rank."""
    found: dict[int, Use] = {}
    if os.environ.get(_YIELDS) != "1":
        return found
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            # Behind the name of the program, which may hold anything.
            fields = (folder / "stat").read_bytes().rpartition(b")")[2].split()
            if int(fields[1]) != os.getppid() or folder.name == str(os.getpid()):
                continue
            variables = (folder / "environ").read_bytes().split(b"\0")
            ranks = [v.removeprefix(_RANK) for v in variables if v.startswith(_RANK)]
            lines = (folder / "io").read_text().splitlines()
            calls = sum(int(line.split()[1]) for line in lines if line.startswith("sysc"))
            pages = int(fields[7]) + int(fields[9])
            found[int(ranks[0])] = Use(int(fields[11]), int(fields[12]), pages, calls)
        # It has gone, or belongs to another user.
        except (OSError, ValueError, IndexError):
            continue
    return found


def has_waited(before: Use, after: Use) -> bool:
    """Whether a rank, which yields its core while it waits, did nothing else between two looks."""
    own = after.own - before.own
    system = after.system - before.system
    return (
        own + system >= _MIN_TICKS
        and system >= _SYSTEM_SHARE * (own + system)
        and after.pages - before.pages <= _FEW_PAGES
        and after.calls == before.calls
    )


class MainThread:
    """Looks at the main thread from time to time."""

    def __init__(self) -> None:
        self._frame: FrameType | None = None
        self._instruction = -1

    def waits_for_ranks(self) -> bool:
        """Whether the main thread is in the same call of mpi4py as when this was last asked."""
        frame = sys._current_frames().get(threading.main_thread().ident or 0)
        # The object itself is compared, as a later one may have the address of one that is gone.
        if frame is None:
            return False
        is_same = frame is self._frame and frame.f_lasti == self._instruction
        self._frame = frame
        self._instruction = frame.f_lasti
        return is_same and _is_of_mpi4py(_called(frame))


def _called(frame: FrameType) -> Any:
    """What a frame calls now, if its source is `name(...)` or `name.attribute(...)`, else None."""
    # Needed only when another rank has ended.
    import ast
    import linecache

    positions = islice(frame.f_code.co_positions(), frame.f_lasti // 2, None)
    first, last, begin, end = next(positions, (None, None, None, None))
    if first is None or last is None or begin is None or end is None:
        return None
    lines = [linecache.getline(frame.f_code.co_filename, n) for n in range(first, last + 1)]
    # Columns count bytes.
    text = [line.encode() for line in lines]
    text[-1] = text[-1][:end]
    text[0] = text[0][begin:]
    try:
        expression = ast.parse(b"".join(text).strip(), mode="eval").body
    except (SyntaxError, ValueError):
        return None
    if not isinstance(expression, ast.Call):
        return None
    attributes = []
    node = expression.func
    while isinstance(node, ast.Attribute):
        attributes.append(node.attr)
        node = node.value
    if not isinstance(node, ast.Name):
        return None
    value = frame.f_locals.get(node.id, frame.f_globals.get(node.id))
    for attribute in reversed(attributes):
        value = getattr(value, attribute, None)
    return value


def _is_of_mpi4py(called: Any) -> bool:
    """Whether a function is a method of an object of mpi4py."""
    owner = type(getattr(called, "__self__", None))
    return any(kind.__module__.startswith("mpi4py") for kind in owner.__mro__)
