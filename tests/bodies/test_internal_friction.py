"""Friction within films: cycles of closed forms, energy, equilibria, and bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet

SOFT = {"E1": 1e6, "E2": 1e6, "nu12": 0.0, "G12": 5e5, "density": 1000.0, "thickness": 1e-3}
K = 4e3  # N/m
LIMIT = 20.0  # N/m
SLIDES_FROM = LIMIT / K


def patch(comm, direction=(1.0, 0.0, 0.0), **law) -> gx.Membrane:
    law = gx.LinearOrthotropic(**(SOFT | law), direction=direction)
    return gx.Membrane(sheet(comm, 2, 2, crossed=True), law, name="film")


def sheared(comm, course, until: float, dt: float, branches=((K,), (LIMIT,)), angle=0.0):
    """A square of one metre whose nodes are all moved in simple shear along an axis at an angle
    [rad] from x."""
    c, s = math.cos(angle), math.sin(angle)
    film = patch(comm, (c, s, 0.0))

    def motion(X, t):
        across = -s * X[0] + c * X[1]
        return np.stack([c * across, s * across, 0 * across]) * course(t)

    stiffness, limit = branches
    friction = gx.loads.InternalFriction(film, strain=(0, 0, 1), stiffness=stiffness, limit=limit)
    # A ball is free, so that the run has something to solve.
    held = gx.Fixed(film, "film", motion=motion)
    ball = gx.PointMass(1.0, (0.0, 0.0, 5.0), comm=comm)
    run = gx.Simulation(gx.Scene(held, friction, ball), gx.Midpoint(dt=dt))
    run.run(until=until)
    return run


@pytest.mark.mpi
@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_a_cycle_loses_the_area_of_its_loop(comm, angle) -> None:
    """4 s (A - s/k) an area, for any number of steps that meet the turning points."""
    A = 4 * SLIDES_FROM

    def course(t: float) -> float:
        """From zero to A, to -A and back, in straight lines of one second each quarter."""
        return A * float(np.interp(t, [0, 1, 3, 5], [0, 1, -1, 1]))

    for dt in (1.0, 0.25, 1 / 7):
        run = sheared(comm, course, 5.0, dt, angle=angle)
        first = LIMIT * (A - SLIDES_FROM)
        assert run.totals.dissipated == pytest.approx(
            first + 4 * LIMIT * (A - SLIDES_FROM), rel=1e-9
        )
        stored = run.totals.stored["internal friction"]
        assert stored == pytest.approx(LIMIT * SLIDES_FROM / 2, rel=1e-9)
        # The supports have done the work.
        assert abs(run.energy_error) < 1e-12


def test_branches_add_and_slide_one_after_the_other(comm) -> None:
    A = 2.5 * SLIDES_FROM
    branches = ((K, 2 * K, K / 2), (LIMIT, LIMIT, LIMIT))
    run = sheared(comm, lambda t: A * t, 1.0, 0.3, branches)
    φ = [LIMIT / k for k in branches[0]]
    assert run.totals.dissipated == pytest.approx(
        sum(LIMIT * max(A - each, 0.0) for each in φ), rel=1e-9
    )
    stored = sum(k * min(A, each) ** 2 / 2 for k, each in zip(branches[0], φ, strict=True))
    assert run.totals.stored["internal friction"] == pytest.approx(stored, rel=1e-9)


@pytest.mark.mpi
def test_a_film_that_flutters_loses_what_slides_and_no_more(comm) -> None:
    film = gx.Membrane(
        sheet(comm, 4, 4, crossed=True),
        gx.LinearOrthotropic(**SOFT, direction=(1.0, 1.0, 0.0)),
        velocity=lambda X: np.stack([3 * X[1], X[0] ** 2, np.sin(4 * X[0])]),
        name="film",
    )
    friction = gx.loads.InternalFriction(
        film, strain=(0.3, -0.7, 0.2), stiffness=(K, K / 3), limit=(5.0, 20.0)
    )
    run = gx.Simulation(gx.Scene(film, friction), gx.Midpoint(dt=1e-3))
    run.run(until=0.05)
    assert abs(run.energy_error) < 1e-10
    # A share of the energy that is above round-off by far
    assert run.totals.dissipated > 1e-2 * run.first.energy
    assert run.totals.momentum == pytest.approx(run.first.momentum, abs=1e-10)
    assert run.totals.angular_momentum == pytest.approx(run.first.angular_momentum, abs=1e-10)


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
def test_a_strip_that_is_loaded_and_unloaded_has_its_hysteresis(comm, order) -> None:
    """Pulled along its warp with N: N = K e + min(k e, s), and back N1 - N = K Δe + min(k Δe, 2 s),
    with the second Piola-Kirchhoff tension N/(1 + ε)."""
    stiffness = SOFT["E1"] * SOFT["thickness"]
    law = gx.LinearOrthotropic(**SOFT, direction=(1.0, 0.0, 0.0))
    film = gx.Membrane(sheet(comm, 2, 2, crossed=True), law, order=order, name="film")
    k, s = 500.0, 1.5
    friction = gx.loads.InternalFriction(film, strain=(1, 0, 0), stiffness=(k,), limit=(s,))
    held = [
        gx.Fixed(film, "left", components=(0, 2)),
        gx.Fixed(film, "bottom", components=(1,)),
    ]
    pull = gx.loads.EdgeLoad(film, "right", force=lambda t: (t, 0.0, 0.0))
    equilibrium = gx.Equilibrium(gx.Scene(film, friction, *held, pull))
    corner = film.port_at((1.0, 1.0, 0.0))
    turned = None
    for load in (1.0, 2.0, 4.0, 10.0, 8.0, 4.0, 0.0):
        equilibrium.find(at=load, progress=False)
        ε = gx.probes.Position(corner, "x")(equilibrium) - 1.0
        e = ε + ε**2 / 2
        tension = load / (1 + ε)
        if turned is None:
            assert tension == pytest.approx(stiffness * e + min(k * e, s), rel=1e-7)
            if load == 10.0:
                turned = e, tension
        else:
            back = turned[0] - e
            assert turned[1] - tension == pytest.approx(
                stiffness * back + min(k * back, 2 * s), rel=1e-7
            )
    # What slid one way, and the other
    slid = turned[0] - s / k + (turned[0] - e - 2 * s / k)
    assert turned[0] - e > 2 * s / k
    assert equilibrium.result.totals.dissipated == pytest.approx(s * slid, rel=1e-6)


def test_a_path_goes_on_from_what_has_slid(comm) -> None:
    """Up to 10 N/m and back: the stresses of the strip above."""
    stiffness = SOFT["E1"] * SOFT["thickness"]
    film = patch(comm)
    k, s = 500.0, 1.5
    friction = gx.loads.InternalFriction(film, strain=(1, 0, 0), stiffness=(k,), limit=(s,))
    held = [
        gx.Fixed(film, "left", components=(0,)),
        gx.Fixed(film, "bottom", components=(1,)),
        gx.Fixed(film, "film", components=(2,), name="plane"),
    ]
    pull = gx.loads.EdgeLoad(film, "right", force=lambda t: (10.0 * t, 0.0, 0.0))
    equilibrium = gx.Equilibrium(gx.Scene(film, friction, *held, pull))
    probes = {"x": gx.probes.Position(film.port_at((1.0, 1.0, 0.0)), "x")}
    strains = []
    for until in (1.0, 0.0):
        found = gx.analysis.path(
            equilibrium, until, start=1.0 - until, first_step=0.1, probes=probes
        )
        ε = found.columns["x"] - 1.0
        e = ε + ε**2 / 2
        tension = 10.0 * found.loads / (1 + ε)
        strains.append((e[-1], tension[-1]))
        if until:
            np.testing.assert_allclose(tension, stiffness * e + np.minimum(k * e, s), atol=1e-6)
        else:
            back = strains[0][0] - e
            expected = strains[0][1] - stiffness * back - np.minimum(k * back, 2 * s)
            np.testing.assert_allclose(tension, expected, atol=1e-6)
    assert strains[0][0] - strains[1][0] > 2 * s / k


@pytest.mark.mpi
@pytest.mark.parametrize(("relaxed", "stored"), [(False, 0.5 * LIMIT * SLIDES_FROM), (True, 0.0)])
def test_a_film_starts_slid_or_relaxed(comm, relaxed, stored) -> None:
    """It is given as sheared by four times the angle at which it slides."""
    film = gx.Membrane(
        sheet(comm, 2, 2, crossed=True),
        gx.LinearOrthotropic(**SOFT, direction=(1.0, 0.0, 0.0)),
        displacement=lambda X: np.stack([4 * SLIDES_FROM * X[1], 0 * X[0], 0 * X[0]]),
        name="film",
    )
    friction = gx.loads.InternalFriction(
        film, strain=(0, 0, 1), stiffness=(K,), limit=(LIMIT,), relaxed=relaxed
    )
    run = gx.Simulation(gx.Scene(film, friction), gx.Midpoint(dt=1e-4))
    assert run.first.stored["internal friction"] == pytest.approx(stored, abs=1e-15)
    run.run(until=1e-2)
    assert abs(run.energy_error) < 1e-11
    assert run.totals.dissipated > 0


def test_the_stress_of_the_friction_is_shown(comm) -> None:
    A = 3 * SLIDES_FROM
    run = sheared(comm, lambda t: A * t, 1.0, 0.5)
    largest = gx.analysis.largest_stress(run, run.scene.bodies[0], at="end")
    # The shear τ of law and friction is the larger principal Cauchy stress, but for a share γ.
    τ = (SOFT["G12"] * SOFT["thickness"] * A + LIMIT) / SOFT["thickness"]
    assert largest.stress == pytest.approx(τ, rel=2 * A)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"stiffness": (1.0, 2.0)}, "stiffness has 2 and limit has 1 entries"),
        ({"stiffness": (), "limit": ()}, r"stiffness is \(\)"),
        ({"strain": (0, 0, 0)}, r"strain is \(0, 0, 0\)"),
        ({"limit": (-1.0,)}, "limit"),
    ],
)
def test_wrong_numbers_are_refused(comm, changed, words) -> None:
    given = {"strain": (0, 0, 1), "stiffness": (K,), "limit": (LIMIT,)} | changed
    with pytest.raises(gx.InputError, match=words):
        gx.loads.InternalFriction(patch(comm), **given)


def test_other_bodies_and_steppers_are_refused(comm) -> None:
    isotropic = gx.Membrane(
        sheet(comm, 2, 2), gx.Linear(1e6, 0.3, density=1000.0, thickness=1e-3), name="isotropic"
    )
    numbers = {"strain": (0, 0, 1), "stiffness": (K,), "limit": (LIMIT,)}
    with pytest.raises(gx.InputError, match="'isotropic' has no direction"):
        gx.loads.InternalFriction(isotropic, **numbers)
    film = patch(comm)
    friction = gx.loads.InternalFriction(film, **numbers)
    with pytest.raises(gx.InputError, match="run its scene with Midpoint"):
        gx.Simulation(gx.Scene(friction), gx.steppers.VariationalMidpoint(dt=1e-3))
    run = gx.Simulation(gx.Scene(friction), gx.Midpoint(dt=1e-3))
    tape = gx.analysis.RunTape(run)
    run.run(until=2e-3)
    with pytest.raises(gx.InputError, match="depends on its history"):
        gx.analysis.gradient(tape, of=gx.analysis.Energy(), by=["film.initial_velocity"])


@pytest.mark.mpi
def test_a_run_that_starts_from_an_equilibrium_has_its_friction(comm) -> None:
    """Under the same load nothing moves, although the film would be shorter without friction."""
    law = gx.LinearOrthotropic(**SOFT, direction=(1.0, 0.0, 0.0))
    film = gx.Membrane(sheet(comm, 2, 2, crossed=True), law, name="film")
    friction = gx.loads.InternalFriction(film, strain=(1, 0, 0), stiffness=(500.0,), limit=(2.0,))
    held = [gx.Fixed(film, "left", components=(0, 2)), gx.Fixed(film, "bottom", components=(1,))]
    pull = gx.loads.EdgeLoad(film, "right", force=lambda t: (10.0 + t, 0.0, 0.0))
    equilibrium = gx.Equilibrium(gx.Scene(film, friction, *held, pull))
    equilibrium.find(at=5.0, progress=False)
    equilibrium.find(at=0.0, progress=False)
    steady = gx.loads.EdgeLoad(film, "right", force=(10.0, 0.0, 0.0))
    scene = gx.Scene(film, friction, *held, steady, gx.StartFrom(equilibrium.system))
    run = gx.Simulation(scene, gx.Midpoint(dt=1e-3))
    corner = gx.probes.Position(film.port_at((1.0, 1.0, 0.0)), "x")
    start = corner(run)
    run.run(until=0.01)
    assert corner(run) == pytest.approx(start, abs=1e-7)
    assert run.totals.kinetic < 1e-9 * run.totals.energy
