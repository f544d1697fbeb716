"""Robust design: choose the levels of control factors at which noise factors matter least.

Problem.  A designer chooses some factors (an opening, a thickness); others vary by themselves
(creases, temperature).  All combinations of levels are too many runs.

Algorithm, after G. Taguchi (S. Taguchi, Y. Wu, Robust Engineering, ASME Press 2000).

1. The rows of an orthogonal array are combinations of levels of the control factors.
2. Each row is run with all combinations of the noise factors, which gives numbers y.
3. A row has the signal-to-noise ratio [dB]

       -10 lg mean(y²)           for numbers that should be small
       -10 lg mean(y⁻²)          for numbers that should be large
       10 lg (mean(y)²/var(y))   for numbers that should not vary                             (1)

4. The effect of a level is the mean ratio of all rows with that level.  The best level of each
   factor is the one with the largest effect.
5. Runs at the best levels confirm that effects add up: their ratio is compared with

       mean + Σ (effect of the level - mean)                                                  (2)

Limits.  Effects are the means of few runs; interactions of factors appear as the difference between
(2) and the ratio that is found.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from itertools import product
from typing import Any

import numpy as np

from gossamer_fx.analysis.cases.results import Outcome, Result
from gossamer_fx.app.sweep.orthogonal_arrays import Levels, orthogonal_array
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array

GOALS = ("smaller", "larger", "nominal")


def signal_to_noise(goal: str, y: Array, what: str = "the numbers") -> float:
    """Signal-to-noise ratio [dB] of Taguchi, larger for a better design.

    It is -10 lg mean(y²) for "smaller", -10 lg mean(y⁻²) for "larger", and 10 lg (mean(y)²/var(y))
    for "nominal".

    Args:
        goal: what the numbers should be: "smaller", "larger", or "nominal", which should not vary.
        y: numbers of the runs that differ by noise only, (n,); n >= 2 for "nominal".
        what: name of the numbers in messages.

    Returns:
        the ratio; infinite for "nominal" numbers that are all equal.

    Raises:
        InputError: the ratio has no value: all numbers are zero for "smaller", one is zero for
            "larger", or their mean is zero for "nominal".
    """
    if goal == "smaller":
        check(
            bool(y.any()),
            f"RobustDesign: {what} with the goal 'smaller' are zero in all runs of a row, so that "
            "the signal-to-noise ratio is infinite; give a number that is zero in no run.",
        )
        return -10 * math.log10(float((y**2).mean()))
    if goal == "larger":
        check(
            bool(y.all()),
            f"RobustDesign: {what} with the goal 'larger' are zero in a run, so that the "
            "signal-to-noise ratio is infinite; give a number that is zero in no run.",
        )
        return -10 * math.log10(float((1 / y**2).mean()))
    mean = float(y.mean())
    check(
        mean != 0,
        f"RobustDesign: {what} with the goal 'nominal' have the mean zero in the runs of a row, so "
        "that their spread cannot be compared with it; give a number whose mean is not zero.",
    )
    variance = float(y.var(ddof=1))
    if variance == 0:
        return math.inf
    return 10 * math.log10(mean**2 / variance)


@check_arguments
@dataclass(frozen=True)
class RobustDesign:
    """A robust design that `./gossamer sweep FILE` runs; in the file it has the name SWEEP.

    Args:
        outcome: outcome(comm, folder, **values) makes one run and returns numbers by name; `folder`
            is for the files of the run.
        control: levels of each control factor by name; as many as a column of the array has.
        goals: what numbers of the outcome should be, by name: "smaller" (the better), "larger", or
            "nominal" (should not vary).  The best levels are those of the first goal.
        noise: levels of each noise factor by name; all combinations are run.
        array: name of the orthogonal array, see `orthogonal_array`.
        usual: levels of the control factors before the design; by default the middle ones.

    Raises:
        InputError: a factor has no column, a goal is unknown, or a nominal goal has no noise.

    Example:
        >>> def outcome(comm, folder, bore, crease):
        ...     return {"opening time": 0.012 * crease / bore}
        >>> SWEEP = gx.sweep.RobustDesign(
        ...     outcome,
        ...     {"bore": [0.3, 0.4, 0.5]},
        ...     noise={"crease": [0.5, 1.0]},
        ...     goals={"opening time": "smaller"},
        ...     array="L9",
        ... )
        >>> len(SWEEP.cases())
        18
    """

    outcome: Outcome
    control: Mapping[str, Sequence[Any]]
    _: KW_ONLY
    goals: Mapping[str, str]
    noise: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    array: str = "L18"
    usual: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the factors, their levels and the goals of the design.

        Raises:
            InputError: `outcome` is not a function, levels are equal or cannot be written, a factor
                has no column in the array, a goal is unknown or needs noise, or a usual level does
                not exist.
        """
        check(
            callable(self.outcome), f"RobustDesign: outcome is {self.outcome!r}; give a function."
        )
        self._check_factors()
        self._check_goals()
        for name, level in self.usual.items():
            check(
                name in self.control and level in self.control[name],
                f"RobustDesign: {name}={level!r} is not a level of a control factor; give one of "
                "its levels.",
            )
        # Refuses factors without a column now, before any run is made.
        self._columns()

    def _check_factors(self) -> None:
        """Refuse factors whose levels cannot be distinguished or written, and names that occur
        twice.

        Raises:
            InputError: a factor has fewer than two different levels, levels that are neither
                numbers nor words, or is both control and noise.
        """
        for name, levels in [*self.control.items(), *self.noise.items()]:
            # Other values could not be written to the files of results, and found in them again.
            is_plain = all(isinstance(level, str | int | float) for level in levels)
            count = len({repr(level) for level in levels})
            check(
                is_plain and count == len(levels) >= 2,
                f"RobustDesign: {name} has {levels!r}; give different levels, numbers or words.",
            )
        both = sorted({*self.control} & {*self.noise})
        check(not both, f"RobustDesign: {', '.join(both)} is control and noise; give it once.")

    def _check_goals(self) -> None:
        """Refuse goals that are unknown or cannot be computed.

        Raises:
            InputError: there is no goal, one is not in `GOALS`, or "nominal" is asked for without
                noise factors.
        """
        check(
            len(self.goals) > 0,
            "RobustDesign has no goal; name a number of the outcome, and what it should be.",
        )
        for name, goal in self.goals.items():
            check(
                goal in GOALS,
                f"RobustDesign: the goal of {name!r} is {goal!r}; give one of: {', '.join(GOALS)}.",
            )
            # A single run has no variance.
            check(
                goal != "nominal" or bool(self.noise),
                f"RobustDesign: {name!r} cannot vary without noise; give some.",
            )

    def _columns(self) -> Levels:
        """The array of level numbers (runs, control factors), from 0.

        Each factor has the first free column with as many levels.

        Raises:
            InputError: the array is unknown, or no column is left for a factor.
        """
        table = orthogonal_array(self.array)
        levels_of_column = table.max(axis=0) + 1
        free = list(range(table.shape[1]))
        chosen: list[int] = []
        for name, levels in self.control.items():
            fitting = [column for column in free if levels_of_column[column] == len(levels)]
            check(
                bool(fitting),
                f"RobustDesign: {self.array} has no column of {len(levels)} levels left for "
                f"{name}; give it another number of levels, or take a larger array.",
            )
            free.remove(fitting[0])
            chosen.append(fitting[0])
        return table[:, chosen]

    # ---- runs ------------------------------------------------------------------------------------

    def rows(self) -> list[dict[str, Any]]:
        """Values of the control factors in each row of the array, by name."""
        rows = []
        for indices in self._columns():
            values = {}
            for (name, levels), k in zip(self.control.items(), indices, strict=True):
                values[name] = levels[k]
            rows.append(values)
        return rows

    def cases(self) -> list[dict[str, Any]]:
        """Values of all factors in all runs of the array; the runs of a row follow each other."""
        return [case for row in self.rows() for case in self._with_noise(row)]

    def confirmations(self, results: Sequence[Result]) -> list[dict[str, Any]]:
        """Values of all factors in the runs that confirm the design: usual levels, then best
        levels.

        Args:
            results: of `cases()`, in order.

        Returns:
            values by name for each run, with all combinations of the noise factors.

        Raises:
            InputError: all runs of a factor failed.
        """
        first_goal = next(iter(self.goals))
        best = self.best(results, first_goal)
        return self._with_noise(self.before()) + self._with_noise(best)

    def _with_noise(self, control: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Given values of the control factors with all combinations of the noise factors."""
        combinations = product(*self.noise.values())
        return [
            {**control, **dict(zip(self.noise, levels, strict=True))} for levels in combinations
        ]

    # ---- results ---------------------------------------------------------------------------------

    def before(self) -> dict[str, Any]:
        """The usual levels of the control factors, by name."""
        # Of an even number of levels, the lower one of the two in the middle.
        middle = {name: levels[(len(levels) - 1) // 2] for name, levels in self.control.items()}
        return middle | dict(self.usual)

    def ratios(self, results: Sequence[Result], goal: str) -> Array:
        """Signal-to-noise ratios [dB] of the groups of runs that differ by noise only, (groups,).

        A group with a run that failed, or did not return the number, has NaN.

        Args:
            results: of all runs, those of a group one after another.
            goal: name of a number of the outcome.

        Raises:
            InputError: all numbers of a group are zero (goal "smaller"), one of them is (goal
                "larger"), or their mean is (goal "nominal").
        """
        # Without noise factors this is one.
        size = math.prod(len(levels) for levels in self.noise.values())
        ratios = []
        for start in range(0, len(results), size):
            group = results[start : start + size]
            # Values of the number in the runs of the group, in its unit.
            y = np.array([result.numbers.get(goal, math.nan) for result in group])
            # A row with a failed run is left out of the effects, instead of counting fewer runs.
            ratio = math.nan
            if np.isfinite(y).all():
                ratio = signal_to_noise(self.goals[goal], y, f"the values of '{goal}'")
            ratios.append(ratio)
        return np.array(ratios)

    def effects(self, results: Sequence[Result], goal: str) -> dict[str, Array]:
        """Effect [dB] of each level of each control factor: the mean ratio of the rows with that
        level.

        A run that failed makes the whole row of its noise combinations NaN; such rows are left out
        of the means.

        Args:
            results: of `cases()`, in order.
            goal: name of a number of the outcome.

        Returns:
            an array (levels,) by factor; NaN for a level of which all rows failed.
        """
        ratios = self.ratios(results, goal)
        columns = self._columns()
        effects = {}
        for j, (name, levels) in enumerate(self.control.items()):
            means = [_finite_mean(ratios[columns[:, j] == k]) for k in range(len(levels))]
            effects[name] = np.array(means)
        return effects

    def shares(self, results: Sequence[Result], goal: str) -> dict[str, float]:
        """Share of each control factor in the variance of the ratio; the remainder is interactions.

        Args:
            results: of `cases()`, in order.
            goal: name of a number of the outcome.

        Returns:
            a dimensionless number by factor; zero if the ratio does not vary.  Where runs failed,
            the sum may exceed one.
        """
        ratios = self.ratios(results, goal)
        columns = self._columns()
        is_known = np.isfinite(ratios)
        mean = _finite_mean(ratios)
        total = float(((ratios[is_known] - mean) ** 2).sum())
        shares = {}
        for j, (name, effect) in enumerate(self.effects(results, goal).items()):
            # Levels of which all rows failed have no effect, and no rows to count.
            counts = np.bincount(columns[is_known, j], minlength=len(effect))
            of_factor = float(np.nansum(counts * (effect - mean) ** 2))
            shares[name] = 0.0
            # Without variance, as of an outcome that is constant, no factor has a share.
            if total:
                shares[name] = of_factor / total
        return shares

    def best(self, results: Sequence[Result], goal: str) -> dict[str, Any]:
        """The level of each control factor with the largest effect, by name.

        Args:
            results: of `cases()`, in order.
            goal: name of a number of the outcome.

        Raises:
            InputError: all runs of a factor failed.
        """
        effects = self.effects(results, goal)
        check(
            all(np.isfinite(effect).any() for effect in effects.values()),
            f"RobustDesign: no run has a finite {goal!r}; see why the runs failed in their "
            "results.",
        )
        best = {}
        for name, effect in effects.items():
            best[name] = self.control[name][int(np.nanargmax(effect))]
        return best

    def predicted(self, results: Sequence[Result], goal: str, levels: Mapping[str, Any]) -> float:
        """Ratio (2) [dB] at some levels of the control factors, if effects add up."""
        mean = _finite_mean(self.ratios(results, goal))
        differences = 0.0
        for name, effect in self.effects(results, goal).items():
            k = list(self.control[name]).index(levels[name])
            differences += float(effect[k]) - mean
        return mean + differences


def _finite_mean(values: Array) -> float:
    """Mean of the values that are finite; NaN if there are none."""
    known = values[np.isfinite(values)]
    if not known.size:
        return math.nan
    return float(known.mean())
