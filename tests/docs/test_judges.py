"""Judges judge: a reference, an aim or a result that is 20 % wrong is noticed, or has a reason."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

TOOLS = Path(__file__).parents[2] / "tools"


@pytest.mark.slow
def test_every_change_of_20_percent_is_noticed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(str(TOOLS))
    judges = importlib.import_module("change_references")
    code = judges.main([])
    assert code == 0, capsys.readouterr().out
