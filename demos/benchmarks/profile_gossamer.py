"""Where the time of a Newton iteration of the free sheet goes, in seven parts.

Newton's own clocks tell law, residual and tangent; PETSc's log the set-up and the applications of
the preconditioner, of which the coarse space's set-up is timed here.  The rest is the Krylov method
itself, Newton's vectors, and what a step does once.  All clocks are of wall time; as the machine
may be shared, each part is given as its share of the run times the CPU time of an iteration.
"""

from __future__ import annotations

import time
from typing import Any

from contestants import words
from mpi4py import MPI
from petsc4py import PETSc
from stopwatch import Stopwatch, show

from demos.films.spinning_sheet import build
from gossamer_fx.solve.solvers.coarse_space import CoarseSpace


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


case = words({"n": 40, "steps": 3, "dt": 1e-3})
coarse = TimedCoarseSpace()
watch = Stopwatch()
run = build(MPI.COMM_WORLD, case["n"], dt=case["dt"]).simulation()
# The log begins after the scene is compiled, so that it has the run only.
PETSc.Log.begin()
figures = watch.measure(run, case["steps"] * case["dt"])
clocks = run.solver.newton.seconds
# What PETSc's event of set-up has beyond the coarse space is the incomplete factorisation.
parts = {what: clocks[what] for what in ("law", "residual", "tangent")} | {
    "coarse space": coarse.seconds,
    "incomplete factorisation": logged("PCSetUp") - coarse.seconds,
    "applications": logged("PCApply"),
}
parts["rest"] = figures["wall"] - sum(parts.values())
iteration = figures["iteration [ms]"]
show(
    {
        key: figures[key]
        for key in (
            "cpu",
            "wall",
            "dofs",
            "steps",
            "Newton/step",
            "Krylov/Newton",
            "iteration [ms]",
        )
    }
    | {f"{what} [ms]": iteration * seconds / figures["wall"] for what, seconds in parts.items()}
)
