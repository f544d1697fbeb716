"""What openings between two volumes have in common."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

from gossamer_fx.core.checks.errors import check
from gossamer_fx.mechanics.gas.contract import Gas, Gases, Holder, Pair, Volume
from gossamer_fx.mechanics.gas.network import GasNetwork


@dataclass(frozen=True, eq=False)
class Connection:
    """An opening between two different ends a and b; its area may be that of a part of a film."""

    a: Volume | Holder
    b: Volume | Holder
    _: KW_ONLY
    name: str = "opening"
    scalar_unknowns = GasNetwork

    def __post_init__(self) -> None:
        check(
            self.a is not self.b,
            f"{type(self).__name__} '{self.name}' leads from '{self.a.name}' back into it.",
        )

    def requires(self) -> Iterable[Any]:
        yield self.a
        yield self.b
        # A ring or the area of a film joins the scene with its film.
        area: Any = getattr(self, "area", None)
        if hasattr(area, "requires"):
            yield from area.requires()


class PassiveOpening(Connection):
    """An opening through which gas flows to the lower pressure, by one law for both directions."""

    def flow(self, gases: Gases, area: float, p: Pair, T: Pair) -> complex:
        """Mass flow [kg/s] from a to b through an effective area [m²]."""
        if p[0].real >= p[1].real:
            return area * self.flux(gases[0], p[0], T[0], p[1])
        return -area * self.flux(gases[1], p[1], T[1], p[0])

    @abstractmethod
    def flux(self, gas: Gas, pu: complex, Tu: complex, pd: complex) -> complex:
        """Mass flow per effective area [kg/(s m²)] of the gas upstream, with the pressure pu [Pa]
        and temperature Tu [K], to the pressure pd."""
