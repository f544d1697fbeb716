"""The pendulum of `demos/antenna_pendulum.py`."""

from __future__ import annotations

import json
import time

import numpy as np
from contestants import words
from mpi4py import MPI

import gossamer_fx as gx
from demos.antenna_attitude import antenna
from demos.antenna_pendulum import G, Record

case = words({"n": 6, "elements": 12, "order": 2, "dt": 1e-2, "until": 2.0})
model = antenna(MPI.COMM_WORLD, case["n"], case["elements"], case["order"])
corners = [model.film.port_at(point) for point in model.points[:4]]
hinge = gx.BallJoint(corners[2], gx.Ground(tuple(model.points[2].tolist())), "hinge")
weights = [gx.Gravity(body, (0, 0, -G)) for body in (model.film, *model.booms)]
record = Record(model.film, corners)
run = gx.Simulation(gx.Scene(*model.items, hinge, *weights), gx.Midpoint(dt=case["dt"]), [record])
cpu, wall = time.process_time(), time.perf_counter()
run.run(until=case["until"])
_, tip, film = np.array(record.rows).T
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
