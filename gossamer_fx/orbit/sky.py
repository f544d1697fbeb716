"""Where Sun and Moon are and how the Earth is turned, by ERFA (the extra `orbit` of the package)."""

from __future__ import annotations

from datetime import UTC, datetime
from functools import cached_property
from typing import Any

import numpy as np

from gossamer_fx.extend import Array, InputError, check
from gossamer_fx.orbit.eclipse import AU

MU_SUN, MU_MOON = 1.32712440018e20, 4.902800066e12  # m³/s²
_DAY = 86400.0


class Sky:
    """Sun, Moon and Earth's orientation as functions of the time t [s] since an epoch.

    Axes are those of the GCRS (equatorial, J2000); light time and aberration (20.5″) are left out.

    Args:
        epoch: UTC, e.g. "2026-01-01" or "2026-01-01T12:00:00".
        ut1_utc: [s], below 0.9 s.

    Raises:
        InputError: no such date, or ERFA is not installed.
    """

    def __init__(self, epoch: str, ut1_utc: float = 0.0) -> None:
        try:
            self.start = datetime.fromisoformat(epoch).replace(tzinfo=UTC)
        except (TypeError, ValueError):
            raise InputError(
                f"epoch is {epoch!r}; give a date in UTC such as '2026-01-01T12:00:00'."
            ) from None
        check(abs(ut1_utc) < 1, f"ut1_utc is {ut1_utc!r} s; it is below 0.9 s.")
        erfa, s = _erfa(), self.start
        day = s.second + s.microsecond * 1e-6
        utc = erfa.dtf2d("UTC", s.year, s.month, s.day, s.hour, s.minute, day)
        self._tt = erfa.taitt(*erfa.utctai(*utc))
        self._ut1 = erfa.utcut1(*utc, ut1_utc)

    @cached_property
    def year(self) -> float:
        """The epoch in years, with fraction."""
        first = datetime(self.start.year, 1, 1, tzinfo=UTC)
        return self.start.year + (self.start - first).total_seconds() / (365.25 * _DAY)

    def sun(self, t: float) -> Array:
        """From the Earth's centre to the Sun's (3,) [m]; VSOP2000 as simplified by ERFA's epv00."""
        heliocentric, _ = _erfa().epv00(self._tt[0], self._tt[1] + t / _DAY)
        position: Array = -AU * np.asarray(heliocentric["p"])
        return position

    def moon(self, t: float) -> Array:
        """From the Earth's centre to the Moon's (3,) [m]; Meeus' abridged ELP2000-82, ERFA's moon98."""
        position: Array = AU * np.asarray(_erfa().moon98(self._tt[0], self._tt[1] + t / _DAY)["p"])
        return position

    def earth(self, t: float) -> Array:
        """Rotation matrix (3, 3) from GCRS to Earth-fixed axes; IAU 2006/2000A without polar motion."""
        tt, ut1 = (self._tt[0], self._tt[1] + t / _DAY), (self._ut1[0], self._ut1[1] + t / _DAY)
        rotation: Array = np.asarray(_erfa().c2t06a(*tt, *ut1, 0.0, 0.0))
        return rotation


def _erfa() -> Any:
    try:
        import erfa
    except ImportError:
        raise InputError(
            "The Sun, the Moon and the Earth's axes of a date come from ERFA, which is not installed; run "
            "pip install 'gossamer_fx[orbit]' (Debian: python3-erfa), or give the direction to the sun yourself."
        ) from None
    return erfa


def third_body(r: Array, body: Array, mu: float) -> Array:
    """Acceleration (3,) [m/s²] by a distant body at r, less that of the Earth's centre.

    μ [(b - r)/|b - r|³ - b/|b|³] = -μ/d³ (r + f b), with f from q = r·(r - 2b)/|b|² so that nothing cancels.

    Source: Battin, An Introduction to the Mathematics and Methods of Astrodynamics (1999), section 8.4.
    """
    d2, q = float((body - r) @ (body - r)), float(r @ (r - 2 * body)) / float(body @ body)
    f = q * (3 + 3 * q + q * q) / (1 + (1 + q) ** 1.5)
    a: Array = -mu / d2**1.5 * (r + f * body)
    return a


def third_body_gradient(r: Array, body: Array, mu: float) -> Array:
    """Its derivative (3, 3) with respect to r [1/s²]."""
    return -point_gradient(body - r, mu)


def point_gradient(r: Array, mu: float) -> Array:
    """μ/|r|³ (1 - 3 r̂ r̂ᵀ) (3, 3): what the attraction of a point grows by with distance from it [1/s²]."""
    d2 = float(r @ r)
    G: Array = mu / d2**1.5 * (np.eye(3) - 3 * np.outer(r, r) / d2)
    return G
