"""Sweeps over the arguments of a scene file: gossamer sweep SCENE --over NAME=VALUE,VALUE ..."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.records.run.case import Case
from gossamer_fx.app.cli.user_files import check_arguments_of, option, value_of
from gossamer_fx.app.sweep.factorial import Factorial
from gossamer_fx.core.checks.errors import InputError, check, on_rank_zero
from gossamer_fx.records.outputs.output import Output, make_parent, replace_file
from gossamer_fx.records.run.checkpoint import Checkpoints

Build = Callable[..., Case]


def values_of(words: Sequence[str]) -> dict[str, list[Any]]:
    """Values of arguments, by name, from words NAME=VALUE,VALUE of a command line.

    Args:
        words: e.g. "cells=4,8"; a value is a number, True, False, or else a word.

    Raises:
        InputError: a word of another form, a name without a value, or one that is given twice.
    """
    over: dict[str, list[Any]] = {}
    for word in words:
        name, value = option(word)
        values = list(value) if isinstance(value, tuple) else [value]
        if isinstance(value, str):
            values = [value_of(part.strip()) for part in value.split(",")]
        check(
            "" not in values,
            f"'{word}' is not of the form NAME=VALUE,VALUE; give arguments of build like "
            "cells=4,8,16.",
        )
        check(name not in over, f"--over has {name} twice; give all its values at once.")
        over[name] = values
    return over


def check_same_scene(comm: MPI.Intracomm, path: Path, folder: Path) -> None:
    """Refuse a folder whose runs are of another scene file, or of this one before it was changed.

    The results of runs are found by the values of their arguments, which do not tell the scene.  A
    new folder gets the checksum of the file.  Collective.

    Args:
        comm: the ranks; rank 0 reads the files.
        path: of the scene file.
        folder: of the sweep; made if it does not exist.

    Raises:
        InputError: on all ranks; names both files.
        OutputFailure: on all ranks, if the checksum cannot be written.
        OSError: on all ranks, if a file cannot be read.
    """

    def compare() -> None:
        """Compare the checksum of the scene file with the one in the folder, or store it there.

        Raises:
            InputError: the folder has another checksum.
            OutputFailure: the checksum cannot be written.
            OSError: a file cannot be read.
        """
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        mark = folder / "scene.json"
        make_parent(MPI.COMM_SELF, mark)
        if mark.is_file():
            try:
                about = dict(json.loads(mark.read_text(encoding="utf-8")))
            except (ValueError, TypeError) as error:
                raise InputError(f"'{mark}' is damaged ({error}); remove the folder.") from error
            check(
                about.get("sha256") == digest,
                f"'{folder}' holds runs of '{about.get('file')}' as it was before a change, or of "
                "another scene; give another folder with --output, or remove this one.",
            )
        else:
            replace_file(mark, json.dumps({"file": str(path), "sha256": digest}))

    on_rank_zero(comm, compare)


class SceneOutcome:
    """Makes one run of a scene file; its numbers are those of the probes, and how the run went.

    For each probe it returns the value at the end, the smallest and the largest one, and for each
    chamber the last pressure.  The run is recorded in its folder with checkpoints, from which it
    continues if it was killed.

    Args:
        build: the function of the scene file.
        progress: called with a line when a run begins.

    Attributes:
        count: of all runs of the sweep, for the progress.
    """

    def __init__(self, build: Build, progress: Callable[[str], None]) -> None:
        self._build = build
        self._progress = progress
        self.count = 1

    def __call__(self, comm: MPI.Intracomm, folder: Path, **values: Any) -> dict[str, float]:
        """Make one run of the scene, or continue it from its newest checkpoint.  Collective.

        Args:
            comm: the ranks.
            folder: of the run, for its recording and checkpoints.
            values: arguments of `build` for this run.

        Returns:
            Numbers by name, the same on every rank: those of `_probe_numbers`, each with its unit
            in the name, and the dimensionless "energy error", "steps" and "iterations a step".

        Raises:
            InputError: `build` does not return a `Case`, or the scene is wrong; an error that
                `build` itself raises passes.
            StepFailure: a time step did not converge.  The folder retains what was recorded and the
                checkpoints; what becomes of a failed run is decided by the sweep.
        """
        words = ", ".join(f"{name}={value}" for name, value in values.items())
        if comm.rank == 0:
            self._progress(f"run with {words} ({self.count} runs in all)")
        case = self._build(comm, **values)
        check(
            isinstance(case, Case),
            f"build returns {type(case).__name__}; let it return a gossamer_fx.Case.",
        )
        saves = folder / "checkpoints"
        is_restart = comm.bcast(any(saves.glob("step-*")))
        restart = saves if is_restart else None
        # What a run without a checkpoint has left is replaced: it has no result.
        outputs: list[Output] = [case.recording(folder, overwrite=True)]
        run = case.simulation(outputs, Checkpoints(saves), restart)
        run.run(until=case.until)
        numbers = dict(on_rank_zero(comm, lambda: _probe_numbers(folder)) or {})
        numbers = dict(comm.bcast(numbers))
        numbers["energy error"] = run.energy_error
        numbers["steps"] = float(run.step)
        numbers["iterations a step"] = run.iterations / max(run.step, 1)
        return numbers


def _probe_numbers(folder: Path) -> dict[str, float]:
    """Results of a recorded run by name: of its probes and of the pressures of its chambers.

    Returns:
        "... at the end" for each probe, in the unit of the probe, "... pressure [Pa] at the end"
        for each chamber, then "... smallest" and "... largest" for each probe: the picture has room
        for the first ones.

    Raises:
        InputError: the folder holds no run.
    """
    from gossamer_fx.records.plot.run_reader import RunReader

    run = RunReader(folder)
    columns = run.table("probes.csv").items()
    probes = {name: values for name, values in columns if name not in run.not_values}
    numbers = {f"{name} at the end": float(values[-1]) for name, values in probes.items()}
    for name, values in run.table("gas.csv").items():
        if name.endswith(" pressure"):
            numbers[f"{name} [Pa] at the end"] = float(values[-1])
    for name, values in probes.items():
        numbers[f"{name} smallest"] = float(np.min(values))
        numbers[f"{name} largest"] = float(np.max(values))
    return numbers


def scene_sweep(
    build: Build,
    path: Path,
    words: Sequence[str],
    listed: bool,
    progress: Callable[[str], None],
) -> Factorial:
    """The sweep over arguments of a scene file that a command line asks for.

    Args:
        build: the function of the scene file.
        path: of the scene file.
        words: NAME=VALUE,VALUE for each argument that is varied.
        listed: whether the values belong together one by one; else all combinations are run.
        progress: called with a line when a run begins.

    Returns:
        The sweep, not yet run.

    Raises:
        InputError: words of another form, unknown arguments, or values that make no sweep.
    """
    over = values_of(words)
    given = [(name, value) for name, values in over.items() for value in values]
    check_arguments_of(build, path, given)
    outcome = SceneOutcome(build, progress)
    sweep = Factorial(outcome, over, listed=listed)
    outcome.count = len(sweep.cases())
    return sweep
