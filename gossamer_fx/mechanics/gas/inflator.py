"""Inflators: gas of a given mass flow and temperature, as from a gas generator."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Annotated, Any

from gossamer_fx.core.checks.arguments import check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.mechanics.gas.contract import Aperture, Gas, Gases, Pair, Volume
from gossamer_fx.mechanics.gas.network import GasNetwork
from gossamer_fx.mechanics.gas.surface import Geometry


@dataclass(eq=False)
class _Jet:
    """The gas of an inflator, with its temperature [K] of the present step."""

    name: str
    gas: Gas
    temperature: float = 300.0
    pressure: float = 0.0


@check_arguments
@dataclass(frozen=True, eq=False)
class Inflator:
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
    is_driven = True
    scalar_unknowns = GasNetwork

    @cached_property
    def a(self) -> _Jet:
        """The end from which the gas comes."""
        return _Jet(self.name, self.gas)

    def requires(self) -> Iterable[Any]:
        yield self.b

    def aperture(self, geometry: Geometry) -> Aperture:
        """Return the mass flow [kg/s], in place of an area, as a function of step length h [s] and
        time t [s] of the middle of the step; it sets the temperature of the step.  Collective."""

        def mass_flow(h: float, t: float) -> float:
            temperature = self._at(geometry, "temperature", self.temperature, t)
            check(
                temperature > 0,
                f"Inflator '{self.name}': its temperature at t = {t:.6g} s is {temperature!r} K; "
                "give a positive one.",
            )
            self.a.temperature = temperature
            flow = self._at(geometry, "mass flow", self.mass_flow, t)
            check(
                flow >= 0,
                f"Inflator '{self.name}': its mass flow at t = {t:.6g} s is {flow!r} kg/s; "
                "give one that is not negative.",
            )
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
