"""Energies, momenta and gas masses of a state, for the ledger."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gossamer_fx.core.model.body import Array

_VECTORS = ("momentum", "angular_momentum")


@dataclass(frozen=True)
class Totals:
    """Energies [J], momenta [kg m/s, kg m²/s], gas masses [kg]; supplied and lost since the start.
    `stored` and `losses` are by the name of the part that stores or dissipates."""

    time: float
    kinetic: float
    stored: dict[str, float]
    supplied: float
    losses: dict[str, float]
    momentum: Array
    angular_momentum: Array
    mass: float
    mass_supplied: float

    @property
    def energy(self) -> float:
        """Kinetic and stored energy [J]."""
        return self.kinetic + sum(self.stored.values())

    @property
    def dissipated(self) -> float:
        """Sum of all losses since the start [J]."""
        return sum(self.losses.values(), 0.0)

    @property
    def size(self) -> float:
        """What an error of the energy is compared with [J]: energies, or flows if these are larger,
        without their signs."""
        # Signs do not cancel: an error of 1 J in 100 J in and 99 J out is one percent.
        flows = abs(self.supplied) + abs(self.dissipated)
        return max(self.kinetic + sum(map(abs, self.stored.values())), flows)

    def as_data(self) -> dict[str, Any]:
        """Numbers, lists and dictionaries, for JSON."""
        vectors = {name: getattr(self, name).tolist() for name in _VECTORS}
        return asdict(self) | vectors

    @classmethod
    def of_data(cls, data: Mapping[str, Any]) -> Totals:
        """The totals of which `as_data` made these data."""
        vectors = {name: np.array(data[name]) for name in _VECTORS}
        return cls(**{**data, **vectors})


def relative_drift(now: Array, first: Array, scale: float = 0.0) -> float:
    """Largest change of a component of a vector from `first` to `now`, over the largest component
    of `first` or a larger scale, which a vector that starts at zero needs; zero if both are."""
    size = max(float(np.abs(first).max()), scale)
    return float(np.abs(now - first).max()) / size if size else 0.0
