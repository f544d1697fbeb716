"""Convergence of stage 2 of the demo `ikaros`: folds every 0.64 and 0.32 m with three steps.

Compared is what a designer asks: when the middles of the edges are 6 m out, how far the tips come,
and the spins of hub and sail.  Folds are where the mesh has them, so the finer sail has twice as
many layers, and is another sail until it is flat.
"""

from __future__ import annotations

from mpi4py import MPI

from demos.sails.ikaros import main
from demos.studies.engine.deployments import LEDGER
from demos.studies.engine.study import Study


def problem(comm: MPI.Comm, pitch: float, h: float, **options: float) -> dict[str, float]:
    return main(pitch=pitch, largest=h, comm=comm, **options)


STUDY = Study(
    "ikaros",
    "Convergence of stage 2 of IKAROS",
    problem,
    {"pitch": [0.64, 0.32], "h": [2e-2, 1e-2, 5e-3]},
    lambda case: case["h"],
    quick={"pitch": [0.8], "h": [2e-2]},
    quick_options={"until": 1.0},
    shows=("opened", "spin_of_hub", "spin_of_sail"),
    quick_shows=("spin_of_hub", "spin_of_sail"),
    limits={"energy_error": 1e-8, "penetrations": 0},
    columns=f"opened, largest_radius, radius, spin_of_hub, spin_of_sail, {LEDGER}",
    may_fail=True,
)
