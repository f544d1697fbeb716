"""Tests of a case as cases of `gossamer_fx.analysis.cases`, which computes, judges and reports
them."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from demos.validation.engine.case import Case
from demos.validation.engine.comparison import comparisons, numbers_of, results_by_test
from demos.validation.engine.report import asked, figure, rows
from gossamer_fx.extend import CaseSet, Judgement, Result


def case_set(
    case: Case, comm: MPI.Intracomm, quick: bool, only: str = "", known: Sequence[Result] = ()
) -> CaseSet:
    """The tests of a case whose name contains a text, in the full or the quick form.

    Args:
        case: the case.
        comm: ranks that compute each test together; their number is a value of the results.
        quick: whether to compute the quick form.
        only: part of the names of the tests.
        known: results of tests that need not be computed unless their inputs have changed.
    """
    tests = {test.name: test for test in case.chosen(quick) if only in test.name}
    model = importlib.import_module(f"demos.validation.models.{case.model}")
    # A result of other inputs has another digest.
    found = {(result.values["test"], result.values["digest"]) for result in known}

    def outcome(
        comm: MPI.Intracomm, folder: Path, test: str, digest: str, ranks: int
    ) -> Mapping[str, Any]:
        return numbers_of(model.predict(tests[test].inputs, comm, quick))

    def judge(results: list[Result]) -> Iterator[Judgement]:
        for test, result in results_by_test(case, results):
            for comparison in comparisons(test, result):
                measured = comparison.measured
                allowed = measured.quick_accepted if quick else measured.accepted
                # Values of which nothing is asked are for information.
                if np.isfinite(allowed).all():
                    words = f"error {100 * comparison.error:.1f} %, asked {asked(measured, quick)}"
                    where = f"{test.name}, {measured.quantity}"
                    yield Judgement(f"{where}: {words}", comparison.is_accepted(quick))

    return CaseSet(
        name=case.name,
        title=case.title,
        outcome=outcome,
        cases=[
            {"test": test.name, "digest": test.digest, "ranks": comm.size}
            for test in tests.values()
            if (test.name, test.digest) not in found
        ],
        rows=lambda results: rows([(case, results)], quick),
        judge=judge,
        draw=lambda results, path: figure(case, results, path),
        expected_warnings=case.expected_warnings,
    )
