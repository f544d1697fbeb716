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
    """The s-th λ² = ω a² √(ρt/D) of a plate J_n(λr) + c I_n(λr), n nodal diameters (Leissa, NASA
    SP-160, ch. 2)."""

    def edge(λ: float) -> float:
        """Determinant of both conditions at the edge, zero at an eigenvalue."""
        if not free:
            return float(jv(n, λ) * ivp(n, λ) - iv(n, λ) * jvp(n, λ))
        # Bending moment and effective shear force of J_n and of I_n.
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

    # Fine enough that no interval has two of the roots that are tabulated.
    grid = np.linspace(0.5, 12, 2000)
    # I_n grows as exp(λ).
    values = [edge(λ) * math.exp(-λ) for λ in grid]
    roots = []
    for k in range(len(grid) - 1):
        if values[k] * values[k + 1] < 0:
            roots.append(brentq(edge, grid[k], grid[k + 1]))
    return roots[s] ** 2


def square_frequencies(clamped: bool, count: int = 6, degree: int = 14) -> np.ndarray:
    """ω a² √(ρt/D) of a square plate by the Rayleigh-Ritz method with polynomials."""
    x, weight = legendre.leggauss(degree + 6)
    # A clamped polynomial has double roots at both ends.
    bubble = legendre.Legendre.fromroots([-1, -1, 1, 1])
    basis = []
    for k in range(degree):
        p = legendre.Legendre.basis(k)
        basis.append(p * bubble if clamped else p)
    # f[d]: d-th derivatives on a side of length 1, at the Gauss points of [-1, 1].
    f = []
    for d in range(3):
        rows = [p.deriv(d)(x) * 2**d for p in basis]
        f.append(np.array(rows))
    # G[i, j]: integrals of the i-th times the j-th derivatives.
    G = {}
    for i in range(3):
        for j in range(3):
            G[i, j] = (f[i] * weight / 2) @ f[j].T
    M = np.kron(G[0, 0], G[0, 0])
    bending = np.kron(G[2, 2], G[0, 0]) + np.kron(G[0, 0], G[2, 2])
    twist = np.kron(G[1, 1], G[1, 1])
    coupling = np.kron(G[2, 0], G[0, 2]) + np.kron(G[0, 2], G[2, 0])
    K = bending + 2 * (1 - NU) * twist + NU * coupling
    # Unit diagonal: products of high degree are nearly dependent and need all digits.
    scale = 1 / np.sqrt(np.diag(M))
    scaling = np.outer(scale, scale)
    values, vectors = np.linalg.eigh(M * scaling)
    is_kept = values > 1e-10 * values.max()
    basis_change = vectors[:, is_kept] / np.sqrt(values[is_kept])
    ω2 = np.linalg.eigvalsh(basis_change.T @ (K * scaling) @ basis_change)
    ω = np.sqrt(np.maximum(ω2, 0))
    # A free plate begins with three rigid motions.
    first = 0 if clamped else 3
    return ω[first : first + count]


def clamped_disc(load: float, thickness: float, degree: int = 16) -> float:
    """w0/t of a clamped disc of radius 1 under the follower pressure load·E t⁴, of the energy

    ∫ (A/2 (E_r² + 2ν E_r E_t + E_t²) + D/2 (κ_r² + 2ν κ_r κ_t + κ_t²)) 2πs ds - p V

    with Green strains E and curvatures κ_r = θ', κ_t = sin θ/s of the meridian r(s), z(s), z' = tan
    θ r'.
    """
    s, weight = legendre.leggauss(40)
    s = (s + 1) / 2
    weight = weight / 2
    identity = np.polynomial.Polynomial([0, 1])
    even = [identity ** (2 * k) for k in range(degree // 2)]
    # Zero at the rim; squared, with zero slope there.
    bubble = np.polynomial.Polynomial([1, 0, -1])
    radial = [identity * bubble * p for p in even]
    lift = [bubble**2 * p for p in even]
    # Values and two derivatives at the Gauss points.
    tables = []
    for polynomials in (radial, lift):
        derivatives = []
        for d in range(3):
            rows = [p.deriv(d)(s) for p in polynomials]
            derivatives.append(np.array(rows))
        tables.append(derivatives)
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
        membrane = A * (E_r**2 + 2 * NU * E_r * E_t + E_t**2)
        bending = D * (κ_r**2 + 2 * NU * κ_r * κ_t + κ_t**2)
        stored = np.pi * s * (membrane + bending)
        work = p * 2 * np.pi * r * z * dr
        # Of order one, as the search for the minimum expects.
        return float((weight * (stored - work)).sum() / (D * t**2))

    found = minimize(
        energy,
        np.zeros(2 * n),
        method="BFGS",
        options={"gtol": 1e-9, "maxiter": 4000},
    )
    return float(found.x[n:] @ [p(0.0) for p in lift])


def test_the_frequencies_of_circular_plates_follow_from_bessel_functions() -> None:
    # The study's values have six digits.
    for edge, found in CIRCLE.items():
        for (n, s), value in found.items():
            assert disc_frequency(n, s, edge == "free") == pytest.approx(value, rel=1e-5)
    assert jn_zeros(0, 1)[0] == pytest.approx(2.404826, rel=1e-6)


def test_the_frequencies_of_square_plates_are_those_of_ritz_and_near_to_leissas() -> None:
    for edge, values in SQUARE.items():
        measured = square_frequencies(edge == "clamped")[: len(values)]
        assert measured == pytest.approx(np.array(values), rel=1e-5)
        assert np.array(values) == pytest.approx(np.array(LEISSA[edge]), rel=1.1e-2)


@pytest.mark.parametrize("load", DISC)
def test_the_clamped_disc_rises_as_its_meridian_says(load: float) -> None:
    assert clamped_disc(load, 0.01, 12) == pytest.approx(DISC[load], rel=1e-3)


def test_a_small_load_lifts_the_clamped_disc_as_linear_theory_says() -> None:
    assert clamped_disc(0.01, 0.01, 12) == pytest.approx(0.01 * 12 * (1 - NU**2) / 64, rel=1e-3)
