"""The point that the frame of a flying scene is attached to, and its orbit.

The frame does not turn.  Its origin R obeys the rule of the bodies, with the exact average of 1/r gravity over a step,

    (V1 - V0)/h = -σ(R0, R1) R̄ + a,   (R1 - R0)/h = (V0 + V1)/2,   σ(b, c) = 2μ/(|b||c|(|b| + |c|))

so that ½|V|² - μ/|R| grows by a·(R1 - R0) and R×V by h R̄×a, exactly.  The acceleration a is whatever keeps the origin
near the bodies: the motion of the whole does not depend on it.

Energies of an orbit are 1e8 times those of a sail's motion.  So that both are told in one ledger, the six numbers of
the origin are carried with 40 digits; this costs less than a millisecond a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Context, Decimal, localcontext
from typing import Any

import numpy as np

from gossamer_fx.extend import Array, check

Exact = list[Decimal]  # a vector

_DIGITS = Context(prec=40)
_ITERATIONS = 200


class Origin:
    """Position R [m] and velocity V [m/s] at the start of a step, and at its end once it was made.

    Args:
        r, v: at the start, (3,).
        mu: of the central body [m³/s²].
    """

    def __init__(self, r: Array, v: Array, mu: float) -> None:
        self.mu, self._mu = mu, Decimal(mu)
        self._R0, self._V0 = exact(r), exact(v)
        self._R1, self._V1 = self._R0, self._V0
        with localcontext(_DIGITS):
            self._first = self._invariants()

    @property
    def R0(self) -> Array:
        return rounded(self._R0)

    @property
    def V0(self) -> Array:
        return rounded(self._V0)

    @property
    def R1(self) -> Array:
        return rounded(self._R1)

    @property
    def moved(self) -> Array:
        """R1 - R0 of the step that was made last [m]."""
        with localcontext(_DIGITS):
            return rounded([b - a for a, b in zip(self._R0, self._R1, strict=True)])

    def step(self, h: float, a: Array) -> None:
        """Make the step of length h with the acceleration a (3,); it counts once it is kept.

        Raises:
            InputError: h is so long that the equation of the step is not solved by iteration.
        """
        with localcontext(_DIGITS):
            H, pushed, R0, V0 = Decimal(h), exact(a), self._R0, self._V0
            r0 = _norm(R0)
            free = [r + H * v + H * H / 2 * p for r, v, p in zip(R0, V0, pushed, strict=True)]
            R1, small = free, Decimal(10) ** -32 * r0
            for _ in range(_ITERATIONS):
                r1 = _norm(R1)
                pull = H * H * self._mu / (2 * r0 * r1 * (r0 + r1))
                new = [f - pull * (b + c) for f, b, c in zip(free, R0, R1, strict=True)]
                change = max(abs(n - c) for n, c in zip(new, R1, strict=True))
                R1 = new
                if change < small:
                    break
            else:
                raise_too_long(h)
            self._R1 = R1
            self._V1 = [2 * (c - b) / H - v for b, c, v in zip(R0, R1, V0, strict=True)]

    def keep(self) -> None:
        """The end of the step is the start of the next."""
        self._R0, self._V0 = self._R1, self._V1

    def gained(self) -> tuple[float, Array]:
        """What ½|V|² - μ/|R| [m²/s²] and R×V (3,) [m²/s] at the start of the step are more than at the very start."""
        with localcontext(_DIGITS):
            now = self._invariants()
            energy, *moment = (float(b - a) for a, b in zip(self._first, now, strict=True))
        return energy, np.array(moment)

    def moment(self) -> Array:
        """R×V (3,) at the start of the step [m²/s]."""
        with localcontext(_DIGITS):
            return rounded(self._invariants()[1:])

    def _invariants(self) -> Exact:
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
        self._R0, self._V0, self._first = (
            [Decimal(d) for d in state[n]] for n in ("position", "velocity", "first")
        )
        self._R1, self._V1 = self._R0, self._V0


def raise_too_long(h: float) -> None:
    check(
        False,
        f"Orbit: a step of {h:.6g} s is too long a part of a revolution; make the stepper's dt smaller.",
    )


def exact(vector: Sequence[float] | Array) -> Exact:
    return [Decimal(float(c)) for c in vector]


def rounded(vector: Exact) -> Array:
    return np.array([float(c) for c in vector])


def _norm(vector: Exact) -> Decimal:
    return sum((c * c for c in vector), Decimal(0)).sqrt()
