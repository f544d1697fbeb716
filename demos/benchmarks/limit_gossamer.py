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

import numpy as np
from contestants import words
from mpi4py import MPI
from stopwatch import Stopwatch, show

from demos.films.spinning_sheet import build


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


case = words({"n": 40, "steps": 3, "dt": 1e-3})
watch = Stopwatch()
run = build(MPI.COMM_WORLD, case["n"], dt=case["dt"]).simulation()
figures = watch.measure(run, case["steps"] * case["dt"])
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
show(
    figures
    | {
        "over limit": figures["iteration [ms]"] / (1e3 * limit),
        "one tangent [ms]": 1e3 * tangent,
        "one set-up [ms]": 1e3 * setting_up,
        "one cycle [ms]": 1e3 * cycle,
        "matrix [MB]": written / 2**20,
        "copy [GB/s]": speed / 1e9,
        "tangent/traffic": tangent * speed / written,
    }
)
