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
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

from mpi4py import MPI

from gossamer_fx.analysis.cases.results import (
    FAILURES,
    Outcome,
    Result,
    Values,
    compute,
    read_result,
)
from gossamer_fx.core.checks.errors import InputError, on_rank_zero
from gossamer_fx.records.outputs.file_locks import FileLocks
from gossamer_fx.records.outputs.output import make_parent, replace_file

# Time [s] between two looks for results of other processes.
_POLLING_INTERVAL = 1.0

# Characters of a run's key in file names: collisions are improbable up to millions of runs.
_KEY_LENGTH = 12


def key_of(values: Values) -> str:
    """Name of a run's files.

    It depends on the values only, so that other processes and later sweeps find the result.
    """
    text = json.dumps(dict(values), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_KEY_LENGTH]


class SharedRuns:
    """Results of runs in a folder, including those that other processes make.

    Args:
        comm: ranks that make a run together.
        folder: contains a file for the result of each run, and a folder for its other files.
        outcome: outcome(comm, folder, **values) makes a run and returns numbers by name.
        failures: exceptions of the outcome that are results.
        progress: called on rank 0 with each result that was computed here.

    Raises:
        InputError: the folder cannot be made or written.
    """

    def __init__(
        self,
        comm: MPI.Intracomm,
        folder: Path,
        outcome: Outcome,
        failures: tuple[type[Exception], ...] = FAILURES,
        progress: Callable[[Result], None] | None = None,
    ) -> None:
        self._comm = comm
        self._folder = folder
        self._outcome = outcome
        self._failures = failures
        self._progress = progress
        make_parent(comm, folder / "any.json")

    def results(self, cases: Sequence[Values]) -> list[Result]:
        """The results of all cases, in order.  Collective.

        Makes the runs that nobody has made or is making, and waits for the others.

        A run that fails with one of `failures` is a result with the reason in `failed`, and is not
        made again.  The call waits without limit while another process makes a run.

        Args:
            cases: values of each run, by name.

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
        return self._folder / f"{key_of(values)}.json"

    def _read(self, values: Values) -> Result | None:
        """The result of a run, or None if it has not been made; the same on every rank."""
        path = self.result_file(values)
        result: Result | None = self._comm.bcast(
            on_rank_zero(self._comm, lambda: read_result(path))
        )
        return result

    def _make(self, values: Values) -> Result | None:
        """Make a run and return its result; None if another process has claimed it.

        The claim is a lock on the file of the result, which is released in any case.  It also
        counts as claimed if the lock cannot be made.
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
        """Make a run and write its result."""
        files = path.with_suffix("")
        result = compute(self._comm, files, self._outcome, values, self._failures)
        on_rank_zero(self._comm, lambda: replace_file(path, json.dumps(asdict(result), indent=1)))
        if self._progress is not None and self._comm.rank == 0:
            self._progress(result)
        return result
