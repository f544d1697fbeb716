"""Results of cases: computed test by test, stored as JSON, so that an interrupted run goes on."""

from __future__ import annotations

import importlib
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from demos.validation.engine.case import Case, Test
from demos.validation.engine.comparison import Comparison, Predicted, Prediction, compare
from gossamer_fx.core.checks.errors import (
    InputError,
    NoEquilibrium,
    StepFailure,
    check,
    on_rank_zero,
)
from gossamer_fx.version import VERSION

# Of result files; those of another format are refused.
FORMAT = 1

# Digits of stored numbers: more only make files larger.
DIGITS = 7

Stored = dict[str, Any]


def result_path(folder: Path, case: Case, quick: bool) -> Path:
    """The file of the results of a case, in its full or its quick form."""
    suffix = "-quick" if quick else ""
    return folder / f"{case.name}{suffix}.json"


def run(
    case: Case,
    folder: Path,
    comm: MPI.Intracomm,
    *,
    quick: bool,
    only: str = "",
    fresh: bool = False,
) -> Stored:
    """Compute the tests of a case that its result file lacks; returns all results.

    Args:
        case: the case.
        folder: of the results.
        comm: the communicator.
        quick: whether to compute the quick form.
        only: compute tests whose name contains this text.
        fresh: compute again what is stored.

    Raises:
        InputError: an input is missing or wrong, or the file cannot be read or written.
    """
    path = result_path(folder, case, quick)
    # All ranks must agree on what is known, or they would not compute the same tests.
    stored = comm.bcast(on_rank_zero(comm, lambda: read(path, case)))
    tests = case.chosen(quick)
    model = importlib.import_module(f"demos.validation.models.{case.model}")
    for test in tests:
        if only not in test.name:
            continue
        known = stored["tests"].get(test.name, {})
        # A result of other inputs does not count, and a test that failed is tried again.
        is_known = known.get("digest") == test.digest and not known.get("failed")
        if is_known and not fresh:
            continue
        stored["tests"][test.name] = _compute(
            model.predict,
            test,
            comm,
            quick,
        )
        # After each test, so that a run that was ended goes on from there.
        on_rank_zero(comm, lambda: write(path, stored))
        if comm.rank == 0:
            seconds = stored["tests"][test.name]["seconds"]
            print(f"{case.name}, {test.name}: {seconds:.1f} s", flush=True)
    return stored


def comparisons(stored: Stored, test: Test) -> list[Comparison]:
    """Comparisons of the measured quantities of a test with its stored prediction."""
    result = stored["tests"].get(test.name, {})
    quantities = result.get("predicted", {})
    return [compare(measured, quantities.get(measured.quantity)) for measured in test.measured]


def _compute(predict: Any, test: Test, comm: MPI.Intracomm, quick: bool) -> Stored:
    """Predict one test; a failure that has a name is a result."""
    started = time.perf_counter()
    result: Stored = {"digest": test.digest, "failed": "", "predicted": {}, "details": {}}
    try:
        prediction: Prediction = predict(
            test.inputs,
            comm,
            quick,
        )
    # Wrong input still ends the command: it would be wrong in the next attempt, too.
    except (NoEquilibrium, StepFailure) as failure:
        result["failed"] = str(failure)
    else:
        result["predicted"] = {
            name: _as_lists(found) for name, found in prediction.quantities.items()
        }
        result["details"] = {name: _rounded(v) for name, v in prediction.details.items()}
    result["seconds"] = round(time.perf_counter() - started, 2)
    result["ranks"] = comm.size
    return result


def _as_lists(found: Predicted) -> Stored:
    """A predicted quantity as JSON has it."""
    y = [_rounded(value) for value in np.atleast_1d(found.y)]
    if found.x is None:
        return {"x": None, "y": y}
    return {"x": [_rounded(value) for value in np.atleast_1d(found.x)], "y": y}


def _rounded(value: float) -> float:
    return float(f"{float(value):.{DIGITS}g}")


def read(path: Path, case: Case) -> Stored:
    """Results that are stored, or none yet.

    Raises:
        InputError: the file is not one of results of this case.
    """
    empty = {"format": FORMAT, "case": case.name, "version": VERSION, "tests": {}}
    if not path.is_file():
        return empty
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        is_right = stored["format"] == FORMAT and stored["case"] == case.name
        is_right = is_right and all(isinstance(one, dict) for one in stored["tests"].values())
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(f"'{path}' does not hold results of '{case.name}'; remove it.") from error
    check(is_right, f"'{path}' does not hold results of '{case.name}'; remove it.")
    return stored


def write(path: Path, stored: Stored) -> None:
    """Write results to a new file, which then replaces the old one: a killed run leaves a whole
    file.

    Raises:
        InputError: the folder cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = path.with_suffix(".new")
        new.write_text(json.dumps(stored, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        new.replace(path)
    except OSError as error:
        raise InputError(
            f"Cannot write '{path}' ({error.strerror}); choose a folder that is writable."
        ) from error
