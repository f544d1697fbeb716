"""Units and names of output fields, and prefixes of units."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.view import Axis

# Name in pictures and unit of each field; pure numbers have no unit.
_FIELDS = {
    "displacement": ("Displacement", "m"),
    "velocity": ("Speed", "m/s"),
    "curvature1": ("Larger principal curvature", "1/m"),
    "curvature2": ("Smaller principal curvature", "1/m"),
    "moment1": ("Larger bending moment", "N m/m"),
    "moment2": ("Smaller bending moment", "N m/m"),
    "fold_angle": ("Fold angle at creases", "rad"),
    "strain1": ("Larger principal strain", ""),
    "strain2": ("Smaller principal strain", ""),
    "elastic_strain1": ("Larger principal elastic strain", ""),
    "elastic_strain2": ("Smaller principal elastic strain", ""),
    "stress1": ("Larger principal stress (Cauchy)", "Pa"),
    "stress2": ("Smaller principal stress (Cauchy)", "Pa"),
    "von_mises_stress": ("Von Mises stress (Cauchy)", "Pa"),
    "second_piola_stress1": ("Larger principal stress (second Piola-Kirchhoff)", "Pa"),
    "second_piola_stress2": ("Smaller principal stress (second Piola-Kirchhoff)", "Pa"),
    "tension": ("Tension", "N"),
    "axial_strain": ("Axial strain", ""),
    "pressure": ("Pressure inside over outside", "Pa"),
    "temperature": ("Temperature", "K"),
    "mode_amplitude": ("Amplitude of the mode (arbitrary scale)", "m"),
    "wrinkle_amplitude": ("Amplitude of the wrinkles", "m"),
    "contact_pressure": ("Contact pressure", "Pa"),
    "state": ("State of the film", ""),
    "wrinkle_slope": ("Slope of the wrinkles", ""),
    "wrinkle_direction": ("Direction of the wrinkles", ""),
    "group": ("Parts of the films", ""),
}
# Vectors, of which pictures show the length or one component, e.g. "displacement_z".
VECTOR_FIELDS = ("displacement", "velocity", "mode_amplitude")
# Components by the end of their names; the normal is that of the deformed film.
COMPONENTS = {
    "x": "along x",
    "y": "along y",
    "z": "along z",
    "normal": "along the normal of the film",
}
_OF_COMPONENTS = {
    f"{vector}_{component}": (
        f"{vector.replace('_', ' ').capitalize()} {words}",
        _FIELDS[vector][1],
    )
    for vector in VECTOR_FIELDS
    for component, words in COMPONENTS.items()
}
# A number is round-off below this share of the largest one with its unit.
ROUND_OFF = 1e-12

NAMES = {field: name for field, (name, _) in (_FIELDS | _OF_COMPONENTS).items()}
UNITS = {field: unit for field, (_, unit) in (_FIELDS | _OF_COMPONENTS).items()}

# Fields that cables and beams have, and films do not.
LINE_FIELDS = ("tension", "axial_strain")

_PREFIXES = {1e-9: "n", 1e-6: "µ", 1e-3: "m", 1.0: "", 1e3: "k", 1e6: "M", 1e9: "G"}
# A unit whose first factor is not squared or cubed, as mm² is the square of a mm, and not a kg.
_TAKES_PREFIX = re.compile(r"(?!kg)[^\W\d²³⁴]+(?![²³⁴^\d])(?=\W|$)")
_EXPONENT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PLAIN_NUMBERS = (1e-2, 1e4)  # between which pure numbers are written as they are
_ROUND_OFF = 1e-9  # of a factor: 0.9999999999 is written as 1, not as 1000 of the smaller unit


def split_component(field: str) -> tuple[str, str]:
    """The recorded field and the component that a name asks for, which is empty for the field
    itself.

    Example:
        `split_component("displacement_z")` is `("displacement", "z")`, `split_component("stress1")`
        is `("stress1", "")`.
    """
    if field in _OF_COMPONENTS:
        vector, _, component = field.rpartition("_")
        return vector, component
    return field, ""


def with_unit(field: str) -> str:
    """Name of a field with its unit, e.g. "stress1 [Pa]"; pure numbers have their name only."""
    unit = UNITS.get(field, "")
    if unit:
        return f"{field} [{unit}]"
    return field


def scaled(largest: float) -> tuple[float, str]:
    """Return factor and prefix of the unit in which a number lies between 1 and 1000; (1.0, "") for
    a number below 1e-9.

    Example:
        `scaled(0.02)` is `(1e-3, "m")`: 0.02 s are 20 ms.
    """
    fitting = [factor for factor in _PREFIXES if factor <= largest * (1 + _ROUND_OFF)]
    factor = max(fitting, default=1.0)
    return factor, _PREFIXES[factor]


def scaled_unit(largest: float, unit: str) -> tuple[float, str]:
    """Factor and name of the multiple of a unit in which a number lies between 1 and 1000.

    Units that take no prefix, such as kg m²/s, 1/m or m³, have a power of ten, and so have small
    and large pure numbers.

    Example:
        `scaled_unit(0.02, "m")` is `(1e-3, "mm")`, `scaled_unit(0.02, "kg m/s")` is
        `(1e-3, "10⁻³ kg m/s")`.
    """
    if not unit and _PLAIN_NUMBERS[0] <= largest < _PLAIN_NUMBERS[1]:
        return 1.0, ""
    factor, prefix = scaled(largest)
    if not prefix:
        return 1.0, unit
    if _TAKES_PREFIX.match(unit):
        return factor, f"{prefix}{unit}"
    power = str(round(math.log10(factor))).translate(_EXPONENT)
    return factor, f"10{power} {unit}".rstrip()


def scaled_axis(axis: Axis, values: Array) -> tuple[float, str]:
    """Factor and unit of the axis of a figure that has these values; 1 and "" of pure numbers."""
    if not axis.unit:
        return 1.0, ""
    factor, prefix = scaled(float(np.abs(values).max(initial=0.0)))
    return factor, f"{prefix}{axis.unit}"


def with_decimals(value: float) -> str:
    """A number with four digits, also if the last ones are zeros, e.g. "15.00"."""
    if abs(value) >= 1000:
        return f"{value:.0f}"
    return f"{value:#.4g}"


def energy_words(energy: float) -> str:
    """An energy with its unit, e.g. "17.2 kJ"."""
    factor, prefix = scaled(abs(energy))
    return f"{energy / factor:.3g} {prefix}J"


# ---- in pictures ---------------------------------------------------------------------------------


def plain_text(text: str) -> str:
    """A name for matplotlib: its dollar signs begin no formula, and characters that have no picture
    are replaced."""
    # Python does not count the space at which no line is broken as printable.
    shown = "".join(c if c.isprintable() or c == "\u00a0" else "\ufffd" for c in text)
    return shown.replace("$", r"\$")


def without_round_off(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers, or arrays of them, by names with their units in brackets, e.g. "foot moment x [N
    m]", in which zero stands for round-off: for what is below `ROUND_OFF` of the largest number of
    the unit.  Forces count as moments at an arm of 1 m, since a hinge has no moment but
    round-off."""
    largest: dict[str, float] = {}
    units = {name: _unit_of(name) for name in numbers}
    for name, values in numbers.items():
        known = np.abs(np.atleast_1d(values))
        size = float(known[np.isfinite(known)].max(initial=0.0))
        largest[units[name]] = max(largest.get(units[name], 0.0), size)
    if "N m" in largest:
        largest["N m"] = max(largest["N m"], largest.get("N", 0.0))
    found: dict[str, Any] = {}
    for name, values in numbers.items():
        unit = units[name]
        is_small = np.abs(values) < ROUND_OFF * largest[unit]
        if not (unit and np.any(is_small)):
            found[name] = values
        elif np.ndim(values):
            found[name] = np.where(is_small, 0.0, values)
        else:
            found[name] = 0.0
    return found


def _unit_of(name: str) -> str:
    """The unit in the last brackets of a name; empty without one."""
    units = re.findall(r"\[([^\[\]]*)\]", name)
    return str(units[-1]) if units else ""
