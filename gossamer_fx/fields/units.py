"""Units of output fields."""

from __future__ import annotations

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
    "stress1": "Pa",
    "stress2": "Pa",
    "pressure": "Pa",
    "contact_pressure": "Pa",
}


def with_unit(field: str) -> str:
    """Name of a field with its unit, e.g. "stress1 [Pa]"; pure numbers have their name only."""
    unit = UNITS.get(field, "")
    if unit:
        return f"{field} [{unit}]"
    return field


def without_unit(name: str) -> str:
    """Name of a field from its name with the unit."""
    return name.partition(" [")[0]
