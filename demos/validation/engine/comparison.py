"""Predicted and measured values of a quantity, and the error between them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from demos.validation.engine.case import Array, Case, Measured, Test
from demos.validation.engine.units import UNITS
from gossamer_fx.extend import Result

# Digits of stored numbers: more only make files larger.
DIGITS = 7

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
        """Errors (n,), relative to the reference of the case or else to each measured value."""
        sizes = np.abs(self.y_measured)
        if math.isfinite(self.measured.reference):
            sizes = np.full(len(sizes), self.measured.reference)
        return (self.y_predicted - self.y_measured) / sizes

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
    def error(self) -> float:
        """The mean error of which the case asks something, with its sign or without."""
        return self.mean_error if self.measured.is_mean_of_sizes else self.bias

    def is_accepted(self, quick: bool = False) -> bool:
        """Whether the error is within what the case asks of the full or the quick form."""
        low, high = self.measured.quick_accepted if quick else self.measured.accepted
        return low <= self.error <= high

    @property
    def middle(self) -> int:
        """Index of the value that tables show: the middle of the range of a curve, or the largest
        value where errors are relative to a reference, as curves may be zero in the middle."""
        if math.isfinite(self.measured.reference):
            return int(np.abs(self.y_measured).argmax())
        return len(self.y_measured) // 2


def compare(measured: Measured, predicted: Predicted | None) -> Comparison:
    """Compare a measured quantity with a prediction, which is None if there is none."""
    x: Array | None = None
    y_measured = measured.y
    y_predicted = np.full(len(y_measured), math.nan)
    if measured.x is not None:
        x = np.linspace(*measured.x_range, COMPARED_POINTS)
        y_measured = np.interp(x, measured.x, measured.y)
        y_predicted = np.full(len(x), math.nan)
    if predicted is None:
        return Comparison(measured, x, y_measured, y_predicted)
    y = np.atleast_1d(np.asarray(predicted.y, dtype=float)) / UNITS[measured.unit][1]
    if x is not None:
        own_x = np.asarray(predicted.x, dtype=float) / UNITS[measured.x_unit][1]
        # A prediction that ends before the range does is not extended.
        y_predicted = np.interp(x, own_x, y, left=math.nan, right=math.nan)
    elif y.shape == y_measured.shape:
        y_predicted = y
    return Comparison(measured, x, y_measured, y_predicted)


# ---- results of cases ----------------------------------------------------------------------------


def numbers_of(prediction: Prediction) -> dict[str, float | list[float]]:
    """The numbers of a prediction as the engine of cases keeps them: "y of NAME", "x of NAME" and
    the details by their names."""
    numbers: dict[str, float | list[float]] = {}
    for name, found in prediction.quantities.items():
        numbers[f"y of {name}"] = [_rounded(value) for value in np.atleast_1d(found.y)]
        if found.x is not None:
            numbers[f"x of {name}"] = [_rounded(value) for value in np.atleast_1d(found.x)]
    return numbers | {name: _rounded(value) for name, value in prediction.details.items()}


def predicted_in(result: Result, quantity: str) -> Predicted | None:
    """A quantity of a result; None if it was not predicted."""
    if f"y of {quantity}" not in result.numbers:
        return None
    x = result.numbers.get(f"x of {quantity}")
    return Predicted(
        y=np.array(result.numbers[f"y of {quantity}"]),
        x=None if x is None else np.array(x),
    )


def comparisons(test: Test, result: Result) -> list[Comparison]:
    """Comparisons of the measured quantities of a test with the prediction of a result."""
    return [compare(item, predicted_in(result, item.quantity)) for item in test.measured]


def with_measured(case: Case, results: Sequence[Result]) -> list[Result]:
    """Results with the measured values that they are compared with, as they are stored: so that a
    changed measured value is noticed."""
    tests = {test.name: test for test in case.tests}
    return [
        replace(
            result,
            numbers={
                **result.numbers,
                **{
                    f"measured {one.quantity}": [_rounded(value) for value in one.y]
                    for one in tests[result.values["test"]].measured
                },
            },
        )
        for result in results
    ]


def compared_numbers(result: Result) -> list[str]:
    """Names of the numbers of a stored result that are compared with those of a later one."""
    return [name for name in result.numbers if name.startswith(("y of ", "measured "))]


def results_by_test(case: Case, results: Sequence[Result]) -> Iterator[tuple[Test, Result]]:
    """The tests that have a result, in the order of the case."""
    by_name = {result.values["test"]: result for result in results}
    for test in case.tests:
        if test.name in by_name:
            yield test, by_name[test.name]


def _rounded(value: float) -> float:
    return float(f"{float(value):.{DIGITS}g}")
