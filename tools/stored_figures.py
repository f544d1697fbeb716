"""Numbers of the stored results of the project by their source, for tables of evidence.

A source is KIND:NAME: `study:disc`, `bench:errors_airbag`, `validate:hiad_torus`, or
`demo:antenna_reference`.
"""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

from packages import ROOT

sys.path[:0] = [str(ROOT)]

from demos.studies.__main__ import stored_file  # noqa: E402
from demos.validation.__main__ import CASES, MODELS, STORED  # noqa: E402
from demos.validation.engine.case import Case, read_case  # noqa: E402
from demos.validation.engine.comparison import (  # noqa: E402
    Comparison,
    comparisons,
    results_by_test,
)
from gossamer_fx.analysis.cases.results import Result, read_results  # noqa: E402

BENCHMARKS = ROOT / "demos" / "benchmarks" / "results"
# Demos with stored results, and the module whose function `figures` reads them.
DEMOS = {"antenna_reference": "demos.antennas.antenna_reference"}


def stored_results(source: str) -> list[Result]:
    """The stored results of a source.

    Raises:
        ValueError: there is no such source, or it has no stored results of its full form.
    """
    kind, _, name = source.partition(":")
    results: list[Result] = []
    if kind == "study":
        results = read_results(stored_file(name, quick=False), name)
    elif kind == "bench":
        results = read_results(BENCHMARKS / f"{name}.json", name)
    elif kind == "validate" and (CASES / f"{name}.toml").is_file():
        case = read_case(CASES / f"{name}.toml", MODELS)
        results = list(compared(case, read_results(STORED / f"{name}.json", name)))
    elif kind == "demo" and name in DEMOS:
        results = importlib.import_module(DEMOS[name]).figures()
    if not results:
        raise ValueError(f"'{source}' has no stored results; give study:NAME or another source.")
    return results


def compared(case: Case, results: list[Result]) -> Iterator[Result]:
    """What was predicted for each test, next to what was measured: numbers by quantity."""
    for test, result in results_by_test(case, results):
        # What was predicted without a measurement next to it is in SI units, "y of NAME".
        numbers: dict[str, Any] = {
            name: value[0] if isinstance(value, list) else value
            for name, value in result.numbers.items()
            if not isinstance(value, list) or len(value) == 1
        }
        for found in comparisons(test, result):
            numbers |= compared_numbers(found)
        yield Result(values={"test": test.name}, numbers=numbers, seconds=result.seconds)


def compared_numbers(found: Comparison) -> dict[str, float]:
    """The judged error, that of a peer, the largest one, and the values of a comparison by name."""
    quantity = found.measured.quantity
    numbers = {
        f"error of {quantity}": found.error,
        f"mean error of {quantity}": found.mean_error,
        f"largest error of {quantity}": float(abs(found.errors).max()),
        f"peer's error of {quantity}": found.measured.peer_error,
    }
    labels: Sequence[str] = found.measured.labels or [""]
    if len(labels) == len(found.y_measured):
        for label, own, measured in zip(labels, found.y_predicted, found.y_measured, strict=True):
            name = f"{quantity}, {label}" if label else quantity
            numbers[f"predicted {name}"] = float(own)
            numbers[f"measured {name}"] = float(measured)
    return numbers


def figure(
    source: str, case: Mapping[str, Any], quantity: str, form: str, factor: float, reduce: str
) -> str:
    """One figure of a stored result as text.

    Args:
        source: of the results, see above.
        case: values that the results must have; a text may be a pattern such as "bounce*".
        quantity: name of the number.
        form: of the text, such as ".3g".
        factor: that brings the number to the unit of the table.
        reduce: "" for a single result; of several ones "least" or "largest" (of their sizes),
            "range", "count", or "nonzero" for the count of those that are not zero.

    Raises:
        ValueError: there is no such number, or several and no `reduce`.
    """
    numbers = [
        result.numbers[quantity] * factor
        for result in stored_results(source)
        if _has(result, case) and quantity in result.numbers
    ]
    where = f"{source}, {dict(case)}: {quantity!r}"
    if not numbers:
        raise ValueError(f"{where} is not stored; give another case or quantity.")
    if reduce == "count":
        return str(len(numbers))
    if reduce == "nonzero":
        return str(sum(number != 0 for number in numbers))
    if reduce in ("least", "largest"):
        sizes = [abs(number) for number in numbers]
        return _text(min(sizes) if reduce == "least" else max(sizes), form)
    if reduce == "range":
        ends = [_text(min(numbers), form), _text(max(numbers), form)]
        return " to ".join(dict.fromkeys(ends))
    if len(numbers) > 1:
        raise ValueError(f"{where} is stored {len(numbers)} times; name more of the case.")
    return _text(numbers[0], form)


def _has(result: Result, case: Mapping[str, Any]) -> bool:
    """Whether a result has the values of a case."""
    for name, wanted in case.items():
        value = result.values.get(name)
        is_text = isinstance(value, str) and isinstance(wanted, str)
        if not (fnmatchcase(value, wanted) if is_text else value == wanted):
            return False
    return True


def _text(number: float, form: str) -> str:
    """A number in a format, its exponent without zeros in front."""
    if number == 0 and "e" in form:
        return "0"
    return re.sub(r"e([+-])0+(\d)", r"e\1\2", format(number, form)).replace("e+", "e")
