"""Films of rubber: closed forms of finite strain, a balloon past its limit point, and balances of a
sheet that goes slack."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from demos.studies.equilibrium_paths import RADIUS, octant
from gossamer_fx.materials import MooneyRivlin, NeoHooke
from gossamer_fx.mechanics.materials.film import SLACK, TAUT, WRINKLED, constants
from gossamer_fx.meshes.sheet import EDGES, sheet
from tests.small_scenes import at_rest, run_until
from tests.strain_samples import CELLS, SQUARE, Samples, at_strains, random_strains, strain

μ = 4e5  # Pa
FILM = {"density": 950.0, "thickness": 1e-3}
NEO_HOOKE = NeoHooke(μ, **FILM, residual_stiffness=0.0)
# C2/C1 = 0.1 and the same shear modulus
MOONEY_RIVLIN = MooneyRivlin(μ / 2.2, 0.1 * μ / 2.2, **FILM)


def of_stretches(λ1, λ2):
    """Strains (n, 3) along the axes."""
    γ = [(np.atleast_1d(λ) ** 2 - 1) / 2 for λ in (λ1, λ2)]
    return strain(*np.broadcast_arrays(*γ), 0.0)


@pytest.mark.parametrize(("law", "share"), [(NEO_HOOKE, 0.0), (MOONEY_RIVLIN, 0.1)], ids=str)
def test_stresses_of_uniaxial_and_equibiaxial_tension(law, share):
    """Nominal forces over the width [N/m], μ t (λ - λ⁻²)(1 + k/λ)/(1 + k) and μ t (λ - λ⁻⁵)(1 + k
    λ²)/(1 + k), k = C2/C1 (Treloar, eqs. 5.24 to 5.26 and 11.4)."""
    λ = np.linspace(1.0, 6.0, 26)
    stress = at_strains(law, "stress")
    uniaxial = λ * stress(of_stretches(λ, λ**-0.5))[:, 0]
    factor = μ * FILM["thickness"] / (1 + share)
    np.testing.assert_allclose(uniaxial, factor * (λ - λ**-2) * (1 + share / λ), atol=1e-8)
    equibiaxial = λ * stress(of_stretches(λ, λ))[:, 0]
    exact = factor * (λ - λ**-5) * (1 + share * λ**2)
    np.testing.assert_allclose(equibiaxial, exact, rtol=1e-12, atol=1e-9)


def test_states_and_energies_of_neo_hooke():
    cases = [(2.0, 0.75, TAUT), (2.0, 0.5, WRINKLED), (0.9, 0.8, SLACK), (1.0, 1.0, TAUT)]
    λ1, λ2, states = (np.array(column) for column in zip(*cases, strict=True))
    e = of_stretches(λ1, λ2)
    np.testing.assert_array_equal(at_strains(NEO_HOOKE, "state")(e)[:, 0], states)
    taut = λ1**2 + λ2**2 + (λ1 * λ2) ** -2 - 3
    wrinkled = λ1**2 + 2 / λ1 - 3
    exact = μ * FILM["thickness"] / 2 * np.choose(states.astype(int), [0.0, wrinkled, taut])
    np.testing.assert_allclose(at_strains(NEO_HOOKE, "energy")(e)[:, 0], exact, atol=1e-12)


def test_relaxed_energy_is_convex():
    """Its tangent has no negative eigenvalue in any state."""
    tangent = at_strains(NEO_HOOKE, "tangent")(random_strains(CELLS, 0.4, seed=2))
    eigenvalues = np.linalg.eigvalsh(tangent.reshape(-1, 3, 3))
    assert eigenvalues.min() >= -1e-9 * eigenvalues.max()


@pytest.mark.parametrize("law", [NEO_HOOKE, MOONEY_RIVLIN], ids=str)
def test_small_strains_have_the_energy_of_linear_film(law):
    """3 μ is Young's modulus, and ν = 1/2; no digits are lost."""
    linear = gx.Linear(3 * μ, 0.5, **FILM)
    e = abs(random_strains(100, 1e-8, seed=3)) * (1, 1, 0.1)
    expected = at_strains(linear, "energy")(e)
    np.testing.assert_allclose(at_strains(law, "energy")(e), expected, rtol=1e-6)


def test_strain_of_a_prestress_is_the_inverse_of_the_stress():
    e = of_stretches(1.3, 1.5)
    e[:, 2] = 0.2
    c = constants(NEO_HOOKE, SQUARE)
    found = Samples(lambda S: NEO_HOOKE.taut_strain(S, c))(at_strains(NEO_HOOKE, "stress")(e))
    np.testing.assert_allclose(found, e, rtol=1e-12)


@pytest.mark.mpi
@pytest.mark.parametrize("stretch", [1.5, 3.0])
def test_a_strip_that_is_stretched_at_once_does_not_turn_over(comm, stretch: float) -> None:
    """Cells that had turned over, which the strain does not see, were taken for an equilibrium."""
    film = gx.Membrane(sheet(comm, 4, 4), MOONEY_RIVLIN)
    law = film.law

    def moved(X: np.ndarray, t: float) -> np.ndarray:
        return np.outer([t, 0.0, 0.0], np.ones(X.shape[1]))

    right = gx.Fixed(film, "right", components=(0,), motion=moved)
    others = [gx.Fixed(film, "left", components=(0,)), gx.Fixed(film, "bottom", components=(1,))]
    flat = gx.Fixed(film, "film", components=(2,))
    equilibrium = gx.Equilibrium(gx.Scene(film, right, *others, flat))
    equilibrium.find(at=stretch - 1)
    force, _ = equilibrium.reaction(right)
    λ = stretch
    exact = 2 * law.thickness * (law.C1 + law.C2 / λ) * (λ - λ**-2)
    assert force[0] == pytest.approx(exact, rel=1e-9)


def balloon_path(comm, law, until, max_steps=200):
    """Pressures over μ t/r0, stretches and the path of a balloon."""
    film = gx.Membrane(octant(comm, 4), law, order=2)
    held = [gx.Fixed(film, name, components=(axis,)) for axis, name in enumerate("xyz")]
    unit = μ * FILM["thickness"] / RADIUS
    equilibrium = gx.Equilibrium(gx.Scene(gx.Pressure(film, lambda t: unit * t), *held))
    top = gx.probes.Position(film.port_at((0.0, 0.0, RADIUS)), "z")
    found = gx.analysis.path(
        equilibrium, until, start=0.2, first_step=0.2, probes={"z": top}, max_steps=max_steps
    )
    return found, found.columns["z"] / RADIUS


@pytest.mark.mpi
def test_balloon_of_neo_hooke_passes_its_limit_point(comm):
    """p r0/(μ t) = 2 (1/λ - λ⁻⁷), at most 1.2395 at λ⁶ = 7; beyond it the pressure falls, and a
    balloon under that pressure is not stable."""
    found, λ = balloon_path(comm, NEO_HOOKE, 1.5, max_steps=16)
    (limit,) = found.limit_points
    assert found.loads[limit] == pytest.approx(2 * (7 ** (-1 / 6) - 7 ** (-7 / 6)), rel=3e-4)
    assert λ[limit] == pytest.approx(7 ** (1 / 6), rel=1e-3)
    np.testing.assert_allclose(found.loads, 2 * (1 / λ - λ**-7), rtol=2e-3)
    assert not found.unstable[:limit].any() and (found.unstable[limit:] == 1).all()


@pytest.mark.mpi
@pytest.mark.parametrize(("λ", "unstable"), [(1.2, 0), (2.0, 1), (3.5, 0)])
def test_a_balloon_found_between_its_limit_points_is_not_stable(comm, caplog, λ, unstable):
    film = gx.Membrane(octant(comm, 4), MOONEY_RIVLIN, order=2, displacement=lambda X: (λ - 1) * X)
    held = [gx.Fixed(film, name, components=(axis,)) for axis, name in enumerate("xyz")]
    pressure = 2 * (1 / λ - λ**-7) * (1 + 0.1 * λ**2) / 1.1
    load = gx.Pressure(film, pressure * μ * FILM["thickness"] / RADIUS)
    result = at_rest(load, *held).result
    assert result.regular and result.unstable == unstable
    assert ("not stable" in result.summary()) == (unstable > 0)
    if comm.rank == 0:
        assert ("its stiffness has 1 negative eigenvalue," in caplog.text) == (unstable > 0)


def test_balloon_of_mooney_rivlin_has_two_limit_points(comm):
    """p r0/(μ t) = 2 (1/λ - λ⁻⁷)(1 + k λ²)/(1 + k) with k = C2/C1: falls and rises again."""
    found, λ = balloon_path(comm, MOONEY_RIVLIN, 1.6)
    exact = 2 * (1 / λ - λ**-7) * (1 + 0.1 * λ**2) / 1.1
    np.testing.assert_allclose(found.loads, exact, rtol=2e-3)
    stretch = np.linspace(1.2, 5.0, 100001)
    slope = np.diff(2 * (1 / stretch - stretch**-7) * (1 + 0.1 * stretch**2) / 1.1)
    limits = stretch[1:-1][slope[1:] * slope[:-1] <= 0]
    np.testing.assert_allclose(λ[list(found.limit_points)], limits, rtol=2e-3)


def thrown(X: np.ndarray) -> np.ndarray:
    """A spin with flutter, in which cells go taut, wrinkled and slack."""
    x, y, _ = X
    flutter = 4 * np.sin(np.pi * x) * np.sin(2 * np.pi * y)
    return np.vstack([-20 * (y - 0.5), 20 * (x - 0.5), flutter])


@pytest.mark.parametrize("law", [NeoHooke(μ, **FILM), MOONEY_RIVLIN], ids=str)
def test_free_sheet_conserves_over_a_thousand_steps(comm, law):
    film = gx.Membrane(sheet(comm, 5, 5), law, velocity=thrown)
    run = run_until(2.0, film, dt=2e-3, tolerances=gx.Tolerances(relative=1e-12))
    assert run.step == 1000
    assert abs(run.energy_error) <= 1e-9
    spin = run.totals.angular_momentum - run.first.angular_momentum
    assert abs(spin).max() <= 1e-11 * abs(run.first.angular_momentum).max()


@pytest.mark.parametrize("law", [NEO_HOOKE, MOONEY_RIVLIN], ids=str)
def test_damping_of_small_strain_is_that_of_linear_film(comm, law):
    losses = []
    for each in (law, gx.Linear(3 * μ, 0.5, **FILM)):
        film = gx.Membrane(sheet(comm, 2, 2), each, velocity=lambda X: 1e-4 * X)
        damping = gx.Damping(film, stiffness_factor=1e-3)
        losses.append(run_until(1e-2, film, damping, dt=1e-3).totals.dissipated)
    assert losses[0] == pytest.approx(losses[1], rel=1e-5)
    assert losses[1] > 0


@pytest.mark.mpi
def test_height_of_a_balloon_has_the_gradient_of_differences(comm):
    def equilibrium(shear_modulus):
        law = NeoHooke(shear_modulus, **FILM)
        film = gx.Membrane(sheet(comm, 3, 3), law, name="film")
        held = [gx.Fixed(film, edge) for edge in EDGES]
        found = gx.Equilibrium(gx.Scene(gx.Pressure(film, 500.0), *held))
        found.find()
        return found, gx.probes.Position(film.port_at((1 / 3, 1 / 3, 0.0)), "z")

    at_rest, height = equilibrium(μ)
    name = "film.shear_modulus"
    slope = gx.analysis.gradient(at_rest, of=height, by=[name])[name].along(1.0)
    heights = [probe(state) for state, probe in (equilibrium(μ + δ) for δ in (40.0, -40.0))]
    assert slope == pytest.approx((heights[0] - heights[1]) / 80.0, rel=1e-6)
