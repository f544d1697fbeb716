"""Openings with state variables: the tutorial's valve, whose plate has inertia."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import brentq

import gossamer_fx as gx
from gossamer_fx.extend import DynamicOpening, PassiveOpening, isentropic_flow
from tests import own_part
from tests.differences import pressure_by_differences
from tests.rates import observed_order
from tests.small_scenes import AIR, run_of, run_until

SECTION = "A valve whose plate has inertia"
OUTSIDE = gx.gas.Ambient(1e5, 300.0, name="outside")
VALVE: dict[str, Any] = {
    "mass": 0.02,
    "spring": 2e3,
    "damping": 1.0,
    "diameter": 0.01,
    "name": "valve",
}


def plate_valve(a, b=OUTSIDE, **changes):
    return own_part.module_of(SECTION).PlateValve(a, b, **(VALVE | changes))


def tank(pressure, name="tank", volume=1e-3):
    return gx.Tank(volume, gas=AIR, pressure=pressure, temperature=300.0, name=name)


def test_the_valve_of_the_page_has_25_lines_of_the_public_interface():
    code = own_part.code_of(SECTION)
    valve = code[code.index("@check_arguments") : code.index("air = ")]
    assert len(valve.strip().splitlines()) <= 25
    modules = {
        node.module for node in ast.walk(ast.parse(code)) if isinstance(node, ast.ImportFrom)
    }
    assert {name for name in modules if name.startswith("gossamer")} == {"gossamer_fx.extend"}


# ---- the plate -----------------------------------------------------------------------------------


def between_reservoirs(dt, until, high=1.2e5, **changes):
    """A plate between two constant pressures, whose scene needs a tank to have gas."""
    valve = plate_valve(gx.gas.Ambient(high, 300.0, name="supply"), **changes)
    return valve, run_until(until, valve, tank(1e5), dt=dt)


def test_between_constant_pressures_it_is_a_damped_oscillator_of_second_order():
    """m x'' + d x' + k x = A Δp from x = x' = 0: x = A Δp/k (1 - exp(-δt) (cos ωt + δ/ω sin ωt)),
    δ = d/(2m), ω² = k/m - δ²."""
    decay = 1.0 / 0.04
    omega = np.sqrt(2e3 / 0.02 - decay**2)
    static = np.pi / 4 * 0.01**2 * 2e4 / 2e3
    until = 0.016
    turned = np.cos(omega * until) + decay / omega * np.sin(omega * until)
    exact = static * (1 - np.exp(-decay * until) * turned)
    steps = [1e-3, 5e-4, 2.5e-4]
    errors = []
    for dt in steps:
        valve, run = between_reservoirs(dt, until)
        errors.append(valve.variable(run, "lift") - exact)
    assert 1.95 < observed_order(steps, errors) < 2.05
    assert abs(errors[-1]) < 2e-3 * static


def test_without_damping_a_step_of_any_length_keeps_the_energy_of_the_plate():
    """½ m x'² + ½ k (x - A Δp/k)², of a rule that is exact for a linear oscillator's energy."""
    static = np.pi / 4 * 0.01**2 * 2e4 / 2e3
    for dt in (1e-3, 3e-2):
        valve, run = between_reservoirs(dt, 30 * dt, damping=1e-12, lift=1.5 * static)
        lift, speed = (valve.variable(run, name) for name in ("lift", "speed"))
        energy = 0.01 * speed**2 + 1e3 * (lift - static) ** 2
        assert energy == pytest.approx(1e3 * (0.5 * static) ** 2, rel=1e-9)


def test_a_higher_pressure_behind_it_presses_it_on_its_seat():
    """The seat gives way by A Δp/(1001 k), and nothing flows."""
    valve, run = between_reservoirs(1e-4, 0.1, high=8e4, damping=20.0)
    seat = np.pi / 4 * 0.01**2 * 2e4 / (1001 * 2e3)
    assert valve.variable(run, "lift") == pytest.approx(-seat, rel=1e-6)
    assert gx.probes.GasFlow(valve)(run) == 0.0


def test_slow_filling_lifts_it_to_where_it_lets_out_what_comes_in():
    """π D x(p) flux(p) = ṁ with the lift of a plate at rest, x = A (p - p_outside)/k."""
    supply = 2e-3
    vessel = tank(1e5, volume=0.05)
    inflator = gx.gas.Inflator(vessel, gas=AIR, mass_flow=supply, temperature=300.0)
    valve = plate_valve(vessel, damping=20.0)
    heater = gx.gas.WallHeat(vessel, 1e4, temperature=300.0)
    run = run_until(20.0, inflator, valve, heater, dt=0.02)
    area = np.pi / 4 * 0.01**2

    def excess(p):
        gap = np.pi * 0.01 * area * (p - 1e5) / 2e3
        return gap * isentropic_flow(AIR, p, 300.0, 1e5, 1e-5) - supply

    pressure = brentq(excess, 1.001e5, 3e5)
    assert run.chamber("tank").pressure == pytest.approx(pressure, rel=1e-4)
    assert gx.probes.GasFlow(valve)(run) == pytest.approx(supply, rel=1e-3)
    lift = area * (run.chamber("tank").pressure - 1e5) / 2e3
    assert valve.variable(run, "lift") == pytest.approx(lift, rel=1e-6)


# ---- in a network --------------------------------------------------------------------------------


def cylinder(comm=MPI.COMM_WORLD, **changes):
    """A piston that gas from a tank moves; the valve opens while the cylinder is at less than the
    tank."""
    numbers = VALVE | {"tank": 1.5e5, "outside": 9e4} | changes
    pressure = numbers.pop("tank")
    outside = numbers.pop("outside")
    mass = gx.PointMass(0.4, (0.0, 0.0, 0.0), name="mass", comm=comm)
    air = gx.gas.Ambient(outside, 293.0, name="air")
    vessel = gx.Chamber(
        gx.gas.Piston(mass.port(), area=0.01, direction=(1.0, 0.0, 0.0)),
        gas=AIR,
        pressure=1e5,
        temperature=300.0,
        dead_volume=5e-4,
        outside=air,
        name="cylinder",
    )
    valve = plate_valve(tank(pressure), vessel, **numbers)
    return mass, valve, gx.Orifice(vessel, air, area=2e-5, name="leak")


@pytest.mark.mpi
def test_gas_that_moves_a_piston_through_it_conserves(comm):
    """Mass and energy of the gas, with the work on the piston and what leaks out; most steps take
    as many iterations as with an orifice."""
    mass, valve, leak = cylinder(comm)
    run = run_of(mass, valve, leak, dt=2e-4)
    tight = run_of(mass, gx.Orifice(valve.a, valve.b, area=2e-5), leak, dt=2e-4)
    for made in (run, tight):
        made.run(until=0.05)
    assert 1e-4 < valve.variable(run, "lift") < 1e-2
    assert abs(run.energy_error) < 1e-13 and abs(run.mass_error) < 1e-13
    assert run.iterations <= 1.3 * tight.iterations
    [network] = run.system.equations.scalar_unknowns
    assert {law.derivatives for law in network.balance._laws} == {"compiled"}


@pytest.mark.mpi
def test_a_run_that_was_stopped_goes_on_bit_for_bit(comm, folder: Path):
    def made(until, **options):
        mass, valve, leak = cylinder(comm)
        run = run_of(mass, valve, leak, dt=2e-4, **options)
        run.run(until=until)
        return [valve.variable(run, name) for name in valve.variables] + [
            state.pressure for state in run.chambers.values()
        ]

    whole = made(0.03)
    made(0.012, checkpoints=gx.Checkpoints(folder))
    assert made(0.03, restart=folder) == whole


PARAMETERS = [("valve", name) for name in ("mass", "spring", "damping", "diameter")]
PARAMETERS += [("valve", "lift"), ("valve", "speed"), ("tank", "pressure"), ("air", "pressure")]


@pytest.mark.parametrize(("item", "name"), PARAMETERS, ids=[name for _, name in PARAMETERS])
def test_its_gradients_are_those_of_differences(item, name):
    argument = name if item == "valve" else {"tank": "tank", "air": "outside"}[item]
    start = {"lift": 2e-4, "speed": 0.05}
    value = (VALVE | start | {"tank": 1.5e5, "outside": 9e4})[argument]

    def make(number):
        parts = cylinder(**(start | {argument: number}))
        return run_of(*parts, dt=5e-4, tolerances=gx.Tolerances(relative=1e-13))

    # Its small gap at the end bends the result within a thousandth of the numbers.
    found = pressure_by_differences(
        make, f"{item}.{name}", value, until=0.02, chamber="cylinder", change=3e-5
    )
    assert found != 0


@pytest.mark.mpi
def test_its_gradients_are_the_same_on_ranks(comm):
    def gradients(on):
        mass, valve, leak = cylinder(on)
        run = run_of(mass, valve, leak, dt=5e-4)
        tape = gx.analysis.RunTape(run)
        run.run(until=0.01)
        pressure = gx.analysis.ChamberPressure(run.chamber("cylinder").chamber)
        names = [f"valve.{name}" for name in ("mass", "spring", "damping", "diameter", "lift")]
        found = gx.analysis.gradient(tape, of=pressure, by=names)
        return [float(found[name].values[0]) for name in names]

    alone = gradients(MPI.COMM_SELF)
    assert gradients(comm) == pytest.approx(alone, rel=1e-9)


@pytest.mark.parametrize("process", ["isothermal", "held pressure"])
def test_in_a_search_for_rest_it_comes_to_rest(process):
    """Where the spring carries the difference of pressures."""
    mass = gx.PointMass(0.4, (0.0, 0.0, 0.0), name="mass")
    valve = plate_valve(tank(1.2e5))
    search = gx.analysis.Continuation()
    equilibrium = gx.Equilibrium(gx.Scene(mass, valve), search, gas=process)
    equilibrium.find()
    difference = equilibrium.chamber("tank").pressure - 1e5
    assert valve.variable(equilibrium, "lift") == pytest.approx(
        np.pi / 4 * 0.01**2 * difference / 2e3, rel=1e-6, abs=1e-9
    )


# ---- what cannot be ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Forgetful(PassiveOpening, DynamicOpening):
    """It has a state variable, and returns the rate of another one."""

    lift: float | None = 0.0
    variables: ClassVar = {"lift": "m"}

    def rates(self, p, T):
        return {"speed": 0.0}

    def flux(self, gas, pu, Tu, pd):
        return 1e-6 * self.lift


def test_rates_and_start_values_of_all_state_variables_are_asked_for():
    vessel = tank(2e5)
    with pytest.raises(gx.InputError, match=r"rates are of \['speed'\]; return one .*\['lift'\]"):
        run_until(0.1, Forgetful(vessel, OUTSIDE), dt=0.1)
    with pytest.raises(gx.InputError, match="its 'lift' is None; make it a field"):
        run_of(Forgetful(vessel, OUTSIDE, lift=None), dt=0.1)
    valve = plate_valve(vessel)
    run = run_of(valve, dt=0.1)
    with pytest.raises(
        gx.InputError,
        match=r"'valve' has no state variable 'area'; its state variables are: lift, speed\.",
    ):
        valve.variable(run, "area")
    with pytest.raises(gx.InputError, match="'valve' is not in the scene"):
        plate_valve(vessel).variable(run, "lift")
    with pytest.raises(gx.InputError, match="mass"):
        plate_valve(vessel, mass=0.0)
