"""What the first page and the tutorial say of the boom is what its study has stored."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from demos.studies.__main__ import stored_file
from demos.studies.engine.named import study_of
from demos.studies.engine.spreads import SpreadStudy
from gossamer_fx.analysis.answer_spread import Spread, Verdict
from gossamer_fx.analysis.cases.results import read_results

ROOT = Path(__file__).parents[2]
# Rows of the table of the tutorial.
QUANTITIES = (
    "halfway [ms]",
    "arrived [ms]",
    "tip speed [m/s]",
    "pressure [Pa]",
    "stiffness along z [N/m]",
    "swing [%]",
    "ring 1 [ms]",
    "ring 2 [ms]",
    "ring 3 [ms]",
)


@pytest.fixture(scope="module")
def found() -> Spread:
    study = study_of("boom")
    assert isinstance(study, SpreadStudy)
    return study.spread(read_results(stored_file("boom", quick=False), "boom"))


def said(page: str, pattern: str) -> list[float]:
    """The numbers that a page says by a pattern, in which # is a number; line ends are blanks."""
    text = " ".join((ROOT / page).read_text(encoding="utf-8").split())
    match = re.search(pattern.replace("#", r"(\d+(?:\.\d+)?)"), text)
    assert match, f"{page} does not say: {pattern}"
    return [float(number) for number in match.groups()]


def is_range(numbers: list[float], verdict: Verdict) -> bool:
    """Whether two whole numbers are the rounded ends of a range."""
    return numbers == [round(verdict.low), round(verdict.high)]


def test_the_first_page_says_what_is_determined_of_the_boom(found: Spread) -> None:
    page = "README.md"
    arrived = found.verdict("arrived [ms]")
    assert arrived.kind == "determined"
    [time, percent] = said(page, r"0\.9 of the length is out after # ms \(all runs within # %\)")
    assert time == round(arrived.value)
    assert percent == round(100 * arrived.largest_change)
    by_cells = [one.numbers["stiffness along z [N/m]"] for one in found.runs_of("cells")]
    usual = found.verdict("stiffness along z [N/m]")
    [coarse, fine] = said(page, "tip is then # N/m on this mesh and # N/m on finer ones")
    assert coarse == round(usual.value)
    assert fine == round(by_cells[-1])
    halfway = found.verdict("halfway [ms]")
    assert halfway.kind == "not determined"
    assert is_range(said(page, "length is out after # to # ms"), halfway)
    ring = found.verdict("ring 1 [ms]")
    assert ring.kind == "not determined"
    assert is_range(said(page, r"each fold opens \(# to # ms\) is not determined"), ring)


def test_the_tutorial_says_the_verdicts_of_the_study(
    found: Spread, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    import evidence

    rows = evidence.tables("folded_tube")["folded_tube"].rows
    judged = [row.cells for row in rows if row.cells[3] != "closed form"]
    assert len(judged) == len(QUANTITIES)
    for (_, _, this_run, kind, low, high), quantity in zip(judged, QUANTITIES, strict=True):
        verdict = found.verdict(quantity)
        assert kind == verdict.kind
        # The run of another day, or another machine, lies in the range, too.
        assert float(low) <= float(this_run) <= float(high)
