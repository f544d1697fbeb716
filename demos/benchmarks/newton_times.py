"""Where the time of a Newton iteration of the free sheet goes."""

from __future__ import annotations

import time
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc
from stopwatch import Stopwatch

from demos.films.spinning_sheet import build
from gossamer_fx.solve.solvers.coarse_space import CoarseSpace

Figures = dict[str, float]


class TimedCoarseSpace:
    """Sums the time that the set-up of coarse spaces takes, which PETSc's log does not tell from
    the rest."""

    def __init__(self) -> None:
        self.seconds = 0.0
        original = CoarseSpace.set_up

        def timed(space: CoarseSpace, *given: Any) -> None:
            started = time.perf_counter()
            original(space, *given)
            self.seconds += time.perf_counter() - started

        CoarseSpace.set_up = timed


def logged(event: str) -> float:
    """Seconds in an event of PETSc's log."""
    return float(PETSc.Log.Event(event).getPerfInfo()["time"])


def profile(n: int = 40, steps: int = 3, dt: float = 1e-3) -> Figures:
    """Where the time of a Newton iteration of the free sheet goes, in seven parts.

    Newton's own clocks tell law, residual and tangent; PETSc's log the set-up and the applications
    of the preconditioner, of which the coarse space's set-up is timed here.  The rest is the Krylov
    method itself, Newton's vectors, and what a step does once.  All clocks are of wall time; as the
    machine may be shared, each part is given as its share of the run times the CPU time of an
    iteration.
    """
    coarse = TimedCoarseSpace()
    watch = Stopwatch()
    run = build(MPI.COMM_WORLD, n, dt=dt).simulation()
    # The log begins after the scene is compiled, so that it has the run only.
    PETSc.Log.begin()
    figures = watch.measure(run, steps * dt)
    clocks = run.solver.newton.seconds
    # What PETSc's event of set-up has beyond the coarse space is the incomplete factorisation.
    parts = {what: clocks[what] for what in ("law", "residual", "tangent")} | {
        "coarse space": coarse.seconds,
        "incomplete factorisation": logged("PCSetUp") - coarse.seconds,
        "applications": logged("PCApply"),
    }
    parts["rest"] = figures["wall"] - sum(parts.values())
    iteration = figures["iteration [ms]"]
    kept = ("cpu", "wall", "dofs", "steps", "Newton/step", "Krylov/Newton", "iteration [ms]")
    shares = {f"{what} [ms]": iteration * s / figures["wall"] for what, s in parts.items()}
    return {name: figures[name] for name in kept} | shares
