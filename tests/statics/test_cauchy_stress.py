"""Stresses of films of finite strain are forces over present thickness and length."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet

FILM = {"density": 1000.0, "thickness": 1e-3}
μ = 4e5  # Pa
NEO_HOOKE = gx.materials.NeoHooke(μ, residual_stiffness=0.0, **FILM)
MOONEY_RIVLIN = gx.materials.MooneyRivlin(μ / 2.2, μ / 22, **FILM)
E, NU = 1e6, 0.3
LINEAR = gx.Linear(E, NU, **FILM)


def stretched(comm, law, λ1, λ2):
    """A sheet that is stretched to λ1 and λ2 along axes that are turned against the mesh."""
    c, s = math.cos(0.4), math.sin(0.4)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    stretch = turn @ np.diag([λ1, λ2, 1.0]) @ turn.T
    film = gx.Membrane(sheet(comm, 2, 2), law, displacement=lambda X: stretch @ X - X)
    return film, gx.Equilibrium(gx.Scene(film))


def across(λ):
    """Stretches of a strip of linear film across its pull and across its surface."""
    strain = (λ**2 - 1) / 2
    return math.sqrt(1 - 2 * NU * strain)


# Law, stretches, and principal Cauchy stresses [Pa]
CASES = {
    "balloon of rubber": (NEO_HOOKE, 2.0, 2.0, μ * (4 - 2.0**-4), μ * (4 - 2.0**-4)),
    "strip of rubber": (NEO_HOOKE, 3.0, 3.0**-0.5, μ * (9 - 1 / 3), 0.0),
    "wrinkled rubber": (NEO_HOOKE, 3.0, 0.3, μ * (9 - 1 / 3), 0.0),
    "plane strain of rubber": (NEO_HOOKE, 2.0, 1.0, μ * (4 - 1 / 4), μ * (1 - 1 / 4)),
    "Mooney-Rivlin": (
        MOONEY_RIVLIN,
        2.0,
        2.0,
        2 * (4 - 2.0**-4) * (MOONEY_RIVLIN.C1 + 4 * MOONEY_RIVLIN.C2),
        2 * (4 - 2.0**-4) * (MOONEY_RIVLIN.C1 + 4 * MOONEY_RIVLIN.C2),
    ),
    "linear strip": (LINEAR, 1.2, across(1.2), 1.2 * E * 0.22 / across(1.2) ** 2, 0.0),
    "linear wrinkled strip": (
        gx.Miyazaki(E, NU, residual_stiffness=0.0, **FILM),
        1.2,
        0.5,
        1.2 * E * 0.22 / across(1.2) ** 2,
        0.0,
    ),
}


@pytest.mark.mpi
@pytest.mark.parametrize("case", CASES)
def test_principal_stresses_are_forces_over_present_sections(comm, case):
    law, λ1, λ2, σ1, σ2 = CASES[case]
    film, scene = stretched(comm, law, λ1, λ2)
    for field, exact in (("stress1", σ1), ("stress2", σ2)):
        _, values = gx.fields.field_values(scene, film, field=field)
        np.testing.assert_allclose(values, exact, rtol=1e-9, atol=1e-6 * σ1)
    von_mises = math.sqrt(σ1**2 - σ1 * σ2 + σ2**2)
    peak = gx.analysis.largest_stress(scene, film, limit=σ1)
    assert peak.stress == pytest.approx(σ1, rel=1e-9)
    assert peak.ratio == pytest.approx(1.0, rel=1e-9)
    probe = gx.probes.LargestStress(film, measure="von Mises")
    assert probe(scene) == pytest.approx(von_mises, rel=1e-6)


def test_second_piola_kirchhoff_stresses_have_their_name(comm):
    film, scene = stretched(comm, NEO_HOOKE, 2.0, 2.0)
    _, S = gx.fields.field_values(scene, film, field="second_piola_stress1")
    np.testing.assert_allclose(S, μ * (1 - 2.0**-6), rtol=1e-9)


def test_a_prestressed_film_in_the_shape_of_its_mesh_has_the_stress_that_was_given(comm):
    film = gx.Membrane(sheet(comm, 2, 2), LINEAR, initial_stress=1e5)
    scene = gx.Equilibrium(gx.Scene(film))
    assert gx.probes.LargestStress(film)(scene) == pytest.approx(1e5, rel=1e-9)
