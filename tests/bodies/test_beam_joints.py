"""Joints between sections of beams: equal to a continuous beam, in every relative direction, and
conserving."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from mpi4py import MPI
from pairs import DT, Motion, conserves

import gossamer_fx as gx
from gossamer_fx.meshes.line import line
from gossamer_fx.records.outputs.description import describe, lines
from tests.small_scenes import at_rest

COMM = MPI.COMM_WORLD
SECTION = gx.sections.rectangle(0.03, 0.05, E=1e7, nu=0.3, density=1000.0)
MOTION = Motion((0.3, -0.2, 0.5, 1.0, 2.0, -0.7))
DIRECTIONS = {
    "onwards": (1.0, 0.0, 0.0),
    # Nearly parallel axes: a rotation from one to the other must not lose digits.
    "almost onwards": (1.0, 1e-4, 0.0),
    "back": (-1.0, 0.0, 0.0),
    "across": (0.0, 1.0, 0.0),
    "obliquely": (0.5, -0.6, 0.3),
}


def arm(name: str, direction: tuple[float, ...], elements: int = 2, **more) -> gx.Beam:
    """From the origin, of the length of `direction` [m]."""
    return gx.Beam(
        line(COMM, [(0, 0, 0), direction], elements),
        SECTION,
        normal=(0.1, 0.2, 1.0),
        name=name,
        **more,
    )


def triad(run: gx.Simulation, frame: gx.Frame) -> np.ndarray:
    """Normal, d2 and d3 (3, 3) of a section or of a body's last two axes, as they are now."""
    d2, d3 = run.system.unknowns.state.vectors(frame.directors[-2:])
    return np.array([np.cross(d2, d3), d2, d3])


@pytest.mark.mpi(1)
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_two_arms_in_free_flight_conserve(direction: str) -> None:
    """Energy, momenta and constraints, while the arms bend under the spin; their sections stay as
    they met."""
    one = arm("one", (-1.0, 0.0, 0.0), velocity=MOTION)
    two = arm("two", DIRECTIONS[direction], velocity=MOTION)
    frames = one.frame("start"), two.frame("start")
    scene = gx.Scene(gx.constraints.FixedJoint(*frames))
    first = [triad(gx.Simulation(scene, gx.Midpoint(dt=DT)), frame) for frame in frames]
    run = conserves(scene)
    assert run.substeps == 0
    now = [triad(run, frame) for frame in frames]
    # The angle between the two sections is what the joint keeps, to round-off.
    assert now[0] @ now[1].T == pytest.approx(first[0] @ first[1].T, abs=1e-10)
    measured = np.abs(now[0] - first[0]).max()
    assert measured > 0.5  # both have turned


@pytest.mark.mpi
def test_frames_of_joints_are_no_bodies_of_a_description() -> None:
    joint = gx.constraints.FixedJoint(
        arm("one", (-1.0, 0.0, 0.0)).frame("start"), arm("two", (1.0, 0.0, 0.0)).frame("start")
    )
    about = describe(gx.Simulation(gx.Scene(joint), gx.Midpoint(dt=DT)))
    assert list(about["bodies"]) == ["one", "two"]
    assert all(
        body["mass"] == pytest.approx(1000 * 0.03 * 0.05) for body in about["bodies"].values()
    )
    (frame,) = about["section frames"]
    measured = [line for line in lines(about) if "section frame" in line]
    assert measured == [f"section frames  '{frame}'"]


def tip(parts: int, load: tuple[float, float, float]) -> np.ndarray:
    """Displaced end of a cantilever of 1 m that is made of that many beams, of 8 elements in
    all."""
    ends = np.linspace(0, 1, parts + 1)
    beams = [
        gx.Beam(line(COMM, [(a, 0, 0), (b, 0, 0)], 8 // parts), SECTION, name=f"beam {k}")
        for k, (a, b) in enumerate(pairwise(ends))
    ]
    joints = [
        gx.constraints.FixedJoint(one.frame("end"), two.frame("start"), name=f"joint {k}")
        for k, (one, two) in enumerate(pairwise(beams))
    ]
    port = beams[-1].port("end")
    search = at_rest(
        gx.Fixed(beams[0], "start", rotation=True), *beams, *joints, gx.loads.Force(port, load)
    )
    return search.system.unknowns.state.vectors([port])[0]


def test_a_cantilever_in_pieces_bends_as_one_in_one_piece() -> None:
    """Under a dead force across it and oblique to its section, tip by more than half a metre."""
    load = (0.0, 2.5, 2.5)
    whole = tip(1, load)
    assert np.linalg.norm(whole[1:]) > 0.5
    # Pieces and whole have the same elements, so only the tolerance of the equilibrium separates
    # them.
    assert tip(2, load) == pytest.approx(whole, abs=1e-7)
    assert tip(4, load) == pytest.approx(whole, abs=1e-7)


def pulled(one: gx.Beam) -> gx.connectors.Spring:
    """What makes the motion other than rigid."""
    mass = gx.PointMass(0.3, (0.0, 1.0, 1.0), name="loose")
    return gx.connectors.Spring(one.port("end"), mass.port(), stiffness=5.0, length=1.0)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.4, 0.5, -0.3)])
@pytest.mark.parametrize("second", ["beam", "body"])
def test_hinges_on_sections_take_any_axis(axis: tuple[float, float, float], second: str) -> None:
    """Both sides carry the axis alike, and turn about it against a spring; all is conserved."""
    one = arm("one", (-1.0, 0.0, 0.0), velocity=MOTION)
    centre = np.array([0.1, 0.2, 0.0])
    if second == "beam":
        frame = arm("two", (0.2, 1.0, 0.1), velocity=MOTION).frame("start")
    else:
        inertia = (0.02, 0.03, 0.04)
        frame = gx.RigidBody(
            0.5,
            inertia,
            position=centre,
            velocity=MOTION.at(centre),
            spin=MOTION.spin,
        ).frame_at((0, 0, 0))
    sides = one.frame("start"), frame
    spiral = gx.connectors.TorsionSpring(*sides, axis=axis, stiffness=0.1, rest_angle=0.5)
    scene = gx.Scene(gx.constraints.RevoluteJoint(*sides, axis=axis), spiral, pulled(one))
    first = [triad(gx.Simulation(scene, gx.Midpoint(dt=DT)), side) for side in sides]
    run = conserves(scene)
    turned = [triad(run, side).T @ before for side, before in zip(sides, first, strict=True)]
    n = np.array(axis) / np.linalg.norm(axis)
    # Both sides carry the axis: round-off of the constraint.
    assert turned[0] @ n == pytest.approx(turned[1] @ n, abs=1e-10)
    # They have turned about the axis by some degrees, or nothing was tested.
    assert np.abs(turned[0] - turned[1]).max() > 0.05


def test_a_beam_slides_along_a_beam() -> None:
    """Along an axis that is oblique to both sections, without turning against it."""
    one = arm("one", (-1.0, 0.0, 0.0), velocity=MOTION)
    two = arm("two", (0.2, 1.0, 0.1), velocity=MOTION)
    joint = gx.constraints.PrismaticJoint(
        one.frame("start"),
        two.frame("start"),
        axis=(0.4, 0.5, -0.3),
    )
    run = conserves(gx.Scene(joint, pulled(one)))
    a, b = run.system.unknowns.state.vectors([one.port("start"), two.port("start")])
    # They have moved along the axis by more than 1 cm, or nothing was tested.
    assert np.linalg.norm(a - b) > 0.01


@pytest.mark.mpi
def test_all_that_meets_at_a_section_shares_its_normal() -> None:
    """A hinge with spring and damper, about an axis oblique to the sections of both beams: two
    bodies are added."""
    one = arm("one", (-1.0, 0.0, 0.0))
    two = arm("two", (0.2, 1.0, 0.1))
    axis = (0.4, 0.5, -0.3)
    scene = gx.Scene(
        gx.constraints.RevoluteJoint(one.frame("start"), two.frame("start"), axis=axis),
        gx.connectors.TorsionSpring(
            one.frame("start"),
            two.frame("start"),
            axis=axis,
            stiffness=0.1,
        ),
        gx.connectors.TorsionDamper(one.frame("start"), two.frame("start"), axis=axis, damping=0.1),
    )
    measured = sorted(body.name for body in scene.bodies)
    expected = ["frame of one/start", "frame of two/start", "one", "two"]
    assert measured == expected
