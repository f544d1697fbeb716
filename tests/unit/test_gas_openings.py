"""Valves, vents, porous films and pipes: their laws, and their state after a restart."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from mpi4py import MPI
from scipy.integrate import solve_ivp

import gossamer_fx as gx
from gossamer_fx.core.forms.backend import cell_nodes, geometry_nodes
from gossamer_fx.core.mesh.quality import area_vectors
from gossamer_fx.extend import DynamicOpening, GasNetwork, Item
from gossamer_fx.mechanics.gas.contract import CompiledWall
from gossamer_fx.mechanics.gas.laws import FlowLaw, position_of
from gossamer_fx.mechanics.gas.openings import friction_parameter, isentropic_flow
from gossamer_fx.meshes.sphere import sphere
from gossamer_fx.presets.gases import HELIUM
from tests.differences import pressure_by_differences
from tests.small_scenes import AIR, inwards, run_of

OUTSIDE = gx.gas.Ambient(1e5, 300.0, name="outside")


def tank(pressure, name="tank", volume=0.01):
    return gx.Tank(volume, gas=AIR, pressure=pressure, temperature=300.0, name=name)


# ---- valves --------------------------------------------------------------------------------------


def relief(vessel, **changes):
    given = {"area": 1e-5, "opens": 2e4, "closes": 1e4, "one_way": True, "name": "relief"}
    return gx.gas.Valve(vessel, OUTSIDE, **{**given, **changes})


def test_a_relief_valve_keeps_the_pressure_between_closing_and_opening():
    """A vessel that is filled: the valve opens above 1.2e5 Pa and closes below 1.1e5 Pa, again and
    again; between them it stays as it is."""
    vessel = tank(1e5)
    valve = relief(vessel)
    supply = gx.gas.Ambient(6e5, 300.0, name="supply")
    run = run_of(gx.Orifice(supply, vessel, area=1e-6, name="inlet"), valve, dt=5e-3)
    state = run.chamber("tank")
    cycles = 0
    was_open = False
    start = 1e5
    for k in range(1, 2001):
        run.run(until=k * 5e-3)
        is_open = valve.was_open(run)
        if is_open and not was_open:
            cycles += 1
            assert start >= 1.2e5
        if was_open and not is_open:
            assert start < 1.1e5
        was_open = is_open
        start = state.pressure
        # One step passes a limit by its change of pressure.
        assert state.pressure < 1.22e5
        assert cycles == 0 or state.pressure > 1.05e5
    assert cycles > 3
    assert abs(run.energy_error) <= 1e-12 and abs(run.mass_error) <= 1e-12


def test_a_burst_vent_stays_open():
    vessel = tank(1.6e5)
    vent = gx.gas.Valve(vessel, OUTSIDE, area=1e-4, opens=5e4, name="vent")
    run = run_of(vent, dt=1e-2)
    run.run(until=3.0)
    assert vent.was_open(run)
    assert run.chamber("tank").pressure == pytest.approx(1e5, rel=1e-4)


def test_a_check_valve_lets_no_gas_back():
    """The lower pressure outside rises it never; from the vessel of higher pressure gas leaves."""
    low = tank(5e4, "low")
    high = tank(2e5, "high")
    valves = [
        gx.gas.Valve(
            vessel,
            OUTSIDE,
            area=1e-5,
            opens=0.0,
            closes=0.0,
            one_way=True,
            name=f"of {vessel.name}",
        )
        for vessel in (low, high)
    ]
    run = run_of(*valves, dt=0.05)
    run.run(until=8.0)
    assert run.chamber("low").pressure == pytest.approx(5e4, rel=1e-14)
    assert run.chamber("high").pressure == pytest.approx(1e5, rel=1e-3)


def test_an_event_opens_a_valve_and_a_restart_keeps_it_open(tmp_path: Path):
    def scene():
        vessel = tank(2e5)
        valve = gx.gas.Valve(vessel, OUTSIDE, area=1e-6)
        return valve, {"events": [gx.At(0.3, valve.open), gx.At(0.8, valve.close)]}

    valve, options = scene()
    saved = gx.Checkpoints(tmp_path / "checkpoints")
    run = run_of(valve, dt=0.1, checkpoints=saved, **options)
    state = run.chamber("tank")
    run.run(until=0.3)
    assert state.pressure == pytest.approx(2e5, rel=1e-14)
    run.run(until=0.5)
    assert state.pressure < 2e5 and valve.was_open(run)
    other, options = scene()
    again = run_of(other, dt=0.1, restart=tmp_path / "checkpoints", **options)
    assert other.was_open(again)
    for one in (run, again):
        one.run(until=1.0)
    assert again.chamber("tank").pressure == state.pressure
    # Of five steps the valve was open: choked at the start, 2e5 Pa over 1e5 Pa.
    choked = 1e-6 * isentropic_flow(AIR, 2e5, 300.0, 1e5, 1e-5)
    start = 2e5 * 0.01 / (AIR.R * 300.0)
    assert start - state.mass == pytest.approx(0.5 * choked, rel=0.05)
    assert not valve.was_open(run)


def test_gradients_by_the_area_of_a_valve_are_those_of_differences():
    """The valve opens after some steps of filling; the step in which it does is the same."""

    def make(area):
        vessel = tank(1.19e5)
        supply = gx.gas.Ambient(6e5, 300.0, name="supply")
        inlet = gx.Orifice(supply, vessel, area=1e-6, name="inlet")
        return run_of(inlet, relief(vessel, area=area), dt=5e-3)

    found = pressure_by_differences(
        make, "relief.area", 1e-6, until=0.25, chamber="tank", change=1e-3
    )
    assert found < 0


def test_a_valve_that_an_event_opens_has_no_gradient():
    vessel = tank(2e5)
    valve = gx.gas.Valve(vessel, OUTSIDE, area=1e-5, name="late")
    run = run_of(valve, dt=0.01, events=[gx.At(0.02, valve.open)])
    tape = gx.analysis.RunTape(run)
    run.run(until=0.05)
    with pytest.raises(gx.StepFailure, match="event opened"):
        gx.analysis.gradient(tape, of=gx.analysis.ChamberPressure(vessel), by=["late.area"])


def test_a_valve_that_closes_above_its_opening_is_refused():
    with pytest.raises(gx.InputError, match=r"closes is 30000\.0 and opens is 20000\.0"):
        relief(tank(1e5), closes=3e4)


# ---- discharge coefficients against the ratio of pressures ---------------------------------------

# Sharp-edged orifices, Perry, Trans. ASME 71 (1949) 757: from incompressible to choked flow.
SHARP = gx.gas.LinearTable((0.0, 0.84), (0.5, 0.75), (1.0, 0.6))


@pytest.mark.parametrize(
    ("ratio", "coefficient"), [(0.0, 0.84), (0.25, 0.795), (0.75, 0.675), (0.999999, 0.6)]
)
def test_the_coefficient_is_that_of_the_pressure_ratio(ratio, coefficient):
    a = tank(1e5)
    orifice = gx.Orifice(a, OUTSIDE, area=1.0, discharge_coefficient=SHARP)
    ideal = gx.Orifice(a, OUTSIDE, area=1.0)
    pressures = (1e5, ratio * 1e5)
    flows = [one.flow((AIR, AIR), 1.0, pressures, (300.0, 300.0)) for one in (orifice, ideal)]
    back = orifice.flow((AIR, AIR), 1.0, pressures[::-1], (300.0, 300.0))
    assert flows[0] / flows[1] == pytest.approx(coefficient, rel=1e-5)
    assert back == pytest.approx(-flows[0], rel=1e-14)


def test_a_run_with_a_table_conserves_and_has_gradients():
    def make(area):
        ends = (tank(3e5, "a"), tank(1e5, "b"))
        between = gx.Orifice(*ends, area=area, discharge_coefficient=SHARP, name="between")
        return run_of(between, dt=0.02)

    pressure_by_differences(make, "between.area", 2e-6, until=0.5, chamber="b")
    run = make(2e-6)
    tape = gx.analysis.RunTape(run)
    run.run(until=0.5)
    assert abs(run.energy_error) <= 1e-13 and abs(run.mass_error) <= 1e-13
    with pytest.raises(gx.InputError, match="discharge_coefficient"):
        gx.analysis.gradient(tape, of=gx.analysis.Energy(), by=["between.discharge_coefficient"])


def test_tables_out_of_order_or_range_are_refused():
    for points in ((), ((0.5, 0.6), (0.2, 0.8))):
        with pytest.raises(gx.InputError, match="by rising x"):
            gx.gas.LinearTable(*points)
    with pytest.raises(gx.InputError, match="out of range"):
        gx.Orifice(
            tank(1e5), OUTSIDE, area=1e-6, discharge_coefficient=gx.gas.LinearTable((0.5, 1.6))
        )


def test_openings_do_not_depend_on_the_order_of_their_ends():
    """A table at either end: only the sign of the flow turns."""
    found = []
    for order in (1, -1):
        ends = (tank(3e5, "a"), tank(1e5, "b"))[::order]
        orifice = gx.Orifice(*ends, area=2e-6, discharge_coefficient=SHARP)
        run = run_of(orifice, dt=0.05)
        run.run(until=0.5)
        found.append([run.chamber(name).pressure for name in "ab"])
    assert np.array(found[0]) == pytest.approx(np.array(found[1]), rel=1e-13)


# ---- porous films --------------------------------------------------------------------------------

RADIUS = 0.2
SOFT = {"nu": 0.3, "density": 1000.0, "thickness": 1e-4}


def porous_sphere(comm, viscous=2e3, inertial=0.0, E=1e9, p=1.2e5, dt=2e-3, start=None):
    film = gx.Membrane(sphere(comm, RADIUS, 6), gx.Linear(E=E, **SOFT), velocity=start)
    outside = gx.gas.Ambient(1e5, 300.0, name="outside")
    bag = gx.Chamber(film, gas=AIR, pressure=p, temperature=300.0, outside=outside, name="bag")
    leak = gx.gas.PorousFilm(
        bag,
        outside,
        area=gx.gas.FilmArea(film),
        viscous=viscous,
        inertial=inertial,
        name="leak",
    )
    return gx.Simulation(
        gx.Scene(film, bag, leak),
        gx.Midpoint(dt=dt, tolerances=gx.Tolerances(relative=1e-12)),
    )


def flat_area(run) -> float:
    """Area [m²] of the triangles of the only film of a scene on one rank, on the mesh."""
    domain = run.system.unknowns.bodies[0].mesh.domain
    corners = domain.geometry.x[geometry_nodes(domain)]
    return float(np.linalg.norm(area_vectors(corners), axis=1).sum())


@pytest.mark.parametrize(("until", "dt", "last"), [(0.004, 5e-5, 1.18e5), (0.2, 2e-3, 1.1e5)])
@pytest.mark.parametrize(("viscous", "inertial"), [(2e3, 0.0), (1e3, 2e3)])
def test_leak_down_of_a_porous_sphere(viscous, inertial, until, dt, last):
    """A stiff sphere of 1.2e5 Pa in air of 1e5 Pa against the ordinary differential equation of its
    gas at constant volume and area, on the way and at its end, which any law reaches; the film
    stretches by some 1e-5."""
    run = porous_sphere(MPI.COMM_SELF, viscous, inertial, E=1e12, dt=dt)
    state = run.chamber("bag")
    volume = state.volume
    flat = flat_area(run)

    def rates(t, y):
        mass, energy = y
        p = (AIR.gamma - 1) * energy / volume
        T = energy / (mass * AIR.cv)
        # The positive root of Δp = viscous v + inertial v²
        v = np.roots([inertial, viscous, 1e5 - p]).max()
        flow = mass / volume * flat * v
        return [-flow, -flow * AIR.cp * T]

    start = [state.mass, state.internal_energy]
    exact = solve_ivp(rates, (0, until), start, rtol=1e-11, atol=1e-12).y[:, -1]
    run.run(until=until)
    assert [state.mass, state.internal_energy] == pytest.approx(exact, rel=1e-4)
    assert state.pressure < last
    assert abs(run.energy_error) <= 1e-10 and abs(run.mass_error) <= 1e-13


@pytest.mark.mpi
def test_a_porous_film_leaks_the_same_on_several_ranks(comm):
    found = []
    for ranks in (MPI.COMM_SELF, comm):
        run = porous_sphere(ranks, E=1e7)
        run.run(until=0.02)
        state = run.chamber("bag")
        found.append([state.pressure, state.mass])
    assert found[1] == pytest.approx(found[0], rel=1e-9)


def test_the_leak_counts_the_deformed_area():
    """A soft sphere stretches: its area is that of the triangles where they are, which differs by
    some 1e-3 from that of a sphere of their mean radius, as the film vibrates."""
    run = porous_sphere(MPI.COMM_SELF, E=2e7, dt=1e-3, viscous=2e5)
    run.run(until=0.02)
    leak = next(item for item in run.scene.items if item.name == "leak")
    area = run.system.equations.scalar_unknowns[0].geometry.area(leak.area)
    x = run.system.unknowns.q0.array_r.reshape(-1, 3)
    radius = np.linalg.norm(x, axis=1).mean()
    assert radius > 1.01 * RADIUS
    triangles = x[cell_nodes(run.system.unknowns.bodies[0].space)]
    stretched = float(np.linalg.norm(area_vectors(triangles), axis=1).sum())
    assert area.aperture(0.0) == pytest.approx(stretched, rel=1e-12)


def test_gradients_through_a_porous_film_are_those_of_differences():
    """By the thickness of the film: it acts through the motion, and the area through which the gas
    leaks."""

    def make(thickness):
        law = gx.Linear(E=1e7, nu=0.3, density=1000.0, thickness=thickness)
        film = gx.Membrane(sphere(MPI.COMM_SELF, RADIUS, 4), law, velocity=inwards, name="film")
        outside = gx.gas.Ambient(1e5, 300.0, name="outside")
        bag = gx.Chamber(film, gas=AIR, pressure=1.1e5, temperature=300.0, outside=outside)
        leak = gx.gas.PorousFilm(bag, outside, area=gx.gas.FilmArea(film), viscous=500.0)
        return gx.Simulation(
            gx.Scene(film, bag, leak),
            gx.Midpoint(dt=1e-3, tolerances=gx.Tolerances(relative=1e-13)),
        )

    pressure_by_differences(
        make, "film.thickness", 1e-4, until=0.01, chamber="chamber", change=1e-3
    )


# ---- pipes ---------------------------------------------------------------------------------------

# Fanno flow, γ = 1.4: 4 f L*/D by Mach number, as printed.  Up to 0.16: S. Farokhi, Aircraft
# Propulsion (2nd ed. 2014), appendix E; others: J. D. Anderson, Modern Compressible Flow, table A.4
FANNO = {
    0.1: "66.922",
    0.12: "45.408",
    0.14: "32.511",
    0.16: "24.198",
    0.2: "14.53",
    0.5: "1.069",
    0.8: "0.07229",
}


@pytest.mark.parametrize("M", FANNO)
def test_friction_parameters_are_those_of_the_tables(M):
    """To the last digit that is printed, 1e-5 of the values with five digits."""
    printed = FANNO[M]
    digits = len(printed.split(".")[1])
    assert round(friction_parameter(1.4, M), digits) == float(printed)


def mass_number(M):
    return M * (1 + 0.2 * M**2) ** -3


def hose(resistance, a=None, b=OUTSIDE):
    return gx.gas.Pipe(
        a or tank(2e5), b, diameter=1e-3, length=1.0, friction=resistance * 1e-3, name="hose"
    )


@pytest.mark.parametrize(
    ("M1", "M2"), [(0.2, 1.0), (0.5, 1.0), (0.2, 0.5), (0.1, 0.2), (0.3, 0.31), (0.01, 0.5)]
)
def test_a_pipe_has_the_mach_numbers_of_fanno_flow(M1, M2):
    """From the inlet at M1 to the end at M2; the pressures are those of the relations for the
    stagnation pressure and p/p*, which do not enter the code."""
    resistance = friction_parameter(1.4, M1) - friction_parameter(1.4, M2)

    def over_critical(M):
        return np.sqrt(1.2 / (1 + 0.2 * M**2)) / M

    inlet = 2e5 * (1 + 0.2 * M1**2) ** -3.5
    end = inlet * over_critical(M2) / over_critical(M1)
    exact = np.pi / 4 * 1e-6 * 2e5 * np.sqrt(1.4 / (AIR.R * 300.0)) * mass_number(M1)
    pipe = hose(resistance)
    for share in (1.0, 0.5) if M2 == 1 else (1.0,):
        pressures = (2e5, end * share)
        found = pipe.flow((AIR, AIR), 1.0, pressures, (300.0, 300.0))
        assert found == pytest.approx(exact, rel=1e-7 if share == 1 else 1e-9)
        back = pipe.flow((AIR, AIR), 1.0, pressures[::-1], (300.0, 300.0))
        assert back == pytest.approx(-found, rel=1e-14)


@pytest.mark.parametrize("x", [0.9, 0.3, 0.05, 1 - 3e-6])
def test_the_compiled_law_of_a_pipe_has_its_slopes(x):
    pipe = hose(20.0)

    def flow(p):
        return pipe.flow((AIR, AIR), 1.0, (2e5, p), (300.0, 300.0))

    p = 2e5 * x
    # The cubic near rest bends within 2 Pa.
    δ = 0.05 if x < 0.99 else 1e-3
    difference = (flow(p + δ) - flow(p - δ)) / (2 * δ)
    slope = flow(p + 1e-30j).imag / 1e-30
    of_pipe = FlowLaw(pipe, [AIR])
    law = of_pipe.compile(2, MPI.COMM_SELF)
    ends = (2e5, 300.0, AIR.R, 1.4, 1.0, p, 300.0, AIR.R, 1.4, 1.0)
    values, slopes = law(*ends, 1.0, *of_pipe.numbers)
    scale = flow(1e4) / 2e5
    assert law.derivatives == "compiled"
    assert values[0] == pytest.approx(flow(p), rel=1e-11)
    assert slope == pytest.approx(difference, rel=1e-6, abs=1e-8 * scale)
    assert slopes[0, 2] == pytest.approx(slope, rel=1e-10, abs=1e-12 * scale)


def test_filling_through_a_pipe_conserves_and_ends_at_rest():
    a = tank(5e5, "a")
    b = tank(1e4, "b")
    run = run_of(hose(30.0, a, b), dt=4.0)
    run.run(until=400.0)
    pressures = [run.chamber(name).pressure for name in "ab"]
    assert pressures == pytest.approx([2.55e5, 2.55e5], rel=1e-3)
    assert abs(run.energy_error) <= 1e-13 and abs(run.mass_error) <= 1e-13


# ---- the balance in C ----------------------------------------------------------------------------


TABLE = gx.gas.LinearTable((0.0, 0.9), (0.5, 0.8), (1.0, 0.6))
CURVE = gx.gas.LinearTable((0.0, 0.02), (1e5, 0.01), (6e5, 0.0))
BOTTLE = gx.gas.Ambient(2e7, 300.0, gas=AIR, name="bottle")
COLD = gx.gas.Ambient(1e5, 250.0, gas=AIR, name="cold")


def orifices(a, b, c):
    """Choked, subsonic, laminar and reversed flows between three tanks, a reservoir and a
    vacuum."""
    return [
        gx.Orifice(a, b, area=2e-6, name="choked"),
        gx.Orifice(c, b, area=1e-6, laminar=1e-2, name="laminar"),
        gx.Orifice(c, a, area=lambda t: 1e-6, discharge_coefficient=0.6, name="reversed"),
        gx.Orifice(gx.gas.Ambient(3e5, 400.0, gas=AIR, name="hot"), b, area=3e-6, name="subsonic"),
        gx.Orifice(c, gx.gas.Ambient(0.0, 300.0, name="space"), area=1e-7, name="leak"),
    ]


def other_kinds(a, b, c):
    """A table, a one-way valve, a porous film, a pipe and a wall."""
    return [
        gx.Orifice(a, b, area=2e-6, discharge_coefficient=TABLE, name="table"),
        gx.gas.Valve(b, COLD, area=1e-6, opens=1e3, closes=0.0, one_way=True),
        gx.gas.PorousFilm(c, COLD, area=1e-3, viscous=4e4, inertial=10.0),
        gx.gas.Pipe(b, c, diameter=2e-3, length=1.0, friction=0.02),
        gx.gas.WallHeat(a, 0.5, temperature=350.0),
    ]


def feeds(a, b, c):
    """A blower, a regulator, an inflator, evaporation, and a wall by a law of the user."""
    return [
        gx.gas.Blower(COLD, a, curve=CURVE),
        gx.gas.Regulator(BOTTLE, c, area=1e-6, pressure=2e5, droop=2e4),
        gx.gas.Inflator(b, gas=AIR, mass_flow=1e-4, temperature=600.0),
        gx.gas.Sublimation(b, gas=AIR, pressure=3e5, temperature=300.0, area=1e-5),
        gx.Orifice(b, c, area=1e-6),
    ]


@dataclass(frozen=True, eq=False)
class Plate(DynamicOpening):
    """A plate on a spring, which the pressure of a lifts; its flow is proportional to its lift and
    to the difference of pressures."""

    a: gx.Tank
    b: gx.Tank
    mass: float = 0.01
    spring: float = 2e3
    lift: float = 1e-3
    speed: float = 0.1
    name: str = "plate"
    scalar_unknowns = GasNetwork
    variables: ClassVar = {"lift": "m", "speed": "m/s"}
    parameters: ClassVar = {"mass": "kg", "spring": "N/m"}

    def rates(self, p, T):
        force = 1e-5 * (p[0] - p[1]) - self.spring * self.lift - 1e-3 * T[0] * self.speed
        return {"speed": force / self.mass, "lift": self.speed}

    def flow(self, gases, area, p, T):
        upstream = 0 if p[0] > p[1] else 1
        difference = p[0] - p[1]
        return area * 1e-5 * self.lift * difference / (gases[upstream].R * T[upstream]) ** 0.5


def plates(a, b, c):
    """Openings with state variables, and one without."""
    return [Plate(a, b), gx.Orifice(b, c, area=1e-6), Plate(c, b, spring=1e3, name="second")]


@pytest.mark.parametrize("other", [AIR, HELIUM], ids=["one gas", "mixture"])
@pytest.mark.parametrize("items", [orifices, other_kinds, feeds, plates])
@pytest.mark.parametrize("h", [1e-4, 0.05])
def test_all_derivatives_of_a_balance_are_those_of_differences(items, h, other):
    """By pressures, masses, volumes, state variables of openings, the start of the step, areas,
    numbers of openings, boundaries and walls; the weights of flows, which depend on the start,
    included."""
    a, b = tank(5e5, "a"), tank(2e5, "b", 0.02)
    c = gx.Tank(0.005, gas=other, pressure=1.99e5, temperature=320.0, name="c")
    run = run_of(*items(a, b, c), dt=h)
    network = run.system.equations.scalar_unknowns[0]
    y = network.begin_step(h, h / 2)
    balance = network.balance
    n = len(network.chambers)
    start = {
        "p0": np.array([state.pressure for state in network.chambers]),
        "m0": np.concatenate([state.masses for state in network.chambers]),
        "V0": np.array([state.volume for state in network.chambers]),
        "x0": network.x.copy(),
    }
    inputs, at_numbers = numbers_with_derivatives(balance)
    step = {
        "y": y * np.linspace(0.98, 1.03, len(y)),
        "V": network.volumes * np.linspace(1.02, 0.97, n),
        "W": network.volumes * 0.01,
        "area": balance._areas.copy(),
        "boundary": balance._boundary.ravel().copy(),
        "wall": balance._wall_states.ravel().copy(),
        "numbers": inputs[at_numbers].copy(),
    }
    values = start | step

    def residual(values):
        begin = {name: values[name] for name in ("p0", "m0", "V0", "x0")}
        for name, given in begin.items():
            balance._start[name][:] = given
        balance._start["U0"][:] = network.contents.energies(begin["p0"] * begin["V0"], begin["m0"])
        balance._areas[:] = values["area"]
        balance._boundary.ravel()[:] = values["boundary"]
        balance._wall_states.ravel()[:] = values["wall"]
        inputs[at_numbers] = values["numbers"]
        balance._c.lib.gas_begin(balance._network.pointer)
        return balance.residual(values["y"], values["V"], values["W"])

    residual(values)
    found = balance.all_derivatives(values["y"], values["V"], values["W"])
    assert {law.derivatives for law in balance._laws} == {"compiled"}
    scale = balance.scales(values["y"], values["V"], values["V"])[:, None]
    by_y, by_V = balance.derivatives(values["y"], values["V"], values["W"])
    assert found["y"] == pytest.approx(by_y, rel=1e-10, abs=1e-12 * abs(by_y).max())
    assert found["V"] == pytest.approx(by_V, rel=1e-10, abs=1e-12 * abs(by_V).max())
    for name, slopes in found.items():
        for column, value in enumerate(values[name]):
            # Masses that are zero are changed by a share of those that are not.
            size = abs(value) or (1e-3 if name in ("y", "m0") else 1.0)
            ends = []
            for sign in (-1, 1):
                varied = {key: array.copy() for key, array in values.items()}
                varied[name][column] += sign * 1e-6 * size
                ends.append(residual(varied))
            difference = (ends[1] - ends[0]) / 2e-6
            error = abs(slopes[:, column] * size - difference)[:, None] / scale
            assert error.max() <= 1e-7, (name, column)


def numbers_with_derivatives(balance):
    """The arguments of the laws of openings in C, and where the parameters of openings are in
    them."""
    found = []
    first = 0
    for passage, flow in zip(balance.passages, balance.flow_laws, strict=True):
        own = first + 2 * flow.end_count + 1
        found += [own + position_of(passage.opening, name) for name in flow.parameters]
        first = own + len(flow.numbers)
    return np.frombuffer(balance._c.ffi.buffer(balance._network.pointer.inputs, 8 * first)), found


NUMBERS = [
    (gx.gas.Pipe, {"diameter": 2e-3, "length": 1.0, "friction": 0.02}),
    (gx.gas.PorousFilm, {"viscous": 4e4, "inertial": 10.0}),
    (gx.gas.Regulator, {"pressure": 2e5, "droop": 2e5}),
]


@pytest.mark.parametrize(
    ("kind", "numbers", "name"),
    [(kind, numbers, name) for kind, numbers in NUMBERS for name in numbers],
    ids=[f"{kind.__name__} {name}" for kind, numbers in NUMBERS for name in numbers],
)
def test_gradients_by_the_numbers_of_openings_are_those_of_differences(kind, numbers, name):
    area = {} if kind is gx.gas.Pipe else {"area": 1e-6 if kind is gx.gas.Regulator else 1e-3}

    def make(value):
        ends = (tank(3e5, "a"), tank(1e5, "b"))
        opening = kind(*ends, **(area | numbers | {name: value}), name="between")
        return run_of(opening, dt=0.02)

    change = 1e-2 if name == "inertial" else 1e-3
    found = pressure_by_differences(
        make, f"between.{name}", numbers[name], until=0.5, chamber="b", change=change
    )
    assert found != 0


def test_flows_of_a_user_are_compiled_with_their_numbers():
    """An orifice of the user, derived from the one here, and an opening that needs real numbers."""

    class Own(gx.Orifice):
        def flux(self, gas, pu, Tu, pd):
            return 0.5 * super().flux(gas, pu, Tu, pd)

    class Tabulated(gx.Orifice):
        def flux(self, gas, pu, Tu, pd):
            return np.interp(pd / pu, [0.0, 1.0], [1.0, 0.0]) * pu / (gas.R * Tu) ** 0.5

    vessel = tank(2e5)
    for kind, derivatives in ((Own, "compiled"), (Tabulated, "differences")):
        run = run_of(vessel, kind(vessel, OUTSIDE, area=1e-6), dt=0.1)
        run.run(until=1.0)
        assert 1e5 < run.chamber("tank").pressure < 2e5
        assert abs(run.energy_error) <= 1e-13
        laws = run.system.equations.scalar_unknowns[0].balance._laws
        assert derivatives in {law.derivatives for law in laws}


# ---- own items -----------------------------------------------------------------------------------


class LooseOpening(Item):
    """All members of an opening, without its base class."""

    name = "slit"

    def __init__(self, a, b):
        self.a = a
        self.b = b

    def requires(self):
        return [self.a, self.b]

    def terms(self, start):
        return []

    def aperture(self, geometry):
        return lambda h, t: 1e-6

    def flow(self, gases, area, p, T):
        return area * 1e-3 * (p[0] - p[1])


class LooseWall(Item):
    """All members of a wall, without its base class."""

    name = "heater"
    temperature = 400.0

    def __init__(self, chamber):
        self.chamber = chamber

    def requires(self):
        return [self.chamber]

    def terms(self, start):
        return []

    def compile(self, geometry):
        return CompiledWall(lambda h: (400.0, 1.0))


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    "item",
    [LooseOpening(tank(2e5), tank(1e5, "sink")), LooseWall(tank(1e5))],
    ids=["opening", "wall"],
)
def test_an_own_item_without_its_base_class_is_refused_and_not_left_out(item):
    words = rf"'{item.name}' .* adds nothing .* gossamer_fx\.extend\.Volume, Opening or Wall"
    with pytest.raises(gx.InputError, match=words):
        run_of(item, dt=1e-2)


@pytest.mark.mpi
def test_an_own_volume_without_its_base_is_refused_where_it_is_alone(comm):
    """No network looks at it, as the scene has no gas."""

    class Bag(Item):
        name = "bag"
        initial_pressure = 1e5
        initial_temperature = 300.0
        gas = gx.IdealGas(gamma=1.4, R=287.0)
        fixed_volume = 1e-3
        enclosure = None
        outside = None

        def terms(self, start):
            return ()

    mass = gx.PointMass(1.0, (0.0, 0.0, 0.0), comm=comm)
    with pytest.raises(gx.InputError, match=r"'bag' \(Bag\) adds nothing .*extend\.Volume"):
        gx.Simulation(gx.Scene(mass, Bag()), gx.Midpoint(dt=1e-2))
