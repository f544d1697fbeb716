"""A free square film spins and flutters; energy and momenta are conserved while it wrinkles.

Film of 1 m × 1 m × 0.1 mm, E = 1 GPa, ν = 0.3, 1400 kg/m³, stress-free, thrown into a spin Ω = 10
rad/s with an out-of-plane velocity sin πx sin πy m/s.  Without load or damping

    H = ½∫ρt|v|² dA + ∫W(E) dA,   P = ∫ρt v dA,   L = ∫ρt x×v dA

stay as they are at the start while every cell switches between taut, wrinkled and slack.

The film flutters faster than the steps resolve.  The picture has the states of means over steps:
in the last 0.2 s 56 % of the film is slack and 1 % taut, and 55 and 1 % with half of the step.  At
the ends of steps 25 % is slack and 5 % taut, and 33 and 4 % with half of the step.

    ./gossamer demo spinning_sheet
    ./gossamer run demos/films/spinning_sheet.py n=30 until=0.2 --output out/sheet
    ./gossamer report out/sheet
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import effort, print_figures, run_case
from gossamer_fx.extend import relative_drift
from gossamer_fx.meshes.sheet import sheet

SPIN = 10.0  # rad/s
TITLE = "A free film, spinning and fluttering"


def throw(x: np.ndarray) -> np.ndarray:
    """Initial velocity [m/s] at the points x (3, n)."""
    X = x[0]
    Y = x[1]
    out_of_plane = np.sin(np.pi * X) * np.sin(np.pi * Y)
    return np.vstack([-SPIN * (Y - 0.5), SPIN * (X - 0.5), out_of_plane])


def build(
    comm: MPI.Comm,
    n: int = 20,
    until: float = 1.0,
    dt: float = 1e-3,
    residual: float = 1e-6,
    order: int = 1,
) -> gx.Case:
    """The free film and its run.

    Args:
        comm: communicator of the mesh.
        n: cells along an edge; each has two triangles.
        until: end of the run [s].
        dt: step [s].
        residual: stiffness of the wrinkled and slack film over that of the taut film.
        order: of the elements, 1 or 2.
    """
    law = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4, residual_stiffness=residual)
    film = gx.Membrane(sheet(comm, n, n), law, order=order, velocity=throw)
    return gx.Case(gx.Scene(film), gx.Midpoint(dt=dt), until=until, title=TITLE)


def main(
    n: int = 20,
    dt: float = 1e-3,
    steps: int = 1000,
    order: int = 1,
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
    stepper: gx.Midpoint | None = None,
) -> dict[str, float]:
    """Run `steps` steps of `dt` [s] on n × n × 2 triangles; returns drifts relative to the initial
    values, and counts.

    With `output`, a folder: the recording of the run, and a picture.
    """
    case = build(comm, n, steps * dt, dt, order=order)
    run, _ = run_case(case, output, "sheet", (0.25, 0.5, 0.75, 1.0), stepper=stepper)
    first = run.first
    last = run.totals
    # The momentum is zero at the start.  It is compared with that of the whole film [kg] at the
    # velocity of the middle of an edge [m/s].
    mass = 1400.0 * 1e-4
    scale = mass * SPIN * 0.5
    return {
        "energy_drift": abs(last.energy / first.energy - 1),
        "linear_momentum_drift": relative_drift(last.momentum, first.momentum, scale=scale),
        "angular_momentum_drift": relative_drift(last.angular_momentum, first.angular_momentum),
        **effort(run),
    }


if __name__ == "__main__":
    print_figures(main(output="out/spinning_sheet"))
