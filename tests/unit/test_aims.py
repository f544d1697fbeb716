"""An aim, once it was set, stays: what is asked of predictions is what was asked first."""

from __future__ import annotations

import json
import math
import tomllib

import pytest

from demos.validation.__main__ import CASES, MODELS, NAMES
from demos.validation.engine.case import read_case

# The aims of validation, each with the commit in which it was set.
FIRST = json.loads((CASES.parent / "aims.json").read_text(encoding="utf-8"))


def aims_of(text: str) -> dict[str, dict]:
    """The aims of a case file, by test and quantity."""
    return {
        f"{test['name']} | {measured['quantity']}": {
            key: measured[key] for key in ("tolerance", "accepted") if key in measured
        }
        for test in tomllib.loads(text)["tests"]
        for measured in test["measured"]
    }


@pytest.mark.parametrize("name", NAMES)
def test_what_is_asked_is_what_was_asked_first(name: str) -> None:
    path = CASES / f"{name}.toml"
    now = {f"{name} | {key}": aim for key, aim in aims_of(path.read_text(encoding="utf-8")).items()}
    first = {
        key: {word: value for word, value in aim.items() if word != "commit"}
        for key, aim in FIRST.items()
        if key.startswith(f"{name} | ")
    }
    assert {key: aim for key, aim in now.items() if aim} == first


def test_every_aim_has_a_kind_and_evidence() -> None:
    for name in NAMES:
        for test in read_case(CASES / f"{name}.toml", MODELS).tests:
            for measured in test.measured:
                if math.isfinite(measured.accepted[1]):
                    assert measured.kind, f"{name}, {test.name}: {measured.quantity}"


def test_what_benchmarks_ask_is_what_they_asked_first() -> None:
    """`demos/benchmarks/aims.json` is changed where a problem is added, and nowhere else."""
    folder = CASES.parents[1] / "benchmarks"
    problems = tomllib.loads((folder / "problems.toml").read_text(encoding="utf-8"))
    words = ("accepted", "quick_accepted", "limits", "equal", "answers")
    now = {
        name: {word: entry[word] for word in words if word in entry}
        for name, entry in problems.items()
    }
    first = json.loads((folder / "aims.json").read_text(encoding="utf-8"))
    assert {name: aims for name, aims in now.items() if aims} == first
