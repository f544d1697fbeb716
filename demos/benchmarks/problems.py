"""What is compared: the problems of `problems.toml`, which explains its entries."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

Words = dict[str, object]  # words of a script; see contestants.run
Cases = dict[str, dict[str, Words]]  # by size, then by contestant
Figures = dict[str, Any]  # numbers, or lists of them at instants

# An error below this is round-off; it is drawn here, because a logarithmic axis has no zero.
SMALLEST_ERROR = 1e-16


@dataclass(frozen=True)
class Problem:
    """A problem of which the run times of several programs are compared.

    Attributes:
        title, unit, cases, quick, peers, equal, limits, expected_warnings, chart, script, seconds:
            as the file has them.
        answers: by case, or for "all", [answer, largest relative error] by figure, of this program.
        cost: names of the figures of which the ratio to the peers is: the first one, divided by the
            others.
        scale: factor of the cost.
    """

    title: str
    cost: Sequence[str]
    unit: str
    cases: Cases
    quick: Cases
    scale: float = 1.0
    seconds: float = 1800.0
    peers: Sequence[str] = ()
    equal: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    answers: Mapping[str, Mapping[str, Sequence[float]]] = field(default_factory=dict)
    expected_warnings: Mapping[str, str] = field(default_factory=dict)
    chart: bool = False
    script: str = ""

    def cost_of(self, figures: Figures) -> float:
        """The cost of a contestant, in `unit`."""
        first, *others = self.cost
        return self.scale * figures[first] / math.prod(figures[name] for name in others)


@dataclass(frozen=True)
class ErrorProblem:
    """A problem with a known answer that several programs solve, each on several meshes or with
    several steps; attributes are as the file has them."""

    title: str
    script: str
    measure: str
    error: Mapping[str, Any]
    curves: dict[str, Sequence[Words]]
    quick: dict[str, Sequence[Words]]
    reference: str
    accepted: float
    quick_accepted: float
    answer: Words | None = None
    quick_answer: Words | None = None
    expected_warnings: Mapping[str, str] = field(default_factory=dict)
    seconds: float = 1800.0

    def error_of(self, figures: Figures, answer: Figures) -> float:
        """The error of the figures of a contestant.

        Args:
            figures: of the contestant.
            answer: figures of the answer; empty if it is not computed.
        """
        name = str(self.error["figure"])
        if isinstance(figures[name], list):
            # Values at several instants: the root of the mean square over time.
            apart = np.subtract(figures[name], answer[name])
            return max(float(np.sqrt(np.mean(apart**2))), SMALLEST_ERROR)
        error = figures[name] * self.error.get("scale", 1.0)
        if "exact" in self.error:
            error = error / self.error["exact"] - 1
        elif answer:
            error -= answer[name] * self.error.get("scale", 1.0)
            if self.error.get("relative"):
                error /= answer[name] * self.error.get("scale", 1.0)
        return max(abs(error), SMALLEST_ERROR)


with Path(__file__).with_suffix(".toml").open("rb") as _file:
    _ENTRIES = tomllib.load(_file)
PROBLEMS = {name: Problem(**entry) for name, entry in _ENTRIES.items() if "cases" in entry}
ERROR_PROBLEMS = {
    name: ErrorProblem(**entry) for name, entry in _ENTRIES.items() if "curves" in entry
}
