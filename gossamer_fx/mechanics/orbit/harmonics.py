"""Potentials in solid spherical harmonics: gravity (J2, or EGM2008 to degree 20) and magnetic field
(IGRF-14) of the Earth.

With the reference radius a, latitude φ and longitude λ, the solid harmonics and a potential are

    Y_nm = (a/r)^(n+1) P_nm(sin φ) exp(i m λ)                                                    (1)

    Φ = s Re Σ c_nm Y_nm,    c_nm = C_nm - i S_nm    (not normalised)                            (2)

A derivative of Y_nm along a Cartesian coordinate is a sum of two Y of degree n + 1.  So the
derivatives of Φ are sums of the same kind as Φ; their coefficients are computed once
(`differentiate`).  No formula divides by cos φ: the poles need no special case.

Source: L. E. Cunningham, Celest. Mech. 2 (1970) 207, doi:10.1007/BF01229495.
"""

from __future__ import annotations

from functools import cache, cached_property
from importlib.resources import files

import numpy as np
import numpy.typing as npt

from gossamer_fx.extend import Array, check

# c_nm at [n, m] for m ≤ n, and zero for m > n.
Coefficients = npt.NDArray[np.complex128]


class SolidHarmonics:
    """The potential Φ = scale Re Σ c_nm Y_nm around the origin, outside a sphere of the reference
    radius a [m].

    `coefficients` c_nm = C_nm - i S_nm are complex (N + 1, N + 1), not normalised; `scale` is for
    example μ/a [m²/s²] for gravity.

    >>> import numpy as np
    >>> point = SolidHarmonics(np.array([[1.0 + 0j]]), radius=1.0, scale=2.0)  # 2/r
    >>> float(point.potential(np.array([4.0, 0.0, 0.0])))
    0.5
    """

    def __init__(self, coefficients: Coefficients, radius: float, scale: float) -> None:
        self.coefficients = coefficients
        self.radius = radius
        self.scale = scale

    @cached_property
    def _first(self) -> list[Coefficients]:
        """Coefficients of the first derivatives along x, y and z."""
        return [differentiate(self.coefficients, axis) for axis in range(3)]

    @cached_property
    def _second(self) -> list[list[Coefficients]]:
        """Coefficients of the second derivatives, of the lower triangle only."""
        rows = []
        for k, first in enumerate(self._first):
            rows.append([differentiate(first, axis) for axis in range(k + 1)])
        return rows

    def potential(self, r: Array) -> Array:
        """Φ (...) at positions r (..., 3) [m], in the unit of `scale`."""
        Y = solid_harmonics(len(self.coefficients) - 1, r, self.radius)
        return self.scale * _real_sum(self.coefficients, Y)

    def gradient(self, r: Array) -> Array:
        """∇Φ (..., 3) at positions r (..., 3) [m], in the unit of `scale` per metre."""
        Y = solid_harmonics(len(self._first[0]) - 1, r, self.radius)
        components = [_real_sum(c, Y) for c in self._first]
        return self.scale / self.radius * np.stack(components, axis=-1)

    def second_gradient(self, r: Array) -> Array:
        """∇∇Φ (..., 3, 3) at positions r (..., 3) [m], in the unit of `scale` per square metre:
        symmetric, with the trace zero, not finite at the origin."""
        Y = solid_harmonics(len(self._second[0][0]) - 1, r, self.radius)
        G = np.empty((*np.shape(r)[:-1], 3, 3))
        for i, row in enumerate(self._second):
            for j, c in enumerate(row):
                component = _real_sum(c, Y)
                G[..., i, j] = component
                G[..., j, i] = component
        return self.scale / self.radius**2 * G


def _real_sum(c: Coefficients, Y: Coefficients) -> Array:
    """Re Σ c_nm Y_nm (...); the degree of c is at most that of Y (N, N, ...)."""
    N = len(c)
    return np.einsum("nm,nm...->...", c, Y[:N, :N]).real


def solid_harmonics(degree: int, r: Array, radius: float) -> Coefficients:
    """Y_nm = (a/r)^(n+1) P_nm(sin φ) exp(i m λ) at positions r (..., 3) [m] for the reference
    radius a [m]: complex (degree + 1, degree + 1, ...), Y_nm at [n, m], zeros where m > n; not
    finite at the origin.

    φ is the latitude, λ the longitude and P_nm the associated Legendre function, not normalised.
    """
    # r2: |r|² [m²]; x, y, z: a/r² times the coordinates [-]; ρ: (a/r)² [-]; xy: x + i y.
    r2 = np.sum(np.asarray(r, dtype=float) ** 2, axis=-1)
    x, y, z = (radius * np.asarray(r)[..., k] / r2 for k in range(3))
    ρ = radius**2 / r2
    xy = x + 1j * y
    Y = np.zeros((degree + 1, degree + 1, *r2.shape), dtype=complex)
    Y[0, 0] = radius / np.sqrt(r2)
    for n in range(1, degree + 1):
        # The recursion goes along the diagonal m = n, and from there to higher n at the same m.  It
        # is stable in this direction.
        Y[n, n] = (2 * n - 1) * xy * Y[n - 1, n - 1]
        m = np.arange(n).reshape(-1, *[1] * r2.ndim)
        Y[n, :n] = (2 * n - 1) * z * Y[n - 1, :n]
        if n > 1:
            Y[n, :n] -= (n + m - 1) * ρ * Y[n - 2, :n]
        Y[n, :n] /= n - m
    return Y


def differentiate(c: Coefficients, axis: int) -> Coefficients:
    """Return the coefficients (N + 1, N + 1) of radius · ∂Φ/∂x_axis from those of Φ, c (N, N),
    complex and not normalised, c_nm at [n, m].

    Φ = Re Σ c_nm Y_nm is a sum of solid spherical harmonics; with the reference radius a, their
    derivatives are

        a ∂z Y_nm = -(n-m+1) Y_{n+1,m}
        a (∂x + i ∂y) Y_nm = -Y_{n+1,m+1}
        a (∂x - i ∂y) Y_nm = (n-m+2)(n-m+1) Y_{n+1,m-1}
    """
    # d: the result; n and m: degrees and orders as a column and a row; up, down: factors of the
    # terms Y_{n+1,m+1} and Y_{n+1,m-1}.
    N = len(c)
    d = np.zeros((N + 1, N + 1), dtype=complex)
    n = np.arange(N)[:, None]
    m = np.arange(N)[None, :]
    if axis == 2:
        d[1:, :N] = -(n - m + 1) * c
        return d
    # ∂x and ∂y are half the sum, and half the difference over i, of the two complex derivatives.
    up: complex = -0.5
    down: complex = 0.5
    if axis == 1:
        up = 0.5j
        down = 0.5j
    d[1:, 1:] = up * c
    # Y_n0 is real, and Re Y_{n+1,-1} follows from Y_{n+1,1}: both halves of its derivative
    # coincide.
    d[1:, 1] += up * c[:, 0].conj()
    lowered = down * (n - m + 2) * (n - m + 1) * c
    d[1:, : N - 1] += lowered[:, 1:]
    return d


def unnormalise(c: Coefficients, geodetic: bool) -> Coefficients:
    """Coefficients (N, N) without normalisation, from normalised ones c of degree n and order m at
    [n, m], in any unit; zero where m > n.

    The factor is √((2-δ_0m) (n-m)!/(n+m)!), Schmidt's semi-normalisation of geomagnetism; in the
    full normalisation of geodesy times √(2n+1).
    """
    N = len(c)
    factor = np.zeros((N, N))
    for n in range(N):
        factor[n, 0] = 1.0
        if geodetic:
            factor[n, 0] = np.sqrt(2 * n + 1)
        # (n+m)!/(n-m)! as a running product, since factorials overflow.
        product = 1.0
        for m in range(1, n + 1):
            product *= (n + m) * (n - m + 1)
            factor[n, m] = np.sqrt(2 / product) * factor[n, 0]
    return c * factor


# ---- gravity of the Earth ------------------------------------------------------------------------

# Gravitational parameter [m³/s²] and equatorial radius [m] of the Earth in WGS 84, and J2 of EGM96.
EARTH_MU = 3.986004418e14
EARTH_RADIUS = 6378137.0
EARTH_J2 = 1.08262668e-3

# Gravitational parameter [m³/s²] and reference radius [m] to which the coefficients of EGM2008
# refer, and the highest degree in the file.
EGM_MU = 3.986004415e14
EGM_RADIUS = 6378136.3
EGM_DEGREE = 20


def oblateness(
    J2: float = EARTH_J2, mu: float = EARTH_MU, radius: float = EARTH_RADIUS
) -> SolidHarmonics:
    """Potential -(μ/r) J2 (a/r)² P_2(sin φ) [m²/s²] of an oblate body around the z axis, with the
    gravitational parameter μ [m³/s²] and the equatorial radius a [m].

    φ is the latitude and r the distance from the centre.  The sign is that of geodesy: the
    acceleration is the gradient.  The potential μ/r of the point mass is not included.
    """
    c = np.zeros((3, 3), dtype=complex)
    c[2, 0] = -J2
    return SolidHarmonics(c, radius, mu / radius)


def egm2008(degree: int = EGM_DEGREE, *, central: bool = False) -> SolidHarmonics:
    """Gravity potential EGM2008 [m²/s²] of the Earth, in Earth-fixed axes, to a degree and order of
    2 to 20; the term μ/r is included if `central`.

    Source: N. K. Pavlis et al., J. Geophys. Res. 117 (2012) B04406, doi:10.1029/2011JB008916.

    >>> import numpy as np
    >>> g = egm2008(2, central=True).gradient(np.array([EGM_RADIUS, 0.0, 0.0]))
    >>> round(float(g[0]), 2)
    -9.81
    """
    check(
        degree in range(2, EGM_DEGREE + 1),
        f"The gravity field is known to degree {EGM_DEGREE}, and begins with degree 2; "
        f"degree is {degree!r}.",
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
    with (files("gossamer_fx.mechanics.orbit") / "egm2008.txt").open() as lines:
        n, m, C, S = np.loadtxt(lines, unpack=True)
    c[n.astype(int), m.astype(int)] = C - 1j * S
    return unnormalise(c, geodetic=True)


# ---- magnetic field of the Earth -----------------------------------------------------------------

# Reference radius [m] of the coefficients of IGRF.
REFERENCE_RADIUS = 6371.2e3


class Igrf:
    """Main magnetic field of the Earth at one year with fraction, from 1900 to 2030.

        B = -∇V [T],    V = a Σ (a/r)^(n+1) P_n^m(sin φ) (g cos mλ + h sin mλ),    n ≤ 13

    Coefficients are linear between epochs; those of the last five years are a forecast.

    Source: IAGA, International Geomagnetic Reference Field, 14th generation,
    doi:10.5281/zenodo.14012302; its file `igrf14.shc` is in this package.

    >>> import numpy as np
    >>> B = Igrf(2025.0).field(np.array([0.0, 0.0, REFERENCE_RADIUS]))  # at the north pole
    >>> bool(5.5e-5 < np.linalg.norm(B) < 6.0e-5)
    True
    """

    def __init__(self, year: float) -> None:
        # c: coefficients [T] of each epoch; s, below: share of the interval that has passed at the
        # year, 0 to 1.
        epochs, c = _igrf14()
        check(
            bool(epochs[0] <= year <= epochs[-1]),
            f"The magnetic field is known from {epochs[0]:.0f} to {epochs[-1]:.0f}, "
            f"not in {year!r}; give a year between them.",
        )
        # The interval of epochs; the last year belongs to the last interval.
        following = np.searchsorted(epochs, year, side="right")
        k = int(np.clip(following - 1, 0, len(epochs) - 2))
        s = (year - epochs[k]) / (epochs[k + 1] - epochs[k])
        self.harmonics = SolidHarmonics(
            coefficients=(1 - s) * c[k] + s * c[k + 1],
            radius=REFERENCE_RADIUS,
            scale=REFERENCE_RADIUS,
        )

    def field(self, r: Array) -> Array:
        """B (..., 3) [T] at Earth-fixed positions r (..., 3) [m]."""
        return -self.harmonics.gradient(r)


@cache
def _igrf14() -> tuple[Array, list[Coefficients]]:
    """Epochs (k,) [years], and for each of them coefficients c_nm (14, 14) [T] without
    normalisation, read once from the file `igrf14.shc` of the package."""
    text = (files("gossamer_fx.mechanics.orbit") / "igrf14.shc").read_text()
    lines = [line.split() for line in text.splitlines() if not line.startswith("#")]
    degree = int(lines[0][1])
    epochs = np.array([float(year) for year in lines[1]])
    c = np.zeros((len(epochs), degree + 1, degree + 1), dtype=complex)
    for n, m, *values in lines[2:]:
        nanotesla = np.array([float(value) for value in values])
        # Lines with negative m have the sine coefficients h, the others the cosine coefficients g.
        if int(m) >= 0:
            c[:, int(n), int(m)] += 1e-9 * nanotesla
        else:
            c[:, int(n), -int(m)] += 1e-9 * (-1j * nanotesla)
    return epochs, [unnormalise(each, geodetic=False) for each in c]
