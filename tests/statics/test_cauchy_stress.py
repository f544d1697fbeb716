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


@pytest.mark.mpi
@pytest.mark.parametrize("law", [LINEAR, gx.Miyazaki(E, NU, **FILM)], ids=["linear", "wrinkling"])
def test_thickness_of_a_film_held_on_its_rim_includes_its_thermal_expansion(comm, law):
    """Film that is held and cooled by Δλ = -2 %: it becomes thinner by the cold and by the tension,
    and its area does not change."""
    cooled = gx.materials.ThermalExpansion(1e-3, 273.0, reference=293.0)
    film = gx.Membrane(sheet(comm, 2, 2), law, thermal=cooled)
    scene = gx.Equilibrium(gx.Scene(film))
    thermal = 1 - 0.02
    # Elastic Green-Lagrange strain, as the surface has the size of the mesh
    strain = (1 - thermal**2) / 2
    thickness = thermal * math.sqrt(1 - 2 * NU / (1 - NU) * 2 * strain)
    exact = E * strain / (1 - NU) / thickness
    assert gx.probes.LargestStress(film)(scene) == pytest.approx(exact, rel=1e-6)


@pytest.mark.mpi
@pytest.mark.parametrize("law", [LINEAR, MOONEY_RIVLIN], ids=["linear", "rubber"])
def test_force_of_a_heated_film_is_its_stress_times_its_present_section(comm, law):
    """A film that is hot, and stretched beyond its free size: free, it would have grown by λ in all
    directions, so that the section of one metre of mesh is λ3 of its first thickness."""
    hot = gx.materials.ThermalExpansion(1e-3, 313.0, reference=293.0)
    stretch = 1.1
    film = gx.Membrane(sheet(comm, 2, 2), law, thermal=hot, displacement=lambda X: 0.1 * X)
    scene = gx.Equilibrium(gx.Scene(film))
    thermal = ((1.02) ** 2 - 1) / 2
    strain = (stretch**2 - 1) / 2 - thermal
    across = 1 / math.sqrt(1 + 2 * strain) ** 2
    if law is LINEAR:
        across = math.sqrt(1 - 4 * NU / (1 - NU) * strain)
    # Nominal force over width [N/m] = S λ; section over width = t λ λ3
    _, S = gx.fields.field_values(scene, film, field="second_piola_stress1")
    _, values = gx.fields.field_values(scene, film, field="stress1")
    np.testing.assert_allclose(values, S / (across * 1.02), rtol=1e-6)
