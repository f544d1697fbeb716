"""The calorically perfect ideal gas."""

from __future__ import annotations

from dataclasses import dataclass

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check


@check_arguments
@dataclass(frozen=True)
class IdealGas:
    """p V = m R T with the ratio of specific heats `gamma` and the specific gas constant `R` [J/(kg K)]."""

    gamma: float
    R: float

    def __post_init__(self) -> None:
        check(
            self.gamma > 1,
            f"IdealGas: gamma is {self.gamma!r}; the ratio of specific heats exceeds 1.",
        )
        check(
            self.R > 0,
            f"IdealGas: R is {self.R!r}; give the specific gas constant in J/(kg K), e.g. 287 for air.",
        )

    @property
    def cv(self) -> float:
        """Specific heat at constant volume [J/(kg K)]."""
        return self.R / (self.gamma - 1)

    @property
    def cp(self) -> float:
        """Specific heat at constant pressure [J/(kg K)]."""
        return self.gamma * self.cv
