"""The files of an ADIOS2 output: how long they are and how many steps they hold, so that damage is
noticed.

An output of ADIOS2's engine BP5 is a folder `film.bp` with the files data.*, md.* and mmd.*.
ADIOS2 only appends to them, and a step is on the disk when its writing returns.  After each step
`steps.json` in the folder is replaced; it holds the number of steps and the length of each file.  A
file that is shorter was cut, and reading it could end the program, since ADIOS2 does not check its
metadata.  Contents that were changed at the same length are not noticed.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

from gossamer_fx.core.checks.errors import InputError, check

Lengths = dict[str, int]  # bytes of each file, by its name

_NAME = "steps.json"
_ADIOS_FILES = ("data.", "md.", "mmd.")
_REMEDY = "put back a copy of it, or start again."


def clear(folder: Path) -> None:
    """Remove what an earlier output left that a new one of the same name does not overwrite.

    ADIOS2 replaces files of the same names, but an earlier run on more ranks may have had more data
    files.
    """
    (folder / _NAME).unlink(missing_ok=True)
    for old in folder.glob("data.*"):
        old.unlink()


def note_steps(folder: Path, steps: int) -> Lengths:
    """Write `steps.json` for files that hold a number of whole steps; returns their lengths.

    Args:
        folder: of an ADIOS2 output, `film.bp`.
        steps: number of steps (records of the fields) that are completely written.

    Returns:
        the length [bytes] of each data file, by its name.

    Raises:
        OSError: the disk is full, or the folder is gone; the former `steps.json` stays.
    """
    lengths = {
        path.name: path.stat().st_size
        for path in sorted(folder.iterdir())
        if path.name.startswith(_ADIOS_FILES)
    }
    _write(folder, steps, lengths)
    return lengths


def noted_steps(folder: Path) -> int:
    """The number of steps (records in time) that a field output should hold; 0 without
    `steps.json`.

    Args:
        folder: of an ADIOS2 output, `film.bp`.

    Raises:
        InputError: `steps.json` is damaged, or a file is missing or shorter than it says.
    """
    path = folder / _NAME
    if not path.is_file():
        return 0
    try:
        noted = json.loads(path.read_bytes())
        steps = int(noted["steps"])
        lengths = {str(name): int(length) for name, length in noted["bytes"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"'{path}' is damaged ({error}); {_REMEDY}") from error
    check_lengths(folder, lengths)
    return steps


def check_lengths(folder: Path, lengths: Lengths) -> None:
    """Raise `InputError` if a file is missing or shorter than it was.

    Args:
        folder: of an ADIOS2 output.
        lengths: lengths [bytes] that its files had, by name; longer files are accepted.

    Raises:
        InputError: names the file.
    """
    for name, length in lengths.items():
        path = folder / name
        check(path.is_file(), f"'{path}' is missing; {_REMEDY}")
        size = path.stat().st_size
        check(
            size >= length,
            f"'{path}' is shorter than it was, {size} instead of {length} bytes; {_REMEDY}",
        )


def cut(
    folder: Path,
    steps: int,
    lengths: Lengths,
    time: float,
) -> None:
    """Cut a field output back to a number of steps, the last of which was at a time.

    Args:
        folder: of an ADIOS2 output.
        steps: number of steps (records of the fields) that are kept.
        lengths: lengths [bytes] of the files after these steps, by name.
        time: of the last of these steps [s].

    Raises:
        InputError: a file is missing or shorter than `lengths`, or, where Python has ADIOS2, the
            output has other steps: it was replaced.
    """
    check_lengths(folder, lengths)
    times = _times(folder)
    same = times is None or (len(times) >= steps and times[steps - 1] == time)
    check(
        same,
        f"'{folder}' was replaced since the checkpoint was written: its step {steps} is not at t = "
        f"{time:.9g} s; {_REMEDY}",
    )
    for name, length in lengths.items():
        os.truncate(folder / name, length)
    _write(folder, steps, lengths)


def _times(folder: Path) -> list[float] | None:
    """Times [s] of the steps (records) of an output; None if this Python has no ADIOS2.

    Raises:
        InputError: it cannot be read.
    """
    try:
        import adios2
    except ImportError:
        return None
    try:
        with adios2.FileReader(str(folder)) as file:
            return [float(t) for t in file.read("step", step_selection=[0, file.num_steps()]).flat]
    except Exception as error:  # ADIOS2 raises what its C++ side throws
        raise InputError(f"'{folder}' is damaged; {_REMEDY}") from error


def _write(folder: Path, steps: int, lengths: Lengths) -> None:
    new = folder / f"{_NAME}.new"
    new.write_text(json.dumps({"steps": steps, "bytes": lengths}), encoding="utf-8")
    new.replace(folder / _NAME)
