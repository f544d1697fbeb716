"""The page of errors against CPU time: it shows the stored results, and its problems can be
solved."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.hanging import HANG_TIMEOUT

ROOT = Path(__file__).parents[2]
BENCHMARKS = ROOT / "demos" / "benchmarks"
RESULTS = sorted((BENCHMARKS / "results").glob("*.json"))


@pytest.fixture
def error_curves(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import error_curves

    return error_curves


def test_the_page_shows_what_is_stored(error_curves) -> None:
    page = error_curves.PAGE.read_text(encoding="utf-8")
    assert error_curves.BETWEEN.search(page)[0] == error_curves.page_part()
    # At least four problems are stored, or the page is empty.
    assert len(RESULTS) >= 4


@pytest.mark.parametrize("path", RESULTS, ids=[path.stem for path in RESULTS])
def test_stored_points_are_those_of_the_problem(error_curves, path: Path) -> None:
    stored = json.loads(path.read_text(encoding="utf-8"))
    problem = error_curves.ERROR_PROBLEMS[stored["problem"]]
    asked = [(program, words) for program, cases in problem.curves.items() for words in cases]
    assert [(point["program"], point["words"]) for point in stored["points"]] == asked
    for point in stored["points"]:
        assert "failure" in point or (point["cpu"] > 0 and point["error"] > 0)
    assert path.with_suffix(".png").is_file()


def test_a_failure_is_a_remark_and_unconverged_steps_are_counted(error_curves) -> None:
    problem = error_curves.ERROR_PROBLEMS["errors_sheet"]
    words = {"steps": 20, "n": 4}
    points = [
        {"program": "kratos", "words": words, "failure": "no convergence"},
        {
            "program": "kratos",
            "words": words,
            "cpu": 2.0,
            "error": 1e-3,
            "unknowns": 75,
            "unconverged": 3,
        },
    ]
    failed, unconverged = error_curves.table(problem, {"points": points}).splitlines()[2:]
    assert failed.endswith("| failed |")
    assert unconverged.endswith("| 75 | 0.001 | 2 | 3 of 20 steps unconverged |")


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
    points = json.loads((tmp_path / "errors_strip.json").read_text(encoding="utf-8"))["points"]
    coarse, fine = (point["error"] for point in points)
    # Order two on 4 and 6 cells along the strip.
    # (4/6)² = 0.44; 0.6 leaves room for other errors.
    assert fine < 0.6 * coarse
    assert (tmp_path / "errors_strip.png").is_file()
