"""A run with steps of two seconds as a separate program: python3 -m tests.survival.long_steps
FOLDER."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from mpi4py import MPI

import gossamer_fx as gx
from tests.survival.scenes import DT, fluttering_sheet


def slow(t: float) -> float:
    """No pressure, after two seconds."""
    if t > 2 * DT:
        if MPI.COMM_WORLD.rank == 0:
            print("step", flush=True)
        until = time.monotonic() + 2
        while time.monotonic() < until:
            time.sleep(0.01)
    return 0.0


def main() -> None:
    out = Path(sys.argv[1])
    film = next(iter(fluttering_sheet(MPI.COMM_WORLD, 2).items))
    saves = gx.Checkpoints(out / "saves", every=1000)
    scene = gx.Scene(film, gx.Pressure(film, slow))
    gx.Simulation(
        scene, gx.Midpoint(dt=DT), outputs=[gx.Recording(out / "run", every=1)], checkpoints=saves
    ).run(until=1.0)


if __name__ == "__main__":
    main()
