"""How far numbers can be from ordinary before a run fails, and whether it says so: a map of an
inflating tube.

A flat tube with a payload on its tip is filled from a tank, 30 steps of h = 1e-4 s.  Each axis goes
from ordinary to extreme, alone and with another one:

    u           ratio of compressive to tensile stiffness of the film
    thickness   of the film [m]
    h           step over the default
    pressure    ratio of the tank's pressure, 1e5 Pa, to that in the tube at the start
    mass        ratio of the payload to the film
    aspect      length of the triangles over their width
    dead        volume that the flat tube encloses at the start [m³]
    loss        loss factor of the film; without any, its vibration never ends

A cell of the map is completed; completed with rejected steps; or failed, and then its row holds the
reason.  One that completed must have closed its balances: energy to 1e-9, gas to 1e-12, with
positive volumes and pressures and finite coordinates.  A cell that completed without this has a
wrong result, and the study ends with an error.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.flat_rooted_tube import BAND, LOSS_FACTOR
from demos.studies.engine.deployments import arguments
from demos.studies.engine.study import Study
from gossamer_fx.extend import Result, check
from gossamer_fx.meshes.tube import flat_tube

# Steps of a run, and their usual length [s].
STEPS = 30
H = 1e-4
# A tube of 58 mm, flat, with four cells across [m].
LENGTH = 0.2
DIAMETER = 0.058
CELLS = 4
# With these values the run takes a few iterations a step.
ORDINARY = {
    "u": 1e-6,
    "thickness": 25e-6,
    "h": 1.0,
    "pressure": 1e5,
    "mass": 1.0,
    "aspect": 1.0,
    "dead": 1e-6,
    "loss": LOSS_FACTOR,
}
# Each over several decades, up to where numbers have no physical sense.
RANGES = {
    "u": [1e-12, 1e-10, 1e-8, 1e-4, 1e-2, 1.0],
    "thickness": [1e-6, 5e-6, 1e-4, 1e-3],
    "h": [0.01, 0.1, 0.3, 3.0, 10.0, 100.0],
    "pressure": [1.0, 1e2, 1e4, 1e6, 1e8],
    "mass": [1e-6, 1e-4, 1e-2, 1e2, 1e4, 1e6],
    "aspect": [10.0, 100.0, 1000.0],
    "dead": [1e-9, 1e-8, 1e-7, 1e-4, 1e-3],
    "loss": [0.0, 1e-6, 1e-3, 0.1],
}
# Pairs in which one number could make the other one worse.
PAIRS = {
    ("u", "h"): ([1e-12, 1e-2], [0.1, 3.0, 10.0]),
    ("u", "thickness"): ([1e-12, 1.0], [1e-6, 1e-3]),
    ("pressure", "dead"): ([1.0, 1e8], [1e-9, 1e-3]),
    ("mass", "h"): ([1e-6, 1e6], [0.1, 10.0]),
    ("aspect", "thickness"): ([10.0, 1000.0], [1e-6, 1e-3]),
}
# Largest closing errors, relative, with which a cell counts as right.
ENERGY = 1e-9
MASS = 1e-12


def cases() -> list[str]:
    """Names of all cells: 'ordinary', 'u=1e-12', 'u=1e-12 h=10', ..."""
    alone = [f"{axis}={value:g}" for axis, values in RANGES.items() for value in values]
    both = [f"{a}={x:g} {b}={y:g}" for (a, b), (xs, ys) in PAIRS.items() for x in xs for y in ys]
    return ["ordinary", *alone, *both]


def problem(comm: MPI.Comm, case: str) -> Mapping[str, float]:
    """Run one cell.

    Raises:
        StepFailure: with the reason.
        InputError: the cell completed with a wrong answer.
    """
    v = ORDINARY | arguments(case)
    gas = gx.IdealGas(gamma=1.4, R=296.8)
    law = gx.Miyazaki(
        E=2.5e9, nu=0.34, density=1420.0, thickness=v["thickness"], residual_stiffness=v["u"]
    )
    mesh = flat_tube(comm, LENGTH, DIAMETER, CELLS)
    # Stretched along the tube: triangles get long and thin, the tube longer.
    mesh.domain.geometry.x[:, 0] *= v["aspect"]
    film = gx.Membrane(mesh, law)
    # Mass of the film [kg], of which the payload is a multiple.
    weight = law.density * v["thickness"] * np.pi * DIAMETER * LENGTH * v["aspect"]
    tip = film.port("tip left")
    payload = gx.PointMass(v["mass"] * weight, position=tip.initial(), comm=comm, name="payload")
    tube = gx.Chamber(
        film,
        gas=gas,
        pressure=1e5 / v["pressure"],
        temperature=293.0,
        dead_volume=v["dead"],
        name="tube",
    )
    # The reservoir has 1 bar; the tube at the start a part of it.
    tank = gx.gas.Ambient(pressure=1e5, temperature=293.0, name="reservoir")
    valve = gx.Orifice(tank, tube, area=1e-6)
    items: list[Any] = [film, gx.constraints.BallJoint(tip, payload.port()), tube, valve]
    if v["loss"]:
        items.append(gx.loads.flat_damping(film, loss_factor=v["loss"], band=BAND))
    run = gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=v["h"] * H))
    run.run(until=STEPS * v["h"] * H)
    state = run.chamber("tube")
    errors = (abs(run.energy_error), abs(run.mass_error))
    finite = bool(
        np.isfinite(run.system.unknowns.q0.array_r).all()
        and np.isfinite(run.system.unknowns.v0.array_r).all()
    )
    # Without these the cell is an error, however few iterations it took.
    sound = (
        comm.allreduce(finite, MPI.LAND)
        and errors[0] <= ENERGY
        and errors[1] <= MASS
        and min(state.volume, state.pressure) > 0
    )
    check(
        sound,
        f"Cell '{case}' has a wrong result without an error: energy off by {errors[0]:.1e}, gas by "
        f"{errors[1]:.1e}.",
    )
    return {
        "iterations": run.iterations / run.step,
        "substeps": run.substeps,
        "energy_error": errors[0],
        "mass_error": errors[1],
        "pressure": state.pressure,
        "volume": state.volume,
        "seconds": run.seconds,
    }


def draw(results: list[Result], path: Path) -> None:
    """Draw the map: a row for each axis and pair, a square for each cell, with iterations and
    sub-steps."""
    from matplotlib.patches import Patch, Rectangle

    from demos.common.figures import new_figure, save

    # Rows of the picture by the names of the axes.
    rows: dict[str, list[Result]] = {}
    for result in results:
        name = str(result.values["case"])
        rows.setdefault(" × ".join(word.split("=")[0] for word in name.split()), []).append(result)
    # Colours that remain different for colour-blind readers.
    colours = {
        "completed": "#009E73",
        "completed, with rejected steps": "#E69F00",
        "failed, by name": "#56507A",
    }
    wide = max(map(len, rows.values()))
    figure = new_figure(1.45 * wide + 2.2, 0.72 * len(rows) + 1.6)
    axes = figure.subplots()
    for y, cells in enumerate(rows.values()):
        for x, result in enumerate(cells):
            rejected = result.numbers.get("substeps", 0)
            if result.failed:
                kind = "failed, by name"
            elif rejected:
                kind = "completed, with rejected steps"
            else:
                kind = "completed"
            axes.add_patch(Rectangle((x, y), 0.94, 0.9, color=colours[kind]))
            # The case is a list of words such as "cells=8"; the label has the values only.
            words = str(result.values["case"]).split()
            lines = [word.split("=")[1] for word in words if "=" in word]
            if not result.failed:
                count = f"{result.numbers['iterations']:.1f} it."
                if rejected:
                    count += f", {rejected:.0f} rej."
                lines += [count, f"{result.numbers['energy_error']:.0e}"]
            told = "\n".join(lines)
            axes.text(
                x + 0.47,
                y + 0.45,
                told,
                ha="center",
                va="center",
                fontsize=8,
                color="white" if result.failed else "black",
            )
    axes.set(
        xlim=(0, wide),
        ylim=(len(rows), 0),
        yticks=[y + 0.45 for y in range(len(rows))],
        yticklabels=list(rows),
    )
    axes.set_xticks([])
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    patches = [Patch(color=colour, label=kind) for kind, colour in colours.items()]
    figure.legend(handles=patches, loc="outside upper center", ncols=3, frameon=False)
    axes.set_xlabel(
        "value; Newton iterations a step, sub-steps of rejected steps; closing error of the energy"
    )
    save(figure, path)


STUDY = Study(
    "stability",
    "Stability of an inflating tube: how far from ordinary numbers may be",
    problem,
    {"case": cases()},
    lambda case: 1.0,
    quick={"case": ["ordinary", "u=1e-12", "h=10", "pressure=1e+08"]},
    shows=("iterations", "pressure"),
    # A cell that completed with larger ones has ended the study already.
    limits={"energy_error": ENERGY, "mass_error": MASS},
    columns="iterations, substeps, energy_error, mass_error, seconds",
    # A step of 10 s is made of 17, in which the tube moves chaotically.
    repeatability=1e-2,
    may_fail=True,
    expected_warnings={"nothing damps it": "one film is undamped on purpose"},
    draw=draw,
)
