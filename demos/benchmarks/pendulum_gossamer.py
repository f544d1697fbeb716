"""The pendulum of `demos/antenna_pendulum.py`."""

from __future__ import annotations

import json
import time

import numpy as np
from contestants import words
from mpi4py import MPI

import gossamer_fx as gx
from demos.antenna_pendulum import build

case = words({"n": 6, "elements": 12, "order": 2, "dt": 1e-2, "until": 2.0})
swing = build(MPI.COMM_WORLD, case["n"], case["elements"], case["until"], case["dt"], case["order"])
series = gx.Series(swing.probes)
run = swing.simulation([series])
cpu, wall = time.process_time(), time.perf_counter()
run.run(until=case["until"])
tip, film = series["tip [m]"], series["film [m]"]
result = {
    "cpu": time.process_time() - cpu,
    "wall": time.perf_counter() - wall,
    "dofs": run.system.numbering.size,
    "steps": run.step,
    "tip [mm]": 1e3 * tip[-1],
    "film, end [mm]": 1e3 * film[-1],
    "film, rms [mm]": 1e3 * float(np.sqrt(np.mean(film**2))),
    "film, largest [mm]": 1e3 * film.max(),
}
print(json.dumps(result))
