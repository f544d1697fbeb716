"""Point masses, rigid bodies and joints against exact motions and their invariants.

Sources of the exact motions:
    spring pendulum    m r'' = -k (|r| - l0) r/|r| + m g, integrated to 1e-10
    free rigid body    L. D. Landau & E. M. Lifshitz, Mechanics, 3rd ed. (1976), § 37, in elliptic
                       functions
    hinged rods        Lagrange's equations of two uniform rods in a plane, integrated to 1e-10; as
                       of the double pendulum in Landau & Lifshitz, § 5, problem 1, with the rods'
                       moments of inertia m l²/12
"""

from __future__ import annotations

import re

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.mechanics.terms.discrete_gradient import PathAverage
from tests.rates import observed_order
from tests.small_scenes import run_until

TIGHT = gx.Tolerances(relative=1e-13)


def midpoint(dt: float) -> gx.Midpoint:
    return gx.Midpoint(dt=dt, rule=PathAverage(), tolerances=TIGHT)


def coordinates(run: gx.Simulation, vectors: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates and rates (vectors, 3) of the first bodies."""
    q, v = (
        x.array_r[: 3 * vectors].reshape(-1, 3).copy()
        for x in (run.system.unknowns.q0, run.system.unknowns.v0)
    )
    return q, v


# Reference positions x, y, z [m] at these times [s].
SPRING_PENDULUM = {
    1.0: (-0.95281627, -0.32598524, -0.49398836),
    5.0: (-0.58812828, 0.40158893, -0.60206206),
    10.0: (0.40307212, -0.22958217, -1.13735299),
}


def spring_pendulum(dt: float) -> tuple[float, gx.Simulation]:
    mass = gx.PointMass(1.0, (1.2, 0, -0.3), velocity=(0, 0.8, 0))
    spring = gx.connectors.Spring(mass.port(), gx.Ground((0, 0, 0)), stiffness=100.0, length=1.0)
    run = gx.Simulation(gx.Scene(mass, spring, gx.Gravity(mass, (0, 0, -9.81))), midpoint(dt))
    error = 0.0
    for t, exact in SPRING_PENDULUM.items():
        run.run(until=t)
        error = max(error, float(np.abs(coordinates(run, 1)[0][0] - exact).max()))
    # L_z = m (x v_y - y v_x) = 1.2 × 0.8.
    assert run.first.angular_momentum[2] == pytest.approx(0.96, abs=1e-10)
    return error, run


# Angular velocities about the body's axes and R_zz, by Jacobi's elliptic functions.
FREE_BODY = {
    1.0: (0.40838623, 0.91280923, 1.07808152, 0.71353421),
    5.0: (0.77041950, -0.63753728, 1.14215384, 0.97089924),
    10.0: (0.23429408, -0.97216577, 1.06064347, 0.93438499),
}


def free_body(dt: float) -> tuple[float, gx.Simulation]:
    """Landau & Lifshitz, Mechanics, § 37, I = (1, 2, 3): a plate without thickness."""
    body = gx.RigidBody(1.0, (1.0, 2.0, 3.0), spin=(1.0, 0.0, 1.2))
    run = gx.Simulation(gx.Scene(body), midpoint(dt))
    error = 0.0
    for t, exact in FREE_BODY.items():
        run.run(until=t)
        q, v = coordinates(run, 4)
        R = q[1:].T
        W = R.T @ v[1:].T
        # ω of the body's axes: the skew part of Rᵀ Ṙ.
        rates = (W[2, 1] - W[1, 2]) / 2, (W[0, 2] - W[2, 0]) / 2, (W[1, 0] - W[0, 1]) / 2
        error = max(error, float(np.abs(np.array([*rates, R[2, 2]]) - exact).max()))
        deviation = np.abs(R.T @ R - np.eye(3)).max()
        # The directors are constrained at the ends of steps, so they are orthonormal to round-off.
        assert deviation < 1e-12
    return error, run


@pytest.mark.parametrize(
    ("dt", "relative", "largest"),
    # Energy is missed by what Newton's residual leaves, which depends on where the iteration ends.
    [(0.026, 1e-10, 1e-11), (0.026, 1e-12, 1e-13), (0.035, 1e-10, 1e-13)],
)
def test_what_a_free_rigid_body_misses_follows_the_tolerance_and_not_the_step(
    dt: float, relative: float, largest: float
) -> None:
    """Two iterations leave a residual just below 1e-10 at 26 ms; at 35 ms a third one is made."""
    body = gx.RigidBody(1.0, (1.0, 2.0, 3.0), spin=(1.0, 0.0, 1.2))
    stepper = gx.Midpoint(dt=dt, tolerances=gx.Tolerances(relative=relative))
    run = gx.Simulation(gx.Scene(body), stepper)
    run.run(until=10.0)
    assert abs(run.energy_error) < largest


def test_what_many_small_steps_leave_does_not_add_up() -> None:
    """One iteration leaves a residual just below the default tolerance, of the same sign in all
    4000 steps."""
    body = gx.RigidBody(1.0, (0.6, 1.1, 1.5), spin=(1.5, 0.0, 0.5))
    run = run_until(2.0, body, dt=5e-4)
    assert run.step == 4000
    assert abs(run.energy_error) < 1e-13
    start = run.first.angular_momentum
    change = np.linalg.norm(run.totals.angular_momentum - start)
    assert change < 1e-13 * np.linalg.norm(start)
    # Two iterations a step, but for the first steps.
    assert run.iterations < 2.01 * run.step


def test_a_step_that_fails_at_a_small_residual_names_the_tolerance_that_passes_it() -> None:
    def run(**tolerances: float) -> gx.Simulation:
        mass = gx.PointMass(1.0, (1.2, 0.0, -0.3), velocity=(0.0, 0.8, 0.0))
        spring = gx.connectors.Spring(
            mass.port(),
            gx.Ground((0.0, 0.0, 0.0)),
            stiffness=100.0,
            length=1.0,
        )
        # Round-off is not taken for zero, so that no step is solved.
        never = gx.Tolerances(relative=0.0, floor=0.0, max_iterations=8, **tolerances)
        return gx.Simulation(gx.Scene(mass, spring), gx.Midpoint(dt=1e-2, tolerances=never))

    words = r"if forces of this size do not matter, give Tolerances\(absolute=(\S+)\)"
    with pytest.raises(gx.StepFailure, match=words) as failure:
        run().run(until=0.1)
    found = re.search(words, str(failure.value))
    assert found is not None
    passing = run(absolute=10 * float(found[1]))
    passing.run(until=0.1)
    assert abs(passing.energy_error) < 1e-13


def test_a_step_that_fails_names_a_body_where_constraints_miss_more_than_forces() -> None:
    body = gx.RigidBody(1e-6, (0.6e-6, 1.1e-6, 1.5e-6), spin=(1.5, 0.0, 0.5))
    words = "constraints off by .* largest in 'body' the rigid body"
    with pytest.raises(gx.StepFailure, match=words):
        run_until(0.5, body, dt=0.5, halvings=0, tolerances=gx.Tolerances(max_iterations=1))


# Two angles [rad] and two rates [rad/s] at these times [s], from the equations of the double
# pendulum.
HINGED_RODS = {
    0.5: (-0.00762363, 0.73574521, -1.97032908, -3.27194317),
    1.0: (-0.52210314, -1.38683787, -1.62101111, -0.48556604),
    2.0: (0.37679909, 0.46511273, 1.05153943, 4.49623996),
}


def hinged_rods(dt: float) -> tuple[float, gx.Simulation]:
    def direction(angle: float) -> np.ndarray:
        return np.array([np.sin(angle), -np.cos(angle), 0.0])

    def rod(name: str, angle: float, start: np.ndarray) -> gx.RigidBody:
        e = direction(angle)
        attitude = np.array([e, np.cross([0, 0, 1], e), [0, 0, 1]]).T
        return gx.RigidBody(
            1.0,
            # m L²/12 of a thin rod of 1 kg and 1 m.
            np.full(3, 1 / 12),
            position=start + e / 2,
            attitude=attitude,
            name=name,
        )

    upper, lower = np.radians([60.0, 30.0])
    a = rod("upper", upper, np.zeros(3))
    b = rod("lower", lower, direction(upper))
    scene = gx.Scene(
        gx.constraints.RevoluteJoint(
            a.frame((-0.5, 0, 0)),
            gx.ground_frame(),
            axis=(0, 0, 1),
            name="root",
        ),
        gx.constraints.RevoluteJoint(
            a.frame((0.5, 0, 0)),
            b.frame((-0.5, 0, 0)),
            axis=(0, 0, 1),
            name="hinge",
        ),
        gx.Gravity(a, (0, -9.81, 0)),
        gx.Gravity(b, (0, -9.81, 0)),
    )
    run = gx.Simulation(scene, midpoint(dt))
    error = 0.0
    for t, exact in HINGED_RODS.items():
        run.run(until=t)
        q, v = (x.reshape(2, 4, 3) for x in coordinates(run, 8))
        axis = q[:, 1]
        rate = v[:, 1]
        angles = np.arctan2(axis[:, 0], -axis[:, 1])
        rates = np.cross(axis, rate)[:, 2]
        error = max(error, float(np.abs(np.array([*angles, *rates]) - exact).max()))
        hinge = (q[0, 0] + q[0, 1] / 2) - (q[1, 0] - q[1, 1] / 2)
        deviation = np.abs(hinge).max()
        # The pin is a constraint on positions: round-off.
        assert deviation < 1e-12
    return error, run


@pytest.mark.parametrize(
    ("motion", "steps", "largest", "kept", "round_off"),
    [
        # Of the angular momentum the components about which nothing turns.
        (spring_pendulum, (4e-3, 2e-3), 0.01, [2], 1e-10),
        (free_body, (2e-2, 1e-2), 1e-3, [0, 1, 2], 1e-11),
        (hinged_rods, (4e-3, 2e-3), 1e-3, [], 1e-10),
    ],
    ids=["spring pendulum", "free body", "hinged rods"],
)
def test_motions_are_of_second_order_and_conserve(motion, steps, largest, kept, round_off) -> None:
    errors = []
    for dt in steps:
        error, run = motion(dt)
        errors.append(error)
        assert abs(run.energy_error) < round_off
        change = run.totals.angular_momentum - run.first.angular_momentum
        assert np.abs(change[kept]).max(initial=0.0) < round_off
    assert 1.9 < observed_order(steps, errors) < 2.1
    assert errors[-1] < largest
