"""What holds gas: chambers and tanks with a state of their own, reservoirs and surroundings without."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from typing import Any

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check, check_positive, require_positive
from gossamer_fx.gas.enclosure import Enclosure, FilmEnclosure
from gossamer_fx.gas.ideal_gas import IdealGas
from gossamer_fx.gas.network import GasNetwork
from gossamer_fx.gas.ring import Ring


@check_arguments
@dataclass(frozen=True, eq=False)
class Reservoir:
    """Gas at constant pressure [Pa] and temperature [K]; what it gives is booked as supplied."""

    pressure: float
    temperature: float
    _: KW_ONLY
    name: str = "reservoir"
    scalar_unknowns = GasNetwork

    def __post_init__(self) -> None:
        _check_state(f"Reservoir '{self.name}'", self.pressure, self.temperature)


@check_arguments
@dataclass(frozen=True, eq=False)
class Ambient:
    """Surroundings at constant pressure [Pa], by default a vacuum, and temperature [K]."""

    pressure: float = 0.0
    temperature: float = 300.0
    _: KW_ONLY
    name: str = "ambient"
    scalar_unknowns = GasNetwork

    def __post_init__(self) -> None:
        check(
            math.isfinite(self.pressure) and self.pressure >= 0,
            f"Ambient '{self.name}': pressure is {self.pressure!r} Pa; give zero (vacuum) or a positive number.",
        )
        check_positive(self, "temperature", "K")


@check_arguments
class Chamber:
    """A volume of well mixed gas: dm/dt = Σ ṁ, dU/dt = Σ c_p T_up ṁ - p dV/dt + heat, p = (γ-1) U/V.

    Args:
        enclosure: the closed film that bounds it, or a `Piston`; none for a rigid chamber.
        gas: the gas; one for all chambers that are connected.
        pressure, temperature: initial state [Pa], [K]; the initial pressure is positive.
        dead_volume: rigid volume [m³] that is added to the enclosed one (pipes, valve); positive if the enclosure
            starts flat.
        volume: volume [m³] of a rigid chamber.
        surface: names of the cell groups that bound the chamber, if it is not the whole film.
        rings: closed lines of the film over which no film closes the chamber; gas passes there only if an `Orifice`
            leads through.
        outside: what acts on the outer side of the film; default vacuum.
    """

    scalar_unknowns = GasNetwork

    def __init__(
        self,
        enclosure: Membrane | Enclosure | None = None,
        *,
        gas: IdealGas,
        pressure: float,
        temperature: float,
        dead_volume: float = 0.0,
        volume: float | None = None,
        surface: tuple[str, ...] = (),
        rings: tuple[Ring, ...] = (),
        outside: Ambient | None = None,
        name: str = "chamber",
    ) -> None:
        self.gas, self.name, self.outside = gas, name, outside
        self.initial_pressure, self.initial_temperature = pressure, temperature
        _check_state(f"{type(self).__name__} '{name}'", pressure, temperature)
        rigid = enclosure is None
        check(
            (volume is not None) == rigid,
            f"Chamber '{name}': give either a film (or piston) that encloses it, or the volume of a rigid chamber.",
        )
        fixed = volume if volume is not None else dead_volume
        check(
            math.isfinite(fixed) and (fixed > 0 if rigid else fixed >= 0),
            f"Chamber '{name}': its {'volume' if rigid else 'dead volume'} is {fixed!r} m³; give a positive number.",
        )
        self.fixed_volume = fixed
        check(
            isinstance(enclosure, Membrane) or not (surface or rings),
            f"Chamber '{name}': surface and rings belong to a film; give one as enclosure, or leave them out.",
        )
        self.enclosure = (
            FilmEnclosure(enclosure, surface, rings, name)
            if isinstance(enclosure, Membrane)
            else enclosure
        )

    def requires(self) -> Iterable[Any]:
        if self.enclosure is not None:
            yield from self.enclosure.requires()
        if self.outside is not None:
            yield self.outside


@check_arguments
class Tank(Chamber):
    """A rigid chamber that blows down: `volume` [m³] at `pressure` [Pa] and `temperature` [K]."""

    def __init__(
        self,
        volume: float,
        *,
        gas: IdealGas,
        pressure: float,
        temperature: float,
        name: str = "tank",
    ) -> None:
        super().__init__(
            gas=gas, pressure=pressure, temperature=temperature, volume=volume, name=name
        )


def _check_state(where: str, pressure: float, temperature: float) -> None:
    require_positive(f"{where}: pressure", pressure, "Pa", " (an almost empty chamber: 1e-3)")
    require_positive(f"{where}: temperature", temperature, "K")
