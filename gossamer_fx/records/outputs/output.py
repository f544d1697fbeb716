"""The protocol of outputs, their schedules, files of other runs, and the evaluation of probes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Protocol, runtime_checkable

from mpi4py import MPI

from gossamer_fx.core.checks.arguments import Range, not_negative
from gossamer_fx.core.checks.errors import InputError, check, on_rank_zero
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.solve.view import StateView

Probe = Callable[[StateView], float]

# Steps between two records, and times of records [s].
Every = Annotated[int, Range(1)]
Times = Sequence[Annotated[float, not_negative("s")]]

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


# A time is met if it differs by less than this from the one asked for, relatively above 1 s [s].
TIME_TOLERANCE = 1e-12


@dataclass(frozen=True)
class Schedule:
    """Every n-th step, or given times; the first and the last state are always due.

    Args:
        times: of records, instead [s].
    """

    every: int = 1
    times: tuple[float, ...] = ()

    def due(self, step: int, time: float, last: bool) -> bool:
        """Whether a record is due after a step.

        Args:
            time: [s].
        """
        if step == 0 or last:
            return True
        if self.times:
            return self.meets(time)
        return step % self.every == 0

    def meets(self, time: float) -> bool:
        """Whether a time [s] is one of the given ones."""
        return any(abs(time - t) <= TIME_TOLERANCE * max(abs(t), 1.0) for t in self.times)
