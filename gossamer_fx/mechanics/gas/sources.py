"""What feeds gas into volumes: blowers and pumps, pressure regulators, inflators, and powders or
liquids that evaporate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated, Any, ClassVar

from gossamer_fx.core.checks.arguments import Mark, Range, check_arguments, not_negative, positive
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.mechanics.gas.contract import (
    USUAL_MASS_FLOW,
    USUAL_PRESSURE,
    USUAL_TEMPERATURE,
    Aperture,
    Discharge,
    Gas,
    Gases,
    Holder,
    Opening,
    Pair,
    Volume,
)
from gossamer_fx.mechanics.gas.network import GasNetwork
from gossamer_fx.mechanics.gas.openings import Connection, Orifice
from gossamer_fx.mechanics.gas.surface import Geometry
from gossamer_fx.mechanics.gas.tables import LinearTable
from gossamer_fx.mechanics.gas.volumes import Ambient


@check_arguments
@dataclass(frozen=True, eq=False)
class Blower(Connection):
    """A blower that moves gas from a to b by a curve of the volume flow against the rise of the
    pressure.  The gas arrives with the temperature of a: the work of the blower, volume flow times
    rise of the pressure, is left out of the energy of the gas.

    Args:
        a, b: chambers, tanks or surroundings; the flow is from a to b.
        curve: volume flow [m³/s] at the density of a, ≥ 0, over the pressure of b less that of a
            [Pa]: a `LinearTable`.
        name: in messages.

    Raises:
        InputError: a volume flow of the curve is negative, or both ends are the same.

    Example:
        >>> outside = gx.gas.Ambient(1e5, 300.0)
        >>> curve = gx.gas.LinearTable((0.0, 0.02), (800.0, 0.012), (1500.0, 0.0))
        >>> fan = gx.gas.Blower(outside, tank, curve=curve)
    """

    _: KW_ONLY
    curve: LinearTable
    name: str = "blower"
    is_driven: ClassVar = True

    def __post_init__(self) -> None:
        least = min(flow for _, flow in self.curve.points)
        not_negative("m³/s").check(f"Blower '{self.name}': a volume flow of its curve", least)

    def flow(self, gases: Gases, area: float, p: Pair, T: Pair) -> complex:
        """Mass flow [kg/s] from a to b; `area` is one."""
        density = p[0] / (gases[0].R * T[0])
        return area * density * self.curve(p[1] - p[0])


@check_arguments
@dataclass(frozen=True, eq=False)
class Regulator(Orifice):
    """An orifice from a to b that closes as the pressure of b approaches a set value: its area is
    multiplied by (pressure - p_b)/droop, between 0 and 1.  No gas flows from b to a.

    Args:
        a, b, area, discharge_coefficient, laminar: as of an `Orifice`.
        pressure: at b [Pa] at which it is closed, > 0.
        droop: fall of the pressure of b below it [Pa] at which it is fully open, > 0.
        name: in messages.

    Raises:
        InputError: a quantity is out of its range.

    Example:
        >>> bottle = gx.gas.Ambient(2e7, 300.0, name="bottle")
        >>> supply = gx.gas.Regulator(bottle, tank, area=1e-6, pressure=1.2e5, droop=2e3)
    """

    _: KW_ONLY
    pressure: Annotated[float, positive("Pa")]
    droop: Annotated[float, positive("Pa")]
    name: str = "regulator"
    parameters: ClassVar = {"pressure": "Pa", "droop": "Pa"}

    def flow(self, gases: Gases, area: float, p: Pair, T: Pair) -> complex:
        """Mass flow [kg/s] from a to b."""
        share = (self.pressure - p[1]) / self.droop
        if share.real <= 0 or p[0].real <= p[1].real:
            return 0.0
        full = super().flow(gases, area, p, T)
        return full if share.real >= 1 else share * full


@dataclass(eq=False)
class _Jet(Holder):
    """The end of an inflator from which its gas comes, with its temperature [K] in the present
    step; the flow does not depend on its pressure [Pa]."""

    name: str
    gas: Gas
    temperature: float = 300.0
    pressure: float = 0.0


@check_arguments
@dataclass(frozen=True, eq=False)
class Inflator(Opening):
    """A source of gas whose mass flow does not depend on the pressure of its chamber.

    A mixture that changes in time is given as an inflator for each of its gases.

    Args:
        b: the chamber or tank that receives the gas.
        gas: the gas or mixture.
        mass_flow: [kg/s], a function of time [s], or a table: see `LinearTable`.
        temperature: of the gas [K], a number > 0, a function of time or a table.
        name: in messages.

    Raises:
        InputError: a quantity is out of its range, also when a function gives it.

    Example:
        >>> from gossamer_fx.presets.gases import HOT_NITROGEN
        >>> flow = gx.gas.LinearTable((0.0, 0.0), (5e-3, 1.2), (0.05, 0.0))
        >>> inflator = gx.gas.Inflator(
        ...     tank, gas=HOT_NITROGEN, mass_flow=flow, temperature=600.0
        ... )
    """

    b: Volume
    _: KW_ONLY
    gas: Gas
    mass_flow: Annotated[float, not_negative("kg/s")] | Callable[[float], float]
    temperature: Annotated[float, positive("K")] | Callable[[float], float]
    name: str = "inflator"
    # The end from which the gas comes.
    a: _Jet = field(init=False, repr=False)
    is_driven: ClassVar = True
    scalar_unknowns = GasNetwork
    USUAL: ClassVar = {"temperature": USUAL_TEMPERATURE, "mass_flow": USUAL_MASS_FLOW}

    def __post_init__(self) -> None:
        object.__setattr__(self, "a", _Jet(self.name, self.gas))

    @property
    def carried_gas(self) -> Gas:
        """The given gas."""
        return self.gas

    def requires(self) -> Iterable[Any]:
        yield self.b

    def aperture(self, geometry: Geometry) -> Aperture:
        """Return the mass flow [kg/s], in place of an area, as a function of step length h [s] and
        time t [s] of the middle of the step; it sets the temperature of the step.  Collective."""

        def mass_flow(h: float, t: float) -> float:
            temperature = self._at(geometry, "temperature", self.temperature, t)
            when = f"at t = {t:.6g} s"
            positive("K").check(f"Inflator '{self.name}': its temperature {when}", temperature)
            self.a.temperature = temperature
            flow = self._at(geometry, "mass flow", self.mass_flow, t)
            not_negative("kg/s").check(f"Inflator '{self.name}': its mass flow {when}", flow)
            return flow

        return mass_flow

    def _at(
        self, geometry: Geometry, quantity: str, given: float | Callable[[float], float], t: float
    ) -> float:
        """A quantity at a time t [s].  Collective."""
        if not callable(given):
            return float(given)
        what = f"Inflator '{self.name}': its {quantity} at t = {t:.6g} s"
        return float(ask_numbers(geometry.comm, what, lambda: given(t)))

    def flow(self, gases: Gases, area: float, p: Pair, T: Pair) -> complex:
        """The mass flow [kg/s] of `aperture`."""
        return area


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


PURE = Mark(lambda gas: len(gas.species) == 1, "a gas that is not a mixture")


@check_arguments
@dataclass(frozen=True, eq=False)
class Sublimation(Discharge):
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
    gas: Annotated[Gas, PURE]
    pressure: Annotated[float, positive("Pa")]
    temperature: Annotated[float, positive("K")]
    area: Annotated[float, positive("m²")]
    accommodation: Annotated[float, Range(0.0, 1.0, above=True)] = 1.0
    name: str = "powder"
    # The saturated vapour at the powder, the end from which gas comes.
    a: Ambient = field(init=False, repr=False)
    scalar_unknowns = GasNetwork
    coefficient: ClassVar = "accommodation"
    USUAL: ClassVar = {"temperature": USUAL_TEMPERATURE, "pressure": USUAL_PRESSURE}

    def __post_init__(self) -> None:
        saturated = Ambient(self.pressure, self.temperature, gas=self.gas, name=self.name)
        object.__setattr__(self, "a", saturated)

    @property
    def carried_gas(self) -> Gas:
        """The vapour."""
        return self.gas

    def requires(self) -> Iterable[Any]:
        yield self.b

    def aperture(self, geometry: Geometry) -> Aperture:
        """Return α A [m²]."""
        return lambda h, t: self.accommodation * self.area

    def flow(self, gases: Gases, area: float, p: Pair, T: Pair) -> complex:
        """Mass flow [kg/s] of vapour into the chamber."""
        vapour, mixture = gases
        partial: complex = 0.0
        for one, fraction in zip(mixture.species, mixture.fractions, strict=True):
            if one == self.gas:
                partial = p[1] * fraction * vapour.R / mixture.R
        return area * (p[0] - partial) / (2 * math.pi * vapour.R * T[0]) ** 0.5
