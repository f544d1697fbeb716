"""The ledger of energy, momentum and mass, as a file; and a progress line."""

from __future__ import annotations

import csv
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

from gossamer_fx.simulate import Simulation, make_parent


class Ledger:
    """CSV with a row for every step: energies [J], momenta, gas masses [kg], the closing errors, iterations.

    `energy_error` is (H - H0) - (supplied - dissipated) over the largest energy so far, H kinetic and stored energy
    (that of the gas included); supplied and dissipated are counted from the start.
    """

    times: Sequence[float] = ()

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._file: IO[str] | None = None

    def open(self, run: Simulation) -> None:
        make_parent(run.comm, self.path)
        if run.comm.rank == 0:
            self._file = self.path.open("w", newline="")
            self._writer = csv.writer(self._file)
            self._writer.writerow(self._row(run))

    def _row(self, run: Simulation) -> dict[str, Any]:
        t = run.totals
        row: dict[str, Any] = {"time": t.time, "step": run.step, "iterations": run.last_iterations}
        row |= {"substeps": run.substeps, "kinetic": t.kinetic}
        row |= {f"stored {name}": energy for name, energy in t.stored.items()}
        row |= {"supplied": t.supplied, "dissipated": t.dissipated, "energy_error": run.energy_error}
        row |= {f"momentum {axis}": p for axis, p in zip("xyz", t.momentum, strict=True)}
        row |= {f"angular momentum {axis}": p for axis, p in zip("xyz", t.angular_momentum, strict=True)}
        if t.mass:
            row |= {"gas mass": t.mass, "gas mass supplied": t.mass_supplied, "mass_error": run.mass_error}
        return row

    def record(self, run: Simulation, last: bool) -> None:
        row = self._row(run)
        if run.comm.rank == 0:
            if self._file is None:  # a run that goes on
                self._file = self.path.open("a", newline="")
                self._writer = csv.writer(self._file)
            self._writer.writerow([repr(float(v)) if isinstance(v, float) else v for v in row.values()])
            self._file.flush()

    def close(self, run: Simulation) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None


class Progress:
    """A line on the terminal of rank 0: time, step, iterations, ledger error; a summary at the end."""

    times: Sequence[float] = ()

    def __init__(self, stream: IO[str] | None = None, seconds: float = 0.5) -> None:
        self._stream = stream or sys.stderr
        self._pause, self._shown = seconds, 0.0

    def open(self, run: Simulation) -> None:
        self._live = self._stream.isatty()
        if not self._live:
            self._pause = max(self._pause, 10.0)
        self._print(run, f"{run.system.numbering.size} unknowns, compiled in {run.compile_seconds:.1f} s\n")

    def _print(self, run: Simulation, text: str) -> None:
        if run.comm.rank == 0:
            self._stream.write(text)
            self._stream.flush()

    def record(self, run: Simulation, last: bool) -> None:
        now = time.monotonic()
        # every rank must agree to look at the totals; rank 0's clock decides
        if run.comm.bcast(now - self._shown < self._pause and not last):
            return
        self._shown = now
        line = (
            f"t = {run.time:.6g} of {run.until:.6g} s   step {run.step}   iterations {run.last_iterations}   "
            f"ledger {run.energy_error:+.1e}"
        )
        self._print(run, ("\r" + line.ljust(79)) if self._live else line + "\n")

    def close(self, run: Simulation) -> None:
        steps = max(run.step, 1)
        summary = (
            f"{run.step} steps in {run.seconds:.1f} s, {run.iterations / steps:.1f} iterations a step, "
            f"{run.substeps} halved; energy closes to {run.energy_error:.1e}"
        )
        if run.totals.mass:
            summary += f", gas mass to {run.mass_error:.1e}"
        self._print(run, ("\n" if self._live else "") + summary + "\n")
