"""The tables of a run's folder as panels of a figure: energies, gas, states of the films, errors,
solver, probes."""

from __future__ import annotations

import math
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from gossamer_fx.core.model.body import Array
from gossamer_fx.records.fields.film_states import STATES
from gossamer_fx.records.fields.units import plain_text, scaled_axis, scaled_unit
from gossamer_fx.records.outputs.tables import LOST
from gossamer_fx.records.plot.colours import STATE_COLOURS
from gossamer_fx.records.plot.run_reader import RunReader
from gossamer_fx.records.plot.run_tables import Tables
from gossamer_fx.solve.view import LOAD_FACTOR

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK = "#33383d"
# after M. Okabe and K. Ito, Color universal design (2008)
LINES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#B8860B", "#56B4E9", "#7F6A4F")

_MAX_POINTS = 2000  # of a curve: more are not seen, and make files large
_NEGLIGIBLE = 1e-6  # of the largest curve: a curve that is always smaller is not shown
_LOGARITHMIC = 30.0  # ratio of the peaks of curves from which on their axis is logarithmic
_LABEL_PITCH = 0.082  # height of a line of a label, of the height of the axes
_LABEL_GAP = 0.018  # between labels, of the height of the axes
_SAME_HEIGHT = 0.01  # of the axes: ends of curves that are nearer have names in the given order
_HARDLY_CHANGES = 1e-10  # change over the value, below which a curve is drawn as a flat one
_FLAT_MARGIN = 0.05  # of the value, above and below a flat curve
_LABEL_WIDTH = 18  # letters of a line of a name at the end of a curve
_LABEL_LINES = 2  # that such a name has at most
_TITLE_WIDTH = 40  # letters of a line of a panel's title
_TITLE_LINES = 4  # that such a title has at most
_SHOWN_SHARE = 0.02  # share of the area from which on a state is named
_SMALLEST_ERROR = 1e-17
_USUAL_ERROR = 1e-12  # to which the axis of errors goes at least
_ANGULAR = "angular momentum "  # before the axes of its components
STORED = "stored "  # before the names of parts that store energy
_UNIT = re.compile(r"\[([^]]*)\]$")  # at the end of a probe's name
_SCALED_UNITS = ("m", "m/s", "N", "Pa", "J", "W", "Hz")  # of probes, that get a prefix
_NUMBER = re.compile(r"[\s_-]*\d+")  # that tells one part of a family from the others
_MAX_PROBE_PANELS = 24  # each takes a third of a second
_MAX_SHARED_PANELS = 8  # of more probes than these panels hold
_FAMILY = 3  # least number of parts, whose names differ in a number, that become a band
_BAND = ("largest of ", "mean of ", "least of ")  # before the number and name of the parts
_DANGLING = re.compile(r"( (of|the|a|an|at|in|on|by))+$")  # before the word that tells curves apart
_PROBE = re.compile(r"(.+) (\S+)( \[[^]]*\])")  # a probe's name with a unit: "tip x [m]"

Panel = Callable[["Axes"], None]
# Name, last value and colour of a curve.
End = tuple[str, float, Any]


@dataclass(frozen=True)
class Curves:
    """Panels over one axis: the time, or the load parameter of a path of equilibria.

    Attributes:
        panels: functions that draw themselves on axes.
        start: of the axis, in its unit.
        end: of the axis, in its unit.
        label: of the axis, e.g. "t [ms]".
        at: function that returns the positions on the axis of values of the run's own axis.
        key: function that draws what the colours of all panels mean, on axes in a line above them;
            None: each panel says it.
    """

    panels: list[Panel]
    start: float = 0.0
    end: float = 1.0
    label: str = "t [s]"
    at: Callable[[Array], Array] = np.asarray
    key: Panel | None = None


def run_curves(run: RunReader, solver: bool = True) -> Curves:
    """Return the panels of a run over time, of a path of equilibria over the load: energies, gas,
    states of the film, errors.

    There are none if ledger.csv is absent or has fewer than two rows.  Curves have at most 2000
    points: of a longer table rows at about equal distances are drawn, the first and the last
    included.  Panels of gas.csv, tensions.csv, states.csv and probes.csv are left out if the file
    is absent, or nothing is seen in them.
    """
    ledger = _thinned(run.table("ledger.csv"))
    if len(run.along(ledger)) < 2:
        return Curves([])
    axis = run.axis
    over = run.along
    folds = LOAD_FACTOR.column in ledger
    if folds:
        axis = LOAD_FACTOR
        points = run.along(ledger)
        loads = ledger[axis.column]

        def over(table: Tables) -> Array:
            """Loads (n,) at the points of the path that are the rows of a table."""
            return np.interp(run.along(table), points, loads)

    factor, unit = scaled_axis(axis, over(ledger))
    gas = _thinned(run.table("gas.csv"))
    states = _thinned(run.table("states.csv"))

    energies = {"kinetic": ledger["kinetic"]}
    # The kinetic, supplied and dissipated energy have a colour each.
    stored = _with_sum_of_others(_with_prefix(ledger, STORED), most=len(LINES) - 3)
    energies |= {f"in {name}": energy for name, energy in stored.items()}
    energies |= {name: ledger[name] for name in ("supplied", "dissipated")}
    if run.kind == "equilibrium" and len(stored) > 1:
        # To be compared with the supplied energy.
        energies["stored, all"] = np.sum(list(stored.values()), axis=0)
    colours = _line_colours(energies)
    t = over(ledger) / factor
    panels: list[Panel] = []
    if _is_seen(energies):
        panels.append(partial(_lines, t, energies, colours, "Energy", "J"))
    if "residual" in ledger:
        panels.append(partial(_residuals, t, ledger["residual"]))
    losses = _with_sum_of_others(_with_prefix(ledger, LOST), most=len(LINES))
    if len(losses) > 1 and _is_seen(losses):
        panels.append(partial(_lines, t, losses, _line_colours(losses), "Energy lost", "J"))
    suffix = " pressure"
    pressures = {
        name.removesuffix(suffix): values for name, values in gas.items() if name.endswith(suffix)
    }
    if _is_seen(pressures):
        pressures = _in_bands(pressures)
        shades = _line_colours(pressures)
        if all(f"in {name}" in colours for name in pressures):
            # a chamber has the colour of its energy
            shades = {name: colours[f"in {name}"] for name in pressures}
        panels.append(partial(_lines, over(gas) / factor, pressures, shades, "Pressure", "Pa"))
    tensions = _thinned(run.table("tensions.csv"))
    means = _in_bands(_mean_tensions(tensions))
    if means:
        times = over(tensions) / factor
        panels.append(partial(_lines, times, means, _line_colours(means), "Tension", "N"))
    shares = _area_shares(run, states)
    if shares and folds:
        # Areas over a load that falls again would lie on each other.
        percent = {name: 100 * values for name, values in shares.items()}
        title = "State of the films"
        panels.append(
            partial(_lines, over(states) / factor, percent, _line_colours(percent), title, "%")
        )
    elif shares:
        panels.append(partial(_states, over(states) / factor, shares))
    angular = _with_prefix(ledger, _ANGULAR)
    # A scene that starts at rest has none, or what its supports give it.
    if any(values[0] != 0 for values in angular.values()):
        shades = _line_colours(angular)
        title = "Angular momentum about the origin"
        panels.append(partial(_lines, t, angular, shades, title, "kg m²/s"))
    # A path of equilibria has none.
    names = {"energy_error": "energy", "mass_error": "gas mass"}
    errors = {words: ledger[name] for name, words in names.items() if name in ledger}
    if errors:
        panels.append(partial(_errors, t, errors))
    if solver:
        panels.append(partial(_iterations, t, ledger["iterations"]))
        probes = _thinned(run.table("probes.csv"))
        panels += [
            partial(_probes, over(probes) / factor, title, _in_bands(curves))
            for title, curves in _few(grouped(_without(probes, run.not_values))).items()
            if any((np.isfinite(values) & (values != 0)).any() for values in curves.values())
        ]

    def at(values: Array) -> Array:
        """Positions on the axis, which of a path of equilibria are loads."""
        if folds:
            return np.interp(values, points, loads) / factor
        return np.asarray(values) / factor

    start = float(t.min())
    return Curves(panels, start=start, end=float(t.max()), label=axis.label(unit), at=at)


def grouped(probes: Tables) -> dict[str, Tables]:
    """Group probes into panels: those whose names differ in the last word share one.

    "tip x [m]" and "tip y [m]" are the curves x and y of the panel "tip [m]".  A name that shares
    with no other, or has no unit, is a panel by itself, whose curve has an empty name.

    Args:
        probes: columns (n,) of a table of probes by name.

    Returns:
        the curves (n,) of each panel by the last words of their names, by the title of the panel.
    """
    found = {name: _PROBE.fullmatch(name) for name in probes}
    titles = {
        name: _DANGLING.sub("", parts[1]) + parts[3] for name, parts in found.items() if parts
    }
    names_of_title = Counter(titles.values())
    panels: dict[str, Tables] = {}
    for name, values in probes.items():
        parts = found[name]
        if parts is None or names_of_title[titles[name]] == 1:
            panels.setdefault(name, {})[""] = values
        else:
            panels.setdefault(titles[name], {})[parts[2]] = values
    return panels


def _few(panels: dict[str, Tables]) -> dict[str, Tables]:
    """Panels of probes, at most about as many as a page holds: of more, those of the same unit
    share one, and of many units the last ones, too."""
    if len(panels) <= _MAX_PROBE_PANELS:
        return panels
    of_unit: dict[str, Tables] = {}
    for title, curves in panels.items():
        found = _UNIT.search(title)
        unit = f" [{found[1]}]" if found else ""
        if unit not in of_unit and len(of_unit) >= _MAX_SHARED_PANELS:
            unit = " of other units"
        names = {f"{title} {name}".strip(): values for name, values in curves.items()}
        of_unit.setdefault(unit, {}).update(names)
    shared: dict[str, Tables] = {}
    for unit, curves in of_unit.items():
        title = f"{len(curves)} probes{unit}"
        if len(curves) == 1:
            title = next(iter(curves))
        shared[title] = curves
    return shared


def _thinned(table: Tables) -> Tables:
    """A table with at most so many rows as are seen in a curve; the first and the last row stay."""
    if not table:
        return table
    count = len(next(iter(table.values())))
    rows = np.unique(np.linspace(0, count - 1, _MAX_POINTS).astype(int))
    return {name: values[rows] for name, values in table.items()}


def _without(table: Tables, columns: Collection[str]) -> Tables:
    """A table without some of its columns."""
    return {name: values for name, values in table.items() if name not in columns}


def _with_prefix(table: Tables, prefix: str) -> Tables:
    """The columns whose names begin with a prefix, named by the remainder."""
    return {
        name.removeprefix(prefix): values
        for name, values in table.items()
        if name.startswith(prefix)
    }


def _area_shares(run: RunReader, states: Tables) -> Tables:
    """Shares of the area of all films by state, from the bottom to the top of the panel.

    Each film counts by the area of its stress-free mesh."""
    bodies = run.about["scene"]["bodies"]
    films = [name for name in run.films if {f"{name} taut", f"{name} wrinkled"} <= set(states)]
    # A damaged description of a scene may lack some.
    films = [film for film in films if 0 < bodies.get(film, {}).get("area", 0.0) < math.inf]
    if not films:
        return {}
    areas = np.array([bodies[film]["area"] for film in films])
    taut, wrinkled = (
        np.average([states[f"{film} {state}"] for film in films], axis=0, weights=areas)
        for state in ("taut", "wrinkled")
    )
    return {"taut": taut, "wrinkled": wrinkled, "slack": 1 - taut - wrinkled}


def _mean_tensions(tensions: Tables) -> Tables:
    """The mean tensions of lines by name.

    Args:
        tensions: tensions.csv, whose columns are called "NAME mean [N]", and so on; may be empty.
    """
    suffix = " mean [N]"
    return {
        name.removesuffix(suffix): values
        for name, values in tensions.items()
        if name.endswith(suffix) and values.any()
    }


def _with_sum_of_others(curves: Tables, most: int) -> Tables:
    """At most so many curves of parts that add up: the largest, and the sum of the others."""
    if len(curves) <= most:
        return curves
    largest_first = sorted(curves, key=lambda name: -float(abs(curves[name]).max()))
    # A set, as there may be many.
    others = set(largest_first[most - 1 :])
    shown = {name: values for name, values in curves.items() if name not in others}
    return shown | {f"{len(others)} others": np.sum([curves[name] for name in others], axis=0)}


def _is_seen(curves: Tables) -> bool:
    """Whether any value differs from zero."""
    return any(np.nan_to_num(values).any() for values in curves.values())


def _in_bands(curves: Tables) -> Tables:
    """Curves of similar parts, at most as many curves and bands as there are colours.

    Of more curves, those of parts whose names differ in a number only, "tie 1", "tie 2", ...,
    become a band: their largest, mean and least value.  If there are still too many, all parts
    become one band.
    """
    if len(curves) <= len(LINES):
        return curves
    families: dict[str, Tables] = {}
    for name, values in curves.items():
        stem = _NUMBER.sub("", name)
        families.setdefault(stem, {})[name] = values
    found: Tables = {}
    drawn = 0
    for stem, family in families.items():
        is_band = len(family) >= _FAMILY
        found |= _band(family, f" {stem}") if is_band else family
        drawn += 1 if is_band else len(family)
    if len(families) == 1 or drawn > len(LINES):
        return _band(curves, "")
    return found


def _band(curves: Tables, name: str) -> Tables:
    """The largest, the mean and the least value of some curves at each time.

    Args:
        name: of what the curves are, after their number; empty: of all.
    """
    values = np.array(list(curves.values()))
    limits = (values.max(axis=0), values.mean(axis=0), values.min(axis=0))
    words = f"{len(curves)}{name}".rstrip()
    return {f"{which}{words}": curve for which, curve in zip(_BAND, limits, strict=True)}


def _band_of(name: str) -> str:
    """The name of a curve without "largest of " and the like: three curves of a band share it."""
    for which in _BAND:
        if name.startswith(which):
            return name.removeprefix(which)
    return name


def _line_colours(curves: Mapping[str, Array]) -> dict[str, str]:
    """A colour for each curve, and one for the three of a band."""
    names = dict.fromkeys(_band_of(name) for name in curves)
    colours = dict(zip(names, cycle(LINES), strict=False))
    return {name: colours[_band_of(name)] for name in curves}


def _fill_bands(t: Array, curves: Tables, colours: Mapping[str, str], axes: Axes) -> None:
    """Fill the bands between their least and largest curves."""
    largest, _, least = _BAND
    for name, values in curves.items():
        lower = f"{least}{name.removeprefix(largest)}"
        if name.startswith(largest) and lower in curves:
            axes.fill_between(t, curves[lower], values, color=colours[name], alpha=0.2, lw=0)


# ---- panels --------------------------------------------------------------------------------------


def _lines(
    t: Array,
    curves: Tables,
    colours: Mapping[str, str],
    title: str,
    unit: str,
    axes: Axes,
) -> None:
    """Draw curves on one axis; if their sizes are far apart, their magnitudes on a logarithmic one.

    There must be a curve; ValueError without one. The axes are changed in place: curves, limits,
    title and labels at the ends.

    Args:
        t: times (n,), in the unit of the time axis.
        curves: values (n,) by name, in `unit`; those below 1e-6 of the largest are left out.
    """
    peaks = {name: float(abs(values).max()) for name, values in curves.items()}
    largest = max(peaks.values())
    peaks = {name: peak for name, peak in peaks.items() if peak > _NEGLIGIBLE * largest}
    logarithmic = bool(peaks) and largest > _LOGARITHMIC * min(peaks.values())
    factor = 1.0
    if not logarithmic:
        factor, unit = scaled_unit(largest, unit)
    ends: list[End] = []
    shown: Tables = {}
    for name in peaks:
        values = curves[name] / factor
        label = name
        if logarithmic:
            values = np.where(values == 0, np.nan, abs(values))
            if curves[name][-1] < 0:
                label = f"−{name}"
        axes.plot(t, values, color=colours[name], label=label)
        ends.append((label, _last_finite(values), colours[name]))
        shown[name] = values
    _fill_bands(t, shown, colours, axes)
    if logarithmic:
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        axes.set_ylim(max(low, 0.01 * min(peaks.values()), _NEGLIGIBLE * largest), high)
    elif all((curves[name] >= 0).all() for name in peaks):
        axes.set_ylim(bottom=0)
    axes.set_title(f"{title} [{unit}]")
    label_ends(axes, ends)


def _states(t: Array, shares: Tables, axes: Axes) -> None:
    """Draw the shares of the area of films by state, stacked to 100 %.

    Args:
        t: times (n,), in the unit of the time axis.
        shares: of "taut", "wrinkled" and "slack", (n,) each, from 0 to 1.
    """
    colours = [STATE_COLOURS[STATES[name]] for name in shares]
    percent = [100 * values for values in shares.values()]
    axes.stackplot(t, *percent, colors=colours, linewidth=0, labels=list(shares))
    axes.set_ylim(0, 100)
    ends: list[End] = []
    top = 0.0
    for name, values in shares.items():
        last = 100 * float(values[-1])
        if values.max() > _SHOWN_SHARE:
            ends.append((name, top + last / 2, INK))
        top += last
    axes.set_title("State of the films [% of their area]")
    label_ends(axes, ends)


def _errors(t: Array, errors: Tables, axes: Axes) -> None:
    """Draw the relative errors of the balances: magnitudes over time, and their running maxima.

    Args:
        t: times (n,), in the unit of the time axis.
        errors: relative closing errors (n,) of energy and gas mass, by name.
    """
    ends: list[End] = []
    axes.set_yscale("log")
    for name, colour in zip(errors, LINES, strict=False):
        values = np.where(errors[name] == 0, np.nan, abs(errors[name]))
        largest_so_far = np.fmax.accumulate(values)
        axes.plot(t, values, color=colour, linewidth=0.5, alpha=0.5)
        axes.plot(t, largest_so_far, color=colour, label=name)
        ends.append((name, _last_finite(largest_so_far), colour))
    highest = max((3 * end for _, end, _ in ends if np.isfinite(end)), default=0.0)
    axes.set_ylim(_SMALLEST_ERROR, max(_USUAL_ERROR, highest))
    axes.set_title("Closing error of the ledger, relative")
    label_ends(axes, ends)


def _residuals(t: Array, residuals: Array, axes: Axes) -> None:
    """Draw the unbalanced force of equilibria over that of loads and supports."""
    axes.set_yscale("log")
    axes.plot(t, np.where(residuals > 0, residuals, np.nan), color=LINES[0], marker=".")
    positive = residuals[residuals > 0]
    if positive.size:
        # Whole decades, so that two at least have numbers.
        lowest = np.floor(np.log10(positive.min()))
        highest = np.floor(np.log10(positive.max())) + 1
        axes.set_ylim(10.0**lowest, 10.0**highest)
    axes.set_title("Unbalanced force, relative")


def _iterations(t: Array, iterations: Array, axes: Axes) -> None:
    axes.plot(t, iterations, color=LINES[0], linewidth=0.8)
    axes.set_ylim(bottom=0)
    axes.locator_params(axis="y", integer=True)
    axes.set_title("Newton iterations of a step")


def _probes(
    t: Array,
    title: str,
    curves: Tables,
    axes: Axes,
) -> None:
    """Draw the curves of probes that share a title and a unit.

    Args:
        t: times (n,), in the unit of the time axis.
        curves: values (n,) by the words at their ends, e.g. "x"; an empty name is not written.
    """
    title, factor = axis_of(title, curves.values())
    colours = _line_colours(curves)
    shown = {name: values / factor for name, values in curves.items()}
    ends: list[End] = []
    for name, values in shown.items():
        axes.plot(t, values, color=colours[name], label=name or None)
        if name:
            ends.append((name, float(values[-1]), colours[name]))
    _fill_bands(t, shown, colours, axes)
    axes.set_title(title)
    label_ends(axes, ends)


def axis_of(name: str, curves: Iterable[Array]) -> tuple[str, float]:
    """Title of the panel of a probe with the unit of its axis, and what values are divided by.

    Args:
        name: of the probe, with its unit at the end if it has one.
        curves: values (n,) in that unit.
    """
    unit = _UNIT.search(name)
    factor = 1.0
    if unit is not None and unit[1] in _SCALED_UNITS:
        largest = max(float(np.nan_to_num(abs(values)).max()) for values in curves)
        factor, words = scaled_unit(largest, unit[1])
        name = f"{name[: unit.start()]}[{words}]"
    return wrapped(plain_text(name), _TITLE_WIDTH, _TITLE_LINES), factor


def label_ends(axes: Axes, ends: Iterable[End]) -> None:
    """Name curves at their right ends, moved apart where the names would overlap."""
    axes.autoscale_view()
    low, high = axes.get_ylim()
    size = max(abs(low), abs(high))
    if axes.get_yscale() == "linear" and high - low < _HARDLY_CHANGES * size:
        # Else the numbers of the axis would have all digits of a round-off.
        axes.set_ylim(low - _FLAT_MARGIN * size, high + _FLAT_MARGIN * size)
    to_axes = axes.transData + axes.transAxes.inverted()
    labels = [
        (float(to_axes.transform((0, value))[1]), name, colour)
        for name, value, colour in ends
        if np.isfinite(value)
    ]
    # From the bottom to the top; those of one height from the last to the first, as they are read.
    labels.reverse()
    labels.sort(key=lambda label: round(label[0] / _SAME_HEIGHT))
    texts = [wrapped(plain_text(name), _LABEL_WIDTH, _LABEL_LINES) for _, name, _ in labels]
    lines = np.array([len(text.splitlines()) for text in texts])
    # A long name loses its middle if the axes are too low for two lines each.
    if (_LABEL_PITCH * lines + _LABEL_GAP).sum() > 1:
        texts = [wrapped(plain_text(name), _LABEL_WIDTH, 1) for _, name, _ in labels]
        lines = np.ones(len(labels), dtype=int)
    # Those of one height may descend by a little.
    heights = np.maximum.accumulate(np.array([height for height, _, _ in labels])).clip(0, 1)
    distances = _LABEL_PITCH * (lines[1:] + lines[:-1]) / 2 + _LABEL_GAP
    # Each pass moves neighbours that overlap half of the way apart; 100 passes separate seven
    # labels.
    for _ in range(100):
        overlap = distances - np.diff(heights)
        push = np.where(overlap > 1e-4, overlap / 2, 0.0)
        heights[:-1] -= push
        heights[1:] += push
        heights = heights.clip(0, 1)
    for height, text, (_, _, colour) in zip(heights, texts, labels, strict=True):
        axes.annotate(
            text,
            xy=(1, height),
            xytext=(5, 0),
            xycoords="axes fraction",
            textcoords="offset points",
            color=colour,
            va="center",
            linespacing=1.0,
        )


def wrapped(name: str, width: int, most_lines: int) -> str:
    """A name in one or two lines of at most `width` letters; one that is too long loses its middle.

    The ends of names distinguish them, e.g. "damping of the film (mass)" and "(stiffness)".
    """
    # `textwrap` would join all white space, also line ends, so that no text has more lines than it
    # says.
    found = textwrap.wrap(name, width)
    if len(found) <= most_lines:
        return "\n".join(found)
    if most_lines == 1:
        half = (width - 1) // 2
        return f"{name[:half].rstrip()}…{name[-half:].lstrip()}"
    return f"{name[: width - 1].rstrip()}…\n{name[-width:].lstrip()}"


def _last_finite(values: Array) -> float:
    """The last number of a curve; a curve on a logarithmic axis has none where it is zero."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return float("nan")
    return float(finite[-1])
