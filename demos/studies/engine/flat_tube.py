"""How well the deployment of the folded tube with flat ends is determined, see
demos/common/flat_rooted_tube.py.

One factor at a time is changed:

    cells      4, 6, 8 across the flat tube
    dt         first step [s]; the largest is twice as long
    nudge      relative change of the pressure of the tank, far below any accuracy
    damping    of the film: a loss factor, or a damping time
    contact    activation distance [m]
    residual_stiffness   compressive over tensile stiffness of the film
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import first_time, run_figures
from demos.common.flat_rooted_tube import ARRIVED, HALFWAY, LOSS_FACTOR, OPEN, build
from demos.studies.engine.deployments import DAMPING, NUDGES
from demos.studies.engine.spreads import Expected, SpreadStudy

LENGTH = 0.25  # m
DIAMETER = 0.03  # m
PRESSURE = 1.5e6  # of the tank [Pa]
UNTIL = 0.04  # s
# Until this time [s] the first fold decides; ratios of pressures are taken then.
EARLY = 3e-3
# The contact distance is half of the distance between layers, and a quarter.
FACTORS: Mapping[str, list[Any]] = {
    "cells": [4, 6, 8],
    "dt": [1e-4, 5e-5],
    "nudge": NUDGES,
    "damping": list(DAMPING),
    "contact": [5e-4, 2.5e-4],
    "residual_stiffness": [1e-6, 1e-5],
}


def deploy(
    comm: MPI.Comm,
    start: str,
    damping: str = "loss 0.01",
    nudge: float = 0.0,
    until: float = UNTIL,
    **given: float,
) -> dict[str, float]:
    """Figures of one deployment of the short tube, its film damped.

    Args:
        start: "zigzag" or "roll".
        damping: one of `DAMPING`.
        nudge: relative change of the pressure of the tank.
    """
    film = {"loss_factor": LOSS_FACTOR, **DAMPING[damping]}
    case = build(comm, start=start, until=until, pressure=PRESSURE * (1 + nudge), **film, **given)  # type: ignore[arg-type]
    series = gx.Series(case.probes)
    run = case.simulation([series])
    run.run(until=until)
    t = series.time
    distance = np.hypot(series["tip x [m]"], series["tip z [m]"])
    ring = series["ring1 [mm2]"] / (1e6 * math.pi * DIAMETER**2 / 4)
    ratio = series["p2 [Pa]"] / series["p1 [Pa]"]
    return {
        "halfway [ms]": 1e3 * first_time(t, distance, HALFWAY * LENGTH),
        "arrived [ms]": 1e3 * first_time(t, distance, ARRIVED * LENGTH),
        "tip speed [m/s]": float(series["tip speed [m/s]"].max()),
        "ring 1 [ms]": 1e3 * first_time(t, ring, OPEN),
        "mean of ring 1": float(ring[t <= EARLY].mean()),
        "p2/p1 at 3 ms": float(np.interp(EARLY, t, ratio)),
        "p1 at the end [Pa]": float(series["p1 [Pa]"][-1]),
        **run_figures(run, series),
    }


def tube_study(start: str, expected: Mapping[str, Expected]) -> SpreadStudy:
    """The study of the tube that starts as a "zigzag" or as a "roll"."""
    return SpreadStudy(
        f"folded_{start}",
        f"What is determined of a folded tube with flat ends, from a {start}",
        partial(deploy, start=start),
        vary=FACTORS,
        expected=expected,
        chance=["nudge"],
        quick={"nudge": [0.0, 1e-9]},
        quick_options={"until": 0.01},
        limits={"energy_error": 1e-9, "penetrations": 0},
    )
