"""The antenna of the demo `antenna_pendulum`, whose film multipliers tie to the booms: its first
`steps` steps."""

from __future__ import annotations

from contestants import words
from mpi4py import MPI
from stopwatch import Stopwatch, show

from demos.antennas.antenna_pendulum import build

case = words({"cells": 20, "steps": 3, "dt": 5e-3})
watch = Stopwatch()
run = build(
    MPI.COMM_WORLD,
    case["cells"],
    2 * case["cells"],
    dt=case["dt"],
).simulation()
show(watch.measure(run, case["steps"] * case["dt"]))
