"""What happened in a run, over time, as panels of a figure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from gossamer_fx.fields.fields import STATES, AreaFractions
from gossamer_fx.model.body import Array
from gossamer_fx.plot.camera import STATE_COLOURS
from gossamer_fx.probes.run import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK = "#33383d"
LINES = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#B8860B",
    "#56B4E9",
    "#7F6A4F",
)  # after Okabe and Ito

_LEAST = 1e-6  # of the largest: what is always smaller is not shown
_LOGARITHMIC = 30.0  # ratio of the curves' peaks beyond which their axis is logarithmic
_LABEL_PITCH = 0.095  # of the axis' height
_LABEL_LENGTH = 14  # letters of a name that fit between two panels
_SHOWN = 0.02  # share of the area from which on a state is named
_PREFIXES = {1e-9: "n", 1e-6: "µ", 1e-3: "m", 1.0: "", 1e3: "k", 1e6: "M", 1e9: "G"}

Panel = Callable[["Axes"], None]


@dataclass(frozen=True)
class Snapshot:
    """Energies [J], pressures [Pa], fractions of area (slack, wrinkled, taut), closing errors and losses [J] by what
    took them at one time [s]."""

    time: float
    energies: dict[str, float]
    pressures: dict[str, float]
    fractions: list[Array]
    errors: dict[str, float]
    losses: dict[str, float]


def observe(run: Run, fractions: Sequence[AreaFractions]) -> Snapshot:
    """The state of a run."""
    totals, chambers = run.totals, run.chambers
    energies = {
        "kinetic": totals.kinetic,
        **{f"in {name}": energy for name, energy in totals.stored.items()},
    }
    energies |= {"supplied": totals.supplied, "dissipated": totals.dissipated}
    errors = {"energy": run.energy_error} | ({"gas mass": run.mass_error} if totals.mass else {})
    pressures = {name: state.pressure for name, state in chambers.items()}
    return Snapshot(
        run.time, energies, pressures, [f(run.system) for f in fractions], errors, totals.losses
    )


def panels(moments: Sequence[Snapshot], second: float) -> list[Panel]:
    """What there is to show, over time in units of `second`; each draws itself on its axes."""
    if len(moments) < 2:
        return []
    t = np.array([m.time for m in moments]) / second
    energies, pressures = (
        _table([m.energies for m in moments]),
        _table([m.pressures for m in moments]),
    )
    colours = dict(zip(energies, cycle(LINES), strict=False))
    chambers = {name: colours[f"in {name}"] for name in pressures}
    result: list[Panel] = [lambda axes: _lines(axes, t, energies, colours, "Energy", "J")]
    if len(moments[0].losses) > 1:
        losses = _table([m.losses for m in moments])
        shades = dict(zip(losses, cycle(LINES), strict=False))
        result.append(lambda axes: _lines(axes, t, losses, shades, "Energy lost", "J"))
    if pressures:
        result.append(lambda axes: _lines(axes, t, pressures, chambers, "Pressure", "Pa"))
    if moments[0].fractions:
        result.append(lambda axes: _states(axes, t, np.array([m.fractions[0] for m in moments])))
    result.append(lambda axes: _errors(axes, t, _table([m.errors for m in moments])))
    return result


def scaled(largest: float) -> tuple[float, str]:
    """Factor and prefix of the unit in which a number lies between 1 and 1000."""
    fitting = [f for f in _PREFIXES if f <= largest * (1 + 1e-9)]
    factor = max(fitting, default=1.0)
    return factor, _PREFIXES[factor]


def _table(rows: Sequence[dict[str, float]]) -> dict[str, Array]:
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _lines(
    axes: Axes, t: Array, curves: dict[str, Array], colours: dict[str, str], title: str, unit: str
) -> None:
    """Curves on one axis; where their sizes are far apart, the magnitudes on a logarithmic one."""
    peaks = {name: float(abs(values).max()) for name, values in curves.items()}
    largest = max(peaks.values())
    peaks = {name: peak for name, peak in peaks.items() if peak > _LEAST * largest}
    logarithmic = bool(peaks) and largest > _LOGARITHMIC * min(peaks.values())
    factor, prefix = (1.0, "") if logarithmic else scaled(largest)
    labels: dict[str, tuple[float, str]] = {}
    for name in peaks:
        values = curves[name] / factor
        if logarithmic:
            values = np.where(values == 0, np.nan, abs(values))
        axes.plot(t, values, color=colours[name])
        if np.isfinite(values[-1]):
            negative = logarithmic and curves[name][-1] < 0
            labels[("−" if negative else "") + name] = float(values[-1]), colours[name]
    if logarithmic:
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        axes.set_ylim(max(low, 0.01 * min(peaks.values()), _LEAST * largest), high)
    elif all((curves[name] >= 0).all() for name in peaks):
        axes.set_ylim(bottom=0)
    axes.set_title(f"{title} [{prefix}{unit}]")
    label_ends(axes, labels)


def _states(axes: Axes, t: Array, fractions: Array) -> None:
    order = [STATES[name] for name in ("taut", "wrinkled", "slack")]
    axes.stackplot(
        t, 100 * fractions[:, order].T, colors=[STATE_COLOURS[s] for s in order], linewidth=0
    )
    axes.set_ylim(0, 100)
    tops = np.cumsum(fractions[-1, order]) * 100
    names = {s: name for name, s in STATES.items()}
    labels = {
        names[s]: (float(top - 50 * fractions[-1, s]), INK)
        for s, top in zip(order, tops, strict=True)
    }
    label_ends(
        axes, {name: at for name, at in labels.items() if fractions[:, STATES[name]].max() > _SHOWN}
    )
    axes.set_title("State of the film [% of area]")


def _errors(axes: Axes, t: Array, errors: dict[str, Array]) -> None:
    """Magnitudes, and their running maxima."""
    labels: dict[str, tuple[float, str]] = {}
    axes.set_yscale("log")
    for (name, values), colour in zip(errors.items(), LINES, strict=False):
        values = np.where(values == 0, np.nan, abs(values))
        worst = np.fmax.accumulate(values)
        axes.plot(t, values, color=colour, linewidth=0.5, alpha=0.5)
        axes.plot(t, worst, color=colour)
        if np.isfinite(worst[-1]):
            labels[name] = float(worst[-1]), colour
    axes.set_ylim(1e-17, max([1e-12, *(3 * worst for worst, _ in labels.values())]))
    axes.set_title("Closing error of the ledger, relative")
    label_ends(axes, labels)


def label_ends(axes: Axes, labels: dict[str, tuple[float, str]]) -> None:
    """Name curves at their right ends, moved apart where they would overlap."""
    axes.autoscale_view()
    to_axes = axes.transData + axes.transAxes.inverted()
    ends = sorted(
        (float(to_axes.transform((0, y))[1]), name, colour) for name, (y, colour) in labels.items()
    )
    heights = np.array([y for y, _, _ in ends]).clip(0, 1)
    for _ in range(100):
        overlap = _LABEL_PITCH - np.diff(heights)
        push = np.where(overlap > 1e-4, overlap / 2, 0.0)
        heights[:-1] -= push
        heights[1:] += push
        heights = heights.clip(0, 1)
    for height, (_, name, colour) in zip(heights, ends, strict=True):
        words = name if len(name) <= _LABEL_LENGTH else name[: _LABEL_LENGTH - 1].rstrip() + "…"
        axes.annotate(
            words,
            (1, height),
            (5, 0),
            xycoords="axes fraction",
            textcoords="offset points",
            color=colour,
            va="center",
        )
