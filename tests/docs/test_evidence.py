"""Figures of evidence are records: pages are made from them, and each has the command, the day and
the commit that made it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from gossamer_fx.app.cli.demo import demos_of

ROOT = Path(__file__).parents[2]
PAGES = ("first_page", "benchmark", "findings", "measured", "performance", "sources")
PAGES += ("verification", "choose", "damping", "files", "fold", "folded_tube", "modes", "statics")
PAGES += ("step_size", "contact", "gas", "gradients", "orbit", "plates", "reduction", "step")
PAGES += ("thermal", "wrinkling")
# Parts that other commands make from result files, which have their own tests.
MADE_ELSEWHERE = re.compile(
    r"<!-- (measured|benchmark|spread)( \w+)? -->.*?<!-- /\1 -->", re.DOTALL
)
# Tables of other things: the form and the inputs of case files, calls, laws and their choice.
NOT_EVIDENCE = {"measured": 4, "choose": 1, "contact": 1, "damping": 2, "files": 1, "statics": 3}


@pytest.fixture
def evidence(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    import evidence

    return evidence


def test_every_file_of_records_has_its_page(evidence) -> None:
    assert sorted(PAGES) == sorted(evidence.PAGES)
    assert sorted(PAGES) == sorted(path.stem for path in evidence.FOLDER.glob("*.toml"))


@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_made_from_its_records(evidence, page: str) -> None:
    assert evidence.made(page) == evidence.PAGES[page].read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES)
def test_every_table_of_evidence_has_records(evidence, page: str) -> None:
    text = evidence.PAGES[page].read_text(encoding="utf-8")
    rest = evidence._BETWEEN.sub("", MADE_ELSEWHERE.sub("", text))
    without = re.findall(r"^\|[-| :]+\|$", rest, re.MULTILINE)
    assert len(without) == NOT_EVIDENCE.get(page, 0)
    # And no record is left that no page shows.
    shown = [name for name, _ in evidence._BETWEEN.findall(text)]
    assert sorted(shown) == sorted(evidence.tables(page))


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


@pytest.mark.parametrize("page", PAGES)
def test_a_cell_holds_one_value_and_its_unit_is_said(evidence, page: str) -> None:
    remarks = [one for table in evidence.tables(page).values() for one in table.remarks()]
    assert not remarks, "\n".join(remarks)


@pytest.mark.parametrize(
    "head, cell",
    [
        ("rings [ms]", "4.45, 5.90"),
        ("tips apart [m]", "0.709; 0.700"),
        ("time [s]", "0.25 s"),
        ("lost energy [J]", "0.164 of 0.2"),
        ("opens after", "162"),
        ("ratio", "energy; gas"),
        ("errors", "0.08 mm at 1 s, 0.49 mm at 2 s"),
    ],
)
def test_a_cell_with_more_than_a_value_is_named(evidence, head: str, cell: str) -> None:
    entry = {"name": "one", "columns": ["run", head], "rows": [{"cells": ["a", cell]}]}
    [remark] = evidence.read_table(entry).remarks()
    assert repr(cell) in remark


@pytest.mark.parametrize(
    "head, cell",
    [
        ("rings [ms]", "4.45"),
        ("angle [°]", "45 to 47"),
        ("cells [1]", "3 × 3"),
        ("radius [m]", "0.4188 ± 0.0002"),
        ("error [%]", "within 0.5"),
        ("error [1]", "3e-14"),
        ("opens after [ms]", "never"),
        ("run", "tube with flat ends, damped"),
        ("run", "`sprout.py length=0.6, rows=1`"),
    ],
)
def test_one_value_is_one_value(evidence, head: str, cell: str) -> None:
    entry = {"name": "one", "columns": ["run", head], "rows": [{"cells": ["a", cell]}]}
    assert not list(evidence.read_table(entry).remarks())


def test_a_figure_is_that_of_the_stored_result(evidence) -> None:
    column = {"head": "energy lost [mJ]", "quantity": "lost [J]", "format": ".1f", "factor": 1e3}
    entry = {"name": "one", "columns": ["run", column], "stored": "study:disc"}
    row = {"cells": ["finer"], "case": {"cells": 2}}
    [[_, lost]] = [row.cells for row in evidence.read_table(entry | {"rows": [row]}).rows]
    stored = evidence.read_results(evidence.stored_file("disc", quick=False), "disc")
    [exact] = [one.numbers["lost [J]"] for one in stored if one.values["cells"] == 2]
    assert float(lost) == pytest.approx(1e3 * exact, abs=0.06)
    # A case that is stored twice, one that is not, and a quantity that is not.
    for case, quantity in (({}, "lost [J]"), ({"cells": 3}, "lost [J]"), ({"cells": 2}, "loss")):
        wrong = entry | {"columns": ["run", column | {"quantity": quantity}]}
        with pytest.raises(ValueError, match="stored"):
            evidence.read_table(wrong | {"rows": [{"cells": ["a"], "case": case}]})
