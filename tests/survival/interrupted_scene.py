"""A scene file that sends itself the signal that the variable SIGNAL names, in the phase of PHASE:
setup, compilation, statics, scene, step, writing, closing."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.forms.compilation import kernel_options
from gossamer_fx.extend import Output
from gossamer_fx.meshes.sheet import sheet

TALK = MPI.COMM_WORLD.Dup()
# Completes when all ranks are in the phase.
ARRIVED: list[MPI.Request] = []
LAW = gx.Linear(E=1e6, nu=0.3, density=1000.0, thickness=1e-3)


def interrupt(phase: str) -> None:
    """Send the signal to this process, or once to the launcher of the ranks, if it is the phase."""
    # Not a variable of this module, with another value of which the scene would be another one.
    if phase != os.environ["PHASE"]:
        return
    if TALK.size == 1:
        os.kill(os.getpid(), signal.Signals[os.environ["SIGNAL"]])
    elif not ARRIVED:
        ARRIVED.append(TALK.Ibarrier())
        if TALK.rank == 0:
            # A rank that is late would be in an earlier phase when the signal comes.
            deadline = time.monotonic() + 5.0
            while not ARRIVED[0].Test() and time.monotonic() < deadline:
                time.sleep(0.01)
            # The parent of mpirun, which is the parent of a rank.
            status = Path(f"/proc/{os.getppid()}/stat").read_text()
            launcher = int(status.rpartition(")")[2].split()[1])
            os.kill(launcher, signal.Signals[os.environ["SIGNAL"]])
            # The signal goes by the launcher and mpirun.
            time.sleep(1.0)


def interrupt_compilation() -> None:
    """Send the signal as soon as a kernel is being compiled."""
    cache = Path(kernel_options()["cache_dir"])
    while not any(not path.with_suffix(".c.cached").exists() for path in cache.glob("*.c")):
        time.sleep(0.01)
    interrupt("compilation")


class Interrupting(Output):
    """An output that is interrupted while it writes, and while it closes its file."""

    times = ()

    def open(self, run: gx.Simulation) -> None: ...

    def record(self, run: gx.Simulation, last: bool) -> None:
        if run.step == 3:
            interrupt("writing")

    def close(self, run: gx.Simulation) -> None:
        interrupt("closing")


def held(film: gx.Membrane, motion: Callable[[np.ndarray, float], np.ndarray]) -> gx.Scene:
    """A film of which one edge is fixed and the other one moved."""
    return gx.Scene(film, gx.Fixed(film, "left"), gx.Fixed(film, "right", motion=motion))


def build(comm: MPI.Intracomm) -> gx.Case:
    """A film that is pulled, at rest first and then in time."""
    if os.environ["PHASE"] == "compilation" and comm.rank == 0:
        threading.Thread(target=interrupt_compilation, daemon=True).start()

    def still(X: np.ndarray) -> np.ndarray:
        interrupt("setup")
        return 0 * X

    def pulled(X: np.ndarray, t: float) -> np.ndarray:
        if t == 0:
            interrupt("statics")
        if t > 2.5e-3:
            interrupt("step")
        return np.vstack([1e-3 + 0 * X[0], 0 * X[0], 0 * X[0]])

    def film() -> gx.Membrane:
        return gx.Membrane(sheet(comm, 2, 2), LAW, displacement=still)

    gx.Equilibrium(held(film(), pulled)).find()
    interrupt("scene")
    return gx.Case(
        held(film(), pulled),
        gx.Midpoint(dt=1e-3),
        until=6e-3,
        fields={"film": ("displacement",)},
        outputs=[Interrupting()],
    )
