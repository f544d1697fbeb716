"""What a gas network is made of, as it sees it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

from gossamer_fx.gas.enclosure import Enclosure
from gossamer_fx.gas.geometry import Geometry
from gossamer_fx.gas.ideal_gas import IdealGas

Aperture = Callable[
    [float, float], float
]  # C_d A [m²] of a step of length h whose middle is at time t


@runtime_checkable
class Holder(Protocol):
    """Something that gas comes from or goes to, at a pressure [Pa] and a temperature [K]."""

    @property
    def name(self) -> str: ...

    @property
    def pressure(self) -> float: ...

    @property
    def temperature(self) -> float: ...


@runtime_checkable
class Volume(Protocol):
    """A holder with a state of its own: see `run.chamber(name)`; here are its initial values [Pa], [K]."""

    name: str
    initial_pressure: float
    initial_temperature: float
    gas: IdealGas
    fixed_volume: float
    enclosure: Enclosure | None

    @property
    def outside(self) -> Holder | None: ...


@runtime_checkable
class Opening(Protocol):
    """A way for gas between two holders."""

    name: str

    @property
    def a(self) -> Holder | Volume: ...

    @property
    def b(self) -> Holder | Volume: ...

    def aperture(self, geometry: Geometry) -> Aperture:
        """Its effective area in a running scene."""
        ...

    def flow(
        self, gas: IdealGas, area: float, p: tuple[complex, complex], T: tuple[complex, complex]
    ) -> complex:
        """Mass flow [kg/s] from a to b at pressures p and temperatures T of the two ends."""
        ...


@runtime_checkable
class Wall(Protocol):
    """Heat conductance [W/K] between a volume and a temperature [K]."""

    name: str
    chamber: Any
    conductance: float
    temperature: float
