"""What a run of this program needed, on all ranks together."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from typing import Any

from mpi4py import MPI

import gossamer_fx as gx

COMM = MPI.COMM_WORLD


class Stopwatch:
    """Runs a simulation and measures it.

    Made before the scene is, so that what the interpreter and its libraries occupy does not count
    as its memory.
    """

    def __init__(self) -> None:
        self._before = megabytes()

    def measure(self, run: gx.Simulation, until: float) -> dict[str, float]:
        """Figures of going on to the time `until` [s]: cpu of all ranks; times of a Newton
        iteration and its parts."""
        newton = run.solver.newton
        first = run.step
        iterations = newton.all_iterations
        krylov = newton.linear_iterations
        # Seconds of each part before, as the clocks go on.
        parts = dict(newton.seconds)
        # All ranks begin together.
        COMM.Barrier()
        cpu = time.process_time()
        wall = time.perf_counter()
        run.run(until=until)
        # Seconds of all ranks add up; wall time is that of the run.
        cpu = COMM.allreduce(time.process_time() - cpu)
        wall = time.perf_counter() - wall
        iterations = newton.all_iterations - iterations
        dofs = run.system.unknowns.numbering.size
        # Peak memory of all ranks.
        peak = COMM.allreduce(megabytes())
        figures = {
            "cpu": cpu,
            "wall": wall,
            "dofs": dofs,
            "steps": run.step - first,
            "Newton/step": iterations / (run.step - first),
            "Krylov/Newton": (newton.linear_iterations - krylov) / iterations,
            "rejected": run.substeps,
            "iteration [ms]": 1e3 * cpu / iterations,
        }
        figures |= {
            f"{part} [ms]": 1e3 * (s - parts[part]) / iterations
            for part, s in newton.seconds.items()
        }
        return figures | {
            "MB": peak,
            # Per unknown, without what the interpreter needs.
            "B/unknown": (peak - COMM.allreduce(self._before)) * 2**20 / dofs,
            "energy": run.totals.energy,
            "stored": sum(run.totals.stored.values()),
            "ΔE/E": abs(run.energy_error),
        }


class Timed:
    """Sums the CPU seconds that functions of an object, class or module take in this process."""

    def __init__(self, owner: object, *names: str) -> None:
        self.seconds = dict.fromkeys(names, 0.0)
        for name in names:
            setattr(owner, name, self._timed(name, getattr(owner, name)))

    def _timed(self, name: str, original: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*given: Any) -> Any:
            started = time.process_time()
            try:
                return original(*given)
            finally:
                self.seconds[name] += time.process_time() - started

        return timed

    @property
    def total(self) -> float:
        """Of all functions."""
        return sum(self.seconds.values())


def megabytes() -> float:
    """Largest memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
