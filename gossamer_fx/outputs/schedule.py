"""When an output is due."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real

from gossamer_fx.checks.errors import check


@dataclass(frozen=True)
class Schedule:
    """Every n-th step, or at given times [s]; the first and the last state are always due."""

    every: int = 1
    times: tuple[float, ...] = ()

    def __post_init__(self) -> None:
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
        if step == 0 or last:
            return True
        return self.meets(time) if self.times else step % self.every == 0

    def meets(self, time: float) -> bool:
        """Whether `time` is one of the given ones."""
        return any(abs(time - t) <= 1e-12 * max(abs(t), 1.0) for t in self.times)
