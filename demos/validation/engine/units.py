"""Units of the quantities in case files, each with its dimension and its size in SI units."""

from __future__ import annotations

import math

from gossamer_fx.checks.errors import check

# Unit: (SI unit of the same dimension, its size in that unit).
UNITS = {
    "1": ("1", 1.0),
    "%": ("1", 1e-2),
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180),
    "m": ("m", 1.0),
    "mm": ("m", 1e-3),
    "um": ("m", 1e-6),
    "in": ("m", 25.4e-3),
    "s": ("s", 1.0),
    "kg": ("kg", 1.0),
    "g": ("kg", 1e-3),
    "kg/m": ("kg/m", 1.0),
    "kg/m2": ("kg/m2", 1.0),
    "g/m2": ("kg/m2", 1e-3),
    "kg/m3": ("kg/m3", 1.0),
    "m/s2": ("m/s2", 1.0),
    "N": ("N", 1.0),
    "kN": ("N", 1e3),
    "lbf": ("N", 4.4482216152605),
    "N m": ("N m", 1.0),
    "N mm": ("N m", 1e-3),
    "N/m": ("N/m", 1.0),
    "kN/m": ("N/m", 1e3),
    "N/rad": ("N/rad", 1.0),
    "Pa": ("Pa", 1.0),
    "kPa": ("Pa", 1e3),
    "MPa": ("Pa", 1e6),
    "GPa": ("Pa", 1e9),
    "bar": ("Pa", 1e5),
    "psi": ("Pa", 6894.757293168361),
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
