"""When Newton's iteration ends: tolerances, the test of convergence, and the rule that gives up
iterations whose residual no longer falls.

With R the reference force, the norm of the first residual, |r| must not exceed

    max(relative R, absolute, floor ε_machine F, 1e-12 F_stop)                                (1)

F is the scale of the forces that cancel in r (`residual_sizes.force_scales`), so that the third
number is the round-off floor: no iteration can reduce r below it. In scenes with contact, F_stop is
the force that stops all motion within the step; R is at most the larger one of F_stop and of the
force of loads and supports, which contact carries when nothing moves. A residual that no longer
falls, by a factor of `STAGNATION_RATIO` from one iterate to the next, counts as solved up to
`STAGNATION_FACTOR` times the round-off floor, or, with contact and (2), `CONTACT_STAGNATION_FACTOR`
times. While it falls, the work of the residual in the step, which is the error of the total energy,
must also be small:

    |r·(q1 - q0)| <= energy tolerance × largest energy so far                                 (2)

Round-off of booms that are a million times stiffer than a film between them hides the film: its
state may be wrong by a thousand times its own round-off in a residual that no longer falls.  In
time steps of several bodies such a residual counts as solved only if (2) holds up to a factor of
`STAGNATION_ENERGY_FACTOR`, or if the forces r_b of each body are small against the forces F_b that
cancel there, of which F_max is the largest:

    |r_b| <= F_b/F_max max(tolerance (1), STAGNATION_FACTOR × round-off floor)                (3)

After `LATE_SHARE` of the iterations that the tolerances allow neither is asked.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Annotated

import numpy as np

from gossamer_fx.core.checks.arguments import Range, check_arguments, not_negative
from gossamer_fx.core.model.body import Array

# With a fraction of 1 or more, the first guess would already count as solved.
Fraction = Annotated[float, Range(0.0, 1.0, below=True)]


@check_arguments
@dataclass(frozen=True)
class Tolerances:
    """When the equations of a step count as solved; `solvers.convergence` has the complete test.

    Args:
        relative: norm of the residual over that of the first guess of the step.
        absolute: residuals below this count as zero [N], whatever their ratio.
        floor: residuals below this number of units in the last place of the forces that cancel in
            them count as zero; four times as many if the residual no longer falls.
        energy: work of the residual in a step, which is the error of the total energy, over the
            largest energy so far; asked while the residual still falls.  In scenes of several
            bodies a hundred times as much is allowed where it no longer falls.
        scalars: largest relative residual of the equations of scalar unknowns, such as gas
            pressures.
        constraint: largest violation of a constraint between points, over its size: the extent of
            the scene where it is a distance, 1 where it is a product of directions.
        max_iterations: number of Newton iterations after which the step has failed.

    The tolerances are those of one step.  What steps leave below them may add up, as all may miss
    to the same side: a free rigid body closes its energy to 2e-12 in 400 steps of 26 ms, where two
    iterations just pass the test of the residual, and to 1e-15 with `relative` 1e-12
    (`tests/bodies/test_multibody_motion.py`).

    Raises:
        InputError: a tolerance is negative, or one that has to be below 1 is not, or no iteration
            is allowed.

    Example:
        >>> stepper = gx.Midpoint(dt=1e-3, tolerances=gx.Tolerances(relative=1e-12))
    """

    relative: Fraction = 1e-10
    absolute: Annotated[float, not_negative("N")] = 0.0
    _: KW_ONLY
    floor: Annotated[float, not_negative()] = 4.0
    energy: Fraction = 1e-12
    scalars: Fraction = 1e-12
    constraint: Annotated[float, not_negative()] = 1e-12
    max_iterations: Annotated[int, Range(1)] = 40


# A residual above this fraction of the one before no longer falls: it is round-off, provided that
# it is below STAGNATION_FACTOR times the round-off floor.  The floor is an estimate, hence a margin
# of four.
STAGNATION_RATIO = 0.5
STAGNATION_FACTOR = 4.0
# At the round-off floor a residual may halve by chance; one that still converges falls steeply.
FLOOR_STAGNATION_RATIO = 0.1

# Where a residual of several bodies no longer falls, its work may be larger than the tolerance of
# the energy by this factor.  In the first ten steps of an antenna of 170 thousand unknowns, factors
# of 1000, 100 and 10 take 71, 98 and 122 iterations, 61 without any limit, and leave energy errors
# of 1e-9, 1e-10 and 3e-11, 3e-9 without.
STAGNATION_ENERGY_FACTOR = 100.0

# Share of the iterations that the tolerances allow after which round-off of the stiffest body is
# enough.  In the first step of an antenna of 499 thousand unknowns, from rest, 20 iterations leave
# an energy error of 8e-8, and 30 of 7e-10.
LATE_SHARE = 0.75

# No body is asked for a smaller share of the residual, F_b/F_max in (3).
LEAST_BODY_SHARE = 1e-4

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
    """Norms of a residual, the same on every rank: imbalance of the forces [N], the largest
    violation of a constraint over its size, and the largest relative residual of scalar
    unknowns."""

    imbalance: float
    violation: float = 0.0
    scalars: float = 0.0


class ConvergenceTest:
    """Judges the residuals of the iterates of one step, see the module.

    For each iterate call `record`, then `is_solved`, with the same residual or with that of the
    true strain.  It has the norms [N] of the forces of all iterates, their reference R in (1) [N],
    and the round-off floor, the third number of (1) [N], zero while it is not known.
    """

    def __init__(self, tolerances: Tolerances, has_contact: bool) -> None:
        self._tolerances = tolerances
        self._has_contact = has_contact
        self.norm = math.inf
        self.norms: list[float] = []
        self.reference = 0.0
        self.round_off_floor = 0.0
        # F_b [N] of the bodies in (3); none while they are not known, or with one body.
        self._body_scales: Array = np.empty(0)
        self._previous_norm = math.inf
        self._contact_floor = 0.0  # fourth number of (1) [N]

    @property
    def tolerance(self) -> float:
        """The norm [N] that a residual must not exceed, the number (1)."""
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
        """Take the norm [N] of the forces of the next iterate; the first one of an iteration is the
        reference, and the norms before it are dropped.  Only the last of them, infinite or that of
        an iteration that lacked contact pairs, is still compared with the first one."""
        self._previous_norm = self.norm
        self.norm = norm
        if is_first:
            self.reference = norm
            self._contact_floor = 0.0
            self.norms = []
        self.norms.append(norm)

    def limit_reference(self, stopping: float, external: Callable[[], float]) -> None:
        """Limit the reference force of an iteration with contact, after its first iterate, by the
        force `stopping` [N], F_stop, that stops all motion within the step, and that of loads and
        supports, for which `external` is called only if F_stop is below the first norm.

        The predictor may have passed through an obstacle.  Its forces are then thousands of times
        larger than those of the solution, and are not a scale for the residual.
        """
        self._contact_floor = CONTACT_FLOOR_RATIO * stopping
        if stopping < self.norm:
            largest = max(stopping, external())
            self.reference = min(self.norm, largest or math.inf)

    def lower_floor(self, force_scale: float, body_scales: Array) -> None:
        """Lower the round-off floor to that of the forces F [N] that cancel in the residual, and
        those (bodies,) of the bodies, none in scenes of one body; of several calls the smallest
        ones count."""
        floor = self._tolerances.floor * sys.float_info.epsilon * force_scale
        if self.round_off_floor:
            floor = min(floor, self.round_off_floor)
            body_scales = np.minimum(body_scales, self._body_scales)
        self.round_off_floor = floor
        self._body_scales = body_scales

    def is_solved(
        self,
        residual: Residual,
        energy_error_is_small: Callable[[float], bool],
        body_imbalances: Callable[[], Array],
    ) -> bool:
        """Whether a residual, of the last iterate or of the true strain there, passes the test.

        The norm of the forces must be below the tolerance, or no longer fall and be round-off.
        Violations of constraints and relative residuals of scalar unknowns must be below their
        tolerances, too.  The functions are called only where they decide, and may be collective.

        Args:
            residual: norms of the residual.
            energy_error_is_small: whether (2) holds up to the factor that it is given.
            body_imbalances: norms (bodies,) of the forces of each body in the residual [N].
        """
        imbalance = residual.imbalance
        ratio = FLOOR_STAGNATION_RATIO if imbalance <= self.round_off_floor else STAGNATION_RATIO
        if self.norm <= ratio * self._previous_norm:
            is_balanced = imbalance <= self.tolerance and energy_error_is_small(1.0)
        elif imbalance <= max(self.tolerance, self.round_off):
            is_balanced = (
                self._body_scales.size == 0
                or len(self.norms) > LATE_SHARE * self._tolerances.max_iterations
                or energy_error_is_small(STAGNATION_ENERGY_FACTOR)
                or self._is_round_off_of_each(body_imbalances())
            )
        else:
            contact_round_off = CONTACT_STAGNATION_FACTOR * self.round_off_floor
            has_contact_round_off = self._has_contact and imbalance <= contact_round_off
            is_balanced = has_contact_round_off and energy_error_is_small(1.0)
        satisfies_constraints = residual.violation <= self._tolerances.constraint
        satisfies_scalars = residual.scalars <= self._tolerances.scalars
        return is_balanced and satisfies_constraints and satisfies_scalars

    def _is_round_off_of_each(self, imbalances: Array) -> bool:
        """Whether (3) holds for the forces (bodies,) of all bodies in the residual [N]."""
        shares = self._body_scales / max(self._body_scales.max(), sys.float_info.min)
        limits = max(self.tolerance, self.round_off) * np.maximum(shares, LEAST_BODY_SHARE)
        return bool((imbalances <= limits).all())

    def diverges(self) -> bool:
        """Whether the last residual exceeds `DIVERGENCE_RATIO`, 1e12, times the larger one of the
        first two, and of the tolerance."""
        has_grown = self.norm > DIVERGENCE_RATIO * max(self.norms[:2])
        return has_grown and self.norm > DIVERGENCE_RATIO * self.tolerance


# An iteration has stalled if the least residual of its last iterates is above STALLED_RATIO of the
# least one before them.  Slack film that switches its state from iterate to iterate leaves such
# residuals, 1e-3 of the first one: a shorter step converges, this one does not. The last iterates
# are STALLED_SHARE of those that the tolerances allow: a folded tube rejects 3 of 316 steps after a
# fifth of them, and 1 of 337 after two fifths, in the same time.
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
    """

    max_iterations: int

    def has_stalled(self, test: ConvergenceTest, kept_shares: Sequence[float]) -> bool:
        """Judge an iteration by the norms of the forces of all iterates, of which the first may be
        round-off and does not count, and the shares of the lengths of the updates that contact has
        left.  A residual that is small waits for the other parts of the test of convergence."""
        norms = test.norms
        last = math.ceil(STALLED_SHARE * self.max_iterations)
        before = norms[1:-last]
        if not before or norms[-1] <= max(test.tolerance, test.round_off):
            return False
        # Bodies that turn far in a step need many shortened updates before the residual falls.
        if max(kept_shares[-last:], default=1.0) < STALLED_KEPT_SHARE:
            return False
        is_falling = norms[-1] < FALLING_RATIO * norms[-1 - FALLING_ITERATES]
        return not is_falling and min(norms[-last:]) > STALLED_RATIO * min(before)
