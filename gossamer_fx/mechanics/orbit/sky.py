"""The sky around an orbit: the shadow of the Earth, positions of Sun and Moon and orientation of
the Earth at a date, and the tidal acceleration by Sun and Moon.

Dates need the library ERFA, the extra `orbit` of the package (pip install 'gossamer_fx[orbit]').
"""

from __future__ import annotations

import math
from datetime import UTC, datetime
from functools import cached_property
from typing import Any

import numpy as np

from gossamer_fx.extend import Array, InputError, check
from gossamer_fx.mechanics.orbit.harmonics import EARTH_RADIUS

# Astronomical unit, and radius of the Sun [m].
AU = 149597870700.0
SUN_RADIUS = 6.957e8


def shadow_depth(r: Array, sun: Array, radius: float = EARTH_RADIUS) -> float:
    """Depth [m] of a position r (3,) [m] from the Earth's centre in the cylindrical shadow of a
    radius [m]; negative in light.  `sun` (3,) is the position of the Sun, or a direction to it of
    any length.

    On the night side it is radius - |r - (r·s) s|, with the direction s to the Sun; on the day side
    radius - |r|.  It is continuous, so that a root finder can locate the entry and the exit.

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


def sunlit_in_cylinder(r: Array, sun: Array, radius: float = EARTH_RADIUS) -> float:
    """1 in light, 0 in the cylindrical shadow; the arguments are those of `shadow_depth`."""
    if shadow_depth(r, sun, radius) > 0:
        return 0.0
    return 1.0


def sunlit_in_cone(r: Array, sun: Array, radius: float = EARTH_RADIUS) -> float:
    """Fraction of the Sun's disc that is visible from r (3,) [m], 1 in light and 0 in the umbra;
    `sun` (3,) [m] is the position of the Sun, both from the Earth's centre, and `radius` [m] that
    of the Earth.

    Sun and Earth are seen as circles, and the Sun's disc has uniform brightness.  An annular
    eclipse gives a value between 0 and 1.

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


# Gravitational parameters [m³/s²].
MU_SUN = 1.32712440018e20
MU_MOON = 4.902800066e12

# Seconds of a day.
_DAY = 86400.0


class Sky:
    """Sun, Moon and orientation of the Earth as functions of the time t [s] since an epoch, a date
    in UTC such as "2026-01-01" or "2026-01-01T12:00:00".

    Axes are those of the GCRS (equatorial, J2000).  Light time and aberration (20.5″) are
    neglected.  `ut1_utc` [s] is the difference UT1 - UTC, below 0.9 s.  A date that does not exist
    raises `InputError`.
    """

    def __init__(self, epoch: str, ut1_utc: float = 0.0) -> None:
        try:
            start = datetime.fromisoformat(epoch)
        except (TypeError, ValueError):
            raise InputError(
                f"epoch is {epoch!r}; give a date in UTC such as '2026-01-01T12:00:00'."
            ) from None
        # A date without an offset is one in UTC.
        if start.tzinfo is None:
            start = start.replace(tzinfo=UTC)
        self.start = start.astimezone(UTC)
        check(abs(ut1_utc) < 0.9, f"ut1_utc is {ut1_utc!r} s; give a difference below 0.9 s.")
        erfa = _erfa()
        s = self.start
        seconds = s.second + s.microsecond * 1e-6
        # Julian dates are pairs of numbers whose sum is the date, so that no digits are lost.
        utc = erfa.dtf2d("UTC", s.year, s.month, s.day, s.hour, s.minute, seconds)
        self._tt = erfa.taitt(*erfa.utctai(*utc))
        self._ut1 = erfa.utcut1(*utc, ut1_utc)

    @cached_property
    def year(self) -> float:
        """The epoch in years, with fraction."""
        first = datetime(self.start.year, 1, 1, tzinfo=UTC)
        return self.start.year + (self.start - first).total_seconds() / (365.25 * _DAY)

    def sun(self, t: float) -> Array:
        """Position (3,) [m] of the Sun from the Earth's centre, by VSOP2000 as in ERFA's epv00."""
        heliocentric, _ = _erfa().epv00(self._tt[0], self._tt[1] + t / _DAY)
        return -AU * np.asarray(heliocentric["p"])

    def moon(self, t: float) -> Array:
        """Position (3,) [m] of the Moon from the Earth's centre, by ELP2000-82 as in ERFA's
        moon98."""
        geocentric = _erfa().moon98(self._tt[0], self._tt[1] + t / _DAY)
        return AU * np.asarray(geocentric["p"])

    def earth(self, t: float) -> Array:
        """Rotation matrix (3, 3) from GCRS to Earth-fixed axes, IAU 2006/2000A.  Polar motion,
        below 1″, is neglected."""
        tt = (self._tt[0], self._tt[1] + t / _DAY)
        ut1 = (self._ut1[0], self._ut1[1] + t / _DAY)
        return np.asarray(_erfa().c2t06a(*tt, *ut1, 0.0, 0.0))


def _erfa() -> Any:
    """The module `erfa` (positions of Sun, Moon and Earth by date), which is optional; `InputError`
    names the package to install."""
    try:
        import erfa
    except ImportError:
        raise InputError(
            "The Sun, the Moon and the Earth's axes of a date come from ERFA, "
            "which is not installed; run pip install 'gossamer_fx[orbit]' (Debian: python3-erfa), "
            "or give the direction to the sun yourself."
        ) from None
    return erfa


def third_body(r: Array, body: Array, mu: float) -> Array:
    """Tidal acceleration (3,) [m/s²] by a distant body: that at r less that of the Earth's centre.

        μ [(b - r)/|b - r|³ - b/|b|³] = -μ/|b - r|³ (r + f b)

    where f is a function of q = r·(r - 2b)/|b|² in which nothing cancels.  r and b (3,) [m] are
    positions from the Earth's centre, of which b is that of the body with the gravitational
    parameter μ [m³/s²].

    Source: R. H. Battin, An Introduction to the Mathematics and Methods of Astrodynamics (1999),
    section 8.4, doi:10.2514/4.861543.
    """
    # d2: |b - r|² [m²].
    d2 = float((body - r) @ (body - r))
    # The plain difference of both terms would lose digits, as r is much shorter than b.
    q = float(r @ (r - 2 * body)) / float(body @ body)
    f = q * (3 + 3 * q + q * q) / (1 + (1 + q) ** 1.5)
    return -mu / d2**1.5 * (r + f * body)


def third_body_gradient(r: Array, body: Array, mu: float) -> Array:
    """Derivative (3, 3) [1/s²] of `third_body` with respect to r."""
    return -point_gradient(body - r, mu)


def point_gradient(r: Array, mu: float) -> Array:
    """Derivative μ/|r|³ (1 - 3 r̂ r̂ᵀ) (3, 3) [1/s²] of the vector μ r/|r|³: the negative gravity
    gradient at r (3,) [m] from a point mass."""
    d2 = float(r @ r)
    return mu / d2**1.5 * (np.eye(3) - 3 * np.outer(r, r) / d2)
