"""Runs of a function that builds cases, as results of a sweep, a spread or a study.

`CaseRuns` makes an outcome of such a function: each run is recorded in its own folder, goes on from
its newest checkpoint after an interruption, and gives the numbers of its probes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

from gossamer_fx.analysis.cases.recorded_numbers import recorded_numbers
from gossamer_fx.core.checks.errors import check
from gossamer_fx.records.outputs.output import Output
from gossamer_fx.records.run.case import Case, all_arguments
from gossamer_fx.records.run.checkpoint import Checkpoints

if TYPE_CHECKING:
    from gossamer_fx.analysis.cases.static_case import StaticCase

# build(comm, **values): a case, or numbers by name of a run that it has made itself.
Build = Callable[..., "Case | StaticCase | Mapping[str, Any]"]


class CaseRuns:
    """The outcome of a function that builds cases: makes one run and returns numbers by name.

    Of each probe of a case they are the value at the end, the smallest and the largest one, and of
    each chamber the last pressure.  The run is recorded in its folder with checkpoints, from which
    it goes on if it was killed.

    Args:
        build: build(comm, **values), as in a scene file.
        progress: called on rank 0 with a line when a run begins.
    """

    def __init__(self, build: Build, progress: Callable[[str], None] | None = None) -> None:
        self._build = build
        self._progress = progress

    def __call__(self, comm: MPI.Intracomm, folder: Path, **values: Any) -> Mapping[str, Any]:
        """Make one run of the case, or continue it from its newest checkpoint.  Collective.

        Args:
            comm: the ranks.
            folder: of the run, for its recording and checkpoints.
            values: arguments of `build` for this run.

        Returns:
            Numbers by name, the same on every rank: what `build` returns if that is not a case;
            else those of `recorded_numbers`, each with its unit in the name, and the dimensionless
            "energy error", "steps" and "iterations a step".

        Raises:
            InputError: `build` returns something else, or the scene is wrong; an error that `build`
                itself raises passes.
            StepFailure: a time step did not converge.  The folder retains what was recorded and the
                checkpoints; what becomes of a failed run is decided by the sweep.
        """
        if comm.rank == 0 and self._progress is not None:
            words = ", ".join(f"{name}={value}" for name, value in values.items())
            self._progress(f"run with {words}")
        case = self._build(comm, **values)
        parameters = all_arguments(self._build, values)
        if isinstance(case, Mapping):
            return case
        if not isinstance(case, Case):
            # Imported here: runs need no equilibria.
            from gossamer_fx.analysis.cases.static_case import StaticCase

            if isinstance(case, StaticCase):
                # What a search that was killed has left is replaced: it has no result.
                return case.compute(folder, overwrite=True, parameters=parameters)
        check(
            isinstance(case, Case),
            f"build returns {type(case).__name__}; let it return a gossamer_fx.Case or StaticCase, "
            "or numbers by name.",
        )
        saves = folder / "checkpoints"
        is_restart = comm.bcast(any(saves.glob("step-*")))
        restart = saves if is_restart else None
        # What a run without a checkpoint has left is replaced: it has no result.
        recording = case.recording(folder, overwrite=True, parameters=parameters)
        outputs: list[Output] = [recording]
        run = case.simulation(outputs, Checkpoints(saves), restart)
        run.run(until=case.until)
        numbers = recorded_numbers(comm, folder)
        numbers["energy error"] = run.energy_error
        numbers["steps"] = float(run.step)
        numbers["iterations a step"] = run.iterations / max(run.step, 1)
        return numbers
