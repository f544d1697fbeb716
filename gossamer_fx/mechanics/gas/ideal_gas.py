"""The calorically perfect ideal gas: p V = m R T with constant specific heats."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

from gossamer_fx.core.algebra.dual_numbers import Number
from gossamer_fx.core.checks.arguments import Range, check_arguments, positive


@check_arguments
@dataclass(frozen=True)
class IdealGas:
    """A calorically perfect ideal gas: p V = m R T and U = m c_v T = p V/(γ - 1).

    Args:
        gamma: ratio of specific heats γ = c_p/c_v, > 1; 1.4 for air.
        R: specific gas constant [J/(kg K)], > 0; 287 for air.
        name: of the species; gases of one scene that differ need different names.

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
    name: str = "gas"
    # All of its mass is of one species.
    fractions = (1.0,)

    @property
    def species(self) -> tuple[IdealGas]:
        """The gas itself."""
        return (self,)

    # Asked for each flow: computed once
    @cached_property
    def cv(self) -> float:
        """Specific heat at constant volume, R/(γ - 1) [J/(kg K)]."""
        return self.R / (self.gamma - 1)

    @cached_property
    def cp(self) -> float:
        """Specific heat at constant pressure, γ c_v [J/(kg K)]."""
        return self.gamma * self.cv

    @property
    def constant_heat_ratio(self) -> float:
        """γ."""
        return self.gamma

    def heat_ratio(self, T: Number) -> Number:
        """γ, the same at all temperatures."""
        return self.gamma

    def heat_capacity(self, T: Number) -> Number:
        """c_v [J/(kg K)], the same at all temperatures."""
        return self.cv

    def energy(self, T: Number) -> Number:
        """c_v T [J/kg]."""
        return self.cv * T

    def enthalpy(self, T: Number) -> Number:
        """c_p T [J/kg]."""
        return self.cp * T
