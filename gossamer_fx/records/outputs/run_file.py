"""The files of a run: the contents of `run.json` and their check, locks, and names of files.

`run.json` may come from a stranger.  It is checked as a whole when it is read, so that its readers
find the keys and types that they expect.  An error names the key, the value and the expected type.

Locks.  An output file is written by one run at a time, and by one output of that run.  The lock on
`out/ledger.csv` is the file `out/.ledger.csv.lock`, which rank 0 holds by the library filelock.
The operating system releases it when the process ends, also after kill -9, so that a lock file that
is left behind blocks nobody.  `out/.ledger.csv.owner` next to it says who holds the lock, for the
message that refuses another run.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import os
import platform
import re
import sys
import time
import weakref
from collections.abc import Iterable
from contextlib import suppress
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout
from mpi4py import MPI

from gossamer_fx.core.checks.errors import InputError, are_usual_sizes, check, on_rank_zero
from gossamer_fx.core.checks.strange_files import read_json, write_new
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
        """Acquire the locks of all paths, of which no two may be equal.  Collective."""
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
    except OSError as error:  # another user's lock file cannot even be opened
        # filelock takes every refusal for the lock of another run.
        if isinstance(error, Timeout) and _has_no_locks(_lock_file(path)):
            return lock
        check(
            isinstance(error, Timeout | PermissionError),
            f"'{path}' cannot be locked by '{_lock_file(path)}' ({error.strerror}); remove that "
            "file, or give another folder.",
        )
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
        write_new(_owner_file(path), json.dumps(about).encode())
    return lock


def _has_no_locks(file: Path) -> bool:
    """Whether the file system refuses to lock a file at all, as some network file systems do."""
    descriptor = os.open(file, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in (errno.EWOULDBLOCK, errno.EAGAIN, errno.EINTR)
    finally:
        # This gives the lock back, if it was given.
        os.close(descriptor)
    return False


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
        owner = read_json(_owner_file(path), path.parent)
        program = Path(owner["program"]).name
        return f" ({program}, process {owner['pid']} on {owner['host']}, since {owner['since']})"
    except (OSError, ValueError, KeyError, TypeError):
        return ""


# Number of the format of run.json and of the other files in the folder.
FORMAT = 2

_REMEDY = "write the run again, or put back a copy of the file."

# Larger integers do not fit into the arrays of NumPy.
_MAX_INTEGER = 2**63

# Characters of a text, which is drawn or shown: matplotlib takes minutes for a million.
_MAX_TEXT = 5000

# Characters of a value in a message: the file may contain a text of any length.
_MAX_SHOWN = 60

# The kind of a value is a type, where float stands for any number and object for anything; a
# dictionary of kinds by key, or {str: kind} for free keys; [kind] for a list of any length; or a
# tuple of the kinds of a list of fixed length.
_POINT = (float, float, float)

_SOLID = {
    "name?": str,
    "X": [_POINT],
    "triangles": [(int, int, int)],
    "lines": [(int, int)],
    "moves": bool,
}
_BODY = {
    "kind": str,
    "nodes": int,
    "unknowns": int,
    "mass": float,
    "box": (_POINT, _POINT),
    "cells?": int,
    "order?": int,
    "groups?": [str],
    "area?": float,
    "length?": float,
    "law?": (str, {str: object}),
}
_PRESTRESS = {
    "unit": str,
    "asked": float,
    "mean": float,
    "least": float,
    "largest": float,
}
_CHAMBER = dict.fromkeys(("pressure", "temperature", "volume", "mass"), float)
# Kinds by key; a key that ends in a question mark may be missing.
_RUN = {
    "format": int,
    "title": str,
    "status": str,
    "ranks": int,
    "scene": {
        "unknowns": int,
        "ranks": int,
        "bodies": {str: _BODY},
        "section frames": [str],
        "items": {str: str},
        "chambers": {str: _CHAMBER},
        "energies": {str: float},
        "momentum": _POINT,
        "angular momentum": _POINT,
    },
    "parameters?": {str: object},
    "arguments?": {str: {str: object}},
    "kind": str,
    "axis": {"name": str, "unit": str, "at": float, "until": float},
    "method": {str: object},
    "fields": {str: [str]},
    "groups?": [str],
    "solids?": [_SOLID],
    "versions": {str: str},
    "origin?": {str: str},
    "captions": [str],
    "result?": {str: object},
    "summary?": str,
    "prestress?": {str: _PRESTRESS},
    "statistics": {
        "steps": int,
        "rejected": int,
        "iterations": int,
        "iterations a step": float,
        "seconds": float,
        "seconds of compilation": float,
        "at rest?": bool,
        "energy error?": float,
        "energy defect?": float,
        "largest energy?": float,
        "mass error?": float,
    },
}

# What a value of a kind is called in messages.
_WORDS = {bool: "true or false", str: "a text", int: "an integer", float: "a number"}


def read_run_file(folder: Path) -> dict[str, Any]:
    """The contents of a run's `run.json`; `InputError` if it is missing or not as `_RUN` says."""
    path = folder / "run.json"
    check(
        path.is_file(),
        f"There is no run in '{folder}'; give a folder with a run.json, as `Recording` writes.",
    )
    try:
        about = read_json(path, folder)
    except InputError:
        raise
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"'{path}' cannot be read ({error}); {_REMEDY}") from error
    version = None
    if isinstance(about, dict):
        version = about.get("format")
    # The format comes before all else: in another one, other keys are right.
    check(
        not isinstance(version, int) or version == FORMAT,
        f"'{path}' is of format {version}, not {FORMAT}; read it with the program that wrote it.",
    )
    check_kind(path, "the file", about, _RUN)
    for solid in about.get("solids", []):
        point_count = len(solid["X"])
        check(
            are_usual_sizes(np.array(solid["X"], dtype=float)),
            f"'{path}': a solid has a point that is not at numbers up to 1e100 m; {_REMEDY}",
        )
        indices = []
        for face in (*solid["triangles"], *solid["lines"]):
            indices += face
        check(
            all(0 <= index < point_count for index in indices),
            f"'{path}': a solid has {point_count} points, but its faces use others; {_REMEDY}",
        )
    return dict(about)


def check_kind(path: Path, where: str, value: Any, kind: Any) -> None:
    """Raise `InputError` unless a value of a JSON file, named `where`, is of a kind, see `_RUN`."""
    if isinstance(kind, dict):
        _refuse_unless(isinstance(value, dict), path, where, value, "an object")
        if str in kind:
            for name, inner in value.items():
                check_kind(path, f"a name in {where}", name, str)
                check_kind(path, f"{where} of {name!r}", inner, kind[str])
            return
        for key, inner in kind.items():
            name = key.removesuffix("?")
            check(name in value or key != name, f"'{path}': {where} has no '{name}'; {_REMEDY}")
            if name in value:
                check_kind(path, f"'{name}'", value[name], inner)
    elif isinstance(kind, list | tuple):
        _refuse_unless(isinstance(value, list), path, where, value, "a list")
        kinds = kind
        if isinstance(kind, list):
            kinds = kind * len(value)
        _refuse_unless(len(value) == len(kinds), path, where, value, f"a list of {len(kinds)}")
        for inner, inner_kind in zip(value, kinds, strict=True):
            check_kind(path, where, inner, inner_kind)
    elif kind in _WORDS:
        types = (int, float) if kind is float else kind
        fits = isinstance(value, types)
        if kind is int or kind is float:
            # In Python, bool is a subclass of int.
            is_large = isinstance(value, int) and abs(value) >= _MAX_INTEGER
            fits = fits and not isinstance(value, bool) and not is_large
        _refuse_unless(fits, path, where, value, _WORDS[kind])
        is_long = kind is str and len(value) > _MAX_TEXT
        words = f"a text of at most {_MAX_TEXT} characters"
        _refuse_unless(not is_long, path, where, value, words)


def _refuse_unless(right: bool, path: Path, where: str, value: Any, expected: str) -> None:
    """Raise `InputError` unless a value of a run.json is right."""
    if right:
        return
    # Only then, as a value may be a list of a million points.
    shown = repr(value)
    if len(shown) > _MAX_SHOWN:
        shown = f"{shown[:_MAX_SHOWN]}..."
    raise InputError(f"'{path}': {where} is {shown}, but must be {expected}; {_REMEDY}")


# Characters of a name that are kept: file systems allow 255 bytes, and endings are added.
_MAX_CHARACTERS = 100

# Hexadecimal digits of the hash that ends a long name.
_HASH_DIGITS = 16

# A point in front hides a file; blanks and points at an end are lost on some systems.
_MISLEADING = re.compile(r"^[. ]|[. ]$")


def file_name(name: str) -> str:
    """A file name for an object's name; different names give different file names.

    Letters, digits, blanks and `- _ .` are kept.  Other characters, and those that would mislead,
    become % and the hexadecimal digits of their UTF-8.  A name over 100 characters is cut and ends
    in a hash.

    Example:
        >>> file_name("film/left")
        'film%2Fleft'
    """
    characters = []
    for character in name:
        is_alphanumeric = character.isascii() and character.isalnum()
        if is_alphanumeric or character in " -_.":
            characters.append(character)
        else:
            characters.append(_escaped(character))
    safe = _MISLEADING.sub(lambda found: _escaped(found[0]), "".join(characters))
    if len(safe) > _MAX_CHARACTERS:
        # Of the full name, as long names may differ at their ends only.
        digest = hashlib.sha256(name.encode(errors="surrogatepass")).hexdigest()
        return f"{safe[:_MAX_CHARACTERS]}%{digest[:_HASH_DIGITS]}"
    return safe or "%"


def _escaped(text: str) -> str:
    """% and two hexadecimal digits for each byte of a text in UTF-8, also of half a surrogate
    pair."""
    encoded = text.encode("utf-8", errors="surrogatepass")
    return "".join(f"%{byte:02X}" for byte in encoded)
