"""Heat of a gas through its film: cooling laws, the deformed area, energy, restart, gradients."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sphere import sphere
from gossamer_fx.presets.gases import AIR
from tests.rates import observed_order

RADIUS = 0.2
START = 400.0  # temperature of the gas [K]
OUTSIDE = 300.0  # K


def balloon(
    comm, coefficient=50.0, dt=1e-3, E=1e7, held=False, velocity=None, temperature=START, **options
):
    """A sphere of hot air in a cold vacuum."""
    law = gx.Linear(E=E, nu=0.3, density=1000.0, thickness=1e-4)
    film = gx.Membrane(sphere(comm, RADIUS, 4), law, velocity=velocity, name="film")
    bag = gx.Chamber(film, gas=AIR, pressure=3e3, temperature=temperature, name="bag")
    cold = gx.gas.FilmHeat(
        bag,
        gx.gas.FilmArea(film),
        coefficient=coefficient,
        temperature=OUTSIDE,
        name="cold",
    )
    supports = [gx.Fixed(film, "film")] if held else []
    stepper = gx.Midpoint(dt=dt, tolerances=gx.Tolerances(relative=1e-12))
    run = gx.Simulation(gx.Scene(film, bag, cold, *supports), stepper, **options)
    gas = run.system.scalar_unknowns[0]
    area = gas.geometry.area(cold.area)
    return SimpleNamespace(
        run=run, bag=run.chamber("bag"), area=area.aperture, heat=lambda: gas.supplied_heat(cold)
    )


def inwards(X):
    return -X / RADIUS


@pytest.mark.parametrize("dt", [0.5, 20.0])
def test_a_rigid_balloon_cools_exponentially(dt):
    """T - T_outside falls as exp(-h A t/(m c_v)), for steps of any length."""
    one = balloon(MPI.COMM_SELF, dt=dt, held=True)
    rate = 50.0 * one.area(0.0) / (one.bag.mass * AIR.cv)
    before = one.bag.internal_energy
    one.run.run(until=3 * dt)
    exact = OUTSIDE + (START - OUTSIDE) * math.exp(-3 * rate * dt)
    assert one.bag.temperature == pytest.approx(exact, rel=1e-9)
    assert one.heat() == pytest.approx(one.bag.internal_energy - before, rel=1e-9)


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


@pytest.mark.mpi
def test_the_heat_closes_the_energy_of_a_film_that_moves(comm):
    found = []
    for ranks in (MPI.COMM_SELF, comm):
        one = balloon(ranks, velocity=inwards, dt=5e-4)
        one.run.run(until=0.5)
        assert one.run.step == 1000
        assert abs(one.run.energy_error) <= 1e-12
        assert one.heat() == pytest.approx(one.run.totals.supplied, rel=1e-12)
        found.append([one.bag.pressure, one.bag.temperature, one.heat()])
    assert found[0][2] < -1.0  # J
    assert found[1] == pytest.approx(found[0], rel=1e-9)


def test_the_heat_counts_the_deformed_area():
    """In a soft film that the gas has stretched the heat of a short step is that of its area."""
    one = balloon(MPI.COMM_SELF, E=1e6, coefficient=1.0, dt=1e-3)
    at_rest = one.area(0.0)
    one.run.run(until=0.03)
    before = one.heat()
    area = one.area(1e-3)
    warm = one.bag.temperature
    one.run.run(until=0.031)
    assert area > 1.05 * at_rest
    mean = (warm + one.bag.temperature) / 2
    # The gas is not taken quite in the middle of a step; its temperature changes by some kelvin.
    assert one.heat() - before == pytest.approx(1e-3 * area * (OUTSIDE - mean), rel=1e-4)


def test_a_restart_goes_on_with_the_same_heat(tmp_path: Path):
    saved = gx.Checkpoints(tmp_path)
    whole = balloon(MPI.COMM_SELF, velocity=inwards, checkpoints=saved)
    whole.run.run(until=0.01)
    again = balloon(MPI.COMM_SELF, velocity=inwards, restart=tmp_path)
    for one in (whole, again):
        one.run.run(until=0.02)
    assert again.bag.temperature == whole.bag.temperature
    assert again.heat() == whole.heat() < 0.0


def test_gradients_are_those_of_differences():
    def of(coefficient=50.0):
        one = balloon(MPI.COMM_SELF, coefficient, velocity=inwards)
        tape = gx.analysis.RunTape(one.run)
        one.run.run(until=0.01)
        return tape, gx.analysis.ChamberPressure(one.bag.chamber), one.bag.pressure

    tape, pressure, _ = of()
    found = gx.analysis.gradient(tape, of=pressure, by=["cold.coefficient"])
    slope = found["cold.coefficient"].values[0]
    values = [of(50.0 + δ)[2] for δ in (-0.2, -0.1, 0.1, 0.2)]
    difference = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * 0.1)
    assert slope == pytest.approx(difference, rel=1e-6)


def test_a_function_has_no_gradient():
    one = balloon(MPI.COMM_SELF, lambda gas, outside: 50.0)
    tape = gx.analysis.RunTape(one.run)
    one.run.run(until=2e-3)
    pressure = gx.analysis.ChamberPressure(one.bag.chamber)
    with pytest.raises(gx.InputError, match="'cold' has no gradient"):
        gx.analysis.gradient(tape, of=pressure, by=["cold.temperature"])


@pytest.mark.parametrize("wrong", [-1.0, math.nan, "much"])
def test_a_wrong_coefficient_of_a_function_is_refused(wrong):
    with pytest.raises(gx.InputError, match=r"FilmHeat 'cold': its coefficient at 400 K"):
        balloon(MPI.COMM_SELF, lambda gas, outside: wrong)
