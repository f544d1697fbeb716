"""The engine of the convergence tests; the cases declare their rates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def observed_order(steps: Sequence[float], errors: Sequence[float]) -> float:
    """Slope of log(error) over log(step), by least squares."""
    # A slope over several steps is less sensitive to one accidental zero than the last pair of
    # errors.
    return float(np.polyfit(np.log(steps), np.log(np.abs(errors)), 1)[0])
