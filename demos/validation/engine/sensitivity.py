"""How predictions and their errors change with the inputs, each changed alone by its standard
uncertainty, and with the mesh and the step.

The change of a prediction is the exact derivative times the uncertainty where a model has a
function `gradients`, or else the difference of two predictions.  A case without a statement of
uncertainty has 1 % of each input that is one number.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.validation.engine.case import Array, Case, Inputs, Measured, Test, with_inputs
from demos.validation.engine.comparison import (
    Comparison,
    Predicted,
    Prediction,
    compare,
    predicted_in,
    results_by_test,
)
from demos.validation.engine.intervals import (
    COVERAGE,
    chosen_points,
    combined,
    digest_of_intervals,
)
from demos.validation.engine.uncertainty import RELATIVE, Uncertainty, changed_values
from demos.validation.engine.units import UNITS
from gossamer_fx.extend import CaseSet, InputError, Judgement, Result, check

# Standard uncertainty, relative to the value, of the inputs of a case that states none: small, as
# stiffnesses of a braid are nearly singular.
UNSTATED = 0.01

# A mean change of the prediction, over the value, below this one is that of the mesh and of the
# solver.
NO_INFLUENCE = 1e-4

# Digits of stored numbers: more only make files larger.
DIGITS = 4

HEAD = [
    "test",
    "quantity",
    "input",
    "value",
    "unit",
    "standard uncertainty",
    "unit of the uncertainty",
    "kind",
    "mean error [%]",
    "change by one standard uncertainty [%]",
    "standard uncertainties that would remove the error",
]


def change_set(
    case: Case, comm: MPI.Intracomm, quick: bool, only: str, stored: Sequence[Result]
) -> CaseSet:
    """The changes of the predictions of a case as cases of `gossamer_fx.analysis.cases`, one for
    each test.

    Args:
        case: the case.
        comm: ranks that compute each test together.
        quick: whether to compute on the mesh of the quick form.
        only: part of the names of the tests.
        stored: results of the full form; the changes by mesh and step are those from them.

    Raises:
        InputError: an input or a measured quantity has no uncertainty, while others have.
    """
    model = importlib.import_module(f"demos.validation.models.{case.model}")
    tests = {test.name: test for test in case.tests if only in test.name}
    if case.statement.uncertainties:
        for test in tests.values():
            check_is_stated(case, test)
    by_test = {test.name: result for test, result in results_by_test(case, stored)}

    def outcome(
        comm: MPI.Intracomm, folder: Path, test: str, digest: str, form: str, ranks: int
    ) -> Mapping[str, Any]:
        return changes(case, model, tests[test], comm, quick, by_test.get(test))

    def judge(results: list[Result]) -> Iterator[Judgement]:
        for result in results:
            yield Judgement(f"{result.values['test']}: intervals", not result.failed)

    return CaseSet(
        name=f"{case.name}-intervals",
        title=f"{case.title}: intervals",
        outcome=outcome,
        cases=[
            {
                "test": test.name,
                "digest": digest_of_intervals(case, test),
                "form": "quick" if quick else "full",
                "ranks": comm.size,
            }
            for test in tests.values()
        ],
        rows=lambda results: influence_rows(case, results),
        judge=judge,
        expected_warnings=case.expected_warnings,
    )


def check_is_stated(case: Case, test: Test) -> None:
    """Refuse a test of which an input, or a quantity measured in an experiment, has no
    uncertainty."""
    quantities = [one.quantity for one in test.measured if one.evidence == "experiment"]
    missing = case.statement.missing(test.name, test.inputs.values, quantities)
    check(
        not missing,
        f"{test.inputs.where}: {', '.join(missing)} have no uncertainty; add [[uncertainties]], or "
        "an entry of [exact] for an input that has none.",
    )


def stated_uncertainties(case: Case, test: Test) -> list[Uncertainty]:
    """The uncertainties of the inputs of a test: those of the case, or 1 % of each number if the
    case states none."""
    if case.statement.uncertainties:
        return case.statement.of_inputs(test.name)
    return [
        Uncertainty(
            inputs=(name,),
            quantity="",
            tests=(),
            size=UNSTATED,
            unit=RELATIVE,
            is_standard=True,
            kind="assumed",
            source="1 % of each input that is one number",
        )
        for name, entry in test.inputs.values.items()
        if isinstance(entry, dict) and isinstance(entry.get("value"), int | float)
    ]


def changes(
    case: Case,
    model: Any,
    test: Test,
    comm: MPI.Intracomm,
    quick: bool,
    stored: Result | None,
) -> dict[str, float | list[float]]:
    """Numbers of a test by name: for each quantity Q the halves of its interval "inputs of Q" and
    "mesh of Q" at each point that has one, "INPUT on Q", the change of Q by one standard
    uncertainty over its size in the mean of the points, and "bias of Q", its mean error.

    Inputs of which no change has a solution leave an empty list of "inputs of Q".

    Args:
        case: the case.
        model: its module.
        test: the test.
        comm: the communicator.
        quick: whether to compute on the mesh of the quick form.
        stored: result of the full form, if there is one.
    """
    prediction = model.predict(test.inputs, comm, quick)
    before = _compared(test, prediction)
    found: dict[str, float | list[float]] = {
        f"bias of {quantity}": _rounded(comparison.bias)
        for quantity, comparison in before.items()
        if math.isfinite(comparison.bias)
    }
    by_quantity: dict[str, list[Array]] = {quantity: [] for quantity in before}
    gradients = _gradients(model, test, prediction)
    for uncertainty in stated_uncertainties(case, test):
        after = _changes_by(model, test, comm, quick, uncertainty, before, gradients)
        for quantity, comparison in before.items():
            change = after.get(quantity, np.full(len(comparison.y_predicted), math.nan))
            by_quantity[quantity].append(change)
            influence = float((change / _sizes(comparison)).mean())
            if math.isfinite(influence):
                found[f"{uncertainty.name} on {quantity}"] = _rounded(influence)
    for quantity, rows in by_quantity.items():
        chosen = chosen_points(before[quantity])
        half = COVERAGE * np.asarray(combined(rows) * np.ones(len(before[quantity].y_predicted)))
        is_bounded = bool(np.isfinite(half[chosen]).all())
        found[f"inputs of {quantity}"] = [_rounded(y) for y in half[chosen]] if is_bounded else []
    for quantity, half in _by_mesh(case, model, test, comm, quick, before, stored).items():
        if np.isfinite(half).all():
            found[f"mesh of {quantity}"] = [_rounded(y) for y in half]
    return found


def _changes_by(
    model: Any,
    test: Test,
    comm: MPI.Intracomm,
    quick: bool,
    uncertainty: Uncertainty,
    before: Mapping[str, Comparison],
    gradients: Mapping[str, Mapping[str, Predicted]],
) -> dict[str, Array]:
    """Changes (n,) of each quantity by one standard uncertainty of an input; empty if the model has
    no solution with the input changed in either direction."""
    followers = getattr(model, "FOLLOWERS", {})
    names = uncertainty.inputs
    has_gradients = all(name in gradients.get(q, {}) for q in before for name in names)
    if has_gradients:
        steps = _steps(test, uncertainty)
        return {
            quantity: sum(
                # A derivative is compared at the points at which the prediction is.
                compare(comparison.measured, gradients[quantity][name]).y_predicted * steps[name]
                for name in names
            )
            for quantity, comparison in before.items()
        }
    # Stiffnesses that are changed alone may not be positive definite.
    for sign in (1, -1):
        values = changed_values(test.inputs.values, uncertainty, sign, test.inputs.where, followers)
        try:
            prediction = model.predict(Inputs(test.inputs.where, values), comm, quick)
        except (gx.NoEquilibrium, gx.StepFailure, InputError):
            continue
        after = _compared(test, prediction)
        found = {
            quantity: sign * (after[quantity].y_predicted - comparison.y_predicted)
            for quantity, comparison in before.items()
            if quantity in after
        }
        # A curve may end before the range does when an input is larger, and not when it is smaller.
        is_whole = all(
            bool(np.isfinite(change[np.isfinite(before[quantity].y_predicted)]).all())
            for quantity, change in found.items()
        )
        if is_whole or sign < 0:
            return found
    return {}


def _gradients(
    model: Any, test: Test, prediction: Prediction
) -> Mapping[str, Mapping[str, Predicted]]:
    """Exact derivatives of quantities by inputs, in SI units, of a model that has them."""
    if not hasattr(model, "gradients"):
        return {}
    found: Mapping[str, Mapping[str, Predicted]] = model.gradients(test.inputs, prediction)
    return found


def _steps(test: Test, uncertainty: Uncertainty) -> dict[str, float]:
    """Changes of the inputs of an uncertainty by one standard uncertainty, in SI units."""
    steps = {}
    changed = changed_values(test.inputs.values, uncertainty, 1, test.inputs.where, {})
    for name in uncertainty.inputs:
        entry = test.inputs.values[name]
        steps[name] = (changed[name]["value"] - entry["value"]) * UNITS[entry["unit"]][1]
    return steps


def _by_mesh(
    case: Case,
    model: Any,
    test: Test,
    comm: MPI.Intracomm,
    quick: bool,
    before: Mapping[str, Comparison],
    stored: Result | None,
) -> dict[str, Array]:
    """Differences (n,) of each quantity by mesh and step, at the points that have an interval.

    They are those of the stored prediction of the full form from that with the inputs of `[finer]`,
    or else from that of the quick form; empty if nothing of this is known.
    """
    other = before
    if case.statement.finer:
        finer = with_inputs(case, case.statement.finer)
        (test_of_finer,) = [one for one in finer.tests if one.name == test.name]
        try:
            other = _compared(test, model.predict(test_of_finer.inputs, comm, quick))
        except (gx.NoEquilibrium, gx.StepFailure):
            other = {}
    elif not quick:
        return {}
    found = {}
    for quantity, comparison in other.items():
        reference = before[quantity]
        if stored is not None:
            reference = compare(comparison.measured, predicted_in(stored, quantity))
        difference = np.abs(comparison.y_predicted - reference.y_predicted)
        found[quantity] = difference[chosen_points(comparison)]
    return found


def _compared(test: Test, prediction: Prediction) -> dict[str, Comparison]:
    """Comparisons of the measured quantities that a prediction has, by name."""
    return {
        one.quantity: compare(one, prediction.quantities[one.quantity])
        for one in test.measured
        if one.quantity in prediction.quantities
    }


def _sizes(comparison: Comparison) -> Array:
    """What errors are relative to (n,)."""
    if math.isfinite(comparison.measured.reference):
        return np.full(len(comparison.y_measured), comparison.measured.reference)
    return np.abs(comparison.y_measured)


def _rounded(value: float) -> float:
    return float(f"{float(value):.{DIGITS}g}")


# ---- tables --------------------------------------------------------------------------------------


def influence_rows(case: Case, results: Sequence[Result]) -> Iterator[list[str]]:
    """Cells of the table of changes by each input; first the headings."""
    yield HEAD
    by_name = {result.values["test"]: result for result in results}
    for test in case.tests:
        if test.name not in by_name:
            continue
        numbers = by_name[test.name].numbers
        for measured in test.measured:
            for uncertainty in stated_uncertainties(case, test):
                yield _influence_cells(test, measured, uncertainty, numbers)


def _influence_cells(
    test: Test, measured: Measured, uncertainty: Uncertainty, numbers: Mapping[str, Any]
) -> list[str]:
    """One row of the table of changes."""
    influence = numbers.get(f"{uncertainty.name} on {measured.quantity}", math.nan)
    bias = numbers.get(f"bias of {measured.quantity}", math.nan)
    needed = "none"
    if math.isnan(influence):
        needed = "no solution"
    elif abs(influence) > NO_INFLUENCE and math.isfinite(bias):
        needed = f"{-bias / influence:+.1f}"
    entry = test.inputs.values[uncertainty.inputs[0]]
    value = entry["value"]
    is_one = len(uncertainty.inputs) == 1 and isinstance(value, int | float)
    return [
        test.name,
        measured.quantity,
        uncertainty.name,
        f"{value:g}" if is_one else "",
        entry["unit"] if is_one else "",
        f"{uncertainty.standard:.3g}",
        uncertainty.unit,
        uncertainty.kind,
        f"{100 * bias:+.1f}" if math.isfinite(bias) else "",
        "" if math.isnan(influence) else f"{100 * influence:+.2f}",
        needed,
    ]
