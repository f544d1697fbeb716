"""The membrane antenna free in space, spun up and let go: nothing may be lost while its film
switches states.

The antenna of the demo `antenna_attitude` without joint and control, thrown into a spin about an
axis between the film's normal and its plane; then the energy, the momentum and the angular momentum
stay as they are.

    ./gossamer demo antenna_free
    ./gossamer run demos/antennas/antenna_free.py until=5 --output out/antenna
    ./gossamer report out/antenna
"""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import gossamer_fx as gx
from demos.antennas.antenna_attitude import antenna
from demos.common.deployment import effort, print_figures, run_case
from gossamer_fx.solve.steppers.stepping import Stepper
from gossamer_fx.solve.system.totals import relative_drift

SPIN = (0.3, 0.1, 1.0)  # rad/s
DRIFT = (0.1, 0.0, 0.05)  # m/s


def build(
    comm: MPI.Comm,
    cells: int = 3,
    elements: int = 6,
    until: float = 50.0,
    dt: float = 5e-3,
    order: int = 1,
) -> gx.Case:
    """The antenna with cells × cells squares of film, booms of `elements`, until a time [s] in
    steps of `dt` [s]."""
    motion = gx.RigidMotion(spin=SPIN, velocity=DRIFT)
    scene = gx.Scene(*antenna(comm, cells, elements, order).items, motion)
    return gx.Case(
        scene, gx.Midpoint(dt=dt), until=until, title="The membrane antenna, free in space"
    )


def main(
    steps: int = 10000,
    dt: float = 5e-3,
    stepper: Stepper | None = None,
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
    **given: int,
) -> dict[str, float]:
    """Run `steps` steps of `dt` [s] of what `build` makes of the numbers given; drifts are relative
    to the start.

    With `output`, a folder: the recording, and a picture.
    """
    case = build(comm, until=steps * dt, dt=dt, **given)
    run, _ = run_case(case, output, "antenna_free", (0.1, 0.6, 1.0), stepper=stepper)
    first, last = run.first, run.totals
    assert run.system.constraints is not None
    return {
        "energy_drift": abs(last.energy / first.energy - 1),
        "linear_momentum_drift": relative_drift(last.momentum, first.momentum),
        "angular_momentum_drift": relative_drift(last.angular_momentum, first.angular_momentum),
        "constraint_error": run.system.constraints.violation(run.system.q0),
        "stored_over_kinetic": sum(last.stored.values()) / last.kinetic,
        **effort(run),
    }


if __name__ == "__main__":
    # A finer film than that of the paper, so that the picture shows where it wrinkles.
    print_figures(main(steps=2000, cells=9, elements=18, output="out/antenna_free"))
