"""Temperature of films in sunlight: closed forms, order, balance, ranks and restarts."""

from __future__ import annotations

import math
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from dolfinx.mesh import locate_entities
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.orbit.film_heat import (
    STEFAN_BOLTZMANN,
    advance,
    equilibrium_temperature,
    substeps,
    view_factor,
)
from gossamer_fx.mechanics.orbit.solar_heating import LIGHT_SPEED, HeatedFilms
from gossamer_fx.meshes.sheet import crossed_sheet, sheet
from tests.rates import observed_order
from tests.small_scenes import run_until

# Material of the film: it matters little where only heat is tested.
FILM = gx.Linear(2e9, 0.3, density=1400.0, thickness=1e-5)
RADIUS = 7e6  # of the orbit [m]
CAPACITY = 15.0  # J/(m² K)
ALUMINISED = gx.orbit.ThermalProperties(CAPACITY, absorptivity=0.2, emissivity=(0.05, 0.6))


def flight(
    comm,
    *,
    T0: float,
    dt: float,
    until: float,
    spin: float = 0.0,
    thermal=None,
    properties=ALUMINISED,
    shadow: str = "none",
    sun=(0.0, 0.0, 1.0),
    **options,
) -> SimpleNamespace:
    """A free film over the equator, damped, with its front towards a Sun over the pole."""
    film = gx.Membrane(crossed_sheet(comm, 2, 2), FILM, thermal=thermal)
    orbit = gx.orbit.Orbit(gx.orbit.Elements(RADIUS), sun=sun, shadow=shadow)
    heating = gx.orbit.SolarHeating(
        film, orbit, properties, initial_temperature=T0, space_temperature=0.0, **options
    )
    items = [film, orbit, heating, gx.Damping(film, stiffness_factor=1e-2)]
    if spin:
        items.append(gx.RigidMotion(spin=(spin, 0.0, 0.0), centre=(0.5, 0.5, 0.0)))
    run = run_until(until, *items, dt=dt)
    return SimpleNamespace(run=run, film=film, heating=heating, heat=heating.balance(run))


def flux() -> float:
    """Flux of sunlight at 1 au [W/m²]."""
    return LIGHT_SPEED * gx.orbit.Orbit(gx.orbit.Elements(RADIUS)).pressure


def test_a_sunlit_film_reaches_radiative_equilibrium(comm) -> None:
    """(ε_f + ε_b) σ T⁴ = α S."""
    end = flight(comm, T0=250.0, dt=2.0, until=200.0)
    expected = (0.2 * flux() / (0.65 * STEFAN_BOLTZMANN)) ** 0.25
    # The Sun is not quite overhead: the film is 7000 km from the line to it.
    assert end.heat.mean == pytest.approx(expected, rel=1e-6)
    assert end.heat.highest - end.heat.lowest < 1e-6
    assert abs(end.heat.error) < 1e-12
    assert abs(end.run.energy_error) < 1e-9


@pytest.mark.parametrize("until", [2.0, 8.0])
def test_it_is_reached_with_the_time_constant_of_the_film(comm, until: float) -> None:
    """A small difference decays as exp(-t/τ), τ = C/(4 (ε_f + ε_b) σ T³)."""
    final = (0.2 * flux() / (0.65 * STEFAN_BOLTZMANN)) ** 0.25
    τ = CAPACITY / (4 * 0.65 * STEFAN_BOLTZMANN * final**3)
    start = final * (1 + 1e-5)
    end = flight(comm, T0=start, dt=0.1, until=until)
    assert (end.heat.mean - final) / (start - final) == pytest.approx(
        # Linearised law for a difference of 1e-5.
        math.exp(-until / τ),
        rel=1e-3,
    )


def test_cooling_in_the_dark_is_the_closed_form() -> None:
    """C dT/dt = -B T⁴ gives T = T0 (1 + 3 B T0³ t/C)^(-1/3); the error is of second order."""
    B = np.array([STEFAN_BOLTZMANN])
    none = np.zeros(1)
    T0 = np.array([350.0])
    exact = 350.0 * (1 + 3 * STEFAN_BOLTZMANN * 350.0**3 * 20.0 / CAPACITY) ** (-1 / 3)
    counts = [4, 8, 16, 32]
    errors = []
    for count in counts:
        T, emitted = advance(T0, 20.0, CAPACITY, none, B, count=count)
        errors.append(float(T[0]) - exact)
        # What is emitted is what the content loses, to round-off.
        assert emitted[0] == pytest.approx(CAPACITY * (350.0 - T[0]), rel=1e-12)
    assert observed_order([1 / count for count in counts], errors) == pytest.approx(2.0, abs=0.1)
    # As fine as a step of the motion is divided at least.
    assert counts[-1] >= substeps(T0, 20.0, CAPACITY, none, B)
    # K, of 350 K.
    assert abs(errors[-1]) < 0.05


def test_steps_far_longer_than_the_time_constant_end_at_equilibrium() -> None:
    A = np.array([0.0, 100.0, 1000.0])
    B = np.full(3, STEFAN_BOLTZMANN)
    T0 = np.full(3, 400.0)
    # 1e9 s at a time constant of below a second.
    count = substeps(T0, 1e9, 1e-3, A, B)
    T, _ = advance(T0, 1e9, 1e-3, A, B, count=count)
    assert T[1:] == pytest.approx(equilibrium_temperature(A, B)[1:], rel=1e-9)
    assert 0 <= T[0] < 1.0


def test_a_turning_film_is_of_second_order_in_the_step(comm) -> None:
    """The facing is that of the shape at the middle of the step, extrapolated from its start."""
    steps = [2.0, 1.0, 0.5, 0.25]
    ends = [
        flight(comm, T0=280.0, dt=dt, until=40.0, spin=0.05).heat.mean for dt in [*steps, 0.0625]
    ]
    errors = [T - ends[-1] for T in ends[:-1]]
    assert observed_order(steps, errors) == pytest.approx(2.0, abs=0.25)
    # It has turned away from the Sun and cooled.
    assert abs(errors[-1]) < 0.02 < 280.0 - ends[-1]


def test_the_back_absorbs_as_the_back_does(comm) -> None:
    """A film that turns its back to the Sun has the temperature of the back's absorptivity."""
    dark_back = gx.orbit.ThermalProperties(CAPACITY, absorptivity=(0.1, 0.8), emissivity=0.4)
    temperatures = []
    for side in (1.0, -1.0):
        end = flight(
            comm, T0=300.0, dt=2.0, until=150.0, sun=(0.0, 0.0, side), properties=dark_back
        )
        temperatures.append(end.heat.mean)
    # Eight times the absorptivity: T⁴ is proportional to it.
    assert temperatures[1] / temperatures[0] == pytest.approx(8**0.25, rel=1e-6)


def test_a_film_expands_with_its_temperature(comm) -> None:
    thermal = gx.materials.ThermalExpansion(2e-5, 250.0, reference=250.0)
    film = gx.Membrane(crossed_sheet(comm, 2, 2), FILM, thermal=thermal)
    orbit = gx.orbit.Orbit(gx.orbit.Elements(RADIUS), sun=(0.0, 0.0, 1.0), shadow="none")
    heating = gx.orbit.SolarHeating(film, orbit, ALUMINISED)
    damping = gx.Damping(film, stiffness_factor=1e-2)
    run = gx.Simulation(gx.Scene(film, orbit, heating, damping), gx.Midpoint(dt=0.5))
    assert heating.balance(run).mean == 250.0
    run.run(until=150.0)
    heat = heating.balance(run)
    elongation = 2e-5 * (heat.mean - 250.0)
    strain = gx.fields.field_values(run, film, field="strain1")[1]
    # Green's strain ε + ε²/2 of the elongation ε.
    np.testing.assert_allclose(strain, elongation * (1 + elongation / 2), rtol=1e-3)
    temperature = gx.fields.field_values(run, film, field="temperature")[1]
    np.testing.assert_allclose(temperature, heat.mean, rtol=1e-12)
    assert abs(run.energy_error) < 1e-9


@pytest.mark.mpi
def test_groups_have_their_own_temperatures(comm) -> None:
    mesh = crossed_sheet(comm, 2, 2)
    dark = locate_entities(mesh.domain, 2, lambda x: x[0] < 0.5 + 1e-9)
    film = gx.Membrane(gx.Mesh(mesh.domain, {"dark": (2, dark)}), FILM)
    orbit = gx.orbit.Orbit(gx.orbit.Elements(RADIUS), sun=(0.0, 0.0, 1.0), shadow="none")
    black = gx.orbit.ThermalProperties(2 * CAPACITY, absorptivity=0.9, emissivity=0.9)
    heating = gx.orbit.SolarHeating(
        film, orbit, ALUMINISED, groups={"dark": black}, initial_temperature=300.0
    )
    run = run_until(300.0, film, orbit, heating, dt=5.0)
    heat = heating.balance(run)
    # Absorbed by one face, emitted by two, of the same value 0.9, which cancels.
    assert heat.highest == pytest.approx((flux() / (2 * STEFAN_BOLTZMANN)) ** 0.25, rel=1e-5)
    assert heat.lowest == pytest.approx(
        (0.2 * flux() / (0.65 * STEFAN_BOLTZMANN)) ** 0.25, rel=1e-5
    )
    # Without expansion the field shows the temperature of each triangle.
    values = gx.fields.field_values(run, film, field="temperature")[1]
    assert comm.allreduce(values.max(initial=0.0), op=MPI.MAX) == pytest.approx(heat.highest)


# ---- the Earth -----------------------------------------------------------------------------------


@pytest.mark.parametrize("height", [1.05, 1.2, 3.0])
@pytest.mark.parametrize("angle", [0.0, 0.5, 1.2, 1.57, 2.0, 2.6, 3.0])
def test_the_view_factor_is_the_integral_over_the_visible_sphere(height, angle) -> None:
    """F = (1/π) ∫ max(cos θ, 0) dΩ by midpoints, over the cone in which the sphere is seen."""
    n = 800
    cone = math.asin(1 / height)
    polar = (np.arange(n)[:, None] + 0.5) / n * cone
    azimuth = (np.arange(n)[None] + 0.5) / n * 2 * math.pi
    cosine = np.sin(polar) * np.cos(azimuth) * math.sin(angle) + np.cos(polar) * math.cos(angle)
    solid_angle = np.sin(polar) * (cone / n) * (2 * math.pi / n)
    integral = float((np.maximum(cosine, 0.0) * solid_angle).sum()) / math.pi
    found = float(view_factor(np.array([math.cos(angle)]), height)[0])
    # 800 × 800 midpoints.
    assert found == pytest.approx(integral, abs=2e-6)


def test_infrared_of_the_earth_keeps_a_film_warm(comm) -> None:
    """Edge on to the Earth in the dark: both faces see it, each with the same view factor."""
    grey = gx.orbit.ThermalProperties(CAPACITY, absorptivity=0.0, emissivity=0.5)
    end = flight(comm, T0=200.0, dt=10.0, until=3000.0, properties=grey, infrared=237.0)
    height = RADIUS / gx.orbit.Orbit(gx.orbit.Elements(RADIUS)).radius
    share = float(view_factor(np.array([0.0]), height)[0])
    # 3000 s are some time constants of the film.
    assert end.heat.mean == pytest.approx((share * 237.0 / STEFAN_BOLTZMANN) ** 0.25, rel=1e-4)


def test_albedo_adds_to_the_day_side_only(comm) -> None:
    """The film turns its edge to the Sun and one face to the Earth, above the brightest point."""
    temperatures = []
    for albedo in (0.0, 0.3):
        film = gx.Membrane(
            crossed_sheet(comm, 2, 2),
            FILM,
            displacement=lambda X: np.vstack([-X[0], 0 * X[0], X[0]]),
        )
        # The film is across the x axis, on which both the Sun and the film are.
        orbit = gx.orbit.Orbit(gx.orbit.Elements(RADIUS), sun=(1.0, 0.0, 0.0), shadow="none")
        heating = gx.orbit.SolarHeating(
            film,
            orbit,
            gx.orbit.ThermalProperties(1e-3, absorptivity=0.3, emissivity=0.5),
            initial_temperature=300.0,
            space_temperature=0.0,
            albedo=albedo,
        )
        run = run_until(1.0, film, orbit, heating, dt=0.5)
        temperatures.append(heating.balance(run).mean)
    height = RADIUS / orbit.radius
    # The whole Earth is seen: F = 1/H².
    ratio = 1 + 0.3 / height**2
    assert (temperatures[1] / temperatures[0]) ** 4 == pytest.approx(ratio, rel=1e-3)


def test_an_eclipse_cools_the_film_as_fast_as_it_radiates(comm) -> None:
    """From its beginning on, T = T0 (1 + 3 B T0³ t/C)^(-1/3)."""
    # On the night side, with the Sun behind the Earth.
    end = flight(comm, T0=290.0, dt=1.0, until=60.0, sun=(-1.0, 0.0, 0.0), shadow="cylinder")
    B = 0.65 * STEFAN_BOLTZMANN
    expected = 290.0 * (1 + 3 * B * 290.0**3 * 60.0 / CAPACITY) ** (-1 / 3)
    assert end.heat.absorbed == 0.0
    # Time step error of the emission.
    assert end.heat.mean == pytest.approx(expected, rel=1e-3)
    assert abs(end.heat.error) < 1e-12


# ---- histories -----------------------------------------------------------------------------------


def heated_run(comm, until: float, **options: object) -> tuple[gx.Simulation, object]:
    """A film with hot and cold triangles, in flutter."""
    thermal = gx.materials.ThermalExpansion(2e-5, {"dark": 320.0}, reference=250.0)
    mesh = crossed_sheet(comm, 3, 3)
    dark = locate_entities(mesh.domain, 2, lambda x: x[0] < 1 / 3 + 1e-9)
    film = gx.Membrane(gx.Mesh(mesh.domain, {"dark": (2, dark)}), FILM, thermal=thermal)
    orbit = gx.orbit.Orbit(gx.orbit.Elements(RADIUS), sun=(0.0, 0.6, 0.8), shadow="none")
    heating = gx.orbit.SolarHeating(film, orbit, ALUMINISED)
    spin = gx.RigidMotion(spin=(0.3, 0.0, 0.2), centre=(0.5, 0.5, 0.0))
    damping = gx.Damping(film, stiffness_factor=1e-3)
    scene = gx.Scene(film, orbit, heating, spin, damping)
    stepper = gx.Midpoint(dt=0.05, tolerances=gx.Tolerances(relative=1e-11))
    run = gx.Simulation(scene, stepper, **options)
    run.run(until=until)
    return run, heating


@pytest.mark.mpi
def test_a_restart_goes_on_with_the_temperatures_of_all_triangles(comm, folder: Path) -> None:
    whole, heating = heated_run(comm, 0.4)
    half, _ = heated_run(comm, 0.2, checkpoints=gx.Checkpoints(folder))
    restored, _ = heated_run(comm, 0.2, restart=folder)
    assert np.array_equal(temperatures_of(restored), temperatures_of(half))
    # Of the mean thermal strain of the last step.
    stresses = [
        gx.probes.LargestStress(one.system.unknowns.bodies[0])(one) for one in (restored, half)
    ]
    assert stresses[0] == pytest.approx(stresses[1], rel=1e-10)
    rest, again = heated_run(comm, 0.4, restart=folder)
    a = heating.balance(whole)
    b = again.balance(rest)
    # Hot film wrinkles and flutters: on several ranks the order of sums differs from run to run,
    # and the motion amplifies it.
    agreement = 1e-9 if comm.size == 1 else 1e-3
    for name in ("stored", "absorbed", "emitted", "lowest", "highest", "mean"):
        assert getattr(b, name) == pytest.approx(getattr(a, name), rel=agreement)
    assert abs(b.error) < 1e-12
    difference = abs(rest.system.unknowns.q0.array_r - whole.system.unknowns.q0.array_r).max(
        initial=0.0
    )
    assert difference < (1e-8 if comm.size == 1 else 1e-2)
    assert abs(rest.energy_error) < 1e-9


def temperatures_of(run: gx.Simulation) -> np.ndarray:
    """Temperatures [K] of this rank's triangles."""
    (kind,) = [one for one in run.system.equations.compiled if isinstance(one, HeatedFilms)]
    _, temperatures = kind.cell_history()["temperature 0"]
    return temperatures.copy()


def test_steps_that_are_undone_take_their_heat_back(comm) -> None:
    control = gx.StepControl(error=1e-7, max_step=0.2)
    run, heating = heated_run(comm, 1.0, control=control)
    assert run.substeps > 0
    heat = heating.balance(run)
    # Undone steps leave no heat behind.
    assert abs(heat.error) < 1e-12
    assert abs(run.energy_error) < 1e-8


# ---- bad input -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"heat_capacity": math.inf}, "heat_capacity"),
        ({"absorptivity": 1.5}, "absorptivity is 1.5; give a number between 0 and 1"),
        ({"emissivity": (0.5, -0.1)}, "emissivity is (0.5, -0.1); give a number between 0 and 1"),
        ({"emissivity": 0.0}, "the film absorbs and does not radiate"),
        ({"absorptivity": (0.1, 0.2, 0.3)}, "absorptivity"),
    ],
)
def test_properties_that_make_no_sense_are_refused(arguments, words: str) -> None:
    usual = {"heat_capacity": 10.0, "absorptivity": 0.1, "emissivity": 0.1}
    with pytest.raises(gx.InputError, match=re.escape(words)):
        gx.orbit.ThermalProperties(**(usual | arguments))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"albedo": 2.0}, "albedo is 2.0; give a number between 0 and 1"),
        ({"initial_temperature": None}, "give initial_temperature in K"),
    ],
)
def test_heatings_that_make_no_sense_are_refused(comm, options, words: str) -> None:
    film = gx.Membrane(sheet(comm, 2, 2), FILM)
    orbit = gx.orbit.Orbit(gx.orbit.Elements(RADIUS), sun=(0.0, 0.0, 1.0))
    with pytest.raises(gx.InputError, match=re.escape(words)):
        gx.orbit.SolarHeating(film, orbit, ALUMINISED, **({"initial_temperature": 300.0} | options))


def test_scenes_that_heat_a_film_twice_or_otherwise_are_refused(comm) -> None:
    orbit = gx.orbit.Orbit(gx.orbit.Elements(RADIUS), sun=(0.0, 0.0, 1.0))
    given = gx.materials.ThermalExpansion(1e-5, lambda X, t: 300.0 + t)
    film = gx.Membrane(sheet(comm, 2, 2), FILM, thermal=given)
    heating = gx.orbit.SolarHeating(film, orbit, ALUMINISED)
    with pytest.raises(gx.InputError, match="has a function for it; give a number"):
        gx.Simulation(gx.Scene(film, orbit, heating), gx.Midpoint(dt=1.0))
    film = gx.Membrane(sheet(comm, 2, 2), FILM)
    both = [
        gx.orbit.SolarHeating(film, orbit, ALUMINISED, initial_temperature=300.0, name=name)
        for name in ("one", "other")
    ]
    with pytest.raises(gx.InputError, match="is heated twice"):
        gx.Simulation(gx.Scene(film, orbit, *both), gx.Midpoint(dt=1.0))
    run = gx.Simulation(gx.Scene(film, orbit), gx.Midpoint(dt=1.0))
    with pytest.raises(gx.InputError, match="'one' is not in the scene"):
        both[0].balance(run)
    grouped = gx.orbit.SolarHeating(
        film, orbit, ALUMINISED, groups={"left": ALUMINISED}, initial_temperature=300.0
    )
    with pytest.raises(gx.InputError, match="the group 'left' has dimension 1"):
        gx.Simulation(gx.Scene(film, orbit, grouped), gx.Midpoint(dt=1.0))
