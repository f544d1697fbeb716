"""Prescribed motions of obstacles are checked, and nothing gets past a film within one step."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from tests.contact.scenes import FILM, assert_conserved, film, simulate

# Gap [m] at which contact begins in these scenes.
DISTANCE = 1e-3


def fail(time):
    raise ZeroDivisionError("of the user")


WRONG_MOTIONS = {
    "returns nan": (lambda t: (0.0, 0.0, math.nan), r"it returns \(0.0, 0.0, nan\)"),
    "returns None": (lambda t: None, "it returns None"),
    "returns a word": (lambda t: "up", "it returns 'up'"),
    "returns words": (lambda t: ("0", "0", "0"), r"it returns \('0', '0', '0'\)"),
    "returns two numbers": (lambda t: (0.0, 0.0), r"it returns \(0.0, 0.0\)"),
    "returns one number": (lambda t: 0.0, "it returns 0.0"),
    "returns complex numbers": (
        lambda t: np.array([0, 0, 1e-6j]),
        r"it returns \[0j, 0j, 1e-06j\]",
    ),
    "raises": (fail, r"it raises ZeroDivisionError \(of the user\)"),
}


def with_moved_plane(comm, motion):
    floor = gx.contact.Plane(
        point=(0.0, 0.0, -0.01),
        normal=(0.0, 0.0, 1.0),
        motion=motion,
        name="floor",
    )
    return gx.Contact(film(comm), floor, distance=DISTANCE)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("wrong", WRONG_MOTIONS)
def test_a_motion_that_is_no_displacement_is_refused(comm, wrong):
    motion, words = WRONG_MOTIONS[wrong]
    contact = with_moved_plane(comm, motion)
    with pytest.raises(gx.InputError, match=f"^Motion of the obstacle 'floor' at t = 0 s: {words}"):
        gx.Simulation(gx.Scene(contact), gx.Midpoint(dt=1e-4))


@pytest.mark.mpi
def test_a_motion_that_fails_later_ends_the_run_before_its_step(comm):
    wrong = (0.0, 0.0, math.nan)
    contact = with_moved_plane(comm, lambda t: (0.0, 0.0, 0.0) if t < 2.5e-4 else wrong)
    run = gx.Simulation(gx.Scene(contact), gx.Midpoint(dt=1e-4))
    with pytest.raises(gx.InputError, match=r"at t = 0\.0003 s: it returns"):
        run.run(until=1e-3)
    # Two steps were fine; the third asks for the position at 0.3 ms.
    assert run.step == 2
    assert run.totals.supplied == 0.0


def moved_obstacle(kind, motion):
    """Return an obstacle a centimetre below the film, which moves as prescribed."""
    if kind == "plane":
        normal = (0.0, 0.0, 1.0)
        return gx.contact.Plane(point=(0.0, 0.0, -0.01), normal=normal, motion=motion)
    if kind == "box":
        sizes = (0.04, 0.04, 0.002)
        return gx.contact.Box(centre=(0.0, 0.0, -0.01), sizes=sizes, motion=motion)
    if kind == "sphere":
        return gx.contact.Sphere(centre=(0.01, 0.004, -0.01), radius=0.002, motion=motion)
    ends = {"start": (-0.1, 0.0, -0.01), "end": (0.1, 0.0, -0.01)}
    return gx.contact.Cylinder(**ends, radius=0.002, motion=motion)


@pytest.mark.parametrize("kind", ["plane", "box", "sphere", "cylinder"])
@pytest.mark.parametrize("length", [0.0095, 0.03], ids=["into the film", "past the film"])
def test_a_jump_between_two_steps_is_refused(kind, length):
    """However short the step, and without energy from nowhere."""
    obstacle = moved_obstacle(kind, lambda t: (0.0, 0.0, 0.0 if t <= 2e-4 else length))
    contact = gx.Contact(film(MPI.COMM_SELF), obstacle, distance=DISTANCE)
    run = gx.Simulation(gx.Scene(contact), gx.Midpoint(dt=1e-4))
    with pytest.raises(gx.StepFailure, match="the motion of the obstacle 'obstacle' jumps"):
        run.run(until=1e-3)
    assert run.time == pytest.approx(2e-4)
    # No energy from the jump.
    assert run.totals.energy == pytest.approx(0.0, abs=1e-20)


def test_a_plane_that_comes_and_goes_within_a_step_is_noticed():
    """The step is shortened until the way of the plane is known, and the film is hit."""
    period = 1e-2
    height = 0.02

    def motion(time):
        return 0.0, 0.0, height * math.sin(math.pi * time / period) ** 2

    contact = with_moved_plane(MPI.COMM_SELF, motion)
    run = simulate([contact], until=period, dt=period, halvings=12)
    film_height = run.system.unknowns.state[contact.bodies[0]].positions()[:, 2]
    # The film was pushed up by nearly the height of the plane.
    assert film_height.min() > height - 0.01
    # A free film that is hit gets the work as kinetic energy; the rest is strain.
    assert run.totals.kinetic == pytest.approx(run.totals.supplied, rel=0.05)
    # The plane is driven from outside: momentum is not conserved.
    assert_conserved(run, momentum=np.inf)


def test_a_thin_box_at_100_metres_per_second_does_not_pass_in_one_step():
    """A heavy wall that meets a free film at speed v sends it on at 2 v: W = m (2 v)²/2."""
    speed = 100.0
    step = 1e-3
    box = gx.contact.Box(
        centre=(0.0, 0.0, -speed * step / 2),
        sizes=(0.4, 0.4, 1e-3),
        motion=lambda t: (0.0, 0.0, speed * t),
    )
    sail = film(MPI.COMM_SELF)
    run = simulate([gx.Contact(sail, box, distance=DISTANCE)], until=step, dt=step, halvings=12)
    height = run.system.unknowns.state[sail].positions()[:, 2]
    assert height.min() > speed * step / 2
    # The film leaves the box in the steps after that of the impact.
    run.run(until=4 * step)
    # 0.14 kg/m² × 0.01 m².
    mass = 0.14 * 0.1**2
    # 10 %: the film does not leave the wall as a rigid body.
    assert run.totals.supplied == pytest.approx(mass * (2 * speed) ** 2 / 2, rel=0.1)


def turning_film(comm, spin):
    """Return a square film about the origin that turns about x with a spin [rad/s]."""
    return gx.Membrane(
        sheet(comm, 4, 4, 0.1, 0.1),
        gx.Miyazaki(**FILM, residual_stiffness=1e-6),
        name="turning",
        displacement=lambda X: np.vstack([0 * X[0] - 0.05, 0 * X[0] - 0.05, 0 * X[0]]),
        velocity=lambda X: np.vstack([0 * X[0], 0 * X[0], spin * (X[1] - 0.05)]),
    )


def in_the_way(kind, comm):
    """Return what a turning film hits."""
    if kind == "film":
        return film(comm, height=0.04, name="lid")
    if kind == "plane":
        return gx.contact.Plane(point=(0.0, 0.0, -0.03), normal=(0.0, 0.0, 1.0))
    if kind == "rod":
        ends = {"start": (-1.0, 0.03, 0.03), "end": (1.0, 0.03, 0.03)}
        return gx.contact.Cylinder(**ends, radius=0.002)
    return gx.contact.Box(centre=(0.0, 0.0, 0.0), sizes=(0.2, 0.12, 0.06), inside=True)


@pytest.mark.mpi(1)
@pytest.mark.parametrize("kind", ["film", "plane", "rod", "room"])
def test_a_film_that_turns_through_another_in_one_step_is_noticed(comm, kind):
    """By 136 degrees: on straight lines its edges pass below what they hit on their arcs."""
    turning = turning_film(comm, spin=1000.0)
    hit = in_the_way(kind, comm)
    contact = gx.Contact(turning, hit, distance=DISTANCE)
    run = simulate([contact], until=5e-3, dt=5e-3, halvings=10)
    assert run.substeps > 0
    if kind == "film":
        speed = np.abs(run.system.unknowns.state[hit].velocities()).max(initial=0.0)
        # The film that was hit moves at a good part of the 50 m/s of the turning edge.
        assert comm.allreduce(float(speed), MPI.MAX) > 10.0
    else:
        # Obstacles in space receive angular momentum, but no energy.
        change = run.totals.angular_momentum[0] - run.first.angular_momentum[0]
        limit = 0.1 * abs(run.first.angular_momentum[0])
        assert abs(change) > limit
    assert abs(run.energy_error) < 1e-9


def test_a_film_that_turns_far_from_others_keeps_its_long_steps():
    turning = turning_film(MPI.COMM_SELF, spin=1000.0)
    floor = gx.contact.Plane(point=(0.0, 0.0, -0.3), normal=(0.0, 0.0, 1.0))
    run = simulate([gx.Contact(turning, floor, distance=DISTANCE)], until=2e-3, dt=2e-3)
    assert run.substeps == 0


def test_an_obstacle_that_turns_through_a_film_with_its_body_is_noticed():
    """A ball on an arm hits the film at the lowest point of its circle, in the middle of a step."""
    arm = 0.1
    spin = 100.0
    sail = film(MPI.COMM_SELF)
    hub = gx.RigidBody(1.0, (1e-2, 1e-2, 1e-2), position=(0.0, 0.0, arm), spin=(spin, 0.0, 0.0))
    ball = gx.contact.Sphere(centre=(0.0, -arm, arm), radius=0.006, body=hub)
    # Half a turn in one step: start and end of the ball are both above the film.
    step = math.pi / spin
    run = simulate([gx.Contact(sail, ball, distance=DISTANCE)], until=step, dt=step, halvings=12)
    assert run.substeps > 0
    height = run.system.unknowns.state[sail].positions()[:, 2]
    # The ball has pushed the film down at the lowest point of its circle.
    assert height.min() < -1e-3
    assert abs(run.energy_error) < 1e-9


def test_a_step_that_turns_a_body_past_another_one_names_the_one_that_turns():
    arm = 0.1
    spin = 100.0
    sail = film(MPI.COMM_SELF)
    hub = gx.RigidBody(1.0, (1e-2, 1e-2, 1e-2), position=(0.0, 0.0, arm), spin=(spin, 0.0, 0.0))
    ball = gx.contact.Sphere(centre=(0.0, -arm, arm), radius=0.006, body=hub, name="ball")
    step = math.pi / spin
    with pytest.raises(gx.StepFailure, match=r"'ball' would turn by \d+° past 'film' in one step"):
        simulate([gx.Contact(sail, ball, distance=DISTANCE)], until=step, dt=step, halvings=0)


@pytest.mark.mpi
def test_a_tool_that_turns_and_moves_takes_a_film_along(comm):
    """A plate of a driven body lifts a film and turns by a quarter about the film's middle: the
    work is supplied, and the body is where the functions say."""

    def rise(t):
        return 0.5 * t * t

    body = gx.RigidBody(1.0, (1.0, 1.0, 1.0), position=(0.0, 0.0, -2e-3), comm=comm, name="tool")
    driven = gx.constraints.Driven(
        body,
        (0.0, 1.0, 0.0),
        angle=lambda t: 0.1 * t * t,
        displacement=lambda t: (0.0, 0.0, rise(t)),
    )
    plate = gx.contact.Box(centre=(0.0, 0.0, -0.012), sizes=(1.0, 1.0, 0.02), body=body)
    sheet_film = film(comm)
    contact = gx.Contact(sheet_film, plate, distance=DISTANCE)
    run = gx.Simulation(gx.Scene(sheet_film, contact, driven), gx.Midpoint(dt=5e-3))
    run.run(until=0.2)
    port = body.port()
    assert gx.probes.Position(port, "z")(run) == pytest.approx(-2e-3 + rise(0.2), abs=1e-15)
    turned = run.system.unknowns.state[body].coordinates()
    if len(turned):
        assert turned[0, 1] == pytest.approx([math.cos(4e-3), 0, -math.sin(4e-3)], abs=1e-12)
    heights = comm.allgather(run.system.unknowns.state[sheet_film].positions()[:, 2].min(initial=1))
    assert min(heights) > rise(0.2) - 5e-3
    assert gx.probes.Penetrations(contact)(run) == 0
    assert abs(run.energy_error) < 1e-10
