"""Robust design of a folded tube: which levels let it deploy quickly, straight and stiff, whatever
was wrong with it.

The method is that by which the deployment of the folded tubes in Miyazaki, KAKENHI 19360384 final
report (2009), §4(4), was made repeatable (quality engineering); its factors and levels were not
published, so those here are chosen.  A tube is run in every row of an L8 array as it was drawn and
folded ("fresh"), and as two specimens that were made with errors and stored: their folds have other
positions and angles, their diameters and thicknesses are not as drawn (`folded_tube.SCATTER`),
their creases have memory, and there is residual air.  A run ends when the tip is
`folded_tube.ARRIVED` of the length from the clamp.  The last response is the stiffness of the tip
of the same specimen, deployed, against a force across the tube: an equilibrium under the pressure
that it has when the tank is empty and the gas is warm again, see demos/common/tube_bending.py.

    ./gossamer sweep demos/design/robust_tube.py --jobs 2
    ./gossamer demo robust_tube
    ./gossamer run demos/design/robust_tube.py start=roll specimen=stored_a --output out/stored

The second prints what follows from the runs of the first.  The last one is one of the runs.

The picture is of the stored roll on a finer mesh (`cells=6`), until its tip arrives at 14.8 ms.

Start the command as often, and on as many machines, as you like: they share the runs.  A run takes
10 to 40 seconds of CPU time.
"""

from __future__ import annotations

import csv
import math
import sys
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.manufacturing import draw_specimen
from demos.common.tube_bending import bent_tube
from demos.inflatables.folded_tube import ARRIVED, SCATTER
from demos.inflatables.folded_tube import build as folded_tube
from gossamer_fx.presets.films import KAPTON_HN
from gossamer_fx.records.outputs.output import Probe

# A short tube, so that a run takes some ten seconds of CPU time [m].
LENGTH = 0.16
DIAMETER = 0.03  # m
TANK = 0.64e-6  # volume of the tank [m³]
PANEL_ANGLE = 80.0  # of the zigzag [degrees]
UNTIL = 0.03  # s: what has not arrived by then has this time
# Specimens: stiffness of creases [N m/m/rad], residual air [Pa], and seed of the manufacturing
# errors.
SPECIMENS: dict[str, dict[str, Any]] = {
    "fresh": {"crease": 0.0, "air": 0.0, "seed": 0},
    "stored_a": {"crease": 0.02, "air": 20.0, "seed": 1},
    "stored_b": {"crease": 0.02, "air": 20.0, "seed": 2},
}


def build(
    comm: MPI.Comm, specimen: str = "fresh", length: float = LENGTH, **levels: Any
) -> gx.Case:
    """The tube of one run, which ends when the tip arrives."""
    case = folded_tube(comm, length=length, tank=TANK, until=UNTIL, **SPECIMENS[specimen], **levels)
    far = distance_of(case.probes)
    probes = {**case.probes, "distance [m]": far}
    arrived = gx.When(far, ARRIVED * length, stop=True, name="the tip has arrived", tolerance=1e-5)
    return replace(case, probes=probes, frames=40, events=[arrived])


def distance_of(probes: Any) -> Probe:
    """Of the tip from the clamp, which is at the origin [m]."""
    return lambda run: math.hypot(*(probes[f"tip {axis} [m]"](run) for axis in "xz"))


def deployed_pressure(panels: int, pressure: float, dead_volume: float) -> float:
    """Pressure [Pa] in the round tube when the tank is empty and all gas has the temperature of the
    start."""
    tube = math.pi * DIAMETER**2 / 4 * LENGTH
    return pressure * TANK / (TANK + tube + panels * dead_volume)


def stiffness(
    comm: MPI.Comm,
    specimen: str,
    start: str,
    panels: int,
    thickness: float,
    pressure: float,
    dead_volume: float,
    cells: int = 8,
) -> float:
    """Stiffness [N/m] of the tip of a deployed specimen; the other levels of the design do not
    change it."""
    given = SPECIMENS[specimen]
    creases = None
    # The roll has no folds in which creases could be.
    if given["crease"] and start == "zigzag":
        creases = {"stiffness": given["crease"], "set_angle_ratio": 0.5}
    # The same errors as those of the run: seed and number of panels are the same.
    made = draw_specimen(given["seed"], panels, SCATTER)
    if start == "roll":
        straight = (0.0,) * (panels - 1)
        made = replace(made, fold_shifts=straight, angle_errors=straight)
    bent = bent_tube(
        comm,
        KAPTON_HN.law(thickness, residual_stiffness=1e-6),
        length=LENGTH,
        diameter=DIAMETER,
        pressure=deployed_pressure(panels, pressure, dead_volume),
        specimen=made,
        cells=cells,
        creases=creases,
        angle=math.radians(PANEL_ANGLE),
    )
    return bent.tip_stiffness


def outcome(comm: MPI.Comm, folder: Path, specimen: str, **levels: Any) -> dict[str, float]:
    """Figures of one run, which continues from its newest checkpoint if there is one.

    Time [s] at which the tip arrives (the end of the run, if it does not), its angle [degrees] from
    the tube's axis and its speed [m/s] then, the stiffness [N/m] of the tip of the deployed tube,
    most edges that intersect the film after any step, errors of the balances of energy and gas
    mass, steps, and rejected steps ("rejected").
    """
    case = build(comm, specimen=specimen, **levels)
    saves = folder / "checkpoints"
    begun = comm.bcast(gx.run.latest_checkpoint(saves) is not None)
    series = gx.Series(case.probes)
    run = case.simulation([series], gx.Checkpoints(saves, every=50), saves if begun else None)
    run.run(until=UNTIL)
    last = {name: float(series[name][-1]) for name in case.probes}
    bent = ("start", "panels", "thickness", "pressure", "dead_volume")
    return {
        "time [s]": run.time,
        "angle [degrees]": math.degrees(abs(math.atan2(last["tip z [m]"], last["tip x [m]"]))),
        "speed [m/s]": last["tip speed [m/s]"],
        "stiffness [N/m]": stiffness(comm, specimen, **{name: levels[name] for name in bent}),
        "penetrations": float(series["penetrations"].max()),
        "energy_error": abs(run.energy_error),
        "mass_error": abs(run.mass_error),
        "steps": run.step,
        "rejected": run.substeps,
    }


CONTROL: dict[str, tuple[Any, Any]] = {
    "start": ("zigzag", "roll"),
    "panels": (2, 3),
    "thickness": (25e-6, 12.5e-6),
    "pressure": (1.5e6, 2.0e6),
    "bore": (0.4e-3, 0.5e-3),
    "dead_volume": (0.2e-6, 0.1e-6),
    "lift": (1e-4, 2e-4),
}
# The usual levels are the first of each factor: those of the demo folded_tube, with two panels.

# L8: levels (8 rows, 7 factors).  Each column is a sum of some of three independent ones, modulo
# two, so that in any two columns all pairs of levels occur equally often.
_BITS = np.array(list(product((0, 1), repeat=3)))
LEVELS = _BITS @ _BITS[1:].T % 2


def cases() -> dict[str, list[Any]]:
    """Values of all factors in all runs: each row of the array with all specimens."""
    values: dict[str, list[Any]] = {}
    for levels, name in zip(LEVELS.T, CONTROL, strict=True):
        of_rows = [CONTROL[name][level] for level in levels]
        values[name] = [value for value in of_rows for _ in SPECIMENS]
    values["specimen"] = list(SPECIMENS) * len(LEVELS)
    return values


SWEEP = gx.sweep.Factorial(outcome, cases(), listed=True)

# Exponent of a response y in its ratio -10 log10 mean(y^p): small ones are good, or large ones.
EXPONENTS = {"time [s]": 2, "angle [degrees]": 2, "speed [m/s]": 2, "stiffness [N/m]": -2}


def main(folder: Path = Path("out/robust_tube")) -> None:
    """Print, for each response of the runs in a folder, the signal-to-noise ratio [dB] of both
    levels of each factor, and the share of the factor in the variance of the ratio."""
    table = folder / "runs.csv"
    if not table.is_file():
        sys.exit(f"There is no '{table}'; run: ./gossamer sweep demos/design/robust_tube.py")
    with table.open(newline="") as file:
        runs = list(csv.DictReader(file))
    for response, exponent in EXPONENTS.items():
        y = np.array([float(run[response]) for run in runs]).reshape(len(LEVELS), len(SPECIMENS))
        ratios = -10 * np.log10((y**exponent).mean(axis=1))
        deviations = ratios - ratios.mean()
        print(f"{response}: {ratios.mean():.2f} dB")
        for levels, name in zip(LEVELS.T, CONTROL, strict=True):
            low, high = (deviations[levels == level].mean() for level in (0, 1))
            share = len(ratios) * (low**2 + high**2) / 2 / (deviations**2).sum()
            print(f"    {name}: {low:+.2f}, {high:+.2f} dB, {100 * share:.0f} %")


if __name__ == "__main__":
    main()
