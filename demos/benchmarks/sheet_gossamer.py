"""The free sheet of `demos/spinning_sheet.py`."""

from __future__ import annotations

import json
import resource
import time

import numpy as np
from contestants import words
from mpi4py import MPI

import gossamer_fx as gx
from demos.spinning_sheet import throw
from gossamer_fx.simulate import relative_drift
from meshes.sheet import sheet

case = words({"n": 40, "steps": 5, "dt": 1e-3, "wrinkling": 1})
constants = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
law = gx.Miyazaki(**constants, residual=1e-6) if case["wrinkling"] else gx.Linear(**constants)
n = case["n"]
film = gx.Membrane(sheet(MPI.COMM_WORLD, n, n), law, velocity=throw)
run = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=case["dt"]))
cpu, wall = time.process_time(), time.perf_counter()
run.run(until=case["steps"] * case["dt"])
result = {
    "cpu": time.process_time() - cpu,
    "wall": time.perf_counter() - wall,
    "dofs": run.system.numbering.size,
    "steps": case["steps"],
    "Newton/step": run.iterations / case["steps"],
    "unconverged": 0,
    "ΔL/L": relative_drift(run.totals.angular_momentum, run.first.angular_momentum),
    "Krylov/Newton": run.solver.newton.linear_iterations / run.iterations,
    "MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    "ΔE/E": float(np.abs(run.totals.energy / run.first.energy - 1)),
}
print(json.dumps(result))
