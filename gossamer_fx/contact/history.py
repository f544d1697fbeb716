"""What contact remembers from step to step: distances of points that grow, and stiffness of pairs that have energy."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gossamer_fx.model.body import Array


@dataclass
class ContactHistory:
    """distance (m,) [m] of each point, infinite before the first search; names (k,) and stiffness (k,) [J] of pairs
    that have energy, of this rank at least; `speed` [m/s], the least for which stiffness is chosen, zero until known.

    `gather`, given by what uses it, makes names and stiffness those of all ranks.  `restored` counts.
    """

    distance: Array = field(default_factory=lambda: np.zeros(0))
    names: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    stiffness: Array = field(default_factory=lambda: np.zeros(0))
    speed: float = 0.0
    restored: int = 0
    comm: Any = None

    def get_state(self) -> dict[str, Any]:
        names, stiffness = self.names, self.stiffness
        if self.comm is not None and self.comm.size > 1:
            parts = self.comm.allgather((names, stiffness))
            names, first = np.unique(np.concatenate([n for n, _ in parts]), return_index=True)
            stiffness = np.concatenate([k for _, k in parts])[first]
        return {
            "distance": self.distance.tolist(),
            "names": names.tolist(),
            "stiffness": stiffness.tolist(),
            "speed": self.speed,
        }

    def set_state(self, state: dict[str, Any]) -> None:
        self.distance = np.array(state["distance"], dtype=float)
        self.names = np.array(state["names"], dtype=np.int64)
        self.stiffness = np.array(state["stiffness"], dtype=float)
        self.speed = float(state["speed"])
        self.restored += 1

    def stiffness_of(self, names: npt.NDArray[np.int64]) -> tuple[npt.NDArray[np.bool_], Array]:
        """Which of the names are known, and their stiffness."""
        if not len(self.names):
            return np.zeros(len(names), dtype=bool), np.zeros(len(names))
        at = np.minimum(np.searchsorted(self.names, names), len(self.names) - 1)
        return self.names[at] == names, self.stiffness[at]
