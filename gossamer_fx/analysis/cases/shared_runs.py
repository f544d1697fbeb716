"""Runs that any number of processes share: each process makes the next run that nobody has claimed.

The processes are equal, without a master.  A process claims a run by a file lock, which the
operating system releases when the process ends, also after kill -9.  The result of a run is a file
that is moved into place when it is complete.  Therefore

- any process may be killed at any time,
- no run that has a result is repeated,
- a run whose process was killed is made by another process, from its last checkpoint if it writes
  any.
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

from gossamer_fx.core.checks.errors import (
    InputError,
    NoEquilibrium,
    StepFailure,
    check,
    on_rank_zero,
)
from gossamer_fx.records.outputs.file_locks import FileLocks
from gossamer_fx.records.outputs.output import make_parent, replace_file

Values = Mapping[str, Any]
Outcome = Callable[..., Mapping[str, float]]

# Time [s] between two looks for results of other processes.
_POLLING_INTERVAL = 1.0

# Characters of a run's key in file names: collisions are improbable up to millions of runs.
_KEY_LENGTH = 12


@dataclass(frozen=True)
class Result:
    """The result of a run.

    Attributes:
        values: of the factors, by name.
        numbers: of the outcome, by name; empty if the run failed.
        seconds: wall time [s].
        failed: why the run failed; empty if it did not.
    """

    values: dict[str, Any]
    numbers: dict[str, float]
    seconds: float
    failed: str = ""


class SharedRuns:
    """Results of runs in a folder, including those that other processes make.

    Args:
        comm: ranks that make a run together.
        folder: contains a file for the result of each run, and a folder for its other files.
        outcome: outcome(comm, folder, **values) makes a run and returns numbers by name.

    Raises:
        InputError: the folder cannot be made or written.
    """

    def __init__(self, comm: MPI.Intracomm, folder: Path, outcome: Outcome) -> None:
        self._comm = comm
        self._folder = folder
        self._outcome = outcome
        make_parent(comm, folder / "any.json")

    def results(self, cases: Sequence[Values]) -> list[Result]:
        """The results of all cases, in order.  Collective.

        Makes the runs that nobody has made or is making, and waits for the others.

        A run whose step or equilibrium fails (`StepFailure`, `NoEquilibrium`) is a result with the
        reason in `failed`, and is not made again. The call waits without limit while another
        process makes a run.

        Args:
            cases: values of the factors of each run, by name.

        Raises:
            InputError: the outcome refuses its values, or returns something other than numbers.
            InputError: the file of a result is damaged, or cannot be written.
        """
        found: dict[int, Result] = {}
        while len(found) < len(cases):
            count_before = len(found)
            for k, values in enumerate(cases):
                if k in found:
                    continue
                result = self._read(values) or self._make(values)
                if result is not None:
                    found[k] = result
            # All runs that are left belong to other processes.
            if len(found) == count_before:
                time.sleep(_POLLING_INTERVAL)
        return [found[k] for k in range(len(cases))]

    def result_file(self, values: Values) -> Path:
        """The file of a run's result; its path without suffix is the folder of the run's other
        files."""
        # The key depends on the values only, so that other processes and later sweeps find the
        # result.
        text = json.dumps(dict(values), sort_keys=True)
        key = hashlib.sha256(text.encode()).hexdigest()[:_KEY_LENGTH]
        return self._folder / f"{key}.json"

    def _read(self, values: Values) -> Result | None:
        """The result of a run, or None if it has not been made; the same on every rank.
        Collective.

        Raises:
            InputError: the file of the result is damaged.
        """

        def read() -> Result | None:
            """Read the file of the result on rank 0; None if it does not exist.

            Raises:
                InputError: the file is not the result of a run.
            """
            path = self.result_file(values)
            try:
                return Result(**json.loads(path.read_text()))
            except FileNotFoundError:
                return None
            except (ValueError, TypeError) as error:
                raise InputError(
                    f"'{path}' is not the result of a run; remove it, and the run is made again."
                ) from error

        result: Result | None = self._comm.bcast(on_rank_zero(self._comm, read))
        return result

    def _make(self, values: Values) -> Result | None:
        """Make a run and return its result; None if another process has claimed it.  Collective.

        The claim is a lock on the file of the result, which is released in any case. It also counts
        as claimed if the lock cannot be made.

        Raises:
            InputError: the outcome refuses its values, or returns something other than numbers.
            InputError: the file of a result is damaged.
        """
        path = self.result_file(values)
        try:
            lock = FileLocks(self._comm, [path])
        except InputError:
            return None
        try:
            # Another process may have ended the run between the last look and the claim.
            return self._read(values) or self._compute(values, path)
        finally:
            lock.release()

    def _compute(self, values: Values, path: Path) -> Result:
        """Make a run and write its result.  Collective.

        A step or an equilibrium that fails is a result too, with the reason.

        Other exceptions of the outcome are raised as they are, and write no result.

        Raises:
            InputError: the outcome refuses its values, or returns something other than numbers.
        """
        started = time.perf_counter()
        numbers: dict[str, float] = {}
        failed = ""
        words = ", ".join(f"{name}={value}" for name, value in values.items())
        try:
            numbers = dict(self._outcome(self._comm, path.with_suffix(""), **values))
        # A failed run is a result, too: the design reports it, and it is not repeated.
        except (StepFailure, NoEquilibrium) as error:
            failed = str(error)
        except InputError as error:
            raise InputError(f"The run with {words} is refused: {error}") from error
        for name, number in numbers.items():
            check(
                isinstance(number, Real) and not math.isnan(number),
                f"The outcome of the run with {words} has {name!r} = {number!r}; let it return "
                "numbers.",
            )
        numbers = {name: float(number) for name, number in numbers.items()}
        result = Result(
            values=dict(values),
            numbers=numbers,
            seconds=time.perf_counter() - started,
            failed=failed,
        )
        on_rank_zero(self._comm, lambda: replace_file(path, json.dumps(asdict(result), indent=1)))
        return result
