"""Locks on output files: a file is written by one run at a time, and by one output of that run.

The lock on `out/ledger.csv` is the file `out/.ledger.csv.lock`, which rank 0 holds by the library
filelock.  The operating system releases it when the process ends, also after kill -9, so that a
lock file that is left behind blocks nobody.  `out/.ledger.csv.owner` next to it says who holds the
lock, for the message that refuses another run.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import time
import weakref
from collections.abc import Iterable
from contextlib import suppress
from itertools import combinations
from pathlib import Path

from filelock import FileLock, Timeout
from mpi4py import MPI

from gossamer_fx.core.checks.errors import InputError, check, on_rank_zero
from gossamer_fx.records.outputs.output import make_parent

# The last object of this process that took the lock on a path, for runs of one program that follow
# each other.
_LAST_OWNER: weakref.WeakValueDictionary[Path, FileLocks] = weakref.WeakValueDictionary()


class FileLocks:
    """The locks of one run on its output files and folders.

    Runs of one program may follow each other: a run takes over the locks of an earlier run of the
    same program, unless that one is inside `Simulation.run` (`running` is true).  On a file system
    without locks nothing is locked.
    """

    def __init__(self, comm: MPI.Intracomm, paths: Iterable[Path]) -> None:
        """Acquire the locks of all paths.  Collective."""
        self.running = False
        self._comm = comm
        self._paths = [Path(os.path.realpath(path)) for path in paths]
        self._locks: dict[Path, FileLock] = {}
        # A run that is dropped without being closed must not block the next one.
        weakref.finalize(self, _release_all, self._locks)
        for one, other in combinations(self._paths, 2):
            check(
                one != other,
                f"Two outputs of the run write '{one}'; give one of them another name.",
            )
        self.acquire()

    def acquire(self) -> None:
        """Take the locks that are not held yet; all of them or, if one is refused, none."""
        for path in self._paths:
            make_parent(self._comm, path)
        on_rank_zero(self._comm, self._acquire_all)

    def release(self) -> None:
        """Release all locks and remove their files."""
        _release_all(self._locks)

    def _acquire_all(self) -> None:
        """Lock every file on this rank; if one is locked by another run, release all and raise."""
        try:
            for path in self._paths:
                if path not in self._locks:
                    self._locks[path] = self._take_over(path) or _lock(path)
                    _LAST_OWNER[path] = self
        except Exception:
            self.release()
            raise

    def _take_over(self, path: Path) -> FileLock | None:
        """The lock that an earlier run of this program holds on a path, which it loses; None if
        there is none.
        """
        other = _LAST_OWNER.get(path)
        if other is None or path not in other._locks:
            return None
        check(
            not other.running,
            f"'{path}' is being written by another run of this program; wait for its end, or give "
            "another folder.",
        )
        return other._locks.pop(path)


def _lock(path: Path) -> FileLock:
    """Lock a path for this process, and write a file next to it that names the process."""
    # The run may be closed by another thread than the one that opened it.
    lock = FileLock(_lock_file(path), thread_local=False)
    try:
        lock.acquire(blocking=False)
        # A run that ended between our opening and locking the file has removed it: such a lock
        # protects nothing.
        while not _lock_file(path).exists():
            lock.release()
            lock.acquire(blocking=False)
    except NotImplementedError:  # the file system has no locks
        return lock
    except (Timeout, PermissionError) as error:  # another user's lock file cannot even be opened
        raise InputError(
            f"'{path}' is being written by another run{_owner(path)}; wait for its end, or give "
            "another folder."
        ) from error
    about = {
        "pid": os.getpid(),
        "host": platform.node(),
        "program": sys.argv[0],
        "since": time.strftime("%F %T"),
    }
    with suppress(OSError):  # without the file, e.g. on a full disk, the message names no process
        _owner_file(path).write_text(json.dumps(about), encoding="utf-8")
    return lock


def _release_all(locks: dict[Path, FileLock]) -> None:
    """Release locks and remove their files; `locks` is empty then."""
    while locks:
        path, lock = locks.popitem()
        # The files are removed while they are still locked, so that nobody else's are; their folder
        # may be gone.
        for file in (_owner_file(path), _lock_file(path)):
            with suppress(OSError):
                file.unlink()
        lock.release()


def _lock_file(path: Path) -> Path:
    return path.with_name(f".{path.name}.lock")


def _owner_file(path: Path) -> Path:
    return path.with_name(f".{path.name}.owner")


def _owner(path: Path) -> str:
    """Who holds the lock, for a message; nothing if that cannot be read."""
    try:
        owner = json.loads(_owner_file(path).read_text(encoding="utf-8"))
        program = Path(owner["program"]).name
        return f" ({program}, process {owner['pid']} on {owner['host']}, since {owner['since']})"
    except (OSError, ValueError, KeyError, TypeError):
        return ""
