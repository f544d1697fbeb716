"""Colours of numbers: scales that any colour vision can read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gossamer_fx.model.body import Array
from gossamer_fx.plot.curve_panels import scaled
from gossamer_fx.plot.view import Integers

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
}
_BINS = 128
_MINOR = 0.05  # of the larger sign: what is smaller does not matter
_TAILS = 0.5  # % of the values beyond either end of a scale, so that single cells do not decide it


@dataclass(frozen=True)
class Scale:
    """Colours from `low` to `high`; round zero from blue over light to red if both signs matter, else viridis."""

    name: str
    unit: str
    low: float
    high: float

    @property
    def signed(self) -> bool:
        return self.low < 0 < self.high

    @property
    def table(self) -> Array:
        """Colours (bins, 3)."""
        from matplotlib import colormaps

        along = np.linspace(0, 1, _BINS)
        colours: Array = (
            colormaps["RdYlBu_r"](along)[:, :3]
            if self.signed
            else colormaps["viridis"](along)[:, :3]
        )
        return colours

    def bins(self, values: Array) -> Integers:
        """Rows of the table."""
        width = self.high - self.low
        part = (values - self.low) / width if width > 0 else np.zeros_like(values)
        found: Integers = np.rint(part.clip(0, 1) * (_BINS - 1)).astype(np.int64)
        return found

    @property
    def label(self) -> tuple[float, str]:
        """Factor of the unit in which the numbers are written, and the label with it."""
        largest = max(abs(self.low), abs(self.high))
        if not self.unit:
            return 1e-3, f"{self.name} [10⁻³]"
        factor, prefix = scaled(largest)
        return factor, f"{self.name} [{prefix}{self.unit}]"


def scale(field: str, samples: Sequence[Array]) -> Scale:
    """The scale on which the samples of a field are seen best; symmetric if both signs matter."""
    values = np.concatenate([np.zeros(0), *samples])
    values = values[np.isfinite(values)]
    low, high = np.percentile(values, [_TAILS, 100 - _TAILS]) if values.size else (0.0, 0.0)
    larger = max(abs(low), abs(high))
    if low < -_MINOR * larger and high > _MINOR * larger:
        low, high = -larger, larger
    else:
        low, high = (0.0, high) if high > -low else (low, 0.0)
    return Scale(NAMES.get(field, field), UNITS.get(field, ""), float(low), float(high))
