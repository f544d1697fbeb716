"""Results of cases, their files and tables, and pictures of errors with observed orders.

A result has numbers by name, the reason of a failure, and the warnings of the program.  Errors are
drawn against CPU time and against the size of cells or steps.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import logging
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.csv_tables import safe_cells
from gossamer_fx.core.checks.errors import (
    InputError,
    NoEquilibrium,
    StepFailure,
    check,
)
from gossamer_fx.core.checks.strange_files import DAMAGED, read_json
from gossamer_fx.core.model.body import Array
from gossamer_fx.records.outputs.output import replace_file
from gossamer_fx.records.plot.written_panels import written_panels
from gossamer_fx.version import VERSION

Numbers = Sequence[float] | Array

# A panel and the names of curves next to it [inch].
PANEL_WIDTH = 4.5
PANEL_HEIGHT = 3.3
NAME_HEIGHT = 0.165

# On an axis of a smaller ratio of the ends the usual ticks of a logarithmic axis are few.
WIDE_RATIO = 20.0

# Lines of the curves of one colour.
LINES = ("o-", "s--", "^:")
MAX_TEN_COLOURS = 10


@dataclass(frozen=True)
class ErrorCurve:
    """Errors of one quantity, or its values, on cells or with steps of several sizes.

    Attributes:
        name: of the curve.
        seconds: CPU times (n,) [s].
        errors: relative errors (n,).
        sizes: h of the cells or steps (n,); empty: there is no panel over h.
        colour_group: curves of the same group have one colour and different lines; default: the
            curve has its own colour.
    """

    name: str
    seconds: Numbers
    errors: Numbers
    sizes: Numbers = ()
    colour_group: str = ""


def observed_order(
    coarse_error: float, fine_error: float, coarse_size: float, fine_size: float
) -> float:
    """Order p of errors that fall like h^p from one size to another; NaN where there is none."""
    if not (coarse_error > 0 and fine_error > 0 and coarse_size != fine_size):
        return math.nan
    return math.log(coarse_error / fine_error) / math.log(coarse_size / fine_size)


def draw_error_curves(
    path: str | Path,
    rows: Mapping[str, Sequence[ErrorCurve]],
    title: str = "",
    are_errors: bool = True,
) -> None:
    """Draw a row of panels for each quantity: errors over CPU time, and over h if it is known.

    Args:
        path: of the PNG; its folder is made.
        rows: curves by the label of their axis.
        title: of the picture; may be empty.
        are_errors: whether the curves are errors, on a logarithmic axis, or values, on a linear
            one.

    Raises:
        OutputFailure: the file cannot be written.
    """
    # Imported here, as only pictures need it.
    from matplotlib import colormaps
    from matplotlib.ticker import NullFormatter

    has_sizes = any(len(curve.sizes) > 0 for curves in rows.values() for curve in curves)
    columns = 2 if has_sizes else 1
    count = max((len(curves) for curves in rows.values()), default=0)
    height = max(PANEL_HEIGHT, NAME_HEIGHT * count) * len(rows) + 0.4
    # A third column is for the names.
    size = (PANEL_WIDTH * columns + 2.0, height)
    with written_panels(path, size, len(rows), columns, sharex="col", sharey="row") as panels:
        for (label, curves), axes in zip(rows.items(), panels, strict=True):
            # Zero has no place on a logarithmic axis.
            has_errors = are_errors and any(e > 0 for curve in curves for e in curve.errors)
            groups = list(dict.fromkeys(curve.colour_group or curve.name for curve in curves))
            palette = colormaps["tab10" if len(groups) <= MAX_TEN_COLOURS else "tab20"]
            drawn: dict[str, int] = {}
            for curve in curves:
                group = curve.colour_group or curve.name
                line = LINES[drawn.get(group, 0) % len(LINES)]
                drawn[group] = drawn.get(group, 0) + 1
                colour = palette(groups.index(group) % palette.N)
                style = {"color": colour, "markersize": 4, "label": curve.name}
                axes[0].plot(curve.seconds, curve.errors, line, **style)
                if has_sizes:
                    axes[1].plot(curve.sizes, curve.errors, line, **style)
            axes[0].set_ylabel(label)
            for panel in axes:
                panel.set_xscale("log")
                if has_errors:
                    panel.set_yscale("log")
                panel.grid(True, which="both", alpha=0.25)
            axes[-1].legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        panels[-1, 0].set_xlabel("CPU time without compilation [s]")
        if has_sizes:
            panels[-1, 1].set_xlabel("h")
            sizes = sorted({h for curves in rows.values() for curve in curves for h in curve.sizes})
            if sizes and sizes[-1] < WIDE_RATIO * sizes[0]:
                panels[-1, 1].set_xticks(sizes, [f"{h:.2g}" for h in sizes])
                panels[-1, 1].xaxis.set_minor_formatter(NullFormatter())
        if title:
            panels[0, 0].figure.suptitle(title, fontsize=10)


# Values of a case by name: numbers and words, which files keep as they are.
Values = Mapping[str, Any]
# outcome(comm, folder, **values) computes a case and returns numbers, or lists of them, by name.
Outcome = Callable[..., Mapping[str, Any]]

# Failures that are results.  All other exceptions end a computation of many cases.
FAILURES: tuple[type[Exception], ...] = (StepFailure, NoEquilibrium)

# Characters of a run's key in file names: collisions are improbable up to millions of runs.
_KEY_LENGTH = 12

# Ends of the names of a probe's numbers: of its extremes over a run, and of its last value.
EXTREMES = (" smallest", " largest")
LAST = " at the end"

# Of files with several results.  A reader refuses those of another format.
FORMAT = 2


@dataclass(frozen=True)
class Result:
    """The result of a case.

    Attributes:
        values: of the case, by name.
        numbers: of the outcome, by name: numbers or lists of numbers; empty if the case failed.
        seconds: wall time [s].
        failed: why the case failed; empty if it did not.
        warnings: of the program while it computed the case, each once.
    """

    values: dict[str, Any]
    numbers: dict[str, Any]
    seconds: float
    failed: str = ""
    warnings: list[str] = field(default_factory=list)


class _Collector(logging.Handler):
    """Keeps the texts of warnings."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.texts.append(record.getMessage())
        others = [*logging.getLogger("gossamer_fx").handlers, *logging.getLogger().handlers]
        # Python prints warnings where no handler is; this one must not silence them.
        if others == [self] and logging.lastResort is not None:
            logging.lastResort.handle(record)


@contextmanager
def recorded_warnings() -> Iterator[list[str]]:
    """Collect the warnings that the program logs on this rank within the block, in the list that it
    yields."""
    collector = _Collector()
    logger = logging.getLogger("gossamer_fx")
    logger.addHandler(collector)
    try:
        yield collector.texts
    finally:
        logger.removeHandler(collector)


def compute(
    comm: MPI.Intracomm,
    folder: Path,
    outcome: Outcome,
    values: Values,
    failures: tuple[type[Exception], ...] = FAILURES,
) -> Result:
    """Compute one case; a failure with a name is a result, too.  Collective.

    Args:
        comm: ranks that compute the case together.
        folder: for files of the case.
        outcome: outcome(comm, folder, **values).
        values: of the case.
        failures: exceptions that are results.  Others are raised as they are.

    Raises:
        InputError: the outcome refuses its values, or returns something other than numbers.
    """
    started = time.perf_counter()
    numbers: Mapping[str, Any] = {}
    failed = ""
    words = ", ".join(f"{name}={value}" for name, value in values.items())
    with recorded_warnings() as own_warnings:
        try:
            numbers = outcome(comm, folder, **values)
        except failures as error:
            failed = str(error)
        except InputError as error:
            raise InputError(f"The run with {words} is refused: {error}") from error
    # A warning may be of one rank only; each is kept once, in the order of the ranks.
    all_warnings = [text for texts in comm.allgather(own_warnings) for text in texts]
    return Result(
        values=dict(values),
        numbers={name: _plain(words, name, number) for name, number in numbers.items()},
        seconds=time.perf_counter() - started,
        failed=failed,
        warnings=list(dict.fromkeys(all_warnings)),
    )


def _plain(words: str, name: str, number: Any) -> float | list[float]:
    """The number `name` of an outcome, or a list of numbers, as files store it.  Lists may have
    gaps, which are NaN; `words` are the values of the case, for the message.

    Raises:
        InputError: it is something else.
    """
    if isinstance(number, np.ndarray | list):
        return [float(one) for one in number]
    check(
        isinstance(number, Real) and not np.isnan(float(number)),
        f"The outcome of the run with {words} has {name!r} = {number!r}; let it return numbers.",
    )
    return float(number)


def key_of(values: Values) -> str:
    """Name of a run's files.

    It depends on the values only, so that other processes and later sweeps find the result.
    """
    text = json.dumps(dict(values), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_KEY_LENGTH]


# ---- files ---------------------------------------------------------------------------------------


def read_result(path: Path) -> Result | None:
    """Read the result of one case; None if there is no such file.

    Raises:
        InputError: the file is not the result of a case.
    """
    try:
        return Result(**read_json(path, path.parent))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise InputError(
            f"'{path}' is not the result of a run; remove it, and the run is made again."
        ) from error


def write_results(path: Path, name: str, results: Sequence[Result]) -> None:
    """Write several results to one file, for a page that shows them.

    Args:
        path: of the JSON file; its folder is made.
        name: of the cases; `read_results` refuses a file of others.
        results: in the order of the page.
    """
    stored = {
        "format": FORMAT,
        "name": name,
        "version": VERSION,
        "results": [asdict(result) for result in results],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, json.dumps(stored, indent=1, ensure_ascii=False) + "\n")


def read_results(path: Path, name: str) -> list[Result]:
    """Read several results; none if there is no such file.

    Raises:
        InputError: the file does not hold results of the cases of this name.
    """
    try:
        stored = read_json(path)
        is_right = stored["format"] == FORMAT and stored["name"] == name
        results = [Result(**one) for one in stored["results"]] if is_right else []
    except FileNotFoundError:
        return []
    except DAMAGED as error:
        raise InputError(f"'{path}' does not hold results of '{name}'; remove it.") from error
    check(is_right, f"'{path}' does not hold results of '{name}'; remove it.")
    return results


def results_as_csv(results: Sequence[Result]) -> str:
    """All results as comma-separated values, with a header.

    Returns:
        a text with a row for each result: values, numbers that are not lists, wall time [s] unless
        the outcome has its own "seconds", reason of failure, and name of the folder of the run.
    """
    names: dict[str, None] = {}
    for result in results:
        names |= dict.fromkeys(result.values)
    numbers = number_names([result.numbers for result in results])
    names |= dict.fromkeys([*numbers, "seconds", "failed", "folder"])
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(safe_cells(names))
    for result in results:
        row = {"seconds": result.seconds, **result.values, **result.numbers}
        row["failed"] = result.failed
        row["folder"] = key_of(result.values)
        writer.writerow(safe_cells(row.get(name, "") for name in names))
    return text.getvalue()


def number_names(runs: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of the numbers of runs that are not lists, in the order in which they occur; extremes
    come last, as pictures have room for the first numbers only."""
    names: dict[str, None] = {}
    for run in runs:
        names |= {name: None for name, n in run.items() if not isinstance(n, list)}
    return sorted(names, key=lambda name: name.endswith(EXTREMES))


def shown_names(runs: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of the numbers of runs for pictures and tables: without extremes that are the value at
    the end in all runs."""

    def is_repeated(name: str) -> bool:
        for kind in EXTREMES:
            if name.endswith(kind):
                last = name.removesuffix(kind) + LAST
                return all(run.get(name) == run.get(last) for run in runs)
        return False

    return [name for name in number_names(runs) if not is_repeated(name)]


def markdown_table(rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown from the texts of its cells; the first row has the headings."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    lines.insert(1, "|---" * lines[0].count(" | ") + "|---|")
    return "\n".join(lines) + "\n"


# ---- words ---------------------------------------------------------------------------------------


def values_text(values: Values) -> str:
    """Values with their names, such as "bore 0.3, crease 1"."""
    return ", ".join(f"{name} {value_text(value)}" for name, value in values.items())


def value_text(value: Any) -> str:
    """A value as text: words as they are, whole numbers with all digits, others with six."""
    if isinstance(value, str):
        return value
    if isinstance(value, int):
        return f"{value:d}"
    return f"{value:g}"


def number_text(number: float, form: str) -> str:
    """A number in a table, by a format such as ".3g"; empty for NaN."""
    if np.isnan(number):
        return ""
    return f"{number:{form}}"
