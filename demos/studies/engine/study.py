"""Studies: a problem over meshes, elements, laws, steppers, ..., and what error a second of
computing leaves.

A `Study` is data: a problem, the axes along which it is varied, references and expected rates.
`run` computes what is not in the study's CSV yet, so that an interrupted study goes on where it
stopped, and writes table and picture.
"""

from __future__ import annotations

import csv
import itertools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

from gossamer_fx.core.checks.errors import (
    InputError,
    NoEquilibrium,
    StepFailure,
    check,
    on_rank_zero,
)

Trial = Mapping[str, Any]  # the values along the axes
Row = dict[str, str]


@dataclass(frozen=True)
class Measure:
    """A result with a reference.

    Args:
        name: its key in what the problem returns.
        reference: exact value, or a function of the case; zero for a result that is an error
            itself.
        tolerance: largest relative error that is accepted on the finest of the full study.
        rate: expected order in h for a case; infinite where no order is expected.
    """

    name: str
    reference: float | Callable[[Trial], float]
    tolerance: float = math.inf
    rate: Callable[[Trial], float] = field(default=lambda case: math.inf)

    def error(self, case: Trial, value: float) -> float:
        """|value - reference|/|reference|, or |value| where the reference is zero."""
        reference = self.reference(case) if callable(self.reference) else self.reference
        return abs(value - reference) / (abs(reference) or 1.0)


@dataclass(frozen=True)
class Study:
    """A problem and its axes.

    Args:
        name: of its files.
        title: one line above the table.
        problem: problem(comm, **case) returns numbers by name, "seconds" among them: run time
            without start-up and compilation.
        axes: values of the parameters by name; numbers and words.  The last axis is the one that is
            refined.
        size: h of a case.
        measures: the results that have references.
        quick: axes with fewer values, for `quick` runs.
        quick_options: further arguments of the problem in `quick` runs, such as an earlier end.
            Their results are not those of the full study, and have a separate file.
        columns: further results that the table shows.
        may_fail: whether a case that fails by name is a result, too.
        draw: draws all results, draw(results, path), instead of errors against run time and h.
    """

    name: str
    title: str
    problem: Callable[..., Mapping[str, float]]
    axes: Mapping[str, Sequence[Any]]
    size: Callable[[Trial], float]
    measures: tuple[Measure, ...] = ()
    quick: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    quick_options: Mapping[str, Any] = field(default_factory=dict)
    columns: tuple[str, ...] = ("iterations", "seconds")
    may_fail: bool = False
    draw: Callable[[list[Result], Path], None] | None = None

    def cases(self, quick: bool) -> list[dict[str, Any]]:
        """All combinations of the values of the axes, or of those of a quick run."""
        axes = {**self.axes, **(self.quick if quick else {})}
        unknown = set(axes) - set(self.axes)
        check(
            not unknown,
            f"Study '{self.name}': quick has an axis {unknown} that the study has not; remove it.",
        )
        return [
            dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())
        ]


@dataclass(frozen=True)
class Result:
    """A case and its numbers; `failed` says why there are none."""

    case: dict[str, Any]
    values: dict[str, float]
    failed: str


def run(
    study: Study,
    folder: Path,
    comm: MPI.Intracomm,
    quick: bool = False,
) -> list[Result]:
    """Compute the cases that `folder/NAME.csv` lacks for this number of ranks; returns all, in
    order.

    Quick forms with other options have the file `NAME-quick.csv`, see `Study`.

    Raises:
        InputError: the file cannot be read or written, or is of a study with other axes.
    """
    options = study.quick_options if quick else {}
    path = folder / f"{study.name}{'-quick' * bool(options)}.csv"
    known = comm.bcast(on_rank_zero(comm, lambda: _read(study, path)))
    results = []
    for case in study.cases(quick):
        key = _key(case, comm.size)
        if key not in known:
            row = _compute(study, case, comm, options)
            known[key] = row
            # After each case, so that a study that was ended goes on from there.
            on_rank_zero(comm, lambda: _write(path, list(known.values())))
            if comm.rank == 0:
                print(f"{study.name}: {', '.join(f'{k} {v}' for k, v in row.items())}", flush=True)
        row = known[key]
        skip = {*case, "ranks", "failed"}
        values = {name: float(text) for name, text in row.items() if name not in skip and text}
        results.append(Result(case, values, row.get("failed", "")))
    return results


def _compute(
    study: Study, case: dict[str, Any], comm: MPI.Intracomm, options: Mapping[str, Any]
) -> Row:
    """Compute one case; a row of text, with the reason of a failure that has a name."""
    started = time.perf_counter()
    row = {name: str(value) for name, value in case.items()} | {"ranks": str(comm.size)}
    try:
        values = study.problem(comm, **case, **options)
        check(
            "seconds" in values,
            f"Study '{study.name}': its problem returns no 'seconds'; return the run time.",
        )
        row |= {name: repr(float(value)) for name, value in values.items()}
    # A failure with a name is a result; any other error ends the study.
    except (NoEquilibrium, StepFailure) as failure:
        row |= {"seconds": repr(time.perf_counter() - started), "failed": str(failure)}
    return row


def _key(case: Mapping[str, Any], ranks: int) -> tuple[str, ...]:
    return (*(f"{name}={value}" for name, value in case.items()), f"ranks={ranks}")


def _read(study: Study, path: Path) -> dict[tuple[str, ...], Row]:
    """Rows of a file that was written before, by their keys; empty if the file does not exist."""
    if not path.is_file():
        return {}
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        # Files of older versions have another word for rejected steps.
        if "halved" in row:
            row.setdefault("rejected", row.pop("halved"))
        if not {*study.axes, "ranks"} <= set(row):
            raise InputError(
                f"'{path}' is of a study with other axes than '{study.name}'; remove it."
            )
    return {_key({name: row[name] for name in study.axes}, int(row["ranks"])): row for row in rows}


def _write(path: Path, rows: list[Row]) -> None:
    """All rows at once, to a new file that then replaces the old one: a killed study leaves a whole
    file."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = path.with_suffix(".new")
        with new.open("w", newline="") as file:
            writer = csv.DictWriter(file, names, restval="")
            writer.writeheader()
            writer.writerows(rows)
        new.replace(path)
    except OSError as error:
        raise InputError(
            f"Cannot write '{path}' ({error.strerror}); choose a folder that is writable."
        ) from error
