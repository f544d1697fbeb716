"""Valves, vents, porous films and pipes: their laws, and their state after a restart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from scipy.integrate import solve_ivp

import gossamer_fx as gx
from gossamer_fx.core.algebra.dual_numbers import jacobian, variables
from gossamer_fx.core.forms.backend import cell_nodes, geometry_nodes
from gossamer_fx.core.mesh.quality import area_vectors
from gossamer_fx.mechanics.gas.balance import Balance
from gossamer_fx.mechanics.gas.compiled_balance import CompiledBalance
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
    with pytest.raises(gx.InputError, match="closes at 30000"):
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
    exact = 2e5 * np.sqrt(1.4 / (AIR.R * 300.0)) * mass_number(M1)
    pipe = hose(resistance)
    for share in (1.0, 0.5) if M2 == 1 else (1.0,):
        pressures = (2e5, end * share)
        found = pipe.flow((AIR, AIR), 1.0, pressures, (300.0, 300.0))
        assert found == pytest.approx(exact, rel=1e-7 if share == 1 else 1e-9)
        back = pipe.flow((AIR, AIR), 1.0, pressures[::-1], (300.0, 300.0))
        assert back == pytest.approx(-found, rel=1e-14)


@pytest.mark.parametrize("x", [0.9, 0.3, 0.05, 1 - 3e-6])
def test_complex_steps_and_dual_numbers_give_the_slopes_of_a_pipe(x):
    pipe = hose(20.0)

    def flow(p):
        return pipe.flow((AIR, AIR), 1.0, (2e5, p), (300.0, 300.0))

    p = 2e5 * x
    # The cubic near rest bends within 2 Pa.
    δ = 0.05 if x < 0.99 else 1e-3
    difference = (flow(p + δ) - flow(p - δ)) / (2 * δ)
    slope = flow(p + 1e-30j).imag / 1e-30
    (dual,) = variables(np.array([p]))
    scale = flow(1e4) / 2e5
    assert slope == pytest.approx(difference, rel=1e-6, abs=1e-8 * scale)
    assert jacobian([flow(dual)], 1)[0, 0] == pytest.approx(slope, rel=1e-10, abs=1e-12 * scale)


def test_filling_through_a_pipe_conserves_and_ends_at_rest():
    a = tank(5e5, "a")
    b = tank(1e4, "b")
    run = run_of(hose(30.0, a, b), dt=4.0)
    run.run(until=400.0)
    pressures = [run.chamber(name).pressure for name in "ab"]
    assert pressures == pytest.approx([2.55e5, 2.55e5], rel=1e-3)
    assert abs(run.energy_error) <= 1e-13 and abs(run.mass_error) <= 1e-13


# ---- the balance in C ----------------------------------------------------------------------------


@pytest.mark.parametrize("h", [1e-4, 0.05, 20.0])
def test_the_balance_in_c_is_that_in_python(h):
    """Choked, subsonic, laminar and reversed flows between three tanks, a reservoir and a vacuum:
    residual, its scales, derivatives and solution at volumes that have changed."""
    a, b, c = tank(5e5, "a"), tank(2e5, "b", 0.02), tank(1.9999e5, "c", 0.005)
    orifices = [
        gx.Orifice(a, b, area=2e-6, name="choked"),
        gx.Orifice(c, b, area=1e-6, laminar=1e-2, name="laminar"),
        gx.Orifice(c, a, area=lambda t: 1e-6, discharge_coefficient=0.6, name="reversed"),
        gx.Orifice(gx.gas.Ambient(3e5, 400.0, name="reservoir"), b, area=3e-6, name="subsonic"),
        gx.Orifice(c, gx.gas.Ambient(0.0, 300.0, name="space"), area=1e-7, name="leak"),
    ]
    run = run_of(*orifices, dt=h)
    network = run.system.equations.scalar_unknowns[0]
    in_c = network.balance
    assert isinstance(in_c, CompiledBalance)
    guess = network.begin_step(h, h / 2)
    in_python = Balance(in_c.contents, in_c.passages, in_c.walls)
    state = [in_c._p0, in_c._m0, in_c._U0, network.volumes]
    in_python.begin(h, h / 2, *state)
    V = network.volumes * (1.02, 0.99, 1.05)
    W = V - network.volumes
    y = guess * (1.01, 0.98, 1.03, 0.99, 1.02, 1.0)
    scale = in_c.scales(y, V, V)
    assert scale == pytest.approx(in_python.scales(y, V, V), rel=1e-13)
    difference = in_c.residual(y, V, W) - in_python.residual(y, V, W)
    assert abs(difference / scale).max() <= 1e-14 * (1 + abs(in_c.residual(y, V, W) / scale).max())
    pairs = zip(in_c.derivatives(y, V, W), in_python.derivatives(y, V, W), strict=True)
    for ours, theirs in pairs:
        assert ours == pytest.approx(theirs, rel=1e-11, abs=1e-13 * abs(theirs).max())
    assert in_c.settle(y, V, W, V) == pytest.approx(in_python.settle(y, V, W, V), rel=1e-11)
    # Volumes that no positive pressure can balance
    assert in_c.settle(y, V, W - 100 * V, V) is None
    assert in_python.settle(y, V, W - 100 * V, V) is None


def test_other_laws_are_not_computed_in_c():
    """A table, a one-way valve, an orifice of the user and a second gas."""

    class Own(gx.Orifice):
        def flux(self, gas, pu, Tu, pd):
            return 0.5 * super().flux(gas, pu, Tu, pd)

    table = gx.gas.LinearTable((0.0, 0.8), (1.0, 0.6))
    vessel = tank(2e5)
    helium = gx.Tank(0.01, gas=HELIUM, pressure=1e5, temperature=300.0, name="helium")
    others = [
        gx.Orifice(vessel, OUTSIDE, area=1e-6, discharge_coefficient=table),
        relief(vessel),
        Own(vessel, OUTSIDE, area=1e-6),
        gx.Orifice(vessel, helium, area=1e-6),
    ]
    for other in others:
        run = run_of(vessel, other, dt=0.1)
        assert type(run.system.equations.scalar_unknowns[0].balance) is Balance


# ---- own items -----------------------------------------------------------------------------------


class LooseOpening:
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


class LooseWall:
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
        return lambda h: (400.0, lambda T: 1.0)


@pytest.mark.mpi(1)
@pytest.mark.parametrize(
    ("item", "base"),
    [(LooseOpening(tank(2e5), tank(1e5, "sink")), "Opening"), (LooseWall(tank(1e5)), "Wall")],
    ids=["opening", "wall"],
)
def test_an_own_item_without_its_base_class_is_refused_and_not_left_out(item, base):
    words = f"'{item.name}' .* is not derived from it.* derive it from gossamer_fx.extend.{base}"
    with pytest.raises(gx.InputError, match=words):
        run_of(item, dt=1e-2)


@pytest.mark.mpi
def test_an_own_volume_without_its_base_is_refused_where_it_is_alone(comm):
    """No network looks at it, as the scene has no gas."""

    class Bag:
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
