"""The state of the gas in one chamber, as outputs, probes and users read it."""

from __future__ import annotations

from dataclasses import dataclass

from gossamer_fx.mechanics.gas.contract import Volume
from gossamer_fx.mechanics.gas.enclosure import CompiledEnclosure


@dataclass(repr=False)
class ChamberState:
    """State of the gas in one chamber at the end of the last accepted step.

    The gas is well mixed and ideal: pressure · volume = (γ - 1) · internal_energy.

    Attributes:
        chamber: the chamber or tank that holds the gas.
        enclosure: what bounds it in the running scene; None for a rigid chamber.
        pressure: [Pa], absolute.
        mass: [kg].
        internal_energy: U = m c_v T [J].
        volume: [m³], rigid part included.

    Example:
        >>> run.chamber("tank").pressure
        200000.0
    """

    chamber: Volume
    enclosure: CompiledEnclosure | None
    pressure: float = 0.0
    mass: float = 0.0
    internal_energy: float = 0.0
    volume: float = 0.0

    def __repr__(self) -> str:
        """Name, pressure, temperature, volume and mass."""
        state = f"{self.pressure:.6g} Pa"
        # Before the first state is set there is no gas, and no temperature.
        if self.mass > 0:
            state += f", {self.temperature:.5g} K, {self.volume:.5g} m³, {self.mass:.5g} kg"
        return f"<ChamberState of '{self.chamber.name}': {state}>"

    @property
    def temperature(self) -> float:
        """Temperature of the gas [K], U/(m c_v)."""
        return self.internal_energy / (self.mass * float(self.chamber.gas.cv))
