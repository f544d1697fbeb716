"""Curves of all runs of a sweep in one picture: probes and pressures over the time, a line for each
run.

The first number that is varied gives the colours, the second one the dashes of the lines.  Runs
whose curves cover each other are one line, which says how many they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gossamer_fx.analysis.cases.results import Result, key_of, value_text
from gossamer_fx.core.model.body import Array
from gossamer_fx.records.fields.units import plain_text, scaled_axis
from gossamer_fx.records.plot.curve_panels import (
    INK,
    LINES,
    Curves,
    End,
    Panel,
    axis_of,
    label_ends,
)
from gossamer_fx.records.plot.page import write_page
from gossamer_fx.records.plot.run_tables import RunTables

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Of a sweep with more runs this many are drawn, at equal distances in the order of the table.
_MAX_RUNS = 100
# The picture has room for so many quantities.
_MAX_PANELS = 12
# Values of the first factor up to which each has its own colour and name; more have a bar.
_MAX_NAMED = 7
# Ratio of the ends of a bar of positive numbers from which on it is logarithmic.
_LOGARITHMIC = 30.0
# Of the range of a panel: curves that differ by less cover each other.
_LINE_WIDTH = 2e-3
# Between two numbers at a logarithmic bar, at least.
_TICK_RATIO = 2.0
_DASHES = ("-", "--", ":", "-.")
_FAILED = "x"  # at the end of the line of a run that failed


@dataclass(frozen=True)
class _Line:
    """One quantity of one run.

    Attributes:
        t: times, or values of the load parameter (n,).
        values: (n,), in the unit of the quantity.
        result: of the run.
    """

    t: Array
    values: Array
    result: Result


@dataclass(frozen=True)
class _Key:
    """What colours and dashes of the lines mean.

    Attributes:
        first: name of the factor that gives the colours; empty: none is varied.
        levels: its values in the order of the sweep.
        second: name of the factor that gives the dashes; empty: there is none.
        dashes: styles by the values of that factor; those beyond the last style have the first.
    """

    first: str
    levels: Sequence[Any]
    second: str
    dashes: Mapping[Any, str]

    @property
    def has_bar(self) -> bool:
        """Whether the colours are a scale of numbers; otherwise each value has its own."""
        is_number = all(isinstance(level, int | float) for level in self.levels)
        return is_number and len(self.levels) > _MAX_NAMED

    @property
    def is_logarithmic(self) -> bool:
        """Whether the scale of colours follows the logarithm."""
        return min(self.levels) > 0 and max(self.levels) > _LOGARITHMIC * min(self.levels)

    def colour(self, level: Any) -> Any:
        """The colour of the runs with a value of the first factor."""
        from matplotlib import colormaps

        if not self.has_bar:
            return LINES[self.levels.index(level) % len(LINES)]
        scale = np.log if self.is_logarithmic else np.asarray
        low, high, at = (float(scale(x)) for x in (min(self.levels), max(self.levels), level))
        # The brightest end could not be seen on white.
        return colormaps["viridis"](0.92 * (at - low) / (high - low))


def draw_lines(
    results: Sequence[Result], factors: Mapping[str, Sequence[Any]], runs: Path, path: Path
) -> None:
    """Draw the probes and gas pressures of all runs that were recorded.

    Nothing is written if no run was recorded with two states or more: those of a function that
    returns numbers, and single equilibria.

    Args:
        results: of the runs, also of those that failed.
        factors: values of each factor that is varied, by name.
        runs: folder with the folders of the runs.
        path: of the PNG.

    Raises:
        InputError: files of a run cannot be read.
        OutputFailure: the picture cannot be written.
    """
    chosen = results
    if len(results) > _MAX_RUNS:
        rows = np.linspace(0, len(results) - 1, _MAX_RUNS).astype(int)
        chosen = [results[row] for row in rows]
    quantities: dict[str, list[_Line]] = {}
    axis = None
    for result in chosen:
        folder = runs / key_of(result.values)
        # A run that failed at once, or a function without a recording, has none.
        if not (folder / "run.json").is_file():
            continue
        run = RunTables(folder)
        if run.kind == "mode":
            continue
        axis = axis or run.axis
        # Runs over other parameters would be on another axis.
        if run.axis == axis:
            for name, line in _lines_of(run, result):
                quantities.setdefault(name, []).append(line)
    if axis is None or not quantities:
        return
    names = [*factors, ""]
    second = names[1] if len(factors) > 1 else ""
    dashes = {level: _DASHES[k % len(_DASHES)] for k, level in enumerate(factors.get(second, ()))}
    # Equal values are one level: a list may have them several times.
    key = _Key(names[0], list(dict.fromkeys(factors.get(names[0], ()))), second, dashes)
    ends = [line.t for lines in quantities.values() for line in lines]
    every_t = np.concatenate(ends)
    factor, unit = scaled_axis(axis, every_t)
    shown = list(quantities)[:_MAX_PANELS]
    panels: list[Panel] = [
        partial(_draw_panel, name, quantities[name], key, factor) for name in shown
    ]
    words = []
    if len(chosen) < len(results):
        words.append(f"{len(chosen)} of {len(results)} runs")
    if len(shown) < len(quantities):
        words.append(f"{len(shown)} of {len(quantities)} quantities")
    title = ", ".join(words)
    if title:
        title += "; the folders of the runs have all."
    start = float(every_t.min()) / factor
    end = float(every_t.max()) / factor
    header = partial(_draw_key, key) if key.first else None
    write_page(path, title, None, Curves(panels, start, end, axis.label(unit), key=header))


def _lines_of(run: RunTables, result: Result) -> list[tuple[str, _Line]]:
    """Name, with unit, and line of each probe and each gas pressure of a run."""
    found = []
    for table in ("probes.csv", "gas.csv"):
        columns = run.table(table)
        t = run.along(columns)
        for name, values in columns.items():
            if name in run.not_values or len(t) < 2 or not np.isfinite(values).any():
                continue
            if table == "gas.csv":
                if not name.endswith(" pressure"):
                    continue
                name = f"{name} [Pa]"
            found.append((name, _Line(t, values, result)))
    return found


# ---- panels --------------------------------------------------------------------------------------


def _draw_panel(name: str, lines: Sequence[_Line], key: _Key, factor: float, axes: Axes) -> None:
    """Draw one quantity of all runs.

    Args:
        name: of the quantity with its unit, for the title.
        factor: of the unit of the time axis.
    """
    title, scale = axis_of(name, [line.values for line in lines])
    ends: list[End] = []
    for numbers in covering([(line.t, line.values) for line in lines]):
        group = [lines[number] for number in numbers]
        line = group[0]
        colour = INK
        dash = "-"
        # One line for runs of several colours belongs to none of them.
        if key.first and len({one.result.values[key.first] for one in group}) == 1:
            colour = key.colour(line.result.values[key.first])
        if key.second and len({one.result.values[key.second] for one in group}) == 1:
            dash = key.dashes[line.result.values[key.second]]
        values = line.values / scale
        axes.plot(line.t / factor, values, dash, color=colour, linewidth=1.2)
        if line.result.failed:
            axes.plot(line.t[-1:] / factor, values[-1:], _FAILED, color=colour, clip_on=False)
        if len(group) > 1:
            which = "all" if len(group) == len(lines) else f"{len(group)}"
            ends.append((f"{which} runs", float(values[np.isfinite(values)][-1]), colour))
    axes.set_title(title)
    if 0 < len(ends) <= _MAX_NAMED:
        label_ends(axes, ends)


def covering(curves: Sequence[tuple[Array, Array]]) -> list[list[int]]:
    """Numbers of the curves of a panel, in groups that cover each other: each curve is compared
    with the first one of a group.

    Args:
        curves: positions on the axis (n,) and values (n,) of each; NaN are gaps.

    Returns:
        Groups in the order of their first curves.
    """
    finite = np.concatenate([values[np.isfinite(values)] for _, values in curves])
    # Where nothing varies but round-off, all curves are one.
    range_ = 0.0
    if len(finite):
        range_ = max(float(np.ptp(finite)), 1e-9 * float(abs(finite).max()))
    groups: list[list[int]] = []
    for number, curve in enumerate(curves):
        for group in groups:
            if _is_covered(*curve, *curves[group[0]], _LINE_WIDTH * range_):
                group.append(number)
                break
        else:
            groups.append([number])
    return groups


def _is_covered(t: Array, values: Array, others_t: Array, others: Array, width: float) -> bool:
    """Whether a curve deviates from another one by less than a width, over the same times."""
    ends = abs(t[[0, -1]] - others_t[[0, -1]]).max()
    if ends > _LINE_WIDTH * np.ptp(others_t):
        return False
    # A path of equilibria may go back on its axis, where nothing can be interpolated.
    if len(t) == len(others_t) and np.array_equal(t, others_t):
        at_times = others
    elif (np.diff(t) > 0).all() and (np.diff(others_t) > 0).all():
        at_times = np.interp(t, others_t, others)
    else:
        return False
    differences = abs(values - at_times)
    same_gaps = np.array_equal(np.isnan(values), np.isnan(at_times))
    return same_gaps and bool(np.nanmax(differences, initial=0.0) <= width)


# ---- key -----------------------------------------------------------------------------------------


def _draw_key(key: _Key, axes: Axes) -> None:
    """Draw what colours and dashes mean, in the line above the panels."""
    from matplotlib.lines import Line2D

    axes.set_axis_off()
    handles = []
    if not key.has_bar:
        for level in key.levels:
            words = plain_text(f"{key.first} {value_text(level)}")
            handles.append(Line2D([], [], color=key.colour(level), label=words))
    for level, dash in key.dashes.items():
        words = plain_text(f"{key.second} {value_text(level)}")
        handles.append(Line2D([], [], color=INK, linestyle=dash, label=words))
    left = 0.0
    if key.has_bar:
        _draw_bar(key, axes.inset_axes((0.01, 0.5, 0.25, 0.3)))
        axes.text(0.27, 0.55, plain_text(key.first), va="center", transform=axes.transAxes)
        left = 0.4
    if handles:
        # Names that begin with "_" would be left out.
        axes.legend(
            handles,
            [f" {handle.get_label()}" for handle in handles],
            loc="center left",
            bbox_to_anchor=(left, 0.5),
            ncols=len(handles),
            frameon=False,
            borderpad=0.0,
            borderaxespad=0.0,
            columnspacing=1.2,
        )


def _draw_bar(key: _Key, bar: Axes) -> None:
    """Draw the scale of colours of the first factor, with its numbers."""
    low = float(min(key.levels))
    high = float(max(key.levels))
    space: Callable[..., Array] = np.linspace
    inner = np.array([0.5 * (low + high)])
    if key.is_logarithmic:
        space = np.geomspace
        inner = 10.0 ** np.arange(math.ceil(math.log10(low)), math.floor(math.log10(high)) + 1)
        bar.set_xscale("log")
        # Numbers next to the ends of the bar would touch theirs.
        inner = inner[(inner > _TICK_RATIO * low) & (inner < high / _TICK_RATIO)]
    edges = space(low, high, 129)
    colours = np.array([key.colour(level) for level in space(low, high, 128)])
    bar.pcolormesh(edges, [0.0, 1.0], colours[None])
    ticks = [low, *map(float, inner), high]
    bar.set_xticks(ticks, [value_text(tick) for tick in ticks])
    bar.minorticks_off()
    bar.set(yticks=[], xlim=(low, high))
    bar.tick_params(axis="x", labelsize=7.5, pad=1.5)
    bar.spines[:].set_visible(False)
