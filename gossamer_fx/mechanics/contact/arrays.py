"""Types of the arrays of contact; their shapes stand in docstrings."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.model.body import Array as Array

ByteArray = npt.NDArray[np.uint8]
Int32Array = npt.NDArray[np.int32]
Int64Array = npt.NDArray[np.int64]
MaskArray = npt.NDArray[np.bool_]
