"""Where the time of a Newton iteration of the free sheet goes."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from stopwatch import Stopwatch

from demos.films.spinning_sheet import build
from gossamer_fx.solve.solvers import coarse_space, newton
from gossamer_fx.solve.solvers.coarse_space import CoarseSpace
from gossamer_fx.solve.solvers.two_level import TwoLevel

Figures = dict[str, float]

MANY = 10**9  # unknowns, more than any scene has


class Timed:
    """Sums the CPU seconds that functions of a class or module take in this process."""

    def __init__(self, owner: object, *names: str) -> None:
        self.seconds = dict.fromkeys(names, 0.0)
        for name in names:
            setattr(owner, name, self._timed(name, getattr(owner, name)))

    def _timed(self, name: str, original: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*given: Any) -> Any:
            started = time.process_time()
            result = original(*given)
            self.seconds[name] += time.process_time() - started
            return result

        return timed


def choose_levels(levels: int) -> None:
    """Let the coarse spaces of this process factorise their matrix (1), or give them a V-cycle of 2
    or 3 levels, whatever its size."""
    coarse_space.MAX_UNKNOWNS_FACTORISED = MANY if levels == 1 else 0
    coarse_space.MAX_UNKNOWNS_ON_ONE_RANK = MANY if levels == 2 else 0


def copying(A: PETSc.Mat) -> float:
    """CPU seconds in which a matrix is copied, as PETSc copies the overlapping parts of several
    ranks before it factorises them."""
    blocks = A.getSize()[0] // A.getBlockSize()
    rows = PETSc.IS().createBlock(A.getBlockSize(), np.arange(blocks, dtype=PETSc.IntType))
    copies = A.createSubMatrices([rows], [rows])
    started = time.process_time()
    A.createSubMatrices([rows], [rows], copies)
    return time.process_time() - started


def profile(n: int = 40, steps: int = 3, dt: float = 1e-3) -> Figures:
    """Where the time of a Newton iteration of the free sheet goes, in ten parts, and the time of
    a copy that several ranks make.

    The rest is the Krylov method itself, Newton's vectors, and what a step does once.  All clocks
    are of CPU time, as the machine may be shared.
    """
    coarse = Timed(CoarseSpace, "set_up", "_set_up_solver", "solve", "_solve_reduced")
    both = Timed(TwoLevel, "setUp", "apply")
    newton.time = SimpleNamespace(perf_counter=time.process_time)
    watch = Stopwatch()
    run = build(MPI.COMM_WORLD, n, dt=dt).simulation()
    figures = watch.measure(run, steps * dt)
    iterations = figures["Newton/step"] * figures["steps"]
    clocks = run.solver.newton.seconds
    # What the two levels need beyond the coarse space is the incomplete factorisation's.
    parts = {what: clocks[what] for what in ("law", "residual", "tangent")} | {
        "coarse matrix": coarse.seconds["set_up"] - coarse.seconds["_set_up_solver"],
        "coarse factors": coarse.seconds["_set_up_solver"],
        "incomplete factorisation": both.seconds["setUp"] - coarse.seconds["set_up"],
        "coarse solutions": coarse.seconds["_solve_reduced"],
        "prolongations": coarse.seconds["solve"] - coarse.seconds["_solve_reduced"],
        "applications": both.seconds["apply"] - coarse.seconds["solve"],
    }
    parts["rest"] = figures["cpu"] - sum(parts.values())
    kept = ("cpu", "dofs", "steps", "Newton/step", "Krylov/Newton", "iteration [ms]")
    milliseconds = {f"{what} [ms]": 1e3 * s / iterations for what, s in parts.items()}
    copy = {"copy on several ranks [s]": copying(run.system.A)}
    return {name: figures[name] for name in kept} | milliseconds | copy
