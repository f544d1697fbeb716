"""The tables of a run's folder: what was run, and numbers over the time or over the load."""

from __future__ import annotations

import csv
from array import array
from collections import Counter
from io import TextIOWrapper
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.csv_tables import plain_cell
from gossamer_fx.core.checks.errors import InputError, are_usual_sizes, check
from gossamer_fx.core.checks.strange_files import open_file
from gossamer_fx.core.model.body import Array
from gossamer_fx.records.outputs.run_file import read_run_file
from gossamer_fx.records.outputs.tables import without_units
from gossamer_fx.solve.view import Axis

Tables = dict[str, Array]

# Columns that a table has in any case.
_REQUIRED = {"ledger.csv": ("step", "iterations", "kinetic", "supplied", "dissipated")}
# Columns of a table: 50 000 ropes have six each.
_MAX_COLUMNS = 300_000
# Characters of the name of a column, which is drawn.
_MAX_NAME = 5000


class RunTables:
    """Reads run.json and the tables of a run's folder, and none of its meshes and fields.

    Args:
        folder: of the run.

    Attributes:
        about: the contents of run.json.
        axis: the time [s], or the load parameter of a path of equilibria.

    Raises:
        InputError: it is not the folder of a run, or run.json cannot be read.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self.about: dict[str, Any] = read_run_file(self.folder)
        axis = self.about["axis"]
        self.axis = Axis(axis["name"], axis["unit"])

    @property
    def title(self) -> str:
        """Title of the run, or the name of its folder."""
        return self.about["title"] or self.folder.name

    @property
    def kind(self) -> str:
        """What was recorded: "run", "equilibrium" or "mode"."""
        return str(self.about["kind"])

    # ---- numbers ---------------------------------------------------------------------------------

    @check_arguments
    def table(self, name: str) -> Tables:
        """Columns of a table of the run's folder by their names; empty if the run did not write it,
        or no row of it.
        Those of the energy balance and of gas are named without the units of their heads.

        A last row that is not complete is left out.

        Args:
            name: of the file, e.g. "ledger.csv".

        Returns:
            arrays (n,) in SI units.

        Raises:
            InputError: the file cannot be read, lacks a column, or holds something else than rows
                of numbers up to 1e100.
        """
        path = self.folder / name
        if Path(name).name != name or not path.is_file():
            return {}
        try:
            with TextIOWrapper(open_file(path, self.folder), "utf-8", newline="") as file:
                head, values = _numbers_of(file)
        except InputError:
            raise
        except (OSError, ValueError, csv.Error) as error:
            raise InputError(
                f"'{path}' holds something else than numbers ({error}); write the run again."
            ) from error
        if name in ("ledger.csv", "gas.csv"):
            head = without_units(head)
        twice = [column for column, count in Counter(head).items() if count > 1]
        check(
            not twice,
            f"'{path}' has two columns '{''.join(twice[:1])}'; write the run again.",
        )
        required = (self.axis.column, *_REQUIRED.get(name, ()))
        missing = [column for column in required if column not in head]
        check(
            not missing or not head,
            f"'{path}' has no column '{''.join(missing[:1])}'; write the run again.",
        )
        # A run writes the head with the first row.
        if not len(values):
            return {}
        table: Tables = dict(zip(head, values.T, strict=True))
        # Column by column only to name the one that is wrong, as there may be many.
        for column in () if are_usual_sizes(values) else table:
            numbers: Array = table[column]
            # Some results may be unknown at a time, e.g. the tension of a line.
            if not _needs_all_numbers(name, column) and column != self.axis.column:
                numbers = np.where(np.isnan(numbers), 0.0, numbers)
            check(
                are_usual_sizes(numbers),
                f"'{path}' has a row whose '{column}' is not a number up to 1e100; write the run "
                "again.",
            )
        return table

    @property
    def not_values(self) -> tuple[str, str]:
        """Columns of each table that are not results: that of the axis, and the number of the
        step."""
        return self.axis.column, "step"

    def along(self, table: Tables) -> Array:
        """Values on the axis (n,) of the rows of a table; an empty array without a table."""
        return table.get(self.axis.column, np.zeros(0))


def _needs_all_numbers(table: str, column: str) -> bool:
    """Whether no value of a column of a table may be NaN: what is drawn, and the energy balance."""
    if table in ("points.csv", "masses.csv", "solids.csv", "lines.csv"):
        return True
    return table == "ledger.csv" and not column.endswith(("_error", "residual"))


def _numbers_of(file: TextIO) -> tuple[list[str], Array]:
    """Head and rows of numbers (n, columns) of a CSV file; a last row that is not complete is left
    out.

    Raises:
        ValueError, csv.Error: it holds something else than rows of numbers.
    """
    rows = csv.reader(file)
    head = [plain_cell(cell) for cell in next(rows, [])]
    if len(head) > _MAX_COLUMNS:
        raise ValueError(f"it has {len(head)} columns, more than {_MAX_COLUMNS}")
    if any(len(name) > _MAX_NAME for name in head):
        raise ValueError(f"a column has a name of more than {_MAX_NAME} characters")
    # Numbers only, as the words of all rows would take many times the bytes of the file.
    numbers = array("d")
    incomplete = 0
    for row in rows:
        if incomplete:
            raise ValueError(f"line {incomplete} has another number of cells than the head")
        if len(row) != len(head):
            incomplete = rows.line_num
            continue
        numbers.extend(map(float, row))
    return head, np.array(numbers).reshape(-1, max(len(head), 1))[:, : len(head)]
