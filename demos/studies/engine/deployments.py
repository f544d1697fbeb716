"""What studies of deployments share: columns for the books, and cases that are computed twice.

Folded film moves chaotically; what differs between a case and the same with its start nudged, no mesh and no step can
tell.
"""

from __future__ import annotations

STARTS = ["usual", "nudged"]  # values of an axis "start"
NUDGE = 1e-9  # of a value
BOOKS = (
    *("dissipated", "penetrations", "energy_error", "angular_momentum_drift"),
    *("halved", "steps", "iterations", "seconds"),
)  # columns: what a demo says of its books


def nudged(value: float, start: str) -> float:
    """A value at the start of a run, a little changed where the start is "nudged"."""
    return value * (1 + NUDGE * (start == "nudged"))
