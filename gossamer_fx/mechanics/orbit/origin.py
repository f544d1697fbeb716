"""Orbit of the origin of the frame in which a flying scene is computed.

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

from collections.abc import Sequence
from decimal import Context, Decimal, localcontext
from typing import Any

import numpy as np

from gossamer_fx.extend import Array, check

# A vector of three numbers.
Exact = list[Decimal]

# Decimal digits of the origin's position and velocity; see the module.
_DIGITS = Context(prec=40)

# The fixed-point iteration for a step: relative tolerance, well below the digits of a float, and
# largest number of iterations, which only steps of a large part of a revolution need.
_TOLERANCE = Decimal(10) ** -32
_ITERATIONS = 200


class Origin:
    """Position R and velocity V of the origin at the start and the end of a step.

    Args:
        r: position (3,) at the start of the run [m].
        v: velocity (3,) there [m/s].
        mu: gravitational parameter of the central body [m³/s²].

    >>> import numpy as np
    >>> origin = Origin(np.array([7e6, 0.0, 0.0]), np.array([0.0, 7546.0, 0.0]), mu=3.986e14)
    >>> origin.step(1.0, np.zeros(3))
    >>> origin.keep()
    >>> energy, moment = origin.gained()
    >>> bool(abs(energy) < 1e-20)
    True
    """

    def __init__(self, r: Array, v: Array, mu: float) -> None:
        """Convert position r (3,) [m] and velocity v (3,) [m/s] to decimals of 40 digits.

        `gained` counts from the energy and angular momentum of this state.  `mu` is the
        gravitational parameter of the central body [m³/s²].
        """
        self.mu = mu
        self._mu = Decimal(mu)
        self._R0 = exact(r)
        self._V0 = exact(v)
        self._R1 = self._R0
        self._V1 = self._V0
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
        """Compute the end of a step of the midpoint rule, with 40 digits; `keep` accepts it.

            (V1 - V0)/h = -σ (R0 + R1)/2 + a,    (R1 - R0)/h = (V0 + V1)/2

        R is the position [m] and V the velocity [m/s] of the origin at the start (0) and the end
        (1) of the step; σ = 2μ/(|R0||R1|(|R0| + |R1|)) gives the exact average of 1/r gravity.

        The step starts from the state that `keep` accepted last; R1 and V1 are replaced at each
        call.

        Args:
            h: length of the step [s].
            a: acceleration (3,) in addition to 1/r gravity [m/s²].

        Raises:
            InputError: the step is so long that the iteration does not converge.
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
        """Changes of ½|V|² - μ/|R| [m²/s²] and R×V (3,) [m²/s] since the start of the run.

        They are taken at the start of the step.
        """
        with localcontext(_DIGITS):
            now = self._invariants()
            energy, *moment = (float(b - a) for a, b in zip(self._first, now, strict=True))
        return energy, np.array(moment)

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

    def get_state(self) -> dict[str, Any]:
        names = {"position": self._R0, "velocity": self._V0, "first": self._first}
        return {name: [str(d) for d in numbers] for name, numbers in names.items()}

    def set_state(self, state: dict[str, Any]) -> None:
        self._R0 = [Decimal(digits) for digits in state["position"]]
        self._V0 = [Decimal(digits) for digits in state["velocity"]]
        self._first = [Decimal(digits) for digits in state["first"]]
        self._R1 = self._R0
        self._V1 = self._V0


def raise_too_long(h: float) -> None:
    """Raise `InputError` for a step of the length h [s]."""
    check(
        False,
        f"Orbit: a step of {h:.6g} s is too long a part of a revolution; make the stepper's dt "
        "smaller.",
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
