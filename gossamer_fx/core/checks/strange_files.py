"""The door of files: all files that may come from a stranger are opened here, to be read or
written.

The folder of a run may hold anything: links to other files of its reader, FIFOs that are never
answered, files that say that they are huge.  So a file is opened only if it is a regular file; one
that is read lies in the folder to which it belongs, also behind all links, and no file is written
through a link.  The bytes that a file claims to have must exist, so that reading the folder of a
run takes no more memory than `LARGEST_EXPANSION` times its size on the disk.
"""

from __future__ import annotations

import errno
import json
import os
import stat
from io import BufferedReader, FileIO
from pathlib import Path
from typing import Any

from gossamer_fx.core.checks.errors import InputError, check

# Bytes of an array over the bytes of the compressed file in which it is.  Numbers of nodes in files
# of fields shrink to a third at best, so that even films at rest, all of whose fields are zero, are
# below 100; zlib alone would reach 1000.
LARGEST_EXPANSION = 250

# Bytes of a file above which it is checked for holes.
_LARGE = 16 * 2**20

# Holes up to which the bytes between them are counted; a file that a program writes has few.
_MAX_HOLES = 10_000

# What is raised where a file cannot be read, or its contents are others than the program writes.
DAMAGED = (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError)

# Bytes of a JSON file: Python takes up to twenty times as many for its contents.
_MAX_JSON = 256 * 2**20

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def open_file(path: Path, folder: Path | None = None) -> BufferedReader:
    """Open a file to read its bytes.

    Args:
        folder: in which the file must be, also behind links; None for a file that the user names.

    Raises:
        InputError: it is not a regular file, a link leads out of the folder, or most of it
            is a hole.
        OSError: there is no such file, or it is not readable.
    """
    real = Path(os.path.realpath(path))
    if folder is not None:
        check_inside(path, folder)
    # Before it is opened: to open a device may have an effect.
    _check_regular(path, os.stat(real).st_mode)
    # Without waiting for the other end of a FIFO that has just replaced it.
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC
    file = os.fdopen(os.open(real, flags), "rb")
    try:
        _check_regular(path, os.fstat(file.fileno()).st_mode)
        _check_holes(path, file.fileno())
    except InputError:
        file.close()
        raise
    return file


def check_inside(path: Path, folder: Path) -> None:
    """Raise `InputError` if a link on the way to a file leads out of the folder in which it is."""
    check(
        Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder)),
        f"'{path}' is a link that leads out of the folder '{folder}', or is behind one; put the "
        "file itself there.",
    )


def read_json(path: Path, folder: Path | None = None) -> Any:
    """The contents of a JSON file, opened by `open_file`.

    Raises:
        InputError: see `open_file`, or it is larger than 256 MiB.
        OSError, ValueError, RecursionError: it cannot be read, or is not JSON.
    """
    with open_file(path, folder) as file:
        size = os.fstat(file.fileno()).st_size
        check(
            size <= _MAX_JSON,
            f"'{path}' has {size} bytes, a file of its kind at most {_MAX_JSON}; put back a copy.",
        )
        return json.loads(file.read().decode("utf-8"))


def open_to_write(path: Path, mode: str) -> FileIO:
    """Open a file to write bytes, which is not a link.

    Args:
        mode: "wb" or "r+b".

    Raises:
        OSError: it is a link, or not a regular file, or cannot be written.
    """

    def opened(name: str, flags: int) -> int:
        if os.path.islink(name):
            raise OSError(errno.ELOOP, "it is a link; remove it", name)
        # A FIFO that nobody reads is an error, not a wait.
        extra = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
        descriptor = os.open(name, flags | extra, 0o666)
        mode_of_file = os.fstat(descriptor).st_mode
        if not stat.S_ISREG(mode_of_file):
            os.close(descriptor)
            raise OSError(errno.EINVAL, f"it is {_kind(mode_of_file)}; remove it", name)
        return descriptor

    return FileIO(path, mode, opener=opened)


def write_new(path: Path, content: bytes) -> None:
    """Write a file as a whole; see `open_to_write` for the errors."""
    with open_to_write(path, "wb") as file:
        # A file without a buffer may take a part of the bytes only.
        remaining = memoryview(content)
        while remaining:
            remaining = remaining[file.write(remaining) :]


def check_expansion(path: Path, claimed: int, existing: int) -> None:
    """Raise `ValueError` if the contents of a compressed file would be more than
    `LARGEST_EXPANSION` times its bytes.

    Args:
        claimed: bytes that its contents are said to have.
        existing: bytes of the file.
    """
    if claimed > LARGEST_EXPANSION * existing:
        raise ValueError(
            f"it has {existing} bytes, but claims to hold {claimed}, more than "
            f"{LARGEST_EXPANSION} times as many"
        )


def _kind(mode: int) -> str:
    """What a file is called that is not a regular one."""
    return _KINDS.get(stat.S_IFMT(mode), "not a file")


def _check_regular(path: Path, mode: int) -> None:
    """Raise `InputError` unless the mode is that of a regular file."""
    check(
        stat.S_ISREG(mode),
        f"'{path}' is {_kind(mode)}, not a regular file; put the file itself there.",
    )


def _check_holes(path: Path, descriptor: int) -> None:
    """Raise `InputError` if most of an open file are holes, which take no room on the disk but
    would take memory."""
    size = os.fstat(descriptor).st_size
    if size < _LARGE:
        return
    begin = 0
    written = 0
    for _ in range(_MAX_HOLES):
        try:
            data = os.lseek(descriptor, begin, os.SEEK_DATA)
            begin = os.lseek(descriptor, data, os.SEEK_HOLE)
        except OSError:
            # There are no more bytes, or the file system does not tell.
            break
        written += begin - data
        if begin >= size:
            break
    os.lseek(descriptor, 0, os.SEEK_SET)
    check(
        2 * written >= size,
        f"'{path}' claims to have {size} bytes, of which {written} were written; put back a copy "
        "of it.",
    )
