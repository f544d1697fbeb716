"""Convergence of the spin deployment of the demo `spin_deployment`: two meshes with three steps.

Compared is what a designer asks: how far the tips come and when, and the spins of hub and sail at
240 ms, when the film is straight.  Folded film moves chaotically, so a row is also computed with
the spin at the start changed by 1e-9 of itself ("nudged"): what differs between the two is what no
mesh and no step can tell.
"""

from __future__ import annotations

from mpi4py import MPI

from demos.sails.spin_deployment import main
from demos.studies.engine.deployments import LEDGER, STARTS, nudged
from demos.studies.engine.study import Study


def problem(comm: MPI.Comm, start: str, cells: int, h: float, **options: float) -> dict[str, float]:
    rev = nudged(8.0, start)
    return main(
        cells=cells,
        largest=h,
        dt=min(h, 4e-4),
        rev=rev,
        comm=comm,
        **options,
    )


STUDY = Study(
    "spin_deployment",
    "Convergence of the deployment of a disc by its spin",
    problem,
    {"start": STARTS, "cells": [1, 2], "h": [2e-3, 1e-3, 5e-4]},
    lambda case: case["h"],
    quick={"start": ["usual"], "cells": [1], "h": [1e-3]},
    quick_options={"until": 0.05},
    shows=("largest_radius", "spin_of_hub", "spin_of_sail"),
    not_repeatable={
        "nutation_at_start": "nothing is tilted: round-off",
    },
    limits={"energy_error": 1e-8, "penetrations": 0},
    columns=f"largest_radius, when, spin_of_hub, spin_of_sail, {LEDGER}",
    may_fail=True,
)
