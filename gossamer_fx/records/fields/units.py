"""Units of output fields, and prefixes of units."""

from __future__ import annotations

import numpy as np

from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.view import Axis

# Unit of each field; fields that are missing are pure numbers.
UNITS = {
    "displacement": "m",
    "velocity": "m/s",
    "curvature1": "1/m",
    "curvature2": "1/m",
    "moment1": "N m/m",
    "moment2": "N m/m",
    "fold_angle": "rad",
    "strain1": "",
    "strain2": "",
    "elastic_strain1": "",
    "elastic_strain2": "",
    "stress1": "Pa",
    "stress2": "Pa",
    "tension": "N",
    "axial_strain": "",
    "pressure": "Pa",
    "mode_amplitude": "m",
    "wrinkle_amplitude": "m",
    "contact_pressure": "Pa",
}

# Fields that cables and beams have, and films do not.
LINE_FIELDS = ("tension", "axial_strain")

_PREFIXES = {1e-9: "n", 1e-6: "µ", 1e-3: "m", 1.0: "", 1e3: "k", 1e6: "M", 1e9: "G"}
_ROUND_OFF = 1e-9  # of a factor: 0.9999999999 is written as 1, not as 1000 of the smaller unit


def with_unit(field: str) -> str:
    """Name of a field with its unit, e.g. "stress1 [Pa]"; pure numbers have their name only."""
    unit = UNITS.get(field, "")
    if unit:
        return f"{field} [{unit}]"
    return field


def scaled(largest: float) -> tuple[float, str]:
    """Return factor and prefix of the unit in which a number lies between 1 and 1000.

    Example:
        `scaled(0.02)` is `(1e-3, "m")`: 0.02 s are 20 ms.
    """
    fitting = [factor for factor in _PREFIXES if factor <= largest * (1 + _ROUND_OFF)]
    factor = max(fitting, default=1.0)
    return factor, _PREFIXES[factor]


def scaled_axis(axis: Axis, values: Array) -> tuple[float, str]:
    """Factor and unit of the axis of a figure that has these values; a pure number stays."""
    if not axis.unit:
        return 1.0, ""
    factor, prefix = scaled(float(np.abs(values).max(initial=0.0)))
    return factor, f"{prefix}{axis.unit}"


def energy_words(energy: float) -> str:
    """An energy with its unit, e.g. "17.2 kJ"."""
    factor, prefix = scaled(abs(energy))
    return f"{energy / factor:.3g} {prefix}J"
