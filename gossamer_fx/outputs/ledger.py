"""The ledger of energy, momentum and mass, as a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.outputs.output import Table
from gossamer_fx.probes.run import Run

LOST = "dissipated "  # before the name of a cause


@check_arguments
class Ledger:
    """CSV with a row for every step: energies [J], momenta, gas masses [kg], the closing errors, iterations.

    `energy_error` is (H - H0) - (supplied - dissipated) over the largest energy so far, H kinetic and stored energy
    (that of the gas included); supplied and dissipated are counted from the start.  It is zero at rest, while all
    energies are round-off.  Where several parts dissipate, each has a column in addition to their sum.
    """

    times: Sequence[float] = ()

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._table = Table(self.path)

    @property
    def writes(self) -> Sequence[Path]:
        return [self.path]

    def open(self, run: Run) -> None:
        self._table.create(run.comm, list(self._row(run)))

    def cursor(self) -> dict[str, Any]:
        return self._table.cursor()

    def resume(self, run: Run, cursor: dict[str, Any]) -> None:
        self._table.cut(run.comm, list(self._row(run)), cursor)

    def _row(self, run: Run) -> dict[str, Any]:
        t = run.totals
        row: dict[str, Any] = {"time": t.time, "step": run.step, "iterations": run.last_iterations}
        row |= {"substeps": run.substeps, "kinetic": t.kinetic}
        row |= {f"stored {name}": energy for name, energy in t.stored.items()}
        row |= {"supplied": t.supplied, "dissipated": t.dissipated}
        if len(t.losses) > 1:
            row |= {f"{LOST}{name}": loss for name, loss in t.losses.items()}
        row |= {"energy_error": run.energy_error}
        row |= {f"momentum {axis}": p for axis, p in zip("xyz", t.momentum, strict=True)}
        row |= {
            f"angular momentum {axis}": p for axis, p in zip("xyz", t.angular_momentum, strict=True)
        }
        if t.mass:
            row |= {
                "gas mass": t.mass,
                "gas mass supplied": t.mass_supplied,
                "mass_error": run.mass_error,
            }
        return row

    def record(self, run: Run, last: bool) -> None:
        self._table.append(run.comm, self._row(run).values())

    def close(self, run: Run) -> None:
        pass
