"""Flight of a scene: the orbit of the origin of its frame, and gravity and sunlight there.

The frame does not rotate.  Its origin has the position R and the velocity V relative to the central
body.  They follow the same time-stepping rule as the bodies, with the exact average of 1/r gravity
over a step of length h:

    (V1 - V0)/h = -σ(R0, R1) R_mid + a,    (R1 - R0)/h = (V0 + V1)/2                             (1)

    σ(b, c) = 2μ/(|b||c|(|b| + |c|)),      R_mid = (R0 + R1)/2                                   (2)

So ½|V|² - μ/|R| grows by exactly a·(R1 - R0), and R×V by h R_mid×a.  The acceleration a is chosen
such that the origin stays near the bodies; their motion does not depend on it.

Energies of an orbit are 1e8 times those of the motion of a sail within the frame.  To balance both
in one ledger, the six numbers of the origin have 40 decimal digits; this costs less than a
millisecond a step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Context, Decimal, localcontext
from typing import Any

import numpy as np

from gossamer_fx.extend import Array, Assembly, HistoryVariables, check
from gossamer_fx.mechanics.orbit.environment import Environment

# A vector of three numbers.
Exact = list[Decimal]

# Decimal digits of the origin's position and velocity; see the module.
_DIGITS = Context(prec=40)

# The fixed-point iteration for a step: relative tolerance, well below the digits of a float, and
# largest number of iterations, which only steps of a large part of a revolution need.
_TOLERANCE = Decimal(10) ** -32
_ITERATIONS = 200

# Change of the energy over that at the start, below which it is what the iteration and the digits
# leave: a body without other energies would have it as its largest energy, and an error of 100 %.
_ROUND_OFF = Decimal(10) ** -30


class Origin:
    """Position R and velocity V of the origin at the start and the end of a step, from r (3,) [m]
    and v (3,) [m/s] at the start of the run; `mu` [m³/s²] is the gravitational parameter of the
    central body.

    >>> import numpy as np
    >>> origin = Origin(np.array([7e6, 0.0, 0.0]), np.array([0.0, 7546.0, 0.0]), mu=3.986e14)
    >>> origin.step(1.0, np.zeros(3))
    >>> origin.keep()
    >>> energy, moment = origin.gained()
    >>> bool(abs(energy) < 1e-20)
    True
    """

    def __init__(self, r: Array, v: Array, mu: float) -> None:
        self.mu = mu
        self._mu = Decimal(mu)
        self._R0 = exact(r)
        self._V0 = exact(v)
        self._R1 = self._R0
        self._V1 = self._V0
        # The invariants at the start of the run, of which `gained` is the change.
        with localcontext(_DIGITS):
            self._first = self._invariants()

    @property
    def R0(self) -> Array:
        """Position (3,) at the start of the step [m]."""
        return rounded(self._R0)

    @property
    def V0(self) -> Array:
        """Velocity (3,) at the start of the step [m/s]."""
        return rounded(self._V0)

    @property
    def R1(self) -> Array:
        """Position (3,) at the end of the step [m]."""
        return rounded(self._R1)

    @property
    def moved(self) -> Array:
        """Displacement R1 - R0 (3,) [m] in the latest step, accurate to all digits of a float."""
        with localcontext(_DIGITS):
            difference = [b - a for a, b in zip(self._R0, self._R1, strict=True)]
            return rounded(difference)

    def step(self, h: float, a: Array) -> None:
        """Compute the end of a step of length h [s] by (1) of the module, with 40 digits and an
        acceleration a (3,) [m/s²] in addition to 1/r gravity.

        It starts from the state that `keep` accepted last; R1 and V1 are replaced at each call.  A
        step so long that the iteration does not converge raises `InputError`.
        """
        with localcontext(_DIGITS):
            # Decimals: H the step length [s]; R0, R1, V0 positions [m] and velocity [m/s]; r0, r1
            # the lengths |R0| and |R1| [m].
            H = Decimal(h)
            acceleration = exact(a)
            R0 = self._R0
            V0 = self._V0
            r0 = _norm(R0)
            # The end of the step without gravity; eliminating V1 from (1) adds -½ h² σ R_mid to it.
            free = []
            for r, v, p in zip(R0, V0, acceleration, strict=True):
                free.append(r + H * v + H * H / 2 * p)
            R1 = free
            for _ in range(_ITERATIONS):
                r1 = _norm(R1)
                pull = H * H * self._mu / (2 * r0 * r1 * (r0 + r1))
                new = [f - pull * (b + c) for f, b, c in zip(free, R0, R1, strict=True)]
                change = max(abs(n - c) for n, c in zip(new, R1, strict=True))
                R1 = new
                if change < _TOLERANCE * r0:
                    break
            else:
                raise_too_long(h)
            self._R1 = R1
            # The second of equations (1), solved for V1.
            self._V1 = [2 * (c - b) / H - v for b, c, v in zip(R0, R1, V0, strict=True)]

    def keep(self) -> None:
        """Accept the step: its end is the start of the next one."""
        self._R0 = self._R1
        self._V0 = self._V1

    def gained(self) -> tuple[float, Array]:
        """Changes of ½|V|² - μ/|R| [m²/s²] and R×V (3,) [m²/s] from the start of the run to the
        start of the step."""
        with localcontext(_DIGITS):
            now = self._invariants()
            energy, *moment = (b - a for a, b in zip(self._first, now, strict=True))
            if abs(energy) < _ROUND_OFF * abs(self._first[0]):
                energy = Decimal(0)
        return float(energy), rounded(moment)

    def moment(self) -> Array:
        """R×V (3,) at the start of the step [m²/s]."""
        with localcontext(_DIGITS):
            return rounded(self._invariants()[1:])

    def _invariants(self) -> Exact:
        """½|V|² - μ/|R|, and the three components of R×V, at the start of the step."""
        (x, y, z), (u, v, w) = self._R0, self._V0
        return [
            (u * u + v * v + w * w) / 2 - self._mu / _norm(self._R0),
            y * w - z * v,
            z * u - x * w,
            x * v - y * u,
        ]

    def get_history(self) -> dict[str, Any]:
        """Decimal digits of "position" [m], "velocity" [m/s], and "first", the invariants at the
        start of the run."""
        names = {"position": self._R0, "velocity": self._V0, "first": self._first}
        return {name: [str(d) for d in numbers] for name, numbers in names.items()}

    def set_history(self, state: dict[str, Any]) -> None:
        self._R0 = [Decimal(digits) for digits in state["position"]]
        self._V0 = [Decimal(digits) for digits in state["velocity"]]
        self._first = [Decimal(digits) for digits in state["first"]]
        self._R1 = self._R0
        self._V1 = self._V0


def raise_too_long(h: float) -> None:
    """Raise `InputError` for a step of the length h [s]."""
    check(
        False,
        f"Orbit: a step of {h:.6g} s is too long a part of a revolution; "
        "make the stepper's dt smaller.",
    )


def exact(vector: Sequence[float] | Array) -> Exact:
    """The decimal numbers that equal the components of a vector."""
    return [Decimal(float(c)) for c in vector]


def rounded(vector: Exact) -> Array:
    """The floats nearest to the components of a vector."""
    return np.array([float(c) for c in vector])


def _norm(vector: Exact) -> Decimal:
    """Length of a vector."""
    return sum((c * c for c in vector), Decimal(0)).sqrt()


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
    """The origin of a flying frame in a run; `around` is what attracts and lights.

    Attributes:
        origin: its position and velocity at the ends of the step.
        moments: function that returns the moments of all bodies at the start of the step,
            collective; None until the bodies of the scene are compiled.
        time: of the middle of the step [s].
        R, V: position [m] and velocity [m/s] of the origin in the middle of the step, (3,) each.
        field: acceleration (3,) [m/s²] that the origin has there by all attraction in addition to
            the central body's 1/r.
        gradient: derivative (3, 3) [1/s²] of `field` with respect to R; zero without perturbation.
        pushed: acceleration (3,) [m/s²] of the origin by which it is kept near the bodies.
        centre: of mass in the middle of the last step, from the origin (3,) [m].
    """

    def __init__(self, around: Environment) -> None:
        self.around = around
        self.origin = Origin(*around.state, around.mu)
        self.moments: Callable[[], Moments] | None = None
        # Start and length [s] of the step that was computed last; None if it was accepted.
        self._prepared_step: tuple[float, float] | None = None
        self.time = 0.0
        self.R: Array = self.origin.R0
        self.V: Array = self.origin.V0
        self.field: Array = np.zeros(3)
        self.gradient: Array = np.zeros((3, 3))
        self.pushed: Array = np.zeros(3)
        self.centre: Array = np.zeros(3)

    def prepare(self, system: Assembly) -> None:
        """Compute the motion of the origin in the present step, once in every step.  The field acts
        at the middle of the step, which depends on the end; a fixed-point iteration solves that.
        Collective.  A step for which it does not converge raises `InputError`."""
        # Several loads share one flight; the first one prepares it.
        if self._prepared_step == (system.time, system.h):
            return
        around = self.around
        origin = self.origin
        h = system.h
        self.time = system.time + h / 2
        around.compare_sun(system.comm, self.time)
        self.pushed = self._acceleration_to_bodies(h)
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
        self._prepared_step = (system.time, h)

    def _acceleration_to_bodies(self, h: float) -> Array:
        """Acceleration (3,) [m/s²] that returns the origin to the centre of mass, critically
        damped, in a step of length h [s]; zeros before the bodies of the scene are known.
        Collective.

        It is S/(m T²) + 2 P/(m T), with mass m [kg], first moment S [kg m] and momentum P [kg m/s]
        of all bodies relative to the origin, and the time T = `following` [s], at least 5 steps.
        """
        if self.moments is None:
            return np.zeros(3)
        m = self.moments()
        T = max(self.around.following, SHORTEST_FOLLOWING * h)
        return (m.first / T**2 + 2 * m.momentum / T) / m.mass

    def state(self) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s], (3,) each, of the centre of mass of all bodies relative
        to the central body, at the start of the step.  Collective."""
        assert self.moments is not None
        m = self.moments()
        return self.origin.R0 + m.first / m.mass, self.origin.V0 + m.momentum / m.mass

    def light(self) -> tuple[Array, float]:
        """Unit vector (3,) along the sunlight, and its pressure on a black surface [N/m²], at the
        origin in the middle of the step."""
        return self.around.light(self.R, self.time)

    def keep(self) -> None:
        """Accept the step; nothing if none was computed since the last one."""
        if self._prepared_step is not None:
            self.origin.keep()
            self._prepared_step = None

    def get_history(self) -> dict[str, Any]:
        return {**self.origin.get_history(), "centre": self.centre.tolist()}

    def set_history(self, state: dict[str, Any]) -> None:
        self.origin.set_history(state)
        self.centre = np.array(state["centre"])
        self._prepared_step = None
