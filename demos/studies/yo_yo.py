"""The yo-yo of the demo `yo_yo`: error of the hub's spin over the cells of a cord and the steps.

The closed form has cords without mass that do not stretch and leave the cylinder along its tangent;
here they are polygons with mass, so that an error remains.  It is over the first spin, until half
the cords are unwound, and to the end.
"""

from __future__ import annotations

from mpi4py import MPI

from demos.sails.yo_yo import main
from demos.studies.engine.study import Measure, Study


def problem(comm: MPI.Comm, h: float, cells: int) -> dict[str, float]:
    # `h` is the longest step, not the first one.
    return main(cells=cells, largest=h, dt=min(h, 2e-4), comm=comm)


STUDY = Study(
    "yo_yo",
    "Hub stopped by two masses on cords: error of its spin",
    problem,
    {"h": [2e-3, 1e-3, 5e-4], "cells": [18, 36, 72]},
    lambda case: 1 / case["cells"],
    (Measure("error_half", 0.0, 5e-3),),
    quick={"h": [1e-3], "cells": [12, 18]},
    columns=(
        "error_whole, energy_error, angular_momentum_drift, penetrations, rejected, steps, "
        "iterations, seconds"
    ),
)
