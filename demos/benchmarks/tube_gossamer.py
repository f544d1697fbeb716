"""The tube of `demos/inflate_tube.py`: `steps` steps after the first `skip` ones."""

from __future__ import annotations

from contestants import words
from mpi4py import MPI
from stopwatch import Stopwatch, show

from demos.inflate_tube import build

case = words({"cells": 14, "steps": 20, "skip": 0, "dt": 1e-4})
watch = Stopwatch()
run = build(MPI.COMM_WORLD, cells=case["cells"], dt=case["dt"]).simulation([])
run.run(until=case["skip"] * case["dt"])
figures = watch.measure(run, (case["skip"] + case["steps"]) * case["dt"])
show(figures | {"p [Pa]": run.chamber("tube").p, "Δm/m": abs(run.mass_error)})
