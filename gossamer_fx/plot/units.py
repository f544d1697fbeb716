"""Names and units of fields in pictures, and prefixes of units."""

from __future__ import annotations

from gossamer_fx.fields.units import UNITS as UNITS
from gossamer_fx.fields.units import scaled as scaled

NAMES = {
    "displacement": "Displacement",
    "velocity": "Speed",
    "curvature1": "Larger principal curvature",
    "curvature2": "Smaller principal curvature",
    "moment1": "Larger bending moment",
    "moment2": "Smaller bending moment",
    "fold_angle": "Fold angle at creases",
    "strain1": "Larger principal strain",
    "strain2": "Smaller principal strain",
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
    """A name for matplotlib: its dollar signs begin no formula, and characters that have no picture are replaced."""
    shown = "".join(c if c.isprintable() else "\ufffd" for c in text)
    return shown.replace("$", r"\$")
