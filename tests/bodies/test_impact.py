"""Impacts on stops: penalty contact of rigid bodies, and a bar on a wall (REFERENCES D13)."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from meshes.line import line

TIGHT = gx.Tolerances(relative=1e-13)
RADIUS, STIFFNESS = 0.1, 1e4


def collision(offset: float, dt: float) -> gx.Simulation:
    """A ball of 1 kg at 2 m/s towards one of 3 kg at rest, with a gap of 1 mm; centres `offset` off the line."""
    first = gx.RigidBody(1.0, np.full(3, 0.004), (-2 * RADIUS - 1e-3, 0, 0), velocity=(2, 0, 0), name="first")
    second = gx.RigidBody(3.0, np.full(3, 0.012), (0, offset, 0), spin=(0, 0, 3), name="second")
    stop = gx.Stop(first.port(), second.port(), distance=2 * RADIUS, stiffness=STIFFNESS)
    return gx.Simulation(gx.Scene(stop), gx.Midpoint(dt=dt, tolerances=TIGHT))


def rates(run: gx.Simulation) -> np.ndarray:
    """Velocities of the centres, (2, 3)."""
    return run.system.v0.array_r[:24].reshape(2, 4, 3)[:, 0].copy()


def test_central_impact_of_two_bodies() -> None:
    """Contact π√(m/k), penetration V√(m/k), m = m1 m2/(m1 + m2), then -1 and 1 m/s: 1 %."""
    run = collision(0.0, 2e-4)
    gaps, touching = [], 0
    while run.time < 0.05:
        run.run(until=run.time + 2e-4)
        x = run.system.q0.array_r[:24].reshape(2, 4, 3)[:, 0]
        gaps.append(float(np.linalg.norm(x[1] - x[0])) - 2 * RADIUS)
        touching += gaps[-1] < 0
    assert touching * 2e-4 == pytest.approx(0.02720699, rel=1e-2)
    assert -min(gaps) == pytest.approx(0.01732051, rel=1e-2)
    assert rates(run)[:, 0] == pytest.approx([-1.0, 1.0], rel=1e-2)
    assert abs(run.energy_error) < 1e-12
    assert np.abs(run.totals.momentum - run.first.momentum).max() < 1e-12 * 2.0


def test_oblique_impact_conserves() -> None:
    """Energy, momentum and angular momentum over an impact off the line of the centres, which deflects both."""
    run = collision(0.12, 5e-4)
    run.run(until=0.06)
    assert abs(rates(run)[0, 1]) > 0.3
    assert abs(run.energy_error) < 1e-12
    assert np.abs(run.totals.momentum - run.first.momentum).max() < 1e-12 * 2.0
    assert np.abs(run.totals.angular_momentum - run.first.angular_momentum).max() < 1e-12


def test_bar_on_a_wall() -> None:
    """2L/c in contact at the mean stress ρcV, then rebound with -V: E = 2.3 GPa, ρ = 1400, L = 0.5 m, V = 1 m/s.

    The wall is as stiff as an element.
    """
    E, ρ, L, A, n, gap = 2.3e9, 1400.0, 0.5, 1e-4, 50, 1e-6
    c = (E / ρ) ** 0.5
    mesh = line(MPI.COMM_SELF, [(0, 0, 0), (L, 0, 0)], n)
    bar = gx.Cable(mesh, gx.CableLaw(E * A, ρ * A), velocity=lambda x: np.vstack([0 * x[0] - 1, 0 * x[0], 0 * x[0]]))
    wall = gx.Stop(bar.port("start"), gx.Ground((-1 - gap, 0, 0)), distance=1.0, stiffness=E * A * n / L)
    dt = L / c / n / 2
    run = gx.Simulation(gx.Scene(wall), gx.Midpoint(dt=dt))
    touching = []
    while run.time < 3 * L / c:
        run.run(until=run.time + dt)
        if run.system.q0.array_r[0] < -gap:
            touching.append(run.time)
    contact = touching[-1] - touching[0]
    assert contact == pytest.approx(2 * L / c, rel=5e-2)
    impulse = run.totals.momentum[0] - run.first.momentum[0]
    assert impulse / A / contact == pytest.approx(ρ * c, rel=3e-2)
    assert run.totals.momentum[0] / (ρ * A * L) == pytest.approx(1.0, rel=3e-2)
    assert abs(run.energy_error) < 1e-8
