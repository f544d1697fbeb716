"""The test of convergence of Newton's iteration.

With R the reference force, the norm of the first residual, |r| must not exceed

    max(relative R, absolute, floor ε_machine F, 1e-12 F_stop)                                (1)

F is the scale of the forces that cancel in r (`System.force_scale`), so that the third number is
the round-off floor: no iteration can reduce r below it.  In scenes with contact, F_stop is the
force that stops all motion within the step; R is at most the larger one of F_stop and of the force
of loads and supports, which contact carries when nothing moves.  A residual that no longer falls,
by a factor of `STAGNATION_RATIO` from one iterate to the next, counts as solved up to
`STAGNATION_FACTOR` times the round-off floor, or, with contact and (2), `CONTACT_STAGNATION_FACTOR`
times.  While it falls, the work of the residual in the step, which is the error of the total
energy, must also be small:

    |r·(q1 - q0)| <= energy tolerance × largest energy so far                                 (2)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gossamer_fx.solve.solvers.tolerances import Tolerances

# A residual above this fraction of the one before no longer falls: it is round-off, provided that
# it is below STAGNATION_FACTOR times the round-off floor.  The floor is an estimate, hence a margin
# of four.
STAGNATION_RATIO = 0.5
STAGNATION_FACTOR = 4.0

# With contact the margin is wider, provided that the residual passes (2): a gap is the difference
# of two squared distances, so that friction and steep barriers have ten times the round-off of
# their stiffness.
CONTACT_STAGNATION_FACTOR = 32.0

# With contact, a residual below this fraction of the force that stops all motion counts as zero.
# Film in free flight between two contacts has almost no forces, and its state follows round-off of
# strains.
CONTACT_FLOOR_RATIO = 1e-12

# Residual over the larger of the first two at which the iteration is declared divergent.  The
# second one counts too, as the first may be round-off when the predictor is nearly exact.
DIVERGENCE_RATIO = 1e12


@dataclass(frozen=True)
class Residual:
    """Norms of a residual, the same on every rank.

    Attributes:
        imbalance: of the forces [N].
        violation: the largest of a constraint [m or 1].
        scalars: the largest of the relative residuals of scalar unknowns.
    """

    imbalance: float
    violation: float = 0.0
    scalars: float = 0.0


class ConvergenceTest:
    """Judges the residuals of the iterates of one step, see the module.

    For each iterate call `record`, then `is_solved`, with the same residual or with that of the
    true strain.

    Args:
        tolerances: when a step counts as solved.
        has_contact: whether the scene has contact.

    Attributes:
        norm: of the forces of the last iterate [N].
        norms: of all iterates of the present iteration [N].
        reference: R in (1) [N].
        round_off_floor: third number of (1) [N]; zero: not known yet.
    """

    def __init__(self, tolerances: Tolerances, has_contact: bool) -> None:
        self._tolerances = tolerances
        self._has_contact = has_contact
        self.norm = math.inf
        self.norms: list[float] = []
        self.reference = 0.0
        self.round_off_floor = 0.0
        self._previous_norm = math.inf
        self._contact_floor = 0.0  # fourth number of (1) [N]

    @property
    def tolerance(self) -> float:
        """The number (1) [N]."""
        return max(
            self._tolerances.relative * self.reference,
            self._tolerances.absolute,
            self.round_off_floor,
            self._contact_floor,
        )

    @property
    def round_off(self) -> float:
        """Residual [N] that round-off alone explains."""
        return STAGNATION_FACTOR * self.round_off_floor

    def record(self, norm: float, is_first: bool) -> None:
        """Take the norm [N] of the forces of the next iterate.

        The first one of an iteration is the reference.  That of the iteration before, which lacked
        contact pairs, still tells whether it falls.
        """
        self._previous_norm = self.norm
        self.norm = norm
        if is_first:
            self.reference = norm
            self._contact_floor = 0.0
            self.norms = []
        self.norms.append(norm)

    def limit_reference(self, stopping: float, external: Callable[[], float]) -> None:
        """Limit the reference force of an iteration with contact, after its first iterate.

        The predictor may have passed through an obstacle.  Its forces are then thousands of times
        larger than those of the solution, and are not a scale for the residual.

        Args:
            stopping: force F_stop [N] that stops all motion within the step.
            external: gives the force [N] of loads and supports, asked where it matters.
        """
        self._contact_floor = CONTACT_FLOOR_RATIO * stopping
        if stopping < self.norm:
            largest = max(stopping, external())
            self.reference = min(self.norm, largest or math.inf)

    def lower_floor(self, force_scale: float) -> None:
        """Take the forces F [N] that cancel in the residual, of which the smallest one counts."""
        units = self._tolerances.floor * np.finfo(float).eps
        floor = float(units * force_scale)
        self.round_off_floor = min(floor, self.round_off_floor or math.inf)

    def is_solved(self, residual: Residual, energy_error_is_small: Callable[[], bool]) -> bool:
        """Whether a residual passes the test.

        The norm of the forces must be below the tolerance, or no longer fall and be round-off;
        while it falls, (2) must hold.  Violations of constraints and relative residuals of scalar
        unknowns must be below their tolerances, too.

        Args:
            residual: that of the last iterate, or of the true strain there.
            energy_error_is_small: whether (2) holds, asked where it matters; it may be collective.
        """
        imbalance = residual.imbalance
        stagnates = self.norm > STAGNATION_RATIO * self._previous_norm
        is_small = imbalance <= self.tolerance and (
            stagnates or imbalance <= self.round_off_floor or energy_error_is_small()
        )
        is_balanced = is_small or (stagnates and imbalance <= self.round_off)
        if self._has_contact and stagnates and not is_balanced:
            contact_round_off = CONTACT_STAGNATION_FACTOR * self.round_off_floor
            is_balanced = imbalance <= contact_round_off and energy_error_is_small()
        satisfies_constraints = residual.violation <= self._tolerances.constraint
        satisfies_scalars = residual.scalars <= self._tolerances.scalars
        return is_balanced and satisfies_constraints and satisfies_scalars

    def diverges(self) -> bool:
        """Whether the last residual has grown beyond measure."""
        largest_early = max(self.norms[:2])
        return self.norm > DIVERGENCE_RATIO * max(largest_early, self.tolerance)
