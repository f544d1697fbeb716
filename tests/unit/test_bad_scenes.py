"""Bad inputs of whole scenes, generated and by hand: one sentence each, never a traceback, never
taken in silence.

The default tests take some of the generated ones; all of them, about two minutes:

    ./gossamer python -m pytest -m slow -s tests/unit/test_bad_scenes.py
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

import gossamer_fx as gx
from tests.unit.bad_scenes import generated, handwritten, scenes

pytestmark = pytest.mark.skipif(
    MPI.COMM_WORLD.size > 1, reason="each rank would make the same small scenes"
)

TOLD = (gx.InputError, gx.StepFailure, gx.NoEquilibrium, gx.OutputFailure)


def outcome(act: Callable[[], Any]) -> tuple[str, str]:
    """Whether it is told in a sentence, ends in a traceback, or is taken in silence; and the
    words."""
    try:
        act()
    except TOLD as error:
        words = str(error)
        return (
            "sentence"
            if "\n" not in words and words.endswith(".") and len(words) < 700
            else "no sentence"
        ), words
    except Exception as error:
        return "traceback", f"{type(error).__name__}: {error}"
    return "silent", ""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.d").mkdir()
    return tmp_path


@pytest.mark.parametrize(
    "scene", ["film", "gas", "plate", "crease", "contact", "orbit", "boom", "static", "run"]
)
def test_the_scenes_run_as_they_are(here: Path, scene: str) -> None:
    act, parameters = scenes(here)[scene]
    act({name: value for name, (value, _) in parameters.items()})


@pytest.mark.parametrize("every", [35, pytest.param(1, marks=pytest.mark.slow)])
def test_generated_bad_inputs_are_told(here: Path, every: int) -> None:
    counts: Counter[str] = Counter()
    wrong = []
    for what, act in islice(generated(here), 0, None, every):
        kind, words = outcome(act)
        counts[kind] += 1
        if kind != "sentence":
            wrong.append(f"{kind}: {what}: {words}")
    print(f"{counts.total()} generated bad inputs: {dict(counts)}")
    assert not wrong, "\n".join(wrong)
    assert counts.total() >= (1000 if every == 1 else 25)


def test_handwritten_bad_inputs_are_told(here: Path) -> None:
    cases = handwritten(here)
    assert len(cases) >= 60
    counts: Counter[str] = Counter()
    wrong = []
    for what, (act, culprit) in cases.items():
        kind, words = outcome(act)
        counts[kind] += 1
        if kind != "sentence" or culprit not in words:
            wrong.append(f"{kind}: {what}: {words}")
    print(f"{counts.total()} handwritten bad inputs: {dict(counts)}")
    assert not wrong, "\n".join(wrong)
