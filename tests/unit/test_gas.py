"""Chambers and orifices without a mesh: flows, and conservation of mass and energy."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.mechanics.gas.openings import isentropic_flow
from tests.rates import observed_order
from tests.small_scenes import AIR, WRINKLING

LAMINAR = 1e-5


def start(*items, dt: float):
    run = gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=dt))
    return run, list(run.chambers.values())


def tank(volume, pressure, temperature, name):
    return gx.Tank(volume, gas=AIR, pressure=pressure, temperature=temperature, name=name)


def vessel_of(volume, pressure, temperature):
    return gx.Chamber(gas=AIR, pressure=pressure, temperature=temperature, volume=volume)


def inlet(vessel, pressure, area):
    """An orifice from a reservoir of 300 K."""
    return gx.Orifice(gx.gas.Ambient(pressure, 300.0, name="reservoir"), vessel, area=area)


def pressures(states):
    return np.array([s.pressure for s in states])


# ---- the law of the orifice ----------------------------------------------------------------------


def test_choked_flow_has_the_exact_value_whatever_is_downstream():
    """ṁ* = C_dA p_u √(γ/(R T_u)) (2/(γ+1))^((γ+1)/(2(γ-1))) = 4.6671e-4 kg/s for 1e-6 m², 2e5 Pa,
    300 K."""
    critical = (2 / 2.4) ** (1.4 / 0.4)
    flows = [
        1e-6 * isentropic_flow(AIR, 2e5, 300.0, x * 2e5, LAMINAR)
        for x in (0.0, 0.2, 0.999 * critical)
    ]
    assert flows[0] == pytest.approx(4.6671e-4, rel=1e-5)
    assert flows[0] == flows[1] == flows[2]


@pytest.mark.parametrize("border", [(2 / 2.4) ** 3.5, 1 - LAMINAR], ids=["choked", "laminar"])
def test_flow_and_its_slope_are_continuous_between_the_branches(border):
    def flow(x):
        return isentropic_flow(AIR, 1.0, 1.0 / 287.0, x, LAMINAR).real

    def slope(x):
        return isentropic_flow(AIR, 1.0, 1.0 / 287.0, x + 1e-30j, LAMINAR).imag / 1e-30

    δ = 1e-10 * (1 - border)
    assert flow(border + δ) == pytest.approx(flow(border - δ), rel=1e-9)
    assert slope(border + δ) == pytest.approx(slope(border - δ), rel=1e-6, abs=1e-8)


def test_flow_grows_with_the_pressure_difference():
    x = np.concatenate([np.linspace(0, 1, 500), 1 - np.geomspace(1e-16, 1e-4, 500)])
    flows = [isentropic_flow(AIR, 1e5, 300.0, p, LAMINAR).real for p in 1e5 * np.sort(x)]
    assert (np.diff(flows) <= 1e-15 * flows[0]).all() and flows[-1] == 0


def test_vacuum_gives_no_flow():
    orifice = gx.Orifice(gx.gas.Ambient(), gx.gas.Ambient(1e5, 300.0, name="reservoir"), area=1.0)
    assert orifice.flow((AIR, AIR), 1.0, (0.0, 0.0), (300.0, 300.0)) == 0
    assert orifice.flow((AIR, AIR), 1.0, (0.0, 1e5), (300.0, 300.0)).real < 0


# ---- flows of a scene ----------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [1e-3, 0.1, 10.0, 1e4])
@pytest.mark.parametrize("p", [1e-3, 5e4, 99e3, 3e5])
def test_stiff_filling_does_not_ring(dt, p):
    """A wide opening equalises within milliseconds; steps up to a million times longer reach p0 and
    stay there."""
    vessel = vessel_of(1e-3, p, 300.0)
    run, (state,) = start(vessel, inlet(vessel, 1e5, 1e-3), dt=dt)
    history = [p]
    for k in range(1, 41):
        run.run(until=k * dt)
        history.append(state.pressure)
    distance = abs(np.array(history) - 1e5)
    assert (np.diff(distance) <= 1e-6 * 1e5).all()
    if dt >= 0.1:
        assert distance[20:].max() <= 1e-4 * 1e5
    assert run.substeps == 0


def test_equal_pressures_stay_equal():
    a, b = (tank(0.01, 1e5, T, f"{T}") for T in (250.0, 400.0))
    run, states = start(gx.Orifice(a, b, area=1e-3), dt=0.1)
    run.run(until=1.0)
    assert pressures(states) == pytest.approx([1e5, 1e5], rel=1e-14)
    assert [s.temperature for s in states] == pytest.approx([250.0, 400.0], rel=1e-14)
    assert run.iterations <= run.step


def test_flow_reverses_when_the_reservoir_is_the_lower_one():
    vessel = vessel_of(0.01, 3e5, 500.0)
    run, (state,) = start(inlet(vessel, 1e5, 1e-5), dt=0.02)
    m_start = state.mass
    run.run(until=10.0)
    assert state.pressure == pytest.approx(1e5, rel=1e-4) and state.mass < m_start
    expected = 500.0 * (1 / 3) ** (0.4 / 1.4)
    assert state.temperature == pytest.approx(
        expected, rel=1e-3
    )  # what stays expands isentropically
    assert abs(run.energy_error) <= 1e-13 and abs(run.mass_error) <= 1e-13
    assert run.totals.mass_supplied == pytest.approx(state.mass - m_start, rel=1e-12)


def test_valve_lets_through_what_its_area_says():
    """While choked, m(t) = m_start + ṁ*/A ∫a(t)dt; the midpoint takes a(t) to second order."""

    def valve(t):
        return 1e-6 * math.sin(t) ** 2

    exact = 4.6671e-4 * (2.0 / 2 - math.sin(4.0) / 4)
    steps = [0.4, 0.2, 0.1]
    errors = []
    for dt in steps:
        vessel = vessel_of(0.01, 1e-3, 300.0)
        run, (state,) = start(inlet(vessel, 2e5, valve), dt=dt)
        m_start = state.mass
        run.run(until=2.0)
        errors.append((state.mass - m_start) / exact - 1)
    assert abs(errors[-1]) <= 1e-3
    assert observed_order(steps[:2], errors[:2]) == pytest.approx(2, abs=0.3)


def test_closed_valve_lets_nothing_through():
    vessel = vessel_of(0.01, 1e4, 300.0)
    run, (state,) = start(inlet(vessel, 2e5, lambda t: 0.0), dt=0.1)
    m = state.mass
    run.run(until=1.0)
    assert state.mass == m and state.pressure == pytest.approx(1e4, rel=1e-14)


@pytest.mark.parametrize("dt", [1.0, 10.0, 1e3])
def test_wall_warms_the_gas_exponentially(dt):
    """T = T_w + (T_0 - T_w) exp(-k t/(m c_v)) in a rigid closed chamber, for steps of any
    length."""
    vessel = vessel_of(0.01, 1e5, 200.0)
    run, (state,) = start(
        vessel, gx.gas.WallHeat(vessel, conductance=0.5, temperature=350.0), dt=dt
    )
    rate = 0.5 / (state.mass * AIR.cv)
    U = state.internal_energy
    for t in (dt, 3 * dt):
        run.run(until=t)
        assert state.temperature == pytest.approx(350.0 - 150.0 * math.exp(-rate * t), rel=1e-9)
    assert run.totals.supplied == pytest.approx(state.internal_energy - U, rel=1e-12)
    assert abs(run.energy_error) <= 1e-13


def test_graph_of_five_chambers_keeps_mass_and_energy():
    """A ring with two chords, one of them to a hot chamber; in the end all pressures are
    ΣU(γ-1)/ΣV."""
    volumes = (0.01, 0.02, 0.005, 0.03, 0.01)
    start_pressures = (4e5, 1e-3, 2e5, 5e4, 1e5)
    temperatures = (300.0, 300.0, 350.0, 280.0, 900.0)
    tanks = [
        tank(V, p, T, f"tank {k}")
        for k, (V, p, T) in enumerate(zip(volumes, start_pressures, temperatures, strict=True))
    ]
    edges = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 0), (1, 3), (4, 2)]
    openings = [
        gx.Orifice(tanks[i], tanks[j], area=2e-6 * (1 + i), name=f"{i}-{j}") for i, j in edges
    ]
    run, states = start(*openings, dt=0.1)
    mass = run.first.mass
    energy = run.first.energy
    run.run(until=60.0)
    assert run.totals.mass == pytest.approx(mass, rel=1e-12)
    assert run.totals.energy == pytest.approx(energy, rel=1e-12)
    assert run.totals.supplied == 0 == run.totals.mass_supplied
    assert pressures(states) == pytest.approx(np.full(5, 0.4 * energy / sum(volumes)), rel=1e-4)
    temperatures = [s.temperature for s in states]
    assert min(temperatures) > 150 and max(temperatures) < 1260


def test_recorded_flows_are_those_of_the_balance(tmp_path: Path):
    """Summed over the steps they are the mass that each end gains or loses, also after a restart,
    whose first row has the flow of the step before."""

    def scene():
        source = tank(0.01, 3e5, 300.0, "source")
        vessel = tank(0.02, 1e5, 350.0, "vessel")
        between = gx.Orifice(vessel, source, area=2e-6, name="between")
        leak = gx.Orifice(vessel, gx.gas.Ambient(), area=lambda t: 1e-6 * t, name="leak")
        return gx.Scene(between, leak), gx.probes.GasFlow(leak)

    dt = 0.1
    folder = tmp_path / "run"
    first, _ = scene()
    saved = gx.Checkpoints(folder / "checkpoints")
    run = gx.Simulation(
        first, gx.Midpoint(dt=dt), outputs=[gx.Recording(folder)], checkpoints=saved
    )
    run.run(until=0.5)
    second, leak = scene()
    again = gx.Simulation(
        second, gx.Midpoint(dt=dt), outputs=[gx.Recording(folder)], restart=folder / "checkpoints"
    )
    assert leak(again) == leak(run) > 0
    again.run(until=1.0)
    rows = gx.plot.RunReader(folder).table("gas.csv")
    from_source = -dt * rows["between flow"]
    into_air = dt * rows["leak flow"]
    assert len(from_source) == 11
    for flow, tank_name, sign in (
        (from_source, "source", -1),
        (from_source - into_air, "vessel", 1),
    ):
        change = np.diff(rows[f"{tank_name} mass"])
        assert sign * flow[1:] == pytest.approx(change, rel=1e-9, abs=1e-15)
    with pytest.raises(gx.InputError, match="'leak' is not in the scene"):
        leak(start(tank(1.0, 1e5, 300.0, "alone"), dt=dt)[0])


def test_chain_through_a_chamber_without_volume_to_speak_of():
    """A tiny chamber between two large ones passes on what it gets: the flows of both openings
    become equal."""
    big = tank(1.0, 2e5, 300.0, "big")
    tiny = tank(1e-9, 1e5, 300.0, "tiny")
    other = tank(1.0, 1e-3, 300.0, "other")
    openings = [
        gx.Orifice(big, tiny, area=1e-5, name="in"),
        gx.Orifice(tiny, other, area=2e-5, name="out"),
    ]
    run, states = start(*openings, dt=0.1)
    run.run(until=2.0)
    assert abs(run.mass_error) <= 1e-12 and abs(run.energy_error) <= 1e-12
    choked = 1e-5 * isentropic_flow(AIR, 2e5, 300.0, 0.0, LAMINAR).real
    assert states[2].mass == pytest.approx(choked * 2.0, rel=0.02)


def test_scene_of_gas_alone_has_no_field():
    vessel = vessel_of(0.01, 1e5, 300.0)
    run, _ = start(vessel, gx.Orifice(vessel, gx.gas.Ambient(), area=1e-6), dt=0.1)
    assert run.system.unknowns.numbering.size == 0 and run.totals.kinetic == 0
    assert list(run.totals.stored) == ["chamber"]


def test_a_dead_volume_is_zero_or_positive(comm):
    from gossamer_fx.meshes.sphere import sphere

    film = gx.Membrane(sphere(comm, 1.0, 6), WRINKLING)

    def chamber(dead_volume):
        return gx.Chamber(
            film, gas=AIR, pressure=1e5, temperature=300.0, dead_volume=dead_volume, name="ball"
        )

    refusal = r"'ball': dead_volume is -1e-06 m³; give zero or a positive number"
    with pytest.raises(gx.InputError, match=refusal):
        chamber(-1e-6)
    _, (state,) = start(film, chamber(0.0), dt=1e-4)
    assert state.volume == pytest.approx(film.mesh.enclosed_volume(), rel=1e-12)
