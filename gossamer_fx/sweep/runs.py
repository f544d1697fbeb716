"""Runs that any number of processes share: each takes the next one that nobody has, until all are done.

There is no master.  The process that makes a run holds a lock on its result, which the operating system releases when
the process ends, also after kill -9.  A result is a file that appears complete or not at all.  So any process may be
killed at any time: no run that has a result is made again, and a run that was killed is made by another process, from
its checkpoint if it keeps one.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from numbers import Real
from pathlib import Path
from typing import Any

from mpi4py import MPI

from gossamer_fx.checks.errors import InputError, NoEquilibrium, StepFailure, check, on_rank_zero
from gossamer_fx.outputs.file_locks import FileLocks
from gossamer_fx.outputs.output import make_parent, replace_file

Values = Mapping[str, Any]
Outcome = Callable[..., Mapping[str, float]]

_PAUSE = 1.0  # s between looks at runs that others make


@dataclass(frozen=True)
class Result:
    """What a run gave: `numbers` by name, or why there are none, `failed`; and its run time [s]."""

    values: dict[str, Any]
    numbers: dict[str, float]
    seconds: float
    failed: str = ""


class SharedRuns:
    """Results of runs in a folder, those that other processes make included.

    Args:
        comm: ranks that make a run together.
        folder: of the results, one file each, and of a folder for each run's own files.
        outcome: outcome(comm, folder, **values) makes a run and returns numbers by name.

    Raises:
        InputError: the folder cannot be made or written.
    """

    def __init__(self, comm: MPI.Intracomm, folder: Path, outcome: Outcome) -> None:
        self._comm, self._folder, self._outcome = comm, folder, outcome
        make_parent(comm, folder / "any.json")

    def results(self, cases: Sequence[Values]) -> list[Result]:
        """The results of all cases, in order; makes those that nobody has made or is making, and waits for the others.

        Raises:
            InputError: an outcome that refuses its values, or returns something else than numbers.
        """
        found: dict[int, Result] = {}
        while len(found) < len(cases):
            before = len(found)
            for k, values in enumerate(cases):
                if k not in found:
                    result = self._known(values) or self._make(values)
                    if result is not None:
                        found[k] = result
            if len(found) == before:
                time.sleep(_PAUSE)
        return [found[k] for k in range(len(cases))]

    def place(self, values: Values) -> Path:
        """The file of a run's result; without its ending, the run's own folder."""
        key = hashlib.sha256(json.dumps(dict(values), sort_keys=True).encode()).hexdigest()[:12]
        return self._folder / f"{key}.json"

    def _known(self, values: Values) -> Result | None:
        def read() -> Result | None:
            path = self.place(values)
            try:
                return Result(**json.loads(path.read_text()))
            except FileNotFoundError:
                return None
            except (ValueError, TypeError) as error:
                raise InputError(
                    f"'{path}' is no result of a run; remove it, and the run is made again."
                ) from error

        known: Result | None = self._comm.bcast(on_rank_zero(self._comm, read))
        return known

    def _make(self, values: Values) -> Result | None:
        """Make a run, unless another process has it."""
        path = self.place(values)
        try:
            lock = FileLocks(self._comm, [path])
        except InputError:
            return None
        try:
            return self._known(values) or self._compute(values, path)
        finally:
            lock.release()

    def _compute(self, values: Values, path: Path) -> Result:
        started, numbers, failed = time.perf_counter(), dict[str, float](), ""
        words = ", ".join(f"{name}={value}" for name, value in values.items())
        try:
            numbers = dict(self._outcome(self._comm, path.with_suffix(""), **values))
        except (StepFailure, NoEquilibrium) as error:
            failed = str(error)
        except InputError as error:
            raise InputError(f"The run with {words} is refused: {error}") from error
        for name, number in numbers.items():
            check(
                isinstance(number, Real) and not math.isnan(number),
                f"The outcome of the run with {words} has {name!r} = {number!r}; let it return numbers.",
            )
        numbers = {name: float(number) for name, number in numbers.items()}
        result = Result(dict(values), numbers, time.perf_counter() - started, failed)
        on_rank_zero(self._comm, lambda: replace_file(path, json.dumps(asdict(result), indent=1)))
        return result
