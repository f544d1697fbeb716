"""Invalid joints are refused with one sentence; closed loops are solved if their constraints are
not redundant."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import run_until

COMM = MPI.COMM_WORLD
LAW = gx.Linear(E=1e6, nu=0.3, density=1000.0, thickness=1e-3)
SECTION = gx.sections.solid_circle(0.02, E=1e8, nu=0.3, density=1000.0)


def body(
    name: str = "body", position: tuple[float, float, float] = (0.0, 0.0, 0.0), **more
) -> gx.RigidBody:
    return gx.RigidBody(1.0, (1.0, 1.0, 1.0), position=position, name=name, **more)


def film() -> gx.Membrane:
    return gx.Membrane(sheet(COMM, 2, 2), LAW)


def beams() -> tuple[gx.Beam, gx.Beam]:
    one = gx.Beam(line(COMM, [(0, 0, 0), (1, 0, 0)], 2), SECTION, name="one")
    two = gx.Beam(line(COMM, [(0, 0, 0), (0, 1, 0)], 2), SECTION, name="two")
    return one, two


def clamped_twice() -> gx.Scene:
    one, two = (beam.frame("start") for beam in beams())
    return gx.Scene(
        gx.constraints.FixedJoint(one, two, name="clamp"),
        gx.constraints.FixedJoint(one, two, name="again"),
    )


def scene_of(joint) -> gx.Scene:
    scene = gx.Scene(joint)
    scene.compile()
    return scene


REFUSED = [
    (
        lambda: scene_of(
            gx.constraints.BallJoint(body().port((0, 0, 1)), film().port_at((0, 0, 0)))
        ),
        "1 m apart",
    ),
    (lambda: film().port_at((0.5, 0.5, 0.1)), "is 0.1 m away from 'film'"),
    # A film of 1 m in the plane z = 0; the point is 0.1 m above it.
    (lambda: film().port("nowhere"), "no group 'nowhere'"),
    (lambda: film().port("left"), "has 3 nodes; a port is one point"),
    (lambda: gx.PointMass(0.0), "mass is 0.0 kg"),
    (lambda: gx.RigidBody(0.0, (1, 1, 1)), "mass is 0.0 kg"),
    (lambda: gx.RigidBody(1.0, (0, 1, 1)), "inertia is singular"),
    (
        lambda: gx.RigidBody(1e-3, [[1e-9, 5e-10, 0], [0, 1e-9, 0], [0, 0, 1e-9]]),
        "give three numbers or a symmetric",
    ),
    # Principal moments obey the triangle inequality: 3 > 1 + 1 is impossible.
    (lambda: gx.RigidBody(1.0, (1, 1, 3)), "no body has"),
    (lambda: gx.RigidBody(1.0, (1, 1, 1), attitude=2 * np.eye(3)), "not a rotation matrix"),
    (
        lambda: gx.constraints.BallJoint(gx.Ground((0, 0, 0)), gx.Ground((0, 0, 0))),
        "joins the ground to itself",
    ),
    (
        lambda: scene_of(gx.constraints.FixedJoint(*(b.frame("end") for b in beams()))),
        r"1\.41421 m apart",
    ),
    (
        lambda: gx.constraints.FixedJoint(*map(beams()[0].frame, ("start", "end"))),
        "joins 'one' to itself",
    ),
    (lambda: clamped_twice().compile(), r"6 of the constraints 'again.* follow from the others"),
    (
        lambda: gx.constraints.RevoluteJoint(body().frame(), gx.ground_frame(), axis=(0, 0, 0)),
        r"axis is \(0, 0, 0\)",
    ),
    (
        lambda: scene_of(
            gx.constraints.BallJoint(body("a", velocity=(1, 0, 0)).port(), body("b").port())
        ),
        "separate with 1 per second",
    ),
    (lambda: scene_of(gx.constraints.Link(body("a").port(), body("b").port())), "has no length"),
    (
        lambda: scene_of(
            gx.constraints.PrismaticJoint(
                body("a").frame(),
                body("b", (0, 0, 1)).frame(),
                axis=(1, 0, 0),
            )
        ),
        "off the axis",
    ),
    (
        lambda: gx.connectors.Spring(
            body().port(),
            gx.Ground((0, 0, 0)),
            stiffness=-1.0,
            length=1.0,
        ),
        "stiffness is -1.0",
    ),
    (
        lambda: gx.connectors.Stop(body().port(), gx.Ground((0, 0, 0)), length=0.0, stiffness=1.0),
        "length is 0.0",
    ),
]


@pytest.mark.parametrize(("make", "words"), REFUSED)
def test_bad_input_is_refused(make, words: str) -> None:
    with pytest.raises(gx.InputError, match=words):
        make()


def test_force_that_is_no_number_is_refused() -> None:
    a = body()
    scene = gx.Scene(a, gx.loads.Force(a.port(), lambda t: (np.nan, 0.0, 0.0)))
    with pytest.raises(gx.InputError, match="three finite numbers"):
        gx.Simulation(scene, gx.Midpoint(dt=0.1))


def four_bars(balls: bool) -> gx.Scene:
    """A rectangle of ground and three bars in the plane z = 0, its sides turning with 1 rad/s about
    z.

    With four hinges along z three constraints are redundant; with balls at both ends of the
    coupler, none.
    """
    corners = [np.array(p, dtype=float) for p in ((0, 0, 0), (0, 1, 0), (2, 1, 0), (2, 0, 0))]
    # The two cranks turn about their lower ends; the coupler translates at 1 m/s.
    motions = [((0.5, 0, 0), (0, 0, -1)), ((1.0, 0, 0), (0, 0, 0)), ((0.5, 0, 0), (0, 0, -1))]
    bars = []
    for k, (velocity, spin) in enumerate(motions):
        a = corners[k]
        b = corners[k + 1]
        e = (b - a) / np.linalg.norm(b - a)
        attitude = np.array([e, np.cross([0, 0, 1], e), [0, 0, 1]]).T
        bars.append(
            body(f"bar {k}", tuple((a + b) / 2), attitude=attitude, velocity=velocity, spin=spin)
        )
    sides = [
        (bars[0].frame_at(corners[0]), gx.ground_frame(corners[0])),
        (bars[0].frame_at(corners[1]), bars[1].frame_at(corners[1])),
        (bars[1].frame_at(corners[2]), bars[2].frame_at(corners[2])),
        (bars[2].frame_at(corners[3]), gx.ground_frame(corners[3])),
    ]
    joints: list = []
    for k, (one, other) in enumerate(sides):
        if balls and k in (1, 2):
            joints.append(gx.constraints.BallJoint(one.origin, other.origin, name=f"ball {k}"))
        else:
            joints.append(gx.constraints.RevoluteJoint(one, other, axis=(0, 0, 1), name=f"pin {k}"))
    return gx.Scene(*joints)


def test_closed_loop_of_hinges_is_refused_by_name() -> None:
    with pytest.raises(
        gx.InputError, match=r"3 of the constraints .*'pin 0.*'pin 3.* follow from the others"
    ):
        four_bars(balls=False).compile()


def test_closed_loop_is_solved() -> None:
    """The rectangle turns as a parallelogram: its sides stay parallel, the kinetic energy is
    constant."""
    run = gx.Simulation(four_bars(balls=True), gx.Midpoint(dt=0.01))
    run.run(until=1.0)
    q = run.system.unknowns.q0.array_r[:36].reshape(3, 4, 3)
    # The directors of the two cranks are opposite, as one points up and the other down.
    assert q[0, 1] == pytest.approx(-q[2, 1], abs=1e-9)
    assert run.totals.kinetic == pytest.approx(run.first.kinetic, rel=1e-10)
    # 1 rad/s for 1 s, up to the error h² of the midpoint rule.
    assert np.arctan2(q[0, 1, 0], q[0, 1, 1]) == pytest.approx(1.0, rel=1e-3)
    assert run.system.equations.constraints is not None
    assert run.system.equations.constraints.violation(run.system.unknowns.q0) < 1e-10


def joined(comm: MPI.Comm) -> list[float]:
    """Film, beam, rigid body, cable and mass, joined across whatever ranks they live on: figures
    after 20 steps."""
    film = gx.Membrane(
        sheet(comm, 3, 3),
        gx.Miyazaki(1e6, 0.3, density=1000.0, thickness=1e-3, residual_stiffness=1e-3),
    )
    beam = gx.Beam(line(comm, [(0, 0, 0), (1, 0, 0)], 2), SECTION)
    hub = gx.RigidBody(1.0, (0.1, 0.1, 0.1), position=(1.2, 0, 0), comm=comm, name="hub")
    cable = gx.Cable(line(comm, [(1.2, 0, 0), (1.2, 0, -1)], 4), gx.CableLaw(1e3, 0.5))
    mass = gx.PointMass(0.5, (1.2, 0, -1.3), comm=comm)
    branch = gx.Beam(line(comm, [(1, 0, 0), (1.5, 0.5, 0)], 2), SECTION, name="branch")
    scene = gx.Scene(
        gx.constraints.BallJoint(
            film.port_at((0.4, 0.0, 0.0)),
            beam.port_at((0.4, 0.0, 0.0)),
            name="tie",
        ),
        gx.constraints.BallJoint(film.port("bottom left"), beam.port("start"), name="corner"),
        gx.constraints.FixedJoint(hub.frame_at((1, 0, 0)), beam.frame("end"), name="clamp"),
        gx.constraints.FixedJoint(beam.frame("end"), branch.frame("start"), name="fork"),
        gx.constraints.BallJoint(cable.port("start"), hub.port(), name="hook"),
        gx.connectors.Rope(cable.port("end"), mass.port(), length=0.2, stiffness=500.0),
        gx.Gravity(mass),
        gx.Gravity(hub),
        gx.loads.Torque(hub.frame(), lambda t: (0.0, 0.1 * np.sin(10 * t), 0.2)),
    )
    run = gx.Simulation(scene, gx.Midpoint(dt=5e-3))
    run.run(until=0.1)
    assert abs(run.energy_error) < 1e-10
    t = run.totals
    return [t.kinetic, sum(t.stored.values()), t.supplied, *t.momentum, *t.angular_momentum]


@pytest.mark.mpi
def test_joints_across_ranks() -> None:
    """All ranks together find what each finds alone."""
    # Ranks sum in another order, and Newton's method ends at another residual.
    assert joined(MPI.COMM_WORLD) == pytest.approx(joined(MPI.COMM_SELF), rel=1e-8, abs=1e-10)


def test_a_screw_on_its_axis() -> None:
    """A cylindrical joint lets a body slide along and turn about its axis only: s = F t²/2m, φ = M
    t²/2I."""
    # A unit vector: (1, 2, 2) has the length 3.
    axis = np.array([1.0, 2.0, 2.0]) / 3
    bolt = gx.RigidBody(2.0, (0.3, 0.3, 0.3), position=(0.5, 1.0, 1.0), name="bolt")
    push = gx.loads.Force(
        bolt.port(),
        # The second part is perpendicular to the axis, where the joint bears it.
        tuple(0.8 * axis + 5.0 * np.array([2.0, -1.0, 0.0])),
        name="push",
    )
    turn = gx.loads.Torque(
        bolt.frame(),
        tuple(0.06 * axis + 2.0 * np.array([2.0, -1.0, 0.0])),
        name="turn",
    )
    joint = gx.constraints.CylindricalJoint(gx.ground_frame(), bolt.frame(), axis=tuple(axis))
    run = run_until(0.5, joint, push, turn, dt=1e-3)
    x, *directors = run.system.unknowns.q0.array_r[:12].reshape(4, 3)
    # The acceleration is constant, so the midpoint rule is exact; the rest is the constraint's
    # round-off.
    assert x == pytest.approx((1.5 + 0.8 * 0.5**2 / 2 / 2.0) * axis, abs=1e-9)
    R = np.column_stack(directors)
    # The angle is about 0.025 rad; directors turn with an error of h².
    assert math.acos((np.trace(R) - 1) / 2) == pytest.approx(0.06 * 0.5**2 / 2 / 0.3, rel=1e-5)
    assert R @ axis == pytest.approx(axis, abs=1e-9)


@pytest.mark.mpi
def test_a_gap_at_the_start_is_closed_before_the_first_step() -> None:
    """A point of eight digits is 3e-9 m away from that of the other body: the first step of 1 µs
    would close the gap with 7 mm/s, and all others would go on with that."""
    one = body("one")
    other = body("other", (1.0, 0.0, 0.0))
    ports = one.port((0.33333333, 0.0, 0.0)), other.port((1 / 3 - 1, 0.0, 0.0))
    joint = gx.constraints.BallJoint(*ports)
    run = run_until(4e-6, one, other, joint, dt=1e-6)
    assert run.totals.kinetic < 1e-25
    ends = [gx.probes.Position(port, "x")(run) for port in ports]
    assert ends[0] == pytest.approx(ends[1], abs=1e-15)
    assert ends[0] == pytest.approx(1 / 3, abs=4e-9)


Y = (0.0, 1.0, 0.0)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("kind", "numbers"),
    [
        (gx.connectors.TorsionSpring, {"stiffness": 1.0}),
        (gx.connectors.TabulatedTorsion, {"angle": (-1.0, 1.0), "moment": (-1.0, 1.0)}),
        (gx.connectors.TorsionStop, {"stiffness": 1.0, "limits": (-0.5, 0.5)}),
    ],
)
def test_a_hinge_that_would_wind_its_spring_beyond_half_a_turn_is_refused(kind, numbers) -> None:
    """Directors are the same after a turn: the moment would jump, and with it the energy."""
    hub = gx.RigidBody(1.0, (1.0, 1.0, 1.0), spin=(0.0, 4.0, 0.0), name="hub")
    sides = (gx.ground_frame(), hub.frame())
    hinge = gx.constraints.RevoluteJoint(*sides, axis=Y)
    spring = kind(*sides, axis=Y, name="spiral", **numbers)
    run = gx.Simulation(gx.Scene(hinge, spring), gx.Midpoint(dt=0.05))
    with pytest.raises(gx.StepFailure, match="'spiral' passes half a turn"):
        run.run(until=2.0)
    # It came close to half a turn, of which no angle of 4 sin t is short after asin(π/4).
    assert 0.7 < run.time < 1.0
    assert abs(run.energy_error) < 1e-12
