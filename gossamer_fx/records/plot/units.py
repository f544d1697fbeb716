"""Names and units of fields in pictures, and prefixes of units."""

from __future__ import annotations

import math
import re

from gossamer_fx.core.checks.errors import check
from gossamer_fx.records.fields.units import UNITS as UNITS
from gossamer_fx.records.fields.units import scaled as scaled

NAMES = {
    "displacement": "Displacement",
    "velocity": "Speed",
    "tension": "Tension",
    "axial_strain": "Axial strain",
    "curvature1": "Larger principal curvature",
    "curvature2": "Smaller principal curvature",
    "moment1": "Larger bending moment",
    "moment2": "Smaller bending moment",
    "fold_angle": "Fold angle at creases",
    "strain1": "Larger principal strain",
    "strain2": "Smaller principal strain",
    "elastic_strain1": "Larger principal elastic strain",
    "elastic_strain2": "Smaller principal elastic strain",
    "stress1": "Larger principal stress",
    "stress2": "Smaller principal stress",
    "pressure": "Pressure inside over outside",
    "contact_pressure": "Contact pressure",
    "state": "State of the film",
    "mode_amplitude": "Amplitude of the mode",
    "wrinkle_slope": "Slope of the wrinkles",
    "wrinkle_amplitude": "Amplitude of the wrinkles",
    "wrinkle_direction": "Direction of the wrinkles",
    "group": "Parts of the films",
}


def plain_text(text: str) -> str:
    """A name for matplotlib: its dollar signs begin no formula, and characters that have no picture
    are replaced."""
    shown = "".join(c if c.isprintable() else "\ufffd" for c in text)
    return shown.replace("$", r"\$")


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
        elif name not in _PREFIXABLE and name[0] in _PREFIX_SIZES and name[1:] in _PREFIXABLE:
            base, factor = name[1:], _PREFIX_SIZES[name[0]]
        else:
            base, factor = name, 1.0
        size *= factor**power
        # Of a converted unit that is a quotient, as rad/s, the second one is in the denominator.
        for direction, part in zip((1, -1), base.split("/"), strict=False):
            if part != "1":
                powers[part] = powers.get(part, 0) + direction * power
    return {name: power for name, power in powers.items() if power}, size
