"""Film laws: potentials, stresses and states at given strains, E = t = 1; derivatives are compared
in test_tangents.py."""

from __future__ import annotations

import numpy as np
import pytest

from gossamer_fx import Linear, Miyazaki, TensionField
from gossamer_fx.mechanics.materials.film import SLACK, TAUT, WRINKLED, constants
from tests.strain_samples import (
    CELLS,
    SQUARE,
    Samples,
    at_strains,
    random_strains,
    strain,
)

UNIT = {"E": 1.0, "nu": 0.3, "density": 1.0, "thickness": 1.0}
MIYAZAKI = Miyazaki(**UNIT, residual_stiffness=1e-4)
LAWS = [Linear(**UNIT), MIYAZAKI, TensionField(**UNIT)]
NAMES = [type(law).__name__ for law in LAWS]


# Exact values of Miyazaki's law with (k1, k2) = (1, u) wrinkled, (u, u) slack; E = 1, ν = 0.3, u =
# 1e-4. ε11, ε22, ε12 (tensor), states that are right, S11, S22, S12, W
TABLE = [
    (2e-3, 1e-3, 0, (TAUT,), 2.5274725e-3, 1.7582418e-3, 0, 3.406593e-6),
    (2e-3, -5e-4, 0, (TAUT,), 2.0329670e-3, 1.0989011e-4, 0, 2.005495e-6),
    (2e-3, -6e-4, 0, (TAUT, WRINKLED), 2.0000000e-3, 0, 0, 2.000000e-6),
    (2e-3, -1.5e-3, 0, (WRINKLED,), 1.9999730e-3, -9.0000810e-8, 0, 2.000041e-6),
    (1e-3, -4e-3, 8e-4, (WRINKLED,), 1.0980024e-3, 2.6386147e-5, 1.7145861e-4, 6.333958e-7),
    (0, 0, 1e-3, (WRINKLED,), 4.9995450e-4, 4.9995450e-4, 5.0002450e-4, 5.000245e-7),
    (-1e-3, -2e-3, 0, (SLACK,), -1.0000600e-7, -2.0000300e-7, 0, 2.500060e-10),
    (-1e-3, -1e-3, 0, (SLACK,), -1.0000300e-7, -1.0000300e-7, 0, 1.000030e-10),
    (-3e-3, 1e-3, 5e-4, (WRINKLED,), 1.5576212e-5, 1.0456200e-3, 1.2875547e-4, 5.638234e-7),
    (5e-4, 5e-4, 1.5e-3, (WRINKLED,), 9.9997400e-4, 9.9997400e-4, 1.0000140e-3, 2.000008e-6),
    (1e-7, -2e-3, 0, (WRINKLED,), 4.0000360e-8, -1.9999880e-7, 0, 2.000008e-10),
    (0.2, -0.1, 0.12, (WRINKLED,), 2.1556597e-1, 2.6518729e-2, 7.5618895e-2, 2.930493e-2),
]


@pytest.mark.parametrize("row", TABLE, ids=str)
def test_miyazaki_has_the_stress_energy_and_state_of_the_table(row):
    ε11, ε22, ε12, states, *stress, energy = row
    e = np.array([[ε11, ε22, 2 * ε12]])
    measured = at_strains(MIYAZAKI, "stress")(e)[0]
    assert measured == pytest.approx(stress, rel=1e-6, abs=1e-6 * max(map(abs, stress)))
    assert at_strains(MIYAZAKI, "energy")(e)[0] == pytest.approx([energy], rel=1e-6)
    assert int(at_strains(MIYAZAKI, "state")(e)[0, 0]) in states


@pytest.mark.parametrize("law", LAWS[1:], ids=NAMES[1:])
@pytest.mark.parametrize("boundary", ["taut to wrinkled", "wrinkled to slack"])
def test_stress_and_energy_are_continuous_where_the_state_switches(law, boundary):
    rng = np.random.default_rng(2)
    γ = rng.uniform(1e-3, 0.1, CELLS)
    φ = rng.uniform(0, np.pi, CELLS)
    # Either the stress across vanishes at ε2 = -ν ε1, or that along at ε1 = -u ν ε2.
    if boundary == "taut to wrinkled":
        γ1 = γ
        γ2 = -law.nu * γ
        exact = [{TAUT}, {WRINKLED}]
        moves_along = 0.0
    else:
        γ1 = law.residual_stiffness * law.nu * γ
        γ2 = -γ
        exact = [{WRINKLED}, {SLACK}]
        moves_along = 1.0
    # So near to the boundary that a continuous function changes by 1e-11 of the stiffness.
    above = strain(γ1 + 1e-11 * moves_along, γ2 + 1e-11, φ)
    below = strain(γ1 - 1e-11 * moves_along, γ2 - 1e-11, φ)
    states = [set(at_strains(law, "state")(e).ravel()) for e in (above, below)]
    assert states == exact
    for what in ("stress", "energy"):
        jump = at_strains(law, what)(above) - at_strains(law, what)(below)
        assert abs(jump).max() <= 1e-9


@pytest.mark.parametrize("law", LAWS, ids=NAMES)
@pytest.mark.parametrize("size", [1e-6, 1e-3, 0.1])
def test_stress_is_monotone(law, size):
    a = random_strains(CELLS, size, seed=3)
    b = random_strains(CELLS, size, seed=4)
    S = at_strains(law, "stress")
    difference = S(a) - S(b)
    work = (difference * (a - b)).sum(axis=1)
    # Never negative but for the round-off of E size².
    assert work.min() >= -1e-15 * size**2


@pytest.mark.parametrize("law", LAWS, ids=NAMES)
@pytest.mark.parametrize("γ", [0.1, 1e-3, 1e-12, 0.0, -1e-12, -1e-3, -0.1])
def test_equal_principal_strains_give_equal_principal_stresses(law, γ):
    e = np.array([[γ, γ, 0.0]])
    stress = at_strains(law, "stress")(e)[0]
    u = 1.0 if γ >= 0 or law.quadratic else law.residual_stiffness
    expected = u * law.E / (1 - u * law.nu) * γ
    # the guard of the root in the wrinkled branch leaves a stress of 5e-16 E at zero strain
    assert stress == pytest.approx([expected, expected, 0], rel=1e-12, abs=1e-15)
    assert np.isfinite(at_strains(law, "tangent")(e)).all()


@pytest.mark.parametrize("law", LAWS, ids=NAMES)
def test_film_is_isotropic(law):
    rng = np.random.default_rng(6)
    γ1, γ2 = rng.uniform(-0.1, 0.1, (2, CELLS))
    angle = rng.uniform(0, np.pi, CELLS)
    energy = at_strains(law, "energy")
    along_axes = energy(strain(γ1, γ2, np.zeros(CELLS)))
    turned = energy(strain(γ1, γ2, angle))
    # The absolute term is for slack film, whose energy cancels to zero.
    assert along_axes == pytest.approx(turned, rel=1e-12, abs=1e-17)


def test_tension_field_is_the_limit_of_small_residual_stiffness():
    e = random_strains(CELLS, 0.1, seed=7)
    limit = at_strains(TensionField(**UNIT), "stress")(e)
    for u in (1e-2, 1e-4, 1e-6):
        law = Miyazaki(**UNIT, residual_stiffness=u)
        stress = at_strains(law, "stress")(e)
        error = abs(stress - limit).max()
        # u E/(1 - ν) times the largest strain, 0.1.
        assert error <= 0.15 * u


def test_tension_field_bears_no_compression():
    e = random_strains(CELLS, 0.1, seed=8)
    law = TensionField(**UNIT)
    S = at_strains(law, "stress")(e)
    state = at_strains(law, "state")(e)[:, 0]
    mean = (S[:, 0] + S[:, 1]) / 2
    radius = np.hypot((S[:, 0] - S[:, 1]) / 2, S[:, 2])
    assert (mean - radius).min() >= -1e-15
    assert abs(S[state == SLACK]).max() == 0
    wrinkled = state == WRINKLED
    assert (mean - radius)[wrinkled] == pytest.approx(0, abs=1e-15)
    mean_strain = (e[:, 0] + e[:, 1]) / 2
    strain_radius = np.hypot((e[:, 0] - e[:, 1]) / 2, e[:, 2] / 2)
    γ1 = mean_strain + strain_radius
    # The stress along is uniaxial: E γ1.
    assert (mean + radius)[wrinkled] == pytest.approx(γ1[wrinkled], rel=1e-12)


def test_full_residual_stiffness_never_wrinkles():
    e = random_strains(CELLS, 0.1, seed=9)
    S = [
        at_strains(law, "stress")(e)
        for law in (Miyazaki(**UNIT, residual_stiffness=1.0), Linear(**UNIT))
    ]
    assert S[0] == pytest.approx(S[1], rel=1e-12, abs=1e-16)


def test_the_mean_stress_of_wrinkles_does_the_work_of_the_energy():
    """Also of film whose residual stiffness is not small."""
    law = Miyazaki(**UNIT, residual_stiffness=0.3)
    c = constants(law, SQUARE)
    mean = Samples(lambda a, b: law._wrinkled_stress(a, b, c), arguments=2)
    rng = np.random.default_rng(3)
    γ1 = rng.uniform(0.5, 1.0, (2, 50))
    γ2 = -rng.uniform(0.6, 0.9, (2, 50)) * γ1
    a, b = (strain(γ1[k], γ2[k], rng.uniform(0, 0.3, 50)) for k in range(2))
    assert set(at_strains(law, "state")(np.vstack([a, b])).ravel()) == {WRINKLED}
    energy = at_strains(law, "energy")
    work = (mean(a, b) * (b - a)).sum(axis=1)
    assert work == pytest.approx((energy(b) - energy(a)).ravel(), rel=1e-7, abs=1e-9)
