"""Attitude control compared with the closed form of a rigid body, and the angles that it measures.

The closed form is the step response of the linear equation I θ'' + K_d θ' + K_p (θ - θ_c) = 0 of
second order, e.g. K. Ogata, Modern Control Engineering, 5th ed. (2010), § 5-3; of a sampled torque
it is the exact solution under a constant torque from sample to sample.
"""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.control.attitude import (
    euler_angles,
    euler_axes,
    position_gradient,
    rotation,
)
from gossamer_fx.mechanics.terms.loads import PointLoads


def controlled(
    inertia: float, kp: float, kd: float, target: float, period: float, dt: float
) -> gx.Simulation:
    """A rigid body whose angle about z is controlled to `target` [rad]; inertia [kg m²], period
    [s]."""
    body = gx.RigidBody(1.0, np.full(3, inertia))
    control = gx.control.AttitudeControl(
        body.frame(),
        (0, 0, target),
        stiffness=kp,
        damping=kd,
        period=period,
    )
    stepper = gx.Midpoint(dt=dt, tolerances=gx.Tolerances(relative=1e-13))
    return gx.Simulation(gx.Scene(body, control), stepper)


def angle_and_rate(run: gx.Simulation) -> tuple[float, float]:
    """Angle of the body about z [rad] and its rate [rad/s]."""
    director = run.scene.bodies[0].frame().directors[0]
    direction = run.system.unknowns.state.vector(director)
    rate = run.system.unknowns.state.rate(director)
    return float(np.arctan2(direction[1], direction[0])), float(np.cross(direction, rate)[2])


TIMES = (1.0, 2.0, 5.0, 10.0, 20.0)  # s
# Inertia, K_p and K_d, and the angles [degrees] at these times by the closed form.
RESPONSES = [
    ((1.0, 0.25, 0.5), (0.83524379, 2.72239877, 8.18687664, 8.59672453, 8.01736093)),
    ((2.0, 0.5, 2.0), (0.72163208, 2.11392894, 5.70162004, 7.67657854, 7.99600481)),
    ((2.0, 0.5, 4.0), (0.55764165, 1.42189261, 3.58917967, 5.74263061, 7.40876742)),
]


@pytest.mark.parametrize(("gains", "degrees"), RESPONSES)
def test_step_response(gains: tuple[float, float, float], degrees: tuple[float, ...]) -> None:
    """I θ'' = -K_p (θ - θ_c) - K_d θ' from rest, θ_c = 8°; the ledger closes with the control's
    work as supplied."""
    run = controlled(*gains, target=np.radians(8.0), period=0.0, dt=0.05)
    run.run(until=0.5)
    for t, exact in zip(TIMES, degrees, strict=True):
        run.run(until=t)
        # Midpoint rule with 0.05 s: its error at these frequencies is below half a per cent of the
        # answer.
        assert np.degrees(angle_and_rate(run)[0]) == pytest.approx(exact, rel=5e-3)
        assert abs(run.energy_error) < 1e-9


def test_torque_held_between_samples() -> None:
    """I = 1, K_p = 0.25, K_d = 0.5, θ_c = 1 rad, sampled every 0.1 s."""
    run = controlled(1.0, 0.25, 0.5, target=1.0, period=0.1, dt=0.02)
    # Angle and rate [rad, rad/s] at these times [s], with a torque that is constant between
    # samples.
    for t, exact in (
        (1.0, (0.1069307, 0.19332098)),
        (2.0, (0.34818193, 0.27242071)),
        (5.0, (1.03769443, 0.13478003)),
    ):
        run.run(until=t)
        assert angle_and_rate(run) == pytest.approx(exact, rel=5e-3)


def turn(axis: int, angle: float) -> np.ndarray:
    """Rotation matrix about a coordinate axis."""
    R = np.eye(3)
    i = (axis + 1) % 3
    j = (axis + 2) % 3
    R[i, i] = np.cos(angle)
    R[j, j] = np.cos(angle)
    R[j, i] = np.sin(angle)
    R[i, j] = -np.sin(angle)
    return R


def test_angles_of_a_stretched_and_turned_patch() -> None:
    """F = R U of arms in a plane gives R = R_w(γ) R_v(β) R_u(θ) back, whatever the stretch U."""
    angles = np.array([0.3, -0.4, 1.1])
    R = turn(2, angles[2]) @ turn(1, angles[1]) @ turn(0, angles[0])
    # A symmetric positive definite stretch, with shear, so that the polar decomposition has work to
    # do.
    U = np.array([[1.2, 0.1, 0], [0.1, 0.9, 0], [0, 0, 1]])
    arms = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    found = rotation(position_gradient(arms @ (R @ U).T, arms))
    # Algebra only, so round-off.
    assert found == pytest.approx(R, abs=1e-12)
    assert euler_angles(found) == pytest.approx(angles, abs=1e-12)


def test_patch_has_the_mean_gradient_of_the_triangles_around_its_centre() -> None:
    """Of a square cut into four by its centre: what a patch measures is the position gradient at
    that node."""
    rng = np.random.default_rng(0)
    square = np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0], [0, 0, 0]])
    x = square + 0.3 * rng.standard_normal((5, 3))
    gradients = []
    for i, j in ((0, 1), (1, 2), (2, 3), (3, 0)):
        edges = np.array([square[i] - square[4], square[j] - square[4]])
        moved = np.array([x[i] - x[4], x[j] - x[4]])
        gradients.append(moved.T @ np.linalg.inv(edges[:, :2]).T)
    F = position_gradient(x[:4] - x[4], square[:4])
    # The mean of the four triangles is exact for a patch, whatever the positions: round-off.
    assert F[:, :2] == pytest.approx(np.mean(gradients, axis=0), abs=1e-12)


def test_axes_of_the_angles() -> None:
    """dR = [ω]× R with ω = Σ dα_i a_i, by central differences."""
    angles = np.array([0.3, -0.4, 1.1])
    # The error of central differences is about ε² = 1e-12, their round-off about 1e-16/ε = 1e-10.
    ε = 1e-6

    def R(a: np.ndarray) -> np.ndarray:
        return turn(2, a[2]) @ turn(1, a[1]) @ turn(0, a[0])

    for i, axis in enumerate(euler_axes(angles)):
        step = ε * np.eye(3)[i]
        derivative = (R(angles + step) - R(angles - step)) / (2 * ε)
        W = derivative @ R(angles).T
        assert np.array([W[2, 1], W[0, 2], W[1, 0]]) == pytest.approx(axis, abs=1e-9)


def test_the_error_of_an_angle_is_the_short_way_round() -> None:
    """Target 170°, angle 181°, which is measured as -179°: the torque acts on an error of -11°, not
    349°."""
    body = gx.RigidBody(1.0, (1.0, 1.0, 1.0))
    control = gx.control.AttitudeControl(
        body.frame(),
        np.radians([170.0, 0.0, -175.0]),
        stiffness=2.0,
        damping=0.0,
    )
    torques = control.law(np.radians([-179.0, 10.0, 179.0]), np.zeros(3))
    # The errors of the three angles, each brought into (-180°, 180°].
    assert torques == pytest.approx(2.0 * np.radians([-11.0, -10.0, 6.0]), rel=1e-12)


def test_another_gain_of_a_compiled_scene_leaves_the_control_as_it_was() -> None:
    hub = gx.RigidBody(1.0, (1.0, 1.0, 1.0), name="hub")
    control = gx.control.AttitudeControl(
        hub.frame(), (0.1, 0.0, 0.0), stiffness=1.0, damping=2.0, name="steering"
    )
    changed, other = (gx.Simulation(gx.Scene(control), gx.Midpoint(dt=0.1)) for _ in range(2))
    [loads] = changed.system.equations.compiled_as(PointLoads)
    [term] = changed.system.unknowns.terms_of(control)
    loads.set_number(term, "stiffness", np.full(3, 3.0))
    assert loads.get_number(term, "stiffness").tolist() == [3.0, 3.0, 3.0]
    assert control.stiffness.tolist() == [1.0, 1.0, 1.0]
    for run in (changed, other):
        run.run(until=0.1)
    ω = [gx.probes.AngularVelocity(hub.frame(), "x")(run) for run in (changed, other)]
    # The first step of all three: h K_p target/I, less the damping.
    assert ω[0] == pytest.approx(3 * ω[1], rel=0.05)


def test_a_point_has_no_attitude() -> None:
    mass = gx.PointMass(1.0, comm=MPI.COMM_WORLD)
    with pytest.raises(gx.InputError, match="frame is of the kind Port"):
        gx.control.AttitudeControl(mass.port(), (0, 0, 0.1), stiffness=1.0, damping=1.0)
