"""Every film law on 1e5 random strains: stress and tangent are derivatives, the energy is convex
and C1.  E = t = 1."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
import ufl

from gossamer_fx import Elastica, Linear, Miyazaki, TensionField
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.materials.film import FilmLaw, constants
from tests.strain_samples import CELLS, SQUARE, Samples, random_strains

UNIT = {"E": 1.0, "nu": 0.3, "density": 1.0, "thickness": 1.0}
LAWS = [
    Linear(**UNIT),
    Miyazaki(**UNIT, residual_stiffness=1e-4),
    TensionField(**UNIT),
    Elastica(**UNIT, half_wavelength=math.pi * 1e2 / math.sqrt(12)),  # buckles at a strain of 1e-4
]
SIZES = (1e-5, 1e-3, 0.1, 0.35)
BATCHES = math.ceil(1e5 / CELLS / len(SIZES))
every_law = pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)


@cache
def response(law: FilmLaw) -> Samples:
    """(energy, stress (3), tangent (9, row by row), state)."""
    c = constants(law, SQUARE)

    def expression(e):
        e = ufl.variable(e)
        W = law.energy(e, c)
        S = ufl.diff(W, e)
        D = ufl.diff(S, e)
        return ufl.as_vector(
            [
                W,
                *(S[i] for i in range(3)),
                *(D[i, j] for i in range(3) for j in range(3)),
                law.state(e, c),
            ]
        )

    return Samples(expression)


def strains():
    """1e5 strains in batches, with their size."""
    for size in SIZES:
        for seed in range(BATCHES):
            yield size, random_strains(CELLS, size, seed)


def parts(values: Array) -> tuple[Array, Array, Array, Array]:
    return values[:, 0], values[:, 1:4], values[:, 4:13].reshape(-1, 3, 3), values[:, 13]


@every_law
def test_tangent_is_symmetric_and_positive_semidefinite(law):
    lowest = 0.0
    skew = 0.0
    for _, e in strains():
        D = parts(response(law)(e))[2]
        skew = max(skew, abs(D - D.transpose(0, 2, 1)).max())
        lowest = min(lowest, np.linalg.eigvalsh((D + D.transpose(0, 2, 1)) / 2).min())
    assert skew <= 1e-10
    assert lowest >= -1e-10


@every_law
def test_stress_and_tangent_are_derivatives(law):
    """Central differences, where both ends have the state of the middle."""
    compared = 0
    for size, e in strains():
        _, S, D, state = parts(response(law)(e))
        δ = 1e-5 * size
        for j, d in enumerate(np.eye(3)):
            (W1, S1, _, s1), (W0, S0, _, s0) = (
                parts(response(law)(e + sign * δ * d)) for sign in (1, -1)
            )
            same = (s1 == state) & (s0 == state)
            of_stress = abs((W1 - W0) / (2 * δ) - S[:, j])[same]
            of_tangent = abs((S1 - S0) / (2 * δ) - D[:, :, j]).max(axis=1)[same]
            # a few strains of a buckled film are within δ of a change of stiffness
            assert np.quantile(of_stress, 0.995) <= 2e-8 * size and of_stress.max() <= δ
            assert np.quantile(of_tangent, 0.995) <= 1e-6 and of_tangent.max() <= 2
            compared += same.sum()
    assert compared > 2.5e5


@every_law
def test_energy_and_stress_do_not_jump_where_the_state_switches(law):
    """Random lines in strain space, bisected to where the state changes."""
    crossed = 0
    for size in SIZES:
        a = random_strains(CELLS, size, seed=1)
        b = random_strains(CELLS, size, seed=2)
        state = parts(response(law)(a))[3]
        for _ in range(50):
            middle = (a + b) / 2
            same = (parts(response(law)(middle))[3] == state)[:, None]
            a = np.where(same, middle, a)
            b = np.where(same, b, middle)
        (Wa, Sa, _, sa), (Wb, Sb, _, sb) = parts(response(law)(a)), parts(response(law)(b))
        switched = sa != sb
        crossed += switched.sum()
        assert abs(Wa - Wb)[switched].max(initial=0.0) <= 1e-10
        assert abs(Sa - Sb)[switched].max(initial=0.0) <= 1e-9
    assert crossed > 1000 or law.quadratic
