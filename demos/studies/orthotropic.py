"""What an orthotropic law costs in iterations, and what it keeps: the thrown free sheet of films of
growing anisotropy.

The sheet of 1 m spins and flutters, so that every cell switches between taut, wrinkled and slack.
Measured are Newton iterations a step, rejected steps, the largest errors of energy and momenta.
"""

from __future__ import annotations

import math

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.engine.study import Study
from gossamer_fx.extend import FilmLaw
from meshes.sheet import sheet

# Step [s], and cells along an edge of 1 m.
DT = 1e-3
CELLS = 10
# kg/m³ and m, as of the isotropic film.
MASS = {"density": 1400.0, "thickness": 1e-4}
# The first axis of the material is not along edges of the mesh.
AXES = {"direction": (1.0, 0.3, 0.0)}

LAWS: dict[str, FilmLaw] = {
    "TensionField": gx.TensionField(1e9, 0.3, **MASS),
    "1:1": gx.Orthotropic(1e9, 1e9, 0.3, 1e9 / 2.6, **AXES, **MASS),
    "10:1": gx.Orthotropic(1e9, 1e8, 0.3, 5e7, **AXES, **MASS),
    "100:1": gx.Orthotropic(1e9, 1e7, 0.3, 5e6, **AXES, **MASS),
    # stiffnesses per width of a braid, condition 124
    "braid": gx.Orthotropic.from_stiffnesses(335.8e3, 704.1e3, 1525.8e3, 702.9e3, **AXES, **MASS),
}


def thrown(X: np.ndarray) -> np.ndarray:
    """A spin with flutter."""
    x, y, _ = X
    return np.vstack([-5 * (y - 0.5), 5 * (x - 0.5), np.sin(np.pi * x) * np.sin(2 * np.pi * y)])


def problem(comm: MPI.Comm, law: str, steps: int) -> dict[str, float]:
    """A free sheet of 10 × 10 × 2 triangles."""
    film = gx.Membrane(sheet(comm, CELLS, CELLS), LAWS[law], velocity=thrown)
    run = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=DT))
    run.run(until=steps * DT)
    mass = MASS["density"] * MASS["thickness"]
    scale = math.sqrt(2 * mass * run.first.kinetic)
    momentum = abs(run.totals.momentum - run.first.momentum).max()
    angular = abs(run.totals.angular_momentum - run.first.angular_momentum).max()
    return {
        "newton_per_step": run.iterations / steps,
        "substeps": run.substeps,
        "energy_error": abs(run.energy_error),
        "momentum_error": float(momentum / scale),
        "angular_momentum_error": float(angular / scale),
        "seconds": run.seconds,
    }


STUDY = Study(
    "orthotropic",
    "Orthotropic films and the isotropic one, on a thrown free sheet",
    problem,
    {"law": list(LAWS), "steps": [200]},
    lambda case: case["steps"],
    quick={"law": ["TensionField", "braid"], "steps": [20]},
    shows=("newton_per_step",),
    limits={"energy_error": 1e-8, "momentum_error": 1e-8, "angular_momentum_error": 1e-8},
    columns="newton_per_step, substeps, energy_error, momentum_error, angular_momentum_error",
)
