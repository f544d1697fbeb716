"""Units of the quantities in case files, each with its dimension and its size in SI units."""

from __future__ import annotations

import math

from gossamer_fx.extend import check

# Units of case files by the SI unit of the same dimension, each with its size in that unit.
DIMENSIONS: dict[str, dict[str, float]] = {
    "1": {"1": 1.0, "%": 1e-2},
    "rad": {"rad": 1.0, "deg": math.pi / 180},
    "rad/s": {"rad/s": 1.0, "rpm": math.pi / 30},
    "m2": {"m2": 1.0},
    "m": {"m": 1.0, "mm": 1e-3, "um": 1e-6, "in": 0.0254},
    "m3": {"m3": 1.0, "cm3": 1e-6},
    "m3/s": {"m3/s": 1.0, "cm3/s": 1e-6},
    "s": {"s": 1.0},
    "1/s": {"1/s": 1.0, "Hz": 1.0},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3},
    "kg": {"kg": 1.0, "g": 1e-3},
    "kg/m": {"kg/m": 1.0},
    "kg m2": {"kg m2": 1.0},
    "kg/m2": {"kg/m2": 1.0, "g/m2": 1e-3},
    "kg/m3": {"kg/m3": 1.0},
    "m/s2": {"m/s2": 1.0},
    "N": {"N": 1.0, "kN": 1e3, "lbf": 4.4482216152605},
    "N m": {"N m": 1.0, "N mm": 1e-3},
    "N m2": {"N m2": 1.0},
    "N/m": {"N/m": 1.0, "kN/m": 1e3},
    "N/rad": {"N/rad": 1.0},
    "N s/m": {"N s/m": 1.0},
    "Pa": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "bar": 1e5, "psi": 6894.757293168361},
    "K": {"K": 1.0},
    "1/Pa": {"1/Pa": 1.0, "1/MPa": 1e-6},
    "J/mol": {"J/mol": 1.0, "kJ/mol": 1e3},
    "m3/mol": {"m3/mol": 1.0},
    "W/K": {"W/K": 1.0},
    "W/(m2 K)": {"W/(m2 K)": 1.0},
    "J/(kg K)": {"J/(kg K)": 1.0},
}

# Unit: (SI unit of the same dimension, its size in that unit).
UNITS = {
    unit: (si_unit, size) for si_unit, units in DIMENSIONS.items() for unit, size in units.items()
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
