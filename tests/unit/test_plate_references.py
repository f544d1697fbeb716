"""The reference values of `demos/studies/plate.py`, derived again from their equations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.optimize import brentq, minimize
from scipy.special import iv, ivp, jn_zeros, jv, jvp

from demos.studies.plate import CIRCLE, DISC, LEISSA, NU, SQUARE


def disc_frequency(n: int, s: int, free: bool) -> float:
    """The s-th λ² = ω a² √(ρt/D) of a plate J_n(λr) + c I_n(λr), n nodal diameters (Leissa, NASA SP-160, ch. 2)."""

    def edge(λ: float) -> float:
        if not free:
            return float(jv(n, λ) * ivp(n, λ) - iv(n, λ) * jvp(n, λ))
        rows = []
        for f, fp, sign in ((jv, jvp, -1.0), (iv, ivp, 1.0)):
            w = f(n, λ)
            dw = λ * fp(n, λ)
            ddw = λ**2 * fp(n, λ, 2)
            laplacian_slope = sign * λ**2 * dw  # of a plate ∇²w = ±λ² w
            moment = ddw + NU * (dw - n**2 * w)
            shear = laplacian_slope - (1 - NU) * n**2 * (dw - w)
            rows.append((moment, shear))
        (m1, v1), (m2, v2) = rows
        return float(m1 * v2 - m2 * v1)

    grid = np.linspace(0.5, 12, 2000)
    values = [edge(λ) * math.exp(-λ) for λ in grid]
    roots = [
        brentq(edge, a, b)
        for a, b, u, v in zip(grid, grid[1:], values, values[1:], strict=False)
        if u * v < 0
    ]
    return roots[s] ** 2


def square_frequencies(
    clamped: bool,
    count: int = 6,
    degree: int = 14,
) -> np.ndarray:
    """ω a² √(ρt/D) of a square plate by the Rayleigh-Ritz method with polynomials."""
    x, weight = legendre.leggauss(degree + 6)
    basis = []
    for k in range(degree):
        p = legendre.Legendre.basis(k)
        basis.append(p * legendre.Legendre.fromroots([-1, -1, 1, 1]) if clamped else p)
    f = [
        np.array([p.deriv(d)(x) * 2**d if d else p(x) for p in basis]) for d in range(3)
    ]  # on a side of length 1
    G = {(i, j): (f[i] * weight / 2) @ f[j].T for i in range(3) for j in range(3)}
    M = np.kron(G[0, 0], G[0, 0])
    K = (
        np.kron(G[2, 2], G[0, 0])
        + np.kron(G[0, 0], G[2, 2])
        + 2 * (1 - NU) * np.kron(G[1, 1], G[1, 1])
    )
    K += NU * (np.kron(G[2, 0], G[0, 2]) + np.kron(G[0, 2], G[2, 0]))
    scale = 1 / np.sqrt(np.diag(M))
    values, vectors = np.linalg.eigh(M * np.outer(scale, scale))
    keep = vectors[:, values > 1e-10 * values.max()] / np.sqrt(
        values[values > 1e-10 * values.max()]
    )
    ω2 = np.linalg.eigvalsh(keep.T @ (K * np.outer(scale, scale)) @ keep)
    return np.sqrt(np.maximum(ω2, 0))[0 if clamped else 3 :][:count]


def clamped_disc(load: float, thickness: float, degree: int = 16) -> float:
    """w0/t of a clamped disc of radius 1 under the follower pressure load·E t⁴, of the energy

    ∫ (A/2 (E_r² + 2ν E_r E_t + E_t²) + D/2 (κ_r² + 2ν κ_r κ_t + κ_t²)) 2πs ds - p V

    with Green strains E and curvatures κ_r = θ', κ_t = sin θ/s of the meridian r(s), z(s), z' = tan θ r'.
    """
    s, weight = legendre.leggauss(40)
    s = (s + 1) / 2
    weight = weight / 2
    even = [np.polynomial.Polynomial([0] * (2 * k) + [1]) for k in range(degree // 2)]
    bubble = np.polynomial.Polynomial([1, 0, -1])
    radial = [np.polynomial.Polynomial([0, 1]) * bubble * p for p in even]
    lift = [bubble**2 * p for p in even]
    tables = [
        [np.array([p.deriv(d)(s) if d else p(s) for p in each]) for d in range(3)]
        for each in (radial, lift)
    ]
    t = thickness
    A = t / (1 - NU**2)
    D = t**3 / 12 / (1 - NU**2)
    p = load * t**4
    n = len(even)

    def energy(c: np.ndarray) -> float:
        u, du, ddu = (c[:n] * t**2 @ table for table in tables[0])
        z, dz, ddz = (c[n:] * t @ table for table in tables[1])
        r = s + u
        dr = 1 + du
        E_r = (dr**2 + dz**2 - 1) / 2
        E_t = ((r / s) ** 2 - 1) / 2
        norm = np.sqrt(dr**2 + dz**2)
        κ_r = (dr * ddz - dz * ddu) / norm**2
        κ_t = dz / norm / s
        stored = A * (E_r**2 + 2 * NU * E_r * E_t + E_t**2) + D * (
            κ_r**2 + 2 * NU * κ_r * κ_t + κ_t**2
        )
        return float(
            (weight * (np.pi * s * stored - p * 2 * np.pi * r * z * dr)).sum() / (D * t**2)
        )

    found = minimize(
        energy,
        np.zeros(2 * n),
        method="BFGS",
        options={"gtol": 1e-9, "maxiter": 4000},
    )
    return float(found.x[n:] @ [p(0.0) for p in lift])


def test_the_frequencies_of_circular_plates_follow_from_bessel_functions() -> None:
    for edge, found in CIRCLE.items():
        for (n, s), value in found.items():
            measured = disc_frequency(n, s, edge == "free")
            assert measured == pytest.approx(value, rel=1e-5)
    measured = jn_zeros(0, 1)[0]
    assert measured == pytest.approx(2.404826, rel=1e-6)


def test_the_frequencies_of_square_plates_are_those_of_ritz_and_near_to_leissas() -> None:
    for edge, values in SQUARE.items():
        measured = square_frequencies(edge == "clamped")[: len(values)]
        assert measured == pytest.approx(np.array(values), rel=1e-5)
        expected = np.array(LEISSA[edge])
        assert np.array(values) == pytest.approx(expected, rel=1.1e-2)


@pytest.mark.parametrize("load", DISC)
def test_the_clamped_disc_rises_as_its_meridian_says(load: float) -> None:
    measured = clamped_disc(load, 0.01, 12)
    assert measured == pytest.approx(DISC[load], rel=1e-3)


def test_a_small_load_lifts_the_clamped_disc_as_linear_theory_says() -> None:
    measured = clamped_disc(0.01, 0.01, 12)
    expected = 0.01 * 12 * (1 - NU**2) / 64
    assert measured == pytest.approx(expected, rel=1e-3)
