"""Steps and times at which an output is due."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real

from gossamer_fx.core.checks.errors import check

# A time is met if it differs by less than this from the one asked for, relatively above 1 s [s].
TIME_TOLERANCE = 1e-12


@dataclass(frozen=True)
class Schedule:
    """Every n-th step, or given times; the first and the last state are always due.

    Args:
        times: of records, instead [s].
    """

    every: int = 1
    times: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Check the number of steps between two records, and the times of records."""
        check(
            isinstance(self.every, int) and self.every >= 1,
            f"every is {self.every!r}; give the number of steps between two outputs.",
        )
        for t in self.times:
            check(
                isinstance(t, Real) and math.isfinite(t) and t >= 0,
                f"times holds {t!r}; give the times of outputs in seconds, from 0 on.",
            )

    def due(self, step: int, time: float, last: bool) -> bool:
        """Whether a record is due after a step.

        Args:
            time: [s].
        """
        if step == 0 or last:
            return True
        if self.times:
            return self.meets(time)
        return step % self.every == 0

    def meets(self, time: float) -> bool:
        """Whether a time [s] is one of the given ones."""
        return any(abs(time - t) <= TIME_TOLERANCE * max(abs(t), 1.0) for t in self.times)
