"""Figures that pages derive from several stored results."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from demos.antennas import antenna_reference
from gossamer_fx.analysis.cases.results import Result, read_results

ROOT = Path(__file__).parents[2]
BENCHMARKS = ROOT / "demos" / "benchmarks" / "results"


@pytest.fixture
def evidence(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    import evidence

    return evidence


def points(problem: str, program: str) -> list[Result]:
    """The stored points of a program that did not fail, from the coarsest."""
    name = f"errors_{problem}"
    found = read_results(BENCHMARKS / f"{name}.json", name)
    return [one for one in found if one.values["program"] == program and not one.failed]


def cost_at(problem: str, program: str, error: float) -> float:
    """CPU time of a program for an error, between its points by power laws."""
    curve = sorted((one.numbers["error"], one.numbers["cpu"]) for one in points(problem, program))
    errors, costs = np.log(np.array(curve)).T
    assert errors[0] <= np.log(error) <= errors[-1]
    return float(np.exp(np.interp(np.log(error), errors, costs)))


def ratios(problem: str, peer: str, errors: tuple[float, ...]) -> str:
    """Smallest and largest CPU time of a peer over that of this program at some errors."""
    found = [cost_at(problem, peer, e) / cost_at(problem, "gossamer", e) for e in errors]
    return f"{min(found):.1f} to {max(found):.1f}"


@pytest.mark.parametrize(
    "peer, errors",
    [("kratos", (4e-3, 3e-3, 1e-3, 2.2e-4)), ("exudyn", (9e-3, 3e-3, 1e-3, 7.2e-4))],
)
def test_times_at_equal_errors_are_those_of_the_result_files(
    evidence, peer: str, errors: tuple[float, ...]
) -> None:
    """Between stored points, so that no record can take them from a file."""
    said = ratios("strip", peer, errors)
    for page, table in (("first_page", "evidence"), ("benchmark", "strip")):
        rows = evidence.tables(page)[table].rows
        assert any(peer.title() in row.cells and said in row.cells for row in rows)


@pytest.mark.parametrize("error", [0.0262, 0.0090])
def test_times_of_the_ring_at_equal_errors_are_those_of_the_result_files(
    evidence, error: float
) -> None:
    ratio = cost_at("ring", "kratos", error) / cost_at("ring", "gossamer", error)
    said = [f"{100 * error:.1f}", f"{ratio:.0f}"]
    assert said in [row.cells for row in evidence.tables("benchmark")["ring"].rows]


def test_the_antenna_is_compared_with_the_other_program_as_the_file_says() -> None:
    stored = read_results(antenna_reference.STORED, antenna_reference.NAME)
    # With the same discretisation both programs agree to 1 mm, at every stored instant.
    coarse = {"cells": 3, "elements": 6, "dt": 0.01, "shell": True}
    own = antenna_reference.tip(stored, antenna_reference.SELF, coarse)
    peer = antenna_reference.tip(stored, "ngsolve", antenna_reference.COARSE)
    assert max(antenna_reference.differences(own, peer)) < 1.0
    # With finer cells, and booms as stiff in both, they do at 1 s and 2 s.
    own = antenna_reference.tip(stored, antenna_reference.SELF, antenna_reference.STIFF)
    peer = antenna_reference.tip(stored, "ngsolve", antenna_reference.REFERENCE)
    assert max(antenna_reference.differences(own, peer)[:2]) < 1.0
