"""The protocol of outputs, tables that survive a crash, and the evaluation of probes."""

from __future__ import annotations

import csv
import errno
import io
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from mpi4py import MPI

from gossamer_fx.core.checks.errors import InputError, check, on_rank_zero, write_on_all
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.solve.view import StateView

Probe = Callable[[StateView], float]

# Files and folders of a recorded run, see `Recording`.
RUN_FILES = (
    "run.json",
    "ledger.csv",
    "gas.csv",
    "states.csv",
    "points.csv",
    "solids.csv",
    "lines.csv",
    "tensions.csv",
    "probes.csv",
    "fields",
)


@runtime_checkable
class Output(Protocol):
    """A record of a run: it reads the state after each step, and does not change it."""

    @property
    def times(self) -> Sequence[float]:
        """Times [s] that the run must meet exactly."""
        ...

    def open(self, run: StateView) -> None:
        """Check the request and make the files; before anything is computed."""
        ...

    def record(self, run: StateView, last: bool) -> None:
        """Look at the state; at the start and after every step."""
        ...

    def close(self, run: StateView) -> None:
        """Finish the files; also after a failure."""
        ...


@runtime_checkable
class Continued(Output, Protocol):
    """An output that continues at its position in a checkpoint; others start again after a
    restart."""

    def cursor(self) -> dict[str, Any]:
        """Its position, for JSON: numbers, words, lists and dictionaries, the same on every
        rank."""
        ...

    def resume(self, run: StateView, cursor: dict[str, Any]) -> None:
        """Remove what was written after the cursor, and continue there; called instead of
        `open`."""
        ...


@runtime_checkable
class Writing(Output, Protocol):
    """An output that writes files."""

    @property
    def writes(self) -> Sequence[Path]:
        """Files and folders that no other output and no other run may write."""
        ...


def cursors_of(outputs: Iterable[Output]) -> list[tuple[str, dict[str, Any]]]:
    """Kinds and cursors of the outputs that continue after a restart."""
    cursors = []
    for output in outputs:
        if isinstance(output, Continued):
            cursors.append((type(output).__name__, output.cursor()))
    return cursors


def begin(run: StateView, output: Output, cursors: list[tuple[str, dict[str, Any]]]) -> None:
    """Open an output for a run, or let it continue at its position in a checkpoint.  Collective."""
    kind = type(output).__name__
    # Outputs have no names: those of one kind are matched in the order in which they are given.
    mine = next((cursor for cursor in cursors if cursor[0] == kind), None)
    if mine is not None and isinstance(output, Continued):
        cursors.remove(mine)
        output.resume(run, mine[1])
    else:
        check_no_other_run(run.comm, output)
        output.open(run)


def check_no_other_run(comm: MPI.Intracomm, output: Output) -> None:
    """Refuse an output that would replace files of another run, or mix its own with them.

    An output with the attribute `overwrite` owns all that it writes: unless that attribute is true,
    none of its files may exist.  Any other output replaces a file of its name, but not one that
    belongs to the folder of a recorded run.
    """
    if not isinstance(output, Writing) or getattr(output, "overwrite", False):
        return
    owns_all = hasattr(output, "overwrite")

    def look() -> None:
        for path in output.writes:
            # An empty folder is what a run that was refused has left.
            exists = path.is_file() or (path.is_dir() and any(path.iterdir()))
            check(
                not exists or not (owns_all or _is_of_a_run(path)),
                f"'{path.parent}' holds a run already, with '{path.name}'; give another folder, "
                "continue that run with restart, or replace it with overwrite=True.",
            )

    on_rank_zero(comm, look)


def _is_of_a_run(path: Path) -> bool:
    """Whether a path is one of the files in the folder of a recorded run."""
    if path.parent.name == "fields":
        return (path.parent.parent / "run.json").exists()
    return path.name in RUN_FILES and (path.parent / "run.json").exists()


class Table:
    """A CSV file that rank 0 writes row by row; a row is in it completely or not at all.

    Attributes:
        end: length of the file after the last complete row [bytes].
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.end = 0
        self._rows = 0  # complete rows, without the head
        self._head: Sequence[str] = ()  # columns that are written with the first row

    def create(self, comm: MPI.Intracomm, head: Sequence[str]) -> None:
        """Begin an empty table; an older file is kept until the first row.  Collective."""
        make_parent(comm, self.path, file=True)
        self.end = 0
        self._rows = 0
        self._head = head

    def append(self, comm: MPI.Intracomm, row: Iterable[Any]) -> None:
        """Add a row to the file.  Collective."""
        lines = _csv_line(row)
        # The head comes with the first row, so that a run that fails before keeps an older file.
        if self._head:
            lines = _csv_line(self._head) + lines

        def write() -> None:
            if comm.rank == 0:
                if self._head:
                    self.path.write_bytes(b"")
                append_bytes(self.path, self.end, lines)

        write_on_all(comm, self.path, write)
        self._head = ()
        self.end = comm.bcast(self.end + len(lines))
        self._rows += 1

    def cursor(self) -> dict[str, int]:
        """What the table holds: `end` in bytes, and the number of `rows`."""
        return {"end": self.end, "rows": self._rows}

    def cut(self, comm: MPI.Intracomm, head: Sequence[str], cursor: Mapping[str, int]) -> None:
        """Go on with a table as it was at a cursor; later rows are cut off.  Collective.

        Args:
            cursor: position that `cursor` returned: length `end` [bytes] and number of `rows`.
        """
        make_parent(comm, self.path, file=True)
        on_rank_zero(comm, lambda: self._cut(head, cursor["end"], cursor["rows"]))
        self.end = cursor["end"]
        self._rows = cursor["rows"]

    def _cut(self, head: Sequence[str], end: int, rows: int) -> None:
        """Cut off the bytes after `end`, if the file is the one that the checkpoint knows; on one
        rank.

        Nothing is changed if a check fails. A file that does not exist counts as empty.

        Args:
            end: length of the file that is kept [bytes].
        """
        content = b""
        if self.path.is_file():
            content = self.path.read_bytes()
        check(
            len(content) >= end,
            f"'{self.path}' is shorter than it was when the checkpoint was written, {len(content)} "
            f"instead of {end} "
            "bytes; put back a copy of it, or start again.",
        )
        first_line = _csv_line(head)
        check(
            content.startswith(first_line),
            f"'{self.path}' has other columns than this run; restart with the same ones, or give "
            "another name.",
        )
        kept = content[:end]
        check(
            kept.endswith(b"\n") and kept.count(b"\n") == rows + first_line.count(b"\n"),
            f"'{self.path}' was replaced since the checkpoint was written, when it had {rows} "
            "rows; put back a copy of "
            "it, or start again.",
        )
        os.truncate(self.path, end)


def append_bytes(path: Path, end: int, content: bytes) -> None:
    """Write bytes at a position of a file; if the disk has no room for all of them, nothing is
    written.

    Args:
        end: position [bytes] at which `content` begins, normally the end of the file.
    """
    # Without a buffer, a full disk is noticed here and not when the file is closed.
    with path.open("r+b", buffering=0) as file:
        file.seek(end)
        try:
            if file.write(content) != len(content):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError:
            file.truncate(end)
            raise


def _csv_line(values: Iterable[Any]) -> bytes:
    """A row of a CSV file, with its line break, in UTF-8."""
    entries = []
    for value in values:
        if isinstance(value, float):
            # The type of NumPy would be part of its representation.
            entries.append(repr(float(value)))
        else:
            entries.append(value)
    line = io.StringIO()
    csv.writer(line).writerow(entries)
    # Names may contain half of a surrogate pair, e.g. from a file name, which has no UTF-8.
    return line.getvalue().encode(errors="backslashreplace")


def make_parent(comm: MPI.Intracomm, path: Path, file: bool | None = None) -> None:
    """Make the folder of an output and try to write in it."""

    def task() -> None:
        """Make the folder and write a page of 4096 bytes to it, which is removed; on rank 0."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            probe = path.parent / f".{path.name}.try"
            try:
                # An empty file can be made on a full disk; a page cannot.
                probe.write_bytes(bytes(4096))
            finally:
                probe.unlink(missing_ok=True)
            if path.is_file():
                path.open("r+b").close()
        except OSError as error:
            raise InputError(
                f"Cannot write '{path}' ({error.strerror}); choose a folder that exists and is "
                "writable."
            ) from error
        check(
            file is not True or not path.is_dir(),
            f"Cannot write '{path}', which is a folder; give the name of a file.",
        )
        check(
            file is not False or not path.is_file(),
            f"'{path}' is to be a folder, but it is a file; remove it or rename.",
        )

    on_rank_zero(comm, task)


def evaluate_probe(run: StateView, name: str, probe: Probe) -> float:
    """The value of a probe in the state of a run.  Collective."""
    return float(ask_numbers(run.comm, f"{name} at {run.axis.words(run.time)}", lambda: probe(run)))


def replace_file(path: Path, text: str) -> None:
    """Replace the contents of a file at once, so that a reader never finds half of them; on one
    rank.
    """
    try:
        new = path.with_suffix(".new")
        # JSON reads the replacement of half of a surrogate pair, \ud800, as that half.
        new.write_text(text, encoding="utf-8", errors="backslashreplace")
        new.replace(path)
    except OSError as error:
        raise InputError(
            f"Cannot write '{path}' ({error.strerror}); choose a folder that is writable."
        ) from error
