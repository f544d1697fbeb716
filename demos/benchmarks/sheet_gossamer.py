"""The free sheet of the demo `spinning_sheet`, of which the first steps are made."""

from __future__ import annotations

from contestants import words
from mpi4py import MPI
from stopwatch import Stopwatch, show

import gossamer_fx as gx
from demos.films.spinning_sheet import throw
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.solve.system.totals import relative_drift

case = words({"n": 40, "steps": 5, "dt": 1e-3, "wrinkling": 1, "relative": 1e-10})
watch = Stopwatch()
# A plastic film of 0.1 mm, in SI units.
constants = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
law = (
    gx.Miyazaki(**constants, residual_stiffness=1e-6)
    if case["wrinkling"]
    else gx.Linear(**constants)
)
n = case["n"]
film = gx.Membrane(sheet(MPI.COMM_WORLD, n, n), law, velocity=throw)
tolerances = gx.Tolerances(relative=case["relative"])
stepper = gx.Midpoint(
    dt=case["dt"],
    tolerances=tolerances,
)
run = gx.Simulation(gx.Scene(film), stepper)
figures = watch.measure(run, case["steps"] * case["dt"])
drift = relative_drift(run.totals.angular_momentum, run.first.angular_momentum)
show(figures | {"unconverged": 0, "ΔL/L": drift})
