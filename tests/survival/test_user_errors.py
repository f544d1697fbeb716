"""Errors of the user's functions during a run: one sentence on all ranks, and the last good state
is saved."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import gossamer_fx as gx
from tests.survival.on_ranks import complete, complete_module

WORDS = {
    "pressure": r"Pressure 'pressure' at t = 0.0035 s: it raises ZeroDivisionError \(of the user\); correct its fun",
    "nan": r"Pressure 'other pressure' at t = 0.0035 s: it returns nan; it must return a finite number.",
    "force": r"'force' at t = 0.0035 s: it raises ZeroDivisionError",
    "differs": r"'second' at t = 0.0035 s: it differs from rank to rank",
    "valve": r"Orifice 'valve': its area at t = 0.0035 s: it raises ZeroDivisionError",
    "event": r"At 'act' at t = 0.004 s: it raises ZeroDivisionError",
    "when": r"When 'look' at t = 0.003 s: it raises ZeroDivisionError",
    "probe": r"Probe 'a' at t = 0.003 s: it raises ZeroDivisionError",
}
# the step of the last good state
LAST = dict.fromkeys(WORDS, 3) | {"event": 4, "when": 2, "probe": 3}


def run(
    folder: Path, what: str, ranks: int, rank: int, *options: str
) -> subprocess.CompletedProcess[str]:
    return complete_module("user_errors", folder, what, rank, *options, ranks=ranks)


def steps(path: Path) -> list[int]:
    with path.open(newline="") as file:
        return [int(row["step"]) for row in csv.DictReader(file)]


@pytest.mark.parametrize("what", [name for name in WORDS if name != "differs"])
def test_the_good_state_before_an_error_is_kept(tmp_path: Path, what: str) -> None:
    """And the mended run goes on from it with complete files."""
    said = run(tmp_path, what, 1, -1)
    assert said.returncode == 2 and re.search(f"told: {WORDS[what]}", said.stdout), said
    assert "Traceback" not in said.stderr
    assert (
        gx.run.latest_checkpoint(tmp_path / "saves")
        == tmp_path / "saves" / f"step-{LAST[what]:08d}"
    )
    assert json.loads((tmp_path / "run" / "run.json").read_text())["status"].startswith("stopped: ")
    mended = run(tmp_path, "nothing", 1, -1, "--restart")
    changed = re.search(r"told: .* of another scene: .*; restart with the same", mended.stdout)
    assert (mended.returncode == 2 and changed) or mended.returncode == 0, mended
    if mended.returncode == 0:
        for name in ("ledger.csv", "last.csv", "run/ledger.csv", "run/probes.csv"):
            assert steps(tmp_path / name) == list(range(7)), name


@pytest.mark.parametrize("what", WORDS)
def test_an_error_on_one_rank_is_told_on_all(tmp_path: Path, what: str) -> None:
    said = run(tmp_path, what, 2, 1)
    assert said.returncode == 2, said
    assert len(re.findall(f"told: {WORDS[what]}", said.stdout)) == 2, said.stdout
    assert (
        gx.run.latest_checkpoint(tmp_path / "saves")
        == tmp_path / "saves" / f"step-{LAST[what]:08d}"
    )


@pytest.mark.parametrize("what", ["pressure", "event", "probe"])
def test_one_rank_that_ends_the_program_is_an_error_on_all(tmp_path: Path, what: str) -> None:
    """Both ranks would wait for each other for ever."""
    said = run(tmp_path, what, 2, 1, "--exit")
    words = WORDS[what].split("it raises")[0] + r"it raises SystemExit \(3\)"
    assert said.returncode == 2, said
    assert len(re.findall(f"told: {words}", said.stdout)) == 2, said.stdout
    assert gx.run.latest_checkpoint(tmp_path / "saves")


def test_a_function_that_ends_the_program_on_all_ranks_ends_it(tmp_path: Path) -> None:
    for ranks in (1, 2):
        assert run(tmp_path / str(ranks), "event", ranks, -1, "--exit").returncode == 3


@pytest.mark.parametrize("rank", [0, 1])
def test_a_scene_that_one_rank_refuses_ends_the_program(tmp_path: Path, rank: int) -> None:
    said = run(tmp_path, "scene", 2, rank, "raise")
    assert said.returncode != 0
    assert "InputError: This scene is refused." in said.stderr and "failed alone" in said.stderr


def test_a_failed_step_shows_one_traceback(tmp_path: Path) -> None:
    code = """
import gossamer_fx as gx
from tests.survival.scenes import *
film = next(iter(fluttering_sheet(MPI.COMM_WORLD, 2).items))
tight = gx.Midpoint(dt=1e-2, tolerances=gx.Tolerances(max_iterations=1))
gx.Simulation(gx.Scene(film), tight).run(until=1.0)
"""
    said = complete([sys.executable, "-c", code])
    assert re.search(r"StepFailure: The step at t = \S+ s failed", said.stderr)
    assert said.stderr.count("Traceback (most recent call last)") == 1
