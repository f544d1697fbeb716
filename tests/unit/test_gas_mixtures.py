"""Mixtures of gases: exact balances of energy and of each species, and gases that are hot."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from scipy.integrate import solve_ivp

import gossamer_fx as gx
from gossamer_fx.mechanics.gas.laws import GasAtEnd, heat_law
from gossamer_fx.mechanics.gas.mixture import Blend
from gossamer_fx.presets.gases import CARBON_DIOXIDE, HELIUM, HOT_NITROGEN, NITROGEN
from tests.differences import pressure_by_differences
from tests.rates import observed_order
from tests.small_scenes import run_of

EQUAL = gx.gas.Mixture({HELIUM: 0.5, NITROGEN: 0.5}, name="equal parts")


def tank(volume, pressure, gas, name, temperature=300.0):
    return gx.Tank(volume, gas=gas, pressure=pressure, temperature=temperature, name=name)


def masses(run: gx.Simulation, gases) -> np.ndarray:
    """Mass of each gas in all chambers together."""
    return np.array([sum(s.mass_of(gas) for s in run.chambers.values()) for gas in gases])


# ---- two tanks -----------------------------------------------------------------------------------


def test_helium_and_nitrogen_share_a_pressure_at_the_energy_of_both():
    """4e5 Pa of helium in 0.01 m³ and 2e4 Pa of nitrogen in 0.02 m³, both of 300 K, rigid and
    adiabatic: U = 6000 J + 1000 J whatever flows, and at the end p Σ V c_v/R = U."""
    a = tank(0.01, 4e5, HELIUM, "a")
    b = tank(0.02, 2e4, NITROGEN, "b")
    run = run_of(gx.Orifice(a, b, area=3e-6), dt=0.05)
    before = masses(run, (HELIUM, NITROGEN))
    run.run(until=60.0)
    assert run.totals.energy == pytest.approx(7000.0, rel=1e-14)
    assert masses(run, (HELIUM, NITROGEN)) == pytest.approx(before, rel=1e-14)
    first, second = run.chambers.values()
    # The first tank has helium only, with c_v/R = 3/2; gas of both is in the second one.
    helium = second.mass_of(HELIUM)
    nitrogen = second.mass_of(NITROGEN)
    capacity = helium * HELIUM.cv + nitrogen * NITROGEN.cv
    factor = capacity / (helium * HELIUM.R + nitrogen * NITROGEN.R)
    final = 7000.0 / (0.01 * 1.5 + 0.02 * factor)
    assert [first.pressure, second.pressure] == pytest.approx([final, final], rel=1e-5)
    # What stays in the first tank expands isentropically.
    expected = 300.0 * (first.pressure / 4e5) ** 0.4
    assert first.temperature == pytest.approx(expected, rel=1e-3)


def test_two_names_of_one_gas_are_the_gas():
    """Nitrogen of two names in a graph of chambers has the pressures and temperatures of one."""

    def final(second):
        a, b, c = (
            tank(V, p, gas, name, T)
            for V, p, gas, name, T in (
                (0.01, 4e5, NITROGEN, "a", 300.0),
                (0.02, 2e4, second, "b", 400.0),
                (0.005, 2e5, NITROGEN, "c", 280.0),
            )
        )
        supply = gx.gas.Ambient(3e5, 350.0, gas=second, name="supply")
        openings = (
            gx.Orifice(a, b, area=3e-6),
            gx.Orifice(c, b, area=1e-6, name="second"),
            gx.Orifice(supply, c, area=2e-6, name="inlet"),
            gx.gas.WallHeat(b, 0.5, temperature=350.0),
        )
        run = run_of(*openings, dt=0.1)
        run.run(until=3.0)
        return run.system.equations.scalar_unknowns[0].size, [
            (state.pressure, state.temperature, state.mass) for state in run.chambers.values()
        ]

    one, expected = final(NITROGEN)
    two, found = final(dataclasses.replace(NITROGEN, name="other nitrogen"))
    assert (one, two) == (6, 9)
    assert np.array(found) == pytest.approx(np.array(expected), rel=1e-12)


def test_a_scene_of_one_gas_mixes_nothing(monkeypatch):
    """One gas has the unknowns p and m of each chamber, and no mixture is made in a step."""

    def refuse(*args):
        raise AssertionError("A scene of one gas made a mixture.")

    monkeypatch.setattr(Blend, "__init__", refuse)
    a = tank(0.01, 4e5, NITROGEN, "a")
    b = tank(0.02, 2e4, NITROGEN, "b")
    run = run_of(
        gx.Orifice(a, b, area=3e-6), gx.Orifice(b, gx.gas.Ambient(), area=1e-6, name="leak"), dt=0.1
    )
    run.run(until=1.0)
    assert run.system.equations.scalar_unknowns[0].size == 4


def test_a_chamber_tracks_only_what_it_can_receive():
    alone = tank(0.01, 1e5, HELIUM, "alone")
    a = tank(0.01, 1e5, NITROGEN, "a")
    b = tank(0.01, 2e5, EQUAL, "b")
    run = run_of(alone, gx.Orifice(a, b, area=1e-6), dt=0.1)
    species = [len(state.species) for state in run.chambers.values()]
    assert sorted(species) == [1, 2, 2]
    run.run(until=0.5)
    assert run.chamber("alone").pressure == pytest.approx(1e5, rel=1e-14)


# ---- filling of one gas into another, against an integration of scipy ----------------------------


def nozzle(gamma, R, p_up, T_up, p_down):
    """Mass flow per area [kg/(s m²)] by the Mach number of the throat (Shapiro 1953, ch. 4)."""
    mach = np.sqrt(2 / (gamma - 1) * ((p_up / p_down) ** ((gamma - 1) / gamma) - 1))
    mach = min(mach, 1.0)
    total = 1 + (gamma - 1) / 2 * mach**2
    return p_up * np.sqrt(gamma / (R * T_up)) * mach * total ** (-(gamma + 1) / (2 * gamma - 2))


@pytest.mark.parametrize(("supply", "until"), [(4e5, 1.0), (6e4, 2.0)], ids=["choked", "subsonic"])
def test_filling_of_nitrogen_with_helium(supply, until):
    """A reservoir of helium fills a tank of nitrogen of 5e4 Pa that leaks its mixture; the steps
    converge with the second order to the integration of scipy, to 1e-6."""
    volume = 0.01
    area = 2e-6
    leak = 1e-6

    def rates(t, state):
        helium, nitrogen, energy = state
        capacity = helium * HELIUM.cv + nitrogen * NITROGEN.cv
        amount = helium * HELIUM.R + nitrogen * NITROGEN.R
        T = energy / capacity
        p = amount * T / volume
        inflow = area * nozzle(HELIUM.gamma, HELIUM.R, supply, 320.0, p)
        mass = helium + nitrogen
        outflow = leak * nozzle(1 + amount / capacity, amount / mass, p, T, 1e-3)
        enthalpy = (capacity + amount) / mass * T
        return [
            inflow - outflow * helium / mass,
            -outflow * nitrogen / mass,
            HELIUM.cp * 320.0 * inflow - enthalpy * outflow,
        ]

    start = 5e4 * volume / (NITROGEN.R * 300.0)
    exact = solve_ivp(
        rates, (0, until), [0, start, start * NITROGEN.cv * 300.0], rtol=1e-12, atol=1e-18
    ).y[:, -1]
    errors = []
    steps = [until / 200, until / 800]
    for dt in steps:
        vessel = tank(volume, 5e4, NITROGEN, "vessel")
        source = gx.gas.Ambient(supply, 320.0, gas=HELIUM, name="supply")
        run = run_of(
            gx.Orifice(source, vessel, area=area, name="inlet"),
            gx.Orifice(vessel, gx.gas.Ambient(), area=leak, name="leak"),
            dt=dt,
        )
        run.run(until=until)
        state = run.chamber("vessel")
        found = [state.mass_of(HELIUM), state.mass_of(NITROGEN), state.internal_energy]
        errors.append(np.array(found) / exact - 1)
        assert abs(run.energy_error) <= 1e-13 and abs(run.mass_error) <= 1e-13
    assert abs(errors[-1]).max() <= 1e-6
    assert observed_order(steps, abs(np.array(errors)).max(axis=1)) == pytest.approx(2, abs=0.2)


# ---- a piston that a mixture drives --------------------------------------------------------------


def driven_piston(comm, area=2e-5, fraction=0.3, outside=None):
    """Nitrogen below a piston on a spring, which a bottle of a mixture drives, with a leak to the
    outside, a vacuum."""
    mass = gx.PointMass(0.5, comm=comm, name="mass")
    axis = (1.0, 0.0, 0.0)
    cylinder = gx.Chamber(
        gx.gas.Piston(mass.port(), 0.01, direction=axis),
        gas=NITROGEN,
        pressure=2e4,
        temperature=300.0,
        dead_volume=1e-3,
        name="cylinder",
    )
    gas = gx.gas.Mixture({HELIUM: fraction, NITROGEN: 1 - fraction})
    bottle = tank(1e-3, 5e5, gas, "bottle")
    return gx.Scene(
        mass,
        gx.connectors.AxialSpring(mass.port(), 2000.0, direction=axis),
        gx.Orifice(bottle, cylinder, area=area, name="inlet"),
        gx.Orifice(cylinder, outside or gx.gas.Ambient(), area=1e-6, name="leak"),
    )


def test_a_mixture_is_filled_to_the_pressure_of_its_supply():
    """An almost empty tank takes γ times the temperature of the supply, up to where round-off
    decides in which direction gas flows."""
    vessel = tank(0.01, 1.0, EQUAL, "vessel")
    supply = gx.gas.Ambient(1e7, 300.0, gas=NITROGEN, name="supply")
    run = run_of(gx.Orifice(supply, vessel, area=1e-2), dt=1.0)
    run.run(until=5.0)
    state = run.chamber("vessel")
    assert state.pressure == pytest.approx(1e7, rel=1e-9)
    assert state.temperature == pytest.approx(NITROGEN.gamma * 300.0, rel=1e-6)
    assert abs(run.mass_error) < 1e-13 and abs(run.energy_error) < 1e-13


def test_energy_and_each_species_over_a_thousand_steps():
    """The gas that leaks is in an almost empty tank, so that each species is constant."""
    outside = tank(1.0, 1.0, EQUAL, "outside")
    scene = driven_piston(MPI.COMM_SELF, outside=outside)
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-3))
    gases = (HELIUM, NITROGEN)
    before = masses(run, gases)
    leaked = run.chamber("outside").mass_of(HELIUM)
    run.run(until=1.0)
    assert abs(run.energy_error) <= 1e-12
    # 1000 sums of round-off 1e-16
    assert masses(run, gases) == pytest.approx(before, rel=1e-13)
    assert run.chamber("cylinder").mass_of(HELIUM) > 1e-4
    assert run.chamber("outside").mass_of(HELIUM) > leaked


def test_the_figures_of_a_run_are_numbers_of_python():
    """`repr` of other numbers is "np.float64(1.0)"."""
    scene = driven_piston(MPI.COMM_SELF)
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-3))
    run.run(until=3e-3)
    flows = [gx.probes.GasFlow(item)(run) for item in scene.items if isinstance(item, gx.Orifice)]
    assert len(flows) == 2 and min(flows) > 0.0
    assert run.totals.mass_supplied < 0.0 > run.totals.supplied
    assert "float64" not in repr((run.account, run.totals.as_data(), flows))


@pytest.mark.mpi
def test_mixtures_on_several_ranks_are_the_same(comm):
    found = []
    for ranks in (MPI.COMM_SELF, comm):
        run = gx.Simulation(driven_piston(ranks), gx.Midpoint(dt=2e-3))
        run.run(until=0.1)
        state = run.chamber("cylinder")
        found.append([state.pressure, state.temperature, *state.masses])
    assert found[1] == pytest.approx(found[0], rel=1e-11)


def test_a_restart_in_the_middle_goes_on_with_the_same_masses(tmp_path: Path):
    saved = gx.Checkpoints(tmp_path / "checkpoints")
    run = gx.Simulation(driven_piston(MPI.COMM_SELF), gx.Midpoint(dt=1e-3), checkpoints=saved)
    run.run(until=0.05)
    again = gx.Simulation(
        driven_piston(MPI.COMM_SELF), gx.Midpoint(dt=1e-3), restart=tmp_path / "checkpoints"
    )
    for one in (run, again):
        one.run(until=0.1)
    for name, state in run.chambers.items():
        other = again.chamber(name)
        assert (other.pressure, other.masses.tolist()) == (state.pressure, state.masses.tolist())
    assert again.totals.mass_supplied == run.totals.mass_supplied


def test_a_recording_has_the_masses_of_species_of_mixtures_only(tmp_path: Path):
    """Helium and nitrogen of a closed scene are constant in the sum of both tanks."""
    mixed = [
        gx.Tank(0.01, gas=gas, pressure=p, temperature=300.0, name=name)
        for gas, p, name in ((HELIUM, 4e5, "a"), (NITROGEN, 2e4, "b"))
    ]
    alone = gx.Tank(0.01, gas=NITROGEN, pressure=1e5, temperature=300.0, name="alone")
    scene = gx.Scene(gx.Orifice(*mixed, area=1e-4, name="joint"), alone)
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-3), outputs=[gx.Recording(tmp_path / "run")])
    run.run(until=0.02)
    rows = gx.plot.RunReader(tmp_path / "run").table("gas.csv")
    columns = [name for name in rows if " mass of " in name]
    assert sorted(columns) == [
        f"{tank.name} mass of {gas.name}" for tank in mixed for gas in (HELIUM, NITROGEN)
    ]
    for gas in (HELIUM, NITROGEN):
        total = sum(rows[f"{tank.name} mass of {gas.name}"] for tank in mixed)
        assert total == pytest.approx(total[0], rel=1e-12)
    assert rows["b mass of helium"][0] == 0 < rows["b mass of helium"][-1]
    assert rows["a mass"] == pytest.approx(
        rows["a mass of helium"] + rows["a mass of nitrogen"], rel=1e-12
    )


@pytest.mark.parametrize(
    ("name", "argument", "value"),
    [("inlet.area", "area", 2e-5), ("bottle.fraction of helium", "fraction", 0.3)],
)
def test_gradients_of_a_mixture_are_those_of_differences(name, argument, value):
    def make(value):
        scene = driven_piston(MPI.COMM_SELF, **{argument: value})
        tolerances = gx.Tolerances(relative=1e-13)
        return gx.Simulation(scene, gx.Midpoint(dt=1e-3, tolerances=tolerances))

    pressure_by_differences(make, name, value, until=0.03, chamber="cylinder")


@pytest.mark.parametrize("T", [300.0, 1500.0])
def test_a_mixture_has_the_mean_properties_of_its_mass(T):
    """Also as an opening sees it, at another temperature than that of its end."""
    shares = {HELIUM: 0.2, HOT_NITROGEN: 0.5, CARBON_DIOXIDE: 0.3}
    mixture = gx.gas.Mixture(shares)

    def mean(quantity):
        return sum(share * quantity(gas) for gas, share in shares.items())

    mean_R = mean(lambda gas: gas.R)
    c_v = mean(lambda gas: gas.heat_capacity(T))
    assert abs(mixture.R - mean_R) < 1e-12 * mean_R
    at_end = GasAtEnd(mixture.species, (1e5, 250.0, mean_R, 1.7), mixture.fractions)
    for gas in (mixture, at_end):
        assert gas.heat_capacity(T) == pytest.approx(c_v, rel=1e-14)
        # γ is the ratio of the specific heats at constant pressure and at constant volume.
        assert gas.heat_ratio(T) == pytest.approx((c_v + mean_R) / c_v, rel=1e-14)
        assert gas.energy(T) == pytest.approx(mean(lambda one: one.energy(T)), rel=1e-14)
        assert gas.enthalpy(T) == pytest.approx(mean(lambda one: one.enthalpy(T)), rel=1e-14)


# ---- gases with specific heats that change -------------------------------------------------------


def test_polynomials_have_the_values_of_the_janaf_tables():
    """c_p and H - H(298.15 K) of Chase, NIST-JANAF Thermochemical Tables, 4th ed. 1998; they are
    from other fits, within 0.1 %."""
    table = {
        (HOT_NITROGEN, 28.0134e-3): {
            500.0: (29.580, 5911),
            1000.0: (32.697, 21463),
            2000.0: (35.971, 56137),
        },
        (CARBON_DIOXIDE, 44.0095e-3): {
            500.0: (44.627, 8305),
            1000.0: (54.308, 33397),
            2000.0: (60.350, 91439),
        },
    }
    for (gas, molar_mass), rows in table.items():
        for T, (heat, enthalpy) in rows.items():
            found = molar_mass * (gas.heat_capacity(T) + gas.R)
            assert found == pytest.approx(heat, rel=1e-3)
            risen = molar_mass * (gas.enthalpy(T) - gas.enthalpy(298.15))
            assert risen == pytest.approx(enthalpy, rel=1e-3)


@pytest.mark.parametrize("T", [150.0, 250.0, 700.0, 1000.5, 3000.0, 7000.0])
def test_the_enthalpy_is_the_integral_of_the_specific_heat(T):
    """By a complex step and as a compiled law, in and outside of the ranges."""
    for gas in (HOT_NITROGEN, CARBON_DIOXIDE):
        assert gas.enthalpy(298.15) == pytest.approx(gas.enthalpy_298, rel=1e-14)
        expected = gas.heat_capacity(T)
        assert gas.energy(T + 1e-30j).imag / 1e-30 == pytest.approx(expected, rel=1e-12)
        law, numbers = heat_law(gas, MPI.COMM_SELF)
        values, slopes = law(T, *numbers)
        assert law.derivatives == "compiled"
        assert values == pytest.approx([gas.energy(T), expected], rel=1e-12)
        assert slopes[0, 0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("end", "outward"), [(0, -1.0), (-1, 1.0)])
def test_the_specific_heat_is_constant_outside_of_the_ranges(end, outward):
    """That of the nearest end, so that the enthalpy goes on along its tangent there."""
    gas = HOT_NITROGEN
    T = gas.temperatures[end]
    beyond = T + outward * 50.0
    assert gas.heat_capacity(beyond) == pytest.approx(gas.heat_capacity(T), rel=1e-14)
    assert gas.heat_ratio(beyond) == pytest.approx(gas.heat_ratio(T), rel=1e-14)
    change = (gas.heat_capacity(T) + gas.R) * (beyond - T)
    assert gas.enthalpy(beyond) - gas.enthalpy(T) == pytest.approx(change, rel=1e-12)


def test_a_hot_gas_cools_with_the_energy_that_its_wall_takes():
    """Closed: U falls by the heat of the wall, and is m u(T) at the end; from 2000 K to 300 K."""
    vessel = tank(0.01, 5e5, CARBON_DIOXIDE, "vessel", temperature=2000.0)
    run = run_of(gx.gas.WallHeat(vessel, 20.0, temperature=300.0), dt=0.05)
    state = run.chamber("vessel")
    mass = state.mass
    assert state.internal_energy == pytest.approx(mass * CARBON_DIOXIDE.energy(2000.0), rel=1e-13)
    run.run(until=10.0)
    assert state.temperature == pytest.approx(300.0, rel=1e-6)
    assert state.internal_energy == pytest.approx(
        mass * CARBON_DIOXIDE.energy(state.temperature), rel=1e-12
    )
    assert abs(run.energy_error) <= 1e-13


def test_hot_gas_into_cold_conserves_energy_and_its_slopes():
    """Carbon dioxide of 1500 K flows into helium: the Newton matrix is that of differences."""
    a = tank(0.01, 4e5, CARBON_DIOXIDE, "a", temperature=1500.0)
    b = tank(0.02, 1e5, HELIUM, "b")
    run = run_of(gx.Orifice(a, b, area=3e-6), gx.gas.WallHeat(b, 1.0, temperature=280.0), dt=0.1)
    run.run(until=1.0)
    assert abs(run.energy_error) <= 1e-13
    network = run.system.equations.scalar_unknowns[0]
    y = network.begin_step(0.1, 1.0)
    V = np.array([state.volume for state in run.chambers.values()])
    balance = network.balance
    by_y, by_V = balance.derivatives(y, V, 0 * V)

    def column(step_y, step_V):
        ends = [balance.residual(y + s * step_y, V + s * step_V, 0 * V) for s in (1, -1)]
        return (ends[0] - ends[1]) / 2

    for k, value in enumerate(y):
        δ = np.zeros(len(y))
        # Masses that are zero are changed by a share of all mass.
        δ[k] = 1e-6 * (value if value > 1e-9 else 1e-3)
        assert column(δ, 0 * V) / δ[k] == pytest.approx(
            by_y[:, k], rel=1e-6, abs=1e-8 * abs(by_y[:, k]).max()
        )
    for k in range(2):
        δ = np.zeros(2)
        δ[k] = 1e-6 * V[k]
        assert column(0 * y, δ) / δ[k] == pytest.approx(
            by_V[:, k], rel=1e-6, abs=1e-8 * abs(by_V[:, k]).max()
        )


# ---- refusals ------------------------------------------------------------------------------------


def test_gases_that_cannot_be_told_apart_are_refused():
    a = tank(0.01, 1e5, gx.IdealGas(1.4, 287.0), "a")
    b = tank(0.01, 1e5, gx.IdealGas(1.3, 189.0), "b")
    with pytest.raises(gx.InputError, match="have the same name"):
        run_of(gx.Orifice(a, b, area=1e-6), dt=0.1)


def test_a_supply_of_one_of_several_gases_names_its_own():
    a = tank(0.01, 1e5, EQUAL, "a")
    supply = gx.gas.Ambient(2e5, name="supply")
    with pytest.raises(gx.InputError, match="'supply' supplies one of several gases"):
        run_of(gx.Orifice(supply, a, area=1e-6), dt=0.1)


def test_fractions_add_up_to_one():
    with pytest.raises(gx.InputError, match=r"add up to 0\.9"):
        gx.gas.Mixture({HELIUM: 0.4, NITROGEN: 0.5})


def test_an_adiabatic_equilibrium_of_a_hot_gas_is_refused():
    a = tank(0.01, 1e5, HOT_NITROGEN, "a")
    mass = gx.PointMass(1.0)
    with pytest.raises(gx.InputError, match=r"'hot nitrogen'.*constant specific heats"):
        gx.Equilibrium(gx.Scene(a, mass))
