"""Units of the quantities in case files, each with its dimension and its size in SI units."""

from __future__ import annotations

from gossamer_fx.core.checks.errors import check
from gossamer_fx.records.plot.measured_series import unit_factor

# The units of case files, divided by commas, by the SI unit of the same dimension.
DIMENSIONS = {
    "1": "1, %",
    "rad": "rad, deg",
    "rad/s": "rad/s, rpm",
    "m2": "m2",
    "m": "m, mm, um, in",
    "m3": "m3, cm3",
    "m3/s": "m3/s, cm3/s",
    "s": "s",
    "1/s": "1/s",
    "m/s": "m/s, mm/s",
    "kg": "kg, g",
    "kg/m": "kg/m",
    "kg m2": "kg m2",
    "kg/m2": "kg/m2, g/m2",
    "kg/m3": "kg/m3",
    "m/s2": "m/s2",
    "N": "N, kN, lbf",
    "N m": "N m, N mm",
    "N m2": "N m2",
    "N/m": "N/m, kN/m",
    "N/rad": "N/rad",
    "N s/m": "N s/m",
    "Pa": "Pa, kPa, MPa, GPa, bar, psi",
    "K": "K",
    "W/K": "W/K",
}


def _plain(unit: str) -> str:
    """A unit as `unit_factor` reads it: powers are raised."""
    return unit.replace("2", "²").replace("3", "³")


# Unit: (SI unit of the same dimension, its size in that unit).
UNITS = {
    unit: (si_unit, unit_factor(_plain(unit), _plain(si_unit), unit))
    for si_unit, units in DIMENSIONS.items()
    for unit in units.split(", ")
}


def conversion_factor(unit: str, wanted: str, where: str) -> float:
    """Factor from a unit of a case file to another unit of the same dimension.

    Args:
        unit: as the file has it.
        wanted: unit that the caller needs.
        where: what it is the unit of, for the message.

    Raises:
        InputError: a unit that is not in `UNITS`, or of another dimension.

    Example:
        >>> round(conversion_factor("kPa", "Pa", "pressure"))
        1000
    """
    check(unit in UNITS, f"{where}: unit is '{unit}'; give one of {', '.join(UNITS)}.")
    dimension, size = UNITS[unit]
    wanted_dimension, wanted_size = UNITS[wanted]
    check(
        dimension == wanted_dimension,
        f"{where}: unit is '{unit}'; give one of the dimension of '{wanted}'.",
    )
    return size / wanted_size
