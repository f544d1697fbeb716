"""The tables of a run's folder as panels of a figure."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from gossamer_fx.fields.fields import STATES
from gossamer_fx.model.body import Array
from gossamer_fx.outputs.ledger import LOST
from gossamer_fx.plot.curve_panels import LINES, Panel, Snapshot, label_ends, panels, scaled
from gossamer_fx.plot.run_reader import RunReader, Tables

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST = 2000  # points of a curve
_PART = re.compile(r"(.+) (\S+)( \[[^]]*\])")  # a probe's name with a unit: "tip x [m]"


def run_curves(run: RunReader) -> tuple[list[Panel], tuple[float, float], str]:
    """Panels of energies, pressures, states, closing errors, solver and probes; start, end and unit of their time."""
    ledger, gas, states = (run.table(f"{name}.csv") for name in ("ledger", "gas", "states"))
    if not ledger or len(ledger["time"]) < 2:
        return [], (0.0, 0.0), "s"
    rows = np.unique(np.linspace(0, len(ledger["time"]) - 1, _MOST).astype(int))
    factor, prefix = scaled(float(ledger["time"].max()))
    moments = [_moment(ledger, gas, states, run.films, int(row)) for row in rows]
    found = panels(moments, factor)
    found.append(partial(_work, ledger["time"] / factor, ledger))
    probes = run.table("probes.csv")
    found += [
        partial(_probes, probes["time"] / factor, title, curves)
        for title, curves in grouped(probes).items()
    ]
    return found, (ledger["time"][0] / factor, ledger["time"][-1] / factor), f"{prefix}s"


def _moment(
    ledger: Tables, gas: Tables, states: Tables, films: Sequence[str], row: int
) -> Snapshot:
    stored = {
        f"in {name[7:]}": float(ledger[name][row]) for name in ledger if name.startswith("stored ")
    }
    flows = {name: float(ledger[name][row]) for name in ("supplied", "dissipated")}
    errors = {"energy": float(ledger["energy_error"][row])}
    if "mass_error" in ledger:
        errors["gas mass"] = float(ledger["mass_error"][row])
    time = float(ledger["time"][row])
    chamber = " pressure"
    pressures = {
        name.removesuffix(chamber): _at(gas, name, time) for name in gas if name.endswith(chamber)
    }
    return Snapshot(
        time,
        {"kinetic": float(ledger["kinetic"][row]), **stored, **flows},
        pressures,
        _fractions(states, films, time),
        errors,
        {
            name.removeprefix(LOST): float(ledger[name][row])
            for name in ledger
            if name.startswith(LOST)
        },
    )


def _fractions(states: Tables, films: Sequence[str], time: float) -> list[Array]:
    """Fractions (slack, wrinkled, taut) of the first film."""
    if not states or not films:
        return []
    shares = np.zeros(len(STATES))
    for name in ("taut", "wrinkled"):
        shares[STATES[name]] = _at(states, f"{films[0]} {name}", time)
    shares[STATES["slack"]] = 1 - shares.sum()
    return [shares]


def _at(table: Tables, name: str, time: float) -> float:
    return float(np.interp(time, table["time"], table[name]))


def _work(t: Array, ledger: Tables, axes: Axes) -> None:
    axes.plot(t, ledger["iterations"], color=LINES[0], linewidth=0.8)
    axes.set_ylim(bottom=0)
    axes.set_title("Newton iterations of a step")


def grouped(probes: Tables) -> dict[str, Tables]:
    """Curves of one panel by their last words, by title: "tip x [m]" and "tip y [m]" are x and y of "tip [m]"."""
    panels: dict[str, Tables] = {}
    for name, values in probes.items():
        if name not in ("time", "step"):
            parts = _PART.fullmatch(name)
            title, curve = (parts[1] + parts[3], parts[2]) if parts else (name, "")
            panels.setdefault(title, {})[curve] = values
    return panels


def _probes(t: Array, title: str, curves: Tables, axes: Axes) -> None:
    colours = dict(zip(curves, cycle(LINES), strict=False))
    for name, values in curves.items():
        axes.plot(t, values, color=colours[name])
    axes.set_title(title)
    label_ends(
        axes, {name: (float(values[-1]), colours[name]) for name, values in curves.items() if name}
    )
