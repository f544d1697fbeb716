"""Files that one run alone may write: two outputs of one file are refused, and so is a second run at the same time.

A claim on `out/ledger.csv` is the file `out/.ledger.csv.lock`, which rank 0 locks (flock) and which says who holds it.
The system ends a lock when its process ends, whatever ended it, so none is ever left behind.
"""

from __future__ import annotations

import fcntl
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

from mpi4py import MPI

from gossamer_fx.checks.errors import InputError, check, on_rank_zero
from gossamer_fx.outputs.file_names import segment_number
from gossamer_fx.outputs.output import make_parent

_HERE: weakref.WeakValueDictionary[Path, Claims] = (
    weakref.WeakValueDictionary()
)  # claims of this process


class Claims:
    """The claims of one run on its files and folders; the same on every rank.

    Runs of one program may follow each other: a run takes over what another one of the same program has claimed,
    unless that one is running.

    Args:
        comm: of the run.
        paths: of files and folders.

    Raises:
        InputError: two of them are the same or segments of each other, their folder cannot be made or written, or
            another run has one of them.
    """

    def __init__(self, comm: MPI.Intracomm, paths: Iterable[Path]) -> None:
        self._comm, self._paths = comm, [Path(os.path.realpath(path)) for path in paths]
        self.running = False
        self._locks: dict[Path, int] = {}  # open files
        weakref.finalize(self, _release, self._locks)
        for a, b in combinations(self._paths, 2):
            same = segment_number(a, b) is not None or segment_number(b, a) is not None
            check(
                not same,
                f"Two outputs of the run write '{max(a, b, key=_length)}'; give one of them another name.",
            )
        self.hold()

    def hold(self) -> None:
        """Claim all of them; what is held already stays."""
        for path in self._paths:
            make_parent(self._comm, path)
        on_rank_zero(self._comm, self._hold)

    def _hold(self) -> None:
        try:
            for path in self._paths:
                if path not in self._locks:
                    self._take(path)
        except Exception:
            self.release()
            raise

    def _take(self, path: Path) -> None:
        other = _HERE.get(path)
        if other is not None and path in other._locks:
            check(
                not other.running,
                f"'{path}' is being written by another run of this program; wait for its end, or give another folder.",
            )
            self._locks[path] = other._locks.pop(path)
        else:
            self._locks[path] = _lock(path)
        _HERE[path] = self

    def release(self) -> None:
        """Let others write."""
        _release(self._locks)


def _length(path: Path) -> int:
    return len(str(path))


def _release(locks: dict[Path, int]) -> None:
    while locks:
        path, lock = locks.popitem()
        with suppress(OSError):  # the folder may be gone
            _lock_file(path).unlink()
        os.close(lock)


def _lock_file(path: Path) -> Path:
    return path.with_name(f".{path.name}.lock")


def _lock(path: Path) -> int:
    """An open file that is locked; the lock of a file system that knows no locks is nobody's."""
    name = _lock_file(path)
    while True:
        lock = os.open(name, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            holder = os.read(lock, 1000)
            os.close(lock)
            raise InputError(
                f"'{path}' is being written by another run{_told(holder)}; wait for its end, or give another folder."
            ) from error
        except OSError:
            return lock
        try:
            if os.fstat(lock).st_ino == name.stat().st_ino:
                break
        except FileNotFoundError:
            pass
        os.close(lock)  # the one who held it has just removed it
    os.ftruncate(lock, 0)
    about = {
        "pid": os.getpid(),
        "host": platform.node(),
        "program": sys.argv[0],
        "since": time.strftime("%F %T"),
    }
    os.write(lock, json.dumps(about).encode())
    return lock


def _told(holder: bytes) -> str:
    """Who holds a lock, in words."""
    try:
        who = json.loads(holder)
        return f" ({Path(who['program']).name}, process {who['pid']} on {who['host']}, since {who['since']})"
    except (ValueError, KeyError, TypeError):
        return ""
