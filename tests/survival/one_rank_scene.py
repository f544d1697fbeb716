"""A scene in which one rank ends, or never returns: PLACE=probe|load|output|file|build and
HOW=exit|ctrl-c|os-exit|abort|never."""

from __future__ import annotations

import os
import sys
import time

from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.extend import Output
from gossamer_fx.meshes.sheet import sheet

# Of the environment, as the file itself may be one.
PLACE = os.environ["PLACE"]
HOW = os.environ["HOW"]
DT = 1e-3


def end(place: str) -> None:
    """End on the last rank if this is it."""
    if place != PLACE or MPI.COMM_WORLD.rank < MPI.COMM_WORLD.size - 1:
        return
    if HOW == "exit":
        sys.exit(3)
    if HOW == "ctrl-c":
        raise KeyboardInterrupt
    if HOW == "os-exit":
        os._exit(3)
    if HOW == "abort":
        os.abort()
    while True:
        time.sleep(0.01)


class Watcher(Output):
    """An output of the user."""

    def record(self, run: gx.Simulation, last: bool) -> None:
        if run.step == 3:
            end("output")


end("file")


def build(comm: MPI.Intracomm) -> gx.Case:
    end("build")
    law = gx.Miyazaki(1e9, 0.3, density=1000.0, thickness=1e-4)
    film = gx.Membrane(sheet(comm, 2, 2), law, name="film")

    def pressure(time: float) -> float:
        if time > 3 * DT:
            end("load")
        return 0.0

    def probe(run: gx.Simulation) -> float:
        if run.step == 3:
            end("probe")
        return 0.0

    return gx.Case(
        gx.Scene(film, gx.Pressure(film, pressure)),
        gx.Midpoint(dt=DT),
        until=6 * DT,
        probes={"a": probe},
        outputs=[Watcher()],
    )
