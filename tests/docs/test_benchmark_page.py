"""The page of errors against CPU time: it shows the stored results, and its problems can be
solved."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gossamer_fx.analysis.cases.results import Result, read_results
from tests.hanging import HANG_TIMEOUT

ROOT = Path(__file__).parents[2]
BENCHMARKS = ROOT / "demos" / "benchmarks"
RESULTS = sorted((BENCHMARKS / "results").glob("*.json"))


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import bench

    return bench


def test_the_page_shows_what_is_stored(bench) -> None:
    page = bench.PAGE.read_text(encoding="utf-8")
    shown = page.split("<!-- benchmark -->\n")[1].split("<!-- /benchmark -->")[0]
    assert shown == bench.page_part()
    # At least four problems are stored, or the page is empty.
    assert len(RESULTS) >= 4


@pytest.mark.parametrize("path", RESULTS, ids=[path.stem for path in RESULTS])
def test_stored_points_are_those_of_the_problem_and_as_it_declares(bench, path: Path) -> None:
    points = read_results(path, path.stem)
    problem = bench.ERROR_PROBLEMS[path.stem]
    asked = [
        {"program": program, **words}
        for program, cases in problem.curves.items()
        for words in cases
    ]
    assert [point.values for point in points] == asked
    for point in points:
        assert point.failed or (point.numbers["cpu"] > 0 and point.numbers["error"] > 0)
    judgements = list(bench.judge_points(problem, points, quick=False))
    assert judgements and all(one.holds for one in judgements)
    assert path.with_suffix(".png").is_file()


def test_a_failure_is_a_remark_and_unconverged_steps_are_counted(bench) -> None:
    problem = bench.ERROR_PROBLEMS["errors_sheet"]
    values = {"program": "kratos", "steps": 20, "n": 4}
    numbers = {"cpu": 2.0, "error": 1e-3, "unknowns": 75, "unconverged": 3}
    points = [Result(values, {}, 1.0, failed="no convergence"), Result(values, numbers, 1.0)]
    _, failed, unconverged = bench.point_rows(problem, points)
    assert failed[-1] == "failed"
    assert unconverged[2:] == ["75", "0.001", "2", "3 of 20 steps unconverged"]


@pytest.mark.skipif(
    "OMPI_COMM_WORLD_SIZE" in os.environ or "PMI_SIZE" in os.environ,
    reason="an mpirun cannot start another",
)
def test_a_quick_form_solves_draws_and_stores(tmp_path: Path) -> None:
    command = [sys.executable, str(BENCHMARKS), "errors_strip", "--quick", "--runs", "1"]
    done = subprocess.run(
        [*command, "--out", str(tmp_path)], capture_output=True, text=True, timeout=HANG_TIMEOUT
    )
    assert done.returncode == 0, done.stderr
    rows = csv.DictReader((tmp_path / "errors_strip" / "runs.csv").open())
    coarse, fine = (float(row["error [%]"]) for row in rows)
    # Order two on 4 and 6 cells along the strip.
    # (4/6)² = 0.44; 0.6 leaves room for other errors.
    assert fine < 0.6 * coarse
    assert (tmp_path / "errors_strip" / "errors_strip.png").is_file()
