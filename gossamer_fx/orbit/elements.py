"""Orbital elements, and states made of them."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, replace

import numpy as np

from gossamer_fx.extend import Array, check, check_arguments
from gossamer_fx.orbit.gravity_field import MU

_SMALL = 1e-11  # eccentricity and sine of the inclination below which an angle has no meaning


@check_arguments
@dataclass(frozen=True)
class Elements:
    """Osculating elements of an ellipse (e < 1, a > 0) or a hyperbola (e > 1, a < 0).

    Args:
        a: semi-major axis [m].
        e: eccentricity.
        i: inclination [rad].
        node: right ascension of the ascending node [rad].
        perigee: argument of perigee [rad].
        anomaly: true anomaly [rad].
    """

    a: float
    e: float = 0.0
    _: KW_ONLY
    i: float = 0.0
    node: float = 0.0
    perigee: float = 0.0
    anomaly: float = 0.0

    def __post_init__(self) -> None:
        check(
            self.e >= 0 and self.e != 1 and self.a * (1 - self.e) > 0,
            f"Elements: a is {self.a!r} m and e is {self.e!r}; give an ellipse (a > 0, e < 1) or a hyperbola (a < 0, "
            "e > 1).",
        )
        check(
            0 <= self.i <= math.pi,
            f"Elements: i is {self.i!r} rad; an inclination is between 0 and pi.",
        )
        check(
            1 + self.e * math.cos(self.anomaly) > 0,
            f"Elements: the hyperbola of e = {self.e!r} has no point at the anomaly {self.anomaly!r} rad; give one "
            "closer to perigee.",
        )

    def motion(self, mu: float = MU) -> float:
        """Mean motion n = √(μ/|a|³) [rad/s]."""
        return math.sqrt(mu / abs(self.a) ** 3)

    def period(self, mu: float = MU) -> float:
        """2π/n [s] of an ellipse."""
        return 2 * math.pi / self.motion(mu)

    def state(self, mu: float = MU) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s], (3,) each."""
        p = self.a * (1 - self.e**2)
        cosine, sine = math.cos(self.anomaly), math.sin(self.anomaly)
        r = p / (1 + self.e * cosine) * np.array([cosine, sine, 0.0])
        v = math.sqrt(mu / p) * np.array([-sine, self.e + cosine, 0.0])
        R = _about(2, self.node) @ _about(0, self.i) @ _about(2, self.perigee)
        return R @ r, R @ v

    def after(self, t: float, mu: float = MU) -> Elements:
        """The elements t seconds later, without perturbations (Kepler's equation)."""
        M = self._mean_anomaly() + self.motion(mu) * t
        return replace(self, anomaly=_true_anomaly(M, self.e))

    def _mean_anomaly(self) -> float:
        e, half = self.e, self.anomaly / 2
        if e < 1:
            E = 2 * math.atan2(
                math.sqrt(1 - e) * math.sin(self.anomaly / 2),
                math.sqrt(1 + e) * math.cos(self.anomaly / 2),
            )
            return E - e * math.sin(E)
        H = 2 * math.atanh(math.sqrt((e - 1) / (e + 1)) * math.tan(half))
        return e * math.sinh(H) - H


def elements_of(r: Array, v: Array, mu: float = MU) -> Elements:
    """The elements of a position r [m] and velocity v [m/s].

    Of a circle, perigee is put at the node; of an equatorial orbit, the node on the x axis.

    Raises:
        InputError: a straight line or a parabola has no such elements.
    """
    r, v = np.asarray(r, dtype=float), np.asarray(v, dtype=float)
    distance, L = float(np.linalg.norm(r)), np.cross(r, v)
    check(
        float(np.linalg.norm(L)) > 1e-9 * distance * float(np.linalg.norm(v)),
        "A body that falls straight down has no elements; give it a velocity across.",
    )
    energy = float(v @ v) / 2 - mu / distance
    check(
        abs(energy) > 1e-14 * mu / distance,
        "A parabola has no semi-major axis; change the speed a little.",
    )
    # the eccentricity vector from r·v and 2E + μ/r, whose difference does not cancel for circles
    ecc = ((v @ v) - mu / distance) * r / mu - float(r @ v) * v / mu
    e, normal = float(np.linalg.norm(ecc)), L / np.linalg.norm(L)
    to_node = np.array([-normal[1], normal[0], 0.0])
    sine = float(np.linalg.norm(to_node))
    to_node = to_node / sine if sine > _SMALL else np.array([1.0, 0.0, 0.0])
    to_perigee = ecc / e if e > _SMALL else to_node
    return Elements(
        a=-mu / (2 * energy),
        e=e if e > _SMALL else 0.0,
        i=math.atan2(sine, float(normal[2])),
        node=_angle(np.array([1.0, 0, 0]), to_node, np.array([0.0, 0, 1])),
        perigee=_angle(to_node, to_perigee, normal),
        anomaly=_angle(to_perigee, r / distance, normal),
    )


def _angle(a: Array, b: Array, axis: Array) -> float:
    """From a to b about an axis [rad], in [0, 2π)."""
    return math.atan2(float(axis @ np.cross(a, b)), float(a @ b)) % (2 * math.pi)


def _about(axis: int, angle: float) -> Array:
    """Rotation matrix about a coordinate axis."""
    c, s, R = math.cos(angle), math.sin(angle), np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


def _true_anomaly(M: float, e: float) -> float:
    """Of a mean anomaly, by Newton's method on Kepler's equation."""
    if e < 1:
        M = math.remainder(M, 2 * math.pi)
        E = M if e < 0.8 else math.copysign(math.pi, M)
        for _ in range(60):
            change = (E - e * math.sin(E) - M) / (1 - e * math.cos(E))
            E -= change
            if abs(change) < 1e-15:
                break
        return 2 * math.atan2(
            math.sqrt(1 + e) * math.sin(E / 2), math.sqrt(1 - e) * math.cos(E / 2)
        )
    H = math.asinh(M / e)
    for _ in range(60):
        change = (e * math.sinh(H) - H - M) / (e * math.cosh(H) - 1)
        H -= change
        if abs(change) < 1e-15 * max(1.0, abs(H)):
            break
    return 2 * math.atan(math.sqrt((e + 1) / (e - 1)) * math.tanh(H / 2))
