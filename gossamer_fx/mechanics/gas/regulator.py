"""Pressure regulators."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Annotated

from gossamer_fx.core.checks.arguments import check_arguments, positive
from gossamer_fx.mechanics.gas.contract import Gases, Pair
from gossamer_fx.mechanics.gas.orifice import Orifice


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

    def flow(self, gases: Gases, area: float, p: Pair, T: Pair) -> complex:
        """Mass flow [kg/s] from a to b."""
        share = (self.pressure - p[1]) / self.droop
        if share.real <= 0 or p[0].real <= p[1].real:
            return 0.0
        full = super().flow(gases, area, p, T)
        return full if share.real >= 1 else share * full
