"""The lid of a box: closed by its latch, opened by its spring according to the closed form, limited
by its stop."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gossamer_fx as gx
from demos.common.lidded_box import LiddedBox
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import run_until

SIZES = (0.1, 0.08, 0.05)
INERTIA = 0.1 / 12 * (0.1**2 + 2e-3**2) + 0.1 * 0.05**2  # of the lid about its hinge


class Angle:
    """How far the lid has turned [rad]."""

    def __init__(self, box: LiddedBox) -> None:
        end = [0.05, 0.0, 0.026]
        self._ends = [
            (
                gx.probes.Position(box.lid.port_at(end), a),
                gx.probes.Position(box.lid.port_at([-0.05, 0, 0.026]), a),
            )
            for a in "xz"
        ]

    def __call__(self, run: gx.Simulation) -> float:
        x, z = (end(run) - hinge(run) for end, hinge in self._ends)
        return math.atan2(z, x)


@pytest.mark.mpi
def test_the_spring_opens_the_lid_as_the_closed_form_says(comm) -> None:
    box = LiddedBox(SIZES, release_time=0.01, max_angle=None, rest_angle=2.0, stiffness=0.1)
    series = gx.Series({"angle": Angle(box)})
    run = run_until(0.08 if comm.size == 1 else 0.02, box, dt=5e-4, outputs=[series])
    held = series.time <= 0.01 + 1e-9
    error = np.abs(series["angle"][held]).max()
    assert error < 1e-9
    ω = math.sqrt(0.1 / INERTIA)
    exact = 2.0 * (1 - np.cos(ω * np.clip(series.time - 0.01, 0, None)))
    assert ω * 0.07 > 1.0  # more than half of the way to rest, on one rank
    assert series["angle"] == pytest.approx(exact, abs=2e-3)
    assert abs(run.energy_error) < 1e-11


def test_the_stop_turns_the_lid_back_and_the_damper_takes_energy() -> None:
    box = LiddedBox(
        SIZES,
        max_angle=1.5,
        rest_angle=2.5,
        stiffness=0.2,
        damping=2e-3,
        stop_stiffness=1e5,
    )
    series = gx.Series({"angle": Angle(box)})
    run = run_until(0.06, box, dt=4e-4, outputs=[series])
    assert 1.5 < series["angle"].max() < 1.55
    assert series["angle"][-1] < 1.4
    assert run.totals.dissipated > 0.01 * 0.5 * 0.2 * 2.5**2
    assert abs(run.energy_error) < 1e-9


def test_walls_leave_the_room_free_and_the_lid_covers_it() -> None:
    box = LiddedBox(SIZES, (0.0, 0.0, 1.0))
    walls = box.obstacles
    assert len(walls) == 6 and walls[-1].body is box.lid
    for wall in walls:
        gap = (
            np.abs(np.asarray(wall.centre) - [0, 0, 1])
            - np.asarray(wall.sizes) / 2
            - np.asarray(SIZES) / 2
        )
        assert gap.max() == pytest.approx(0.0, abs=1e-12)


def test_a_free_body_carries_the_box(comm) -> None:
    """Lid and body turn against each other; momentum and angular momentum stay; the angle is the
    closed form's.

    With the reduced inertia: without external moments the spring turns both by φr (1 - cos ωt) with
    ω² = k/I, where 1/I is that of the lid about the hinge for a body that is much heavier.
    """
    body = gx.RigidBody(2e3, (50.0, 60.0, 70.0), velocity=(0.3, 0.0, -0.1), comm=comm, name="bus")
    turn = (0.3, -0.5, 0.8)
    box = LiddedBox(
        SIZES,
        (0.4, 0.2, -0.1),
        release_time=0.01,
        max_angle=None,
        rest_angle=2.0,
        stiffness=0.1,
        body=body,
        turn=turn,
    )
    scene = gx.Scene(box)
    run = gx.Simulation(scene, gx.Midpoint(dt=5e-4))
    before = run.totals
    until = 0.08 if comm.size == 1 else 0.02
    run.run(until=until)
    after = run.totals
    scale = 0.1 * 0.05 * 40.0 * 0.1
    drift = np.abs(after.angular_momentum - before.angular_momentum).max()
    assert drift < 1e-10 * scale + 1e-12 * np.abs(before.angular_momentum).max()
    momentum = np.linalg.norm(before.momentum)
    assert np.abs(after.momentum - before.momentum).max() < 1e-12 * momentum
    assert abs(run.energy_error) < 1e-11
    axes = Rotation.from_rotvec(turn).as_matrix()
    # The normal of the lid in the axes of the box.
    normal = axes.T @ run.system.unknowns.state.vector(box.lid.frame().directors[2])
    angle = math.atan2(-normal[0], normal[2])
    ω = math.sqrt(0.1 / INERTIA)
    assert angle == pytest.approx(2.0 * (1 - math.cos(ω * (until - 0.01))), abs=5e-3)


def test_the_lid_moves_with_a_turning_body_at_the_start(comm) -> None:
    """Before the first step, lid and body have one angular velocity: all joints hold their
    velocities."""
    body = gx.RigidBody(2.0, (0.1, 0.2, 0.25), spin=(0.4, -1.0, 2.0), comm=comm, name="bus")
    box = LiddedBox(SIZES, (0.1, 0.0, 0.2), body=body, release_time=1.0)
    run = gx.Simulation(gx.Scene(box), gx.Midpoint(dt=1e-4))
    expected = np.cross([0.4, -1.0, 2.0], [0.1, 0.0, 0.226])
    found = [gx.probes.Velocity(box.lid.port(), axis)(run) for axis in "xyz"]
    assert found == pytest.approx(expected, abs=1e-12)
    spin = [gx.probes.AngularVelocity(box.lid.frame(), axis)(run) for axis in "xyz"]
    assert spin == pytest.approx([0.4, -1.0, 2.0], abs=1e-12)


@pytest.mark.mpi
def test_a_film_in_the_box_touches_it(comm) -> None:
    """A sheet that flies upwards in the box strikes the lid and turns it."""
    law = gx.Miyazaki(E=1e8, nu=0.3, density=1400.0, thickness=1e-4, residual_stiffness=1e-4)
    film = gx.Membrane(
        sheet(comm, 2, 2, 0.06, 0.06),
        law,
        displacement=lambda X: np.array([[-0.03], [-0.03], [0.022]]) + 0 * X,
        velocity=lambda X: np.array([[0.0], [0.0], [2.0]]) + 0 * X,
    )
    box = LiddedBox(SIZES, mass=1e-3, stiffness=1e-4, rest_angle=1.0)
    contact = gx.Contact(film, *box.obstacles, distance=1e-3)
    angle = Angle(box)
    run = run_until(3e-3 if comm.size == 1 else 5e-4, film, box, contact, dt=1e-4)
    assert gx.probes.Penetrations(contact)(run) == 0
    assert abs(run.energy_error) < 1e-9
    assert comm.size > 1 or angle(run) > 0.005


@pytest.mark.parametrize(
    "options, words",
    [
        ({"rest_angle": 4.0}, "rest_angle is 4.0 rad; give an angle between 0 and π"),
        ({"sizes": (0.1, 0.0, 0.1)}, "three positive numbers"),
    ],
)
def test_what_cannot_be_is_refused(options, words: str) -> None:
    with pytest.raises(gx.InputError, match=words):
        LiddedBox(**{"sizes": SIZES} | options)
