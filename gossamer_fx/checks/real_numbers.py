"""Which values are real numbers: NumPy also makes numbers of words, and drops imaginary parts."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

# Kinds of NumPy's types that are real numbers: truth values, whole numbers and floating-point numbers.
REAL_KINDS = "biuf"


def real_numbers(value: Any) -> npt.NDArray[np.float64] | None:
    """Return a number, list or array as an array of floats; None if an entry is not a real number.

    NaN and infinite values are returned, too.

    >>> real_numbers([1, 2.5])
    array([1. , 2.5])
    >>> print(real_numbers(["1", "2"]), real_numbers([1j]))
    None None
    """
    try:
        found = np.asarray(value)
        if found.dtype.kind not in REAL_KINDS:
            # Fractions and numbers beyond 64 bits are objects for NumPy.
            are_real = all(isinstance(one, Real) for one in found.ravel().tolist())
            if found.dtype.kind != "O" or not are_real:
                return None
        return found.astype(float)
    except (TypeError, ValueError, OverflowError):
        return None
