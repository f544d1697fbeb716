"""Which inputs would explain an error: predictions with each input changed a little."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator
from typing import Any

from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.engine.case import Case, Test, with_inputs
from demos.validation.engine.comparison import compare
from gossamer_fx.extend import InputError

# Relative change of an input: small, as stiffnesses of a braid are nearly singular.
CHANGE = 0.01

# A change of the mean prediction below this one is that of the mesh and of the solver.
NO_INFLUENCE = 1e-4

HEAD = (
    "| test | quantity | input | mean error | mean error with +1 % | change that would remove it |"
)


def sensitivities(case: Case, comm: MPI.Intracomm, *, quick: bool, only: str = "") -> Iterator[str]:
    """Lines of a Markdown table of signed mean errors, one for each input that is a number.

    The last column divides the error by the influence: an input may explain the error if it is as
    uncertain as that.

    Args:
        case: the case.
        comm: the communicator.
        quick: whether to compute with the mesh of the quick form.
        only: tests whose name contains this text.
    """
    yield HEAD
    yield "|---" * 6 + "|"
    model = importlib.import_module(f"demos.validation.models.{case.model}")
    for test in case.chosen(quick):
        if only not in test.name:
            continue
        before = _biases(model, test, comm, quick)
        for name, entry in test.inputs.values.items():
            value = entry.get("value") if isinstance(entry, dict) else None
            if not isinstance(value, int | float):
                continue
            changed = with_inputs(case, {name: value * (1 + CHANGE)})
            (other,) = [one for one in changed.tests if one.name == test.name]
            after = _biases(model, other, comm, quick)
            for quantity, bias in before.items():
                influence = after.get(quantity, math.nan) - bias
                needed = "none"
                if math.isnan(influence):
                    needed = "no solution"
                elif abs(influence) > NO_INFLUENCE:
                    needed = f"{-100 * CHANGE * bias / influence:+.0f} %"
                cells = [
                    test.name,
                    quantity,
                    name,
                    f"{100 * bias:+.1f} %",
                    "" if math.isnan(influence) else f"{100 * (bias + influence):+.1f} %",
                    needed,
                ]
                yield "| " + " | ".join(cells) + " |"


def _biases(model: Any, test: Test, comm: MPI.Intracomm, quick: bool) -> dict[str, float]:
    """Mean of predicted/measured - 1 of each quantity; empty if the model has no solution."""
    try:
        prediction = model.predict(test.inputs, comm, quick)
    # Stiffnesses that are changed alone may not be positive definite.
    except (gx.NoEquilibrium, gx.StepFailure, InputError):
        return {}
    found = {}
    for measured in test.measured:
        predicted = prediction.quantities.get(measured.quantity)
        if predicted is not None:
            comparison = compare(measured, predicted)
            found[measured.quantity] = comparison.bias
    return found
