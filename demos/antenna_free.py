"""The membrane antenna free in space, spun up and let go: nothing may be lost while its film switches states.

The antenna of `demos/antenna_attitude.py` without joint and control, thrown into a spin about an axis between the
film's normal and its plane; then the energy, the momentum and the angular momentum stay as they are.

    ./gossamer demo antenna_free
"""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import gossamer_fx as gx
from demos.antenna_attitude import antenna
from gossamer_fx.running.stepping import Stepper
from gossamer_fx.simulate import relative_drift

SPIN = (0.3, 0.1, 1.0)  # rad/s
DRIFT = (0.1, 0.0, 0.05)  # m/s


def main(
    film_cells: int = 3,
    boom_elements: int = 6,
    steps: int = 10000,
    dt: float = 5e-3,
    order: int = 1,
    stepper: Stepper | None = None,
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Run `steps` steps of `dt` [s]; all drifts are relative to the start."""
    model = antenna(comm, film_cells, boom_elements, order)
    outputs: list = [gx.Progress()]
    if output is not None:
        outputs.append(gx.Ledger(Path(output) / "ledger.csv"))
    motion = gx.RigidMotion(spin=SPIN, velocity=DRIFT)
    run = gx.Simulation(gx.Scene(*model.items, motion), stepper or gx.Midpoint(dt=dt), outputs)
    run.run(until=steps * dt)
    first, last = run.first, run.totals
    assert run.system.constraints is not None
    return {
        "energy_drift": abs(last.energy / first.energy - 1),
        "linear_momentum_drift": relative_drift(last.momentum, first.momentum),
        "angular_momentum_drift": relative_drift(last.angular_momentum, first.angular_momentum),
        "constraint_error": run.system.constraints.violation(run.system.q0),
        "stored_over_kinetic": sum(last.stored.values()) / last.kinetic,
        "newton_per_step": run.iterations / run.step,
        "substeps": run.substeps,
        "dofs": run.system.numbering.size,
        "seconds": run.seconds,
    }


if __name__ == "__main__":
    for key, value in main(output="out/antenna_free").items():
        if MPI.COMM_WORLD.rank == 0:
            print(f"{key:24} {value:.6g}")
