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
    folder: Path, phase: str, *options: str, cache: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """The command that runs the scene, to its end."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PHASE": phase}
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


def test_while_a_kernel_is_compiled(tmp_path: Path) -> None:
    """The next run compiles what was left unfinished."""
    said = command(tmp_path / "run", "compilation", cache=tmp_path)
    assert said.returncode == 128 + signal.SIGINT, said.stderr
    assert "stopped by Ctrl-C" in said.stderr and "Traceback" not in said.stderr
    again = command(tmp_path / "run", "none", cache=tmp_path)
    assert again.returncode == 0, again.stderr
