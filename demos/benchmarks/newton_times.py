"""Where the time of a Newton iteration of the free sheet goes."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from stopwatch import Stopwatch, Timed

from demos.films.spinning_sheet import build
from gossamer_fx.solve.solvers import coarse_space, newton
from gossamer_fx.solve.solvers.coarse_space import CoarseSpace
from gossamer_fx.solve.solvers.two_level import TwoLevel

Figures = dict[str, float]

MANY = 10**9  # unknowns, more than any scene has

# Applications and parts of them whose time is summed.
REPETITIONS = 20


def shares_of_application(multigrid: PETSc.PC) -> tuple[float, float]:
    """The parts of the CPU time of an application that the mesh itself takes, and the prolongation
    to it.  They are timed one by one, as PETSc makes the whole application."""
    mesh = multigrid.getMGSmoother(multigrid.getMGLevels() - 1)
    P = multigrid.getMGInterpolation(multigrid.getMGLevels() - 1)
    r, z = multigrid.getOperators()[0].createVecs()
    r.set(1.0)
    reduced = P.createVecRight()

    def seconds(part: Callable[[], object]) -> float:
        part()
        started = time.process_time()
        for _ in range(REPETITIONS):
            part()
        return time.process_time() - started

    def prolong() -> None:
        P.multTranspose(r, reduced)
        P.mult(reduced, z)

    whole = seconds(lambda: multigrid.apply(r, z))
    return seconds(lambda: mesh.solve(r, z)) / whole, seconds(prolong) / whole


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
    coarse = Timed(CoarseSpace, "set_up", "_set_up_solvers")
    both = Timed(TwoLevel, "setUp", "apply")
    newton.time = SimpleNamespace(perf_counter=time.process_time)
    watch = Stopwatch()
    run = build(MPI.COMM_WORLD, n, dt=dt).simulation()
    figures = watch.measure(run, steps * dt)
    iterations = figures["Newton/step"] * figures["steps"]
    clocks = run.solver.newton.seconds
    preconditioner = run.solver.newton._preconditioner.getPythonContext()
    on_mesh, prolongations = shares_of_application(preconditioner._multigrid)
    # What the set-up of both levels needs beyond the coarse space is the incomplete
    # factorisation's.
    parts = {what: clocks[what] for what in ("law", "residual", "tangent")} | {
        "coarse matrix": coarse.seconds["set_up"] - coarse.seconds["_set_up_solvers"],
        "coarse factors": coarse.seconds["_set_up_solvers"],
        "incomplete factorisation": both.seconds["setUp"] - coarse.seconds["set_up"],
        "coarse solutions": both.seconds["apply"] * (1 - on_mesh - prolongations),
        "prolongations": both.seconds["apply"] * prolongations,
        "applications": both.seconds["apply"] * on_mesh,
    }
    parts["rest"] = figures["cpu"] - sum(parts.values())
    kept = ("cpu", "dofs", "steps", "Newton/step", "Krylov/Newton", "iteration [ms]")
    milliseconds = {f"{what} [ms]": 1e3 * s / iterations for what, s in parts.items()}
    copy = {"copy on several ranks [s]": copying(run.system.matrices.A)}
    return {name: figures[name] for name in kept} | milliseconds | copy
