"""Tables of evidence as data: ./gossamer python tools/evidence.py [--write].

A figure is a record of `docs/evidence/PAGE.toml`.  It has a value (a cell), a unit and what it is
(the heading of its column and the text of its row), a reference in another column of the row if it
is compared, and the command, the day and the commit of the program that made it.  A row that does
not give one of the last three has that of its table.

A cell holds one value, with its unit in the heading, as in "time [ms]", or in a column "unit".
"[1]" is the unit of what has none, and is not shown.  A column may be
`{head = "time [ms]", quantity = "opened [s]", format = ".1f", factor = 1e3}`: then its cells are
not written, but taken from the stored result that is named by the row (`case = {cells = 2}`) and
the table or row (`stored = "study:disc"`); see `stored_figures`.  A single cell may be such a
record, too.  With `show_command = true` the last column has the command of each row.

With --write the tables between `<!-- evidence NAME -->` and `<!-- /evidence -->` are made again
from the records; without, pages that differ and cells that hold more than one value are named,
and the code is 1.  A figure is changed in the record, or stored again by its command.

What a study of `demos.studies.engine.spreads` says of its quantities stands between `<!-- spread
STUDY -->` and `<!-- /spread -->`; it is made from the stored results of the study.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import stored_figures
from packages import ROOT

sys.path[:0] = [str(ROOT)]

from demos.studies.__main__ import stored_file  # noqa: E402
from demos.studies.engine.named import study_of  # noqa: E402
from demos.studies.engine.spreads import SpreadStudy  # noqa: E402
from gossamer_fx.analysis.answer_spread import Spread, rounded  # noqa: E402
from gossamer_fx.analysis.cases.results import (  # noqa: E402
    markdown_table,
    read_results,
    value_text,
)

FOLDER = ROOT / "docs" / "evidence"
THEORY = (
    "contact",
    "gas",
    "gradients",
    "orbit",
    "plates",
    "reduction",
    "step",
    "thermal",
    "wrinkling",
)
GUIDES = ("choose", "damping", "fold", "modes", "statics", "step_size")
# Pages with tables of evidence, by the name of their file of records.
PAGES = {
    "first_page": ROOT / "README.md",
    "benchmark": ROOT / "docs" / "benchmark.md",
    "files": ROOT / "docs" / "files.md",
    "findings": ROOT / "docs" / "findings.md",
    "measured": ROOT / "docs" / "measured.md",
    "performance": ROOT / "docs" / "performance.md",
    "sources": ROOT / "docs" / "sources.md",
    "verification": ROOT / "docs" / "verification.md",
    "folded_tube": ROOT / "docs" / "tutorials" / "folded_tube.md",
    **{name: ROOT / "docs" / "howto" / f"{name}.md" for name in GUIDES},
    **{name: ROOT / "docs" / "theory" / f"{name}.md" for name in THEORY},
}
_SPREAD = re.compile(r"<!-- spread (\w+) -->\n(.*?)<!-- /spread -->", re.DOTALL)
_BETWEEN = re.compile(r"<!-- evidence (\w+) -->\n(.*?)<!-- /evidence -->", re.DOTALL)

# What is not a figure: code, the addresses of links, and names with digits such as "IKAROS 2".
_NO_TEXT = re.compile(r"`[^`]*`|\]\([^)]*\)")
# Thousands may be written with a k, and millions with an M.
_NUMBER = r"[-+±]?\d+(?:\.\d+)?(?:e[-+]?\d+)?[kM]?"
# One value: a number, a range, a product, a number with its deviation, and a word before it.
_VALUE = re.compile(
    rf"(?:(?:within|below|above|about|at most|at least|up to) )?{_NUMBER}"
    rf"(?:(?: to | × | ± |/){_NUMBER})*"
)
_TWO_VALUES = re.compile(rf"{_NUMBER}[^;,\d]*,[^,;]*{_NUMBER}")


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        head: its heading, with the unit in brackets.
        quantity: name of the number of the stored result that fills it; empty: cells are written.
        form: how the number is written, such as ".3g".
        factor: brings it to the unit of the column.
        reduce: what is shown of several results, see `stored_figures.figure`.
    """

    head: str
    quantity: str = ""
    form: str = ".3g"
    factor: float = 1.0
    reduce: str = ""

    @property
    def unit(self) -> str:
        """The unit in the heading; empty if it has none."""
        found = re.search(r"\[([^]]+)\](?!\()", self.head)
        return found[1] if found else ""

    @property
    def text(self) -> str:
        """The heading as the page shows it."""
        return self.head.removesuffix(" [1]")


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
        return re.search(r"\d", _NO_TEXT.sub("", " ".join(self.cells))) is not None


@dataclass(frozen=True)
class Table:
    """A table of evidence: its name, columns and rows."""

    name: str
    columns: Sequence[Column]
    rows: Sequence[Row]

    def text(self) -> str:
        """The table in Markdown."""
        lines = [_line([column.text for column in self.columns])]
        lines.append("|---" * len(self.columns) + "|")
        return "\n".join([*lines, *(_line(row.cells) for row in self.rows)]) + "\n"

    def remarks(self) -> Iterator[str]:
        """Cells that hold more than one value, or a value whose unit is not said."""
        has_units = any(column.head == "unit" for column in self.columns)
        for row in self.rows:
            for column, cell in zip(self.columns, row.cells, strict=True):
                if column.head == "command":
                    continue
                wrong = fault(cell, column, has_units)
                if wrong:
                    yield f"{self.name}, {column.head}, {cell!r}: {wrong}"


def fault(cell: str, column: Column, has_unit_column: bool) -> str:
    """What is wrong with a cell, and what to write; empty if it is well."""
    text = _NO_TEXT.sub("", cell)
    if ";" in text:
        return "unlike things; give each a column or a row."
    if _TWO_VALUES.search(text):
        return "two values; give each a column or a row."
    is_value = _VALUE.fullmatch(text.strip()) is not None
    if is_value and not column.unit and not has_unit_column:
        return "a value without a unit; give the column one, such as [ms] or [1]."
    if column.unit and re.match(r"[-+±]?\d", text) and not is_value:
        return "more than a value; put the unit into the heading and words into another column."
    return ""


def _line(cells: Sequence[str]) -> str:
    """One line of a table in Markdown; a cell that is empty has one blank."""
    return "|" + "|".join(f" {cell} " if cell else " " for cell in cells) + "|"


def tables(page: str) -> dict[str, Table]:
    """The tables of a page by name, from its records."""
    file = FOLDER / f"{page}.toml"
    if not file.is_file():
        return {}
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    return {entry["name"]: read_table(entry) for entry in data["table"]}


def read_table(entry: Mapping[str, Any]) -> Table:
    """A table from its entry in a file of records.

    Raises:
        ValueError: a row has too few or too many cells, or a stored figure does not exist.
    """
    columns = [read_column(column) for column in entry["columns"]]
    shown = [*columns, Column("command")] if entry.get("show_command") else columns
    rows = [read_row(entry, columns, row) for row in entry["rows"]]
    return Table(entry["name"], shown, rows)


def read_column(entry: str | Mapping[str, Any]) -> Column:
    """A column from its heading, or from its entry."""
    if isinstance(entry, str):
        return Column(entry)
    words = {"form" if name == "format" else name: value for name, value in entry.items()}
    return Column(**words)


def read_row(entry: Mapping[str, Any], columns: Sequence[Column], row: Mapping[str, Any]) -> Row:
    """A row of a table; what it does not say is that of the table."""
    said = {name: row.get(name, entry.get(name, "")) for name in ("command", "date", "commit")}
    source = row.get("stored", entry.get("stored", ""))
    written = iter(row["cells"])
    cells = []
    for column in columns:
        if column.quantity and "case" in row:
            cells.append(
                stored_figures.figure(
                    source=source,
                    case=row["case"],
                    quantity=column.quantity,
                    form=column.form,
                    factor=column.factor,
                    reduce=column.reduce,
                )
            )
            continue
        cell = next(written, None)
        if cell is None:
            raise ValueError(f"{entry['name']}: a row has too few cells: {row['cells']}")
        if isinstance(cell, Mapping):
            cell = stored_figures.figure(
                source=cell.get("stored", source),
                case=cell.get("case", {}),
                quantity=cell["quantity"],
                form=cell.get("format", ".3g"),
                factor=cell.get("factor", 1.0),
                reduce=cell.get("reduce", ""),
            )
        cells.append(cell)
    if next(written, None) is not None:
        raise ValueError(f"{entry['name']}: a row has too many cells: {row['cells']}")
    if entry.get("show_command"):
        cells.append(f"`{said['command']}`" if said["command"] else "")
    return Row(cells, **said)


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
    """The table of a study of spreads, from its stored results, with a line for each factor."""
    study = study_of(name)
    if not isinstance(study, SpreadStudy):
        raise SystemExit(f"{name} is not a study of spreads; give one that is.")
    found = study.spread(read_results(stored_file(name, quick=False), name))
    lines = [markdown_table(spread_rows(found))]
    for factor in found.factors:
        usual = f"`{value_text(found.results[0].values[factor])}`"
        others = [f"`{value_text(run.values[factor])}`" for run in found.runs_of(factor)]
        words = ", ".join(others[:-1]) + " and " * bool(others[:-1]) + others[-1]
        lines.append(f"- The factor *{factor}* is usually {usual}. Other runs have {words}.")
    lines += list(scatters(found))
    return "\n".join(lines) + "\n"


def scatters(found: Spread) -> Iterator[str]:
    """A line for each quantity that is statistical: its mean and its scatter."""
    for name in found.names:
        verdict = found.verdict(name)
        if verdict.kind == "statistical":
            words, _, unit = name.removesuffix("]").partition(" [")
            mean = rounded(verdict.value, verdict.deviation)
            deviation = rounded(verdict.deviation, verdict.deviation)
            yield (
                f"- The {words} is statistical, with a mean of {mean} {unit} and a standard "
                f"deviation of {deviation} {unit}."
            )


def spread_rows(found: Spread) -> Iterator[list[str]]:
    """Cells of the table of a spread, one value in each; first the headings."""
    factors = [f"by {factor} [%]" for factor in found.factors]
    yield ["quantity", "unit", "usual run", "verdict", "least", "largest", "most by", *factors]
    for name in found.names:
        verdict = found.verdict(name)
        words, _, unit = name.removesuffix("]").partition(" [")
        usual = f"{found.results[0].numbers[name]:.4g}"
        size = verdict.high - verdict.low
        ends = [rounded(end, size) for end in (verdict.low, verdict.high)]
        changes = [_percent(verdict.changes[factor]) for factor in found.factors]
        yield [words, unit or "1", usual, verdict.kind, *ends, verdict.factor, *changes]


def _percent(change: float) -> str:
    """A relative change in percent with two digits."""
    percent = 100 * change
    return f"{percent:.0f}" if percent >= 100 else f"{percent:.2g}"


def main(words: Sequence[str]) -> int:
    """Compare the pages with their records, or write them."""
    code = 0
    for page, path in PAGES.items():
        for table in tables(page).values():
            for remark in table.remarks():
                print(f"docs/evidence/{page}.toml: {remark}")
                code = 1
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
