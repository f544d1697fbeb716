"""Predicted and measured values of a quantity, and the error between them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from demos.validation.engine.case import Array, Measured
from demos.validation.engine.units import UNITS

# Points of the abscissa at which curves are compared, evenly spaced over the range.
COMPARED_POINTS = 101


@dataclass(frozen=True)
class Predicted:
    """A predicted quantity in SI units.

    Args:
        y: values (n,), or one number.
        x: abscissae (n,) of a curve, rising.
    """

    y: Array | float
    x: Array | None = None


@dataclass(frozen=True)
class Prediction:
    """What a model predicts for one test.

    Args:
        quantities: by name, as the case file has them.
        details: further numbers for the report, e.g. unknowns, by name; "seconds" is the run time.
    """

    quantities: Mapping[str, Predicted]
    details: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Comparison:
    """Predicted and measured values at the same points, in the units of the case file.

    Attributes:
        measured: the quantity.
        x: where curves are compared, else None.
        y_measured, y_predicted: (n,); not a number where the prediction ends before.
    """

    measured: Measured
    x: Array | None
    y_measured: Array
    y_predicted: Array

    @property
    def errors(self) -> Array:
        """Relative errors (n,)."""
        return (self.y_predicted - self.y_measured) / np.abs(self.y_measured)

    @property
    def mean_error(self) -> float:
        """Mean of the sizes of the relative errors; infinite if values are missing."""
        mean = float(np.abs(self.errors).mean())
        return math.inf if math.isnan(mean) else mean

    @property
    def bias(self) -> float:
        """Mean of the relative errors with their signs."""
        return float(self.errors.mean())

    @property
    def is_accepted(self) -> bool:
        """Whether the error is within what the case asks."""
        low, high = self.measured.accepted
        error = self.mean_error if self.measured.is_mean_of_sizes else self.bias
        return low <= error <= high

    @property
    def middle(self) -> int:
        """Index of the value that tables show: the middle of the range of a curve."""
        return len(self.y_measured) // 2


def compare(measured: Measured, predicted: Mapping[str, Any] | None) -> Comparison:
    """Compare a measured quantity with a prediction.

    Args:
        measured: of the case.
        predicted: {"x": list or None, "y": list} in SI units, as results store it; None if there is
            none.
    """
    x: Array | None = None
    y_measured = measured.y
    y_predicted = np.full(len(y_measured), math.nan)
    if measured.x is not None:
        x = np.linspace(*measured.x_range, COMPARED_POINTS)
        y_measured = np.interp(x, measured.x, measured.y)
        y_predicted = np.full(len(x), math.nan)
    if predicted is None:
        return Comparison(measured, x, y_measured, y_predicted)
    size = UNITS[measured.unit][1]
    y = np.atleast_1d(np.asarray(predicted["y"], dtype=float)) / size
    if x is not None:
        own_x = np.asarray(predicted["x"], dtype=float) / UNITS[measured.x_unit][1]
        # A prediction that ends before the range does is not extended.
        y_predicted = np.interp(x, own_x, y, left=math.nan, right=math.nan)
    elif y.shape == y_measured.shape:
        y_predicted = y
    return Comparison(measured, x, y_measured, y_predicted)
