"""Gravity field of the Earth beyond a point mass: oblateness J2, or EGM2008 to degree 20."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

import numpy as np

from gossamer_fx.extend import check
from gossamer_fx.mechanics.orbit.harmonics import Coefficients, SolidHarmonics, unnormalise

# Gravitational parameter [m³/s²] and equatorial radius [m] of the Earth in WGS 84, and J2 of EGM96.
MU = 3.986004418e14
RADIUS = 6378137.0
J2 = 1.08262668e-3

# Gravitational parameter [m³/s²] and reference radius [m] to which the coefficients of EGM2008
# refer, and the highest degree in the file.
EGM_MU = 3.986004415e14
EGM_RADIUS = 6378136.3
EGM_DEGREE = 20


def oblateness(J2: float = J2, mu: float = MU, radius: float = RADIUS) -> SolidHarmonics:
    """Potential -(μ/r) J2 (a/r)² P_2(sin φ) [m²/s²] of an oblate body around the z axis.

    φ is the latitude and r the distance from the centre.  The sign is that of geodesy: the
    acceleration is the gradient.  The potential μ/r of the point mass is not included.

    Args:
        J2: oblateness, dimensionless.
        mu: gravitational parameter μ [m³/s²].
        radius: equatorial radius a [m].
    """
    c = np.zeros((3, 3), dtype=complex)
    c[2, 0] = -J2
    return SolidHarmonics(c, radius, mu / radius)


def egm2008(degree: int = EGM_DEGREE, *, central: bool = False) -> SolidHarmonics:
    """Gravity potential EGM2008 [m²/s²] of the Earth, in Earth-fixed axes.

    Args:
        degree: highest degree and order, 2 to 20.
        central: whether the term μ/r is included.

    Raises:
        InputError: the degree is not in the file `egm2008.txt` of this package.

    Source: N. K. Pavlis et al., J. Geophys. Res. 117 (2012) B04406, doi:10.1029/2011JB008916.

    >>> import numpy as np
    >>> g = egm2008(2, central=True).gradient(np.array([EGM_RADIUS, 0.0, 0.0]))
    >>> round(float(g[0]), 2)
    -9.81
    """
    check(
        degree in range(2, EGM_DEGREE + 1),
        f"The gravity field is known to degree {EGM_DEGREE}, and begins with degree 2; degree is "
        f"{degree!r}.",
    )
    c = np.zeros((degree + 1, degree + 1), dtype=complex)
    c += _egm2008()[: degree + 1, : degree + 1]
    if central:
        c[0, 0] = 1.0
    return SolidHarmonics(c, EGM_RADIUS, EGM_MU / EGM_RADIUS)


@cache
def _egm2008() -> Coefficients:
    """Coefficients c_nm of EGM2008 without normalisation, read once."""
    c = np.zeros((EGM_DEGREE + 1, EGM_DEGREE + 1), dtype=complex)
    for line in (files("gossamer_fx.mechanics.orbit") / "egm2008.txt").read_text().splitlines():
        if not line.startswith("#"):
            n, m, C, S = line.split()
            c[int(n), int(m)] = float(C) - 1j * float(S)
    return unnormalise(c, geodetic=True)
