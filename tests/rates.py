"""The engine of the convergence tests; the cases declare their rates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def observed_order(steps: Sequence[float], errors: Sequence[float]) -> float:
    """Slope of log(error) over log(step), by least squares."""
    # A slope over four and more steps is less sensitive to one accidental zero than the last pair
    # of errors.  Of three steps h, h/2 and h/4 the middle one has no weight: two suffice.
    log_steps = np.log(steps)
    log_errors = np.log(np.abs(errors))
    slope, _ = np.polyfit(log_steps, log_errors, 1)
    return float(slope)
