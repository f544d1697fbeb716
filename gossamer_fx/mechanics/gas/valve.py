"""Valves that open and close by pressures or events, and burst vents."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Annotated

from gossamer_fx.core.checks.arguments import check_arguments, not_negative
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.model.state import HasSystem
from gossamer_fx.mechanics.gas.balance import Passage
from gossamer_fx.mechanics.gas.contract import Gases, Pair
from gossamer_fx.mechanics.gas.network import GasNetwork
from gossamer_fx.mechanics.gas.orifice import Orifice


@check_arguments
@dataclass(frozen=True, eq=False)
class Valve(Orifice):
    """An orifice that opens and closes by the difference of the pressures of a and b, or by events.

    It is open or closed in a whole step, by the state at the start of the step.  A relief valve has
    `opens` above `closes`, its hysteresis; a check valve has `opens=0.0, closes=0.0, one_way=True`;
    a burst vent has `opens` alone, and stays open.  Without both it acts by events only.

    Args:
        a, b, area, discharge_coefficient, laminar: as of an `Orifice`.
        opens: pressure of a over that of b [Pa] from which on it opens; None: by events only.
        closes: the same below which it closes, at most `opens`; None: it stays open.
        one_way: whether no gas flows from b to a while it is open.
        starts_open: whether it is open at the start.
        name: in messages.

    Raises:
        InputError: a quantity is out of its range, or `closes` is above `opens`.

    Example:
        >>> outside = gx.gas.Ambient(1e5, 300.0)
        >>> relief = gx.gas.Valve(tank, outside, area=1e-5, opens=5e3, closes=3e3, one_way=True)
        >>> vent = gx.gas.Valve(tank, outside, area=1e-4, opens=2e4, name="vent")
        >>> late = gx.gas.Valve(tank, outside, area=1e-4, name="late")
        >>> opening = gx.At(0.5, late.open)
    """

    _: KW_ONLY
    opens: Annotated[float, not_negative("Pa")] | None = None
    closes: Annotated[float, not_negative("Pa")] | None = None
    one_way: bool = False
    starts_open: bool = False
    name: str = "valve"

    def __post_init__(self) -> None:
        super().__post_init__()
        check(
            self.closes is None or self.opens is None or self.closes <= self.opens,
            f"Valve '{self.name}' closes at {self.closes!r} Pa, above {self.opens!r} Pa, at which "
            "it opens; give a lower pressure.",
        )

    def is_open(self, was_open: bool, p: tuple[float, float]) -> bool:
        """Whether it is open in a step that starts at the pressures p [Pa] of a and b."""
        excess = p[0] - p[1]
        if was_open:
            return self.closes is None or excess >= self.closes
        return self.opens is not None and excess >= self.opens

    def open(self, run: HasSystem) -> None:
        """Open the valve from the present state on: an action of events."""
        self._passage(run).was_open = True

    def close(self, run: HasSystem) -> None:
        """Close the valve from the present state on: an action of events."""
        self._passage(run).was_open = False

    def was_open(self, run: HasSystem) -> bool:
        """Whether the valve was open in the last step: a probe."""
        return self._passage(run).was_open

    def _passage(self, run: HasSystem) -> Passage:
        """The valve in a run.  `InputError`: it is not in the scene."""
        for scalars in run.system.scalar_unknowns:
            if isinstance(scalars, GasNetwork):
                return scalars.switch(self)
        raise InputError(f"'{self.name}' is not in the scene; add it.")

    def flow(self, gases: Gases, area: float, p: Pair, T: Pair) -> complex:
        """Mass flow [kg/s] from a to b while it is open."""
        if self.one_way and p[0].real < p[1].real:
            return 0.0
        return super().flow(gases, area, p, T)
