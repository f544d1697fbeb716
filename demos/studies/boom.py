"""How well the deployment of the folded boom is determined: the demo `folded_tube` with one factor
at a time changed.

    cells      4, 6, 8 on half of the circumference
    dt         first step [s]; the largest is eight times as long
    nudge      relative change of the pressure of the tank, far below any accuracy
    damping    of the film: a loss factor that is the same for all frequencies, within the range
               that is assumed for polyimide, or a damping time; "all over" acts also where film is
               slack
    contact    activation distance [m]
    residual_stiffness   compressive over tensile stiffness of the film

Half-way, arrival and tip speed are those of the tip; the stiffness is that of the tip in the
equilibrium that is found from the end of the run.  The swing is the largest distance of the tip
from the axis in the last 50 ms; rings are half open at the times given.
"""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

from demos.inflatables.folded_tube import main
from demos.studies.engine.spreads import Expected, SpreadStudy

# Arguments of the demo for each kind of damping.
DAMPING: dict[str, dict[str, Any]] = {
    "loss 0.01": {},
    "loss 0.003": {"loss_factor": 0.003},
    "loss 0.03": {"loss_factor": 0.03},
    "1e-7 s": {"loss_factor": 0.0, "damping": 1e-7},
    "1e-6 s": {"loss_factor": 0.0, "damping": 1e-6},
    "1e-6 s all over": {"loss_factor": 0.0, "damping": 1e-6, "tension_only": False},
    "loss 0.01 all over": {"tension_only": False},
}


def problem(comm: MPI.Comm, damping: str = "loss 0.01", **given: float) -> dict[str, float]:
    """The figures of one deployment."""
    return main(comm=comm, **DAMPING[damping], **given)


STUDY = SpreadStudy(
    "boom",
    "What is determined of the deployment of a folded boom",
    problem,
    vary={
        "cells": [4, 6, 8],
        "dt": [1e-4, 5e-5],
        "nudge": [0.0, 1e-9, -1e-9],
        "damping": list(DAMPING),
        "contact": [5e-4, 2.5e-4],
        "residual_stiffness": [1e-6, 1e-5],
    },
    expected={
        "halfway [ms]": Expected("determined", 20.0, 26.0),
        "arrived [ms]": Expected("determined", 40.0, 46.0),
        "tip speed [m/s]": Expected("determined", 7.0, 9.0),
        "stiffness along z [N/m]": Expected("determined", 123.0, 130.0),
        "pressure [Pa]": Expected("determined", 6500.0, 7000.0),
        "swing [%]": Expected("not determined", 0.0, 15.0),
        "ring 1 [ms]": Expected("not determined", 3.0, 60.0),
        "ring 2 [ms]": Expected("not determined", 3.0, 60.0),
        "ring 3 [ms]": Expected("not determined", 3.0, 60.0),
    },
    chance=["nudge"],
    quick={"nudge": [0.0, 1e-9]},
    quick_options={"until": 0.02},
    limits={"energy_error": 1e-9, "penetrations": 0},
)
