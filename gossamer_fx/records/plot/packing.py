"""Arrays in few bytes, for the scripts of a page."""

from __future__ import annotations

from base64 import b64encode
from typing import Any

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.model.body import Array

NUMBER_BYTES = 2  # numbers are sent with 16 bits, as fractions of their range
_LARGEST_NUMBER = 65534
_NO_NUMBER = 65535  # where there is none


def packed(values: Array) -> dict[str, Any]:
    """Rows of numbers (n, k): the least of each column, its range, and fractions of this range as
    integers of 16 bits, `_NO_NUMBER` for those that are not finite."""
    low: Array = np.zeros(values.shape[1])
    span: Array = np.zeros(values.shape[1])
    is_known = np.isfinite(values)
    if is_known.any():
        low = np.min(values, axis=0, where=is_known, initial=np.inf)
        span = np.max(values, axis=0, where=is_known, initial=-np.inf) - low
        # A column without any number.
        span = np.where(np.isfinite(span), span, 0.0)
        low = np.where(np.isfinite(low), low, 0.0)
    part = np.where(is_known, values - low, 0.0) / np.where(span > 0, span, 1.0)
    numbers = np.where(is_known, np.rint(_LARGEST_NUMBER * part), _NO_NUMBER)
    return {"low": low.tolist(), "span": span.tolist(), "data": binary(numbers, np.uint16)}


def binary(values: npt.NDArray[Any], kind: type) -> str:
    """Numbers as base64 of little-endian binary numbers."""
    found = np.ascontiguousarray(values, dtype=np.dtype(kind).newbyteorder("<"))
    return b64encode(found.tobytes()).decode()
