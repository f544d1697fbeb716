"""Solids as pictures show them: surfaces that move as a whole."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class Solid:
    """Points X (n, 3) [m] that stay together, `triangles` (t, 3) between them, and `lines` (l, 2) along their edges.

    Rooms and planes have no triangles, which would hide what is in or behind them.

    on: the body with one node of which it is a part: X are then along the node's directors, from its position.
    motion: displacement [m] over the time [s].  Without both it stays, and X are points in space.
    """

    name: str
    X: npt.NDArray[np.floating]
    triangles: npt.NDArray[np.int32]
    lines: npt.NDArray[np.int32]
    on: Any = None
    motion: Callable[[float], Sequence[float]] | None = None
