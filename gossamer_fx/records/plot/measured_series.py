"""Measured series from CSV files, converted to the units of a run's probes."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gossamer_fx.core.checks.csv_tables import csv_rows
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.model.body import Array
from gossamer_fx.records.plot.run_reader import RunReader

# "tip x [mm]": a name and a unit; the unit may be absent.
_HEADING = re.compile(r"\s*(.*?)\s*(?:\[([^]]*)\])?\s*")
# Probes that a message lists.
_LISTED = 8
# Rows of a file: the text is kept in memory while it is read.
_MAX_ROWS = 2_000_000


@dataclass(frozen=True)
class MeasuredSeries:
    """A measured quantity over the time.

    Attributes:
        label: of the legend, the name of the file without its ending.
        probe: name of the column of probes.csv that it is compared with.
        t: times (n,) [s].
        y: values (n,), in the unit of the probe.
    """

    label: str
    probe: str
    t: Array
    y: Array


def read_measured(path: str | Path, run: RunReader) -> list[MeasuredSeries]:
    """Series of a CSV file whose columns are named like probes of a run.

    The first row is the heading: "time [s]", or the load parameter of a path of equilibria, and
    names of probes with units, e.g. "tip x [mm]".
    Columns are separated by commas or semicolons.  An empty cell is a value that was not measured.
    """
    path = Path(path)
    headings, cells = _rows(path)
    probes = run.table("probes.csv")
    probe_units = {}
    for column in probes:
        name, unit = _parts(column)
        if column not in run.not_values:
            probe_units[name] = (column, unit)
    check(
        bool(probe_units),
        f"The run in '{run.folder}' recorded no probes; give its Recording some, to compare "
        f"'{path}' with.",
    )
    axis = run.axis
    times: Array | None = None
    columns = []
    for k, heading in enumerate(headings):
        name, unit = _parts(heading)
        values = np.array([row[k] for row in cells])
        if name in (axis.name, axis.symbol):
            check(times is None, f"'{path}' has two columns '{axis.name}'; leave one of them.")
            if unit is not None or axis.unit:
                where = f"'{path}', column '{heading}'"
                values *= unit_factor(unit or axis.unit, axis.unit or "1", where)
            times = values
            continue
        known = ", ".join(f"'{column}'" for column, _ in list(probe_units.values())[:_LISTED])
        check(
            name in probe_units,
            f"'{path}' has a column '{heading}', but the run has no such probe; name it like one "
            f"of {known}.",
        )
        column, probe_unit = probe_units[name]
        factor = 1.0
        if unit is not None or probe_unit:
            factor = unit_factor(unit or "1", probe_unit or "1", f"'{path}', column '{heading}'")
        columns.append((column, values * factor))
    if times is None:
        raise InputError(
            f"'{path}' has no column '{axis.name} [{axis.unit or 1}]'; add the {axis.name} of each "
            "row."
        )
    check(
        bool(columns),
        f"'{path}' has no column besides the {axis.name}; add one named like a probe.",
    )
    found = []
    for column, values in columns:
        given = np.isfinite(values) & np.isfinite(times)
        check(
            bool(given.any()),
            f"'{path}' has no value in the column for '{column}'; fill or remove it.",
        )
        found.append(MeasuredSeries(path.stem, column, times[given], values[given]))
    return found


def rms_difference(series: MeasuredSeries, times: Array, values: Array) -> float:
    """Root mean square of the values (n,) of a probe minus the measurement, over the measured times
    within those of the probe; NaN if there is none."""
    is_within = (series.t >= times[0]) & (series.t <= times[-1])
    if not is_within.any():
        return math.nan
    computed = np.interp(series.t[is_within], times, values)
    return float(np.sqrt(np.mean((computed - series.y[is_within]) ** 2)))


def _parts(heading: str) -> tuple[str, str | None]:
    """Name and unit of a heading; None if it has no unit."""
    match = _HEADING.fullmatch(heading)
    if match is None:
        return heading.strip(), None
    return match[1], match[2]


def _rows(path: Path) -> tuple[list[str], list[list[float]]]:
    """Headings and numbers of a CSV file; empty cells are NaN."""
    rows = csv_rows(path)
    check(
        len(rows) > 1,
        f"'{path}' has {len(rows)} rows; give a heading, such as 'time [s],tip x [m]', and values "
        "below it.",
    )
    check(len(rows) <= _MAX_ROWS, f"'{path}' has more than {_MAX_ROWS} rows; give fewer.")
    headings = rows[0]
    numbers = []
    for line, row in enumerate(rows[1:], start=2):
        check(
            len(row) == len(headings),
            f"'{path}', row {line} has {len(row)} cells and the heading {len(headings)}; give as "
            "many.",
        )
        numbers.append([_number(cell, path, line) for cell in row])
    return headings, numbers


def _number(cell: str, path: Path, line: int) -> float:
    """A finite number, or NaN for an empty cell."""
    if not cell.strip():
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    check(
        math.isfinite(value),
        f"'{path}', row {line}: '{cell.strip()[:40]}' is not a finite number; correct it, or leave "
        "the cell empty.",
    )
    return value


# ---- conversion of measured values ---------------------------------------------------------------

# Sizes of units without prefixes in those of SI.
_CONVERTED = {
    "min": ("s", 60.0),
    "h": ("s", 3600.0),
    "deg": ("rad", math.pi / 180),
    "°": ("rad", math.pi / 180),
    "rpm": ("rad/s", math.pi / 30),
    "in": ("m", 0.0254),
    "lbf": ("N", 4.4482216152605),
    "psi": ("Pa", 6894.757293168361),
    "bar": ("Pa", 1e5),
    "mbar": ("Pa", 1e2),
    "atm": ("Pa", 101325.0),
    "g": ("kg", 1e-3),
    "mg": ("kg", 1e-6),
    "t": ("kg", 1e3),
    "Hz": ("1/s", 1.0),
    "%": ("1", 1e-2),
}
_PREFIX_SIZES = {
    "n": 1e-9,
    "µ": 1e-6,
    "u": 1e-6,
    "m": 1e-3,
    "c": 1e-2,
    "k": 1e3,
    "M": 1e6,
    "G": 1e9,
}
_PREFIXABLE = ("m", "s", "N", "Pa", "J", "W", "rad", "K", "mol")
_POWERS = {"²": 2, "³": 3}


def unit_factor(unit: str, wanted: str, where: str) -> float:
    """Factor by which values in a unit are multiplied to get values in another one."""
    powers, size = _decomposed(unit)
    wanted_powers, wanted_size = _decomposed(wanted)
    check(
        powers == wanted_powers,
        f"{where}: the unit is '{unit}' and the probe's '{wanted}'; give values in a unit of the "
        "same dimension.",
    )
    return size / wanted_size


def _decomposed(unit: str) -> tuple[dict[str, int], float]:
    """Powers of the units of SI in a product of units, and its size in them."""
    powers: dict[str, int] = {}
    size = 1.0
    sign = 1
    for word in re.split(r"([ /])", unit.strip().replace("^2", "²").replace("^3", "³")):
        if word == "/":
            sign = -1
        if word in ("", " ", "/", "1"):
            continue
        power = sign * _POWERS.get(word[-1], 1)
        name = word.rstrip("²³").replace("μ", "µ")
        if name in _CONVERTED:
            base, factor = _CONVERTED[name]
        elif name not in _PREFIXABLE and name[:1] in _PREFIX_SIZES and name[1:] in _PREFIXABLE:
            base, factor = name[1:], _PREFIX_SIZES[name[0]]
        else:
            base, factor = name, 1.0
        size *= factor**power
        # Of a converted unit that is a quotient, as rad/s, the second one is in the denominator.
        for direction, part in zip((1, -1), base.split("/"), strict=False):
            if part != "1":
                powers[part] = powers.get(part, 0) + direction * power
    return {name: power for name, power in powers.items() if power}, size
