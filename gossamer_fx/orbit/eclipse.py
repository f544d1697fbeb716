"""The shadow of the Earth."""

from __future__ import annotations

import math

import numpy as np

from gossamer_fx.extend import Array
from gossamer_fx.orbit.gravity_field import RADIUS

AU, SUN_RADIUS = 149597870700.0, 6.957e8  # m


def shadow_depth(r: Array, sun: Array, radius: float = RADIUS) -> float:
    """How deep [m] a position r (3,) is in the cylinder behind the Earth; negative outside.

    On the night side radius - |r - (r·s)s|, elsewhere radius - |r|; continuous, so that an event finds its zero.
    """
    s = sun / np.linalg.norm(sun)
    along = float(r @ s)
    return radius - float(np.linalg.norm(r - min(along, 0.0) * s if along < 0 else r))


def sunlit_in_cylinder(r: Array, sun: Array, radius: float = RADIUS) -> float:
    """1 in light, 0 in the cylinder behind the Earth."""
    return 0.0 if shadow_depth(r, sun, radius) > 0 else 1.0


def sunlit_in_cone(r: Array, sun: Array, radius: float = RADIUS) -> float:
    """The part of the Sun's disc that the Earth leaves to be seen, of uniform brightness; both seen as circles.

    Args:
        r: position (3,) from the Earth's centre [m].
        sun: that of the Sun [m].

    Source: Montenbruck & Gill, Satellite Orbits (2000), section 3.4.2.
    """
    to_sun = sun - r
    disc = math.asin(SUN_RADIUS / float(np.linalg.norm(to_sun)))
    earth = math.asin(min(radius / float(np.linalg.norm(r)), 1.0))
    apart = math.atan2(float(np.linalg.norm(np.cross(-r, to_sun))), float(-r @ to_sun))
    if apart >= disc + earth:
        return 1.0
    if apart <= abs(earth - disc):
        return 0.0 if earth >= disc else 1 - (earth / disc) ** 2
    # the common area of two circles, on a plane
    x = (apart**2 + disc**2 - earth**2) / (2 * apart)
    y = math.sqrt(max(disc**2 - x**2, 0.0))
    common = disc**2 * math.acos(x / disc) + earth**2 * math.acos((apart - x) / earth) - apart * y
    return 1 - common / (math.pi * disc**2)
