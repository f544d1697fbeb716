"""How far an answer can be off: a quantity over meshes, steps, starts and unknown constants.

One factor at a time is changed from its usual value.  What a quantity then does decides what may be
said of it, its verdict:

- *determined*: no factor changes it by more than a limit.  The largest change is its uncertainty.
- *statistical*: a start that differs by less than can be measured changes it by more than that, and
  no other factor changes it by much more than the start.  It has a mean and a standard deviation.
- *not determined*: another factor changes it by more.  It has a range, and the factor is named.

A closed energy balance says nothing of this: it proves the method, and not the answer.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.cases.case_runs import Build, CaseRuns
from gossamer_fx.analysis.cases.case_set import CaseSet, run_cases
from gossamer_fx.analysis.cases.results import (
    Result,
    markdown_table,
    number_names,
    shown_names,
    value_text,
    values_text,
)
from gossamer_fx.core.checks.arguments import check_arguments, positive
from gossamer_fx.core.checks.errors import check, on_rank_zero
from gossamer_fx.core.checks.lookups import check_known
from gossamer_fx.core.model.body import Array
from gossamer_fx.records.plot.written_panels import written_panels

# Change of a quantity up to which it counts as determined, unless another limit is given.
SPREAD_LIMIT = 0.1

# A quantity is statistical if no factor changes it by more than this multiple of the range that the
# starts cover: two or three starts cover about half of the range of ten.
START_RANGES = 2.0

# Layout of the picture [inch].
_WIDTH = 8.0
_ROW_HEIGHT = 0.22
_PANEL_EXTRA = 0.55


@check_arguments
@dataclass(frozen=True)
class Verdict:
    """What may be said of a quantity.

    Attributes:
        kind: "determined", "statistical" or "not determined".
        value: of the usual run; the mean over all runs if it is statistical.
        low, high: smallest and largest value of all runs.
        deviation: standard deviation over all runs.
        changes: largest change of each factor, over the scale of the quantity, by name.
        reason: why there are no numbers: a run without a finite value; else empty.

    Example:
        >>> changes = {"cells": 0.03, "damping": 0.4}
        >>> print(gx.analysis.Verdict("not determined", 1.0, 0.6, 1.1, 0.2, changes))
        not determined: 0.60 to 1.10, most by damping
    """

    kind: str
    value: float = 0.0
    low: float = 0.0
    high: float = 0.0
    deviation: float = 0.0
    changes: Mapping[str, float] = field(default_factory=dict)
    reason: str = ""

    @property
    def largest_change(self) -> float:
        """The largest change by any factor, over the scale of the quantity."""
        return max(self.changes.values(), default=math.inf)

    @property
    def factor(self) -> str:
        """Name of the factor that changes the quantity most."""
        return max(self.changes, key=lambda name: self.changes[name], default="")

    def __str__(self) -> str:
        """The verdict as a clause, with no more digits than are determined."""
        if self.reason:
            return f"not determined: {self.reason}"
        if self.kind == "determined":
            uncertainty = max(self.value - self.low, self.high - self.value)
            value = rounded(self.value, uncertainty)
            return f"{value}, determined to {_percent(self.largest_change)}"
        if self.kind == "statistical":
            mean = rounded(self.value, self.deviation)
            deviation = rounded(self.deviation, self.deviation)
            return f"statistical: mean {mean}, standard deviation {deviation}"
        size = self.high - self.low
        ends = f"{rounded(self.low, size)} to {rounded(self.high, size)}"
        return f"not determined: {ends}, most by {self.factor}"


@check_arguments
@dataclass(frozen=True, eq=False)
class Spread:
    """Quantities of runs in which one factor at a time was changed; `spread` makes one.

    Attributes:
        results: of all runs; the first one has the usual value of every factor.
        chance: factors that only nudge the start.
        limit: change up to which a quantity is determined.
        scales: what changes are relative to, by the name of the quantity; default: the size of its
            usual value.
        quantities: that are judged; default: all numbers.

    Example:
        >>> found = gx.analysis.spread(lambda comm, n: {"y": 1 + 1 / n**2}, vary={"n": [8, 16]})
        >>> found.verdict("y").factor, found.runs_of("n")[0].numbers
        ('n', {'y': 1.00390625})
    """

    results: Sequence[Result]
    chance: Sequence[str] = ()
    limit: float = SPREAD_LIMIT
    scales: Mapping[str, float] = field(default_factory=dict)
    quantities: Sequence[str] = ()

    @property
    def names(self) -> list[str]:
        """Names of the quantities that are judged."""
        return list(self.quantities) or shown_names([run.numbers for run in self.results])

    @property
    def factors(self) -> list[str]:
        """Names of the factors, in the order in which they were given."""
        return list(self.results[0].values)

    def runs_of(self, factor: str) -> list[Result]:
        """The runs in which a factor has not its usual value."""
        usual = self.results[0].values[factor]
        return [result for result in self.results if result.values[factor] != usual]

    def verdict(self, quantity: str) -> Verdict:
        """What may be said of a quantity.

        Raises:
            InputError: no run has such a number.
        """
        known = number_names([run.numbers for run in self.results])
        check_known("The outcome of the runs", "number", quantity, known)
        for result in self.results:
            if not math.isfinite(result.numbers.get(quantity, math.nan)):
                words = result.failed or "no finite value"
                reason = f"{values_text(result.values)}: {words}"
                return Verdict("not determined", reason=reason)
        values = np.array([result.numbers[quantity] for result in self.results])
        scale = self.scales.get(quantity, abs(values[0])) or 1.0
        changes = {}
        for factor in self.factors:
            sizes = [abs(run.numbers[quantity] - values[0]) for run in self.runs_of(factor)]
            changes[factor] = max(sizes, default=0.0) / scale
        starts = [values[0]]
        for factor in self.chance:
            starts += [run.numbers[quantity] for run in self.runs_of(factor)]
        by_chance = (max(starts) - min(starts)) / scale
        others = [change for name, change in changes.items() if name not in self.chance]
        kind = "not determined"
        value = values[0]
        if max(changes.values()) <= self.limit:
            kind = "determined"
        elif max(others, default=0.0) <= START_RANGES * by_chance:
            kind = "statistical"
            value = values.mean()
        return Verdict(
            kind=kind,
            value=float(value),
            low=float(values.min()),
            high=float(values.max()),
            deviation=float(values.std(ddof=1)),
            changes=changes,
        )

    def rows(self) -> list[list[str]]:
        """Texts of the cells of the table; first the headings."""
        rows = [["quantity", "usual", "verdict", *(f"by {name}" for name in self.factors)]]
        for name in self.names:
            found = self.verdict(name)
            usual = self.results[0].numbers.get(name, math.nan)
            changes = [_percent(found.changes.get(factor, math.nan)) for factor in self.factors]
            rows.append([name, f"{usual:.4g}", str(found), *changes])
        return rows

    def table(self) -> str:
        """A table in Markdown: usual value, verdict and the largest change by each factor, with a
        line on what was varied."""
        lines = [markdown_table(self.rows())]
        for factor in self.factors:
            usual = value_text(self.results[0].values[factor])
            others = [value_text(run.values[factor]) for run in self.runs_of(factor)]
            kind = " (nudges the start)" if factor in self.chance else ""
            lines.append(f"- {factor}{kind}: usually {usual}; also {', '.join(others)}.")
        return "\n".join(lines) + "\n"

    @check_arguments
    def plot(self, path: str | Path) -> None:
        """Write a PNG: for each quantity a panel with the values by each factor, next to the
        usual one.

        Args:
            path: of the file, ending in `.png`.

        Raises:
            OutputFailure: the file cannot be written.
        """
        shown = [name for name in self.names if not self.verdict(name).reason]
        panel_height = _ROW_HEIGHT * len(self.factors) + _PANEL_EXTRA
        size = (_WIDTH, max(panel_height * len(shown), 1.0))
        with written_panels(path, size, max(len(shown), 1)) as panels:
            for axes, name in zip(panels[:, 0], shown, strict=False):
                usual = self.results[0].numbers[name]
                axes.axvline(usual, color="#33383d", linewidth=1.0)
                for row, factor in enumerate(self.factors):
                    values: Array = np.array([run.numbers[name] for run in self.runs_of(factor)])
                    ends = [min(usual, values.min()), max(usual, values.max())]
                    colour = "#D55E00" if factor in self.chance else "#0072B2"
                    axes.plot(ends, [row, row], color=colour, linewidth=3, alpha=0.35)
                    axes.plot(values, np.full(len(values), row), "o", color=colour, markersize=4)
                axes.set_yticks(range(len(self.factors)), self.factors, fontsize=8)
                axes.set_ylim(len(self.factors) - 0.5, -0.5)
                axes.tick_params(axis="x", labelsize=8)
                axes.set_title(f"{name}: {self.verdict(name)}", fontsize=9, loc="left")
                axes.spines[["top", "right"]].set_visible(False)


def one_at_a_time(vary: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """Values of all runs: the usual ones, which are the first of each factor, then each further
    value of one factor with the usual ones of the others.

    Raises:
        InputError: no factor, a factor with less than two values, equal values, or values that are
            neither numbers nor words.
    """
    check(len(vary) > 0, "spread: there is nothing to vary; name a factor and its values.")
    for name, values in vary.items():
        is_plain = all(isinstance(value, str | int | float) for value in values)
        check(
            is_plain and len(values) >= 2 and len(set(values)) == len(values),
            f"spread: {name} has {list(values)!r}; give its usual value and one or more others, "
            "numbers or words.",
        )
    usual = {name: values[0] for name, values in vary.items()}
    return [usual] + [
        {**usual, name: value} for name, values in vary.items() for value in values[1:]
    ]


@check_arguments
def spread(
    case: Build,
    *,
    vary: Mapping[str, Sequence[Any]],
    chance: Sequence[str] = (),
    quantities: Sequence[str] = (),
    scales: Mapping[str, float] | None = None,
    limit: Annotated[float, positive()] = SPREAD_LIMIT,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    folder: str | Path | None = None,
    executor: Executor | None = None,
) -> Spread:
    """Compute a case with one factor at a time changed, and say how well each quantity is
    determined.  Collective.

    Args:
        case: case(comm, **values), e.g. the function `build` of a scene file, whose probes are the
            quantities; or a function that makes the run and returns numbers by name.
        vary: values of each factor by name, the usual one first: cells, steps, numerical constants,
            and constants that nobody has measured, over their range.  Numbers or words.
        chance: names of factors that only nudge the start, by less than can be measured, such as a
            pressure that is multiplied by `1 + nudge` with `nudge` of 0, 1e-9, -1e-9.
        quantities: names of the numbers that are judged; default: all.
        scales: what changes of a quantity are relative to, in its unit, by name; for quantities
            around zero.  Default: the size of its usual value.
        limit: relative change up to which a quantity counts as determined.
        comm: ranks that compute each run together.
        folder: of the runs, with runs.csv, spread.md and spread.png.  What it has is not computed
            again.  Default: nothing is kept.
        executor: whose workers make the runs, any `concurrent.futures.Executor`:
            `ProcessPoolExecutor` with the context "spawn", `mpi4py.futures.MPIPoolExecutor`,
            `dask.distributed.Client.get_executor()`.  Then `case` is defined at the top of a
            module.

    Raises:
        InputError: nothing is varied, a factor has fewer than two values, a name in `chance` or
            `quantities` is unknown, or the case refuses its values.
        OutputFailure: the folder cannot be written.

    Example:
        >>> def fall(comm, dt, gravity, nudge):
        ...     ball = gx.PointMass(2.0, (0.0, 0.0, 1.0 + nudge), comm=comm, name="ball")
        ...     scene = gx.Scene(ball, gx.Gravity(ball, (0.0, 0.0, -gravity)))
        ...     run = gx.Simulation(scene, gx.Midpoint(dt=dt))
        ...     run.run(until=0.4)
        ...     return {"height [m]": gx.probes.Position(ball.port(), "z")(run)}
        >>> vary = {"dt": [0.02, 0.01], "gravity": [9.81, 9.78, 9.83], "nudge": [0.0, 1e-9]}
        >>> found = gx.analysis.spread(fall, vary=vary, chance=["nudge"])
        >>> print(found.verdict("height [m]"))
        0.2152, determined to 1.1 %
    """
    for name in chance:
        check_known("spread: vary", "factor", name, vary)
    runs = one_at_a_time(vary)
    make = partial(Spread, chance=chance, limit=limit, scales=scales or {}, quantities=quantities)
    if folder is not None:
        return make(_compute(case, runs, make, comm, Path(folder), executor))
    # Runs write their recordings somewhere, even if nobody asks for them.
    kept = on_rank_zero(comm, lambda: tempfile.TemporaryDirectory(prefix="spread-"))
    name = comm.bcast(kept.name if kept is not None else "")
    try:
        return make(_compute(case, runs, make, comm, Path(name), executor))
    finally:
        comm.barrier()
        if kept is not None:
            kept.cleanup()


def _compute(
    case: Build,
    runs: Sequence[Mapping[str, Any]],
    make: Callable[[Sequence[Result]], Spread],
    comm: MPI.Intracomm,
    folder: Path,
    executor: Executor | None,
) -> list[Result]:
    """Make the runs that a folder lacks, and write their table and picture."""
    cases = CaseSet(
        name="spread",
        title="",
        outcome=CaseRuns(case),
        cases=runs,
        rows=lambda results: make(results).rows(),
        draw=lambda results, path: make(results).plot(path),
        may_fail=True,
    )
    return run_cases(cases, comm, folder, verbose=False, executor=executor)


def rounded(value: float, uncertainty: float) -> str:
    """A value with the digits that an uncertainty of the same unit leaves: its first two.

    Example:
        >>> rounded(123.456, 0.83), rounded(0.0012345, 2e-5)
        ('123.46', '0.001234')
    """
    if not math.isfinite(value) or not uncertainty > 0:
        return f"{value:.6g}"
    # The decimal place of the uncertainty's second digit.
    places = 1 - math.floor(math.log10(uncertainty))
    if places < 0:
        return f"{round(value, places):.0f}"
    # Below a part in a million nobody reads more digits.
    return f"{value:.{places}f}" if places <= 6 else f"{value:.6g}"


def _percent(change: float) -> str:
    """A relative change in percent, with two digits; empty for NaN."""
    if math.isnan(change):
        return ""
    percent = 100 * change
    return f"{percent:.0f} %" if percent >= 100 else f"{percent:.2g} %"
