"""How well the deployment of a disc of film by its spin is determined: the demo `spin_deployment`
with one factor at a time changed.

    cells      1, 2 on a side of the hub
    largest    largest step [s]
    nudge      relative change of the spin at the start, far below any accuracy
    damping    of the film: a damping time, or a loss factor that is the same for all frequencies
    contact    activation distance [m]; the layers are 0.5 mm apart at the start
    residual_stiffness   compressive over tensile stiffness of the film

The disc is open when its tips' mean radius is three quarters of that of the flat disc.
"""

from __future__ import annotations

import math
from typing import Any

from mpi4py import MPI

from demos.sails.spin_deployment import main
from demos.studies.engine.deployments import NUDGES, SPIN_DAMPING, balances
from demos.studies.engine.spreads import Expected, SpreadStudy


def problem(
    comm: MPI.Comm, damping: str = "1e-4 s", nudge: float = 0.0, **given: Any
) -> dict[str, float]:
    """The figures of one deployment."""
    found = main(comm=comm, rev=8.0 * (1 + nudge), **SPIN_DAMPING[damping], **given)
    return {
        "opened [ms]": 1e3 * found["opened"],
        "largest radius [m]": found["largest_radius"],
        "when [ms]": 1e3 * found["when"],
        "hub at the end [1/s]": found["spin_of_hub"] / math.tau,
        "sail at the end [1/s]": found["spin_of_sail"] / math.tau,
        "lost [J]": found["dissipated"],
        **balances(found),
    }


STUDY = SpreadStudy(
    "disc",
    "What is determined of the deployment of a disc by its spin",
    problem,
    vary={
        "cells": [1, 2],
        "largest": [1e-3, 5e-4],
        "nudge": NUDGES,
        "damping": list(SPIN_DAMPING),
        "contact": [4e-4, 2e-4],
        "residual_stiffness": [1e-6, 1e-5],
    },
    expected={
        "opened [ms]": Expected("not determined", 165.0, 220.0),
        "largest radius [m]": Expected("not determined", 0.37, 0.45),
        "when [ms]": Expected("not determined", 195.0, 240.0),
        "hub at the end [1/s]": Expected("not determined", 0.5, 5.7),
        "sail at the end [1/s]": Expected("not determined", 0.33, 0.475),
        "lost [J]": Expected("not determined", 0.03, 0.175),
    },
    chance=["nudge"],
    quick={"nudge": [0.0, 1e-9]},
    quick_options={"until": 0.03},
    limits={"energy_error": 1e-8, "penetrations": 0},
)
