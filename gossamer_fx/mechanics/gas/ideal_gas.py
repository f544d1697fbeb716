"""The calorically perfect ideal gas: p V = m R T with constant specific heats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from gossamer_fx.core.checks.arguments import Range, check_arguments, positive


@check_arguments
@dataclass(frozen=True)
class IdealGas:
    """A calorically perfect ideal gas: p V = m R T and U = m c_v T = p V/(γ - 1).

    Args:
        gamma: ratio of specific heats γ = c_p/c_v, > 1; 1.4 for air.
        R: specific gas constant [J/(kg K)], > 0; 287 for air.

    Raises:
        InputError: gamma ≤ 1 or R ≤ 0.

    Example:
        >>> air = gx.IdealGas(gamma=1.4, R=287.0)
        >>> round(air.cp, 1)
        1004.5
    """

    # γ = 1 would mean an infinite c_v: the internal energy U = p V/(γ - 1) has no value then.
    gamma: Annotated[float, Range(1.0, above=True)]
    R: Annotated[float, positive("J/(kg K)")]

    @property
    def cv(self) -> float:
        """Specific heat at constant volume, R/(γ - 1) [J/(kg K)]."""
        return self.R / (self.gamma - 1)

    @property
    def cp(self) -> float:
        """Specific heat at constant pressure, γ c_v [J/(kg K)]."""
        return self.gamma * self.cv
