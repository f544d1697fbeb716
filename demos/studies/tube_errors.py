"""How manufacturing errors change the bending stiffness of a deployed tube.

The tube of demos/common/flat_rooted_tube.py with three panels, round and straight under 8 kPa, is
bent by a small force at its tip (demos/common/tube_bending.py).  Specimens have errors of one kind,
or of all kinds, with the standard deviations `flat_rooted_tube.SCATTER`.  The closed form of a
specimen is

    EI = E t π r³,

with its own radius, and the thickness of its middle panel, where the deflection is measured.

    none            the tube as drawn
    creases         as drawn, with creases of 0.02 N m/m/rad whose rest angle is half of the fold's
    fold_position, fold_angle, diameter, thickness      errors of this kind; folds have creases
    all             errors of all kinds; folds have creases
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping

import numpy as np
from mpi4py import MPI

from demos.common.flat_rooted_tube import SCATTER
from demos.common.manufacturing import Scatter, draw_specimen
from demos.common.tube_bending import bent_tube, straight_stiffness
from demos.studies.engine.study import Measure, Study
from gossamer_fx.presets.films import KAPTON_HN

LENGTH = 0.25  # m
DIAMETER = 0.03  # m
PANELS = 3
THICKNESS = 25e-6  # m
PRESSURE = 8e3  # Pa: that of the demo's tank, when it is empty
CREASES = {"stiffness": 0.02, "set_angle_ratio": 0.5}
# Angle of the panels when the tube was folded [rad].
ANGLE = math.radians(80.0)
SPECIMENS = 6
KINDS = ("fold_position", "fold_angle", "diameter", "thickness")


def scatter_of(errors: str) -> Scatter:
    """Standard deviations of one kind of errors, or of all."""
    if errors == "all":
        return SCATTER
    if errors in KINDS:
        return Scatter(**{errors: getattr(SCATTER, errors)})
    return Scatter()


def problem(comm: MPI.Comm, errors: str, cells: int) -> Mapping[str, float]:
    """Mean and spread of the stiffness over `SPECIMENS` specimens, and of their closed form."""
    began = time.perf_counter()
    creases = CREASES if errors != "none" else None
    # Specimens without errors are all the same.
    seeds = [0] if errors in ("none", "creases") else range(1, SPECIMENS + 1)
    found = []
    closed = []
    for seed in seeds:
        specimen = draw_specimen(seed, PANELS, scatter_of(errors))
        law = KAPTON_HN.law(THICKNESS, residual_stiffness=1e-6)
        bent = bent_tube(
            comm,
            law,
            length=LENGTH,
            diameter=DIAMETER,
            pressure=PRESSURE,
            specimen=specimen,
            cells=cells,
            creases=creases,
            angle=ANGLE,
        )
        found.append(bent.bending_stiffness)
        middle = THICKNESS * specimen.thickness_ratios[PANELS // 2]
        film = KAPTON_HN.law(middle)
        closed.append(straight_stiffness(film, DIAMETER * specimen.diameter_ratio, PRESSURE))
    ratios = np.array(found) / np.array(closed)
    return {
        "mean EI": float(np.mean(found)),
        "spread": float(np.std(found) / np.mean(found)),
        "closed form": float(np.mean(closed)),
        "spread of it": float(np.std(closed) / np.mean(closed)),
        "EI/closed form": float(ratios.mean()),
        "specimens": len(found),
        "seconds": time.perf_counter() - began,
    }


STUDY = Study(
    "tube_errors",
    "Bending stiffness of a deployed tube with manufacturing errors",
    problem,
    {"errors": ["none", "creases", *KINDS, "all"], "cells": [8]},
    lambda case: math.pi * DIAMETER / 2 / case["cells"],
    # The flat ends leave the tube oval by a few percent, see the module of the bending.
    (Measure("EI/closed form", 1.0, 0.06),),
    quick={"errors": ["none", "diameter"], "cells": [4, 8]},
    columns="mean EI, spread, closed form, spread of it, specimens, seconds",
)
