"""CSV files: tables of users, and cells that spreadsheets do not run as formulas."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from gossamer_fx.core.checks.errors import InputError, check

# With these a cell begins a formula for a spreadsheet, which may start programs.
_FORMULAS = ("=", "+", "-", "@")


def csv_rows(path: Path) -> list[list[str]]:
    """The rows of a table of a user that are not empty, the first one with the headings.

    Columns are separated by commas, or by semicolons if the first row has no comma; lines that
    begin with # are comments.  `InputError`: the file cannot be read as text in UTF-8.
    """
    check(path.is_file(), f"There is no table '{path}'; give the path of a CSV file.")
    try:
        # Spreadsheets begin a file with a byte order mark, which "utf-8-sig" drops.
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = [line for line in file if not line.lstrip().startswith("#")]
        first = next((line for line in lines if line.strip()), "")
        separator = "," if "," in first else ";"
        rows = csv.reader(lines, delimiter=separator)
        return [row for row in rows if any(cell.strip() for cell in row)]
    except (OSError, UnicodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"The table '{path}' cannot be read ({reason}); save it as CSV in UTF-8."
        ) from error


def safe_cells(values: Iterable[Any]) -> list[Any]:
    """Cells of a row that is written: words that a spreadsheet would take for a formula get an
    apostrophe, which `plain_cell` removes."""
    return [f"'{value}" if _is_formula(value) else value for value in values]


def plain_cell(cell: str) -> str:
    """A word as it was given to `safe_cells`."""
    word = cell.removeprefix("'")
    return word if _is_formula(word) else cell


def _is_formula(value: Any) -> bool:
    """Whether a spreadsheet would take a cell for a formula; a number with a sign is none."""
    if not isinstance(value, str) or not value.lstrip().startswith(_FORMULAS):
        return False
    try:
        float(value)
    except ValueError:
        return True
    return False
