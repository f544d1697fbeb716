"""Figures on the first page and in the words of docs/benchmark.md are those of the result files."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from demos.antennas import antenna_reference
from gossamer_fx.analysis.cases.results import Result, read_results

ROOT = Path(__file__).parents[2]
BENCHMARKS = ROOT / "demos" / "benchmarks" / "results"


def on_one_line(text: str) -> str:
    return re.sub(r"\s+", " ", text)


def words_of(page: str) -> str:
    """The text of a page on one line."""
    return on_one_line((ROOT / page).read_text(encoding="utf-8"))


def points(problem: str, program: str) -> list[Result]:
    """The stored points of a program that did not fail, from the coarsest."""
    name = f"errors_{problem}"
    found = read_results(BENCHMARKS / f"{name}.json", name)
    return [one for one in found if one.values["program"] == program and not one.failed]


def percent(error: float) -> str:
    return f"{100 * error:.2g} %"


def seconds(point: Result) -> str:
    return f"{point.numbers['cpu']:.3g} s"


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


def claims() -> dict[str, str]:
    """What the first page says, by what it is about."""
    airbag = points("airbag", "gossamer, P1")
    curved = points("airbag", "gossamer, P2")
    kratos = points("airbag", "kratos")
    antenna = points("pendulum", "gossamer, P1")
    quadratic = points("pendulum", "gossamer, P2")
    exudyn = points("pendulum", "exudyn")

    def heights(meshes: list[Result]) -> str:
        errors = [f"{one.numbers['error']:.2g}" for one in meshes]
        return f"{', '.join(errors)} mm"

    return {
        "airbag": (
            f"{percent(curved[1].numbers['error'])} in {seconds(curved[1])} by order 2, "
            f"{percent(airbag[2].numbers['error'])} in {seconds(airbag[2])} by order 1, "
            f"{percent(kratos[-1].numbers['error'])} in {seconds(kratos[-1])} by Kratos"
        ),
        "finest airbag": (
            f"order 2: {percent(curved[-1].numbers['error'])} in {seconds(curved[-1])}; "
            f"order 1: {percent(airbag[-1].numbers['error'])} in {seconds(airbag[-1])}; "
            f"Kratos: {percent(kratos[-1].numbers['error'])} in {seconds(kratos[-1])}"
        ),
        "antenna": (
            f"{heights(antenna)} on 3, 6, 9 cells here (P1, {antenna[0].numbers['cpu']:.3g} to "
            f"{seconds(antenna[-1])}), {heights(quadratic)} on 3, 6 cells "
            f"(P2, to {seconds(quadratic[-1])}), {heights(exudyn)} by Exudyn "
            f"({exudyn[0].numbers['cpu']:.3g} to {seconds(exudyn[-1])})"
        ),
        "strip": (
            f"Kratos {ratios('strip', 'kratos', (4e-3, 3e-3, 1e-3, 2.2e-4))}; "
            f"Exudyn {ratios('strip', 'exudyn', (9e-3, 3e-3, 1e-3, 7.2e-4))}"
        ),
    }


CLAIMS = claims()


@pytest.mark.parametrize("about", ["finest airbag", "strip"])
def test_the_first_page_says_what_the_result_files_say(about: str) -> None:
    assert CLAIMS[about] in words_of("README.md")


@pytest.mark.parametrize("about", ["airbag", "antenna", "strip"])
def test_the_page_of_benchmarks_says_the_same(about: str) -> None:
    assert CLAIMS[about] in words_of("docs/benchmark.md")


def test_the_antenna_is_compared_with_the_other_program_as_the_file_says() -> None:
    stored = read_results(antenna_reference.STORED, antenna_reference.NAME)
    page = words_of("docs/verification.md")
    assert on_one_line(antenna_reference.table(stored)) in page
    said = antenna_reference.claims(stored)
    for claim in said:
        assert claim in page
    # The first two are the distances of both programs.
    for claim in said[:2]:
        assert claim in words_of("README.md")
    # With the same discretisation both programs agree to 1 mm, at every stored instant.
    coarse = {"cells": 3, "elements": 6, "dt": 0.01, "shell": True}
    own = antenna_reference.tip(stored, antenna_reference.SELF, coarse)
    peer = antenna_reference.tip(stored, "ngsolve", antenna_reference.COARSE)
    assert max(antenna_reference.differences(own, peer)) < 1.0
    # With finer cells, and booms as stiff in both, they do at 1 s and 2 s.
    own = antenna_reference.tip(stored, antenna_reference.SELF, antenna_reference.STIFF)
    peer = antenna_reference.tip(stored, "ngsolve", antenna_reference.REFERENCE)
    assert max(antenna_reference.differences(own, peer)[:2]) < 1.0
