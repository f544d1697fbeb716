"""Shadow of the Earth: whether, and by how much, it covers the Sun."""

from __future__ import annotations

import math

import numpy as np

from gossamer_fx.extend import Array
from gossamer_fx.mechanics.orbit.gravity_field import RADIUS

# Astronomical unit, and radius of the Sun [m].
AU = 149597870700.0
SUN_RADIUS = 6.957e8


def shadow_depth(r: Array, sun: Array, radius: float = RADIUS) -> float:
    """Depth [m] of a position in the cylindrical shadow of the Earth; negative in light.

    On the night side it is radius - |r - (r·s) s|, with the direction s to the Sun; on the day side
    radius - |r|.  It is continuous, so that a root finder can locate the entry and the exit.

    Args:
        r: position (3,) from the Earth's centre [m].
        sun: position (3,) of the Sun [m], or direction to it of any length, not zero.
        radius: radius of the Earth [m].

    >>> import numpy as np
    >>> shadow_depth(np.array([-7000e3, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), radius=6400e3)
    6400000.0
    """
    s = sun / np.linalg.norm(sun)
    along = float(r @ s)
    across = r
    if along < 0:
        across = r - along * s
    return radius - float(np.linalg.norm(across))


def sunlit_in_cylinder(r: Array, sun: Array, radius: float = RADIUS) -> float:
    """1 in light, 0 in the cylindrical shadow; the arguments are those of `shadow_depth`."""
    if shadow_depth(r, sun, radius) > 0:
        return 0.0
    return 1.0


def sunlit_in_cone(r: Array, sun: Array, radius: float = RADIUS) -> float:
    """Part of the Sun's disc that is visible, 1 in light and 0 in the umbra; dimensionless.

    Sun and Earth are seen as circles, and the Sun's disc has uniform brightness.  An annular
    eclipse gives a value between 0 and 1.

    Args:
        r: position (3,) from the Earth's centre [m], not zero.
        sun: position (3,) of the Sun from there [m].
        radius: radius of the Earth [m].

    Source: O. Montenbruck & E. Gill, Satellite Orbits (2000), section 3.4.2,
    doi:10.1007/978-3-642-58351-3.

    >>> import numpy as np
    >>> sunlit_in_cone(np.array([-7000e3, 0.0, 0.0]), np.array([AU, 0.0, 0.0]))
    0.0
    """
    to_sun = sun - r
    # Angular radii of both discs, and the angle between their centres [rad].
    sun_disc = math.asin(SUN_RADIUS / float(np.linalg.norm(to_sun)))
    earth_disc = math.asin(min(radius / float(np.linalg.norm(r)), 1.0))
    sine = float(np.linalg.norm(np.cross(-r, to_sun)))
    cosine = float(-r @ to_sun)
    apart = math.atan2(sine, cosine)
    if apart >= sun_disc + earth_disc:
        return 1.0
    if apart <= abs(earth_disc - sun_disc):
        # One disc lies within the other: total or annular eclipse.
        if earth_disc >= sun_disc:
            return 0.0
        return 1 - (earth_disc / sun_disc) ** 2
    # The common area of two circles in a plane; x is the distance of their chord from the Sun's
    # centre.
    x = (apart**2 + sun_disc**2 - earth_disc**2) / (2 * apart)
    y = math.sqrt(max(sun_disc**2 - x**2, 0.0))
    sun_sector = sun_disc**2 * math.acos(x / sun_disc)
    earth_sector = earth_disc**2 * math.acos((apart - x) / earth_disc)
    common = sun_sector + earth_sector - apart * y
    return 1 - common / (math.pi * sun_disc**2)
