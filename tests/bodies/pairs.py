"""Pairs of bodies with a common point, the items that can act on them, and the invariants of their
motion."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet

COMM = MPI.COMM_WORLD
# s; 200 steps are long enough for a few swings of every exciter below.
DT = 5e-3


class Motion:
    """A rigid velocity field that every body of a scene starts with, so that all joints hold in
    rate."""

    def __init__(self, numbers: tuple[float, ...]) -> None:
        self.velocity = np.array(numbers[:3])
        self.spin = np.array(numbers[3:])

    def __call__(self, x: np.ndarray) -> np.ndarray:
        return self.velocity[:, None] + np.cross(self.spin, x.T).T

    def at(self, place: np.ndarray) -> tuple[float, float, float]:
        """The velocity (3,) of one point."""
        x, y, z = self(place[:, None])[:, 0]
        return x, y, z


def film(motion: Motion, name: str) -> gx.Membrane:
    """Of 1 m, its corner at the origin."""
    law = gx.Miyazaki(
        # Soft and thin, so that the film bends and wrinkles at these speeds.
        E=1e6,
        nu=0.3,
        density=1000.0,
        thickness=1e-3,
        residual_stiffness=1e-3,
    )
    return gx.Membrane(sheet(COMM, 2, 2), law, velocity=motion, name=name)


def cable(motion: Motion, name: str) -> gx.Cable:
    """From the origin along -x."""
    law = gx.TensionOnly(EA=1e3, line_density=1.0)
    return gx.Cable(line(COMM, [(0, 0, 0), (-1, 0, 0.3)], 3), law, velocity=motion, name=name)


def beam(motion: Motion, name: str) -> gx.Beam:
    """From the origin along -y."""
    section = gx.sections.rectangle(0.03, 0.05, E=1e7, nu=0.3, density=1000.0)
    return gx.Beam(line(COMM, [(0, 0, 0), (0, -1, 0.2)], 2), section, velocity=motion, name=name)


def body(motion: Motion, name: str) -> gx.RigidBody:
    # Off the joint at the origin, so that the joint transmits moments.
    centre = np.array([0.1, 0.2, -0.4])
    return gx.RigidBody(
        2.0,
        (0.2, 0.3, 0.4),
        position=centre,
        velocity=motion.at(centre),
        spin=motion.spin,
        name=name,
    )


def mass(motion: Motion, name: str) -> gx.PointMass:
    return gx.PointMass(0.7, (0.0, 0.0, 0.0), velocity=tuple(motion.velocity), name=name)


BODIES: dict[str, Callable[[Motion, str], Any]] = {
    "film": film,
    "cable": cable,
    "beam": beam,
    "body": body,
    "mass": mass,
}
JOINTED = [
    (a, b, "ball")
    for i, a in enumerate(BODIES)
    for b in list(BODIES)[i:]
    if (a, b) != ("mass", "mass")
] + [
    (a, b, kind)
    for a, b in (("beam", "body"), ("body", "body"), ("beam", "beam"))
    for kind in ("fixed", "revolute", "prismatic", "cylindrical")
]
AXIS = (1.0, 0.0, 0.0)  # of hinges and slides; in the plane of the beam's section


def port(item: Any) -> gx.Port:
    """The point of a body that is at the origin at the start."""
    return item.port() if isinstance(item, gx.PointMass) else item.port_at((0, 0, 0))


def frame(item: Any) -> gx.Frame:
    """Axes at the origin."""
    return item.frame("start") if isinstance(item, gx.Beam) else item.frame_at((0, 0, 0))


def joint(kind: str, a: Any, b: Any) -> Any:
    """A joint of two bodies that share the origin."""
    if kind == "ball":
        return gx.constraints.BallJoint(port(a), port(b))
    full, other = sorted((frame(a), frame(b)), key=lambda f: -len(f.directors))
    if kind == "fixed":
        return gx.constraints.FixedJoint(full, other)
    kinds = {
        "revolute": gx.constraints.RevoluteJoint,
        "prismatic": gx.constraints.PrismaticJoint,
        "cylindrical": gx.constraints.CylindricalJoint,
    }
    return kinds[kind](full, other, axis=AXIS)


# ---- what may act on a body; `loose` is a mass at rest nearby, so that the motion is not rigid ---


def loose_mass() -> gx.PointMass:
    # It belongs to no joint; an exciter between it and a body makes the motion other than rigid.
    return gx.PointMass(0.3, (0.5, -0.4, 0.8), name="loose")


def connected(kind: Any, item: Any, loose: gx.PointMass, **given: Any) -> list:
    """A connector between a body and the loose mass."""
    return [kind(port(item), loose.port(), **given)]


# Shorter than the distance at the start, so that the spring pulls at once.
spring = partial(connected, gx.connectors.Spring, stiffness=50.0, length=0.7, name="exciter")
damper = partial(connected, gx.connectors.Damper, damping=0.5)
# The loose mass starts 1.025 m from the origin and approaches, so that the stop closes.
stop = partial(connected, gx.connectors.Stop, length=0.95, stiffness=300.0)
# Slightly longer than the distance at the start, so that the rope becomes taut in the motion.
rope = partial(connected, gx.connectors.Rope, length=1.05, stiffness=300.0)


def tape(item: Any, loose: gx.PointMass) -> list:
    if not isinstance(item, gx.Membrane):
        return []
    law = gx.TensionOnly(EA=200.0, line_density=0.1)
    return [
        gx.connectors.Tape.through(item, law, points=[(0, 0.3, 0), (1, 0.8, 0)], bars_per_segment=3)
    ]


def control(item: Any, loose: gx.PointMass) -> list:
    """Held between samples, for a torque that follows grows without bound where the Euler angles
    are singular.

    Gains are such that the delay does not make a beam's section unstable, which has little inertia.
    """
    if isinstance(item, gx.Cable | gx.PointMass):
        return []
    if isinstance(item, gx.Membrane):
        corners = [item.port_at(corner) for corner in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0))]
        axes = gx.control.patch(item.port_at((0.5, 0.5, 0)), corners)
    else:
        axes = frame(item)
    return [
        gx.control.AttitudeControl(axes, (0.1, 0.0, 0.2), stiffness=0.02, damping=1e-4, period=0.02)
    ]


def weight(item: Any, loose: gx.PointMass) -> list:
    return [gx.Gravity(item, (0.0, 1.0, -9.81))]


def push(item: Any, loose: gx.PointMass) -> list:
    return [gx.loads.Force(port(item), lambda t: (2.0 * np.sin(20 * t), 1.0, 0.0))]


INTERNAL = {"spring": spring, "damper": damper, "stop": stop, "rope": rope, "tape": tape}
EXTERNAL = {"control": control, "weight": weight, "push": push}


def hinge_parts(a: Any, b: Any) -> list:
    """What turns or brakes a hinge of two rigid bodies."""
    return [
        gx.connectors.TorsionSpring(frame(a), frame(b), axis=AXIS, stiffness=2.0, rest_angle=0.4),
        gx.connectors.TorsionDamper(frame(a), frame(b), axis=AXIS, damping=0.2),
    ]


def conserves(scene: gx.Scene, closed: bool = True, steps: int = 200) -> gx.Simulation:
    """Energy to 1e-9 and constraints to 1e-10 over all steps; in a `closed` system, momenta to
    1e-10."""
    # Newton's tolerance is far below the limits of energy and momenta that are asserted.
    run = gx.Simulation(scene, gx.Midpoint(dt=DT, tolerances=gx.Tolerances(relative=1e-12)))
    for k in range(4):
        run.run(until=(k + 1) * steps // 4 * DT)
        now = run.totals
        first = run.first
        assert abs(run.energy_error) < 1e-9
        if closed:
            # √(kinetic energy) has the dimension of a momentum for masses of about 1 kg.
            scale = first.kinetic**0.5 * 2
            error = np.abs(now.momentum - first.momentum).max()
            assert error < 1e-10 * scale
            error = np.abs(now.angular_momentum - first.angular_momentum).max()
            assert error < 1e-10 * scale
        if run.system.equations.constraints is not None:
            assert run.system.equations.constraints.violation(run.system.unknowns.q0) < 1e-10
    assert run.step == steps
    return run
