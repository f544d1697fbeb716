"""Trajectory bounds: the rigid drift of points, and their expected positions."""

from __future__ import annotations

import numpy as np
import pytest

from gossamer_fx.mechanics.contact.broad_phase.candidates import RigidDrift, TrajectoryBounds

TURN = RigidDrift(
    time=0.5,
    centre=np.array([0.3, 0.1, -0.2]),
    velocity=np.array([2.0, -1.0, 0.5]),
    spin=np.array([0.0, 3.0, 4.0]),
)


def drifted(drift: RigidDrift, x: np.ndarray, time: float) -> np.ndarray:
    """Return where points x (n, 3) are at a time [s] by the drift alone: many short midpoint
    steps."""
    # Midpoint steps rotate exactly in norm; 20000 of them give the angle to 1e-9.
    count = 20000
    step = (time - drift.time) / count
    r = x - drift.centre
    for _ in range(count):
        middle = r + step / 2 * np.cross(drift.spin, r)
        r = r + step * np.cross(drift.spin, middle)
    return r + drift.centre + (time - drift.time) * drift.velocity


def test_a_drift_is_undone() -> None:
    x = np.random.default_rng(0).uniform(size=(5, 3))
    # Error of the many steps; the closed form itself is exact.
    assert TURN.undone(drifted(TURN, x, 0.9), 0.9) == pytest.approx(x, abs=1e-7)
    assert TURN.undone(x, 0.5) == pytest.approx(x)


def test_the_drift_of_points_is_their_rigid_motion() -> None:
    x = np.random.default_rng(1).uniform(size=(20, 3))
    found = RigidDrift.of(x, TURN.velocities(x), 0.5)
    assert found.spin == pytest.approx(TURN.spin)
    assert found.velocities(x) == pytest.approx(TURN.velocities(x))


def test_the_drift_of_points_on_a_line_moves_them_rightly() -> None:
    """Their spin about the line cannot be seen."""
    line = np.array([[0.1, 0.2, 0.3]]) + np.linspace(0, 1, 4)[:, None]
    found = RigidDrift.of(line, TURN.velocities(line), 0.5)
    assert found.velocities(line) == pytest.approx(TURN.velocities(line))


def test_bounds_hold_while_points_are_within_their_margins() -> None:
    rng = np.random.default_rng(2)
    x = rng.uniform(size=(50, 3))
    velocities = rng.normal(scale=0.3, size=(50, 3))
    margin = rng.uniform(0.01, 0.03, 50)
    bounds = TrajectoryBounds(TURN, x, velocities, margin, duration=0.2)
    assert bounds.hold(drifted(TURN, x + 0.1 * velocities, 0.6), 0.6)
    # After their duration the relative velocities are over.
    assert bounds.hold(drifted(TURN, x + 0.2 * velocities, 0.75), 0.75)
    assert not bounds.hold(drifted(TURN, x + 0.4 * velocities, 0.9), 0.9)
    off = np.zeros_like(x)
    # Slightly more than the margin, in all three components together.
    off[7] = 1.01 * margin[7] / 3**0.5
    assert not bounds.hold(x + off, 0.5)
    lower, upper = bounds.boxes()
    for t in (0.0, 0.1, 0.2):
        assert (lower <= x + t * velocities).all() and (x + t * velocities <= upper).all()
