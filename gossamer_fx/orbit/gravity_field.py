"""The Earth's gravity beyond 1/r: oblateness, or EGM2008 to degree 20."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

import numpy as np

from gossamer_fx.extend import check
from gossamer_fx.orbit.harmonics import Coefficients, SolidHarmonics, unnormalise

MU, RADIUS, J2 = 3.986004418e14, 6378137.0, 1.08262668e-3  # m³/s², m, of WGS 84 and EGM96
EGM_MU, EGM_RADIUS, EGM_DEGREE = 3.986004415e14, 6378136.3, 20


def oblateness(J2: float = J2, mu: float = MU, radius: float = RADIUS) -> SolidHarmonics:
    """The potential -(μ/r) J2 (a/r)² P_2(sin φ), around the z axis."""
    c = np.zeros((3, 3), dtype=complex)
    c[2, 0] = -J2
    return SolidHarmonics(c, radius, mu / radius)


def egm2008(degree: int = EGM_DEGREE, *, central: bool = False) -> SolidHarmonics:
    """EGM2008 to a degree and order, in Earth-fixed axes; the term μ/r is included if `central`.

    Source: Pavlis et al., J. Geophys. Res. 117 (2012) B04406, doi:10.1029/2011JB008916; `egm2008.txt` beside this file.

    Raises:
        InputError: a degree that the file does not hold.
    """
    check(
        degree in range(2, EGM_DEGREE + 1),
        f"The gravity field is known to degree {EGM_DEGREE}, and begins with degree 2; degree is {degree!r}.",
    )
    c = np.zeros((degree + 1, degree + 1), dtype=complex)
    c += _egm2008()[: degree + 1, : degree + 1]
    if central:
        c[0, 0] = 1.0
    return SolidHarmonics(c, EGM_RADIUS, EGM_MU / EGM_RADIUS)


@cache
def _egm2008() -> Coefficients:
    c = np.zeros((EGM_DEGREE + 1, EGM_DEGREE + 1), dtype=complex)
    for line in (files("gossamer_fx.orbit") / "egm2008.txt").read_text().splitlines():
        if not line.startswith("#"):
            n, m, C, S = line.split()
            c[int(n), int(m)] = float(C) - 1j * float(S)
    return unnormalise(c, geodetic=True)
