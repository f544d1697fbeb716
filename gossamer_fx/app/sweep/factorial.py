"""Plain sweeps: runs with all combinations of some values, or with a list of values; a table and
pictures.

The runs are those of `analysis.cases`: any number of processes share them, a run with a result is
not repeated, and a run that was killed is made again, from its last checkpoint if it writes any.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial
from itertools import cycle, product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.cases.case_set import CaseSet, run_cases
from gossamer_fx.analysis.cases.results import (
    EXTREMES,
    Outcome,
    Result,
    shown_names,
    value_text,
    values_text,
)
from gossamer_fx.app.sweep.run_lines import covering, draw_lines
from gossamer_fx.core.checks.arguments import at_least, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.records.fields.units import without_round_off

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# More runs than this are a slip of the keyboard rather than a wish.
MAX_RUNS = 10_000

# Panels of the picture; the table has all numbers.
_MAX_PANELS = 12
_MARGIN = 0.05  # of the axis, at both of its ends
# Errors of balances below this are round-off, of which no curve is drawn.
_ROUND_OFF = 1e-12


@check_arguments
@dataclass(frozen=True)
class Factorial:
    """A sweep over all combinations of values, or over a list of them.

    In a file it has the name SWEEP, and `./gossamer sweep FILE` runs it; a scene file needs none:
    `./gossamer sweep SCENE --over cells=4,8 edge=0.2,0.3`.

    Args:
        outcome: outcome(comm, folder, **values) makes one run and returns numbers by name; `folder`
            is for the files of the run.
        over: values of each factor by name: numbers or words.
        listed: whether the first values of all factors belong together, the second ones, and so on;
            else all combinations are run.

    Raises:
        InputError: no factor, values that are equal or neither numbers nor words, or lists of
            different lengths.

    Example:
        >>> def outcome(comm, folder, bore, stroke):
        ...     return {"volume": bore**2 * stroke}
        >>> SWEEP = gx.sweep.Factorial(outcome, {"bore": [1.0, 2.0], "stroke": [1.0, 3.0, 5.0]})
        >>> len(SWEEP.cases()), SWEEP.cases()[1]
        (6, {'bore': 1.0, 'stroke': 3.0})
    """

    outcome: Outcome
    over: Annotated[Mapping[str, Sequence[Any]], at_least(1)]
    _: KW_ONLY
    listed: bool = False

    def __post_init__(self) -> None:
        """Check the factors and their values.

        Raises:
            InputError: `outcome` is not a function, there is no factor, a value is neither a number
                nor a word, lists have different lengths, two runs are equal, or there are more than
                10 000 runs.
        """
        for name, values in self.over.items():
            # Other values could not be written to the files of results, and found in them again.
            is_plain = all(isinstance(value, str | int | float) for value in values)
            check(
                is_plain and len(values) > 0,
                f"Factorial: {name} has {values!r}; give numbers or words.",
            )
        counts = {name: len(values) for name, values in self.over.items()}
        words = ", ".join(f"{name} has {count}" for name, count in counts.items())
        check(
            not self.listed or len(set(counts.values())) == 1,
            f"Factorial: in a list all factors have as many values; {words}.",
        )
        runs = int(np.prod([float(count) for count in counts.values()]))
        check(
            self.listed or runs <= MAX_RUNS,
            f"Factorial: {words}, which makes {runs} runs; give fewer values, at most {MAX_RUNS} "
            "runs.",
        )
        cases = [repr(case) for case in self.cases()]
        check(
            len(set(cases)) == len(cases),
            f"Factorial: a run is in the sweep twice ({words}); give different values.",
        )

    def cases(self) -> list[dict[str, Any]]:
        """Values of all factors in all runs, by name; the last factor varies fastest."""
        combinations: Any = product(*self.over.values())
        if self.listed:
            combinations = zip(*self.over.values(), strict=True)
        return [dict(zip(self.over, values, strict=True)) for values in combinations]


@check_arguments
def run_factorial(
    sweep: Factorial, comm: MPI.Intracomm, folder: str | Path, *, executor: Executor | None = None
) -> str:
    """Make the runs of a sweep that its folder lacks; writes runs.csv, sweep.md, sweep.png and, of
    runs that were recorded, curves.png.  Collective.

    A run whose step or equilibrium fails (`StepFailure`, `NoEquilibrium`) does not end the sweep:
    the tables have the reason, the picture a gap.  Any other exception of an outcome ends the sweep
    before the reports are written; results of earlier runs stay in the folder and are not repeated.

    Args:
        sweep: what to run.
        comm: ranks that make a run together.
        folder: of runs and reports.
        executor: whose workers make the runs, see `gossamer_fx.analysis.spread`; default: the
            calling processes.

    Returns:
        The table in Markdown, as in sweep.md.

    Raises:
        InputError: the folder cannot be written, the file of a result is damaged, or the outcome
            refuses values of a run or returns something other than numbers.

    Example:
        >>> sweep = gx.sweep.Factorial(lambda comm, folder, a: {"y": 2.0 * a}, {"a": [1.0, 2.0]})
        >>> gx.sweep.run_factorial(sweep, comm, folder / "doubled").splitlines()[0]
        '2 runs, 0 s; 0 failed.'
    """
    cases = CaseSet(
        name="sweep",
        title="",
        outcome=sweep.outcome,
        cases=sweep.cases(),
        draw=lambda results, path: _draw_all(sweep, results, path),
    )
    results = run_cases(cases, comm, Path(folder), verbose=False, executor=executor)
    return cases.table(results)


# ---- the pictures --------------------------------------------------------------------------------


def _draw_all(sweep: Factorial, results: Sequence[Result], path: Path) -> None:
    """Draw the numbers of the runs, and the curves of those that were recorded."""
    draw(sweep, results, path)
    varied = {name: values for name, values in sweep.over.items() if len(set(values)) > 1}
    if sweep.listed:
        # In a list the factors vary together: the one with the most values tells runs apart best.
        most = max(varied, key=lambda name: len(set(varied[name])), default="")
        varied = {name: varied[name] for name in (most,) if name}
    draw_lines(results, varied, path.parent / "runs", path.with_name("curves.png"))


def draw(sweep: Factorial, results: Sequence[Result], path: Path) -> None:
    """Draw each number over the first factor, with a curve for each combination of the others.

    The first 12 numbers are drawn; above them stands how many there are.  A failed run leaves a gap
    in its curve; nothing is written if all runs failed.

    Args:
        sweep: that was run.
        results: of its runs.
        path: of the PNG.

    Raises:
        OutputFailure: the file cannot be written.
    """
    from gossamer_fx.records.plot.curve_panels import Curves, Panel
    from gossamer_fx.records.plot.page import write_page

    results = [replace(one, numbers=without_round_off(one.numbers)) for one in results]
    names = shown_names([result.numbers for result in results])
    names = [name for name in names if not _is_round_off(name, results)]
    shown = names[:_MAX_PANELS]
    if not shown:
        return
    title = ""
    if len(names) > len(shown):
        title = f"{len(shown)} of {len(names)} numbers; runs.csv has all."
    varied = [name for name, values in sweep.over.items() if len(set(values)) > 1]
    first = (varied or list(sweep.over))[0]
    others = [name for name in varied if name != first]
    # In a list the factors vary together: there is one curve.
    if sweep.listed:
        others = []
    # Words are drawn at equal distances, numbers on their scale.
    levels = list(dict.fromkeys(sweep.over[first]))
    has_words = any(isinstance(level, str) for level in levels)
    positions = [float(k if has_words else level) for k, level in enumerate(levels)]
    margin = _MARGIN * (max(positions) - min(positions)) or 1.0
    curves: dict[str, list[tuple[float, Result]]] = {}
    for result in results:
        label = values_text({name: result.values[name] for name in others})
        position = positions[levels.index(result.values[first])]
        curves.setdefault(label, []).append((position, result))
    ticks = dict(zip(positions, map(value_text, levels), strict=True)) if has_words else {}
    panels: list[Panel] = [partial(_draw_panel, number, curves, ticks) for number in shown]
    start = min(positions) - margin
    end = max(positions) + margin
    write_page(path, title, None, Curves(panels, start, end, first))


def _is_round_off(name: str, results: Sequence[Result]) -> bool:
    """Whether a number of the results is an extreme that is zero in all of them, or the closing
    error of balances that all close."""
    sizes = [abs(result.numbers.get(name, 0.0)) for result in results]
    if name.endswith(EXTREMES):
        return max(sizes) == 0
    return name == "energy error" and max(sizes) < _ROUND_OFF


def _draw_panel(
    number: str,
    curves: Mapping[str, Sequence[tuple[float, Result]]],
    ticks: Mapping[float, str],
    axes: Axes,
) -> None:
    """Draw one number of the runs of each curve over their positions on the axis."""
    from gossamer_fx.records.fields.units import plain_text
    from gossamer_fx.records.plot.curve_panels import (
        INK,
        LINES,
        End,
        label_ends,
        wrapped,
    )

    colours = dict(zip(curves, cycle(LINES), strict=False))
    tables: dict[str, tuple[Array, Array]] = {}
    for label, runs in curves.items():
        points = sorted((position, run.numbers.get(number, np.nan)) for position, run in runs)
        at_levels, numbers = np.array(points).T
        tables[label] = (at_levels, numbers)
    ends: list[End] = []
    # Curves that cover each other are drawn once, and named together.
    for group in covering(list(tables.values())):
        labels = [list(tables)[index] for index in group]
        at_levels, numbers = tables[labels[0]]
        colour = colours[labels[0]] if len(labels) == 1 else INK
        axes.plot(at_levels, numbers, "o-", color=colour, markersize=4, linewidth=1.2)
        finite = numbers[np.isfinite(numbers)]
        words = "all" if len(labels) == len(curves) > 1 else "; ".join(labels)
        if words and len(finite):
            ends.append((words, float(finite[-1]), colour))
    if ticks:
        axes.set_xticks(list(ticks), list(ticks.values()))
    axes.set_title(wrapped(plain_text(number), 40, 4))
    # More names than this would cover each other.
    if len(ends) <= len(LINES):
        label_ends(axes, ends)
