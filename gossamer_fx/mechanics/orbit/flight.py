"""State of a flying scene: the origin of its frame, and gravity and sunlight there in a step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gossamer_fx.extend import Array, Assembly, HistoryVariables
from gossamer_fx.mechanics.orbit.environment import Environment
from gossamer_fx.mechanics.orbit.origin import Origin, raise_too_long

# Accuracy [m] of the position at which the perturbing field is evaluated.  The field changes over
# kilometres, so a millimetre is more than enough.
MIDPOINT_TOLERANCE = 1e-3

# Fixed-point iterations for the middle of a step, at most.  The field is a small part of the
# attraction: steps of a tenth of a low orbit take fewer than ten.  An iteration that does not
# converge in this number would not end.
MAX_MIDPOINT_ITERATIONS = 50

# The origin follows the centre of mass with at least this many steps as time constant; a shorter
# one would make the explicit law unstable.
SHORTEST_FOLLOWING = 5


@dataclass(frozen=True)
class Moments:
    """Mass [kg], first moment Σ m x [kg m] and momentum Σ m v [kg m/s], seen from the origin."""

    mass: float
    first: Array
    momentum: Array


class Flight(HistoryVariables):
    """The origin of a flying frame at work.

    Args:
        around: what attracts and lights.

    Attributes:
        origin: its position and velocity at the ends of the step.
        time: of the middle of the step [s].
        R, V: there (3,).
        field: acceleration [m/s²] that the origin has there by all attraction in addition to the
            central body's 1/r.
        gradient: its derivative (3, 3) [1/s²].
        pushed: acceleration of the origin by which it is kept near the bodies.
        centre: of mass in the middle of the last step, from the origin (3,) [m].
    """

    def __init__(self, around: Environment) -> None:
        self.around = around
        self.origin = Origin(*around.state, around.mu)
        self.moments: Callable[[], Moments] | None = None
        self._for: tuple[float, float] | None = None
        self.time = 0.0
        self.R: Array = self.origin.R0
        self.V: Array = self.origin.V0
        self.field: Array = np.zeros(3)
        self.gradient: Array = np.zeros((3, 3))
        self.pushed: Array = np.zeros(3)
        self.centre: Array = np.zeros(3)

    def prepare(self, system: Assembly) -> None:
        """Compute the motion of the moving origin in the present step, once in every step.
        Collective.

        Sets position `R` [m] and velocity `V` [m/s] of the origin in the middle of the step, the
        perturbing acceleration `field` [m/s²] there, and its `gradient` [1/s²].  The field acts at
        the middle of the step, which depends on the end; a fixed-point iteration solves that.

        Args:
            system: the compiled scene, with the start `time` and the length `h` of the step [s].

        Raises:
            InputError: the step is so long that the motion of the origin cannot be solved.
        """
        # Several loads share one flight; the first one prepares it.
        if self._for == (system.time, system.h):
            return
        around = self.around
        origin = self.origin
        h = system.h
        self.time = system.time + h / 2
        self.pushed = self._return(h)
        # Origin at the start of the step (3,) [m], from the attracting centre.
        R0 = origin.R0
        self.R = R0 + h / 2 * origin.V0
        for _ in range(MAX_MIDPOINT_ITERATIONS):
            self.field = around.field(self.R, self.time)
            origin.step(h, self.field + self.pushed)
            before = self.R
            self.R = (R0 + origin.R1) / 2
            change = np.linalg.norm(self.R - before)
            if not around.is_perturbed or change < MIDPOINT_TOLERANCE:
                break
        else:
            raise_too_long(h)
        self.V = origin.moved / h
        if around.is_perturbed:
            self.gradient = around.gradient(self.R, self.time)
        self._for = (system.time, h)

    def _return(self, h: float) -> Array:
        """Acceleration (3,) [m/s²] that returns the origin to the centre of mass, critically
        damped.

        It is S/(m T²) + 2 P/(m T), with mass m [kg], first moment S [kg m] and momentum P [kg m/s]
        of all bodies relative to the origin, and the time T = `following` [s], at least 5 steps.

        Args:
            h: length of the step [s].

        Returns:
            the acceleration; zeros before the bodies of the scene are known.  Collective.
        """
        if self.moments is None:
            return np.zeros(3)
        m = self.moments()
        T = max(self.around.following, SHORTEST_FOLLOWING * h)
        back: Array = (m.first / T**2 + 2 * m.momentum / T) / m.mass
        return back

    def state(self) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s] of the centre of mass, from what attracts, at the start
        of the step.
        """
        assert self.moments is not None
        m = self.moments()
        return self.origin.R0 + m.first / m.mass, self.origin.V0 + m.momentum / m.mass

    def light(self) -> tuple[Array, float]:
        """Direction (3,) of sunlight, and its pressure on a black surface [N/m²]."""
        return self.around.light(self.R, self.time)

    def keep(self) -> None:
        """Accept the step."""
        if self._for is not None:
            self.origin.keep()
            self._for = None

    def get_state(self) -> dict[str, Any]:
        return self.origin.get_state()

    def set_state(self, state: dict[str, Any]) -> None:
        self.origin.set_state(state)
        self._for = None
