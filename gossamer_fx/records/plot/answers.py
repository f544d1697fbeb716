"""The answers of a recorded run, for its report: what a reader asks first, before balances.

The recording may come from a stranger: names and numbers are as they stand in its files.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from gossamer_fx.core.model.body import Array
from gossamer_fx.records.fields.units import with_unit, without_round_off
from gossamer_fx.records.plot.run_reader import RunReader
from gossamer_fx.records.plot.run_tables import RunTables
from gossamer_fx.records.probes.points import GAS_UNITS, GasQuantity

_HEAD = ("", "at the end", "least over the run", "largest over the run")
_HEAD_OF_ONE_STATE = ("", "value")

# Fields whose numbers stand for kinds of states and for groups.
_NO_AMOUNTS = ("state", "group")

# Quantities of gas in the table, in this order; masses and flows are in the curves.
_GAS: tuple[GasQuantity, ...] = ("pressure", "temperature", "volume")

# How columns of the ledger begin, and their units.
_LEDGER_UNITS = {
    "kinetic": "J",
    "stored": "J",
    "supplied": "J",
    "dissipated": "J",
    "angular momentum": "kg m²/s",
    "momentum": "kg m/s",
    "gas mass": "kg",
}

# A sum that should vanish is round-off below this share of its parts.
_ROUND_OFF = 1e-12


def answers(run: RunReader) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows of a table: the largest value of each recorded field on each body, the gas of
    each chamber, shares of films that are taut and wrinkled, the probes of the user, and the
    frequencies of the modes that a `StaticCase` has recorded.  Extremes over the run only if it has
    several states."""
    rows = list(_answers(run))
    # Probes may have more states than fields.
    changes = any(row[2] and len(set(row[1:])) > 1 for row in rows)
    if changes or len(run.times) > 1:
        return _HEAD, list(rows)
    return _HEAD_OF_ONE_STATE, [row[:2] for row in rows]


def _answers(run: RunReader) -> Iterator[tuple[str, str, str, str]]:
    """The rows, with extremes over the run."""
    for name, fields in run.fields.items():
        for field in fields:
            if field not in _NO_AMOUNTS and run.has_field(name, field):
                segment, step = run.bodies[name].at(len(run.times) - 1)
                values = segment.at_corners(field, step)
                yield from _of_field(name, field, values[np.isfinite(values)])
    gas = run.table("gas.csv")
    for quantity in _GAS:
        columns = ((c, v) for c, v in gas.items() if c.endswith(f" {quantity}"))
        yield from _of_columns((f"{c} [{GAS_UNITS[quantity]}]", v) for c, v in columns)
    for table in ("states.csv", "probes.csv"):
        found = {c: v for c, v in run.table(table).items() if c not in run.not_values}
        yield from _of_columns(without_round_off(found).items())
    for number, frequency in sorted(_frequencies(run.folder)):
        yield f"frequency {number} [Hz]", f"{frequency:.4g}", "", ""


def _frequencies(folder: Path) -> Iterator[tuple[int, float]]:
    """Numbers and frequencies [Hz] of the modes that were recorded next to an equilibrium.

    Raises:
        InputError: the file of a mode cannot be read.
    """
    for one in (folder / "modes").glob("mode_*"):
        # A link may lead out of the folder, which a stranger may have sent.
        if one.is_symlink() or one.parent.is_symlink():
            continue
        result = RunTables(one).about.get("result", {})
        number = result.get("mode")
        frequency = result.get("frequency [Hz]")
        # A file that somebody changed may have other things there.
        if isinstance(number, int) and isinstance(frequency, float):
            yield number, frequency


def _of_field(body: str, field: str, values: Array) -> Iterator[tuple[str, str, str, str]]:
    """The value of a field on a body that is farthest from zero, in the last record."""
    if values.size:
        extreme = float(values.flat[int(abs(values).argmax())])
        which = "largest" if extreme >= 0 else "least"
        yield f"{which} {with_unit(field)} of {body}", f"{extreme:.4g}", "", ""


def _of_columns(columns: Iterable[tuple[str, Array]]) -> Iterator[tuple[str, str, str, str]]:
    """Last, least and largest value of each column that has one."""
    for name, values in columns:
        known = values[np.isfinite(values)]
        if len(known):
            last = f"{values[-1]:.4g}"
            yield name, last, f"{known.min():.4g}", f"{known.max():.4g}"


def ledger_unit(column: str) -> str:
    """Unit of a column of the ledger; empty for errors, which are relative."""
    return next((u for name, u in _LEDGER_UNITS.items() if column.startswith(name)), "")


def is_round_off(column: str, run: RunReader, ledger: Mapping[str, Array]) -> bool:
    """Whether a column of the ledger is the round-off of a sum that vanishes, such as the momentum
    of a film that is blown up: a reader would take it for a result."""
    unit = ledger_unit(column)
    if unit not in ("J", "kg m/s", "kg m²/s"):
        return False
    energies = [v for c, v in ledger.items() if ledger_unit(c) == "J"]
    scale = max((float(abs(v).max(initial=0.0)) for v in energies), default=0.0)
    if unit != "J":
        bodies = run.about["scene"]["bodies"].values()
        mass = sum(float(body.get("mass", 0.0)) for body in bodies)
        kinetic = float(np.max(ledger.get("kinetic", np.zeros(1)), initial=0.0))
        # The momentum if all of the mass had this energy.
        scale = float(np.sqrt(2 * max(mass * kinetic, 0.0)))
    if unit == "kg m²/s":
        boxes = [np.array(body["box"], dtype=float) for body in bodies if "box" in body]
        scale *= max((float(abs(box).max(initial=0.0)) for box in boxes), default=1.0)
    return bool(abs(ledger[column]).max(initial=0.0) <= _ROUND_OFF * scale)
