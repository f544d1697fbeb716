"""Convergence of a deployment: the folded tube on three meshes with three steps.

The tube of demos/common/flat_rooted_tube.py, 0.25 m, three compartments, to 12 ms with equal steps,
its film damped with a loss factor of 0.01 and undamped.  What is
compared is what a designer asks: when the rings open, the pressures, how fast the tip moves, and
where it is.  Motion of folded film is chaotic: round-off grows by contact and by wrinkles, and so
do errors.  A row is therefore also computed with the tank's pressure changed by 1e-9 of itself
("nudged"): what differs between the two is what no mesh and no step can tell.
"""

from __future__ import annotations

import math

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import run_figures
from demos.common.flat_rooted_tube import LOSS_FACTOR, build, opening_times
from demos.studies.engine.deployments import STARTS, nudged
from demos.studies.engine.study import Study

# End of a run [s], the same as in the study of choking.
UNTIL = 12e-3
# Loss factor of the film.
FILMS = {"damped": LOSS_FACTOR, "undamped": 0.0}


def problem(
    comm: MPI.Comm, film: str, start: str, cells: int, h: float, until: float = UNTIL
) -> dict[str, float]:
    """Fill the folded tube of the demo until a time [s], with steps of h [s]."""
    case = build(
        comm,
        cells=cells,
        dt=h,
        until=until,
        pressure=nudged(1.5e6, start),
        loss_factor=FILMS[film],
    )
    series = gx.Series(case.probes)
    run = gx.Simulation(case.scene, case.stepper, outputs=[series])
    run.run(until=until)
    t = series.time
    opened = opening_times(t, [series["ring1 [mm2]"], series["ring2 [mm2]"]], 0.03)
    x = series["tip x [m]"]
    z = series["tip z [m]"]
    speed = series["tip speed [m/s]"]
    return {
        "opened1 [ms]": 1e3 * opened[0],
        "opened2 [ms]": 1e3 * opened[1],
        "p2/p1 at 3 ms": float(np.interp(3e-3, t, series["p2 [Pa]"] / series["p1 [Pa]"])),
        "p1 at the end [Pa]": float(series["p1 [Pa]"][-1]),
        "distance [mm]": 1e3 * math.hypot(x[-1], z[-1]),
        "mean speed [m/s]": float(np.trapezoid(speed, t) / t[-1]),
        **run_figures(run, series),
        "unknowns": run.system.unknowns.q0.getSize(),
    }


STUDY = Study(
    "deployment",
    "Convergence of the deployment of a folded tube",
    problem,
    {"film": list(FILMS), "start": STARTS, "cells": [4, 6, 8], "h": [1e-4, 5e-5, 2.5e-5]},
    lambda case: case["h"],
    quick={"film": ["damped"], "start": ["usual"], "cells": [4], "h": [1e-4]},
    quick_options={"until": 4e-3},
    shows=("opened1 [ms]", "opened2 [ms]", "p2/p1 at 3 ms"),
    quick_shows=("p2/p1 at 3 ms", "distance [mm]"),
    limits={"energy_error": 1e-8, "penetrations": 0},
    columns=(
        "opened1 [ms], opened2 [ms], p2/p1 at 3 ms, p1 at the end [Pa], distance [mm], "
        "mean speed [m/s], penetrations, energy_error, iterations, rejected, unknowns, seconds"
    ),
    may_fail=True,
    expected_warnings={"nothing damps it": "one film is undamped on purpose, for comparison"},
)
