"""Positions of Sun and Moon and orientation of the Earth at a date, by the library ERFA.

ERFA is the extra `orbit` of the package (pip install 'gossamer_fx[orbit]').
"""

from __future__ import annotations

from datetime import UTC, datetime
from functools import cached_property
from typing import Any

import numpy as np

from gossamer_fx.extend import Array, InputError, check
from gossamer_fx.mechanics.orbit.eclipse import AU

# Gravitational parameters [m³/s²].
MU_SUN = 1.32712440018e20
MU_MOON = 4.902800066e12

# Seconds of a day.
_DAY = 86400.0


class Sky:
    """Sun, Moon and orientation of the Earth as functions of the time t [s] since an epoch.

    Axes are those of the GCRS (equatorial, J2000).  Light time and aberration (20.5″) are
    neglected.

    Args:
        epoch: date in UTC, such as "2026-01-01" or "2026-01-01T12:00:00".
        ut1_utc: difference UT1 - UTC [s]; its magnitude is below 0.9 s.

    Raises:
        InputError: the date does not exist, or ERFA is not installed.
    """

    def __init__(self, epoch: str, ut1_utc: float = 0.0) -> None:
        try:
            self.start = datetime.fromisoformat(epoch).replace(tzinfo=UTC)
        except (TypeError, ValueError):
            raise InputError(
                f"epoch is {epoch!r}; give a date in UTC such as '2026-01-01T12:00:00'."
            ) from None
        check(abs(ut1_utc) < 1, f"ut1_utc is {ut1_utc!r} s; it is below 0.9 s.")
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
        position: Array = -AU * np.asarray(heliocentric["p"])
        return position

    def moon(self, t: float) -> Array:
        """Position (3,) [m] of the Moon from the Earth's centre, by ELP2000-82 as in ERFA's
        moon98."""
        geocentric = _erfa().moon98(self._tt[0], self._tt[1] + t / _DAY)
        position: Array = AU * np.asarray(geocentric["p"])
        return position

    def earth(self, t: float) -> Array:
        """Rotation matrix (3, 3) from GCRS to Earth-fixed axes, IAU 2006/2000A.

        Polar motion, below 1″, is neglected.
        """
        tt = (self._tt[0], self._tt[1] + t / _DAY)
        ut1 = (self._ut1[0], self._ut1[1] + t / _DAY)
        rotation: Array = np.asarray(_erfa().c2t06a(*tt, *ut1, 0.0, 0.0))
        return rotation


def _erfa() -> Any:
    """The module `erfa` (positions of Sun, Moon and Earth by date), which is optional.

    Raises:
        InputError: ERFA is not installed; the message names the package to install.
    """
    try:
        import erfa
    except ImportError:
        raise InputError(
            "The Sun, the Moon and the Earth's axes of a date come from ERFA, which is not "
            "installed; run "
            "pip install 'gossamer_fx[orbit]' (Debian: python3-erfa), or give the direction to the "
            "sun yourself."
        ) from None
    return erfa


def third_body(r: Array, body: Array, mu: float) -> Array:
    """Tidal acceleration (3,) [m/s²] by a distant body: that at r less that of the Earth's centre.

        μ [(b - r)/|b - r|³ - b/|b|³] = -μ/|b - r|³ (r + f b)

    where f is a function of q = r·(r - 2b)/|b|² in which nothing cancels.

    Args:
        r: position (3,) from the Earth's centre [m].
        body: position b (3,) of the body from there [m].
        mu: its gravitational parameter μ [m³/s²].

    Source: R. H. Battin, An Introduction to the Mathematics and Methods of Astrodynamics (1999),
    section 8.4, doi:10.2514/4.861543.
    """
    # d2: |b - r|² [m²].
    d2 = float((body - r) @ (body - r))
    # The plain difference of both terms would lose digits, as r is much shorter than b.
    q = float(r @ (r - 2 * body)) / float(body @ body)
    f = q * (3 + 3 * q + q * q) / (1 + (1 + q) ** 1.5)
    a: Array = -mu / d2**1.5 * (r + f * body)
    return a


def third_body_gradient(r: Array, body: Array, mu: float) -> Array:
    """Derivative (3, 3) [1/s²] of `third_body` with respect to r."""
    return -point_gradient(body - r, mu)


def point_gradient(r: Array, mu: float) -> Array:
    """Derivative μ/|r|³ (1 - 3 r̂ r̂ᵀ) (3, 3) [1/s²] of the vector μ r/|r|³.

    It is the negative gravity gradient at the position r (3,) [m] from a point mass.
    """
    d2 = float(r @ r)
    G: Array = mu / d2**1.5 * (np.eye(3) - 3 * np.outer(r, r) / d2)
    return G
