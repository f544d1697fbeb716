"""Scenes in orbit: Kepler's motion, conservation, tides, perturbations, and strains without
round-off of 7000 km."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.orbit import libration
from gossamer_fx.mechanics.orbit.elements import Elements, elements_of
from gossamer_fx.mechanics.orbit.harmonics import EARTH_J2, EARTH_MU, EARTH_RADIUS
from gossamer_fx.mechanics.orbit.orbit import Orbit
from gossamer_fx.mechanics.orbit.relative_gravity import equivalent_points
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import run_until

# Semi-major axis [m] of a low orbit, its rate [rad/s] and period [s].
A = 7e6
RATE = math.sqrt(EARTH_MU / A**3)
PERIOD = 2 * math.pi / RATE


def state(
    run: gx.Simulation, orbit: Orbit, body: gx.RigidBody | gx.PointMass
) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity of a body, seen from the Earth's centre."""
    origin = orbit.flight(run.system.unknowns).origin
    port = body.port()
    x = run.system.unknowns.state.vector(port)
    v = run.system.unknowns.state.rate(port)
    return origin.R0 + x, origin.V0 + v


def dumbbell(
    tilt: float, spin: float = RATE, length: float = 20.0
) -> tuple[gx.PointMass, gx.PointMass, gx.connectors.Spring]:
    """Two masses of 10 kg on a spring of 1e5 N/m."""
    arm = length / 2 * np.array([math.cos(tilt), math.sin(tilt), 0.0])
    v = np.cross([0, 0, spin], arm)
    a, b = (
        gx.PointMass(10.0, tuple(s * arm), velocity=tuple(s * v), name=n)
        for s, n in ((-1, "a"), (1, "b"))
    )
    return (a, b, gx.connectors.Spring(a.port(), b.port(), stiffness=1e5, length=length))


@pytest.mark.mpi
def test_a_lone_mass_at_the_origin_has_no_energy_to_lose(comm) -> None:
    """What 40 digits of the origin leave is not the largest energy of the run."""
    mass = gx.PointMass(1.0, comm=comm)
    run = run_until(100.0, mass, Orbit(Elements(A, 0.01)), dt=10.0)
    assert run.energy_error == 0.0


def test_rigid_body_flies_by_keplers_laws_in_second_order() -> None:
    start = Elements(8e6, 0.1, i=0.9, node=1.0, perigee=2.0, anomaly=0.5)
    exact = start.after(1200.0).state()[0]
    errors = []
    for steps in (10, 20, 40):
        orbit = Orbit(start)
        body = gx.RigidBody(20.0, (1.0, 2.0, 2.5), spin=(0.01, 0.02, 0.0))
        run = run_until(1200.0, body, orbit, dt=1200.0 / steps)
        errors.append(np.linalg.norm(state(run, orbit, body)[0] - exact))
        assert abs(run.energy_error) < 1e-10
        assert drift(run) < 1e-13
    # Order between each two halvings.
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 2) < 0.02)


def drift(run: gx.Simulation) -> float:
    """Relative change of the angular momentum of the whole."""
    first = run.first.angular_momentum
    now = run.totals.angular_momentum
    return float(np.linalg.norm(now - first) / np.linalg.norm(first))


def test_dumbbell_hangs_on_its_spring_by_the_tide() -> None:
    orbit = Orbit(Elements(A))
    a, b, spring = dumbbell(0.0)
    run = gx.Simulation(gx.Scene(a, b, spring, orbit), gx.Midpoint(dt=20.0))
    stretch = []
    for _ in range(10):
        run.run(until=run.time + 20.0)
        x = run.system.unknowns.state.vectors([a.port(), b.port()])
        stretch.append(np.linalg.norm(x[1] - x[0]) - 20.0)
    # undamped, it swings between 0 and twice the tide's 3 n² m L/(2 k)
    tide = 3 * RATE**2 * 10 * 10 / 1e5
    assert 0 < min(stretch) < max(stretch) < 2.01 * tide
    assert abs(run.energy_error) < 1e-8  # of 1 mJ in the frame: 1e-20 of the orbit's energy
    assert drift(run) < 1e-14


@pytest.mark.parametrize("tilt", [1e-3, math.radians(40)])
def test_libration_of_a_dumbbell(tilt: float) -> None:
    """Time of a quarter of a swing in the plane: that of a pendulum 3/2 n² sin 2θ, an elliptic
    integral."""
    _, ratio = libration(MPI.COMM_SELF, tilt, h=15.0)
    # The midpoint rule with 15 s: 0.2 % of the period of libration.
    assert ratio == pytest.approx(1.0, rel=2e-3)


def test_points_have_the_moments_of_a_body() -> None:
    mass = np.array(
        [[5.0, 1.0, 0.5, 0], [1.0, 3.0, 0.2, 0.1], [0.5, 0.2, 2.0, 0], [0, 0.1, 0, 1.0]]
    )
    points, weights = equivalent_points(mass, np.array([1.0, 0, 0, 0]))
    # The point masses have the same zeroth, first and second moments.
    assert np.allclose(
        np.einsum("p,pi,pj->ij", weights, points, points), mass, rtol=1e-13, atol=1e-14
    )
    assert np.allclose(points[:, 0], 1)
    bar = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6
    points, weights = equivalent_points(bar, np.ones(2))
    assert np.allclose(np.einsum("p,pi,pj->ij", weights, points, points), bar)
    assert np.allclose(points.sum(axis=1), 1)
    single, _ = equivalent_points(np.array([[3.0]]), np.ones(1))
    assert single.shape == (1, 1)


def film(order: int = 1) -> gx.Membrane:
    return gx.Membrane(
        sheet(MPI.COMM_WORLD, 4, 4),
        gx.Miyazaki(E=2.5e9, nu=0.3, density=1400.0, thickness=7.5e-6),
        order=order,
        displacement=lambda X: 1e-3 * np.array([X[0], X[1], 0 * X[0]]),
        velocity=lambda X: np.array([-X[1], X[0], 0 * X[0]]),
    )


@pytest.mark.mpi(1)
@pytest.mark.parametrize("order", [1, 2])
def test_strains_are_not_spoilt_by_seven_thousand_kilometres(order: int) -> None:
    """In 20 ms the tide does nothing; the film moves as if it were not in orbit."""
    positions = []
    stored = []
    for parts in ((), (Orbit(Elements(A, 0.01, i=1.0)),)):
        run = run_until(0.02, film(order), *parts, dt=1e-3)
        positions.append(run.system.unknowns.q0.array_r.reshape(-1, 3).copy())
        stored.append(run.totals.stored["film"])
    moved = positions[1] - positions[0]
    moved -= run.comm.bcast(moved[0])  # the origin goes to the centre of mass
    # 1 nm: round-off of 7000 km would be 1 nm in each position.
    assert np.abs(moved).max() < 1e-9
    assert stored[1] == pytest.approx(stored[0], rel=1e-9)
    assert abs(run.energy_error) < 1e-10


def test_flexible_body_keeps_energy_and_angular_momentum_of_the_whole() -> None:
    # The perigee is within the Earth.
    orbit = Orbit(Elements(A, 0.2, i=1.0), radius=5e6)
    hub = gx.RigidBody(1.0, (0.1, 0.1, 0.1), position=(0.0, 0.0, 0.5), velocity=(0.02, 0, 0))
    sail = film()
    strings = [
        gx.connectors.Rope(hub.port(), sail.port(corner), stiffness=50.0, length=0.5, name=corner)
        for corner in ("bottom left", "top right")
    ]
    stepper = gx.Midpoint(dt=5e-3, tolerances=gx.Tolerances(relative=1e-13))
    run = gx.Simulation(gx.Scene(sail, hub, orbit, *strings), stepper)
    run.run(until=0.2)
    assert abs(run.energy_error) < 1e-9
    # All forces are internal or act between body and Earth.
    assert drift(run) < 1e-13


def test_oblateness_turns_the_node_and_the_perigee() -> None:
    """Secular rates by J2 against the formulas of first order, over one revolution of an orbit of e
    = 0.05."""
    a = 8e6
    e = 0.05
    i = 0.6
    start = Elements(a, e, i=i, node=1.0, perigee=0.7, anomaly=0.0)
    n = math.sqrt(EARTH_MU / a**3)
    p = a * (1 - e**2)
    rate = 1.5 * n * EARTH_J2 * (EARTH_RADIUS / p) ** 2
    orbit = Orbit(start, gravity="J2")
    body = gx.PointMass(10.0)
    run = run_until(2 * math.pi / n, body, orbit, dt=20.0)
    end = elements_of(*state(run, orbit, body))
    # 1 %: the formula is the first order of J2.
    assert (end.node - 1.0) / run.time == pytest.approx(-rate * math.cos(i), rel=0.01)
    assert abs(run.energy_error) < 1e-9


def test_all_attractions_are_work_supplied() -> None:
    pytest.importorskip("erfa")
    orbit = Orbit(
        Elements(A, 0.01, i=1.0),
        gravity=8,
        epoch="2026-03-01",
        third_bodies=("sun", "moon"),
    )
    run = run_until(300.0, *dumbbell(0.5), orbit, dt=30.0)
    assert abs(run.totals.supplied) > 1e3  # J, for 20 kg
    assert abs(run.energy_error) < 1e-10


def test_another_time_of_return_is_the_same_motion() -> None:
    ends = []
    for following in (200.0, 5000.0):
        orbit = Orbit(Elements(A, 0.01, i=1.0), gravity="J2", following=following)
        body = gx.PointMass(10.0, (40.0, 30.0, 20.0), velocity=(0.1, 0.0, 0.2))
        run = run_until(600.0, body, orbit, dt=10.0)
        ends.append(np.array(state(run, orbit, body)))
    error = np.abs(ends[1][0] - ends[0][0]).max()
    # Another choice of the moving origin changes only what is neglected.
    assert error < 1e-4  # m: terms of second order in |x|/|R|
    error = np.abs(ends[1][1] - ends[0][1]).max()
    assert error < 1e-6


def test_what_cannot_fly_is_refused() -> None:
    for wrong in (
        {"gravity": "point mass"},
        {"gravity": 4},
        {"gravity": 40, "epoch": "2026-01-01"},
        {"third_bodies": ("jupiter",)},
        {"third_bodies": ("moon",)},
        {"shadow": "sphere"},
    ):
        with pytest.raises(gx.InputError):
            Orbit(Elements(A), **wrong)
    with pytest.raises(gx.InputError, match="start"):
        Orbit(((7e6, 0, 0),))
    for start in (Elements(7e6, 0.2), ((6e6, 0.0, 0.0), (0.0, 7e3, 0.0))):
        with pytest.raises(gx.InputError, match=r"radius of 6.37814e\+06 m; give another"):
            Orbit(start)
    body = gx.PointMass(1.0)
    with pytest.raises(gx.InputError, match="Midpoint"):
        gx.Simulation(gx.Scene(body, Orbit(Elements(A))), gx.GeneralizedAlpha(dt=1.0))
    with pytest.raises(gx.InputError, match="not in the scene"):
        Orbit(Elements(A)).flight(
            gx.Simulation(gx.Scene(body), gx.Midpoint(dt=1.0)).system.unknowns
        )


@pytest.mark.mpi
@pytest.mark.parametrize("name", ["sun", "moment"])
def test_functions_of_the_user_are_the_same_on_all_ranks(comm, name: str) -> None:
    """On one rank one that is not finite."""

    def given(t: float) -> tuple[float, float, float]:
        return (1.0, 0.0, float(comm.rank) if comm.size > 1 else math.nan)

    functions = {"sun": (1.0, 0.0, 0.0), "moment": (1.0, 0.0, 0.0), name: given}
    hub = gx.RigidBody(1.0, (1.0, 1.0, 1.0), name="hub", comm=comm)
    orbit = Orbit(Elements(A), epoch="2026-01-01", sun=functions["sun"])
    magnet = gx.orbit.MagneticDipole(hub.frame(), orbit, moment=functions["moment"])
    with pytest.raises(gx.InputError, match=f"its {name} at t = 0.5 s"):
        gx.Simulation(gx.Scene(hub, orbit, magnet), gx.Midpoint(dt=1.0)).run(until=1.0)


@pytest.mark.slow
def test_a_stiffer_body_moves_as_the_rigid_one() -> None:
    # The error falls by the factor of the stiffness, 4.
    """A dumbbell on springs of 1, 4, 16 N/m against two masses on a bar: the angle errs by
    1/stiffness."""
    tilt = 0.5
    until = 600.0
    h = 1.0
    arm = np.array([math.cos(tilt), math.sin(tilt), 0.0])

    def angle(*parts: object, along: tuple[object, ...]) -> float:
        run = run_until(until, *parts, Orbit(Elements(A)), dt=h)
        x = run.system.unknowns.state.vectors(along)
        d = x[-1] - x[0] if len(along) == 2 else x[0]
        return math.atan2(d[1], d[0])

    across = np.array([-arm[1], arm[0], 0.0])
    attitude = np.column_stack([arm, across, (0.0, 0.0, 1.0)])
    bar = gx.RigidBody(20.0, (1e-6, 2000.0, 2000.0), attitude=attitude, spin=(0, 0, RATE))
    rigid = angle(bar, along=(bar.frame().directors[0],))
    errors = []
    for stiffness in (1.0, 4.0, 16.0):
        a, b, _ = dumbbell(tilt)
        spring = gx.connectors.Spring(a.port(), b.port(), stiffness=stiffness, length=20.0)
        errors.append(abs(angle(a, b, spring, along=(a.port(), b.port())) - rigid))
    orders = np.log(np.array(errors[:-1]) / errors[1:]) / math.log(4)
    # A tenth: the softest spring has a visible second-order term.
    assert np.all(np.abs(orders - 1) < 0.1), (errors, orders)


@pytest.mark.parametrize("hold", ["film", "mass"])
def test_nothing_is_held_in_flight(hold: str) -> None:
    film = gx.Membrane(
        sheet(MPI.COMM_WORLD, 2, 2),
        gx.Linear(E=1e9, nu=0.3, density=1e3, thickness=1e-5),
    )
    mass = gx.PointMass(1.0)
    holder = (
        gx.Fixed(film, "left")
        if hold == "film"
        else gx.connectors.Spring(
            gx.Ground((1.0, 0.0, 0.0)),
            mass.port(),
            stiffness=1.0,
            length=1.0,
        )
    )
    with pytest.raises(gx.InputError, match="nothing to hold on to"):
        gx.Scene(film, mass, holder, Orbit(Elements(A, 0.0))).compile()


def test_a_field_without_a_middle_of_the_step_is_refused(monkeypatch) -> None:
    """A force that reverses whenever it is asked for moves the end of the step to and fro for
    ever."""
    directions = itertools.cycle([1.0, -1.0])
    monkeypatch.setattr(Orbit, "field", lambda orbit, r, t: np.array([next(directions), 0.0, 0.0]))
    orbit = Orbit(Elements(A), gravity="J2")
    # A run tries its first step when it is made.
    with pytest.raises(gx.InputError, match="make the stepper's dt smaller"):
        gx.Simulation(gx.Scene(gx.PointMass(1.0), orbit), gx.Midpoint(dt=10.0))
