"""Ideal gases, p V = m R T: with constant specific heats, or with heats that are NASA polynomials
of the temperature.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Annotated, ClassVar

import numpy as np

from gossamer_fx.core.checks.arguments import RISING, Count, Range, check_arguments, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.laws.tracing import Number
from gossamer_fx.mechanics.gas.contract import Gas


@check_arguments
@dataclass(frozen=True)
class IdealGas(Gas):
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
    USUAL: ClassVar = {
        "gamma": (1.01, 1.7, "", "is it in per cent?"),
        "R": (10.0, 5e3, "J/(kg K)", "is it in kJ/(kg K), or of a mole?"),
    }

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


# Powers of the temperature in c_p/R: those of the seven coefficients of NASA/TP-2002-211556.
LOWEST_POWER = -2
COEFFICIENTS = 7


@check_arguments
@dataclass(frozen=True)
class PolynomialGas(Gas):
    """A gas with p V = m R T and a specific heat that is a NASA polynomial in each range of T:

        c_p/R = a_1 T^-2 + a_2 T^-1 + a_3 + a_4 T + a_5 T² + a_6 T³ + a_7 T⁴                   (1)

    (McBride, Zehe and Gordon, NASA/TP-2002-211556, equation 1.)  The five coefficients of the older
    form of seven, a_1 + a_2 T + ..., are a_3 to a_7.  The enthalpy is the integral of (1) from
    298.15 K on, where it is `enthalpy_298`, without heats of formation.  Outside of the ranges c_p
    is constant.

    Args:
        R: specific gas constant [J/(kg K)], > 0.
        temperatures: ends [K] of the ranges, rising; one more than there are ranges.
        coefficients: a_1 to a_7 of each range.
        enthalpy_298: H(298.15 K) - H(0) [J/kg], > 0; the table of the source has it per mole.
        name: of the species; gases of one scene that differ need different names.

    Raises:
        InputError: temperatures do not rise or do not belong to the ranges, a range has another
            number of coefficients, or c_v is not positive at the end of one.

    Example:
        >>> constant = gx.gas.PolynomialGas(
        ...     287.0, (200.0, 6000.0), ((0.0, 0.0, 3.5, 0.0, 0.0, 0.0, 0.0),), 299489.0
        ... )
        >>> round(constant.heat_ratio(300.0), 12)
        1.4
    """

    R: Annotated[float, positive("J/(kg K)")]
    temperatures: Annotated[tuple[Annotated[float, positive("K")], ...], RISING]
    coefficients: tuple[Annotated[tuple[float, ...], Count(COEFFICIENTS)], ...]
    enthalpy_298: Annotated[float, positive("J/kg")]
    name: str = "gas"
    USUAL: ClassVar = {"R": (10.0, 5e3, "J/(kg K)", "is it in kJ/(kg K), or of a mole?")}

    def __post_init__(self) -> None:
        limits = self.temperatures
        check(
            len(limits) == len(self.coefficients) + 1 > 1,
            f"Gas '{self.name}': {len(limits)} temperatures with {len(self.coefficients)} ranges; "
            "give the ends of all ranges, one more than there are ranges.",
        )
        for T in limits:
            check(
                self.heat_capacity(T) > 0,
                f"Gas '{self.name}': c_v is {self.heat_capacity(T):.4g} J/(kg K) at {T:.6g} K; "
                "check the coefficients.",
            )

    @property
    def constant_heat_ratio(self) -> None:
        """γ changes with the temperature."""
        return

    def heat_ratio(self, T: Number) -> Number:
        """γ = 1 + R/c_v."""
        return 1 + self.R / self.heat_capacity(T)

    def heat_capacity(self, T: Number) -> Number:
        """c_v = c_p - R [J/(kg K)]."""
        return self.R * (_polynomial(self._range(T), self._inside(T)) - 1)

    def energy(self, T: Number) -> Number:
        """u = h - R T [J/kg]."""
        return self.enthalpy(T) - self.R * T

    def enthalpy(self, T: Number) -> Number:
        """h [J/kg], the integral of c_p from 298.15 K, where it is `enthalpy_298`; outside of the
        ranges linear in T."""
        inside = self._inside(T)
        excess = (T - inside) * _polynomial(self._range(T), inside)
        return self.enthalpy_298 + self.R * (self._integral(inside) + excess)

    def _inside(self, T: Number) -> Number:
        """The temperature, or the nearest end of the ranges if it is outside of them."""
        if T.real < self.temperatures[0]:
            return self.temperatures[0]
        if T.real > self.temperatures[-1]:
            return self.temperatures[-1]
        return T

    def _range(self, T: Number) -> tuple[float, ...]:
        """The coefficients a_1 to a_7 at a temperature [K]."""
        number = sum(T.real >= limit for limit in self.temperatures[1:-1])
        return self.coefficients[number]

    def _integral(self, T: Number) -> Number:
        """∫ c_p/R dT from 298.15 K to a temperature inside the ranges, [K]."""
        reference = self._inside(298.15)
        result: Number = 0.0
        for (low, high), a in zip(pairwise(self.temperatures), self.coefficients, strict=True):
            # The part of the way that lies in this range; its sign is that of the way.
            first = min(max(reference, low), high)
            last = T
            if T.real < low:
                last = low
            elif T.real > high:
                last = high
            result = result + _primitive(a, last) - _primitive(a, first)
        return result


def _polynomial(a: tuple[float, ...], T: Number) -> Number:
    """c_p/R by (1) of `PolynomialGas` with coefficients a_1 to a_7, at a temperature [K]."""
    result: Number = 0.0
    for coefficient in reversed(a):
        result = result * T + coefficient
    return result * T**LOWEST_POWER


def _primitive(a: tuple[float, ...], T: Number) -> Number:
    """∫ c_p/R dT [K] of `_polynomial`, to which any constant may be added, at a temperature [K]."""
    result: Number = a[1] * np.log(T)
    for position, coefficient in enumerate(a):
        power = position + LOWEST_POWER + 1
        if power:
            result = result + coefficient / power * T**power
    return result
