"""What contact sees of the system, and types of its arrays, whose shapes stand in docstrings."""

from __future__ import annotations

from enum import IntEnum
from typing import Protocol

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.core.model.body import Array as Array
from gossamer_fx.mechanics.terms.assembly import Assembly

ByteArray = npt.NDArray[np.uint8]
Int32Array = npt.NDArray[np.int32]
Int64Array = npt.NDArray[np.int64]
MaskArray = npt.NDArray[np.bool_]


class Sides(IntEnum):
    """What the two sides of a pair are made of, and in which order its four points stand."""

    POINT_TRIANGLE = 0  # the point, the three corners
    EDGE_EDGE = 1  # the ends of the first edge, the ends of the second
    POINT_BOUNDARY = 2  # the point, an origin, two directions


class ContactAssembly(Assembly, Protocol):
    """The system with what contact needs in addition to other terms.

    Attributes:
        M: mass matrix [kg], once the scene is compiled.
    """

    M: PETSc.Mat
