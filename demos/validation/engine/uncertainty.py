"""How uncertain the inputs and the measured values of a case are, as a case file states it.

    [[uncertainties]]
    inputs = ["A11", "A12"]           changed together, by one factor or by one shift, or
    quantity = "load"                 a measured quantity, of all tests that have it
    tests = ["1 up, 69 kPa"]          those that it holds for (optional; default: all)
    half_width = {value = 1, unit = "mm"}   of a range without further knowledge, or
    standard = {value = 0.02, unit = "relative"}   a standard deviation; "relative" is the share of
                                      the value
    kind = "assumed"                  one of `KINDS`
    source = "..."                    where the number is from; of an assumed one the reason

    [exact]                           inputs without uncertainty: a reason by name
    deflection = "how far the computed test goes"

    [finer]                           inputs of a finer mesh or a smaller step (optional)
    cells_around = 18

The standard uncertainty of a half-width a is a/√3, that of a uniform distribution.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from demos.validation.engine.units import conversion_factor
from gossamer_fx.extend import check

KINDS = ("measured scatter", "tolerance", "reading", "assumed")

# The unit of a number that is a share of the value that it belongs to.
RELATIVE = "relative"

# Standard deviation of a uniform distribution over its half-width.
UNIFORM = 1 / math.sqrt(3)

# The inputs of a test by name, as the tables {value, unit} of the file.
Values = Mapping[str, Any]


@dataclass(frozen=True)
class Uncertainty:
    """One statement of a case file.

    Attributes:
        inputs: names of inputs that change together; empty of a measured quantity.
        quantity: name of a measured quantity; empty of inputs.
        tests: names of the tests that it holds for; empty: all.
        size: half-width or standard deviation.
        unit: of `size`, or `RELATIVE`.
        is_standard: whether `size` is a standard deviation.
        kind: one of `KINDS`.
        source: where the number is from, or the reason of an assumed one.
    """

    inputs: tuple[str, ...]
    quantity: str
    tests: tuple[str, ...]
    size: float
    unit: str
    is_standard: bool
    kind: str
    source: str

    @property
    def name(self) -> str:
        """The inputs or the quantity in one line."""
        return self.quantity or ", ".join(self.inputs)

    @property
    def standard(self) -> float:
        """The standard uncertainty, in `unit`."""
        return self.size if self.is_standard else UNIFORM * self.size

    def holds_for(self, test: str) -> bool:
        """Whether it is stated for a test."""
        return not self.tests or test in self.tests

    def of_values(self, values: np.ndarray, unit: str, where: str) -> np.ndarray:
        """Standard uncertainties (n,) of values (n,), in their unit.

        Raises:
            InputError: the unit of the statement is of another dimension.
        """
        if self.unit == RELATIVE:
            return self.standard * np.abs(values)
        return np.full(len(values), self.standard * conversion_factor(self.unit, unit, where))


@dataclass(frozen=True)
class Statement:
    """All that a case file states about uncertainty.

    Attributes:
        uncertainties: of inputs and measured quantities.
        exact: reasons by the names of inputs without uncertainty.
        finer: inputs of a finer mesh or a smaller step, by name.
    """

    uncertainties: tuple[Uncertainty, ...] = ()
    exact: Mapping[str, str] = field(default_factory=dict)
    finer: Mapping[str, float] = field(default_factory=dict)

    def of_inputs(self, test: str) -> list[Uncertainty]:
        """The uncertainties of the inputs of a test."""
        return [one for one in self.uncertainties if one.inputs and one.holds_for(test)]

    def of_quantity(self, test: str, quantity: str) -> list[Uncertainty]:
        """The uncertainties of a measured quantity of a test."""
        return [
            one for one in self.uncertainties if one.quantity == quantity and one.holds_for(test)
        ]

    def missing(self, test: str, inputs: Values, quantities: Iterable[str]) -> list[str]:
        """Names of the inputs that are numbers and of the measured quantities of a test without a
        statement.

        Args:
            test: its name.
            inputs: of the test.
            quantities: that were measured in an experiment.
        """
        stated = {name for one in self.of_inputs(test) for name in one.inputs}
        stated |= set(self.exact)
        numbers = [name for name, entry in inputs.items() if isinstance(entry, dict)]
        found = [name for name in numbers if name not in stated]
        return found + [name for name in quantities if not self.of_quantity(test, name)]

    def key(self, test: str) -> list[Any]:
        """What the intervals of a test depend on; the words about it have no influence."""
        return [
            *([list(one.inputs), one.standard, one.unit] for one in self.of_inputs(test)),
            dict(self.finer),
        ]


def changed_values(
    values: Values,
    uncertainty: Uncertainty,
    sign: float,
    where: str,
    followers: Mapping[str, Callable[[Values, float], Values]],
) -> Values:
    """The inputs of a test, of which those of an uncertainty are changed by the standard
    uncertainty.

    Args:
        values: of the test.
        uncertainty: of inputs.
        sign: 1 or -1, of the change.
        where: case and test, for messages.
        followers: inputs that others follow from: followers[name](values, number) gives the values
            of all inputs for another number of it, in its unit.

    Raises:
        InputError: an input is missing or not a number, or has a unit of another dimension.
    """
    found = dict(values)
    for name in uncertainty.inputs:
        entry = found.get(name)
        check(
            isinstance(entry, dict) and "value" in entry,
            f"{where}: '{name}' of [[uncertainties]] is not an input that is a number; give one.",
        )
        value = np.asarray(entry["value"], dtype=float)
        if uncertainty.unit == RELATIVE:
            new = value * (1 + sign * uncertainty.standard)
        else:
            factor = conversion_factor(uncertainty.unit, entry["unit"], f"{where}: {name}")
            new = value + sign * uncertainty.standard * factor
        if name in followers:
            found = dict(followers[name](found, float(new)))
        else:
            found[name] = {**entry, "value": new.tolist()}
    return found
