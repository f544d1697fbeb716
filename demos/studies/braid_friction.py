"""Does friction between the yarns of braided tubes explain why the tube of 55° is stiffer than its
model, with one number for all braid angles?

The tubes are those of the validation cases `hiad_55`, `hiad_60` and `hiad_71` in four-point bending
(demos/validation/models/braided_tube.py).  Yarns at ±β from the axis turn against each other by e =
cos²β E_L - sin²β E_H.  `gx.loads.InternalFriction` resists that up to a limit [N/m], which is
reached at the slip e = `slip`; a braid that is inflated has slid, so that it begins there.

Loads are compared with the measured ones at a deflection of 75 mm.  If one limit explained all
angles, the errors of all tests would be small with it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.engine.study import Study
from demos.validation.engine.case import read_case
from demos.validation.engine.units import conversion_factor
from demos.validation.models import braided_tube
from gossamer_fx.extend import Result

CASES = Path(__file__).parents[1] / "validation" / "cases"
# Deflection [m] at which loads are compared: beyond the onset of sliding, before cords go slack.
COMPARED_AT = 0.075


def problem(
    comm: MPI.Comm,
    angle: int,
    pressure: int,
    cords: int,
    slip: float,
    limit: float,
    cells: int,
) -> Mapping[str, float]:
    """The load of one test: `angle` of its braid [degrees], `pressure` [kPa], `cords` on the loaded
    side, with a friction of a `limit` [N/m]."""
    began = time.perf_counter()
    case = read_case(CASES / f"hiad_{angle}.toml", ["braided_tube"])
    name = f"{cords} up, {pressure} kPa"
    (test,) = (test for test in case.tests if test.name == name)
    (measured,) = test.measured
    assert measured.x is not None, "loads are measured over deflections"
    x = measured.x * conversion_factor(measured.x_unit, "m", name)
    y = measured.y * conversion_factor(measured.unit, "N", name)
    aim = float(np.interp(COMPARED_AT, x, y))
    tube = replace(braided_tube.Tube.read(test.inputs), deflection=COMPARED_AT)
    model = braided_tube.build(tube, comm, cells)
    if limit > 0:
        β = test.inputs.number("braid_angle", "rad")
        friction = gx.loads.InternalFriction(
            model.film,
            strain=(math.cos(β) ** 2, -(math.sin(β) ** 2), 0.0),
            stiffness=(limit / slip,),
            limit=(limit,),
        )
        model = replace(model, scene=gx.Scene(*model.scene.items, friction))
    deflections, loads, _ = braided_tube.bend(model, tube, braided_tube.QUICK_STEP)
    load = float(np.interp(COMPARED_AT, deflections, loads))
    return {
        "measured": aim,
        "load": load,
        "deficit": aim - load,
        "error": load / aim - 1,
        "seconds": time.perf_counter() - began,
    }


def draw(results: list[Result], path: Path) -> None:
    """The error of each test over the friction limit, a panel for each braid angle."""
    from demos.common.figures import BLUE, RED, finish, new_figure, save

    figure = new_figure(10.0, 3.4)
    done = [result for result in results if not result.failed]
    angles = sorted({int(result.values["angle"]) for result in done})
    finest = max(int(result.values["cells"]) for result in done)
    for angle, axes in zip(
        angles, figure.subplots(1, len(angles), sharey=True, squeeze=False)[0], strict=True
    ):
        for cords, color in ((1, BLUE), (2, RED)):
            of_kind = [
                result
                for result in done
                if (result.values["angle"], result.values["cords"]) == (angle, cords)
                and result.values["cells"] == finest
            ]
            words = f"{cords} cord{'s' * (cords > 1)} up"
            for pressure in sorted({result.values["pressure"] for result in of_kind}):
                tests = [one for one in of_kind if one.values["pressure"] == pressure]
                x = [float(one.values["limit"]) for one in tests]
                y = [100 * one.numbers["error"] for one in tests]
                axes.plot(x, y, "-o", ms=3, color=color, label=words)
                words = ""
        axes.axhline(0.0, color="black", lw=0.6)
        axes.set_title(f"{angle}°")
        finish(axes, "friction limit [N/m]", "load over the measured one - 1 [%]")
    axes.legend()
    save(figure, path, "Braided tubes with friction of their yarns, a line for each pressure")


STUDY = Study(
    "braid_friction",
    "Friction of the yarns of braided tubes: does one number explain all braid angles?",
    problem,
    {
        "angle": [55, 60, 71],
        "pressure": [34, 69, 138],
        "cords": [1, 2],
        "slip": [1e-3],
        "limit": [0.0, 400.0, 800.0],
        "cells": [6, 12],
    },
    lambda case: 1 / case["cells"],
    # The slip is not known: a fifth of it.
    finer=[
        {"angle": angle, "pressure": 69, "cords": 1, "slip": 2e-4, "limit": 800.0, "cells": 6}
        for angle in (55, 60, 71)
    ],
    quick={"pressure": [69], "cords": [1], "limit": [0.0, 400.0], "cells": [6]},
    columns="measured, load, deficit, error, seconds",
    shows=("error",),
    draw=draw,
)
