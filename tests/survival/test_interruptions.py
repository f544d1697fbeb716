"""Ctrl-C in every phase of a scene: one sentence, and nothing that was written is lost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.hanging import HANG_TIMEOUT
from tests.survival.on_ranks import ROOT

SCENE = "tests/survival/interrupted_scene.py"


def command(
    folder: Path, phase: str, *options: str, cache: Path | None = None, number: str = "SIGINT"
) -> subprocess.CompletedProcess[str]:
    """The command that runs the scene, to its end."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PHASE": phase, "SIGNAL": number}
    if cache is not None:
        environment["XDG_CACHE_HOME"] = str(cache)
    words = ["run", SCENE, "--out", str(folder), *options]
    return subprocess.run(
        [sys.executable, "-P", "-m", "gossamer_fx", *words],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=HANG_TIMEOUT,
    )


@pytest.mark.parametrize(
    ("phase", "ranks", "words"),
    [
        ("setup", 1, "stopped by Ctrl-C; nothing is left to go on from"),
        ("setup", 2, "stopped by Ctrl-C; nothing is left to go on from"),
        ("statics", 1, "the system has the state of the last pseudo-step"),
        ("statics", 2, "the system has the state of the last pseudo-step"),
    ],
)
def test_before_the_run(tmp_path: Path, phase: str, ranks: int, words: str) -> None:
    said = command(tmp_path / "run", phase, "--ranks", str(ranks))
    assert said.returncode == 128 + signal.SIGINT, said.stderr
    assert said.stderr.count("\n") == 1 and words in said.stderr, said.stderr
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(("number", "ranks"), [("SIGTERM", 1), ("SIGUSR1", 1), ("SIGTERM", 2)])
def test_a_signal_before_the_first_step_leaves_a_checkpoint(
    tmp_path: Path, number: str, ranks: int
) -> None:
    """A job that is ended while its scene is made goes on as others do."""
    folder = tmp_path / "run"
    said = command(folder, "scene", "--ranks", str(ranks), "--quiet", number=number)
    assert said.returncode == 128 + signal.Signals[number], said.stderr
    assert f"stopped by {number} at t = 0 s, after step 0; restart from" in said.stderr
    assert "--restart" in said.stderr
    assert "Traceback" not in said.stderr
    assert [path.name for path in (folder / "checkpoints").iterdir()] == ["step-00000000"]
    assert command(folder, "none", "--restart").returncode == 0
    assert len((folder / "ledger.csv").read_text().splitlines()) == 8


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(("phase", "step"), [("step", 3), ("writing", 4), ("closing", 6)])
def test_in_the_run(tmp_path: Path, phase: str, step: int, ranks: int) -> None:
    """It ends with its step, as recorded, and a restart goes on to the end."""
    folder = tmp_path / "run"
    said = command(folder, phase, "--ranks", str(ranks))
    assert said.returncode == 128 + signal.SIGINT, said.stderr
    assert said.stderr.count(f"after step {step}; restart from") == 1
    assert "Traceback" not in said.stderr
    recorded = (folder / "ledger.csv").read_text().splitlines()[1:]
    assert len(recorded) == step + 1
    assert command(folder, "none", "--restart").returncode == 0
    again = (folder / "ledger.csv").read_text().splitlines()[1:]
    assert again[: step + 1] == recorded and len(again) == 7


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_signal_before_a_search_ends_it(tmp_path: Path, ranks: int) -> None:
    """There is no scene of which a checkpoint could be written."""
    said = command(tmp_path / "run", "setup", "--ranks", str(ranks), number="SIGTERM")
    assert said.returncode == 128 + signal.SIGTERM, said.stderr
    assert said.stderr.count("\n") == 1 and "was stopped by SIGTERM" in said.stderr, said.stderr
    assert not (tmp_path / "run").exists()


def test_while_a_kernel_is_compiled(tmp_path: Path) -> None:
    """The next run compiles what was left unfinished."""
    said = command(tmp_path / "run", "compilation", cache=tmp_path)
    assert said.returncode == 128 + signal.SIGINT, said.stderr
    assert "stopped by Ctrl-C" in said.stderr and "Traceback" not in said.stderr
    again = command(tmp_path / "run", "none", cache=tmp_path)
    assert again.returncode == 0, again.stderr
