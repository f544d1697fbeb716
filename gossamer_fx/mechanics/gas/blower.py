"""Blowers and pumps: flow against a pressure."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.mechanics.gas.connection import Connection
from gossamer_fx.mechanics.gas.contract import Aperture, Gases, Pair
from gossamer_fx.mechanics.gas.linear_table import LinearTable
from gossamer_fx.mechanics.gas.surface import Geometry


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
    is_driven = True

    def __post_init__(self) -> None:
        super().__post_init__()
        least = min(flow for _, flow in self.curve.points)
        check(
            least >= 0,
            f"Blower '{self.name}': a volume flow of its curve is {least!r} m³/s; "
            "give none that is negative.",
        )

    def aperture(self, geometry: Geometry) -> Aperture:
        """One blower, in place of an area."""
        return lambda h, t: 1.0

    def flow(self, gases: Gases, area: float, p: Pair, T: Pair) -> complex:
        """Mass flow [kg/s] from a to b; `area` is the number of blowers."""
        density = p[0] / (gases[0].R * T[0])
        return area * density * self.curve(p[1] - p[0])
