"""Cells of CSV files that spreadsheets do not run as formulas."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

# With these a cell begins a formula for a spreadsheet, which may start programs.
_FORMULAS = ("=", "+", "-", "@")


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
