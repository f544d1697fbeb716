"""Tables of evidence as data: ./gossamer python tools/evidence.py [--write].

Each row of a table on a page of evidence is a record of `docs/evidence/PAGE.toml`: its cells, the
command that makes its figures, and the day and commit of the program that made them.  With --write
the tables between `<!-- evidence NAME -->` and `<!-- /evidence -->` are made again from the
records; without, the pages that differ are named, and the code is 1.  A figure is changed in the
record, together with its commit and date.

What a study of `demos.studies.engine.spreads` says of its quantities stands between `<!-- spread
STUDY -->` and `<!-- /spread -->`; it is made from the stored results of the study.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass

from packages import ROOT

sys.path[:0] = [str(ROOT)]

from demos.studies.__main__ import stored_file  # noqa: E402
from demos.studies.engine.named import study_of  # noqa: E402
from demos.studies.engine.spreads import SpreadStudy  # noqa: E402
from gossamer_fx.analysis.cases.results import read_results  # noqa: E402

FOLDER = ROOT / "docs" / "evidence"
# Pages whose tables are evidence, by the name of their file of records.
PAGES = {
    "first_page": ROOT / "README.md",
    **{
        name: ROOT / "docs" / f"{name}.md"
        for name in ("benchmark", "findings", "measured", "performance", "sources", "verification")
    },
}
_SPREAD = re.compile(r"<!-- spread (\w+) -->\n(.*?)<!-- /spread -->", re.DOTALL)
_BETWEEN = re.compile(r"<!-- evidence (\w+) -->\n(.*?)<!-- /evidence -->", re.DOTALL)


@dataclass(frozen=True)
class Row:
    """One row of a table of evidence.

    Attributes:
        cells: as the page shows them.
        command: that makes the figures; may be empty.
        date: of the run, year-month-day.
        commit: of the program that was run, or that brought the row.
    """

    cells: Sequence[str]
    command: str
    date: str
    commit: str

    @property
    def has_figures(self) -> bool:
        """Whether a cell has a digit outside of code and links."""
        text = re.sub(r"`[^`]*`|\([^)]*\.md[^)]*\)", "", " ".join(self.cells))
        return re.search(r"\d", text) is not None


@dataclass(frozen=True)
class Table:
    """A table of evidence: its name, headings and rows."""

    name: str
    columns: Sequence[str]
    rows: Sequence[Row]

    def text(self) -> str:
        """The table in Markdown."""
        lines = [_line(self.columns), "|---" * len(self.columns) + "|"]
        return "\n".join([*lines, *(_line(row.cells) for row in self.rows)]) + "\n"


def _line(cells: Sequence[str]) -> str:
    """One line of a table in Markdown; a cell that is empty has one blank."""
    return "|" + "|".join(f" {cell} " if cell else " " for cell in cells) + "|"


def tables(page: str) -> dict[str, Table]:
    """The tables of a page by name, from its records."""
    file = FOLDER / f"{page}.toml"
    if not file.is_file():
        return {}
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    return {
        entry["name"]: Table(entry["name"], entry["columns"], [Row(**row) for row in entry["rows"]])
        for entry in data["table"]
    }


def made(page: str) -> str:
    """The text of a page with its tables made from the records.

    Raises:
        KeyError: the page has a table that has no records.
    """
    records = tables(page)
    text = PAGES[page].read_text(encoding="utf-8")
    text = _SPREAD.sub(
        lambda found: f"<!-- spread {found[1]} -->\n\n{spread_table(found[1])}\n<!-- /spread -->",
        text,
    )
    return _BETWEEN.sub(
        lambda found: (
            f"<!-- evidence {found[1]} -->\n\n{records[found[1]].text()}\n<!-- /evidence -->"
        ),
        text,
    )


def spread_table(name: str) -> str:
    """The table of a study of spreads, from its stored results, with a line on what was varied."""
    study = study_of(name)
    if not isinstance(study, SpreadStudy):
        raise SystemExit(f"{name} is not a study of spreads; give one that is.")
    return study.spread(read_results(stored_file(name, quick=False), name)).table()


def main(words: Sequence[str]) -> int:
    """Compare the pages with their records, or write them."""
    code = 0
    for page, path in PAGES.items():
        text = made(page)
        if text == path.read_text(encoding="utf-8"):
            continue
        if "--write" in words:
            path.write_text(text, encoding="utf-8")
        else:
            print(f"{path.relative_to(ROOT)} is not as its records; run this with --write.")
            code = 1
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
