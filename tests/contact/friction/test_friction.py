"""Friction of contact: closed forms of sliding, stopping and sticking; conservation; rolling of a
ball."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import EDGES as EDGES_OF_SHEET
from gossamer_fx.meshes.sheet import sheet
from tests.contact.scenes import (
    FILM,
    SIGMA,
    assert_conserved,
    contact_set_of,
    count_intersections,
    film,
    obstacle_of,
    simulate,
    two_films,
)

OTHERS = ("plane", "ball", "cylinder", "box", "cone", "in ball", "in box", "in cone")
FLOOR = {"point": (0.0, 0.0, 0.0), "normal": (0.0, 0.0, 1.0)}


# Two triangles, which stay flat and slide as one piece.
def patch(velocity: float, height: float = 2e-5, order: int = 1):
    start = (velocity, 0.0, 0.0)
    return film(MPI.COMM_SELF, 1, velocity=start, height=height, order=order, name="patch")


def speeds(body, items, until: float, dt: float = 5e-4):
    """Velocities along x after each step, and the run."""
    seen = gx.Series({"v": gx.probes.Velocity(body.port_at((0.05, 0.05, 0.0)), "x")})
    run = simulate(items, until, dt, outputs=[seen])
    return np.array(seen["v"]), run


def pressed(body, p: float, ramp: float = 0.01) -> gx.Pressure:
    """A pressure [Pa] that presses the body down, and begins softly."""

    def at(t: float) -> float:
        y = min(t / ramp, 1.0)
        return -p * y * y * (3 - 2 * y)

    return gx.Pressure(body, at)


@pytest.mark.parametrize("order", [1, 2])
def test_a_film_slides_down_a_slope(order) -> None:
    slope = math.radians(30)
    μ = 0.3
    g = 9.80665
    body = patch(0.0, 1e-4, order)
    down = gx.Gravity(body, (g * math.sin(slope), 0.0, -g * math.cos(slope)))
    floor = gx.contact.Plane(**FLOOR, friction=μ)
    v, run = speeds(body, [gx.Contact(body, floor, distance=2e-4, stiffness=1e9), down], 0.03)
    a = g * (math.sin(slope) - μ * math.cos(slope))
    assert v[-1] == pytest.approx(a * 0.03, rel=0.02)  # though it jumps
    travelled = 5e-4 * (v[1:] + v[:-1]).sum() / 2
    lost = μ * SIGMA * 0.01 * g * math.cos(slope) * travelled
    assert run.totals.dissipated == pytest.approx(lost, rel=0.05)
    assert abs(run.energy_error) < 1e-9


def test_a_film_that_slides_is_stopped() -> None:
    body = patch(0.2)
    μ = 0.5
    p = 4.0
    v0 = 0.2
    contact = gx.Contact(body, gx.contact.Plane(**FLOOR), distance=2e-4, stiffness=1e8, friction=μ)
    v, run = speeds(body, [contact, pressed(body, p)], 0.03)
    # Until the pressure is full it acts with its mean, half of it, for 0.01 s: as much as 5 ms
    # later in full.
    until = 0.005 + v0 / (μ * p / SIGMA)  # the pressure begins in 0.01 s
    t = 5e-4 * np.arange(len(v))
    at_full = (t > 0.012) & (t < until - 1e-3)
    # 2 mm/s: the law is smoothed near zero slip, and the patch still vibrates.
    assert np.allclose(v[at_full], (until - t[at_full]) * μ * p / SIGMA, atol=2e-3)
    # Stopped, except for the creep that the law states.
    error = abs(v[t > until + 5e-3]).max()
    assert error < 1e-5
    # All kinetic energy of the patch, ½ σ A v0², is lost by friction.
    assert run.totals.losses == {"contact": pytest.approx(0.5 * SIGMA * 0.01 * v0**2, rel=1e-6)}


@pytest.mark.slow
def test_below_the_friction_angle_it_creeps_as_slowly_as_stated() -> None:
    body = patch(0.0)
    μ = 0.5
    p = 4.0
    a = 8.0
    contact = gx.Contact(
        body,
        gx.contact.Plane(**FLOOR),
        distance=2e-4,
        stiffness=1e8,
        friction=μ,
        slip_velocity=1e-4,
    )
    v, _ = speeds(body, [contact, pressed(body, p), gx.Gravity(body, (a, 0.0, 0.0))], 0.04)
    share = a * SIGMA / (μ * p)
    v = (v[1:] + v[:-1])[-30:] / 2  # of steps: their ends swing about it for a while
    # The law is 1 - (1 - v/v_s)², solved for the speed v at which it carries the share.
    # 5 %: mean of the last thirty steps.
    assert v.mean() == pytest.approx(1e-4 * (1 - math.sqrt(1 - share)), rel=0.05)


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, 2])
def test_films_that_rub_keep_momentum_and_angular_momentum(comm, order) -> None:
    options = {"order": order, "n": 6 - 2 * order}
    lower, upper = two_films(comm, height=1.2e-3, velocity=(1.0, 0.4, -2.0), **options)
    run = simulate([gx.Contact(lower, upper, distance=1e-3, friction=0.3)], 1.6e-3)
    # It must have rubbed.
    assert run.totals.dissipated > 1e-5
    measured = gx.probes.Velocity(lower.port_at((0.05, 0.05, 0.0)), "x")(run)
    assert measured > 0.02  # taken along
    assert count_intersections(run) == 0
    assert_conserved(run)


def test_friction_costs_nothing_where_there_is_none() -> None:
    one = film(MPI.COMM_SELF, name="one")
    other = film(MPI.COMM_SELF, height=1.2e-3, name="other")
    run = simulate(
        [
            gx.Contact(
                one,
                other,
                gx.contact.Plane(point=(0, 0, -1), normal=(0, 0, 1)),
                distance=1e-3,
            )
        ],
        1e-4,
    )
    assert contact_set_of(run).friction is None
    assert (contact_set_of(run).mesh.frames < 0).all()


@pytest.mark.parametrize(
    "kind", ["in cylinder", *(pytest.param(kind, marks=pytest.mark.slow) for kind in OTHERS)]
)
def test_films_rub_on_solids_of_a_free_body(kind) -> None:
    thrown = film(MPI.COMM_SELF, velocity=(0.6, 0.3, -2.0), name="thrown")
    block = gx.RigidBody(0.02, (1e-5, 1e-5, 1e-5), position=(0.0, 0.0, -0.022), comm=MPI.COMM_SELF)
    run = simulate(
        [gx.Contact(thrown, obstacle_of(kind, block, friction=0.4), distance=1e-3)],
        4e-3,
    )
    assert run.totals.dissipated > 1e-5
    assert_conserved(run)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("μ", [0.0, 0.5])
def test_a_ball_on_a_film_turns_by_friction_alone(comm, μ) -> None:
    """It is thrown along a free film and presses on it: what it loses along the film, it gains as
    rotation."""
    m = 1e-3
    r = 0.01
    bag = film(comm, name="bag")
    ball = gx.RigidBody(
        m,
        (0.4 * m * r * r,) * 3,
        position=(0.003, 0.002, r + 3e-4),
        velocity=(0.3, 0, -0.5),
        comm=comm,
    )
    solid = gx.contact.Sphere(
        centre=(0.003, 0.002, r + 3e-4),
        radius=r,
        # The rotation of the ball is in its directors, whose constraint adds round-off.
        body=ball,
        friction=μ,
    )
    run = simulate([gx.Contact(bag, solid, distance=2e-4)], 4e-3)
    assert_conserved(run, momentum=1e-10)
    spin = _spin(run, ball)
    if μ == 0:
        assert abs(spin) < 1e-9
        assert run.totals.losses == {}
    else:
        lost = m * (0.3 - gx.probes.Velocity(ball.port(), "x")(run))
        assert lost > 1e-6
        measured = spin * 0.4 * m * r * r
        # 10 %: the film, too, turns a little under the ball.
        assert measured == pytest.approx(lost * r, rel=0.1)
        assert run.totals.dissipated > 0


def _spin(run, ball) -> float:
    """Angular velocity about y."""
    owned = run.system.unknowns.state[ball].owned
    d, rate = (
        z.array_r[owned].reshape(-1, 4, 3)[:, 1:]
        for z in (run.system.unknowns.q0, run.system.unknowns.v0)
    )
    return run.comm.allreduce(float(np.cross(d, rate)[..., 1].sum() / 2))


def test_a_film_between_a_rough_floor_and_a_rough_film() -> None:
    lower, upper = two_films(MPI.COMM_SELF, height=1.2e-3, velocity=(1.0, 0.4, -2.0), n=3)
    floor = gx.contact.Plane(point=(0, 0, -1e-3), normal=(0, 0, 1), friction=0.5)
    run = simulate([gx.Contact(lower, upper, floor, distance=8e-4, friction=0.3)], 1e-3)
    # A few rejected steps are allowed where three surfaces rub at once.
    assert run.substeps < 10
    assert abs(run.energy_error) < 1e-9


def test_a_moved_solid_drags_a_film_along_and_pays_for_it() -> None:
    body = patch(0.0)
    belt = gx.contact.Plane(**FLOOR, motion=lambda t: (0.1 * t, 0.0, 0.0), friction=0.4)
    contact = gx.Contact(body, belt, distance=2e-4, stiffness=1e8)
    v, run = speeds(body, [contact, pressed(body, 4.0)], 0.03)
    assert v[-1] == pytest.approx(0.1, abs=1e-4)
    # what the belt gives is twice what the film has in the end: the other half is lost
    kinetic = 0.5 * SIGMA * 0.01 * 0.1**2
    assert run.totals.dissipated == pytest.approx(kinetic, rel=1e-2)
    assert abs(run.energy_error) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("μ", [0.0, 0.5])
def test_a_ball_rolls_in_a_bag_if_there_is_friction(μ) -> None:
    m = 5e-3
    r = 0.02
    size = 0.2
    start = (0.03, 0.01, 0.012)

    def sagging(X):
        deep = 0.02 * np.sin(np.pi * X[0] / size) * np.sin(np.pi * X[1] / size)
        return np.vstack([X[0] - size / 2, X[1] - size / 2, -deep]) - X

    law = gx.Miyazaki(**FILM | {"E": 2e6}, residual_stiffness=1e-3)
    bag = gx.Membrane(sheet(MPI.COMM_SELF, 8, 8, size, size), law, displacement=sagging, name="bag")
    rim = [gx.Fixed(bag, side) for side in EDGES_OF_SHEET]
    ball = gx.RigidBody(
        m,
        (0.4 * m * r * r,) * 3,
        position=start,
        velocity=(0, 0.4, 0),
        comm=MPI.COMM_SELF,
        name="ball",
    )
    contact = gx.Contact(
        bag,
        gx.contact.Sphere(centre=start, radius=r, body=ball, friction=μ),
        distance=1e-3,
    )
    run = simulate([contact, *rim, gx.Gravity(bag), gx.Gravity(ball)], 0.25, 1e-3)
    assert abs(run.energy_error) < 1e-9
    assert count_intersections(run) == 0
    state = (
        z.array_r[run.system.unknowns.state[ball].owned]
        for z in (run.system.unknowns.q0, run.system.unknowns.v0)
    )
    (_, *d), (v, *rates) = (z.reshape(4, 3) for z in state)
    ω = np.cross(d, rates).sum(axis=0) / 2
    slip = (v + np.cross(ω, [0, 0, -r]))[:2]
    if μ == 0:
        assert not run.totals.dissipated
        assert np.abs(ω).max() < 1e-9
    else:
        assert run.totals.dissipated > 1e-4
        error = np.linalg.norm(slip)
        # The ball rolls: its slip is below a fifth of its speed.
        limit = 0.2 * np.linalg.norm(v[:2])
        assert error < limit
