"""Robust design: levels of what a designer chooses at which what nobody chooses matters least.

After G. Taguchi (S. Taguchi, Y. Wu, Robust Engineering, ASME Press 2000): control factors in an orthogonal array, every
row of it with all noise, a signal-to-noise ratio for every row, the mean of it at every level, and runs at the best
levels that confirm that the effects add up.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from itertools import product
from typing import Any

import numpy as np

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Array
from gossamer_fx.sweep.orthogonal_arrays import Levels, orthogonal_array
from gossamer_fx.sweep.runs import Outcome, Result

GOALS = ("smaller", "larger", "nominal")


def signal_to_noise(goal: str, y: Array) -> float:
    """[dB] of numbers that should be small, -10 lg mean y²; large, -10 lg mean y⁻²; or alike, 10 lg (mean y)²/var y."""
    if goal == "smaller":
        return -10 * math.log10(float((y**2).mean()))
    if goal == "larger":
        return -10 * math.log10(float((1 / y**2).mean()))
    return 10 * math.log10(float(y.mean() ** 2 / y.var(ddof=1)))


@check_arguments
@dataclass(frozen=True)
class RobustDesign:
    """What `./gossamer sweep FILE` runs, the name SWEEP in its file.

        SWEEP = gx.sweep.RobustDesign(
            outcome,  # outcome(comm, folder, **values) returns numbers by name
            control={"bore": [0.3e-3, 0.4e-3, 0.5e-3], ...},
            noise={"crease": [0.0, 0.02]},
            goals={"opening time": "smaller"},
        )

    Args:
        outcome: makes one run; `folder` is for its own files.
        control: levels of each control factor by name, two or three, as a column of the array has.
        goals: for numbers of the outcome by name "smaller" (the better), "larger", or "nominal" (the more alike); the
            best levels are those of the first one.
        noise: levels of each noise factor; all combinations are run.
        array: name of the orthogonal array, see `orthogonal_array`.
        usual: levels of the control factors before the design; by default the middle ones.

    Raises:
        InputError: factors that have no column, a goal that is none, a nominal goal without noise.
    """

    outcome: Outcome
    control: Mapping[str, Sequence[Any]]
    _: KW_ONLY
    goals: Mapping[str, str]
    noise: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    array: str = "L18"
    usual: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check(
            callable(self.outcome), f"RobustDesign: outcome is {self.outcome!r}; give a function."
        )
        for name, levels in [*self.control.items(), *self.noise.items()]:
            count = len(set(map(repr, levels)))
            plain = all(isinstance(level, str | int | float) for level in levels)
            check(
                plain and count == len(levels) >= 2,
                f"RobustDesign: {name} has {levels!r}; give different levels, numbers or words.",
            )
        both = sorted({*self.control} & {*self.noise})
        check(not both, f"RobustDesign: {', '.join(both)} is control and noise; give it once.")
        check(
            len(self.goals) > 0,
            "RobustDesign has no goal; name a number of the outcome, and what it should be.",
        )
        for name, goal in self.goals.items():
            check(
                goal in GOALS,
                f"RobustDesign: the goal of {name!r} is {goal!r}; give one of: {', '.join(GOALS)}.",
            )
            check(
                goal != "nominal" or bool(self.noise),
                f"RobustDesign: {name!r} cannot vary without noise; give some.",
            )
        for name, level in self.usual.items():
            check(
                name in self.control and level in self.control[name],
                f"RobustDesign: {name}={level!r} is no level of a control factor; give one of its levels.",
            )
        self._columns()

    def _columns(self) -> Levels:
        """Levels (runs, control factors): each factor has the first free column with as many levels."""
        table = orthogonal_array(self.array)
        free = list(range(table.shape[1]))
        chosen = []
        for name, levels in self.control.items():
            column = next((c for c in free if table[:, c].max() + 1 == len(levels)), None)
            check(
                column is not None,
                f"RobustDesign: {self.array} has no column of {len(levels)} levels left for {name}; give it another "
                "number of levels, or take a larger array.",
            )
            assert column is not None
            free.remove(column)
            chosen.append(column)
        return table[:, chosen]

    # ---- runs --------------------------------------------------------------------------------------------------------

    def _with_noise(self, control: Mapping[str, Any]) -> list[dict[str, Any]]:
        return [
            {**control, **dict(zip(self.noise, levels, strict=True))}
            for levels in product(*self.noise.values())
        ]

    def rows(self) -> list[dict[str, Any]]:
        """Values of the control factors in every row of the array."""
        names = list(self.control)
        return [
            {n: self.control[n][k] for n, k in zip(names, row, strict=True)}
            for row in self._columns()
        ]

    def cases(self) -> list[dict[str, Any]]:
        """Values of all runs of the array."""
        return [case for row in self.rows() for case in self._with_noise(row)]

    def confirmations(self, results: Sequence[Result]) -> list[dict[str, Any]]:
        """Values of the runs with the usual levels, and of those with the best ones, once the array is run."""
        goal = next(iter(self.goals))
        return [
            case
            for levels in (self.before(), self.best(results, goal))
            for case in self._with_noise(levels)
        ]

    # ---- what they say -----------------------------------------------------------------------------------------------

    def before(self) -> dict[str, Any]:
        """The usual levels."""
        middle = {name: levels[(len(levels) - 1) // 2] for name, levels in self.control.items()}
        return middle | dict(self.usual)

    def ratios(self, results: Sequence[Result], goal: str) -> Array:
        """S/N [dB] of every group of runs that differ by noise only; no number where one of them failed."""
        size = math.prod(map(len, self.noise.values()))
        found = []
        for k in range(0, len(results), size):
            y = [result.numbers.get(goal, math.nan) for result in results[k : k + size]]
            whole = all(math.isfinite(value) for value in y)
            found.append(signal_to_noise(self.goals[goal], np.array(y)) if whole else math.nan)
        return np.array(found)

    def effects(self, results: Sequence[Result], goal: str) -> dict[str, Array]:
        """Mean S/N [dB] at each level of each control factor."""
        ratios, columns = self.ratios(results, goal), self._columns()
        return {
            name: np.array([_mean(ratios[columns[:, j] == k]) for k in range(len(levels))])
            for j, (name, levels) in enumerate(self.control.items())
        }

    def shares(self, results: Sequence[Result], goal: str) -> dict[str, float]:
        """Share of each control factor in the variance of S/N; what is left is of interactions."""
        ratios, columns = self.ratios(results, goal), self._columns()
        mean, known = _mean(ratios), np.isfinite(ratios)
        whole = float(((ratios[known] - mean) ** 2).sum())
        shares = {}
        for j, (name, effect) in enumerate(self.effects(results, goal).items()):
            counts = np.bincount(columns[known, j], minlength=len(effect))
            shares[name] = float(np.nansum(counts * (effect - mean) ** 2)) / whole if whole else 0.0
        return shares

    def best(self, results: Sequence[Result], goal: str) -> dict[str, Any]:
        """The level of each control factor with the largest mean S/N."""
        effects = self.effects(results, goal)
        check(
            all(np.isfinite(effect).any() for effect in effects.values()),
            f"RobustDesign: no run has a finite {goal!r}; see why the runs failed in their results.",
        )
        return {
            name: self.control[name][int(np.nanargmax(effect))] for name, effect in effects.items()
        }

    def predicted(self, results: Sequence[Result], goal: str, levels: Mapping[str, Any]) -> float:
        """S/N [dB] at some levels, if the effects of the factors add up."""
        mean = _mean(self.ratios(results, goal))
        effects = self.effects(results, goal)
        return mean + sum(
            float(effect[list(self.control[name]).index(levels[name])]) - mean
            for name, effect in effects.items()
        )


def _mean(values: Array) -> float:
    """Of the finite ones."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan
