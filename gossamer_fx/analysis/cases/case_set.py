"""Sets of cases: one problem in many forms, computed by any number of processes together, what
their results are compared with, and reports.

`run_cases` computes what is missing, so that an interrupted set goes on where it stopped, and
writes runs.csv, NAME.md and NAME.png.  What a `CaseSet` compares are `Judgement`s.  In addition

- a case that fails falls short, unless failures are results of the set,
- a warning of the program that the set does not expect falls short,
- a number that the set is to show and that is zero or missing in all cases falls short,
- a set that compares nothing falls short.

Processes that are started on one folder share its runs (`SharedRuns`): each makes the next run that
nobody has claimed.  They are equal, without a master.  A process claims a run by a file lock, which
the operating system releases when the process ends, also after kill -9.  The result of a run is a
file that is moved into place when it is complete.  Therefore

- any process may be killed at any time,
- no run that has a result is repeated,
- a run whose process was killed is made by another process, from its last checkpoint if it writes
  any.
"""

from __future__ import annotations

import json
import math
import pickle
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.cases.results import (
    FAILURES,
    Outcome,
    Result,
    Values,
    compute,
    key_of,
    markdown_table,
    read_result,
    results_as_csv,
    shown_names,
    value_text,
    values_text,
)
from gossamer_fx.core.checks.errors import InputError, check, on_rank_zero
from gossamer_fx.records.fields.units import without_round_off
from gossamer_fx.records.outputs.output import make_parent, replace_file
from gossamer_fx.records.outputs.run_file import FileLocks

# Time [s] between two looks for results of other processes.
_POLLING_INTERVAL = 1.0


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
            InputError: the file of a result is damaged.
            OutputFailure: a file cannot be written.
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
        return self._comm.bcast(on_rank_zero(self._comm, lambda: read_result(path)))

    def _make(self, values: Values) -> Result | None:
        """Make a run and return its result; None if another process has claimed it.

        The claim is a lock on the file of the result, which is released in any case.
        """
        path = self.result_file(values)
        # A full disk is refused: nobody else would make the run.
        make_parent(self._comm, path)
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
        """Make a run that this process has claimed, write its result and report it.  Collective."""
        files = path.with_suffix("")
        result = compute(self._comm, files, self._outcome, values, self._failures)
        on_rank_zero(self._comm, lambda: replace_file(path, json.dumps(asdict(result), indent=1)))
        if self._progress is not None and self._comm.rank == 0:
            self._progress(result)
        return result


Results = list[Result]


@dataclass(frozen=True)
class Judgement:
    """One result compared with what it should be.

    Attributes:
        words: what was compared, with both values, e.g. "tip, cells 8: error 0.06, allowed 0.05".
        holds: whether it is as it should be.
        subject: what was compared, without the values; default: the words up to the first colon.
            By it a miss that stored results have, too, is found again.
    """

    words: str
    holds: bool
    subject: str = ""

    @property
    def known_as(self) -> str:
        """The subject of the judgement."""
        return self.subject or self.words.split(":")[0]


def plain_rows(results: Results) -> list[list[str]]:
    """Headings, and cells with the values, numbers, wall times and folders of all results."""
    names = shown_names([result.numbers for result in results])
    rows = [[*results[0].values, *names, "time [s]", "folder in runs"]]
    for result in results:
        cells = [value_text(value) for value in result.values.values()]
        numbers = without_round_off(result.numbers)
        for name in names:
            if name in numbers:
                cells.append(f"{float(numbers[name]):.6g}")
            else:
                cells.append("failed" if result.failed else "")
        rows.append([*cells, f"{result.seconds:.1f}", key_of(result.values)])
    return rows


@dataclass(frozen=True)
class CaseSet:
    """Cases of one problem.

    Attributes:
        name: of its files.
        title: one line above the table; may be empty.
        outcome: outcome(comm, folder, **values) computes a case.
        cases: values of each case by name: numbers and words.
        rows: the table from all results: texts of cells, first the headings.
        judge: judgements of the results: each compared with what it should be.
        draw: draw(results, path) writes the picture.
        shows: numbers of which at least one case must have a finite value other than zero.
        limits: largest sizes of numbers in all cases that have them, such as errors of balances.
        expected_warnings: reasons by a part of the text of a warning.
        may_fail: whether cases that fail are results of the set.
        failures: exceptions of the outcome that are results.
    """

    name: str
    title: str
    outcome: Outcome
    cases: Sequence[Values]
    rows: Callable[[Results], Iterable[Sequence[str]]] = plain_rows
    judge: Callable[[Results], Iterable[Judgement]] = lambda results: ()
    draw: Callable[[Results, Path], None] | None = None
    shows: Sequence[str] = ()
    limits: Mapping[str, float] = field(default_factory=dict)
    expected_warnings: Mapping[str, str] = field(default_factory=dict)
    may_fail: bool = False
    failures: tuple[type[Exception], ...] = FAILURES

    def judgements(self, results: Results) -> list[Judgement]:
        """All judgements of the set, with those that every set makes."""
        found = list(self.judge(results))
        for name in self.shows:
            shown = [result.numbers.get(name, 0.0) for result in results]
            has_value = any(np.isfinite(value) and value != 0 for value in shown)
            found.append(Judgement(f"{name}: zero or missing in every row", has_value))
        for name, largest in self.limits.items():
            for result in results:
                if name in result.numbers:
                    value = result.numbers[name]
                    subject = f"{values_text(result.values)}: {name}"
                    words = f"{subject} {value:.2g} > {largest:.2g}"
                    found.append(Judgement(words, abs(value) <= largest, subject))
        if not found:
            found.append(Judgement("nothing is compared with a declared value", False))
        for result in results:
            where = values_text(result.values)
            if result.failed and not self.may_fail:
                found.append(Judgement(f"{where}: {result.failed}", False, f"{where}: failed"))
            for text in result.warnings:
                if not any(part in text for part in self.expected_warnings):
                    words = f"{where}: undeclared warning: {text}"
                    found.append(Judgement(words, False, words))
        return found

    def table(self, results: Results) -> str:
        """Title, number of runs, table and reasons of failures, in Markdown."""
        failed = [result for result in results if result.failed]
        seconds = sum(result.seconds for result in results)
        text = f"### {self.title}\n\n" if self.title else ""
        text += f"{len(results)} runs, {seconds:.0f} s; {len(failed)} failed.\n\n"
        text += markdown_table(self.rows(results))
        if failed:
            text += "\n"
        for result in failed:
            text += f"- {values_text(result.values)}: {result.failed}\n"
        return text


def _run_alone(
    folder: Path, outcome: Outcome, failures: tuple[type[Exception], ...], values: Values
) -> Result:
    """The result of one case in a worker process of an executor, on one rank."""
    return SharedRuns(MPI.COMM_SELF, folder, outcome, failures).results([values])[0]


def _results_of_workers(
    cases: CaseSet, folder: Path, executor: Executor, progress: Callable[[Result], None]
) -> list[Result]:
    """Results of all cases, in order, which the workers of an executor compute.

    A case whose worker ended without a result has failed; as no file has its result, the next call
    computes it again.

    Raises:
        InputError: the outcome cannot be sent to a worker, or refuses its values.
    """
    try:
        pickle.dumps((cases.outcome, cases.failures))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            f"The function of '{cases.name}' cannot be sent to a worker ({error}); define it with "
            "def at the top of a module."
        ) from error
    futures = [
        executor.submit(_run_alone, folder, cases.outcome, cases.failures, dict(values))
        for values in cases.cases
    ]
    found = []
    for values, future in zip(cases.cases, futures, strict=True):
        try:
            result = future.result()
        except (BrokenExecutor, CancelledError, OSError) as error:
            reason = f"its worker ended without a result ({type(error).__name__})"
            result = Result(values=dict(values), numbers={}, seconds=0.0, failed=reason)
        progress(result)
        found.append(result)
    return found


def run_cases(
    cases: CaseSet,
    comm: MPI.Intracomm,
    folder: Path,
    *,
    fresh: bool = False,
    verbose: bool = True,
    executor: Executor | None = None,
) -> list[Result]:
    """Compute the cases that a folder lacks, and write runs.csv, NAME.md and NAME.png.  Collective.

    Args:
        cases: what to compute.
        comm: ranks that compute each case together.
        folder: of the reports; results of single cases are in its folder `runs`.
        fresh: whether to compute all cases again.
        verbose: whether rank 0 prints a line for each case that was computed, and the table.
        executor: whose workers compute the cases, one each and on one rank, in a folder that they
            all reach; e.g. `concurrent.futures.ProcessPoolExecutor` with the context "spawn",
            `mpi4py.futures.MPIPoolExecutor`, `dask.distributed.Client.get_executor()`.  Default:
            the calling processes compute them.

    Returns:
        The results of all cases, in order.

    Raises:
        InputError: the folder cannot be written, the file of a result is damaged, the outcome
            refuses values or returns something other than numbers, or cannot be sent to a worker,
            or an executor is given on several ranks.
    """
    check(
        executor is None or comm.size == 1,
        f"An executor is given on {comm.size} ranks; start this program on one rank, or leave the "
        "executor out.",
    )
    # A table that cannot be written is refused before the runs.
    make_parent(comm, folder / "runs.csv", file=True)
    runs = folder / "runs"
    if fresh:
        on_rank_zero(comm, lambda: shutil.rmtree(runs, ignore_errors=True))

    def progress(result: Result) -> None:
        numbers = {name: n for name, n in result.numbers.items() if not isinstance(n, list)}
        words = result.failed or ", ".join(f"{name} {n:.4g}" for name, n in numbers.items())
        print(f"{cases.name}: {values_text(result.values)}: {words}", flush=True)

    report = progress if verbose else None
    if executor is None:
        results = SharedRuns(comm, runs, cases.outcome, cases.failures, report).results(cases.cases)
    else:
        results = _results_of_workers(cases, runs, executor, report or (lambda result: None))

    def write() -> None:
        text = cases.table(results)
        replace_file(folder / "runs.csv", results_as_csv(results))
        replace_file(folder / f"{cases.name}.md", text)
        if cases.draw is not None:
            cases.draw(results, folder / f"{cases.name}.png")
        if verbose:
            print(text)

    on_rank_zero(comm, write)
    return results


# Of the largest value of a column: smaller numbers are round-off in it.
VANISHING = 1e-6


def changes(
    results: Sequence[Result],
    stored: Sequence[Result],
    repeatability: float,
    names: Callable[[Result], Iterable[str]],
) -> Iterator[Judgement]:
    """Results compared with the stored ones of the same values, in either direction.

    Args:
        results: of all cases.
        stored: of earlier ones; those without a counterpart are left out.
        repeatability: largest relative change of a number that round-off, another processor or
            another library may cause.
        names: names of the numbers of a result that are compared.
    """
    known = {key_of(result.values): result for result in stored}
    # What vanishes but for round-off is compared with the largest value of its column; "never",
    # which is infinite, has no size.
    columns: dict[str, float] = {}
    for result in stored:
        for name in names(result):
            sizes = [abs(old) for old, _ in _pairs(result.numbers[name], None)]
            columns[name] = max([columns.get(name, 0.0), *filter(math.isfinite, sizes)])
    for result in results:
        before = known.get(key_of(result.values))
        if before is None:
            continue
        where = values_text(result.values)
        if bool(result.failed) != bool(before.failed):
            words = result.failed or "it succeeded, and failed before"
            yield Judgement(f"{where}: changed: {words}", False)
            continue
        for name in names(before):
            for old, new in _pairs(before.numbers[name], result.numbers.get(name)):
                # Written so that a number that is missing, or not a number, has changed.
                scale = max(abs(old), VANISHING * columns[name])
                is_near = math.isfinite(old) and abs(new - old) <= repeatability * scale
                holds = old == new or is_near
                words = f"{where}: {name} was {old:.6g} and is {new:.6g}"
                yield Judgement(words, holds, f"{where}: {name} changed")


def _pairs(old: Any, new: Any) -> Iterator[tuple[float, float]]:
    """Old and new numbers of two numbers, or of two lists of them."""
    before = old if isinstance(old, list) else [old]
    after = new if isinstance(new, list) else [new]
    if len(after) != len(before) or None in after:
        after = [math.nan] * len(before)
    yield from zip(map(float, before), map(float, after), strict=True)


def verdict(
    judgements: Mapping[str, Sequence[Judgement]],
    known: Mapping[str, Sequence[Judgement]] | None = None,
) -> tuple[str, bool]:
    """What to print of the judgements of several sets, by name, and whether all of them hold.

    Args:
        judgements: of each set, by its name; without any, nothing holds.
        known: judgements of its stored results; what they miss, too, is said, and is not new.
    """
    missed = []
    known_misses = []
    count = 0
    for name, found in judgements.items():
        before = {one.known_as for one in (known or {}).get(name, ()) if not one.holds}
        count += len(found)
        for one in found:
            if one.holds:
                continue
            if one.known_as in before:
                known_misses.append(f"{name}: {one.words} (known)")
            else:
                missed.append(f"{name}: {one.words}")
    if missed:
        return "\n".join([*known_misses, *missed]), False
    words = f"All {count} comparisons are as declared."
    if known_misses:
        words = f"{count - len(known_misses)} of {count} comparisons are as declared; no new miss."
    return "\n".join([*known_misses, words]), count > 0
