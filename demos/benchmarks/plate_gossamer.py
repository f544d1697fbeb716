"""The cantilever and the slit ring of Sze, Liu & Lo under their whole load at once; see
`demos/studies/plate.py`."""

from __future__ import annotations

import json
import time

from contestants import words
from mpi4py import MPI
from plate_problems import CASES

import gossamer_fx as gx
from gossamer_fx.meshes.plates import slit_ring
from gossamer_fx.meshes.sheet import sheet

case = words({"shape": "strip", "n": 16, "step": 50.0})
shape = CASES[case["shape"]]
n = case["n"]
# Without a Poisson effect the strip has the closed form of a beam.
law = gx.Linear(E=shape.E, nu=0.0, density=1.0, thickness=shape.thickness)
if case["shape"] == "strip":
    plate = gx.Plate(sheet(MPI.COMM_WORLD, n, max(n // 8, 1), 10.0, 1.0), law)
    held = "left"
    loaded = "right"
else:
    plate = gx.Plate(slit_ring(MPI.COMM_WORLD, n // 2, 4 * n, 6.0, 10.0), law)
    held = "end"
    loaded = "start"
load = gx.loads.EdgeLoad(plate, loaded, force=(0.0, 0.0, shape.load))
search = gx.Equilibrium(
    gx.Scene(plate, gx.Fixed(plate, held, rotation=True), load),
    gx.analysis.Continuation(first_step=case["step"]),
)
cpu = time.process_time()
wall = time.perf_counter()
found = search.find()
cpu = time.process_time() - cpu
wall = time.perf_counter() - wall
# Vertical coordinates; the reference is the largest deflection of the loaded edge.
z = search.system.q0.array_r[2::3]
result = {
    "cpu": cpu,
    "wall": wall,
    "dofs": search.system.numbering.size,
    "steps": found.iterations,
    "W": float(z[plate.nodes(loaded)].max()),
}
print(json.dumps(result | {"error [%]": 100 * abs(result["W"] / shape.deflection - 1)}))
