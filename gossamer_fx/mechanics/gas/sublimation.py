"""Powders and liquids that inflate by their vapour, and vapour pressures."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Annotated, Any

from gossamer_fx.core.checks.arguments import Range, check_arguments, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.mechanics.gas.contract import Aperture, Gas, Gases, Pair, Volume
from gossamer_fx.mechanics.gas.network import GasNetwork
from gossamer_fx.mechanics.gas.surface import Geometry
from gossamer_fx.mechanics.gas.volumes import Ambient


@check_arguments
@dataclass(frozen=True)
class Antoine:
    """A vapour pressure by the equation of Antoine, log10(p/Pa) = A - B/(T + C), T in kelvin; with
    C = 0 it is that of Clausius and Clapeyron.

    Args:
        A, B, C: coefficients, for pascal and kelvin.

    Example:
        >>> water = gx.gas.Antoine.of_latent_heat(2.5e6, 461.5, pressure=611.0, temperature=273.16)
        >>> round(water(283.16))
        1231
    """

    A: float
    B: float
    C: float = 0.0

    @classmethod
    def of_latent_heat(
        cls, latent_heat: float, R: float, *, pressure: float, temperature: float
    ) -> Antoine:
        """The vapour pressure of Clausius and Clapeyron, p = p_0 exp(-L/R (1/T - 1/T_0)), of a
        latent heat L [J/kg], the gas constant R [J/(kg K)] and one point [Pa, K]."""
        B = latent_heat / (R * math.log(10))
        return cls(math.log10(pressure) + B / temperature, B)

    def __call__(self, temperature: float) -> float:
        """Vapour pressure [Pa] at a temperature [K]."""
        return float(10 ** (self.A - self.B / (temperature + self.C)))


@check_arguments
@dataclass(frozen=True, eq=False)
class Sublimation:
    """A powder or liquid of given temperature that evaporates into a chamber, or condenses from it,
    by the law of Hertz and Knudsen:

        ṁ = α A (p_vapour - p_partial)/√(2π R T)

    with the partial pressure of the vapour in the chamber (Kolasinski, Surface Science, 3rd ed.
    2012, ch. 3.8).  The powder does not come to an end, and its heat comes from outside: vapour
    enters with the temperature of the powder.

    Args:
        b: the chamber or tank.
        gas: the vapour, one species.
        pressure: vapour pressure at the temperature of the powder [Pa], > 0; see `Antoine`.
        temperature: of the powder [K], > 0.
        area: of its surface A [m²], > 0.
        accommodation: coefficient α of evaporation and condensation, in (0, 1].
        name: in messages.

    Raises:
        InputError: a quantity is out of its range, or the vapour is a mixture.

    Example:
        >>> vapour = gx.IdealGas(gamma=1.08, R=68.1, name="benzoic acid")
        >>> pressure = gx.gas.Antoine(A=14.4, B=4700.0)(330.0)
        >>> powder = gx.gas.Sublimation(
        ...     tank, gas=vapour, pressure=pressure, temperature=330.0, area=0.01
        ... )
    """

    b: Volume
    _: KW_ONLY
    gas: Gas
    pressure: Annotated[float, positive("Pa")]
    temperature: Annotated[float, positive("K")]
    area: Annotated[float, positive("m²")]
    accommodation: Annotated[float, Range(0.0, 1.0, above=True)] = 1.0
    name: str = "powder"
    scalar_unknowns = GasNetwork

    def __post_init__(self) -> None:
        check(
            len(self.gas.species) == 1,
            f"Sublimation '{self.name}': its vapour is a mixture; give one for each species.",
        )

    @cached_property
    def a(self) -> Ambient:
        """The saturated vapour."""
        return Ambient(self.pressure, self.temperature, gas=self.gas, name=self.name)

    def requires(self) -> Iterable[Any]:
        yield self.b

    def aperture(self, geometry: Geometry) -> Aperture:
        """Return α A [m²]."""
        return lambda h, t: self.accommodation * self.area

    def flow(self, gases: Gases, area: float, p: Pair, T: Pair) -> complex:
        """Mass flow [kg/s] of vapour into the chamber."""
        partial: complex = 0.0
        for one, fraction in zip(gases[1].species, gases[1].fractions, strict=True):
            if one == self.gas:
                partial = p[1] * fraction * one.R / gases[1].R
        return area * (p[0] - partial) / (2 * math.pi * self.gas.R * T[0]) ** 0.5
