"""Figures of evidence are records: pages are made from them, and each has the command, the day and
the commit that made it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from gossamer_fx.app.cli.demo import demos_of

ROOT = Path(__file__).parents[2]
PAGES = ("first_page", "benchmark", "findings", "measured", "performance", "sources")
PAGES += ("verification",)
# Parts that other commands make from result files, which have their own tests.
MADE_ELSEWHERE = re.compile(
    r"<!-- (measured|benchmark|spread)( \w+)? -->.*?<!-- /\1 -->", re.DOTALL
)
# Tables of other things: the form and the inputs of case files.
NOT_EVIDENCE = {"measured": 2}


@pytest.fixture
def evidence(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    import evidence

    return evidence


@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_made_from_its_records(evidence, page: str) -> None:
    assert evidence.made(page) == evidence.PAGES[page].read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES)
def test_every_table_of_evidence_has_records(evidence, page: str) -> None:
    text = evidence.PAGES[page].read_text(encoding="utf-8")
    rest = evidence._BETWEEN.sub("", MADE_ELSEWHERE.sub("", text))
    without = re.findall(r"^\|[-| :]+\|$", rest, re.MULTILINE)
    assert len(without) == NOT_EVIDENCE.get(page, 0)


def names_of(folder: str, suffix: str) -> set[str]:
    return {path.stem for path in (ROOT / "demos" / folder).glob(f"*{suffix}")} | {"all"}


@pytest.mark.parametrize("page", PAGES)
def test_a_figure_has_a_command_that_exists_a_day_and_a_commit(evidence, page: str) -> None:
    problems = (ROOT / "demos" / "benchmarks" / "problems.toml").read_text(encoding="utf-8")
    benches = set(re.findall(r"^\[(\w+)\]$", problems, re.MULTILINE)) | {"errors", "all"}
    known = {
        "study": names_of("studies", ".py"),
        "validate": names_of("validation/cases", ".toml"),
        "demo": {*demos_of(ROOT / "demos")},
        "bench": benches,
    }
    for table in evidence.tables(page).values():
        for row in table.rows:
            assert len(row.cells) == len(table.columns)
            assert re.fullmatch(r"20\d\d-\d\d-\d\d", row.date), row
            assert re.fullmatch(r"[0-9a-f]{8,40}", row.commit), row
            if not row.has_figures:
                continue
            # Before it there may be options of PETSc.
            found = re.search(r"\./gossamer (\w+)(?: (\S+))?", row.command)
            assert found, f"{page}, {table.name}: no command: {row.cells}"
            command, subject = found.groups()
            if command in known:
                assert (subject or "folded_tube") in known[command], row.command
            elif command in ("run", "test"):
                named = [word for word in row.command.split() if "/" in word and word[0] != "."]
                assert named and (ROOT / named[0]).exists(), row.command
