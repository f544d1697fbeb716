"""Keplerian orbital elements, and their conversion to and from positions and velocities."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, replace
from typing import Annotated

import numpy as np
from scipy.spatial.transform import Rotation

from gossamer_fx.core.checks.arguments import positive
from gossamer_fx.extend import Array, Range, Vector, check, check_arguments
from gossamer_fx.mechanics.orbit.harmonics import EARTH_MU

# Eccentricity, and sine of the inclination, below which the direction to perigee, or to the node,
# is round-off.
_SMALL = 1e-11

# Newton's method on Kepler's equation: largest number of iterations, and relative tolerance.
_KEPLER_ITERATIONS = 60
_KEPLER_TOLERANCE = 1e-15

# Eccentricity from which Newton's method starts at E = π, from where it converges for every
# anomaly.
_LARGE_ECCENTRICITY = 0.8


@check_arguments
@dataclass(frozen=True)
class Elements:
    """Osculating elements of an orbit: an ellipse (e < 1, a > 0) or a hyperbola (e > 1, a < 0).

    Args:
        a: semi-major axis [m].
        e: eccentricity.
        i: inclination [rad].
        node: right ascension of the ascending node [rad].
        perigee: argument of perigee [rad].
        anomaly: true anomaly [rad].

    Raises:
        InputError: a and e are of no orbit, or a value is not finite.

    Example:
        >>> gx.orbit.Elements(6.8e6, 0.001, i=0.9).e
        0.001
    """

    a: float
    e: float = 0.0
    _: KW_ONLY
    i: Annotated[float, Range(0.0, math.pi, "rad")] = 0.0
    node: float = 0.0
    perigee: float = 0.0
    anomaly: float = 0.0

    def __post_init__(self) -> None:
        check(
            self.e >= 0 and self.e != 1 and self.a * (1 - self.e) > 0,
            f"Elements: a is {self.a!r} m and e is {self.e!r}; "
            "give an ellipse (a > 0, e < 1) or a hyperbola (a < 0, e > 1).",
        )
        check(
            1 + self.e * math.cos(self.anomaly) > 0,
            "Elements: "
            f"the hyperbola of e = {self.e!r} has no point at the anomaly {self.anomaly!r} rad; "
            "give one closer to perigee.",
        )

    @check_arguments
    def motion(self, mu: Annotated[float, positive("m³/s²")] = EARTH_MU) -> float:
        """Mean motion n = √(μ/|a|³) [rad/s]."""
        return math.sqrt(mu / abs(self.a) ** 3)

    @check_arguments
    def period(self, mu: Annotated[float, positive("m³/s²")] = EARTH_MU) -> float:
        """2π/n [s] of an ellipse."""
        return 2 * math.pi / self.motion(mu)

    @check_arguments
    def state(self, mu: Annotated[float, positive("m³/s²")] = EARTH_MU) -> tuple[Array, Array]:
        """Position (3,) [m] and velocity (3,) [m/s] at the true anomaly, relative to the central
        body with the gravitational parameter `mu` [m³/s²], by default the Earth."""
        # p: semi-latus rectum [m]; r, v: position [m] and velocity [m/s] in the axes of the orbit;
        # R: rotation to the axes of the scene.
        p = self.a * (1 - self.e**2)
        cosine = math.cos(self.anomaly)
        sine = math.sin(self.anomaly)
        r = p / (1 + self.e * cosine) * np.array([cosine, sine, 0.0])
        v = math.sqrt(mu / p) * np.array([-sine, self.e + cosine, 0.0])
        # From the axes of the orbit (x to perigee, z normal to the orbit) to the axes of the scene.
        R = Rotation.from_euler("ZXZ", [self.node, self.i, self.perigee]).as_matrix()
        return R @ r, R @ v

    @check_arguments
    def after(self, t: float, mu: Annotated[float, positive("m³/s²")] = EARTH_MU) -> Elements:
        """The elements t seconds later, without perturbations (Kepler's equation)."""
        M = self._mean_anomaly() + self.motion(mu) * t
        return replace(self, anomaly=_true_anomaly(M, self.e))

    def _mean_anomaly(self) -> float:
        """Mean anomaly [rad] by Kepler's equation, M = E - e sin E with the eccentric anomaly E of
        an ellipse, or M = e sinh H - H with H of a hyperbola."""
        e = self.e
        half = self.anomaly / 2
        if e < 1:
            E = 2 * math.atan2(
                math.sqrt(1 - e) * math.sin(half),
                math.sqrt(1 + e) * math.cos(half),
            )
            return E - e * math.sin(E)
        H = 2 * math.atanh(math.sqrt((e - 1) / (e + 1)) * math.tan(half))
        return e * math.sinh(H) - H


@check_arguments
def elements_of(
    r: Vector | Array, v: Vector | Array, mu: Annotated[float, positive("m³/s²")] = EARTH_MU
) -> Elements:
    """Osculating elements of a position and a velocity.

    The perigee of a circle (e below 1e-11) is set to its node, the node of an equatorial orbit
    (sine of the inclination below 1e-11) to the x axis.

    Args:
        r: position (3,) [m] from the centre.
        v: velocity (3,) [m/s].
        mu: gravitational parameter [m³/s²].

    Raises:
        InputError: a straight line (sine of the angle between r and v below 1e-9) or a parabola
            (energy below 1e-14 μ/|r|).

    Example:
        >>> position, velocity = gx.orbit.Elements(7e6, 0.1).state()
        >>> round(gx.orbit.elements_of(position, velocity).e, 12)
        0.1
    """
    r = np.asarray(r, dtype=float)
    v = np.asarray(v, dtype=float)
    distance = float(np.linalg.norm(r))
    # Angular momentum per mass (3,) [m²/s].
    L = np.cross(r, v)
    check(
        float(np.linalg.norm(L)) > 1e-9 * distance * float(np.linalg.norm(v)),
        "A body that falls straight down has no elements; give it a velocity across.",
    )
    energy = float(v @ v) / 2 - mu / distance
    check(
        abs(energy) > 1e-14 * mu / distance,
        "A parabola has no semi-major axis; change the speed a little.",
    )
    # Eccentricity vector.  This form has no difference that cancels for circles.
    towards_perigee = ((v @ v) - mu / distance) * r / mu - float(r @ v) * v / mu
    e = float(np.linalg.norm(towards_perigee))
    normal = L / np.linalg.norm(L)
    x_axis = np.array([1.0, 0.0, 0.0])
    z_axis = np.array([0.0, 0.0, 1.0])

    towards_node = np.array([-normal[1], normal[0], 0.0])
    sine = float(np.linalg.norm(towards_node))
    to_node = x_axis
    if sine > _SMALL:
        to_node = towards_node / sine

    to_perigee = to_node
    eccentricity = 0.0
    if e > _SMALL:
        to_perigee = towards_perigee / e
        eccentricity = e

    return Elements(
        a=-mu / (2 * energy),
        e=eccentricity,
        i=math.atan2(sine, float(normal[2])),
        node=_angle(x_axis, to_node, z_axis),
        perigee=_angle(to_node, to_perigee, normal),
        anomaly=_angle(to_perigee, r / distance, normal),
    )


def _angle(a: Array, b: Array, axis: Array) -> float:
    """Angle [rad] from a to b (3,) about a unit axis (3,) perpendicular to both, in [0, 2π)."""
    sine = float(axis @ np.cross(a, b))
    cosine = float(a @ b)
    return math.atan2(sine, cosine) % (2 * math.pi)


def _true_anomaly(M: float, e: float) -> float:
    """True anomaly, in -π to π, of a mean anomaly M [rad], by Newton's method on Kepler's equation.
    The iteration ends at a change below round-off or after 60 iterations, without an error."""
    if e < 1:
        # E: eccentric anomaly [rad] of an ellipse; H below: that of a hyperbola.
        M = math.remainder(M, 2 * math.pi)
        E = M
        # Kepler's equation is nearly singular at perigee of such an ellipse.
        if e >= _LARGE_ECCENTRICITY:
            E = math.copysign(math.pi, M)
        for _ in range(_KEPLER_ITERATIONS):
            change = (E - e * math.sin(E) - M) / (1 - e * math.cos(E))
            E -= change
            if abs(change) < _KEPLER_TOLERANCE:
                break
        return 2 * math.atan2(
            math.sqrt(1 + e) * math.sin(E / 2),
            math.sqrt(1 - e) * math.cos(E / 2),
        )
    H = math.asinh(M / e)
    for _ in range(_KEPLER_ITERATIONS):
        change = (e * math.sinh(H) - H - M) / (e * math.cosh(H) - 1)
        H -= change
        if abs(change) < _KEPLER_TOLERANCE * max(1.0, abs(H)):
            break
    return 2 * math.atan(math.sqrt((e + 1) / (e - 1)) * math.tanh(H / 2))
