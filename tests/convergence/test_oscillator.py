"""The integrator on problems with exact solutions, without finite elements: a mass on a spring, and
free masses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from tests.rates import observed_order
from tests.small_scenes import run_until

OMEGA = 10.0  # rad/s


def oscillator(h: float, steps: int) -> tuple[np.ndarray, np.ndarray, gx.Simulation]:
    """x and ẋ after every step of a mass that is let go at x = 1 m."""
    mass = gx.PointMass(2.0, position=(1.0, 0.0, 0.0), comm=MPI.COMM_SELF)
    spring = gx.connectors.AxialSpring(mass.port(), 2.0 * OMEGA**2, direction=(1.0, 0.0, 0.0))
    run = gx.Simulation(gx.Scene(mass, spring), gx.Midpoint(dt=h))
    history = []
    for step in range(1, steps + 1):
        run.run(until=step * h)
        history.append((run.system.unknowns.q0.array_r[0], run.system.unknowns.v0.array_r[0]))
    x, v = np.array(history).T
    return x, v, run


@pytest.mark.parametrize(
    # ω_h of the docstring for ω = 10 rad/s.
    "h, frequency",
    [(0.01, 9.991679144), (0.1, 9.272952180), (0.2, 7.853981634)],
)
def test_midpoint_keeps_the_amplitude_and_has_its_exact_frequency(h, frequency):
    """x_n = cos(ω_h n h) with ω_h = (2/h) atan(ωh/2); energy is kept to round-off."""
    steps = 200
    x, v, run = oscillator(h, steps)
    assert frequency == pytest.approx(2 / h * math.atan(OMEGA * h / 2), rel=1e-9)
    phase = frequency * h * np.arange(1, steps + 1)
    # The given frequency has ten digits; 200 steps multiply their error.
    assert x == pytest.approx(np.cos(phase), abs=1e-6)
    assert v == pytest.approx(-OMEGA * np.sin(phase), abs=1e-5)
    # Amplitude √(x² + (v/ω)²) is an invariant of the rule.
    assert x**2 + (v / OMEGA) ** 2 == pytest.approx(np.ones(steps), rel=1e-12)
    assert abs(run.energy_error) <= 1e-12


def test_phase_is_of_second_order():
    steps = [0.04, 0.01]
    # 0.4 s are 4 rad.
    errors = [oscillator(h, round(0.4 / h))[0][-1] - math.cos(4.0) for h in steps]
    assert observed_order(steps, errors) == pytest.approx(2, abs=0.1)


def test_free_masses_fly_straight_in_one_iteration_at_most():
    masses = [
        gx.PointMass(
            m,
            position=(m, 0.0, 1.0),
            velocity=(0.0, m, -1.0),
            comm=MPI.COMM_SELF,
            name=f"mass {m}",
        )
        for m in (1.0, 3.0)
    ]
    run = run_until(50.0, *masses, dt=0.5)
    x = run.system.unknowns.q0.array_r.reshape(-1, 3)
    # x + v t with t = 50 s.
    assert x == pytest.approx(np.array([(1.0, 50.0, -49.0), (3.0, 150.0, -49.0)]), rel=1e-12)
    assert run.iterations <= run.step
    # Σ m v of both masses.
    assert run.totals.momentum == pytest.approx([0.0, 10.0, -4.0], rel=1e-14)


def test_fall_is_exact_whatever_the_step():
    """The midpoint rule integrates a constant force exactly; its work counts as supplied."""
    mass = gx.PointMass(2.0, velocity=(1.0, 0.0, 3.0), comm=MPI.COMM_SELF)
    run = run_until(10.0, mass, gx.Gravity(mass), dt=0.7)
    # z = v t - g t²/2 at 10 s; the last step is shortened to end there.
    z = 30.0 - 9.80665 * 50.0
    assert run.system.unknowns.q0.array_r == pytest.approx([10.0, 0.0, z], rel=1e-12)
    assert run.totals.supplied == pytest.approx(-2.0 * 9.80665 * z, rel=1e-12)
    assert abs(run.energy_error) <= 1e-14
