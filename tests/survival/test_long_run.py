"""A run of 1e5 steps: invariants drift by round-off only, and memory is constant."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.solve.system.totals import relative_drift
from tests.survival.scenes import DT, fluttering_sheet

STEPS = 100_000
MASS = 0.14  # of the sheet: kg
SPEED = 5.0  # m/s


def resident(_: gx.Simulation) -> float:
    """Memory of this process [MB]."""
    line = next(
        line
        for line in Path("/proc/self/status").read_text().splitlines()
        if line.startswith("VmRSS")
    )
    return int(line.split()[1]) / 1024


@pytest.mark.slow
def test_a_sheet_flutters_for_long(tmp_path: Path) -> None:
    """Equations are solved to round-off; its share grows as the sheet flies away, 0.4 m a
    second."""
    probes = {
        "energy": lambda run: run.energy_error,
        "momentum": lambda run: relative_drift(
            run.totals.momentum, run.first.momentum, scale=MASS * SPEED
        ),
        "angular momentum": lambda run: relative_drift(
            run.totals.angular_momentum, run.first.angular_momentum
        ),
        "memory": resident,
    }
    stepper = gx.Midpoint(dt=DT, tolerances=gx.Tolerances(relative=1e-12))
    outputs = [gx.outputs.Probes(tmp_path / "long.csv", probes, every=1000), gx.outputs.Progress()]
    saves = gx.Checkpoints(tmp_path / "checkpoints", every=1000)
    run = gx.Simulation(
        fluttering_sheet(MPI.COMM_SELF), stepper, outputs=outputs, checkpoints=saves
    )
    run.run(until=STEPS * DT)
    assert run.step == STEPS
    table = np.genfromtxt(tmp_path / "long.csv", delimiter=",", names=True)
    print(
        f"{table[-1]}, {run.iterations / run.step:.2f} iterations a step, {run.substeps} steps "
        "rejected"
    )
    position = 1 + 0.4 * table["time"]  # m
    round_off = 4 * np.finfo(float).eps * table["step"] * position
    for name in ("energy", "momentum", "angular_momentum"):
        assert (np.abs(table[name][1:]) <= round_off[1:]).all(), name
    assert np.ptp(table["memory"][2:]) <= 3.0
