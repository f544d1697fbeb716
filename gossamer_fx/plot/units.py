"""Names and units of fields in pictures, and prefixes of units."""

from __future__ import annotations

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
    "mode_amplitude": "m",
}
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
    "state": "State of the film",
    "mode_amplitude": "Amplitude of the mode",
    "group": "Parts of the films",
}
_PREFIXES = {1e-9: "n", 1e-6: "µ", 1e-3: "m", 1.0: "", 1e3: "k", 1e6: "M", 1e9: "G"}
_ROUND_OFF = 1e-9  # of a factor: 0.9999999999 is written as 1, not as 1000 of the smaller unit


def scaled(largest: float) -> tuple[float, str]:
    """Factor and prefix of the unit in which a number lies between 1 and 1000.

    Example:
        `scaled(0.02)` is `(1e-3, "m")`: 0.02 s are 20 ms.
    """
    fitting = [factor for factor in _PREFIXES if factor <= largest * (1 + _ROUND_OFF)]
    factor = max(fitting, default=1.0)
    return factor, _PREFIXES[factor]


def plain_text(text: str) -> str:
    """A name for matplotlib: its dollar signs begin no formula, and characters that have no picture are replaced."""
    shown = "".join(c if c.isprintable() else "\ufffd" for c in text)
    return shown.replace("$", r"\$")
