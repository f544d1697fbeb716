"""Potentials in solid spherical harmonics: gravity and the magnetic field by one recursion, without a pole.

With Y_nm = (a/r)^(n+1) P_nm(sin φ) exp(i m λ), a the reference radius, a potential is

    Φ = s Re Σ c_nm Y_nm,    c_nm = C_nm - i S_nm   (unnormalised)

A derivative of Y_nm along a coordinate is a sum of two Y of degree n + 1, so the derivatives of Φ are sums of the same
kind, whose coefficients are found once (Cunningham, Celest. Mech. 2 (1970) 207, doi:10.1007/BF01229495).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

from gossamer_fx.extend import Array

Coefficients = npt.NDArray[np.complex128]  # c_nm at [n, m], m ≤ n


class SolidHarmonics:
    """The potential Φ = scale Re Σ c_nm Y_nm around the origin, outside the sphere of `radius` [m].

    Args:
        coefficients: c_nm = C_nm - i S_nm, unnormalised, complex (N + 1, N + 1).
        radius: a [m].
        scale: s, e.g. μ/a [m²/s²].
    """

    def __init__(self, coefficients: Coefficients, radius: float, scale: float) -> None:
        self.coefficients, self.radius, self.scale = coefficients, radius, scale

    @cached_property
    def _first(self) -> list[Coefficients]:
        return [differentiate(self.coefficients, axis) for axis in range(3)]

    @cached_property
    def _second(self) -> list[list[Coefficients]]:
        return [
            [differentiate(c, axis) for axis in range(k + 1)] for k, c in enumerate(self._first)
        ]

    def potential(self, r: Array) -> Array:
        """Φ (...) at positions r (..., 3) [m]."""
        return self.scale * self._sum(self.coefficients, r)

    def gradient(self, r: Array) -> Array:
        """∇Φ (..., 3)."""
        Y = solid_harmonics(len(self._first[0]) - 1, r, self.radius)
        return self.scale / self.radius * np.stack([_real_sum(c, Y) for c in self._first], axis=-1)

    def second_gradient(self, r: Array) -> Array:
        """∇∇Φ (..., 3, 3), symmetric and without trace."""
        Y = solid_harmonics(len(self._second[0][0]) - 1, r, self.radius)
        G = np.empty((*np.shape(r)[:-1], 3, 3))
        for i, row in enumerate(self._second):
            for j, c in enumerate(row):
                G[..., i, j] = G[..., j, i] = _real_sum(c, Y)
        return self.scale / self.radius**2 * G

    def _sum(self, c: Coefficients, r: Array) -> Array:
        return _real_sum(c, solid_harmonics(len(c) - 1, r, self.radius))


def _real_sum(c: Coefficients, Y: Coefficients) -> Array:
    """Re Σ c_nm Y_nm; c has all degrees of Y or less."""
    N = len(c)
    result: Array = np.einsum("nm,nm...->...", c, Y[:N, :N]).real
    return result


def solid_harmonics(degree: int, r: Array, radius: float) -> Coefficients:
    """Y_nm (degree + 1, degree + 1, ...) at positions r (..., 3); zero where m > n."""
    r2 = np.sum(np.asarray(r, dtype=float) ** 2, axis=-1)
    x, y, z = (radius * np.asarray(r)[..., k] / r2 for k in range(3))
    ρ, xy = radius**2 / r2, x + 1j * y
    Y = np.zeros((degree + 1, degree + 1, *r2.shape), dtype=complex)
    Y[0, 0] = radius / np.sqrt(r2)
    for n in range(1, degree + 1):
        Y[n, n] = (2 * n - 1) * xy * Y[n - 1, n - 1]
        m = np.arange(n).reshape(-1, *[1] * r2.ndim)
        Y[n, :n] = (2 * n - 1) * z * Y[n - 1, :n]
        if n > 1:
            Y[n, :n] -= (n + m - 1) * ρ * Y[n - 2, :n]
        Y[n, :n] /= n - m
    return Y


def differentiate(c: Coefficients, axis: int) -> Coefficients:
    """Coefficients of a ∂Φ/∂x_axis, of one degree more.

    a ∂z Y_nm = -(n-m+1) Y_{n+1,m},  a (∂x + i∂y) Y_nm = -Y_{n+1,m+1},  a (∂x - i∂y) Y_nm = (n-m+2)(n-m+1) Y_{n+1,m-1}
    """
    N = len(c)
    d = np.zeros((N + 1, N + 1), dtype=complex)
    n, m = np.arange(N)[:, None], np.arange(N)[None, :]
    if axis == 2:
        d[1:, :N] = -(n - m + 1) * c
        return d
    up, down = (-0.5, 0.5) if axis == 0 else (0.5j, 0.5j)
    # Y_n0 is real, and Re Y_{n+1,-1} follows from Y_{n+1,1}: both halves of its derivative fall together
    d[1:, 1:] = up * c
    d[1:, 1] += up * c[:, 0].conj()
    d[1:, : N - 1] += (down * (n - m + 2) * (n - m + 1) * c)[:, 1:]
    return d


def unnormalise(c: Coefficients, geodetic: bool) -> Coefficients:
    """Unnormalised coefficients of fully normalised ones (geodesy), or of Schmidt's (geomagnetism).

    Factor √((2-δ_0m) (n-m)!/(n+m)!), times √(2n+1) in geodesy.
    """
    N = len(c)
    factor = np.zeros((N, N))
    for n in range(N):
        factor[n, 0] = np.sqrt(2 * n + 1) if geodetic else 1.0
        product = 1.0
        for m in range(1, n + 1):
            product *= (n + m) * (n - m + 1)
            factor[n, m] = np.sqrt(2 / product) * factor[n, 0]
    return c * factor
