"""Studies: a problem over meshes, elements, laws, steppers, ..., and what error a second of
computing leaves.

A `Study` is data: a problem, the axes along which it is varied, references and expected rates.  It
becomes a set of cases of `gossamer_fx.analysis.cases`, which computes what is missing, compares it
with what the study declares, and writes the table and the picture.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.extend import (
    CaseSet,
    ErrorCurve,
    Judgement,
    Result,
    check,
    draw_error_curves,
    number_text,
    observed_order,
    values_text,
)

Trial = Mapping[str, Any]  # the values along the axes

# Reasons for warnings that several studies expect.
ROUND_OFF = {
    "the inner forces have a round-off": "the load is far below the stiffness of the sheet; the "
    "remaining force is small compared with the errors that are judged"
}
NOT_REGULAR = {
    "The equilibrium is not regular": "wrinkles without stiffness against bending, or that could "
    "as well lie elsewhere, have neighbours at the same energy"
}
NOT_STABLE = {
    "The equilibrium is not stable": "wrinkles that the mesh resolves could merge, and film that "
    "bears compression could form more of them"
}
WITHOUT_UNITS = {
    "numbers are in SI units": "the reference is without units, or a round number",
    "lengths are in metres": "the reference is without units, or a round number",
}

# Largest relative change of a result from the stored one: what is printed has fewer digits.
REPEATABILITY = 1e-3

# By so much an observed order may be below the expected one: coarse cases are not yet in the
# asymptotic range.
ORDER_MARGIN = 0.3


def no_order(case: Trial) -> float:
    """The rate of a measure of which no order is expected."""
    return math.inf


def search_figures(found: gx.analysis.EquilibriumResult) -> dict[str, float]:
    """How a search went: what a problem returns of it."""
    return {
        "iterations": found.iterations,
        "residual": found.residual,
        "seconds": found.seconds,
    }


@dataclass(frozen=True)
class Measure:
    """A result with a reference.

    Args:
        name: its key in what the problem returns.
        reference: exact value, or a function of the case; zero for a result that is an error
            itself.
        tolerance: largest relative error that is accepted on the finest of the full study.
        rate: expected order in h for a case; infinite where no order is expected.
        quick_tolerance: the same on the finest mesh of a quick run; default: `tolerance`.
        is_quick_asymptotic: whether the meshes of a quick run show the order, too.
    """

    name: str
    reference: float | Callable[[Trial], float]
    tolerance: float = math.inf
    rate: Callable[[Trial], float] = no_order
    quick_tolerance: float | None = None
    is_quick_asymptotic: bool = True

    def error(self, result: Result) -> float:
        """|value - reference|/|reference|, or |value| where the reference is zero; NaN if the
        result lacks the value."""
        if self.name not in result.numbers:
            return math.nan
        reference = self.reference
        if callable(reference):
            reference = reference(result.values)
        return abs(result.numbers[self.name] - reference) / (abs(reference) or 1.0)


@dataclass(frozen=True)
class Claim:
    """What a page says of results.

    Args:
        number: its key in what the problem returns.
        low, high: between which it is in all cases that are meant.
        where: values of these cases; default: all cases.
    """

    number: str
    low: float
    high: float
    where: Mapping[str, Any] = field(default_factory=dict)

    def judgements(self, results: Sequence[Result]) -> Iterator[Judgement]:
        """Of the results that are meant and did not fail."""
        for result in results:
            is_meant = all(result.values.get(name) == v for name, v in self.where.items())
            if is_meant and not result.failed:
                value = result.numbers.get(self.number, math.nan)
                words = (
                    f"{self.number}, {values_text(result.values)}: {value:.5g}, claimed "
                    f"{self.low:.5g} to {self.high:.5g}"
                )
                yield Judgement(words, self.low <= value <= self.high)


# Beginnings of what `Study.to_be_stored` adds to the numbers of a result.
ADDED = ("reference of ", "tolerance of ", "limit of ")

# Numbers that differ from run to run, or with the last digit of a residual.
NOT_COMPARED = {
    "seconds",
    "compile_seconds",
    "iterations",
    "plane iterations",
    "residual",
    "newton_per_step",
    "Newton/step",
    "energy_error",
    "mass_error",
    "angular_momentum_drift",
    "momentum_error",
    "rejected",
    "substeps",
    "steps",
}


@dataclass(frozen=True)
class Study:
    """A problem and its axes.

    Args:
        name: of its files.
        title: one line above the table.
        problem: problem(comm, **case) returns numbers by name, "seconds" among them: run time
            without start-up and compilation.  Numbers that are NaN have no value in this case.
        axes: values of the parameters by name; numbers and words.  The last axis is the one that is
            refined.
        size: h of a case.
        measures: the results that have references.
        finer: further cases of the full form, where the last value of the last axis is too coarse.
        quick: axes with fewer values, for `quick` runs.
        quick_options: further arguments of the problem in `quick` runs, such as an earlier end.
        columns: names of further results that the table shows, divided by commas.
        shows: results of which at least one case must have a finite value other than zero.
        quick_shows: the same in quick runs; default: `shows`.
        limits: largest sizes of results in all cases that have them, such as errors of balances.
        claims: what pages say of the results, without `quick_options`.
        repeatability: largest relative change of a result from the stored one that another
            processor or library may cause.
        not_repeatable: results that are not compared with stored ones, with the reason; "all" for
            all of them.
        may_fail: whether a case that fails by name is a result, too.
        expected_warnings: reasons by a part of the text of a warning.
        draw: draws all results, draw(results, path), instead of errors against run time and h.
    """

    name: str
    title: str
    problem: Callable[..., Mapping[str, float]]
    axes: Mapping[str, Sequence[Any]]
    size: Callable[[Trial], float]
    measures: tuple[Measure, ...] = ()
    finer: Sequence[Trial] = ()
    quick: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    quick_options: Mapping[str, Any] = field(default_factory=dict)
    columns: str = "iterations, seconds"
    shows: tuple[str, ...] = ()
    quick_shows: tuple[str, ...] | None = None
    limits: Mapping[str, float] = field(default_factory=dict)
    claims: Sequence[Claim] = ()
    repeatability: float = REPEATABILITY
    not_repeatable: Mapping[str, str] = field(default_factory=dict)
    may_fail: bool = False
    expected_warnings: Mapping[str, str] = field(default_factory=dict)
    draw: Callable[[list[Result], Path], None] | None = None

    def case_set(self, comm: MPI.Intracomm, quick: bool = False) -> CaseSet:
        """The cases of the full or the quick form on the ranks of a communicator.

        Raises:
            InputError: the quick form has an axis that the study has not.
        """
        unknown = set(self.quick) - set(self.axes)
        check(
            not unknown,
            f"Study '{self.name}': quick has an axis {unknown} that the study has not; remove it.",
        )
        axes = {**self.axes, **(self.quick if quick else {})}
        trials: list[Trial] = [
            dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())
        ]
        if not quick:
            trials += self.finer
        # Options and ranks are values of the case, too: other results belong to others.
        others = {**(self.quick_options if quick else {}), "ranks": comm.size}
        shows = self.shows
        if quick and self.quick_shows is not None:
            shows = self.quick_shows
        draw = self.draw
        if draw is None and self.measures:
            draw = self._draw_errors
        return CaseSet(
            name=self.name,
            title=self.title,
            outcome=self.outcome,
            cases=[{**trial, **others} for trial in trials],
            rows=self.rows,
            judge=lambda results: self.judge(results, quick),
            draw=draw,
            shows=shows,
            limits=self.limits,
            expected_warnings=self.expected_warnings,
            may_fail=self.may_fail,
        )

    def outcome(
        self, comm: MPI.Intracomm, folder: Path, ranks: int, **case: Any
    ) -> Mapping[str, float]:
        """What the problem returns of a case; numbers that are NaN are left out."""
        numbers = self.problem(comm, **case)
        check(
            "seconds" in numbers,
            f"Study '{self.name}': its problem returns no 'seconds'; return the run time.",
        )
        return {name: value for name, value in numbers.items() if not math.isnan(value)}

    def curves(self, results: list[Result]) -> dict[tuple[Any, ...], list[Result]]:
        """The results that differ in the refined (last) axis only, by the values of the others."""
        *others, _ = self.axes
        found: dict[tuple[Any, ...], list[Result]] = {}
        for result in results:
            found.setdefault(tuple(result.values[name] for name in others), []).append(result)
        return found

    def order(self, measure: Measure, coarse: Result, fine: Result) -> float:
        """Observed order between two results of a curve; not a number where there is none."""
        return observed_order(
            measure.error(coarse),
            measure.error(fine),
            self.size(coarse.values),
            self.size(fine.values),
        )

    def case_text(self, result: Result) -> str:
        """The values along the axes, with their names."""
        return values_text({name: result.values[name] for name in self.axes})

    def rows(self, results: list[Result]) -> Iterator[list[str]]:
        """The table, curve by curve, with errors and orders."""
        head = [*self.axes]
        for measure in self.measures:
            head += [measure.name, "error", "order"]
        columns = self.columns.split(", ")
        yield [*head, *columns]
        for curve in self.curves(results).values():
            for previous, result in zip([None, *curve], curve, strict=False):
                cells = [str(result.values[name]) for name in self.axes]
                for measure in self.measures:
                    # The coarsest case of a curve has no other to be compared with.
                    slope = self.order(measure, previous, result) if previous else math.nan
                    value = result.numbers.get(measure.name, math.nan)
                    cells.append(number_text(value, ".6g"))
                    cells.append(number_text(measure.error(result), ".2g"))
                    cells.append(number_text(slope, ".1f"))
                for name in columns:
                    cells.append(number_text(result.numbers.get(name, math.nan), ".4g"))
                if result.failed:
                    cells[-1] += " (failed)"
                yield cells

    def compared_numbers(self, result: Result) -> list[str]:
        """Names of the numbers of a result that are compared with stored ones.

        Balances are at round-off; their limits judge them.
        """
        skipped = NOT_COMPARED | {*self.limits} | {*self.not_repeatable}
        if "all" in self.not_repeatable:
            return [name for name in result.numbers if name.startswith(ADDED)]
        return [name for name in result.numbers if name not in skipped]

    def to_be_stored(self, results: list[Result]) -> list[Result]:
        """Results with the references and aims of the study, so that another one is noticed."""
        aims = {f"limit of {name}": largest for name, largest in self.limits.items()}
        for measure in self.measures:
            if math.isfinite(measure.tolerance):
                aims[f"tolerance of {measure.name}"] = measure.tolerance
        stored = []
        for result in results:
            references = dict(aims)
            for measure in self.measures:
                value = measure.reference
                references[f"reference of {measure.name}"] = (
                    value(result.values) if callable(value) else value
                )
            numbers = result.numbers if result.failed else {**result.numbers, **references}
            stored.append(replace(result, numbers=numbers, seconds=round(result.seconds, 1)))
        return stored

    def judge(self, results: list[Result], quick: bool) -> Iterator[Judgement]:
        """Errors of the finest cases with their tolerances, and orders with the expected ones."""
        # With other options the problem of a quick run is another one.
        if not (quick and self.quick_options):
            for claim in self.claims:
                yield from claim.judgements(results)
        for curve in self.curves(results).values():
            done = [result for result in curve if not result.failed]
            for measure in self.measures if done else ():
                words = f"{measure.name}, {self.case_text(done[-1])}"
                tolerance = measure.tolerance
                if quick and measure.quick_tolerance is not None:
                    tolerance = measure.quick_tolerance
                if math.isfinite(tolerance):
                    error = measure.error(done[-1])
                    # Written so that an error that is not a number falls short, too.
                    holds = error <= tolerance
                    yield Judgement(f"{words}: error {error:.2g} > {tolerance:.2g}", holds)
                rate = measure.rate(done[-1].values)
                is_asymptotic = measure.is_quick_asymptotic or not quick
                if math.isfinite(rate) and is_asymptotic and len(done) > 1:
                    overall = self.order(measure, done[0], done[-1])
                    holds = overall >= rate - ORDER_MARGIN
                    subject = f"{words}: order"
                    yield Judgement(f"{subject} {overall:.2f}, expected {rate:.2g}", holds, subject)

    def summary(self, results: list[Result]) -> Iterator[list[str]]:
        """For every measure what the finest cases of each element leave, and the orders."""
        groups: dict[str, list[list[Result]]] = {}
        for name, curve in self.curves(results).items():
            done = _computed(curve)
            # A study of bodies that have one element only counts as one of P1.
            element = "P2" if "P2" in name else "P1"
            if done:
                groups.setdefault(element, []).append(done)
        if not groups:
            return
        finest = [curve[-1] for found in groups.values() for curve in found]
        seconds = _span([result.numbers["seconds"] for result in finest], ".2g")
        for measure in self.measures:
            cells = {"P1": "", "P2": ""}
            for element, found in groups.items():
                orders = []
                for curve in found:
                    # An infinite rate means that no order is expected.
                    has_order = math.isfinite(measure.rate(curve[-1].values))
                    if has_order and len(curve) > 1:
                        orders.append(self.order(measure, curve[0], curve[-1]))
                error = number_text(max(measure.error(curve[-1]) for curve in found), ".2g")
                cells[element] = f"{error}; {_span(orders, '.1f')}" if orders else error
            yield [self.name, measure.name, cells["P1"], cells["P2"], seconds]

    def _draw_errors(self, results: list[Result], path: Path) -> None:
        """Errors against run time and against h, a row of panels for each measure."""
        rows: dict[str, list[ErrorCurve]] = {}
        for measure in self.measures:
            curves = rows.setdefault(f"relative error of {measure.name}", [])
            for name, curve in self.curves(results).items():
                done = _computed(curve)
                label = ", ".join(map(str, name)) or self.name
                if len(done) > 1:
                    overall = self.order(measure, done[0], done[-1])
                    label += f" (order {overall:.1f})" if not math.isnan(overall) else ""
                # Curves that differ in the element only share their colour.
                alike = [str(value) for value in name if value not in ("P1", "P2")]
                curves.append(
                    ErrorCurve(
                        name=label,
                        seconds=[result.numbers["seconds"] for result in done],
                        errors=[measure.error(result) for result in done],
                        sizes=[self.size(result.values) for result in done],
                        colour_group=", ".join(alike) or self.name,
                    )
                )
        draw_error_curves(path, rows, self.title)


SUMMARY_HEAD = ["study", "measure", "largest error; order", "the same with P2", "CPU time [s]"]


def _computed(curve: list[Result]) -> list[Result]:
    """The results of a curve that have numbers: a step that fails may be a result without."""
    return [result for result in curve if not result.failed and result.numbers]


def _span(values: list[float], form: str) -> str:
    """Smallest and largest of some numbers."""
    if not values:
        return ""
    # One number if both are the same to these digits.
    ends = {f"{value:{form}}" for value in (min(values), max(values))}
    return " to ".join(sorted(ends, key=float))
