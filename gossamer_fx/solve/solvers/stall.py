"""The rule that gives up Newton iterations whose residual no longer falls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

# An iteration has stalled if the least residual of its last iterates is above STALLED_RATIO of the
# least one before them.  Slack film that switches its state from iterate to iterate leaves such
# residuals, 1e-3 of the first one: a shorter step converges, this one does not. The last iterates
# are STALLED_SHARE of those that the tolerances allow: a folded tube rejects 14 of 359 steps after
# a fifth of them, and 2 of 329 after two fifths, in the same time.
# docs/performance.md counts the iterations that the rule saves.
STALLED_SHARE = 0.4
STALLED_RATIO = 0.7

# At least one of the last updates must have kept this share of its length: as long as contact
# shortens all of them much, the iteration is on its way.  Measured: 0.65 to 1 where it has stalled,
# 0.1 to 0.3 where a film turns by two radians in a step and converges.
STALLED_KEPT_SHARE = 0.5

# A residual below this fraction of that of three iterates before falls again, e.g. after new
# contacts had raised it.
FALLING_RATIO = 0.5
FALLING_ITERATES = 3


@dataclass(frozen=True)
class StallRule:
    """Whether the last residuals of an iteration are hardly smaller than those before.

    For time steps with contact and without friction: with friction an iteration may come from a
    plateau to a solution, and an equilibrium has no time step that could be divided.

    Args:
        max_iterations: number of Newton iterations that are allowed.
    """

    max_iterations: int

    def has_stalled(
        self, norms: Sequence[float], kept_shares: Sequence[float], small: float
    ) -> bool:
        """Judge an iteration by all of its residuals so far.

        Args:
            norms: of the forces of all iterates [N].  The first does not count, as it may be
                round-off when the predictor is nearly exact.
            kept_shares: shares of the lengths of the updates that contact has left.
            small: norm [N] that passes the test of the forces; such a residual waits for the other
                parts of the test.
        """
        last = math.ceil(STALLED_SHARE * self.max_iterations)
        before = norms[1:-last]
        if not before or norms[-1] <= small:
            return False
        # Bodies that turn far in a step need many shortened updates before the residual falls.
        if max(kept_shares[-last:], default=1.0) < STALLED_KEPT_SHARE:
            return False
        is_falling = norms[-1] < FALLING_RATIO * norms[-1 - FALLING_ITERATES]
        return not is_falling and min(norms[-last:]) > STALLED_RATIO * min(before)
