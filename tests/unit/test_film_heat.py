"""Heat of a gas through its film: cooling laws, the deformed area, energy, restart, gradients."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.orbit.film_heat import STEFAN_BOLTZMANN
from gossamer_fx.mechanics.orbit.solar_heating import LIGHT_SPEED
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.sphere import sphere
from gossamer_fx.presets.gases import AIR
from tests.differences import pressure_by_differences
from tests.rates import observed_order
from tests.small_scenes import inwards

RADIUS = 0.2
START = 400.0  # temperature of the gas [K]
OUTSIDE = 300.0  # K


def balloon(
    comm,
    coefficient=50.0,
    dt=1e-3,
    E=1e7,
    held=False,
    velocity=None,
    temperature=START,
    outside=OUTSIDE,
    **options,
):
    """A sphere of hot air in a cold vacuum."""
    law = gx.Linear(E=E, nu=0.3, density=1000.0, thickness=1e-4)
    film = gx.Membrane(sphere(comm, RADIUS, 4), law, velocity=velocity, name="film")
    bag = gx.Chamber(film, gas=AIR, pressure=3e3, temperature=temperature, name="bag")
    cold = gx.gas.FilmHeat(
        bag,
        gx.gas.FilmArea(film),
        coefficient=coefficient,
        temperature=outside,
        name="cold",
    )
    supports = [gx.Fixed(film, "film")] if held else []
    stepper = gx.Midpoint(dt=dt, tolerances=gx.Tolerances(relative=1e-12))
    run = gx.Simulation(gx.Scene(film, bag, cold, *supports), stepper, **options)
    gas = run.system.equations.scalar_unknowns[0]
    area = gas.geometry.area(cold.area)
    return SimpleNamespace(run=run, bag=run.chamber("bag"), area=area.aperture)


@pytest.mark.parametrize("dt", [0.5, 20.0])
def test_a_rigid_balloon_cools_exponentially(dt):
    """T - T_outside falls as exp(-h A t/(m c_v)), for steps of any length."""
    one = balloon(MPI.COMM_SELF, dt=dt, held=True)
    rate = 50.0 * one.area(0.0) / (one.bag.mass * AIR.cv)
    before = one.bag.internal_energy
    one.run.run(until=3 * dt)
    exact = OUTSIDE + (START - OUTSIDE) * math.exp(-3 * rate * dt)
    assert one.bag.temperature == pytest.approx(exact, rel=1e-9)
    assert one.run.totals.supplied == pytest.approx(one.bag.internal_energy - before, rel=1e-9)


def test_free_convection_cools_by_its_law():
    """h = c ΔT^¼ gives ΔT^-¼ = ΔT_0^-¼ + c A t/(4 m c_v), with second order."""

    def coefficient(gas, outside):
        return 2.0 * abs(gas - outside) ** 0.25

    steps = (0.02, 0.01, 0.005)
    errors = []
    for dt in steps:
        one = balloon(MPI.COMM_SELF, coefficient, dt=dt, held=True)
        rate = 2.0 * one.area(0.0) / (one.bag.mass * AIR.cv)
        one.run.run(until=0.2)
        exact = ((START - OUTSIDE) ** -0.25 + rate * 0.2 / 4) ** -4
        errors.append((one.bag.temperature - OUTSIDE) / exact - 1)
    assert abs(errors[-1]) < 1e-4
    assert observed_order(steps, errors) == pytest.approx(2, abs=0.2)


def test_the_gas_follows_a_temperature_that_changes():
    """With T_outside = 300 K + b t the gas has T = T_outside - b τ + (100 K + b τ) exp(-t/τ),
    τ = m c_v/(h A): of first order in the step, as T_outside is taken at its start."""
    steps = (5e-3, 2.5e-3, 1.25e-3)
    errors = []
    for dt in steps:
        one = balloon(
            MPI.COMM_SELF,
            dt=dt,
            held=True,
            outside=lambda run: OUTSIDE + 200.0 * run.system.unknowns.time,
        )
        τ = one.bag.mass * AIR.cv / (50.0 * one.area(0.0))
        one.run.run(until=0.2)
        exact = OUTSIDE + 40.0 - 200.0 * τ + (START - OUTSIDE + 200.0 * τ) * math.exp(-0.2 / τ)
        errors.append(one.bag.temperature / exact - 1)
    # Half a step of 200 K/s
    assert errors[-1] == pytest.approx(-0.125 / exact, rel=0.05)
    assert observed_order(steps, errors) == pytest.approx(1, abs=0.1)


@pytest.mark.mpi
def test_the_outside_may_follow_the_altitude_of_the_run(comm):
    """A payload that rises fast through the troposphere is cooled by 6.5 K in a kilometre."""
    air = gx.loads.StandardAtmosphere()
    film = gx.Membrane(sheet(comm, 2, 2), gx.Linear(2e9, 0.3, density=1400.0, thickness=1e-5))
    payload = gx.PointMass(1.0, velocity=(0.0, 0.0, 100.0), comm=comm)
    height = gx.probes.Position(payload.port(), "z")
    tank = gx.Tank(0.01, gas=AIR, pressure=1e4, temperature=288.15)
    cold = gx.gas.FilmHeat(
        tank,
        gx.gas.FilmArea(film),
        coefficient=100.0,
        temperature=lambda run: air.temperature(height(run)),
    )
    run = gx.Simulation(gx.Scene(gx.Fixed(film, "film"), payload, cold), gx.Midpoint(dt=0.1))
    run.run(until=10.0)
    # The gas follows within a step, at whose start the air is 0.065 K warmer than at its end.
    assert run.chamber("tank").temperature == pytest.approx(air.temperature(990.0), rel=1e-6)
    assert abs(run.energy_error) <= 1e-12


@pytest.mark.mpi
def test_the_gas_becomes_as_warm_as_a_film_in_sunlight(comm):
    """A film over the equator with the Sun over the pole: (ε_f + ε_b) σ T⁴ = α S, and the gas that
    touches it has the same temperature."""
    film = gx.Membrane(sheet(comm, 2, 2), gx.Linear(2e9, 0.3, density=1400.0, thickness=1e-5))
    orbit = gx.orbit.Orbit(gx.orbit.Elements(7e6), sun=(0.0, 0.0, 1.0), shadow="none")
    properties = gx.orbit.ThermalProperties(15.0, absorptivity=0.2, emissivity=(0.05, 0.6))
    sunlight = gx.orbit.SolarHeating(
        film, orbit, properties, initial_temperature=250.0, space_temperature=0.0
    )
    tank = gx.Tank(0.01, gas=AIR, pressure=1e4, temperature=START)
    warm = gx.gas.FilmHeat(
        tank,
        gx.gas.FilmArea(film),
        coefficient=1.0,
        temperature=lambda run: sunlight.balance(run).mean,
    )
    damping = gx.Damping(film, stiffness_factor=1e-2)
    run = gx.Simulation(gx.Scene(film, orbit, sunlight, damping, warm), gx.Midpoint(dt=2.0))
    run.run(until=200.0)
    expected = (0.2 * LIGHT_SPEED * orbit.pressure / (0.65 * STEFAN_BOLTZMANN)) ** 0.25
    assert sunlight.balance(run).mean == pytest.approx(expected, rel=1e-6)
    assert run.chamber("tank").temperature == pytest.approx(expected, rel=1e-5)
    assert abs(run.energy_error) <= 1e-12


@pytest.mark.mpi
def test_the_heat_closes_the_energy_of_a_film_that_moves(comm):
    found = []
    for ranks in (MPI.COMM_SELF, comm):
        one = balloon(ranks, velocity=inwards, dt=5e-4)
        one.run.run(until=0.5)
        assert one.run.step == 1000
        assert abs(one.run.energy_error) <= 1e-12
        found.append([one.bag.pressure, one.bag.temperature, one.run.totals.supplied])
    assert found[0][2] < -1.0  # J
    assert found[1] == pytest.approx(found[0], rel=1e-9)


def test_the_heat_counts_the_deformed_area():
    """In a soft film that the gas has stretched the heat of a short step is that of its area."""
    one = balloon(MPI.COMM_SELF, E=1e6, coefficient=1.0, dt=1e-3)
    at_rest = one.area(0.0)
    one.run.run(until=0.03)
    before = one.run.totals.supplied
    area = one.area(1e-3)
    warm = one.bag.temperature
    one.run.run(until=0.031)
    assert area > 1.05 * at_rest
    mean = (warm + one.bag.temperature) / 2
    # The gas is not taken quite in the middle of a step; its temperature changes by some kelvin.
    heat = one.run.totals.supplied - before
    assert heat == pytest.approx(1e-3 * area * (OUTSIDE - mean), rel=1e-4)


def test_a_restart_goes_on_with_the_same_heat(tmp_path: Path):
    saved = gx.Checkpoints(tmp_path)
    whole = balloon(MPI.COMM_SELF, velocity=inwards, checkpoints=saved)
    whole.run.run(until=0.01)
    again = balloon(MPI.COMM_SELF, velocity=inwards, restart=tmp_path)
    for one in (whole, again):
        one.run.run(until=0.02)
    assert again.bag.temperature == whole.bag.temperature
    assert again.run.totals.supplied == whole.run.totals.supplied < 0.0


def test_gradients_are_those_of_differences():
    def make(coefficient):
        return balloon(MPI.COMM_SELF, coefficient, velocity=inwards).run

    pressure_by_differences(make, "cold.coefficient", 50.0, until=0.01, chamber="bag", change=2e-3)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"coefficient": lambda gas, outside: 50.0}, "has no gradient"),
        ({"outside": lambda run: OUTSIDE}, "has no gradient: its temperature"),
    ],
)
def test_functions_have_no_gradient(given, words):
    one = balloon(MPI.COMM_SELF, **given)
    tape = gx.analysis.RunTape(one.run)
    one.run.run(until=2e-3)
    pressure = gx.analysis.ChamberPressure(one.bag.chamber)
    with pytest.raises(gx.InputError, match=f"'cold' {words}"):
        gx.analysis.gradient(tape, of=pressure, by=["cold.coefficient"])


@pytest.mark.parametrize("wrong", [0.0, math.nan, "much"])
def test_a_wrong_temperature_of_a_function_is_refused(wrong):
    with pytest.raises(gx.InputError, match=r"FilmHeat 'cold': its temperature at t = 0 s"):
        balloon(MPI.COMM_SELF, outside=lambda run: wrong)


@pytest.mark.parametrize("wrong", [-1.0, math.nan, "much"])
def test_a_wrong_coefficient_of_a_function_is_refused(wrong):
    with pytest.raises(gx.InputError, match=r"FilmHeat 'cold': its coefficient at 400 K"):
        balloon(MPI.COMM_SELF, lambda gas, outside: wrong)
