"""What studies of deployments share: columns for the energy balance, cases that are computed
twice, and kinds of damping of a film.

Folded film moves chaotically; what differs between a case and the same with its start nudged, no
mesh and no step can tell.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

STARTS = ["usual", "nudged"]  # values of an axis "start"
# Relative change of a value: far below its accuracy, and far above round-off.
NUDGE = 1e-9
# Columns of the tables: what a demo returns of its energy balance and of its steps.  "rejected" is
# the number of rejected steps.
LEDGER = (
    "dissipated, penetrations, energy_error, angular_momentum_drift, rejected, steps, iterations, "
    "seconds"
)

# Arguments of a tube for each kind of damping of its film: a loss factor that is the same for all
# frequencies, within the range that is assumed for polyimide, or a damping time.
DAMPING: dict[str, dict[str, Any]] = {
    "loss 0.01": {},
    "loss 0.003": {"loss_factor": 0.003},
    "loss 0.03": {"loss_factor": 0.03},
    "1e-7 s": {"loss_factor": 0.0, "damping": 1e-7},
    "1e-6 s": {"loss_factor": 0.0, "damping": 1e-6},
}
# Those of a spinning sail.
SPIN_DAMPING: dict[str, dict[str, Any]] = {
    "1e-4 s": {},
    "1e-5 s": {"damping": 1e-5},
    "1e-3 s": {"damping": 1e-3},
    "loss 0.01": {"damping": 0.0, "loss_factor": 0.01},
    "loss 0.03": {"damping": 0.0, "loss_factor": 0.03},
}
NUDGES = [0.0, NUDGE, -NUDGE]


def arguments(case: str) -> dict[str, float]:
    """Arguments of a demo that a case names, e.g. "disc rev=2 cells=2"."""
    given = dict(word.split("=") for word in case.split() if "=" in word)
    whole = ("cells", "n")
    return {name: int(text) if name in whole else float(text) for name, text in given.items()}


def nudged(value: float, start: str) -> float:
    """A value at the start of a run, a little changed where the start is "nudged"."""
    return value * (1 + NUDGE * (start == "nudged"))


def balances(found: Mapping[str, float]) -> dict[str, float]:
    """Of the figures of a spinning sail those that studies limit, or show."""
    names = ("energy_error", "penetrations", "angular_momentum_drift")
    return {name: found[name] for name in names}
