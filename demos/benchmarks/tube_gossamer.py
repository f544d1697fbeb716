"""The tube of the demo `inflate_tube`: its first `steps` steps."""

from __future__ import annotations

from contestants import words
from mpi4py import MPI
from stopwatch import Stopwatch, show

from demos.inflatables.inflate_tube import build

case = words({"cells": 14, "steps": 20, "dt": 1e-4})
watch = Stopwatch()
run = build(MPI.COMM_WORLD, cells=case["cells"], dt=case["dt"]).simulation()
figures = watch.measure(run, case["steps"] * case["dt"])
show(figures | {"p [Pa]": run.chamber("tube").pressure, "Δm/m": abs(run.mass_error)})
