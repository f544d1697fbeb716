"""Studies of how well an answer is determined: one factor at a time, see
`gossamer_fx.analysis.answer_spread`.

The study declares what each quantity is: determined to so much, statistical, or not determined.  A
quantity that turns out to be better or worse than that falls short.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.extend import SPREAD_LIMIT, CaseSet, Judgement, Result, one_at_a_time


@dataclass(frozen=True)
class Expected:
    """What a study declares of a quantity.

    Attributes:
        kind: its verdict, "determined", "statistical" or "not determined".
        low, high: all runs lie between them, in the unit of the quantity.
    """

    kind: str
    low: float
    high: float


@dataclass(frozen=True)
class SpreadStudy:
    """A problem, the factors that are varied one at a time, and what its quantities are.

    Args:
        name: of its files.
        title: one line above the table.
        problem: problem(comm, **case) returns numbers by name.
        vary: values of each factor by name, the usual one first.
        expected: what the full form declares of each quantity.
        chance, scales, limit: see `gossamer_fx.analysis.spread`.
        quick: the factors of quick runs, whose verdicts are not judged.
        quick_options: further arguments of the problem in quick runs, such as an earlier end.
        limits: largest sizes of results in all cases that have them, such as errors of balances.
        repeatability: largest relative change of a determined quantity from the stored one.
        expected_warnings: reasons by a part of the text of a warning.
        expected_failures: whether a case that fails by name is a result, too.
    """

    name: str
    title: str
    problem: Callable[..., Mapping[str, float]]
    vary: Mapping[str, Sequence[Any]]
    expected: Mapping[str, Expected]
    chance: Sequence[str] = ()
    scales: Mapping[str, float] = field(default_factory=dict)
    limit: float = SPREAD_LIMIT
    quick: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    quick_options: Mapping[str, Any] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    repeatability: float = SPREAD_LIMIT
    expected_warnings: Mapping[str, str] = field(default_factory=dict)
    expected_failures: bool = False

    def spread(self, results: Sequence[Result]) -> gx.analysis.Spread:
        """The spread of results of this study, in its factors alone."""
        names = [name for name in self.vary if name in results[0].values]
        own = [
            Result(
                values={name: result.values[name] for name in names},
                numbers=result.numbers,
                seconds=result.seconds,
                failed=result.failed,
            )
            for result in results
        ]
        chance = [name for name in self.chance if name in names]
        return gx.analysis.Spread(
            own, chance=chance, limit=self.limit, scales=self.scales, quantities=[*self.expected]
        )

    def case_set(self, comm: MPI.Intracomm, quick: bool = False) -> CaseSet:
        """The cases of the full or the quick form on the ranks of a communicator."""
        options = {**(self.quick_options if quick else {}), "ranks": comm.size}
        factors = self.quick if quick else self.vary
        return CaseSet(
            name=self.name,
            title=self.title,
            outcome=self.outcome,
            cases=[{**case, **options} for case in one_at_a_time(factors)],
            rows=lambda results: self.spread(results).rows(),
            judge=lambda results: self.judge(results, quick),
            draw=lambda results, path: self.spread(results).plot(path),
            limits=self.limits,
            expected_warnings=self.expected_warnings,
            may_fail=self.expected_failures,
        )

    def outcome(
        self, comm: MPI.Intracomm, folder: Path, ranks: int, **case: Any
    ) -> Mapping[str, float]:
        """What the problem returns of a case."""
        return self.problem(comm, **case)

    def compared_numbers(self, result: Result) -> list[str]:
        """Names of the numbers that are determined, which are compared with stored ones."""
        is_determined = (
            name for name, expected in self.expected.items() if expected.kind == "determined"
        )
        return [name for name in is_determined if name in result.numbers]

    def to_be_stored(self, results: list[Result]) -> list[Result]:
        """Results as they are stored."""
        return [replace(result, seconds=round(result.seconds, 1)) for result in results]

    def judge(self, results: Sequence[Result], quick: bool) -> Iterator[Judgement]:
        """Verdicts and ranges with the declared ones; in the quick form that there are numbers."""
        found = self.spread(results)
        for name, expected in self.expected.items():
            verdict = found.verdict(name)
            if quick:
                yield Judgement(f"{name}: {verdict}", name in results[0].numbers)
                continue
            yield Judgement(
                f"{name}: {verdict}; declared {expected.kind}", verdict.kind == expected.kind
            )
            is_within = expected.low <= verdict.low and verdict.high <= expected.high
            yield Judgement(
                f"{name}: {verdict.low:.5g} to {verdict.high:.5g}; declared "
                f"{expected.low:.5g} to {expected.high:.5g}",
                bool(verdict.reason) or is_within,
            )

    def summary(self, results: Sequence[Result]) -> Iterator[list[str]]:
        """Rows of the page of studies: what each quantity is."""
        found = self.spread(results)
        seconds = f"{sum(result.seconds for result in results):.2g}"
        for name in self.expected:
            yield [self.name, name, str(found.verdict(name)), "", seconds]
