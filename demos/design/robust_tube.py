"""Robust design of a folded tube: which levels let it deploy quickly, straight and stiff, whatever
was wrong with it.

The method is that by which the deployment of the folded tubes in Miyazaki, KAKENHI 19360384 final
report (2009), §4(4), was made repeatable (quality engineering); its factors and levels were not
published, so those here are chosen.  A tube is run in every row of an L8 array as it was drawn and
folded ("fresh"), and as two specimens that were made with errors and stored: their folds have other
positions and angles, their diameters and thicknesses are not as drawn (`flat_rooted_tube.SCATTER`),
their creases have memory, and there is residual air.  A run ends when the tip is
`flat_rooted_tube.ARRIVED` of the length from the clamp.  The last response is the stiffness of the
tip of the same specimen, deployed, against a force across the tube: an equilibrium under the
pressure that it has when the tank is empty and the gas is warm again, see
demos/common/tube_bending.py.

    ./gossamer demo robust_tube
    ./gossamer demo robust_tube length=0.8
    ./gossamer demo robust_tube dt=5e-5
    ./gossamer demo robust_tube cells=6
    ./gossamer run demos/design/robust_tube.py start=roll specimen=stored_a --output out/stored

The first makes the runs, and prints and draws what follows from them; with `--jobs 2`,
`./gossamer sweep demos/design/robust_tube.py` makes them with two processes.  The second is for the
long tube of the report: an L4 array of the factors that matter most, with one stored specimen.  It
has not been run to its end: of 150 ms, a zigzag takes 112 s of CPU time and 920 steps for 33 ms,
the quickest roll 84 s and 1250 steps for 15 ms.  The third repeats all runs with half of the step,
the fourth on a finer mesh: what changes is not determined.  The last one is one of the runs.

The picture is of the stored roll on a finer mesh (`cells=6`), until its tip arrives at 14.8 ms.

Start a command as often, and on as many machines, as you like: they share the runs.  A run of the
short tube takes 10 to 40 seconds of CPU time.
"""

from __future__ import annotations

import csv
import inspect
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.command_line import named_values
from demos.common.figures import BLUE, GREY, new_figure, save
from demos.common.flat_rooted_tube import ARRIVED, LOSS_FACTOR, SCATTER
from demos.common.flat_rooted_tube import build as flat_rooted_tube
from demos.common.manufacturing import draw_specimen
from demos.common.tube_bending import bent_tube
from gossamer_fx.extend import Array, Probe, check
from gossamer_fx.presets.films import KAPTON_HN

# A short tube, so that a run takes some ten seconds of CPU time [m].
LENGTH = 0.16
DIAMETER = 0.03  # m
PANEL_ANGLE = 80.0  # of the zigzag [degrees]
# Volume of the tank [m³], and end of a run [s], at which what has not arrived is counted: of the
# short tube.  Both are in proportion to the length.
TANK = 0.64e-6
UNTIL = 0.03
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
    longer = length / LENGTH
    given = SPECIMENS[specimen] | levels
    case = flat_rooted_tube(
        comm,
        length=length,
        tank=TANK * longer,
        loss_factor=LOSS_FACTOR,
        until=UNTIL * longer,
        **given,
    )
    far = distance_of(case.probes)
    probes = {**case.probes, "distance [m]": far}
    arrived = gx.When(far, ARRIVED * length, stop=True, name="the tip has arrived", tolerance=1e-5)
    return replace(case, probes=probes, frames=40, events=[arrived])


def distance_of(probes: Any) -> Probe:
    """Of the tip from the clamp, which is at the origin [m]."""
    return lambda run: math.hypot(*(probes[f"tip {axis} [m]"](run) for axis in "xz"))


def deployed_pressure(length: float, panels: int, pressure: float, dead_volume: float) -> float:
    """Pressure [Pa] in the round tube when the tank is empty and all gas has the temperature of the
    start."""
    tank = TANK * length / LENGTH
    tube = math.pi * DIAMETER**2 / 4 * length
    return pressure * tank / (tank + tube + panels * dead_volume)


def stiffness(
    comm: MPI.Comm,
    specimen: str,
    length: float,
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
        length=length,
        diameter=DIAMETER,
        pressure=deployed_pressure(length, panels, pressure, dead_volume),
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
    run.run(until=case.until)
    last = {name: float(series[name][-1]) for name in case.probes}
    bent = ("length", "start", "panels", "thickness", "pressure", "dead_volume")
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
# The usual levels are the first of each factor: those of flat_rooted_tube, with two panels.

# Factors that are varied at each length; of the others all runs have the usual level.
FACTORS = {LENGTH: tuple(CONTROL), 0.8: ("start", "thickness", "bore")}
# Specimens of each row at each length.
MADE = {LENGTH: tuple(SPECIMENS), 0.8: ("fresh", "stored_a")}


def array(factors: int) -> Array:
    """Levels (factors + 1, factors), 0 or 1, of an orthogonal array of 3 (L4) or 7 (L8) factors.

    Each column is a sum of some independent ones, modulo two, so that in any two columns all pairs
    of levels occur equally often.
    """
    bits = np.array(list(product((0, 1), repeat=factors.bit_length())))
    return bits @ bits[1:].T % 2


def cases(length: float, **numerics: float) -> dict[str, list[Any]]:
    """Values of all factors in all runs: each row of the array with all specimens.

    Args:
        length: of the tube [m].
        numerics: the same in all runs, such as dt=5e-5, the first step [s].
    """
    varied = FACTORS[length]
    rows = array(len(varied))
    values: dict[str, list[Any]] = {}
    for name, of_levels in CONTROL.items():
        column = [0] * len(rows)
        if name in varied:
            column = list(rows[:, varied.index(name)])
        values[name] = [of_levels[level] for level in column for _ in MADE[length]]
    values["specimen"] = list(MADE[length]) * len(rows)
    # Of the command line all numbers are floats.
    whole = {name: int(value) for name, value in numerics.items() if value == int(value)}
    for name, value in {"length": length, **numerics, **whole}.items():
        values[name] = [value] * len(values["specimen"])
    return values


# Arguments of `flat_rooted_tube` that are not part of the design.
NUMERICS = ("dt", "cells", "contact", "residual", "residual_stiffness", "iterations")
SWEEP = gx.sweep.Factorial(outcome, cases(LENGTH), listed=True)

# Exponent of a response y in its ratio -10 log10 mean(y^p): small ones are good, or large ones.
EXPONENTS = {"time [s]": 2, "angle [degrees]": 2, "speed [m/s]": 2, "stiffness [N/m]": -2}


def main(length: float = LENGTH, folder: Path | None = None, **numerics: float) -> None:
    """Make the runs of a length that the folder lacks; print and draw, for each response, the
    signal-to-noise ratio [dB] of both levels of each factor, and its share in the variance.

    `numerics`, such as dt=5e-5, are the same in all runs: how much do they change the answer?
    """
    if folder is None:
        others = {} if length == LENGTH else {"length": length}
        words = [f"_{name}_{value:g}" for name, value in {**others, **numerics}.items()]
        folder = Path("out/robust_tube" + "".join(words))
    sweep = gx.sweep.Factorial(outcome, cases(length, **numerics), listed=True)
    gx.sweep.run_factorial(sweep, MPI.COMM_SELF, folder)
    with (folder / "runs.csv").open(newline="") as file:
        runs = list(csv.DictReader(file))
    varied = FACTORS[length]
    rows = array(len(varied))
    effects: dict[str, Array] = {}
    for response, exponent in EXPONENTS.items():
        y = np.array([float(run[response]) for run in runs]).reshape(len(rows), -1)
        ratios = -10 * np.log10((y**exponent).mean(axis=1))
        deviations = ratios - ratios.mean()
        print(f"{response}: {ratios.mean():.2f} dB")
        # Means (factors, 2) over the rows that have a level.
        levels = np.array([[deviations[column == k].mean() for k in (0, 1)] for column in rows.T])
        shares = len(rows) * (levels**2).sum(axis=1) / 2 / (deviations**2).sum()
        for name, (low, high), share in zip(varied, levels, shares, strict=True):
            print(f"    {name}: {low:+.2f}, {high:+.2f} dB, {100 * share:.0f} %")
        effects[response] = ratios.mean() + levels
    draw(effects, varied, folder / "robust_tube.png")


def draw(effects: dict[str, Array], varied: Sequence[str], path: Path) -> None:
    """Signal-to-noise ratios (factors, 2) [dB] of the levels of the varied factors: a row for each
    response."""
    figure = new_figure(2.5 * len(varied), 2.4 * len(effects))
    grid = figure.subplots(len(effects), len(varied), sharey="row", squeeze=False)
    for (response, ratios), row in zip(effects.items(), grid, strict=True):
        for name, levels, axes in zip(varied, ratios, row, strict=True):
            axes.plot([0, 1], levels, "o-", color=BLUE)
            axes.axhline(levels.mean(), color=GREY, lw=0.8)
            axes.set_xticks([0, 1], [str(level) for level in CONTROL[name]])
            axes.set_xlim(-0.3, 1.3)
            axes.set_title(name)
        row[0].set_ylabel(f"{response}\nS/N [dB]")
    save(figure, path)


if __name__ == "__main__":
    # e.g. length=0.8
    parameters = inspect.signature(flat_rooted_tube).parameters
    defaults = {"length": LENGTH} | {name: parameters[name].default for name in NUMERICS}
    given = named_values(sys.argv[1:], defaults)
    length = given.pop("length", LENGTH)
    check(length in FACTORS, f"There is no design of {length} m; give a length of {[*FACTORS]}.")
    main(length, **given)
