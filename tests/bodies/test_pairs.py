"""Every body alone and every pair of bodies with every joint, in random motion: nothing is lost (property tests)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpi4py import MPI

import gossamer_fx as gx
from meshes.line import line
from meshes.sheet import sheet

COMM = MPI.COMM_WORLD
STEPS, DT = 200, 5e-3


class Motion:
    """A rigid velocity field that every body of a scene starts with, so that all joints hold in rate."""

    def __init__(self, numbers: tuple[float, ...]) -> None:
        self.velocity, self.spin = np.array(numbers[:3]), np.array(numbers[3:])

    def __call__(self, x: np.ndarray) -> np.ndarray:
        return self.velocity[:, None] + np.cross(self.spin, x.T).T


def film(motion: Motion, name: str) -> gx.Membrane:
    """Of 1 m, its corner at the origin."""
    law = gx.Miyazaki(E=1e6, nu=0.3, density=1000.0, thickness=1e-3, residual=1e-3)
    return gx.Membrane(sheet(COMM, 2, 2), law, velocity=motion, name=name)


def cable(motion: Motion, name: str) -> gx.Cable:
    """From the origin along -x."""
    law = gx.TensionOnly(EA=1e3, line_density=1.0)
    return gx.Cable(line(COMM, [(0, 0, 0), (-1, 0, 0.3)], 3), law, velocity=motion, name=name)


def beam(motion: Motion, name: str) -> gx.Beam:
    """From the origin along -y."""
    section = gx.rectangle(0.03, 0.05, E=1e7, nu=0.3, density=1000.0)
    return gx.Beam(line(COMM, [(0, 0, 0), (0, -1, 0.2)], 2), section, velocity=motion, name=name)


def body(motion: Motion, name: str) -> gx.RigidBody:
    centre = np.array([0.1, 0.2, -0.4])
    velocity = motion(centre[:, None])[:, 0]
    return gx.RigidBody(2.0, (0.2, 0.3, 0.4), centre, velocity=velocity, spin=motion.spin, name=name)


def mass(motion: Motion, name: str) -> gx.PointMass:
    return gx.PointMass(0.7, (0.0, 0.0, 0.0), tuple(motion.velocity), name=name)


BODIES = {"film": film, "cable": cable, "beam": beam, "body": body, "mass": mass}


def port(item) -> gx.Port:
    """The point of a body that is at the origin at the start."""
    if isinstance(item, gx.RigidBody):
        return item.port_at((0, 0, 0))
    if isinstance(item, gx.PointMass):
        return item.port()
    return item.port_at((0, 0, 0))


def conserves(scene: gx.Scene) -> None:
    """Energy to 1e-9, momenta to 1e-10 and constraints to 1e-10 over 200 steps."""
    run = gx.Simulation(scene, gx.Midpoint(dt=DT, tolerances=gx.Tolerances(relative=1e-12)))
    worst = 0.0
    for k in range(4):
        run.run(until=(k + 1) * STEPS // 4 * DT)
        now, first = run.totals, run.first
        assert abs(run.energy_error) < 1e-9
        scale = first.kinetic**0.5 * 2
        assert np.abs(now.momentum - first.momentum).max() < 1e-10 * scale
        assert np.abs(now.angular_momentum - first.angular_momentum).max() < 1e-10 * scale
        if run.system.constraints is not None:
            worst = max(worst, run.system.constraints.violation(run.system.q0))
    assert run.step == STEPS
    assert worst < 1e-10


numbers = st.tuples(*[st.floats(-3, 3)] * 6).filter(lambda n: np.linalg.norm(n) > 0.5)


def joints(a, b) -> dict:
    """All joints that two bodies which share the origin can have."""
    p, q = port(a), port(b)
    found = {"ball": gx.BallJoint(p, q)}
    frames = [frame(item) for item in (a, b) if isinstance(item, gx.RigidBody | gx.Beam)]
    if len(frames) == 2 and any(len(f.directors) == 3 for f in frames):
        full = sorted(frames, key=lambda f: -len(f.directors))
        axis = (1.0, 0.0, 0.0)  # in the plane of the beam's section
        found |= {
            "fixed": gx.FixedJoint(*full),
            "revolute": gx.RevoluteJoint(*full, axis),
            "prismatic": gx.PrismaticJoint(*full, axis),
        }
    return found


def frame(item) -> gx.Frame:
    """Axes at the origin."""
    return item.frame("start") if isinstance(item, gx.Beam) else item.frame_at((0, 0, 0))


def exciter(motion: Motion, item) -> list:
    """A loose mass at rest on a spring, so that the motion is no rigid one."""
    loose = gx.PointMass(0.3, (0.5, -0.4, 0.8), comm=COMM, name="loose")
    return [gx.Spring(port(item), loose.port(), stiffness=50.0, length=0.7, name="exciter")]


@pytest.mark.parametrize("name", BODIES)
@settings(max_examples=2)
@given(numbers=numbers)
def test_alone(name: str, numbers: tuple[float, ...]) -> None:
    motion = Motion(numbers)
    item = BODIES[name](motion, name)
    conserves(gx.Scene(item, *exciter(motion, item)))


PAIRS = [(a, b) for i, a in enumerate(BODIES) for b in list(BODIES)[i:] if (a, b) != ("mass", "mass")]
KINDS = [(a, b, "ball") for a, b in PAIRS] + [
    (a, b, kind) for a, b in (("beam", "body"), ("body", "body")) for kind in ("fixed", "revolute", "prismatic")
]


@pytest.mark.parametrize(("first", "second", "kind"), KINDS)
@settings(max_examples=1)
@given(numbers=numbers)
def test_pair_with_joint(first: str, second: str, kind: str, numbers: tuple[float, ...]) -> None:
    motion = Motion(numbers)
    a, b = BODIES[first](motion, "first"), BODIES[second](motion, "second")
    conserves(gx.Scene(a, b, joints(a, b)[kind], *exciter(motion, a)))


DISTANCES = {
    "link": lambda p, q: gx.Link(p, q),
    "spring": lambda p, q: gx.Spring(p, q, stiffness=200.0, length=0.3),
    "rope": lambda p, q: gx.Rope(p, q, length=0.6, stiffness=500.0),
}


@pytest.mark.parametrize("kind", DISTANCES)
@pytest.mark.parametrize("name", BODIES)
@settings(max_examples=1)
@given(numbers=numbers)
def test_pair_at_a_distance(name: str, kind: str, numbers: tuple[float, ...]) -> None:
    motion = Motion(numbers)
    item = BODIES[name](motion, name)
    place = np.array([0.3, 0.4, 0.2])
    other = gx.PointMass(0.5, tuple(place), tuple(motion(place[:, None])[:, 0]), name="other")
    conserves(gx.Scene(item, DISTANCES[kind](port(item), other.port()), *exciter(motion, item)))


@pytest.mark.parametrize(("axis", "angle"), [((1.0, 0.0, 0.0), 0.0), ((0.0, 1.0, 0.0), 0.4)])
def test_hinge_with_torsional_spring(axis: tuple[float, float, float], angle: float) -> None:
    motion = Motion((0.0, 0.0, 0.0, 1.0, 2.0, 0.5))
    a, b = body(motion, "first"), body(motion, "second")
    spring = gx.TorsionSpring(frame(a), frame(b), axis, stiffness=2.0, rest=angle)
    hinge = gx.RevoluteJoint(frame(a), frame(b), axis)
    conserves(gx.Scene(a, b, hinge, spring, *exciter(motion, a)))


def test_dampers_lose_what_is_booked() -> None:
    motion = Motion((0.0, 0.0, 0.0, 1.0, 2.0, 0.5))
    a, b = body(motion, "first"), body(motion, "second")
    axis = (1.0, 0.0, 0.0)
    loose = gx.PointMass(0.3, (0.5, -0.4, 0.8), name="loose")
    scene = gx.Scene(
        a,
        b,
        gx.RevoluteJoint(frame(a), frame(b), axis),
        gx.TorsionDamper(frame(a), frame(b), axis, coefficient=0.5),
        gx.Spring(port(a), loose.port(), stiffness=50.0, length=0.7),
        gx.Damper(port(b), loose.port(), coefficient=0.5),
    )
    run = gx.Simulation(scene, gx.Midpoint(dt=DT, tolerances=gx.Tolerances(relative=1e-12)))
    run.run(until=1.0)
    assert run.totals.dissipated > 0.1
    assert abs(run.energy_error) < 1e-9
    assert np.abs(run.totals.angular_momentum - run.first.angular_momentum).max() < 1e-10
