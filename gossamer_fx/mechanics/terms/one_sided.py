"""The linear law that acts on one side only: T(y) = max(y, 0), as of a rope, a stop or a tape."""

from __future__ import annotations

import numpy as np

from gossamer_fx.core.model.body import Array


def one_sided_energy(y: Array) -> Array:
    """ψ(y) = ½ max(y, 0)², of any shape."""
    return np.maximum(y, 0.0) ** 2 / 2


def one_sided_average(y0: Array, y1: Array) -> tuple[Array, Array]:
    """Average of T(y) = max(y, 0) along the straight path from y0 to y1, and its derivative by y1.

    The average is exact, also where the path passes zero: T_mean (y1 - y0) = ψ(y1) - ψ(y0) with ψ =
    ½ max(y, 0)², so a step with it conserves energy.  It does not divide by a small change: that is
    done only where the path passes zero, and there |y1 - y0| >= |y1|.

    Args:
        y0, y1: arrays of one shape, in any unit, e.g. stretches [m] of ropes.

    Returns:
        T_mean, in that unit, and dT_mean/dy1, dimensionless, of that shape; ½ (T(y0) + T(y1)) and ½
        where the law acts all the way.
    """
    pull0 = np.maximum(y0, 0.0)
    pull1 = np.maximum(y1, 0.0)
    passes_zero = (y0 > 0) != (y1 > 0)
    # Elsewhere the divisor is 1: its quotient is not read, and must not divide by zero.
    change = np.where(passes_zero, y1 - y0, 1.0)
    quotient = (pull1**2 - pull0**2) / (2 * change)
    slope_of_quotient = (pull1 - quotient) / change
    # Where T is linear all the way, the trapezoidal rule is exact.
    trapezoidal_mean = (pull0 + pull1) / 2
    trapezoidal_slope = np.where(y1 > 0, 0.5, 0.0)
    mean = np.where(passes_zero, quotient, trapezoidal_mean)
    slope = np.where(passes_zero, slope_of_quotient, trapezoidal_slope)
    return mean, slope
