"""Inflators, blowers, regulators and powders: their laws and their share in the balances."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.mechanics.gas.contract import CompiledWall
from gossamer_fx.presets.gases import HELIUM, HOT_NITROGEN, NITROGEN
from tests.differences import pressure_by_differences
from tests.rates import observed_order
from tests.small_scenes import run_of


def tank(pressure, gas=NITROGEN, name="tank", volume=0.01):
    return gx.Tank(volume, gas=gas, pressure=pressure, temperature=300.0, name=name)


def closes(run) -> bool:
    """Whether mass and energy close to round-off."""
    return abs(run.mass_error) <= 1e-13 and abs(run.energy_error) <= 1e-13


# ---- inflators -----------------------------------------------------------------------------------


def test_an_inflator_gives_the_mass_and_the_enthalpy_of_its_tables():
    """m = ∫ ṁ dt and U = U_0 + ∫ ṁ h(T) dt in a rigid tank, whatever its pressure; trapezoids of
    flow and temperature, of second order in the step."""
    vessel = tank(1e5)
    times = np.array([0.0, 0.01, 0.05])
    flows = np.array([0.0, 0.4, 0.0])
    heats = np.array([900.0, 700.0, 400.0])
    inflator = gx.gas.Inflator(
        vessel,
        gas=HOT_NITROGEN,
        mass_flow=gx.gas.LinearTable(*zip(times, flows, strict=True)),
        temperature=gx.gas.LinearTable(*zip(times, heats, strict=True)),
    )
    t = np.linspace(0, 0.05, 200001)
    flow = np.interp(t, times, flows)
    enthalpy = np.interp(
        np.interp(t, times, heats),
        np.arange(300.0, 1000.0, 0.01),
        [HOT_NITROGEN.enthalpy(T) for T in np.arange(300.0, 1000.0, 0.01)],
    )
    supplied = np.trapezoid(flow * enthalpy, t)
    errors = []
    steps = [1e-3, 2.5e-4]
    for dt in steps:
        run = run_of(inflator, dt=dt)
        before = run.first.energy
        run.run(until=0.05)
        state = run.chamber("tank")
        # The kink of the flow lies between two steps, and the midpoint rule is exact for lines.
        assert state.mass_of(HOT_NITROGEN) == pytest.approx(0.01, rel=1e-10)
        assert closes(run)
        errors.append((state.internal_energy - before) / supplied - 1)
    assert abs(errors[-1]) <= 1e-5
    assert observed_order(steps, np.abs(errors)) == pytest.approx(2, abs=0.2)


def test_two_inflators_make_a_mixture():
    vessel = tank(1e5)
    sources = [
        gx.gas.Inflator(vessel, gas=gas, mass_flow=flow, temperature=500.0, name=gas.name)
        for gas, flow in ((HELIUM, lambda t: 0.01 * t), (HOT_NITROGEN, 0.02))
    ]
    run = run_of(*sources, dt=0.01)
    run.run(until=0.5)
    state = run.chamber("tank")
    assert state.mass_of(HELIUM) == pytest.approx(0.01 * 0.125, rel=1e-12)
    assert state.mass_of(HOT_NITROGEN) == pytest.approx(0.01, rel=1e-12)
    assert closes(run)


def test_a_negative_flow_of_an_inflator_is_refused():
    source = gx.gas.Inflator(
        tank(1e5), gas=NITROGEN, mass_flow=lambda t: 0.1 - t, temperature=300.0
    )
    with pytest.raises(gx.InputError, match=r"mass flow at t = 0\.15 s is -0\.05"):
        run_of(source, dt=0.1).run(until=0.5)


# ---- blowers -------------------------------------------------------------------------------------

CURVE = gx.gas.LinearTable((0.0, 0.02), (1000.0, 0.01), (2000.0, 0.0))


def test_a_blower_works_where_its_curve_meets_the_leak():
    """From air through a chamber back to air: the flow of the blower becomes that of the leak."""
    air = gx.gas.Ambient(1e5, 300.0, name="air")
    vessel = tank(1e5, volume=0.1)
    leak = gx.Orifice(vessel, air, area=2e-4, name="leak")
    blower = gx.gas.Blower(air, vessel, curve=CURVE)
    run = run_of(blower, leak, dt=0.1)
    run.run(until=200.0)
    state = run.chamber("tank")
    rise = state.pressure - 1e5
    assert 0 < rise < 2000.0
    density = 1e5 / (NITROGEN.R * 300.0)
    flows = [gx.probes.GasFlow(one)(run) for one in (blower, leak)]
    assert flows == pytest.approx([density * CURVE(rise)] * 2, rel=1e-6)
    # Bernoulli's equation, for a small rise of pressure
    slow = 2e-4 * math.sqrt(2 * density * rise)
    assert flows[1] == pytest.approx(slow, rel=0.02)
    assert closes(run)


def test_a_blower_moves_the_density_of_the_gas_that_it_takes_in():
    """From cold thin helium into hot dense nitrogen; neither gas, pressure nor temperature of the
    other side counts."""
    blower = gx.gas.Blower(tank(9.9e4, HELIUM, "a"), tank(1e5, name="b"), curve=CURVE)
    flow = blower.flow((HELIUM, NITROGEN), 2.0, (9.9e4, 1e5), (250.0, 400.0))
    assert flow == pytest.approx(2 * 9.9e4 / (HELIUM.R * 250.0) * CURVE(1000.0), rel=1e-12)


def test_stirred_helium_and_nitrogen_are_one_mixture_at_300_kelvin():
    """Helium of 4e5 Pa in 0.01 m³ and nitrogen of 2e4 Pa in 0.02 m³ that a blower stirs until both
    tanks hold one mixture: p = ΣpV/ΣV = 146 666.7 Pa at the temperature and energy of before."""
    a = tank(4e5, HELIUM, "a")
    b = tank(2e4, NITROGEN, "b", volume=0.02)
    run = run_of(
        gx.Orifice(a, b, area=3e-4, name="joint"),
        gx.gas.Blower(b, a, curve=gx.gas.LinearTable((0.0, 2e-3))),
        dt=0.2,
    )
    gases = (HELIUM, NITROGEN)
    before = [sum(state.mass_of(gas) for state in run.chambers.values()) for gas in gases]
    run.run(until=400.0)
    after = [sum(state.mass_of(gas) for state in run.chambers.values()) for gas in gases]
    assert after == pytest.approx(before, rel=1e-13)
    assert run.totals.energy == pytest.approx(7000.0, rel=1e-13)
    shares = [state.mass_of(HELIUM) / state.mass for state in run.chambers.values()]
    assert shares == pytest.approx([before[0] / sum(before)] * 2, rel=1e-9)
    # The blower keeps a small difference of pressures; the mean over the volume is exact.
    mean = sum(state.pressure * state.volume for state in run.chambers.values()) / 0.03
    assert mean == pytest.approx(4400.0 / 0.03, rel=1e-9)
    for state in run.chambers.values():
        assert state.pressure == pytest.approx(146666.7, rel=1e-4)
        assert state.temperature == pytest.approx(300.0, rel=1e-4)


# ---- regulators ----------------------------------------------------------------------------------


def test_a_regulator_holds_the_pressure_behind_it():
    """A bottle feeds a leaking vessel: the pressure stays within the droop, at the area that the
    leak needs."""
    vessel = tank(1e5)
    bottle = gx.gas.Ambient(2e7, 300.0, name="bottle")
    regulator = gx.gas.Regulator(bottle, vessel, area=1e-7, pressure=1.5e5, droop=2e3)
    leak = gx.Orifice(vessel, gx.gas.Ambient(), area=2e-6, name="leak")
    run = run_of(regulator, leak, dt=0.1)
    run.run(until=400.0)
    state = run.chamber("tank")
    share = (1.5e5 - state.pressure) / 2e3
    assert 0 < share < 1
    # Both flows are choked: area times pressure, over the root of the temperature.
    demand = 2e-6 * state.pressure / (1e-7 * 2e7) * math.sqrt(300.0 / state.temperature)
    assert share == pytest.approx(demand, rel=1e-5)
    assert closes(run)


# ---- powders -------------------------------------------------------------------------------------

VAPOUR = gx.IdealGas(gamma=1.08, R=68.1, name="vapour")


def test_a_powder_fills_a_vessel_to_its_vapour_pressure():
    """Into a vessel of vapour at the temperature of the powder, held by a wall: the pressure
    relaxes exponentially at the rate α A R T/(V √(2π R T))."""
    vessel = tank(50.0, VAPOUR)
    powder = gx.gas.Sublimation(
        vessel, gas=VAPOUR, pressure=100.0, temperature=300.0, area=1e-5, accommodation=0.5
    )
    # The wall holds the temperature: its conductance is far above that of the flow.
    wall = gx.gas.WallHeat(vessel, 1e3, temperature=300.0)
    run = run_of(powder, wall, dt=0.1)
    state = run.chamber("tank")
    rate = 0.5e-5 * VAPOUR.R * 300.0 / (0.01 * math.sqrt(2 * math.pi * VAPOUR.R * 300.0))
    for t in (5.0, 20.0, 60.0):
        run.run(until=t)
        assert state.pressure == pytest.approx(100.0 - 50.0 * math.exp(-rate * t), rel=1e-5)
    assert closes(run)


@pytest.mark.parametrize("conductance", [10.0, 1e3, 1e6])
def test_round_off_of_a_wall_costs_one_search(conductance):
    """The heat of a wall at nearly the temperature of the gas is the round-off of their difference
    times its conductance: a residual that falls no further ends the balance."""
    calls = []

    class Counting(gx.gas.WallHeat):
        def compile(self, geometry):
            def coefficient(T, outside):
                # Not for symbols: it is called back.
                calls.append(float(T.real))
                return 1.0

            return CompiledWall(lambda h: (self.temperature, self.conductance), coefficient)

    vessel = tank(1e5)
    run = run_of(vessel, Counting(vessel, conductance, temperature=310.0), dt=1.0)
    run.run(until=20.0)
    assert run.chamber("tank").temperature == pytest.approx(310.0, rel=1e-4)
    assert closes(run)
    # Three solutions a step, each of which halves an update at most 30 times.
    assert len(calls) < 20 * 3 * 40


def test_the_partial_pressure_of_the_vapour_counts():
    """In nitrogen of 1e4 Pa the vapour rises to its own vapour pressure."""
    vessel = tank(1e4)
    powder = gx.gas.Sublimation(vessel, gas=VAPOUR, pressure=100.0, temperature=300.0, area=1e-3)
    run = run_of(powder, gx.gas.WallHeat(vessel, 10.0, temperature=300.0), dt=0.1)
    run.run(until=100.0)
    state = run.chamber("tank")
    partial = state.mass_of(VAPOUR) * VAPOUR.R * state.temperature / state.volume
    assert partial == pytest.approx(100.0, rel=1e-6)
    assert state.pressure == pytest.approx(10100.0, rel=1e-6)
    assert closes(run)


@pytest.mark.parametrize(("area", "dt"), [(1e-3, 0.1), (1.0, 10.0)])
def test_vapour_condenses_without_the_other_gas(area, dt):
    """From 249 Pa in nitrogen the vapour falls to its own vapour pressure, also in steps of 5000
    times the time of the fall, and all nitrogen stays."""
    vessel = tank(1e4, gx.gas.Mixture({NITROGEN: 0.9, VAPOUR: 0.1}))
    powder = gx.gas.Sublimation(vessel, gas=VAPOUR, pressure=100.0, temperature=300.0, area=area)
    run = run_of(powder, gx.gas.WallHeat(vessel, 10.0, temperature=300.0), dt=dt)
    state = run.chamber("tank")
    nitrogen = state.mass_of(NITROGEN)
    run.run(until=20.0)
    partial = state.mass_of(VAPOUR) * VAPOUR.R * state.temperature / state.volume
    assert partial == pytest.approx(100.0, rel=1e-6)
    assert state.mass_of(NITROGEN) == nitrogen
    assert closes(run)


@pytest.mark.parametrize(("number", "value"), [("area", 1e-4), ("accommodation", 0.5)])
def test_gradients_of_a_powder_are_those_of_differences(number, value):
    def make(changed):
        vessel = tank(1e4, gx.gas.Mixture({NITROGEN: 0.9, VAPOUR: 0.1}))
        numbers = {"area": 1e-4, "accommodation": 0.5, number: changed}
        powder = gx.gas.Sublimation(
            vessel, gas=VAPOUR, pressure=100.0, temperature=300.0, **numbers
        )
        return run_of(powder, dt=0.1)

    pressure_by_differences(make, f"powder.{number}", value, until=0.5, chamber="tank", change=1e-3)


def test_vapour_pressures_of_water_are_those_of_the_tables():
    """Antoine's coefficients of water by Stull, Ind. Eng. Chem. 39 (1947) 517 (bar, 256 to 373 K)
    against the 47.39 kPa of the steam tables at 80 °C; and the slope of Clausius and Clapeyron."""
    water = gx.gas.Antoine(A=4.6543 + 5, B=1435.264, C=-64.848)
    assert water(353.15) == pytest.approx(47.39e3, rel=2e-3)
    latent = gx.gas.Antoine.of_latent_heat(2.257e6, 461.5, pressure=101325.0, temperature=373.124)
    slope = (latent(373.625) - latent(372.625)) / 1.0
    # dp/dT = L p/(R T²)
    assert slope == pytest.approx(2.257e6 * 101325.0 / (461.5 * 373.125**2), rel=1e-4)
