"""Gravity and magnetic field of the Earth: tables, independent evaluations, derivatives, zero
trace."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.mechanics.orbit.harmonics import (
    EGM_MU,
    EGM_RADIUS,
    Igrf,
    SolidHarmonics,
    egm2008,
    oblateness,
)

# Points [m], and accelerations [m/s²] by the maximum degree of the harmonics.
PLACES = 1e6 * np.array([(7, 0, 0), (4, 3, 5), (-2.5, 5.5, -3.5)])
ACCELERATIONS = {
    2: [
        (-8.1457659786, -3.6626192e-5, -5.4043287e-9),
        (-4.500680134, -3.3755707756, -5.6407708433),
        (2.9265485017, -6.4385591491, 4.1083495812),
    ],
    4: [
        (-8.1457109670, 1.8418520e-5, 6.1396349e-5),
        (-4.500673786, -3.3756972173, -5.6407842336),
        (2.926502372, -6.4384943374, 4.1083854151),
    ],
}
# J_n of EGM2008, of its published table.
ZONALS = {
    2: 1.0826261739e-3,
    3: -2.5324105e-6,
    4: -1.6198976e-6,
    5: -2.2775359e-7,
    6: 5.4066658e-7,
    8: -2.0399313e-7,
}


@pytest.mark.parametrize("degree", ACCELERATIONS)
def test_egm2008_at_three_places(degree: int) -> None:
    field = egm2008(degree, central=True)
    for place, known in zip(PLACES, ACCELERATIONS[degree], strict=True):
        assert np.allclose(
            field.gradient(place), known, rtol=0, atol=5.1e-11
        )  # half of the tables' last digit


def test_zonal_coefficients_of_egm2008() -> None:
    c = egm2008().coefficients
    for n, J in ZONALS.items():
        # The table has eight digits.
        assert -c[n, 0].real == pytest.approx(J, rel=1e-7)
    assert len(c) == 21
    # All coefficients C_nm + i S_nm of degrees 2 to 20 are given.
    assert np.count_nonzero(c) == sum(n + 1 for n in range(2, 21))


def test_oblateness() -> None:
    known = [(-0.01096739, 0, 0), (0, 0, 0.02193478), (0.00893762, 0.00670321, -0.00372401)]
    places = 1e6 * np.array([(7, 0, 0), (0, 0, 7), (4, 3, 5)])
    # Half of the last of eight decimals.
    assert np.allclose(oblateness().gradient(places), known, rtol=0, atol=1e-8 / 2)
    r = np.linalg.norm(places, axis=1)[:, None]
    z = places[:, 2:]
    factor = np.hstack([1 - 5 * z**2 / r**2] * 2 + [3 - 5 * z**2 / r**2])
    formula = -1.5 * 1.08262668e-3 * 3.986004418e14 * 6378137.0**2 / r**5 * places * factor
    # Another form of the same polynomial: round-off.
    assert np.allclose(oblateness().gradient(places), formula, rtol=1e-13, atol=1e-17)


@pytest.mark.parametrize(
    ("r", "colatitude", "longitude", "known"),
    [
        (6871.2, 90, 0, (10884.7845, -21681.1030, -1932.6934)),
        (6871.2, 30, 140, (-43744.9444, -12713.1381, -2537.5182)),
        (7071.2, 120, -60, (10166.3687, -14172.1646, -2102.5571)),
    ],
)
def test_igrf_at_three_places(
    r: float, colatitude: float, longitude: float, known: tuple[float, ...]
) -> None:
    θ = math.radians(colatitude)
    λ = math.radians(longitude)
    e_r, e_θ, e_λ = spherical_axes(θ, λ)
    B = Igrf(2020.0).field(1e3 * r * e_r)
    # nT: half of the last of four decimals, for each component.
    components = np.array([B @ e_r, B @ e_θ, B @ e_λ])
    assert np.allclose(1e9 * components, known, rtol=0, atol=6e-5)


def test_igrf_between_epochs_is_their_mean() -> None:
    r = np.array([4e6, 3e6, 5e6])
    ends = [Igrf(year).field(r) for year in (2020.0, 2025.0, 2030.0)]
    assert np.allclose(Igrf(2022.5).field(r), (ends[0] + ends[1]) / 2, rtol=1e-14)
    assert np.allclose(Igrf(2030.0).field(r), ends[2])
    with pytest.raises(gx.InputError, match="1900"):
        Igrf(1850.0)


def spherical_axes(θ: float, λ: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors outwards, southwards and eastwards at a colatitude and a longitude [rad]."""
    outwards = np.array([math.sin(θ) * math.cos(λ), math.sin(θ) * math.sin(λ), math.cos(θ)])
    southwards = np.array([math.cos(θ) * math.cos(λ), math.cos(θ) * math.sin(λ), -math.sin(θ)])
    eastwards = np.array([-math.sin(λ), math.cos(λ), 0.0])
    return outwards, southwards, eastwards


def spherical(harmonics: SolidHarmonics, r: np.ndarray) -> np.ndarray:
    """The gradient by another route: spherical components, Legendre functions in closed form by
    differentiation of (x² - 1)^n, derivative by colatitude from their own recursion."""
    N = len(harmonics.coefficients)
    a = harmonics.radius
    distance = np.linalg.norm(r)
    θ = math.acos(r[2] / distance)
    λ = math.atan2(r[1], r[0])
    g = np.zeros(3)
    for n in range(N):
        rodrigues = np.polynomial.Polynomial([-1, 0, 1]) ** n / (2**n * math.factorial(n))
        for m in range(n + 1):
            c = harmonics.coefficients[n, m]
            if c == 0:
                continue
            P = rodrigues.deriv(n + m)
            dP = rodrigues.deriv(n + m + 1)
            x = math.cos(θ)
            s = math.sin(θ)
            value = s**m * P(x)
            # Derivative of s^m P(cos θ) by θ; the first part is absent for m = 0.
            slope = -(s ** (m + 1)) * dP(x)
            if m:
                slope += m * s ** (m - 1) * x * P(x)
            wave = c * np.exp(1j * m * λ)
            factor = (a / distance) ** (n + 1) / distance
            along_r = -(n + 1) * value * wave.real
            along_θ = slope * wave.real
            along_λ = value / s * (1j * m * wave).real
            g += factor * np.array([along_r, along_θ, along_λ])
    e_r, e_θ, e_λ = spherical_axes(θ, λ)
    return harmonics.scale * (g[0] * e_r + g[1] * e_θ + g[2] * e_λ)


@pytest.mark.parametrize(
    "place", [(7e6, 0, 0), (4e6, 3e6, 5e6), (-2.5e6, 5.5e6, -3.5e6), (1e5, 2e5, -6.6e6)]
)
def test_two_routes_agree(place: tuple[float, float, float]) -> None:
    r = np.array(place)
    for harmonics in (egm2008(10, central=True), Igrf(2026.0).harmonics):
        g = harmonics.gradient(r)
        error = np.abs(g - spherical(harmonics, r)).max()
        # Two algorithms in double precision.
        assert error < 1e-12 * np.linalg.norm(g)


def test_second_derivatives() -> None:
    field = egm2008(20)
    r = np.array([4e6, 3e6, 5e6])
    G = field.second_gradient(r)
    step = 200.0
    ahead, behind = (field.gradient(r + s * step * np.eye(3)) for s in (1, -1))
    # Central differences with 200 m: (step/r)² of truncation.
    error = np.abs(G - (ahead - behind) / (2 * step)).max()
    assert error < 1e-7 * np.abs(G).max()
    # The potential is harmonic: its second derivatives have no trace.
    error = abs(np.trace(G))
    assert error < 1e-13 * np.abs(G).max()
    slope = [(field.potential(r + s * step * np.eye(3))) for s in (1, -1)]
    assert np.allclose(field.gradient(r), (slope[0] - slope[1]) / (2 * step), rtol=1e-6, atol=1e-9)


def test_poles_are_places_like_others() -> None:
    field = egm2008(20, central=True)
    north = np.array([0.0, 0.0, 7e6])
    aside = field.gradient(north + np.array([1.0, 0, 0]))
    error = np.linalg.norm(field.gradient(north) - aside)
    # 1 m from the pole the gradient differs by its second derivative, 3 μ/r³ at most.
    assert error < 3 * EGM_MU / 7e6**3
    assert np.isfinite(field.second_gradient(north)).all()


def test_degrees_beyond_the_file_are_refused() -> None:
    with pytest.raises(gx.InputError, match="20"):
        egm2008(21)
    assert EGM_RADIUS == 6378136.3
