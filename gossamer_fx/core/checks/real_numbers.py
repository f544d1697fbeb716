"""Which values are real numbers that can be computed with.

NumPy also makes numbers of words, drops imaginary parts, and takes numbers whose squares overflow.
"""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

# Kinds of NumPy's types that are real numbers: truth values, whole numbers and floating-point
# numbers.
REAL_KINDS = "biuf"

# Sizes of numbers, other than zero, with which the package computes, in SI units: cubes of these,
# and ratios of their squares, are floating-point numbers.
LARGEST = 1e100
SMALLEST = 1e-100

# Whole numbers up to this one are integers of 64 bits.
LARGEST_COUNT = 2**63 - 1


def real_numbers(value: Any) -> npt.NDArray[np.float64] | None:
    """Return a number, list or array as an array of floats; None if an entry is not a real number.

    NaN and infinite values are returned, too.  Words, complex numbers, and lists whose rows differ
    in length are not real numbers; True and False are 1 and 0.

    Args:
        value: anything.

    Returns:
        Array of the shape that NumPy gives to the value, () for a number.

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


def are_usual_sizes(numbers: npt.NDArray[np.floating]) -> bool:
    """Return whether all numbers are finite, and zero or of a size that can be computed with.

    A size may be at most `LARGEST`, 1e100 in SI units.  A single number, of shape (), must also be
    zero or at least `SMALLEST`, 1e-100; entries of a list may be smaller, since a component that
    vanishes next to the others is harmless.

    >>> are_usual_sizes(np.array([1e-300, -1e9])), are_usual_sizes(np.array([1e300]))
    (True, False)
    >>> are_usual_sizes(np.array(1e-300))
    False
    """
    sizes = np.abs(numbers)
    # NaN is not below the limit.
    is_below = bool((sizes <= LARGEST).all())
    if sizes.ndim > 0:
        return is_below
    return is_below and bool(sizes == 0 or sizes >= SMALLEST)
