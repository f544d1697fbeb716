"""Robust design of a folded tube: which levels let it deploy quickly and straight, whatever storage did to it.

The method is that by which the deployment of the folded tubes in Miyazaki, KAKENHI 19360384 final report (2009), §4(4),
was made repeatable (quality engineering); its factors and levels were not published, so those here are chosen.  A tube
is run in every row of an L18 array as it was folded ("fresh"), and as storage left it ("stored": creases with memory,
and residual air in it), until its tip is 95 % of its length from the clamp.

    ./gossamer sweep demos/robust_tube.py --jobs 2
    ./gossamer run demos/robust_tube.py start=roll state=stored --output out/stored     one of the runs

The picture is of the stored roll on a finer mesh (`cells=6`), until 11 ms.

Start the command as often, and on as many machines, as you like: they share the runs.  A run takes one to two minutes.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from mpi4py import MPI

import gossamer_fx as gx
from demos.folded_tube import build as folded_tube
from gossamer_fx.outputs.output import Probe

LENGTH = 0.25  # m
ARRIVED = 0.95  # of the length
UNTIL = 0.05  # s: what has not arrived by then has this time
STATES = {"fresh": {"crease": 0.0, "air": 0.0}, "stored": {"crease": 0.02, "air": 20.0}}


def build(comm: MPI.Comm, state: str = "fresh", length: float = LENGTH, **levels: Any) -> gx.Case:
    """The tube of one run, which ends when the tip arrives."""
    case = folded_tube(comm, length=length, until=UNTIL, **STATES[state], **levels)
    far = distance_of(case.probes)
    probes = {**case.probes, "distance [m]": far}
    arrived = gx.When(
        far,
        ARRIVED * length,
        stop=True,
        name="the tip has arrived",
        tolerance=1e-5,
    )
    return gx.Case(
        case.scene,
        case.stepper,
        until=UNTIL,
        title=case.title,
        probes=probes,
        frames=40,
        control=case.control,
        events=[arrived],
    )


def distance_of(probes: Any) -> Probe:
    """Of the tip from the clamp, which is at the origin [m]."""
    return lambda run: math.hypot(*(probes[f"tip {axis} [m]"](run) for axis in "xz"))


def outcome(comm: MPI.Comm, folder: Path, **levels: Any) -> dict[str, float]:
    """Figures of one run, which continues from its newest checkpoint if there is one.

    Time [s] at which the tip arrives (the end of the run, if it does not), its angle [degrees] from the
    tube's axis and its speed [m/s] then, most edges that intersect the film after any step, errors of
    the balances of energy and gas mass, steps, and rejected steps ("rejected").
    """
    case = build(comm, **levels)
    saves = folder / "checkpoints"
    begun = comm.bcast(gx.run.latest_checkpoint(saves) is not None)
    series = gx.Series(case.probes)
    run = case.simulation([series], gx.Checkpoints(saves, every=50), saves if begun else None)
    run.run(until=UNTIL)
    last = {name: float(series[name][-1]) for name in case.probes}
    return {
        "time [s]": run.time,
        "angle [degrees]": math.degrees(abs(math.atan2(last["tip z [m]"], last["tip x [m]"]))),
        "speed [m/s]": last["tip speed [m/s]"],
        "penetrations": float(series["penetrations"].max()),
        "energy_error": abs(run.energy_error),
        "mass_error": abs(run.mass_error),
        "steps": run.step,
        "rejected": run.substeps,
    }


SWEEP = gx.sweep.RobustDesign(
    outcome,
    control={
        "start": ["zigzag", "roll"],
        "panels": [2, 3, 4],
        "thickness": [12.5e-6, 25e-6, 50e-6],
        "pressure": [1.0e6, 1.5e6, 2.0e6],
        "bore": [0.3e-3, 0.4e-3, 0.5e-3],
        "dead_volume": [0.1e-6, 0.2e-6, 0.4e-6],
        "lift": [1e-4, 2e-4, 3e-4],
    },
    noise={"state": list(STATES)},
    goals={"time [s]": "smaller", "angle [degrees]": "smaller", "speed [m/s]": "smaller"},
    usual={"panels": 3},
)
