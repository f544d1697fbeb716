"""A plate folded along a crease and thrown: how long a step may be where the crease is stiff and
the flight fast.

Two panels of 50 × 20 mm, t = 50 µm, folded by 80° along a crease that is at rest when flat, fly
with spin and waves across, through flat and back.  The crease has 1, 20 and 400 times the stiffness
of 2 mN m/m/rad, the throw 1 and 10 times a spin of 1 rad/s with waves of 0.4 m/s.

The turn of the fold in a step limits the step (docs/theory/creases.md), and so do the waves of a
fast throw: with the tenfold speed, steps of 0.2 ms were rejected again and again.  A fold turns
with the root of its stiffness, waves with the speed, so steps and ends of the runs are those of the
softest crease and the slowest throw over the larger one of both: 100 steps of 0.2 ms, or 400 of
50 µs.  Wanted: no step fails, less than 5 % are rejected, energy 1e-9, angular momentum 1e-10.
"""

from __future__ import annotations

import math
import time

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.crease import folded
from demos.studies.engine.study import Measure, Study
from gossamer_fx.meshes.creased_strip import creased_strip

# Length of a panel and width of the strip [m].
LENGTH = 0.05
WIDTH = 0.02
# Of the softest crease [N m/m/rad].
STIFFNESS = 2e-3
# End of a run with the softest crease and the slowest throw [s].
UNTIL = 0.02
LAW = gx.Linear(E=2.5e9, nu=0.3, density=1400.0, thickness=50e-6)


def thrown(speed: float, X: np.ndarray) -> np.ndarray:
    """Velocities (3, n) [m/s] at points X (3, n): a turn, and a wave across the strip."""
    # Not symmetric about the crease or the middle line, so that no motion is left out.
    across = 0.4 * np.sin(40 * X[0]) * (1 + 20 * X[1])
    return speed * np.stack([X[1] - 0.01, -X[0], across])


def problem(
    comm: MPI.Comm, stiffness: float, speed: float, h: float, cells: int, until: float = UNTIL
) -> dict[str, float]:
    """Stiffness and speed as multiples of the softest and slowest; time step h [s] and end of the
    run [s] of these; cells along a panel."""
    mesh = creased_strip(comm, cells, 3, LENGTH, WIDTH)
    plate = gx.Plate(
        mesh,
        LAW,
        hinges=["crease"],
        displacement=folded(math.radians(80)),
        velocity=lambda X: thrown(speed, X),
    )
    crease = gx.connectors.Crease(plate, "crease", stiffness=stiffness * STIFFNESS)
    series = gx.Series({"angle": gx.probes.FoldAngle(crease)})
    faster = max(math.sqrt(stiffness), speed)
    run = gx.Simulation(gx.Scene(plate, crease), gx.Midpoint(dt=h / faster), outputs=[series])
    began = time.process_time()
    run.run(until=until / faster)
    angles = np.degrees(series["angle"])
    drift = run.totals.angular_momentum - run.first.angular_momentum
    return {
        "rejected": run.substeps / (until / h),
        "energy": run.energy_error,
        "angular momentum": float(np.abs(drift).max() / np.abs(run.first.angular_momentum).max()),
        "iterations": run.iterations / run.step,
        "least angle": float(angles.min()),
        "largest angle": float(angles.max()),
        "largest turn": float(np.abs(np.diff(angles)).max()),
        "seconds": time.process_time() - began,
    }


STUDY = Study(
    "thrown_crease",
    "A creased plate thrown",
    problem,
    {"stiffness": [1.0, 20.0, 400.0], "speed": [1.0, 10.0], "h": [2e-4, 5e-5], "cells": [8]},
    lambda case: LENGTH / case["cells"],
    (
        Measure("rejected", 0.0, 0.05),
        Measure("energy", 0.0, 1e-9),
        Measure("angular momentum", 0.0, 1e-10),
    ),
    quick={"stiffness": [1.0], "speed": [1.0], "h": [2e-4]},
    quick_options={"until": 2e-3},
    not_repeatable=dict.fromkeys(
        ("energy", "angular momentum"), "a balance at round-off, judged by its tolerance"
    ),
    columns="least angle, largest angle, largest turn, iterations, seconds",
)
