"""Numbers of a recorded run or equilibrium, for tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.cases.results import EXTREMES, LAST
from gossamer_fx.core.checks.errors import on_rank_zero


def recorded_numbers(comm: MPI.Intracomm, folder: Path) -> dict[str, float]:
    """Results of a recorded run by name: of its probes and of the pressures of its chambers.
    Collective.

    Returns:
        "... at the end", "... smallest" and "... largest" for each probe, in the unit of the probe,
        and "... pressure [Pa] at the end" for each chamber.

    Raises:
        InputError: the folder holds no run.
    """
    return dict(comm.bcast(on_rank_zero(comm, lambda: _read_numbers(folder))))


def _read_numbers(folder: Path) -> dict[str, float]:
    """What `recorded_numbers` returns, on one rank."""
    from gossamer_fx.records.plot.run_tables import RunTables

    run = RunTables(folder)
    columns = run.table("probes.csv").items()
    probes = {name: values for name, values in columns if name not in run.not_values}
    numbers = {f"{name}{LAST}": float(values[-1]) for name, values in probes.items()}
    for name, values in run.table("gas.csv").items():
        if name.endswith(" pressure"):
            numbers[f"{name} [Pa]{LAST}"] = float(values[-1])
    for name, values in probes.items():
        for kind, of in zip(EXTREMES, (np.min, np.max), strict=True):
            numbers[f"{name}{kind}"] = float(of(values))
    return numbers
