"""A run of the small tube as a separate program: python3 -m tests.survival.tube_run FOLDER STEPS
[--restart]."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from tests.survival.scenes import filled_tube

DT = 1e-4


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("steps", type=int)
    parser.add_argument("--restart", action="store_true")
    parser.add_argument("--every", type=int, default=3)
    wanted = parser.parse_args()
    scene = filled_tube(MPI.COMM_WORLD)
    out = wanted.folder
    tube = next(item for item in scene.items if item.name == "tube")
    outputs = [
        gx.Ledger(out / "ledger.csv"),
        gx.outputs.Probes(
            out / "gas.csv",
            {"p": gx.probes.GasState(tube, "pressure"), "V": gx.probes.GasState(tube, "volume")},
            every=2,
        ),
        gx.outputs.VTU(out / "tube.pvd", every=4),
    ]
    saves = gx.Checkpoints(out / "checkpoints", every=wanted.every)
    restart = gx.run.latest_checkpoint(saves.folder) if wanted.restart else None
    run = gx.Simulation(
        scene, gx.Midpoint(dt=DT), outputs=outputs, checkpoints=saves, restart=restart
    )
    if run.comm.rank == 0:
        print("ready", flush=True)
    run.run(until=wanted.steps * DT)
    q = run.system.unknowns.q0.array_r.reshape(-1, 3)
    moments = run.comm.allreduce(np.concatenate([q.sum(axis=0), (q**2).sum(axis=0)]))
    if run.comm.rank == 0:
        tube_now = run.chamber("tube")
        np.savetxt(
            out / "end.txt",
            [*moments, tube_now.pressure, tube_now.volume, run.totals.kinetic, run.totals.energy],
        )


if __name__ == "__main__":
    main()
