"""One rank that ends alone, or never returns: all ranks end, in one sentence, and the last
checkpoint stays."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from mpi4py import MPI

import gossamer_fx as gx
from tests.hanging import HANG_TIMEOUT
from tests.survival.on_ranks import ROOT, complete_module

SCENE = Path(__file__).with_name("one_rank_scene.py")
PLACES = ("probe", "load", "output", "file", "build")
ENDS = ("exit", "ctrl-c", "os-exit", "abort")
USUAL = {("probe", "exit"), ("load", "os-exit")}

# Of a rank that exits with the code zero.
WAIT_FOR_IT = "at the end of its script or by sys.exit, and the others, which wait for it, with it;"

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts ranks")


def run(
    folder: Path, place: str, how: str, *words: str, ranks: int = 2
) -> subprocess.CompletedProcess[str]:
    """Run the scene by the command."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PLACE": place, "HOW": how}
    given = [str(SCENE), "-o", str(folder), "-n", str(ranks), "--checkpoint", "2", *words]
    return subprocess.run(
        [sys.executable, "-P", "-m", "gossamer_fx", "run", *given],
        env=environment,
        capture_output=True,
        text=True,
        timeout=HANG_TIMEOUT,
    )


@pytest.mark.parametrize(
    ("place", "how"),
    [
        pytest.param(place, how, marks=() if (place, how) in USUAL else pytest.mark.slow)
        for place in PLACES
        for how in ENDS
    ],
)
def test_all_ranks_end_in_a_sentence(tmp_path: Path, place: str, how: str) -> None:
    done = run(tmp_path / "out", place, how)
    assert done.returncode != 0
    sentences = [line for line in done.stderr.splitlines() if line.startswith("gossamer: ")]
    # Both ranks may say the sentence of an error on all.
    assert len(set(sentences)) == 1 and sentences[0].endswith("."), done.stderr
    if place in ("probe", "load", "output"):
        assert gx.run.latest_checkpoint(tmp_path / "out" / "checkpoints")


@pytest.mark.parametrize(
    ("place", "ranks"),
    [
        ("load", 2),
        *(pytest.param(place, 1, marks=pytest.mark.slow) for place in PLACES),
        *(pytest.param(place, 2, marks=pytest.mark.slow) for place in PLACES if place != "load"),
    ],
)
def test_a_function_that_never_returns_is_ended_on_demand(
    tmp_path: Path, place: str, ranks: int
) -> None:
    done = run(tmp_path / "out", place, "never", "--no-progress-after", "8", ranks=ranks)
    assert done.returncode == 1, done.stderr
    sentences = [line for line in done.stderr.splitlines() if line.startswith("gossamer: ")]
    assert len(sentences) == 1, done.stderr
    assert "No step has been completed for 8 s" in sentences[0]
    assert f"'{SCENE.name}', line " in sentences[0] and f"on rank {ranks - 1};" in sentences[0]
    if place in ("probe", "load", "output"):
        assert gx.run.latest_checkpoint(tmp_path / "out" / "checkpoints")


@pytest.mark.parametrize("word", ["0", "-1", "nan", "inf", "soon"])
def test_a_time_without_progress_is_positive(tmp_path: Path, word: str) -> None:
    done = run(tmp_path / "out", "probe", "exit", f"--no-progress-after={word}")
    assert done.returncode == 2
    assert f"'{word}' is not a positive number of seconds" in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("alone", "gossamer: rank 1 has ended alone by sys.exit(3), and the others with it;"),
        ("raised", "gossamer: rank 1 has ended alone by sys.exit('a word'), and the others"),
        ("error", "gossamer: rank 1 failed alone by ValueError (a word) in the lines above;"),
        ("zero", WAIT_FOR_IT),
        ("zero in a library", WAIT_FOR_IT),
    ],
)
def test_a_rank_of_a_script_that_ends_alone_ends_all(how: str, words: str) -> None:
    done = complete_module("exiting_script", how, ranks=2)
    assert done.returncode != 0
    assert words in done.stderr, done.stderr


@pytest.mark.parametrize("how", ["all", "one at the end", "caught"])
def test_ranks_of_a_script_may_exit_with_different_codes(how: str) -> None:
    done = complete_module("exiting_script", how, ranks=2)
    assert "gossamer: " not in done.stderr, done.stderr
    assert (done.returncode == 0) == (how == "caught")


def test_a_rank_goes_on_alone_after_the_others_have_exited() -> None:
    done = complete_module("exiting_script", "goes on", ranks=2)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "has gone on\n"
    assert "gossamer: " not in done.stderr, done.stderr
