"""Ideal gas without a mesh, against exact solutions and converged integrations; γ = 1.4, R = 287
J/(kg K)."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from tests.rates import observed_order

AIR = gx.IdealGas(gamma=1.4, R=287.0)


def histories(scene: gx.Scene, dt: float, times) -> tuple[np.ndarray, gx.Simulation]:
    """(p, T, m) of every chamber at the given times, shape (times, chambers, 3), and the run."""
    run = gx.Simulation(scene, gx.Midpoint(dt=dt))
    found = []
    for t in times:
        run.run(until=t)
        found.append([(s.pressure, s.temperature, s.mass) for s in run.chambers.values()])
    return np.array(found), run


def closes(run: gx.Simulation) -> bool:
    """Whether mass is kept to 1e-12 and energy to 1e-12 of what there was at most."""
    return abs(run.mass_error) <= 1e-12 and abs(run.energy_error) <= 1e-12


# ---- filling a rigid tank from a reservoir: V = 0.01 m³, C_d A = 1e-6 m², 2e5 Pa, 300 K ----------

# State of the supply [Pa, K].
P0 = 2e5
T0 = 300.0


def filling(p: float, T: float) -> gx.Scene:
    tank = gx.Chamber(gas=AIR, pressure=p, temperature=T, volume=0.01)
    return gx.Scene(tank, gx.Orifice(gx.gas.Ambient(P0, T0, name="reservoir"), tank, area=1e-6))


# p, T at the start; time at which it is full, T then; p, T at other times
FILLING = {
    "from vacuum": (
        1e-3,
        300.0,
        45.0740921,
        420.0,
        {5: (28128.716, 420.0), 10: (56257.431, 420.0), 20: (112508.951, 420.0)},
    ),
    "choked first": (
        2e4,
        300.0,
        41.5190063,
        403.8462,
        {5: (48128.715, 360.1376), 10: (76257.430, 380.1222), 20: (132159.301, 396.0273)},
    ),
    "never choked": (
        1.5e5,
        280.0,
        18.0916724,
        305.4545,
        {5: (172539.752, 292.7477), 10: (189166.970, 300.7572)},
    ),
}


@pytest.mark.parametrize("case", FILLING)
def test_filling_of_a_tank(case):
    p, T, full, T_full, rows = FILLING[case]
    found, run = histories(filling(p, T), 0.25, [*rows, full, full + 15])
    # Tables come from integrations that are converged to all their digits; steps of 0.25 s give
    # 1e-3.
    assert found[:-2, 0, :2] == pytest.approx(np.array(list(rows.values())), rel=1e-3)
    assert found[-2:, 0, :2] == pytest.approx(np.array([(P0, T_full)] * 2), rel=1e-3)
    assert closes(run)


@pytest.mark.parametrize(
    "case, before", [("from vacuum", 35.0), ("choked first", 20.0), ("never choked", 10.0)]
)
def test_filling_is_of_second_order(case, before):
    p, T, *_ = FILLING[case]
    steps = [0.5, 0.125]
    *runs, exact = (histories(filling(p, T), dt, [before])[0][0, 0, 0] for dt in [*steps, 0.01])
    # The finest step has a third-order term of a few per cent.
    assert observed_order(steps, np.array(runs) - exact) == pytest.approx(2, abs=0.2)


@pytest.mark.parametrize("case", FILLING)
def test_temperature_of_a_filled_tank_is_that_of_the_enthalpy_it_got(case):
    """m T = m_i T_i + γ T0 (m - m_i), whatever the steps."""
    p, T, full, *_ = FILLING[case]
    m_start = p * 0.01 / (AIR.R * T)
    found, _ = histories(filling(p, T), 0.7, np.linspace(0, full, 6)[1:])
    _, T_now, m = found[:, 0].T
    # Energy balance of an adiabatic tank: enthalpy γ T0 per mass flows in.
    assert m * T_now == pytest.approx(m_start * T + 1.4 * T0 * (m - m_start), rel=1e-12)


# ---- choked blow-down into a vacuum: V = 0.01 m³, C_d A = 2e-6 m², 3e5 Pa, 300 K -----------------

# Time [s]: pressure [Pa] and temperature [K] of the choked isentropic blow-down.
BLOW_DOWN = {5: ((227693.391, 277.268810),), 20: ((105678.916, 222.666412),)}


def blow_down() -> gx.Scene:
    tank = gx.Tank(0.01, gas=AIR, pressure=3e5, temperature=300.0)
    return gx.Scene(gx.Orifice(tank, gx.gas.Ambient(), area=2e-6))


# ---- two tanks: V = 0.01 and 0.02 m³, C_d A = 3e-6 m², 4e5 and 2e4 Pa, 300 K ---------------------

# Time [s]: pressure [Pa] and temperature [K] of donor and taker; the last row is the equilibrium.
TWO_TANKS = {
    1: ((367816.067, 292.89562), (36091.966, 342.30774)),
    10: ((181109.906, 239.22242), (129445.047, 364.84503)),
    20: ((146666.667, 225.231), (146666.667, 359.705)),
}


def two_tanks() -> gx.Scene:
    donor = gx.Tank(0.01, gas=AIR, pressure=4e5, temperature=300.0, name="donor")
    taker = gx.Tank(0.02, gas=AIR, pressure=2e4, temperature=300.0, name="taker")
    return gx.Scene(gx.Orifice(donor, taker, area=3e-6))


@pytest.mark.parametrize(
    ("scene", "rows", "longest_step", "spread"),
    [(blow_down, BLOW_DOWN, 1.0, 0.1), (two_tanks, TWO_TANKS, 0.5, 0.15)],
)
def test_flow_from_a_tank_is_of_second_order(scene, rows, longest_step, spread):
    exact = np.array(list(rows.values()))
    steps = [longest_step, longest_step / 2, longest_step / 4]
    errors = []
    for dt in steps:
        found, run = histories(scene(), dt, rows)
        errors.append(found[:, : exact.shape[1], :2] / exact - 1)
        # The longest steps already reach 0.1 %.
        assert abs(errors[-1]).max() <= 1e-3
        assert closes(run)
    # While gas flows.
    for row in np.array(errors)[:, :2].reshape(3, -1).T:
        assert observed_order(steps, row) == pytest.approx(2, abs=spread)


# ---- a piston: A = 0.01 m², M = 0.5 kg, k = 2000 N/m, V = 1e-3 m³ + A x, filled from 1e5 Pa
# through 2e-5 m²

PISTON = {  # t: x [m], ẋ [m/s], p, T, m
    0.1: (0.097060879, 1.716119, 26993.99, 387.4909, 0.478326e-3),
    0.3: (0.215736480, -1.200114, 47828.29, 372.7092, 1.411750e-3),
    0.5: (0.309776650, -1.440735, 59387.76, 361.9984, 2.342371e-3),
    1.0: (0.412407327, 0.178257, 89454.83, 365.4398, 4.370402e-3),
}


def piston(dt: float, times, comm: MPI.Comm = MPI.COMM_SELF) -> tuple[np.ndarray, gx.Simulation]:
    mass = gx.PointMass(0.5, comm=comm)
    axis = (1.0, 0.0, 0.0)
    cylinder = gx.Chamber(
        gx.gas.Piston(mass.port(), 0.01, direction=axis),
        gas=AIR,
        pressure=1e3,
        temperature=300.0,
        dead_volume=1e-3,
    )
    inlet = gx.Orifice(gx.gas.Ambient(1e5, 300.0, name="reservoir"), cylinder, area=2e-5)
    run = gx.Simulation(
        gx.Scene(mass, gx.connectors.AxialSpring(mass.port(), 2000.0, direction=axis), inlet),
        gx.Midpoint(dt=dt),
    )
    found = []
    for t in times:
        run.run(until=t)
        state = run.chamber("chamber")
        x, v = (
            run.comm.allreduce(float(q.array_r[:1].sum()))
            for q in (run.system.unknowns.q0, run.system.unknowns.v0)
        )
        found.append((x, v, state.pressure, state.temperature, state.mass))
    return np.array(found), run


def test_piston():
    exact = np.array(list(PISTON.values()))
    found, run = piston(5e-4, PISTON)
    x, v, *gas = range(5)
    assert found[:, [x, *gas]] == pytest.approx(exact[:, [x, *gas]], rel=5e-3)
    assert found[:-1, v] == pytest.approx(exact[:-1, v], rel=0.02)
    assert found[-1, v] == pytest.approx(
        exact[-1, v], abs=0.02 * abs(exact[:, v]).max()
    )  # it turns round there
    assert abs(run.energy_error) <= 1e-8 and abs(run.mass_error) <= 1e-12


@pytest.mark.mpi
def test_piston_on_several_ranks_is_the_same(comm):
    (alone, _), (shared, _) = (piston(2e-3, [0.1], ranks) for ranks in (MPI.COMM_SELF, comm))
    # One mass and one gas: only the order of sums differs.
    assert shared == pytest.approx(alone, rel=1e-11)


@pytest.mark.mpi
def test_a_piston_in_air_swings_by_nanometres(comm):
    """Forces of 1 kN on both sides have a round-off that the motion must not be asked to beat."""
    outside = gx.gas.Ambient(1e5, 300.0)
    mass = gx.PointMass(2.0, velocity=(1e-6, 0.0, 0.0), comm=comm)
    cylinder = gx.Chamber(
        gx.gas.Piston(mass.port(), 0.01, direction=(1.0, 0.0, 0.0)),
        gas=AIR,
        pressure=1e5,
        temperature=300.0,
        dead_volume=1e-3,
        outside=outside,
    )
    run = gx.Simulation(gx.Scene(mass, cylinder), gx.Midpoint(dt=1e-3))
    run.run(until=0.05)
    frequency = (AIR.gamma * 1e5 * 0.01**2 / 1e-3 / 2.0) ** 0.5
    swung = gx.probes.Position(mass.port(), "x")(run)
    assert swung * frequency / 1e-6 == pytest.approx(np.sin(frequency * 0.05), abs=5e-3)
    assert abs(run.energy_error) <= 1e-12


def test_piston_is_of_second_order():
    steps = [2e-3, 5e-4]
    times = [0.3, 0.5]
    errors = [piston(dt, times)[0] - [PISTON[t] for t in times] for dt in steps]
    for quantity in range(4):  # the mass is exact while the inlet is choked
        for e in np.array(errors)[:, :, quantity].T:
            assert observed_order(steps, e) == pytest.approx(2, abs=0.2)


@pytest.mark.slow
def test_velocity_of_the_piston_where_it_turns():
    found, run = piston(1e-4, PISTON)
    # 2 %: the velocity passes through zero nearby.
    assert found[:, 1] == pytest.approx(np.array(list(PISTON.values()))[:, 1], rel=0.02)
    assert abs(run.energy_error) <= 1e-8
