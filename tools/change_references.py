"""Do judges judge?  Changes every reference, aim and judged result by 20 %, one at a time, and says
which changes nobody notices: ./gossamer python tools/change_references.py [--all].

Nothing is computed: stored results of studies, validation and benchmarks are judged again, as their
commands judge them.  A change that is not noticed needs a reason in tools/unnoticed.toml; ends with
code 1 if one has none, or if a reason is given for a change that is noticed.  With --all each
change is printed.
"""

from __future__ import annotations

import dataclasses
import math
import sys
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "demos" / "benchmarks")]

from demos.studies.__main__ import NAMES as STUDIES  # noqa: E402
from demos.studies.__main__ import stored_file  # noqa: E402
from demos.studies.engine.named import study_of  # noqa: E402
from demos.studies.engine.study import ADDED, Study  # noqa: E402
from demos.validation.__main__ import (  # noqa: E402
    CASES,
    MODELS,
    REPEATABILITY,
    STORED,
)
from demos.validation.__main__ import NAMES as EXPERIMENTS  # noqa: E402
from demos.validation.engine.case import Case, read_case  # noqa: E402
from demos.validation.engine.comparison import compared_numbers, with_measured  # noqa: E402
from demos.validation.engine.results import case_set  # noqa: E402
from gossamer_fx.analysis.cases.case_set import Judgement, changes, verdict  # noqa: E402
from gossamer_fx.analysis.cases.results import Result, read_results  # noqa: E402

FACTORS = (0.8, 1.2)
REASONS = ROOT / "tools" / "unnoticed.toml"


@dataclass(frozen=True)
class Change:
    """One change of 20 %.

    Attributes:
        where: of which judge, e.g. "study airbag".
        what: was changed, with the factor.
        is_noticed: whether the judge then says that something is wrong.
    """

    where: str
    what: str
    is_noticed: bool

    @property
    def name(self) -> str:
        """Judge and number, without case and factor, as in the list of reasons."""
        return f"{self.where}: {self.what.split(' of ')[0]}"


def is_well(now: Sequence[Judgement], known: Sequence[Judgement]) -> bool:
    """Whether a judge would end with code 0."""
    return verdict({"": now}, {"": known})[1]


def with_number(result: Result, name: str, factor: float) -> Result:
    """A result with one number, or the numbers of one list, changed."""
    number: Any = result.numbers[name]
    changed = [factor * one for one in number] if isinstance(number, list) else factor * number
    return dataclasses.replace(result, numbers={**result.numbers, name: changed})


def changed_results(
    where: str,
    results: list[Result],
    names: Callable[[Result], list[str]],
    judged: Callable[[list[Result]], bool],
) -> Iterator[Change]:
    """Each judged number of each result changed."""
    for k, result in enumerate(results):
        for name in names(result):
            # Nothing is 20 % of zero, or of infinity: "never".
            if not any(math.isfinite(one) and one for one in _numbers(result.numbers[name])):
                continue
            for factor in FACTORS:
                changed = [*results[:k], with_number(result, name, factor), *results[k + 1 :]]
                words = f"{name} of {', '.join(map(str, result.values.values()))} × {factor}"
                yield Change(where, words, not judged(changed))


def _numbers(value: Any) -> list[float]:
    return value if isinstance(value, list) else [value]


# ---- studies -------------------------------------------------------------------------------------


def study_changes(name: str, quick: bool) -> Iterator[Change]:
    """Results and references of a study, in one of its forms."""
    study = study_of(name)
    stored = read_results(stored_file(name, quick), name)
    if not stored:
        return
    where = f"study {name}{' --quick' * quick}"
    known = study.case_set(MPI.COMM_SELF, quick).judgements(stored)

    def judged(results: list[Result], other: Any = study) -> bool:
        """Whether the study, or another one instead, finds nothing wrong."""
        own = [without_references(result) for result in results]
        now = [
            *other.case_set(MPI.COMM_SELF, quick).judgements(own),
            *changes(other.to_be_stored(own), stored, other.repeatability, other.compared_numbers),
        ]
        return is_well(now, known)

    assert judged(stored), f"{where}: the stored results are judged as wrong"

    def names(result: Result) -> list[str]:
        """The numbers that the study shows, and its page speaks of."""
        return [one for one in study.compared_numbers(result) if not one.startswith(ADDED)]

    yield from changed_results(where, stored, names, judged)
    if isinstance(study, Study):
        yield from aim_changes(where, study, lambda other: judged(stored, other))
        for k, measure in enumerate(study.measures):
            reference = measure.reference
            if not callable(reference) and not reference:
                continue
            for factor in FACTORS:
                value: Any = _scaled(reference, factor)
                one = dataclasses.replace(measure, reference=value)
                others = (*study.measures[:k], one, *study.measures[k + 1 :])
                other = dataclasses.replace(study, measures=others)
                words = f"reference {measure.name} of all × {factor}"
                yield Change(where, words, not judged(stored, other))
        for k, claim in enumerate(study.claims):
            for factor in FACTORS:
                moved = dataclasses.replace(claim, low=factor * claim.low, high=factor * claim.high)
                claims = (*study.claims[:k], moved, *study.claims[k + 1 :])
                other = dataclasses.replace(study, claims=claims)
                is_meant = any(claim.judgements(stored))
                if is_meant and claim.low:
                    words = f"claim {claim.number} of {claim.where} × {factor}"
                    yield Change(where, words, not judged(stored, other))


def aim_changes(where: str, study: Study, judged: Callable[[Study], bool]) -> Iterator[Change]:
    """Tolerances of measures, and limits."""
    for factor in FACTORS:
        for k, measure in enumerate(study.measures):
            if math.isfinite(measure.tolerance):
                one = dataclasses.replace(measure, tolerance=factor * measure.tolerance)
                others = (*study.measures[:k], one, *study.measures[k + 1 :])
                other = dataclasses.replace(study, measures=others)
                yield Change(
                    where, f"tolerance {measure.name} of all × {factor}", not judged(other)
                )
        for name, largest in study.limits.items():
            if largest:
                other = dataclasses.replace(study, limits={**study.limits, name: factor * largest})
                yield Change(where, f"limit {name} of all × {factor}", not judged(other))


def without_references(result: Result) -> Result:
    """A stored result as the problem returned it, without references and aims."""
    numbers = {n: v for n, v in result.numbers.items() if not n.startswith(ADDED)}
    return dataclasses.replace(result, numbers=numbers)


def _scaled(reference: Any, factor: float) -> Any:
    if callable(reference):
        return lambda case: factor * reference(case)
    return factor * reference


# ---- validation ----------------------------------------------------------------------------------


def validation_changes(name: str) -> Iterator[Change]:
    """Predictions and measured values of a case."""
    case = read_case(CASES / f"{name}.toml", MODELS)
    stored = read_results(STORED / f"{name}.json", name)
    where = f"validate {name}"
    known = case_set(case, MPI.COMM_SELF, quick=False).judgements(stored)

    def judged(results: list[Result], other: Case = case) -> bool:
        """Whether the case, or another one instead, finds nothing wrong."""
        now = [
            *case_set(other, MPI.COMM_SELF, quick=False).judgements(results),
            *changes(with_measured(other, results), stored, REPEATABILITY, compared_numbers),
        ]
        return is_well(now, known)

    def predicted(result: Result) -> list[str]:
        """Names of the predicted numbers."""
        return [one for one in compared_numbers(result) if not one.startswith("measured ")]

    yield from changed_results(where, stored, predicted, judged)
    for t, test in enumerate(case.tests):
        for m, measured in enumerate(test.measured):
            for factor in FACTORS:
                one = dataclasses.replace(measured, y=factor * measured.y)
                items = (*test.measured[:m], one, *test.measured[m + 1 :])
                other_test = dataclasses.replace(test, measured=items)
                tests = (*case.tests[:t], other_test, *case.tests[t + 1 :])
                other = dataclasses.replace(case, tests=tests)
                words = f"measured {measured.quantity} of {test.name} × {factor}"
                yield Change(where, words, not judged(stored, other))


# ---- benchmarks ----------------------------------------------------------------------------------


def benchmark_changes() -> Iterator[Change]:
    """Answers of problems of run times, and stored errors of problems of errors."""
    from bench import STORED as POINTS
    from bench import judge_points, turns
    from contestants import SELF
    from problems import ERROR_PROBLEMS, PROBLEMS

    for name, problem in PROBLEMS.items():
        for form, sizes in (("", problem.cases), (" --quick", problem.quick)):
            if not problem.answers:
                continue
            answers = {
                label: {**problem.answers.get("all", {}), **problem.answers.get(label, {})}
                for label in sizes
            }
            for label, figures in answers.items():
                for figure in figures:
                    for factor in FACTORS:
                        results = []
                        for other, others in answers.items():
                            numbers = {key: answer for key, (answer, _) in others.items()}
                            numbers |= {problem.cost[0]: 1.0, "cost": 1.0}
                            if other == label:
                                numbers[figure] *= factor
                            values = {"case": other, "program": SELF, "run": 0}
                            results.append(Result(values, numbers, 1.0))
                        cases = turns(name, problem, 1, bool(form))
                        bare = dataclasses.replace(problem, peers=())
                        cases = turns(name, bare, 1, bool(form))
                        found = cases.judgements(results)
                        words = f"{figure} of {label} × {factor}"
                        yield Change(f"bench {name}{form}", words, not is_well(found, []))
    for name, problem in ERROR_PROBLEMS.items():
        points = read_results(POINTS / f"{name}.json", name)
        known = list(judge_points(problem, points, quick=False))
        exact = problem.error.get("exact")
        if exact is None:
            continue
        for factor in FACTORS:
            moved = [
                dataclasses.replace(
                    point,
                    numbers={**point.numbers, "error": abs(1 / factor - 1)},
                )
                for point in points
                if not point.failed
            ]
            found = list(judge_points(problem, moved, quick=False))
            words = f"exact of {problem.error['figure']} × {factor}"
            yield Change(f"bench {name}", words, not is_well(found, known))


# ---- all of them ---------------------------------------------------------------------------------


def all_changes() -> Iterator[Change]:
    """Every change of every judge."""
    for name in STUDIES:
        for quick in (False, True):
            yield from study_changes(name, quick)
    for name in EXPERIMENTS:
        yield from validation_changes(name)
    yield from benchmark_changes()


def main(words: Sequence[str]) -> int:
    """Print how many changes are noticed, and those that are not."""
    reasons = tomllib.loads(REASONS.read_text(encoding="utf-8")).get("unnoticed", {})
    found = list(all_changes())
    if "--all" in words:
        for change in found:
            print(f"{'noticed' if change.is_noticed else 'NOT    '} {change.where}: {change.what}")
    unnoticed = [change for change in found if not change.is_noticed]
    without_reason = [change for change in unnoticed if change.name not in reasons]
    superfluous = set(reasons) - {change.name for change in unnoticed}
    for change in without_reason:
        print(f"not noticed: {change.where}: {change.what}")
    for name in sorted(superfluous):
        print(f"noticed, though tools/unnoticed.toml has a reason: {name}")
    print(
        f"{len(found)} changes of 20 %: {len(found) - len(unnoticed)} noticed, "
        f"{len(unnoticed) - len(without_reason)} not, with a reason, {len(without_reason)} without."
    )
    return 1 if without_reason or superfluous else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
