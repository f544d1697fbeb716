"""A run that meets a fault, as a separate program: python3 -m tests.survival.faults FOLDER WHAT."""

from __future__ import annotations

import contextlib
import errno
import os
import resource
import shutil
import sys
from pathlib import Path

from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.checks import ending, errors
from gossamer_fx.extend import Output
from tests.survival.scenes import DT, fluttering_sheet
from tests.survival.small_disk import NOT_ALLOWED, made_read_only

COMM = MPI.COMM_WORLD
NEVER_SENT = 4711  # tag of a message


class Trouble(Output):
    """An output that makes trouble after a step."""

    times = ()

    def __init__(self, what: str, out: Path, step: int = 6) -> None:
        self.what = what
        self.out = out
        self.step = step

    def open(self, run: gx.Simulation) -> None:
        pass

    def record(self, run: gx.Simulation, last: bool) -> None:
        if run.step != self.step:
            return
        match self.what:
            case "full" if COMM.rank == 0:
                # no file may become larger than the largest is now
                size = max(p.stat().st_size for p in self.out.rglob("*") if p.is_file())
                resource.setrlimit(resource.RLIMIT_FSIZE, (size // 2, size // 2))
            case "full-disk" if COMM.rank == 0:
                with contextlib.suppress(OSError), (self.out / "filler").open("wb") as file:
                    file.write(bytes(3_000_000))
            case "read-only" if COMM.rank == 0:
                if not made_read_only(str(self.out)):
                    COMM.Abort(NOT_ALLOWED)
            case "ledger removed" if COMM.rank == 0:
                (self.out / "ledger.csv").unlink()
            case "folder removed" if COMM.rank == 0:
                shutil.rmtree(self.out / "checkpoints")
                (self.out / "checkpoints").write_text("no folder")
            case "stuck":
                # as of a library in which the other ranks wait for the one that has failed
                errors.WRITE_PATIENCE = 1.0
                errors.write_on_all(COMM, self.out / "fields", fail_on_first_rank)
            case "one rank" if COMM.rank == COMM.size - 1:
                ending.PATIENCE = 1.0
                raise ZeroDivisionError("of this rank alone")
            case "every rank":
                raise ZeroDivisionError("of all ranks")

    def close(self, run: gx.Simulation) -> None:
        pass


def fail_on_first_rank() -> None:
    """Fail like a library that other ranks do not leave, as they wait for the first one."""
    if COMM.rank == 0:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    COMM.recv(source=0, tag=NEVER_SENT)


def main() -> None:
    out = Path(sys.argv[1])
    what = sys.argv[2]
    outputs = [
        gx.Ledger(out / "ledger.csv"),
        gx.outputs.Probes(out / "probes.csv", {"one": lambda run: 1.0}),
        *(
            [gx.outputs.VTU(out / "film.pvd", fields=("displacement", "state"))]
            if "fields" in sys.argv[3:]
            else []
        ),
        Trouble(what, out),
    ]
    saves = gx.Checkpoints(out / "checkpoints", every=2)
    restart = out / "checkpoints" if "restart" in sys.argv[3:] else None
    if "no room" in sys.argv[3:]:
        resource.setrlimit(
            resource.RLIMIT_FSIZE, (2048, 2048)
        )  # as on a disk that is full from the start
    try:
        run = gx.Simulation(
            fluttering_sheet(COMM),
            gx.Midpoint(dt=DT),
            outputs=outputs,
            checkpoints=saves,
            restart=restart,
        )
        run.run(until=(60 if restart else 20) * DT)
    except (gx.InputError, gx.OutputFailure) as failure:
        if COMM.rank == 0:
            print(failure, flush=True)
        sys.exit(3)


if __name__ == "__main__":
    main()
