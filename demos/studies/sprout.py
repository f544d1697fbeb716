"""Convergence of the demo `sprout`: two tubes of 0.6 m in V that unfold a film, on three meshes
with three steps.

Compared is what a designer asks: how far apart the tips are at 120 ms and how far in front of the
cube, how it turns, and the pressures.  Folded film moves chaotically, so a row is also computed
with the tank's pressure changed by 1e-9 of itself ("nudged"): what differs between the two is what
no mesh and no step can tell.
"""

from __future__ import annotations

from mpi4py import MPI

from demos.inflatables.sprout import main
from demos.studies.engine.deployments import LEDGER, STARTS, nudged
from demos.studies.engine.study import Study


def problem(
    comm: MPI.Comm, start: str, cell: float, h: float, until: float = 0.12
) -> dict[str, float]:
    """Deploy tubes and film with cells of some length [m] and steps of at most h [s]."""
    found = main(
        until=until,
        length=0.6,
        rows=1,
        tank=5e-4,
        damping=3e-4,
        cell=cell,
        # Widths of cells in proportion to the length, as those of the demo.
        fine=0.2 * cell / 0.06,
        coarse=0.3 * cell / 0.06,
        largest=h,
        dt=min(h, 1e-4),
        pressure=nudged(20e3, start),
        comm=comm,
    )
    pressures = [value for name, value in found.items() if name.startswith("pressure")]
    return found | {"least pressure": min(pressures), "largest pressure": max(pressures)}


STUDY = Study(
    "sprout",
    "Convergence of the deployment of two tubes and a film",
    problem,
    {"cell": [0.06, 0.045, 0.034], "start": STARTS, "h": [2e-4, 1e-4, 5e-5]},
    lambda case: case["h"],
    quick={"start": ["usual"], "cell": [0.06], "h": [4e-4]},
    quick_options={"until": 5e-3},
    shows=("span", "reach", "spin"),
    limits={"energy_error": 1e-8, "penetrations": 0},
    columns=f"span, reach, spin, least pressure, largest pressure, {LEDGER}",
    may_fail=True,
)
