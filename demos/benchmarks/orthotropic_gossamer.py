"""The law of orthotropic film against that of isotropic film, on the thrown free sheet of the study
`orthotropic`.

The two sheets take turns, a step each, so that what else runs on the machine slows both down.  All
clocks are of CPU time.
"""

from __future__ import annotations

import time
from types import SimpleNamespace

import numpy as np
from contestants import words
from mpi4py import MPI
from stopwatch import show

import gossamer_fx as gx
from demos.studies.orthotropic import AXES, DT, LAWS, MASS, thrown
from gossamer_fx.mechanics.materials.film import FilmLaw
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.solve.solvers import newton

# Steps before the first that is measured: the sheet begins to wrinkle.
FIRST_STEPS = 2
# Stiffnesses per width of braids for inflatable decelerators [N/m]; their condition is 124 and 323.
STEEP_BRAID = gx.Orthotropic.from_stiffnesses(75.6e3, 502.0e3, 4014.0e3, 504.1e3, **AXES, **MASS)
FILMS: dict[str, FilmLaw] = {
    "isotropic": LAWS["TensionField"],
    "fabric": LAWS["10:1"],
    "braid": LAWS["braid"],
    "steep braid": STEEP_BRAID,
}


def free_sheet(law: str, order: int, n: int) -> gx.Simulation:
    """A free sheet of n × n × 2 triangles."""
    mesh = sheet(MPI.COMM_WORLD, n, n)
    film = gx.Membrane(mesh, FILMS[law], order=order, velocity=thrown)
    return gx.Simulation(gx.Scene(film), gx.Midpoint(dt=DT))


case = words({"law": "braid", "order": 1, "n": 48, "steps": 20})
# The solver's clocks tell wall time; here the machine may be shared.
newton.time = SimpleNamespace(perf_counter=time.process_time)
runs = {law: free_sheet(law, case["order"], case["n"]) for law in ("isotropic", case["law"])}
for run in runs.values():
    run.run(until=FIRST_STEPS * DT)
measured: dict[str, list[tuple[float, int]]] = {law: [] for law in runs}
cpu = time.process_time()
wall = time.perf_counter()
for step in range(FIRST_STEPS + 1, FIRST_STEPS + case["steps"] + 1):
    for law, run in runs.items():
        solver = run.solver.newton
        seconds = solver.seconds["law"]
        iterations = solver.all_iterations
        run.run(until=step * DT)
        measured[law].append((solver.seconds["law"] - seconds, solver.all_iterations - iterations))
law_times = {
    law: float(np.median([seconds / iterations for seconds, iterations in steps]))
    for law, steps in measured.items()
}
newton_steps = {
    law: float(np.mean([iterations for _, iterations in steps])) for law, steps in measured.items()
}
own = case["law"]
show(
    {
        "ratio": law_times[own] / law_times["isotropic"],
        "cpu": time.process_time() - cpu,
        "wall": time.perf_counter() - wall,
        "dofs": runs[own].system.numbering.size,
        "steps": case["steps"],
        "law [ms]": 1e3 * law_times[own],
        "isotropic law [ms]": 1e3 * law_times["isotropic"],
        "Newton/step": newton_steps[own],
        "isotropic Newton/step": newton_steps["isotropic"],
    }
)
