"""The ledger of a run as a file: energies, momenta, gas masses and their closing errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.records.outputs.output import Table
from gossamer_fx.solve.view import StateView

# Beginning of the columns of single causes of dissipation; readers of the table know them by it.
LOST = "dissipated "


@check_arguments
class Ledger:
    """CSV file with a row for every step: energies [J], momenta, gas masses [kg], closing errors,
    iterations.

    The first column is the time [s], or the load parameter of a path of equilibria.

    `energy_error` is (H - H0) - (supplied - dissipated) over the largest energy so far; it is zero
    at rest, while all energies are round-off.  H is the kinetic and stored energy, including that
    of the gas; supplied and dissipated energies are sums from the start.  If several items
    dissipate, each has a column in addition to the sum.

    Args:
        path: of the file.

    Raises:
        InputError: when the run is made: the folder cannot be made or written.

    Example:
        >>> thrown = gx.PointMass(2.0, comm=comm, name="thrown mass")
        >>> ledger = gx.Ledger(folder / "ledger.csv")
        >>> throw = gx.Simulation(gx.Scene(thrown), gx.Midpoint(dt=0.1), outputs=[ledger])
        >>> throw.run(until=0.3)
        >>> (folder / "ledger.csv").read_text().splitlines()[0][:36]
        'time,step,iterations,substeps,kineti'
    """

    times: Sequence[float] = ()

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._table = Table(self.path)

    @property
    def writes(self) -> Sequence[Path]:
        return [self.path]

    def open(self, run: StateView) -> None:
        self._table.create(run.comm, list(self._row(run)))

    def cursor(self) -> dict[str, Any]:
        return self._table.cursor()

    def resume(self, run: StateView, cursor: dict[str, Any]) -> None:
        self._table.cut(run.comm, list(self._row(run)), cursor)

    def _row(self, run: StateView) -> dict[str, Any]:
        """The present state of a run as columns by name; energies in J, momenta in kg m/s and kg
        m²/s.

        Gas masses are in kg; `energy_error` and `mass_error` are relative, and left out where no
        energy is conserved.  Columns of gas are left out if there is no gas.  Collective; the same
        on every rank.
        """
        t = run.totals
        account = run.account
        row: dict[str, Any] = {run.axis.column: run.time, "step": run.step}
        row |= {"iterations": account.last_iterations, "substeps": account.rejected}
        row |= {"kinetic": t.kinetic}
        row |= {f"stored {name}": energy for name, energy in t.stored.items()}
        row |= {"supplied": t.supplied, "dissipated": t.dissipated}
        if len(t.losses) > 1:
            row |= {f"{LOST}{name}": loss for name, loss in t.losses.items()}
        if account.balance is not None:
            row |= {"energy_error": account.balance.energy_error}
        row |= {f"momentum {axis}": p for axis, p in zip("xyz", t.momentum, strict=True)}
        row |= {
            f"angular momentum {axis}": p for axis, p in zip("xyz", t.angular_momentum, strict=True)
        }
        if t.mass:
            row |= {"gas mass": t.mass, "gas mass supplied": t.mass_supplied}
            if account.balance is not None:
                row |= {"mass_error": account.balance.mass_error}
        return row

    def record(self, run: StateView, last: bool) -> None:
        self._table.append(run.comm, self._row(run).values())

    def close(self, run: StateView) -> None:
        pass
