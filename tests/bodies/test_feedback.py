"""Feedback by laws of the user: sampled recursions, reaction wheels, delay, restarts.

Between two samples a body of mass m has a constant force u, so that the states at the samples obey
the exact recursion x' = x + P v + P² u/2m, v' = v + P u/m (zero-order hold; Franklin, Powell &
Workman, Digital Control of Dynamic Systems, 3rd ed. (1998), § 4.3).  The midpoint rule meets it to
round-off.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.mechanics.control.feedback import _HeldTorque, _Thrust, _WheelTorque

COMM = MPI.COMM_WORLD
X = (1.0, 0.0, 0.0)
Z = (0.0, 0.0, 1.0)
STEPPER = gx.Midpoint(dt=0.05, tolerances=gx.Tolerances(relative=1e-14))
MASS = 2.0  # kg
PERIOD = 0.1  # s


def pushed(law: Any, comm: MPI.Intracomm = COMM, **arguments: Any) -> tuple[gx.Scene, Any]:
    """A free body with a thruster along x, that a law of position and velocity commands."""
    body = gx.RigidBody(MASS, (1.0, 1.0, 1.0), velocity=(0.1, 0.0, 0.0), comm=comm)
    measures = [gx.probes.Position(body.port(), "x"), gx.probes.Velocity(body.port(), "x")]
    thruster = gx.control.Thruster(body.frame(), X)
    arguments = {"period": PERIOD} | arguments
    feedback = gx.control.Feedback(measures, law, [thruster], **arguments)
    return gx.Scene(feedback), feedback


def pushed_with_times() -> tuple[gx.Scene, Any, list[float]]:
    """The same body under a proportional-derivative law, and a list of the times of its calls."""
    times: list[float] = []

    def law(t: float, values: np.ndarray) -> float:
        times.append(t)
        return proportional_derivative(t, values)

    return *pushed(law), times


def proportional_derivative(t: float, values: np.ndarray) -> float:
    """To x = 1 m; [N]."""
    return float(1.5 * (1.0 - values[0]) - 2.0 * values[1])


@pytest.mark.mpi(1)
@pytest.mark.parametrize("delay", [0, 1, 3])
def test_sampled_thruster_meets_its_recursion(delay: int) -> None:
    """Position, command and work at each sample, with a command that acts `delay` samples late."""
    scene, feedback = pushed(proportional_derivative, delay=delay)
    run = gx.Simulation(scene, STEPPER)
    # Position [m], velocity [m/s] and the commands [N] that wait.
    x = 0.0
    v = 0.1
    waiting = [0.0] * delay
    energy = MASS * v**2 / 2
    for k in range(30):
        waiting.append(proportional_derivative(0.0, np.array([x, v])))
        u = waiting.pop(0)
        x += PERIOD * v + PERIOD**2 * u / (2 * MASS)
        v += PERIOD * u / MASS
        run.run(until=(k + 1) * PERIOD)
        found = [probe(run) for probe in feedback.measures]
        assert found == pytest.approx([x, v], abs=1e-12)
        assert feedback.commands(run) == pytest.approx([u], abs=1e-12)
    work = feedback.work(run)["thruster"]
    assert work == pytest.approx(MASS * v**2 / 2 - energy, abs=1e-12)
    assert run.totals.supplied == pytest.approx(work, abs=1e-12)
    assert abs(run.energy_error) < 1e-12


def test_steps_end_at_samples() -> None:
    """Also with a step that does not divide the period: the recursion stays exact."""
    scene, _, times = pushed_with_times()
    run = gx.Simulation(scene, gx.Midpoint(dt=0.07))
    run.run(until=1.0)
    assert times == pytest.approx(np.arange(10) * PERIOD, abs=1e-12)


def test_sampled_torque_turns_a_body() -> None:
    """The same recursion of an angle; the error of the midpoint rule's rotation is O(dt²)."""
    errors = []
    for dt in (0.05, 0.025):
        body = gx.RigidBody(1.0, (0.5, 0.5, 0.5), comm=COMM)
        director = body.frame().directors[0]

        def angle(run: Any, director: Any = director) -> float:
            x, y, _ = run.system.unknowns.state.vector(director)
            return float(np.arctan2(y, x))

        rate = gx.probes.AngularVelocity(body.frame(), "z")
        feedback = gx.control.Feedback(
            [angle, rate],
            lambda t, values: (0.0, 0.0, 0.6 * (0.4 - values[0]) - 0.5 * values[1]),
            [gx.control.BodyTorque(body.frame())],
            period=PERIOD,
        )
        run = gx.Simulation(gx.Scene(feedback), gx.Midpoint(dt=dt))
        run.run(until=2.0)
        θ = 0.0
        ω = 0.0
        for _ in range(20):
            u = 0.6 * (0.4 - θ) - 0.5 * ω
            θ += PERIOD * ω + PERIOD**2 * u / (2 * 0.5)
            ω += PERIOD * u / 0.5
        errors.append(abs(angle(run) - θ))
        assert abs(run.energy_error) < 1e-12
    assert errors[1] < 1e-4
    assert errors[1] < errors[0] / 3


# ---- reaction wheels -----------------------------------------------------------------------------


def with_wheel(
    law: Any,
    inertias: tuple[float, float, float],
    axis: Any,
    *,
    inertia: float,
    spin: Any = (0.0, 0.0, 0.0),
    wheel_spin: float = 0.0,
) -> tuple[gx.Simulation, gx.control.Feedback]:
    """A body with one wheel, which a law of its rate about x commands."""
    body = gx.RigidBody(1.0, inertias, spin=spin, comm=COMM)
    actuator = gx.control.ReactionWheel(body.frame(), axis, inertia=inertia, spin=wheel_spin)
    rate = gx.probes.AngularVelocity(body.frame(), "x")
    feedback = gx.control.Feedback([rate], law, [actuator], period=PERIOD)
    return gx.Simulation(gx.Scene(feedback), STEPPER), feedback


@pytest.mark.mpi
def test_wheel_and_body_exchange_momentum() -> None:
    """A motor torque of 0.02 N m for 2 s from rest: J ω = -I Ω = u t, and the motor has given
    (u t)²/2 (1/J + 1/I)."""
    J = 0.5
    I = 0.01  # noqa: E741 (as in the formula)
    run, feedback = with_wheel(lambda t, values: 0.02, (J, J, J), X, inertia=I)
    run.run(until=2.0)
    exchanged = 0.02 * 2.0
    assert feedback.spins(run)["reaction wheel"] == pytest.approx(-exchanged / I, rel=1e-12)
    # Rates of directors have the error of the midpoint rule.
    assert feedback.measures[0](run) == pytest.approx(exchanged / J, rel=1e-4)
    assert run.totals.angular_momentum == pytest.approx(np.zeros(3), abs=1e-15)
    energy = exchanged**2 / 2 * (1 / J + 1 / I)
    assert feedback.work(run)["reaction wheel"] == pytest.approx(energy, rel=1e-4)
    assert run.totals.stored["reaction wheel"] == pytest.approx(exchanged**2 / (2 * I), rel=1e-12)
    assert run.totals.supplied == pytest.approx(feedback.work(run)["reaction wheel"], rel=1e-12)
    assert abs(run.energy_error) < 1e-12


@pytest.mark.mpi
def test_tumbling_body_with_a_driven_wheel_conserves_its_momentum() -> None:
    """Angular momentum of body and wheel to round-off, also while the motor works."""
    run, _ = with_wheel(
        lambda t, values: 0.05 * np.sin(3 * t) - 0.1 * values[0],
        (0.3, 0.5, 0.6),
        (1.0, 2.0, 2.0),
        spin=(0.6, 0.4, -0.5),
        inertia=0.02,
        wheel_spin=0.0,
    )
    run.run(until=5.0)
    first = run.first.angular_momentum
    assert run.totals.angular_momentum == pytest.approx(first, abs=1e-13)
    # The body stays where it is, so that its centre is the origin.
    for axis, momentum in zip("xyz", first, strict=True):
        assert gx.probes.AngularMomentum(axis)(run) == pytest.approx(momentum, abs=1e-13)
    assert abs(run.energy_error) < 1e-12


def test_axis_of_an_idle_wheel_precesses() -> None:
    """J ω + l a = L with inertia J 1 gives da/dt = ω × a = (L/J) × a: the axis turns about L with
    the rate |L|/J."""
    J = 0.5
    run, _ = with_wheel(
        lambda t, values: 0.0, (J, J, J), Z, spin=(0.4, 0.0, 0.0), inertia=0.02, wheel_spin=10.0
    )
    L = run.first.angular_momentum
    assert pytest.approx([0.4 * J, 0.0, 0.2], abs=1e-14) == L
    run.run(until=3.0)
    n = L / np.linalg.norm(L)
    angle = np.linalg.norm(L) / J * 3.0
    a = np.array(Z)
    # Rodrigues' formula.
    exact = a * np.cos(angle) + np.cross(n, a) * np.sin(angle) + n * (n @ a) * (1 - np.cos(angle))
    found = run.system.unknowns.state.vector(run.scene.bodies[0].frame().directors[2])
    assert found == pytest.approx(exact, abs=1e-3)
    # The gyroscopic torque does no work.
    assert run.totals.supplied == pytest.approx(0.0, abs=1e-14)
    assert abs(run.energy_error) < 1e-12


def test_wheel_under_generalised_alpha() -> None:
    """The exchange of momentum of the midpoint rule, to the order of that method."""
    errors = []
    for dt in (0.05, 0.025):
        body = gx.RigidBody(1.0, (0.5, 0.5, 0.5), spin=(0.4, 0.0, 0.0), comm=COMM)
        wheel = gx.control.ReactionWheel(body.frame(), Z, inertia=0.02, spin=10.0)
        feedback = gx.control.Feedback(
            [lambda run: 0.0], lambda t, values: 0.02, [wheel], period=PERIOD
        )
        run = gx.Simulation(gx.Scene(feedback), gx.GeneralizedAlpha(dt=dt))
        run.run(until=2.0)
        assert feedback.spins(run)["reaction wheel"] == pytest.approx(10.0 - 0.04 / 0.02)
        errors.append(np.abs(run.totals.angular_momentum - run.first.angular_momentum).max())
    assert errors[1] < 0.01
    assert errors[1] < errors[0] / 1.8


@pytest.mark.parametrize("law", [_HeldTorque(), _Thrust(1), _WheelTorque(0.02, 3.0)])
def test_tangents_of_actuators(law: Any) -> None:
    """Against central differences, whose error is that of round-off, 1e-16 over 1e-6."""
    rng = np.random.default_rng(1)
    n = 6 if isinstance(law, _Thrust) else 12
    law.hold(0.0, rng.standard_normal(len(law.command)))
    law.begin(0.3, 0.05, rng.standard_normal(n), np.zeros(n))
    X = rng.standard_normal(n)
    ε = 1e-6
    columns = [(law.force(X + ε * e) - law.force(X - ε * e)) / (2 * ε) for e in np.eye(n)]
    largest = np.abs(columns).max()
    assert largest > 0.1
    assert law.tangent(X) == pytest.approx(np.array(columns).T, abs=1e-7 * largest)


# ---- state, repeated steps and refusals ----------------------------------------------------------


def with_integral(t: float, values: np.ndarray, state: np.ndarray) -> tuple[float, np.ndarray]:
    """PID: the state is the integral of the error [m s]."""
    error = 1.0 - values[0]
    return 1.5 * error - 2.0 * values[1] + 0.3 * state[0], state + PERIOD * error


@pytest.mark.mpi
def test_restart_has_state_and_waiting_commands(folder: Path) -> None:
    def made(**options: Any) -> tuple[gx.Simulation, gx.control.Feedback]:
        scene, feedback = pushed(with_integral, delay=2, state=(0.0,))
        return gx.Simulation(scene, STEPPER, **options), feedback

    # A time between two samples.
    stop = 0.65
    whole, feedback = made()
    broken, _ = made(checkpoints=gx.Checkpoints(folder))
    for run in (whole, broken):
        run.run(until=stop)
    again, other = made(restart=folder)
    assert again.time == stop
    for run in (whole, again):
        run.run(until=2.0)
    for probe, other_probe in zip(feedback.measures, other.measures, strict=True):
        assert probe(whole) == other_probe(again)
    assert feedback.work(whole) == other.work(again)
    assert feedback.commands(whole)[0] != 0.0


def test_repeated_steps_do_not_call_the_law_again() -> None:
    """An event in mid-step and a step control repeat steps; each sample is taken once."""
    scene, feedback, times = pushed_with_times()
    position = feedback.measures[0]
    event = gx.When(position, 0.2, name="passes")
    run = gx.Simulation(scene, STEPPER, events=[event], control=gx.StepControl(max_step=0.05))
    run.run(until=2.0)
    assert run._monitor.get_history()["done"]
    assert len(times) == len(set(times)) == 20


def test_refusals() -> None:
    scene, _ = pushed(proportional_derivative, period=0.01)
    with pytest.raises(gx.InputError, match=r"period of 0\.01 s is shorter than the step"):
        gx.Simulation(scene, STEPPER).run(until=0.1)
    scene, _ = pushed(lambda t, values: (1.0, 2.0))
    with pytest.raises(gx.InputError, match=r"'feedback' at t = 0 s: it returns \[1\.0, 2\.0\]"):
        gx.Simulation(scene, STEPPER).run(until=0.1)
    scene, _ = pushed(lambda t, values, state: (1.0, (1.0, 2.0)), state=(0.0,))
    with pytest.raises(gx.InputError, match="1 commands and 2 numbers of the state"):
        gx.Simulation(scene, STEPPER).run(until=0.1)
    scene, feedback = pushed(proportional_derivative)
    with pytest.raises(gx.InputError, match=r"'thruster' .* acts in runs only"):
        gx.Equilibrium(scene).find()
    with pytest.raises(gx.InputError, match="'thruster' is an actuator of a feedback, whose law"):
        run = gx.Simulation(scene, STEPPER)
        tape = gx.analysis.RunTape(run)
        run.run(until=0.1)
        gx.analysis.gradient(tape, of=gx.analysis.Energy(), by=["body.spin"])
    with pytest.raises(gx.InputError, match=r"Feedback 'feedback' is not in the scene; add it\."):
        other, _ = pushed(proportional_derivative)
        feedback.commands(gx.Simulation(other, STEPPER))
    with pytest.raises(gx.InputError, match=r"measures is \[\]"):
        gx.control.Feedback([], proportional_derivative, [], period=0.1)
    frame = gx.RigidBody(1.0, (1.0, 1.0, 1.0)).frame()
    twins = [gx.control.BodyTorque(frame), gx.control.BodyTorque(frame)]
    with pytest.raises(gx.InputError, match="the actuator 'torque' is given twice"):
        gx.control.Feedback([lambda run: 0.0], proportional_derivative, twins, period=0.1)
    with pytest.raises(gx.InputError, match=r"direction is \(0\.0, 0\.0, 0\.0\)"):
        gx.control.Thruster(frame, (0.0, 0.0, 0.0))
