"""The state of the gas in a chamber."""

from __future__ import annotations

from dataclasses import dataclass

from gossamer_fx.gas.contract import Volume
from gossamer_fx.gas.enclosure import CompiledEnclosure


@dataclass
class ChamberState:
    """State of one chamber: pressure [Pa], mass [kg], internal energy [J], volume [m³]."""

    chamber: Volume
    enclosure: CompiledEnclosure | None
    p: float = 0.0
    m: float = 0.0
    U: float = 0.0
    V: float = 0.0

    @property
    def temperature(self) -> float:
        """[K]"""
        return self.U / (self.m * float(self.chamber.gas.cv))
