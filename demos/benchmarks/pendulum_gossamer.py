"""The pendulum of the demo `antenna_pendulum`."""

from __future__ import annotations

import numpy as np
from contestants import words
from mpi4py import MPI
from stopwatch import Stopwatch, show

import gossamer_fx as gx
from demos.antennas.antenna_pendulum import build

case = words({"n": 6, "elements": 12, "order": 2, "dt": 1e-2, "until": 2.0})
watch = Stopwatch()
swing = build(MPI.COMM_WORLD, case["n"], case["elements"], case["until"], case["dt"], case["order"])
series = gx.Series(swing.probes)
figures = watch.measure(swing.simulation([series]), case["until"])
tip = series["tip [m]"]
film = series["film [m]"]
# At the end and over the time: the film vibrates, so that its value at the end depends on the
# phase.
show(
    figures
    | {
        "tip [mm]": 1e3 * tip[-1],
        "film, end [mm]": 1e3 * film[-1],
        "film, rms [mm]": 1e3 * np.sqrt(np.mean(film**2)),
        "film, largest [mm]": 1e3 * film.max(),
    }
)
