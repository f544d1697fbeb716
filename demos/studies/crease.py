"""A strip folded along a crease in its middle and pulled at both ends: plates of order 2 against
elastica and hinge.

The exact solution is that of inextensible panels (an elastica each) and a linear rotational spring
with a rest angle: the strip of `demos.common.crease_identification` without own weight.
Wanted: 1 % of the distance and 0.7° of the angle with 8 cells a panel; with 16, a quarter of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.crease_identification import HangingStrip
from demos.studies.engine.study import ROUND_OFF, Measure, Study
from demos.studies.plate import positions
from gossamer_fx.meshes.creased_strip import creased_strip

# Length of a panel, width and thickness [m]; Young's modulus [Pa].
LENGTH = 0.05
WIDTH = 0.01
THICKNESS = 50e-6
E = 2.5e9
# Of the crease: N m/m/rad, and rad.
STIFFNESS = 2e-3
REST = math.radians(120.0)
# ν = 0: the panels bend as strips.
LAW = gx.Linear(E=E, nu=0.0, density=1400.0, thickness=THICKNESS)
STRIP = HangingStrip(LENGTH, WIDTH, bending_stiffness=E * THICKNESS**3 / 12)
FORCES = [0.003, 0.01, 0.03, 0.05, 0.1, 0.3]  # N/m


def folded(angle: float) -> Callable[[np.ndarray], np.ndarray]:
    """Displacement of the flat strip to plane panels in a valley fold of some angle [rad]."""
    c = math.cos(angle / 2)
    s = math.sin(angle / 2)
    return lambda X: np.stack([(c - 1) * X[0], 0 * X[1], s * abs(X[0])])


def problem(comm: MPI.Comm, force: float, cells: int) -> dict[str, float]:
    """`cells` along each panel."""
    mesh = creased_strip(comm, cells, 1, LENGTH, WIDTH)
    plate = gx.Plate(mesh, LAW, hinges=["crease"], displacement=folded(REST))
    crease = gx.connectors.Crease(plate, "crease", stiffness=STIFFNESS, rest_angle=REST)
    pulls = [
        gx.loads.EdgeLoad(plate, side, force=(sign * force, 0.0, 0.0), name=f"pull {side}")
        for side, sign in (("left", -1), ("right", 1))
    ]
    search = gx.Equilibrium(gx.Scene(plate, crease, gx.Fixed(plate, "crease"), *pulls))
    found = search.find()
    angle = gx.probes.FoldAngle(crease).of(search.system)
    distance = float(positions(search, plate, "right")[0] - positions(search, plate, "left")[0])
    exact_angle, exact_distance = STRIP.equilibrium(REST, STIFFNESS, force * WIDTH)
    return {
        "angle [deg]": math.degrees(angle),
        "angle error [deg]": abs(math.degrees(angle - exact_angle)),
        "d [mm]": 1e3 * distance,
        "d/exact": distance / exact_distance,
        "iterations": found.iterations,
        "seconds": found.seconds,
        "compile_seconds": search.compile_seconds,
    }


STUDY = Study(
    "crease",
    "A creased strip pulled at its ends",
    problem,
    {"force": FORCES, "cells": [4, 8, 16]},
    lambda case: LENGTH / case["cells"],
    (
        Measure("d/exact", 1.0, 2.5e-3, lambda case: 2.0),
        Measure("angle error [deg]", 0.0, 0.175, lambda case: 2.0),
    ),
    quick={"force": [0.05], "cells": [4, 8]},
    expected_warnings=ROUND_OFF,
    columns="angle [deg], d [mm], iterations, seconds",
)
