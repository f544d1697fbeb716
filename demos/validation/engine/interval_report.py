"""Tables and a picture of intervals: of each test, of each quantity of a case, and of what a case
states about its inputs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from demos.validation.engine.case import Case, Test
from demos.validation.engine.comparison import comparisons, results_by_test
from demos.validation.engine.intervals import (
    RIGHT,
    UNDETERMINED,
    VERDICTS,
    WRONG,
    Interval,
    changes_of,
    count,
    interval_of,
    verdict_cells,
)
from demos.validation.engine.report import between, is_asked
from gossamer_fx.extend import Result

# A case with its stored results and the stored changes of its predictions.
Stored = tuple[Case, list[Result], list[Result]]

TEST_HEAD = [
    "case",
    "test",
    "quantity",
    "unit",
    "predicted",
    "± by inputs",
    "± by mesh and step",
    "± in all",
    "measured",
    "± of the measured",
    "points that overlap [%]",
    "width over the value [%]",
    "verdict",
    "form",
]
SUMMARY_HEAD = [
    "case",
    "quantity",
    "counted",
    "tests",
    "least ± of the prediction [%]",
    "largest ± of the prediction [%]",
    "largest ± of the measured value [%]",
    *VERDICTS,
]
STATED_HEAD = ["case", "input", "tests", "value", "unit", "half-width", "standard uncertainty"]
STATED_HEAD += ["unit of the uncertainty", "kind", "source"]
EXACT_HEAD = ["case", "input", "reason"]

# Size of the picture [in], and of a column of it.
COLUMN_WIDTH = 1.45
MARGIN = 1.0
HEIGHT = 4.2
# Errors beyond this one are drawn at the edge.
LARGEST_ERROR = 1.0
COLOURS = {RIGHT: "tab:blue", UNDETERMINED: "tab:orange", WRONG: "tab:red"}
MARKERS = {RIGHT: "o", UNDETERMINED: "s", WRONG: "X"}


def intervals_of_test(
    case: Case, test: Test, result: Result, changes: Sequence[Result]
) -> Iterator[Interval | None]:
    """The intervals of the quantities of a test that were measured in an experiment, in the order
    of the case; None where nothing is stored."""
    found = changes_of(case, test, changes)
    for comparison in comparisons(test, result):
        if comparison.measured.evidence == "experiment":
            yield None if found is None else interval_of(case, test, comparison, found)


def named_intervals(
    case: Case, results: Sequence[Result], changes: Sequence[Result]
) -> dict[tuple[str, str], Interval]:
    """The intervals of a case by the names of test and quantity."""
    found = {}
    for test, result in results_by_test(case, list(results)):
        for one in intervals_of_test(case, test, result, changes):
            if one is not None:
                found[test.name, one.comparison.measured.quantity] = one
    return found


def is_counted(case: Case, test: Test, quantity: str) -> bool:
    """Whether a quantity is one of those that the pages count: something was asked of it, and it
    is a prediction."""
    [measured] = [one for one in test.measured if one.quantity == quantity]
    return is_asked(measured) and measured.evidence == "experiment" and not measured.not_counted


def counted_intervals(stored: Iterable[Stored]) -> dict[str, list[Interval | None]]:
    """The intervals of the quantities that the pages count, by their kind."""
    found: dict[str, list[Interval | None]] = {}
    for case, results, changes in stored:
        for test, result in results_by_test(case, results):
            names = [one for one in test.measured if one.evidence == "experiment"]
            every = intervals_of_test(case, test, result, changes)
            for measured, interval in zip(names, every, strict=True):
                if is_counted(case, test, measured.quantity):
                    found.setdefault(measured.kind, []).append(interval)
    return found


def headline(stored: Iterable[Stored]) -> str:
    """A sentence with the numbers of verdicts of the quantities that are counted."""
    groups = counted_intervals(stored)
    every = [one for group in groups.values() for one in group]
    numbers = count(every)
    known = [one for one in every if one is not None]
    undetermined = [one for one in known if one.verdict == UNDETERMINED]
    overlapping = sum(one.overlaps for one in undetermined)
    words = (
        f"With the uncertainty of inputs, mesh and measurement {numbers.get(RIGHT, 0)} of "
        f"{len(every)} predictions are right, {numbers.get(UNDETERMINED, 0)} are undetermined "
        f"(of these {overlapping} overlap the measured value), and {numbers.get(WRONG, 0)} are "
        "wrong"
    )
    if numbers.get("", 0):
        words += f"; {numbers['']} have no interval"
    return words + "."


def test_rows(stored: Iterable[Stored]) -> Iterator[list[str]]:
    """Cells of the table of all intervals; first the headings."""
    yield TEST_HEAD
    for case, results, changes in stored:
        for test, result in results_by_test(case, results):
            for interval in intervals_of_test(case, test, result, changes):
                if interval is not None:
                    yield interval_row(case, test, interval)


def interval_row(case: Case, test: Test, interval: Interval) -> list[str]:
    """One row of the table: of a curve the point in the middle of its range."""
    measured = interval.comparison.measured
    # The largest value where errors are relative to a reference, as curves may be zero in between.
    k = len(interval.y_measured) // 2
    if np.isfinite(measured.reference):
        k = int(np.abs(interval.y_measured).argmax())
    mesh = interval.by_mesh[k]
    return [
        case.name,
        test.name,
        measured.quantity,
        measured.unit,
        f"{interval.y_predicted[k]:.4g}",
        _two_digits(interval.by_inputs[k]),
        _two_digits(mesh),
        _two_digits(interval.half[k]),
        f"{interval.y_measured[k]:.4g}",
        _two_digits(interval.by_measurement[k]),
        f"{100 * interval.share:.0f}",
        f"{100 * interval.width:.0f}" if np.isfinite(interval.width) else "unbounded",
        interval.verdict,
        interval.form,
    ]


def summary_rows(stored: Iterable[Stored]) -> Iterator[list[str]]:
    """Cells of the table with one row for each quantity of a case; first the headings."""
    yield SUMMARY_HEAD
    groups: dict[tuple[str, str, bool], list[Interval]] = {}
    for case, results, changes in stored:
        for test, result in results_by_test(case, results):
            for interval in intervals_of_test(case, test, result, changes):
                if interval is not None:
                    quantity = interval.comparison.measured.quantity
                    key = (case.name, quantity, is_counted(case, test, quantity))
                    groups.setdefault(key, []).append(interval)
    for (name, quantity, counts), group in groups.items():
        yield [
            name,
            quantity,
            "yes" if counts else "no",
            str(len(group)),
            # Half of the interval, over the value.
            _two_digits(min(50 * one.width for one in group)),
            _two_digits(max(50 * one.width for one in group)),
            _two_digits(max(float(100 * (one.by_measurement / one.sizes).mean()) for one in group)),
            *verdict_cells(group),
        ]


def stated_rows(cases: Iterable[Case]) -> Iterator[list[str]]:
    """Cells of the table of what cases state about inputs and measured values; first the
    headings."""
    yield STATED_HEAD
    for case in cases:
        for one in case.statement.uncertainties:
            tests = [test for test in case.tests if one.holds_for(test.name)]
            names = f"{len(tests)} of {len(case.tests)}" if one.tests else "all"
            value, unit = _value(tests, one.inputs)
            yield [
                case.name,
                one.name if one.inputs else f"{one.name} (measured)",
                names,
                value,
                unit,
                "" if one.is_standard else f"{one.size:g}",
                f"{one.standard:.3g}",
                one.unit,
                one.kind,
                one.source,
            ]


def exact_rows(cases: Iterable[Case]) -> Iterator[list[str]]:
    """Cells of the table of inputs that have no uncertainty; first the headings."""
    yield EXACT_HEAD
    for case in cases:
        for name, reason in case.statement.exact.items():
            yield [case.name, name, reason]


def _value(tests: Sequence[Test], inputs: Sequence[str]) -> tuple[str, str]:
    """The value and the unit of one input, the least and the largest of several tests; nothing of
    several inputs or of an array."""
    if len(inputs) != 1:
        return "", ""
    entries = [test.inputs.values.get(inputs[0]) for test in tests]
    values = [entry["value"] for entry in entries if entry is not None]
    if not values or not all(isinstance(value, int | float) for value in values):
        return "", ""
    least = f"{min(values):g}"
    return between([least, f"{max(values):g}"]), next(e["unit"] for e in entries if e is not None)


def _two_digits(value: float) -> str:
    """A number with two digits; nothing if it is not known."""
    if np.isnan(value):
        return ""
    if not np.isfinite(value):
        return "unbounded"
    # Without an exponent: 140, not 1.4e+02.
    return str(np.format_float_positional(value, precision=2, fractional=False, trim="-"))


# ---- picture -------------------------------------------------------------------------------------


def interval_picture(stored: Sequence[Stored], path: Path) -> None:
    """Draw the error of each counted quantity with the intervals of prediction and measurement."""
    # Loaded here, as tables need no pictures; "Agg" needs no screen.
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    families: dict[str, list[Interval]] = {}
    for case, results, changes in sorted(stored, key=lambda entry: entry[0].family):
        for test, result in results_by_test(case, results):
            for interval in intervals_of_test(case, test, result, changes):
                if interval is None:
                    continue
                if is_counted(case, test, interval.comparison.measured.quantity):
                    families.setdefault(case.family, []).append(interval)
    drawing, axis = pyplot.subplots(
        figsize=(MARGIN + COLUMN_WIDTH * max(len(families), 4), HEIGHT), layout="constrained"
    )
    for column, intervals in enumerate(families.values()):
        _draw_column(axis, column, intervals)
        axis.axvline(column + 1, color="0.85", linewidth=0.8, zorder=0)
    axis.axhline(0.0, color="0.3", linewidth=0.8, zorder=1)
    axis.set_xlim(0, max(len(families), 1))
    axis.set_ylim(-100 * LARGEST_ERROR, 100 * LARGEST_ERROR)
    axis.set_yscale("symlog", linthresh=10)
    ticks = [-100, -50, -20, -10, -5, 0, 5, 10, 20, 50, 100]
    axis.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()
    axis.set_xticks(np.arange(len(families)) + 0.5, list(families), parse_math=False)
    axis.tick_params(axis="x", length=0)
    axis.set_ylabel("error and intervals [%]")
    for name in VERDICTS:
        axis.plot(
            [], [], MARKERS[name], color=COLOURS[name], markersize=4, label=f"{name}, ± predicted"
        )
    axis.plot([], [], color="0.8", linewidth=4, label="± measured")
    axis.legend(fontsize=8, ncols=4, loc="upper center", bbox_to_anchor=(0.5, 1.12), frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    drawing.savefig(path, dpi=110)
    pyplot.close(drawing)


def _draw_column(axis, column: int, intervals: Sequence[Interval]) -> None:
    """The quantities of a family, evenly spaced over its column."""
    places = column + (np.arange(len(intervals)) + 0.5) / len(intervals)
    limit = 100 * LARGEST_ERROR
    for x, interval in zip(places, intervals, strict=True):
        error = 100 * float(((interval.y_predicted - interval.y_measured) / interval.sizes).mean())
        half = 100 * float((interval.half / interval.sizes).mean())
        measured = 100 * float((interval.by_measurement / interval.sizes).mean())
        colour = COLOURS[interval.verdict]
        axis.plot([x, x], [-measured, measured], color="0.8", linewidth=4, zorder=1)
        shown = float(np.clip(np.nan_to_num(error, nan=limit), -limit, limit))
        ends = np.clip([shown - half, shown + half], -limit, limit)
        axis.plot([x, x], ends, color=colour, linewidth=1.2, zorder=2)
        axis.plot(
            x,
            shown,
            MARKERS[interval.verdict],
            color=colour,
            markersize=4,
            zorder=3,
            clip_on=False,
        )
