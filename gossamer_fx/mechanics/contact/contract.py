"""What the sides of a pair are, and types of arrays, whose shapes stand in docstrings."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.model.body import Array as Array

ByteArray = npt.NDArray[np.uint8]
Int32Array = npt.NDArray[np.int32]
Int64Array = npt.NDArray[np.int64]
MaskArray = npt.NDArray[np.bool_]


class Sides(IntEnum):
    """What the two sides of a pair are made of, and in which order its four points stand."""

    POINT_TRIANGLE = 0  # the point, the three corners
    EDGE_EDGE = 1  # the ends of the first edge, the ends of the second
    POINT_BOUNDARY = 2  # the point, an origin, two directions
