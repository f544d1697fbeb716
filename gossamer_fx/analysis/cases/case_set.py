"""Sets of cases: one problem in many forms, what their results are compared with, and reports.

`run_cases` computes what is missing, so that an interrupted set goes on where it stopped, and
writes runs.csv, NAME.md and NAME.png.  What a set compares are `Judgement`s.  In addition

- a case that fails falls short, unless failures are results of the set,
- a warning of the program that the set does not expect falls short,
- a number that the set is to show and that is zero or missing in all cases falls short,
- a set that compares nothing falls short.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.cases.results import (
    FAILURES,
    Outcome,
    Result,
    Values,
    markdown_table,
    number_names,
    results_as_csv,
    value_text,
    values_text,
)
from gossamer_fx.analysis.cases.shared_runs import SharedRuns, key_of
from gossamer_fx.core.checks.errors import on_rank_zero
from gossamer_fx.records.outputs.output import make_parent, replace_file

Results = list[Result]


@dataclass(frozen=True)
class Judgement:
    """One result compared with what it should be.

    Attributes:
        words: what was compared, with both values, e.g. "tip, cells 8: error 0.06, allowed 0.05".
        holds: whether it is as it should be.
    """

    words: str
    holds: bool


def plain_rows(results: Results) -> list[list[str]]:
    """Headings, and cells with the values, numbers, wall times and folders of all results."""
    names = number_names(results)
    rows = [[*results[0].values, *names, "time [s]", "folder in runs"]]
    for result in results:
        cells = [value_text(value) for value in result.values.values()]
        for name in names:
            if name in result.numbers:
                cells.append(f"{result.numbers[name]:.6g}")
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
                    words = f"{values_text(result.values)}: {name} {value:.2g} > {largest:.2g}"
                    found.append(Judgement(words, abs(value) <= largest))
        if not found:
            found.append(Judgement("nothing is compared with a declared value", False))
        for result in results:
            where = values_text(result.values)
            if result.failed and not self.may_fail:
                found.append(Judgement(f"{where}: {result.failed}", False))
            for text in result.warnings:
                if not any(part in text for part in self.expected_warnings):
                    found.append(Judgement(f"{where}: undeclared warning: {text}", False))
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


def run_cases(
    cases: CaseSet, comm: MPI.Intracomm, folder: Path, *, fresh: bool = False, verbose: bool = True
) -> list[Result]:
    """Compute the cases that a folder lacks, and write runs.csv, NAME.md and NAME.png.  Collective.

    Args:
        cases: what to compute.
        comm: ranks that compute each case together.
        folder: of the reports; results of single cases are in its folder `runs`.
        fresh: whether to compute all cases again.
        verbose: whether rank 0 prints a line for each case that was computed, and the table.

    Returns:
        The results of all cases, in order.

    Raises:
        InputError: the folder cannot be written, the file of a result is damaged, or the outcome
            refuses values or returns something other than numbers.
    """
    # A table that cannot be written is refused before the runs.
    make_parent(comm, folder / "runs.csv", file=True)
    runs = folder / "runs"
    if fresh:
        on_rank_zero(comm, lambda: shutil.rmtree(runs, ignore_errors=True))

    def progress(result: Result) -> None:
        numbers = {name: n for name, n in result.numbers.items() if not isinstance(n, list)}
        words = result.failed or ", ".join(f"{name} {n:.4g}" for name, n in numbers.items())
        print(f"{cases.name}: {values_text(result.values)}: {words}", flush=True)

    shared = SharedRuns(comm, runs, cases.outcome, cases.failures, progress if verbose else None)
    results = shared.results(cases.cases)

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


def verdict(judgements: Mapping[str, Sequence[Judgement]]) -> tuple[str, bool]:
    """What to print of the judgements of several sets, by name, and whether all of them hold."""
    missed = []
    count = 0
    for name, found in judgements.items():
        count += len(found)
        missed += [f"{name}: {one.words}" for one in found if not one.holds]
    if missed:
        return "\n".join(missed), False
    return f"All {count} comparisons are as declared.", count > 0
