"""A Newton iteration of the free sheet, and what it cannot do without.

The limit is the time of one tangent, one set-up of the preconditioner and, for each Krylov
iteration, one application of it and one product with the matrix; each is timed apart, again and
again on the last system of the run.  The tangent is then compared with the memory traffic that its
matrix alone causes: the time of writing it once, at the speed at which the same process copies
large arrays.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median
from types import SimpleNamespace
from typing import Any

import numpy as np
from mpi4py import MPI
from stopwatch import Stopwatch

from demos.films.spinning_sheet import build
from gossamer_fx.solve.solvers import factorisation, newton
from gossamer_fx.solve.solvers.coarse_space import CoarseSpace
from gossamer_fx.solve.solvers.two_level import TwoLevel

Figures = dict[str, float]


def seconds(action: Callable[[], object], times: int = 15) -> float:
    """Median CPU time of an action: the machine may be shared."""

    def once() -> float:
        started = time.process_time()
        action()
        return time.process_time() - started

    return median(once() for _ in range(times))


def copying_speed(size: int = 2**25, times: int = 9) -> float:
    """Bytes read and written a second in copying `size` numbers."""
    source = np.ones(size)
    target = np.zeros(size)
    # Every number is read once and written once.
    return 2 * source.nbytes / seconds(lambda: np.copyto(target, source), times)


def limit(n: int = 40, steps: int = 3, dt: float = 1e-3) -> Figures:
    """A Newton iteration of the free sheet over what it cannot do without."""
    watch = Stopwatch()
    run = build(MPI.COMM_WORLD, n, dt=dt).simulation()
    figures = watch.measure(run, steps * dt)
    system = run.system
    ksp = run.solver.newton.ksp
    A = system.A
    preconditioner = ksp.getPC()
    x, y = A.createVecs()
    x.setRandom()

    def set_up() -> None:
        A.stateIncrease()  # what is set up for a matrix stays until it changes
        ksp.setOperators(A)
        ksp.setUp()
        ksp.setUpOnBlocks()

    tangent = seconds(system.tangent)
    application = seconds(lambda: preconditioner.apply(x, y))
    product = seconds(lambda: A.mult(x, y))
    setting_up = seconds(set_up)
    cycle = application + product
    speed = copying_speed()
    # Bytes of a matrix in blocks: 8 for each number, and 4 for the column of each block.
    numbers = A.getInfo()["nz_used"]
    written = numbers * 8 + numbers / A.getBlockSize() ** 2 * 4
    # The time of an iteration if it made nothing but these parts.
    limit = tangent + setting_up + figures["Krylov/Newton"] * cycle
    return figures | {
        "over limit": figures["iteration [ms]"] / (1e3 * limit),
        "one tangent [ms]": 1e3 * tangent,
        "one set-up [ms]": 1e3 * setting_up,
        "one cycle [ms]": 1e3 * cycle,
        "matrix [MB]": written / 2**20,
        "copy [GB/s]": speed / 1e9,
        "tangent/traffic": tangent * speed / written,
    }


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


def profile(n: int = 40, steps: int = 3, dt: float = 1e-3) -> Figures:
    """Where the time of a Newton iteration of the free sheet goes, in nine parts.

    The rest is the Krylov method itself, Newton's vectors, and what a step does once.  All clocks
    are of CPU time, as the machine may be shared.
    """
    coarse = Timed(CoarseSpace, "set_up", "solve")
    coarse_factors = Timed(factorisation, "set_up")
    both = Timed(TwoLevel, "setUp", "apply")
    newton.time = SimpleNamespace(perf_counter=time.process_time)
    watch = Stopwatch()
    run = build(MPI.COMM_WORLD, n, dt=dt).simulation()
    figures = watch.measure(run, steps * dt)
    clocks = run.solver.newton.seconds
    # What the two levels need beyond the coarse space is the incomplete factorisation's.
    parts = {what: clocks[what] for what in ("law", "residual", "tangent")} | {
        "coarse matrix": coarse.seconds["set_up"] - coarse_factors.seconds["set_up"],
        "coarse factors": coarse_factors.seconds["set_up"],
        "incomplete factorisation": both.seconds["setUp"] - coarse.seconds["set_up"],
        "coarse solutions": coarse.seconds["solve"],
        "applications": both.seconds["apply"] - coarse.seconds["solve"],
    }
    parts["rest"] = figures["cpu"] - sum(parts.values())
    kept = ("cpu", "dofs", "steps", "Newton/step", "Krylov/Newton", "iteration [ms]")
    iterations = figures["Newton/step"] * figures["steps"]
    return {name: figures[name] for name in kept} | {
        f"{what} [ms]": 1e3 * s / iterations for what, s in parts.items()
    }
