"""The table of what goes with what is what the program does."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

TOOLS = Path(__file__).parents[2] / "tools"


@pytest.mark.slow
def test_the_table_of_features_is_what_the_program_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each cell runs, or is refused with the sentence that the page shows."""
    monkeypatch.syspath_prepend(str(TOOLS))
    features = importlib.import_module("features")
    assert features.words() in features.PAGE.read_text(encoding="utf-8")
