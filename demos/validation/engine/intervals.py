"""Intervals of predictions and of measured values, and what they say about a prediction.

A prediction y of the inputs x_i with the standard uncertainties u_i has to first order, for inputs
that are independent of each other, the standard uncertainty

    u² = Σ (∂y/∂x_i u_i)²                                                                       (1)

Its interval reaches 2 u to each side, and so does that of a measured value.  The difference m of
the prediction from that on another mesh, or with another step, is kept apart, and widens the
interval to each side to

    h = √((2u)² + m²)                                                                           (2)

A prediction is

    undetermined    if its interval, 2h, is wider than a fifth of the value
    right           if it is not, and the intervals overlap, at 95 % of the compared points or more
    wrong           if they do not

so that no prediction is right by the width of its interval.  The idea is that of ASME V&V 20:
inputs, numerics and measurement have uncertainties, and what a difference exceeds beyond them is an
error of the model.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from demos.validation.engine.case import Array, Case, Test, digest_of
from demos.validation.engine.comparison import Comparison
from gossamer_fx.extend import Result

# Half of an interval over the standard uncertainty: 95 % of a normal distribution.
COVERAGE = 2.0
# Widest interval of a prediction that is determined, over the value.
WIDEST = 0.2
# Share of the compared points at which intervals of a right prediction overlap: those of a correct
# one do not overlap at a twentieth of them.
LEAST_SHARE = 0.95

RIGHT = "right"
UNDETERMINED = "undetermined"
WRONG = "wrong"
VERDICTS = (RIGHT, UNDETERMINED, WRONG)

# Of the points at which curves are compared every fifth one has an interval.
POINTS_OF_CURVES = slice(None, None, 5)


def combined(changes: Iterable[Array]) -> Array | float:
    """The root of the sum of squares of changes (n,), such as ∂y/∂x_i u_i in equation (1); 0 if
    there are none."""
    return np.sqrt(sum(np.square(change) for change in changes))


def chosen_points(comparison: Comparison) -> slice:
    """The compared points that have an interval."""
    return slice(None) if comparison.x is None else POINTS_OF_CURVES


@dataclass(frozen=True)
class Interval:
    """The intervals of one quantity of a test, in the unit of the case file.

    Attributes:
        comparison: of predicted and measured values.
        y_predicted, y_measured: at the points that have an interval (n,).
        sizes: what errors are relative to (n,).
        by_inputs: half of the interval of the prediction by its inputs, 2u (n,); infinite where a
            changed input has no solution.
        by_mesh: difference by mesh and step (n,), not a number where none is known.
        by_measurement: half of the interval of the measured value (n,).
        form: of the computation that the changes are from, "full" or "quick".
    """

    comparison: Comparison
    y_predicted: Array
    y_measured: Array
    sizes: Array
    by_inputs: Array
    by_mesh: Array
    by_measurement: Array
    form: str = "full"

    @property
    def half(self) -> Array:
        """Half of the interval of the prediction (n,), equation (2)."""
        return np.asarray(combined([self.by_inputs, np.nan_to_num(self.by_mesh)]))

    @property
    def width(self) -> float:
        """The interval of the prediction over the value, in the mean of the points."""
        return float((2 * self.half / self.sizes).mean())

    @property
    def share(self) -> float:
        """Share of the points at which the intervals overlap."""
        distance = np.abs(self.y_predicted - self.y_measured)
        # A value without a prediction is not a number, which overlaps with nothing.
        return float((distance <= self.half + self.by_measurement).mean())

    @property
    def overlaps(self) -> bool:
        """Whether the intervals overlap at so many points as those of a right prediction."""
        return self.share >= LEAST_SHARE

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`."""
        if not np.isfinite(self.y_predicted).all():
            return WRONG
        if self.width > WIDEST:
            return UNDETERMINED
        return RIGHT if self.overlaps else WRONG


def digest_of_intervals(case: Case, test: Test) -> str:
    """A short text that differs if inputs or their uncertainties differ."""
    return digest_of(case.model, {**test.inputs.values, "": case.statement.key(test.name)})


def measured_half(case: Case, test: Test, comparison: Comparison) -> Array:
    """Half of the interval of the measured values at the points that have an interval (n,); not a
    number where the case states none."""
    measured = comparison.measured
    y = comparison.y_measured[chosen_points(comparison)]
    stated = case.statement.of_quantity(test.name, measured.quantity)
    if not stated:
        return np.full(len(y), math.nan)
    sizes = y
    # Of a curve through zero a share is that of its reference.
    if math.isfinite(measured.reference):
        sizes = np.full(len(y), measured.reference)
    where = f"{test.inputs.where}, measured '{measured.quantity}'"
    return COVERAGE * np.asarray(
        combined([one.of_values(sizes, measured.unit, where) for one in stated])
    )


def interval_of(case: Case, test: Test, comparison: Comparison, found: Result) -> Interval | None:
    """The intervals of a quantity from the stored changes of its prediction; None if it has none.

    Args:
        case, test: of the quantity.
        comparison: of the predicted and measured values.
        found: changes of the test, as `sensitivity` computes them.
    """
    quantity = comparison.measured.quantity
    if f"inputs of {quantity}" not in found.numbers:
        return None
    chosen = chosen_points(comparison)
    y_predicted = comparison.y_predicted[chosen]
    y_measured = comparison.y_measured[chosen]
    sizes = np.abs(y_measured)
    if math.isfinite(comparison.measured.reference):
        sizes = np.full(len(y_measured), comparison.measured.reference)
    # An empty list is that of an input without a solution.
    by_inputs = np.array(found.numbers[f"inputs of {quantity}"] or np.inf) * np.ones(len(sizes))
    by_mesh = np.array(found.numbers.get(f"mesh of {quantity}", math.nan)) * np.ones(len(sizes))
    return Interval(
        comparison=comparison,
        y_predicted=y_predicted,
        y_measured=y_measured,
        sizes=sizes,
        by_inputs=by_inputs,
        by_mesh=by_mesh,
        by_measurement=measured_half(case, test, comparison),
        form=str(found.values["form"]),
    )


def changes_of(case: Case, test: Test, stored: Sequence[Result]) -> Result | None:
    """The stored changes of a test; None if there are none of its inputs and uncertainties."""
    digest = digest_of_intervals(case, test)
    for result in stored:
        if result.values["test"] == test.name and result.values["digest"] == digest:
            return result
    return None


def count(intervals: Iterable[Interval | None]) -> Mapping[str, int]:
    """The number of quantities with each verdict; under "" those without an interval."""
    return Counter("" if one is None else one.verdict for one in intervals)


def verdict_cells(intervals: Sequence[Interval | None]) -> Iterator[str]:
    """The numbers of right, undetermined and wrong quantities."""
    numbers = count(intervals)
    for name in VERDICTS:
        yield str(numbers.get(name, 0))
