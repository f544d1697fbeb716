"""When an output is due."""

from __future__ import annotations

from dataclasses import dataclass

from gossamer_fx.errors import check


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

    def due(self, step: int, time: float, last: bool) -> bool:
        if step == 0 or last:
            return True
        if self.times:
            return any(abs(time - t) <= 1e-12 * max(abs(t), 1.0) for t in self.times)
        return step % self.every == 0
