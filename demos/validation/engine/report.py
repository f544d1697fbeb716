"""What a validation found: a table, and a figure with the reference points over the curves.

References are measured, or computed by theory or another program, as the title and source of a case
say.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from demos.validation.engine.case import Array, Case, Measured, Test
from demos.validation.engine.comparison import (
    Comparison,
    comparisons,
    predicted_in,
    results_by_test,
)
from demos.validation.engine.intervals import Interval, chosen_points
from demos.validation.engine.units import UNITS
from gossamer_fx.extend import Result

HEAD = [
    "case",
    "test",
    "quantity",
    "predicted",
    "reference",
    "our error",
    "asked",
    "peer's error",
    "time [s]",
]
SUMMARY_HEAD = [
    "compared with",
    "family",
    "case",
    "quantity",
    "tests",
    "least error [%]",
    "largest error [%]",
    "asked [%]",
    "tests within",
    "peer's error [%]",
]
# Words of tables for the kinds of evidence, in their order.
COMPARED_WITH = {"experiment": "experiment", "theory": "theory", "program": "other program"}
ORDER = [*COMPARED_WITH.values()]
# Least width of a panel, and width of the label of a value [in].
PANEL_WIDTH = 3.2
LABEL_WIDTH = 0.17
PANELS_IN_A_ROW = 4
# Of the title of a figure.
LETTERS_PER_INCH = 12
# Largest over smallest value of a panel, beyond which errors of the smaller ones would not be seen:
# all are then drawn over the measured ones.
LARGEST_SPREAD = 20.0
# Relative error below which one decimal of the percentage would not show it.
SMALL_ERROR = 5e-4


def rows(cases: Iterable[tuple[Case, list[Result]]], quick: bool = False) -> Iterator[list[str]]:
    """Cells of a table of all results; of a curve the middle of the range and the mean error."""
    yield HEAD
    for case, results in cases:
        for test, result in results_by_test(case, results):
            seconds = f"{result.seconds:.3g}"
            for comparison in comparisons(test, result):
                cells = [case.name, test.name, *_cells(comparison, quick), seconds]
                if result.failed:
                    cells[5] = "failed"
                yield cells
                # The time is that of the whole test.
                seconds = ""


def summary(cases: Iterable[tuple[Case, list[Result]]]) -> Iterator[list[str]]:
    """Cells of a table with one row for each quantity of a case, with its best and worst test."""
    yield SUMMARY_HEAD
    groups: dict[tuple[str, str, str, str, bool], list[Comparison]] = {}
    # Sorted by family; cases and quantities in the order of their files.
    for case, results in sorted(cases, key=lambda entry: entry[0].family):
        for test, result in results_by_test(case, results):
            for comparison in comparisons(test, result):
                measured = comparison.measured
                # What is shown for information has a separate row.
                words = COMPARED_WITH[measured.evidence]
                if measured.not_counted:
                    words += ", not counted"
                key = (words, case.family, case.name, measured.quantity, is_asked(measured))
                groups.setdefault(key, []).append(comparison)
    # Experiments first.
    for (words, family, case_name, quantity, _), group in sorted(
        groups.items(), key=lambda entry: ORDER.index(entry[0][0].split(",")[0])
    ):
        by_limit = sorted(group, key=lambda one: one.measured.accepted[1])
        limit = between([asked(one.measured, quick=False) for one in by_limit])
        ordered = sorted(group, key=lambda one: abs(one.error))
        worst = _cells(ordered[-1], quick=False)[3]
        within = sum(one.is_accepted() and not one.measured.not_converged for one in group)
        percentages = [
            _cells(ordered[0], quick=False)[3],
            worst or "failed",
            limit,
            peer_errors(group),
        ]
        # The headings have the unit.
        least, largest, limit, peers = (text.replace(" %", "") for text in percentages)
        yield [
            words,
            family,
            case_name,
            quantity,
            str(len(group)),
            least,
            largest,
            limit,
            str(within) if limit else "",
            peers,
        ]


def between(words: Sequence[str]) -> str:
    """The first and the last of some words, once if they are the same; nothing of none."""
    return " to ".join(dict.fromkeys([*words[:1], *words[-1:]]))


def peer_errors(group: Iterable[Comparison]) -> str:
    """The least and the largest error of the peers that are known."""
    known = [one.measured.peer_error for one in group if math.isfinite(one.measured.peer_error)]
    return between([percent(error) for error in sorted(known)])


def _cells(comparison: Comparison, quick: bool) -> list[str]:
    """Quantity, predicted, measured, our error, asked, peer's error."""
    measured = comparison.measured
    # One value stands for a curve or several values; the error is that of all of them.
    k = comparison.middle
    name = measured.quantity
    if comparison.x is not None:
        name += f" at {comparison.x[k]:.4g} {measured.x_unit}"
    elif len(measured.y) > 1:
        label = measured.labels[k] if measured.labels else f"value {k + 1}"
        name += f", {label} (one of {len(measured.y)})"
    unit = "" if measured.unit == "1" else f" {measured.unit}"
    return [
        name,
        f"{comparison.y_predicted[k]:.4g}{unit}",
        f"{comparison.y_measured[k]:.4g}{unit}",
        percent(comparison.error, signed=not measured.is_mean_of_sizes),
        asked(measured, quick),
        percent(measured.peer_error),
    ]


def percent(value: float, signed: bool = False) -> str:
    """A relative error in words; nothing if it is not known, as that of a peer may be."""
    if not math.isfinite(value):
        return ""
    sign = "+" if signed else ""
    # Of small errors one digit, however small they are.
    form = ".1f" if abs(value) >= SMALL_ERROR else ".1g"
    return f"{100 * value:{sign}{form}} %"


def is_asked(measured: Measured) -> bool:
    """Whether the case asks something of the error, or else shows it for information."""
    return bool(np.isfinite(measured.accepted).all())


def asked(measured: Measured, quick: bool) -> str:
    """What the case asks of the error, in words; nothing if it asks nothing."""
    low, high = measured.quick_accepted if quick else measured.accepted
    if not math.isfinite(high):
        return ""
    if measured.is_mean_of_sizes:
        return f"{100 * high:g} %"
    return f"{100 * low:+g} to {100 * high:+g} %"


# ---- figure --------------------------------------------------------------------------------------


# Intervals of the quantities of tests, by the names of test and quantity.
Intervals = Mapping[tuple[str, str], Interval]


def figure(
    case: Case, results: list[Result], path: Path, intervals: Intervals | None = None
) -> None:
    """Draw a panel for each measured quantity: measured points over predicted curves or values.

    Args:
        case: the case.
        results: of its tests.
        path: of the picture.
        intervals: of predicted and measured values that are drawn, too.
    """
    # Loaded here, as tables need no pictures; "Agg" needs no screen.
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    # A curve has a panel; values of one quantity share one over all tests.
    panels: dict[tuple[str, str], list[tuple[Test, Comparison]]] = {}
    by_name = {}
    for test, result in results_by_test(case, results):
        by_name[test.name] = result
        for comparison in comparisons(test, result):
            quantity = comparison.measured.quantity
            is_curve = comparison.x is not None
            key = (quantity, test.name if is_curve else "")
            panels.setdefault(key, []).append((test, comparison))
    if not panels:
        return
    columns = min(PANELS_IN_A_ROW, len(panels))
    rows = math.ceil(len(panels) / columns)
    # Each value of a panel of values has a label below it.
    labels = [
        sum(len(comparison.y_measured) for _, comparison in entries)
        for (_, test_name), entries in panels.items()
        if not test_name
    ]
    width = max([PANEL_WIDTH, *(LABEL_WIDTH * count for count in labels)])
    size = (max(width * columns, 5.0), 2.7 * rows + 1.0)
    drawing, axes = pyplot.subplots(
        rows, columns, figsize=size, squeeze=False, layout="constrained"
    )
    # The last row may have axes that no panel takes.
    for axis in axes.ravel()[len(panels) :]:
        axis.set_visible(False)
    for axis, ((quantity, test_name), entries) in zip(axes.ravel(), panels.items(), strict=False):
        words = test_name or quantity
        if test_name:
            comparison = entries[0][1]
            _draw_curve(axis, comparison, by_name[test_name])
            if predicted_in(by_name[test_name], comparison.measured.quantity) is not None:
                # In the title: within the panel it would lie on a curve in one case or another.
                words = f"{words}\nmean error {percent(comparison.mean_error)}"
            _draw_bands(axis, (intervals or {}).get((test_name, quantity)))
        else:
            scales = _draw_values(axis, entries)
            found = [(intervals or {}).get((test.name, quantity)) for test, _ in entries]
            _draw_bars(axis, found, scales)
        # Words of a case file are text, not formulas.
        axis.set_title(
            words,
            fontsize=9,
            parse_math=False,
        )
        axis.grid(alpha=0.25)
        axis.tick_params(labelsize=8)
    # Outside of the panels, where it hides no value.
    handles, names = axes.ravel()[0].get_legend_handles_labels()
    drawing.legend(handles, names, loc="outside lower center", ncols=2, fontsize=8)
    title = _even_lines(case.title, int(LETTERS_PER_INCH * size[0]))
    drawing.suptitle(title, fontsize=11, parse_math=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    drawing.savefig(path, dpi=100)
    pyplot.close(drawing)


def _even_lines(words: str, letters: int) -> str:
    """A title on as few lines of at most so many letters as it needs, of nearly equal lengths."""
    fewest = len(textwrap.wrap(words, letters))
    widths = range(letters // 2, letters + 1)
    return next(
        text
        for text in (textwrap.fill(words, width) for width in widths)
        if text.count("\n") < fewest
    )


def _draw_curve(axis, comparison: Comparison, result: Result) -> None:
    """Measured points, the predicted curve, and the range in which they are compared."""
    measured = comparison.measured
    axis.plot(
        measured.x,
        measured.y,
        "o",
        markersize=3,
        color="0.45",
        label="reference",
    )
    predicted = predicted_in(result, measured.quantity)
    if predicted is not None:
        x = predicted.x / UNITS[measured.x_unit][1]
        y = predicted.y / UNITS[measured.unit][1]
        axis.plot(
            x,
            y,
            "-",
            color="tab:red",
            linewidth=1.6,
            label="predicted",
        )
    axis.axvspan(*measured.x_range, color="0.95", zorder=0)
    axis.set_xlabel(
        f"[{measured.x_unit}]",
        fontsize=8,
        parse_math=False,
    )
    axis.set_ylabel(
        f"{measured.quantity} [{measured.unit}]",
        fontsize=8,
        parse_math=False,
    )
    # From zero, so that errors are seen against the whole quantity.
    axis.set_ylim(bottom=min(0.0, *axis.get_ylim()))


def _draw_bands(axis, interval: Interval | None) -> None:
    """The intervals along a curve."""
    if interval is None:
        return
    x = interval.comparison.x[chosen_points(interval.comparison)]
    for y, half, colour, words in (
        (interval.y_measured, interval.by_measurement, "0.45", "± reference"),
        (interval.y_predicted, interval.half, "tab:red", "± predicted"),
    ):
        if np.isfinite(half).all():
            axis.fill_between(x, y - half, y + half, color=colour, alpha=0.2, lw=0, label=words)


def _draw_bars(axis, intervals: Sequence[Interval | None], scales: Sequence[Array]) -> None:
    """The intervals of values, which are drawn over their scales (n,)."""
    place = 0
    for interval, scale in zip(intervals, scales, strict=True):
        places = place + np.arange(len(scale))
        place += len(scale)
        if interval is None:
            continue
        for y, half, colour, width in (
            (interval.y_measured, interval.by_measurement, "0.45", 4.0),
            (interval.y_predicted, interval.half, "tab:red", 1.2),
        ):
            if np.isfinite(half).all():
                low = (y - half) / scale
                high = (y + half) / scale
                axis.vlines(places, low, high, color=colour, alpha=0.4, lw=width)


def _draw_values(axis, entries: list[tuple[Test, Comparison]]) -> list[Array]:
    """Measured and predicted values next to each other, one after another over all tests; the
    scales (n,) over which those of each test are drawn."""
    names = []
    y_measured = []
    y_predicted = []
    for test, comparison in entries:
        count = len(comparison.y_measured)
        labels = comparison.measured.labels or [str(k + 1) for k in range(count)]
        if count == 1 and not comparison.measured.labels:
            labels = [""]
        names += [f"{test.name} {label}".strip() for label in labels]
        y_measured += list(comparison.y_measured)
        y_predicted += list(comparison.y_predicted)
    places = np.arange(len(names))
    unit = entries[0][1].measured.unit
    label = "" if unit == "1" else f"[{unit}]"
    sizes = np.abs(y_measured)
    scales = [np.ones(len(comparison.y_measured)) for _, comparison in entries]
    if sizes.max() > LARGEST_SPREAD * sizes.min():
        scales = [comparison.y_measured for _, comparison in entries]
        y_predicted = list(np.divide(y_predicted, y_measured))
        y_measured = [1.0] * len(names)
        label = "over reference"
    axis.plot(
        places,
        y_measured,
        "o",
        color="0.45",
        label="reference",
    )
    axis.plot(
        places,
        y_predicted,
        "_",
        color="tab:red",
        markersize=14,
        markeredgewidth=2.5,
    )
    # For the legend: the wide mark above would be cut off there.
    axis.plot(
        [],
        [],
        "_",
        color="tab:red",
        markeredgewidth=2.5,
        label="predicted",
    )
    axis.set_xticks(
        places,
        names,
        rotation=60,
        ha="right",
        fontsize=6,
        parse_math=False,
    )
    axis.set_ylabel(label, fontsize=8, parse_math=False)
    return scales
