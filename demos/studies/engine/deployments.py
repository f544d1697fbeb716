"""What studies of deployments share: columns for the energy balance, and cases that are computed
twice.

Folded film moves chaotically; what differs between a case and the same with its start nudged, no
mesh and no step can tell.
"""

from __future__ import annotations

STARTS = ["usual", "nudged"]  # values of an axis "start"
# Relative change of a value: far below its accuracy, and far above round-off.
NUDGE = 1e-9
# Columns of the tables: what a demo returns of its energy balance and of its steps.  "rejected" is
# the number of rejected steps.
LEDGER = (
    "dissipated, penetrations, energy_error, angular_momentum_drift, rejected, steps, iterations, "
    "seconds"
)


def arguments(case: str) -> dict[str, float]:
    """Arguments of a demo that a case names, e.g. "disc rev=2 cells=2"."""
    given = dict(word.split("=") for word in case.split() if "=" in word)
    whole = ("cells", "n")
    return {name: int(text) if name in whole else float(text) for name, text in given.items()}


def nudged(value: float, start: str) -> float:
    """A value at the start of a run, a little changed where the start is "nudged"."""
    return value * (1 + NUDGE * (start == "nudged"))
