"""The extensible elastica, its cubic, and the film law made of it; its derivatives are compared in
test_tangents.py."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from gossamer_fx import Elastica, Linear
from gossamer_fx.mechanics.materials.elastica import buckled_strip, cubic, onset
from gossamer_fx.mechanics.materials.film import SLACK, TAUT, WRINKLED
from tests.strain_samples import CELLS, at_strains, random_strains, strain

NU = 0.3
LAW = Elastica(
    E=1.0,
    nu=NU,
    density=1.0,
    thickness=1.0,
    half_wavelength=math.pi * 1e2 / math.sqrt(12),
)  # e_E = 1e-4


@pytest.mark.parametrize(
    ("e_E", "α", "δ", "load"),
    [
        (1e-4, 20, 0.03036462, 1.01539376),
        (1e-2, 20, 0.03991557, 1.01507684),
        (1e-4, 60, 0.25904634, 1.15168675),
        (1e-2, 60, 0.26562310, 1.14835205),
        (1e-4, 120, 0.87688206, 1.88454545),
        (1e-2, 120, 0.88104193, 1.85921498),
    ],
)
def test_buckled_strip(e_E, α, δ, load):
    assert buckled_strip(e_E, math.radians(α)) == pytest.approx((δ, load), abs=6e-9)


def test_thin_strip_is_the_inextensible_elastica():
    """P/P_c = 1 + δ/2 + 9δ²/32 + 21δ³/128 + 795δ⁴/8192 + O(δ⁵)."""
    δ, load = buckled_strip(1e-12, 0.2)
    exact = 1 + δ / 2 + 9 * δ**2 / 32 + 21 * δ**3 / 128 + 795 * δ**4 / 8192
    assert load == pytest.approx(exact, abs=2 * δ**5)


@pytest.mark.parametrize("e_E", [1e-8, 1e-4, 1e-3, 1e-2])
def test_cubic_fits_the_elastica_up_to_a_shortening_of_0_3(e_E):
    c1, c2, c3 = cubic(e_E)
    for α in np.linspace(0.05, 1.1, 20):
        δ, load = buckled_strip(e_E, α)
        x = δ - onset(e_E)
        assert δ < 0.3
        assert 1 + c1 * x + c2 * x**2 + c3 * x**3 == pytest.approx(load, abs=1e-4)


@pytest.mark.parametrize(
    ("e_E", "coefficients"),
    [
        (1e-5, (0.50056, 0.26941, 0.23160)),
        (1e-3, (0.50031, 0.26917, 0.23089)),
        (1e-2, (0.49776, 0.26723, 0.22307)),
    ],
)
def test_cubic_has_the_coefficients_of_the_reference(e_E, coefficients):
    assert cubic(e_E) == pytest.approx(coefficients, abs=3e-4)


def test_wrinkles_press_as_the_elastica_does():
    """Compression across a tension: nominal stress of the buckled strips at every shortening."""
    e_c = onset(1e-4)
    for α in np.linspace(0.1, 1.1, 8):
        δ, load = buckled_strip(1e-4, α)
        f = ((1 - δ) ** 2 - 1) / 2
        γ1 = 0.01
        S = at_strains(LAW, "stress")(np.array([[γ1, f - NU * γ1, 0.0]]))[0]
        expected = -e_c / (1 - NU**2) * load * math.sqrt(1 - 2 * e_c) / (1 - δ)
        assert S[1] == pytest.approx(expected, rel=1e-3)
        assert S[0] == pytest.approx(γ1 + NU * S[1], rel=1e-9)


def test_unbuckled_film_is_linear():
    e = np.abs(random_strains(CELLS, 0.05, seed=1)) * [1, 1, 0]
    exact = at_strains(Linear(E=1.0, nu=NU, density=1.0, thickness=1.0), "energy")(e)
    assert at_strains(LAW, "energy")(e) == pytest.approx(exact, rel=1e-12)


def test_energy_is_symmetric_in_compression_and_isotropic():
    rng = np.random.default_rng(4)
    γ = rng.uniform(-0.2, 0.05, (2, CELLS))
    φ = rng.uniform(0, np.pi, CELLS)
    W = at_strains(LAW, "energy")
    measured = W(strain(*γ, np.zeros(CELLS)))
    exact = W(strain(*γ, φ))
    assert measured == pytest.approx(exact, rel=1e-9, abs=1e-15)
    γ1 = -abs(γ[0])
    separate = W(strain(γ1, 0 * γ1, φ)) + W(strain(γ[1] * 0, -abs(γ[1]), φ))
    assert W(strain(γ1, -abs(γ[1]), φ)) == pytest.approx(separate, rel=1e-9)


def test_states():
    e = np.array([[1e-2, 1e-2, 0], [1e-2, -1e-2, 0], [-1e-2, -1e-2, 0], [0, 0, 0]])
    assert at_strains(LAW, "state")(e).ravel().tolist() == [TAUT, WRINKLED, SLACK, TAUT]


# The thickest strip that is allowed, of which most terms of the energy count: e_w is near 1e-3.
THICK = Elastica(E=1.0, nu=NU, density=1.0, thickness=1.0, half_wavelength=32.0)


def strip_load(f: float) -> float:
    """Stress of a buckled strip at the strain f over that at the onset."""
    λ_w = math.sqrt(1 - 2 * THICK.onset)
    λ = math.sqrt(1 + 2 * f)
    x = λ_w - λ
    return λ_w / λ * (1 + x * (THICK.c1 + x * (THICK.c2 + x * THICK.c3)))


def strip_energy(f: float) -> float:
    """Energy of a strip at the strain f, by quadrature of its stress."""
    E = 1 / (1 - NU**2)
    if f >= -THICK.onset:
        return E * f**2 / 2
    buckled, _ = quad(strip_load, f, -THICK.onset, epsabs=1e-14)
    return E * (THICK.onset**2 / 2 + THICK.onset * buckled)


@pytest.mark.parametrize("γ2", [-0.01, -0.03, -0.1, -0.2])
def test_a_strip_that_nothing_pulls_across_has_the_least_energy(γ2: float) -> None:
    """U(γ) = min over the strain γ1 across of E γ1²/2 + ψ(γ + ν γ1)."""
    least = minimize_scalar(
        lambda γ1: γ1**2 / 2 + strip_energy(γ2 + NU * γ1),
        bounds=(0.0, 0.1),
        method="bounded",
        options={"xatol": 1e-10},
    )
    # The strain across is larger than -ν γ2 without stress, so that the film is slack.
    measured = at_strains(THICK, "energy")(np.array([[0.0, γ2, 0.0]]))[0]
    assert measured == pytest.approx([least.fun], rel=2 * THICK.onset**2 + 1e-7)


def test_the_energy_of_wrinkles_is_that_of_their_strips() -> None:
    for γ1, f in ((0.05, -0.021), (0.05, -0.05), (0.1, -0.2)):
        measured = at_strains(THICK, "energy")(np.array([[γ1, f - NU * γ1, 0.0]]))[0]
        assert measured == pytest.approx([γ1**2 / 2 + strip_energy(f)], rel=1e-9)


@pytest.mark.parametrize("f", [-0.01, -0.1])
def test_film_is_slack_where_strips_press_more_than_the_film_is_pulled(f: float) -> None:
    """σ1 = E γ1 + ν ψ'(f) is zero at γ1 = ν/(1 - ν²) times -f, or times e_w and the load."""
    compression = -f if f >= -THICK.onset else THICK.onset * strip_load(f)
    limit = NU / (1 - NU**2) * compression
    states = []
    for γ1 in (0.99 * limit, 1.01 * limit):
        e = np.array([[γ1, f - NU * γ1, 0.0]])
        states.append(int(at_strains(THICK, "state")(e)[0, 0]))
    assert states[0] == SLACK and states[1] != SLACK
