"""Ropes with viscosity: damped while they are taut, without force while they are slack, and never
in compression."""

from __future__ import annotations

import math

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.mechanics.connectors.spring import rope_damper
from tests.rows import step_of

# Units: N/m, N s/m, kg, m.
K = 400.0
C = 1.0
MASS = 0.5
L = 1.0


def scene(x, v, *more, damping=C):
    mass = gx.PointMass(MASS, (x, 0.0, 0.0), velocity=(v, 0.0, 0.0))
    rope = gx.connectors.Rope(
        gx.Ground((0.0, 0.0, 0.0)),
        mass.port(),
        length=L,
        stiffness=K,
        damping=damping,
    )
    return gx.Scene(mass, rope, *[make(mass) for make in more]), mass


def test_a_slack_rope_is_free_and_a_plain_damper_is_not():
    """A mass that flies below the rope's length has a constant speed; with a damper in addition it
    slows down."""
    free, mass = scene(0.2, 0.5)
    run = gx.Simulation(free, gx.Midpoint(dt=1e-2))
    run.run(until=0.5)
    assert (
        # No force acts, so that the speed is that of the start to round-off.
        gx.probes.Velocity(mass.port(), "x")(run) == pytest.approx(0.5, abs=1e-12)
        and run.totals.dissipated == 0
    )
    damped, mass = scene(
        0.2,
        0.5,
        lambda m: gx.connectors.Damper(gx.Ground((0.0, 0.0, 0.0)), m.port(), damping=C),
        damping=0.0,
    )
    run = gx.Simulation(damped, gx.Midpoint(dt=1e-2))
    run.run(until=0.5)
    # The damper slows it as exp(-C t/m) = exp(-1) would: below 0.3 from 0.5 m/s.
    assert gx.probes.Velocity(mass.port(), "x")(run) < 0.3


def test_a_taut_rope_decays_as_a_damped_oscillator():
    """Under a steady pull that keeps it taut: ẍ = -ω² x - 2ζω ẋ about the stretched length."""
    pull = 40.0
    x0 = 0.05
    start = L + pull / K + x0
    made, mass = scene(start, 0.0, lambda m: gx.loads.Force(m.port(), (pull, 0.0, 0.0)))
    run = gx.Simulation(made, gx.Midpoint(dt=1e-3))
    run.run(until=0.1)
    ω = math.sqrt(K / MASS)
    δ = C / (2 * MASS)
    ωd = math.sqrt(ω**2 - δ**2)
    exact = x0 * math.exp(-δ * 0.1) * (math.cos(ωd * 0.1) + δ / ωd * math.sin(ωd * 0.1))
    measured = gx.probes.Position(mass.port(), "x")(run) - L - pull / K
    # The phase error of the midpoint rule with 1 ms is below 2e-5 m of the amplitude of 0.05 m.
    assert measured == pytest.approx(exact, abs=2e-5)
    assert abs(run.energy_error) < 1e-12


@pytest.mark.mpi(1)
@pytest.mark.parametrize("damping", [0.1, 5.0, 100.0])
def test_a_bounce_on_a_rope_loses_energy_and_nothing_pushes(damping):
    """However strong the viscosity: the loss never falls, the ledger closes, the mass is never
    pushed outwards."""
    made, mass = scene(0.9, 2.0, damping=damping)
    run = gx.Simulation(made, gx.Midpoint(dt=2e-3))
    speeds = []
    losses = []
    for k in range(1, 100):
        run.run(until=k * 2e-3)
        speeds.append(gx.probes.Velocity(mass.port(), "x")(run))
        losses.append(run.totals.dissipated)
    assert (np.diff(losses) >= 0).all() and 0 < losses[-1] < run.first.energy
    assert (np.diff(speeds) <= 1e-12).all()  # the rope pulls inwards, or not at all
    assert speeds[-1] < 0 and abs(run.energy_error) < 1e-12


def test_the_tangent_of_a_damped_rope_is_the_derivative():
    rng = np.random.default_rng(1)
    numbers = {"c": 3.0, "k": 50.0, "L": 1.0}
    l0, l1 = 1 + 0.2 * rng.standard_normal((2, 200, 1))
    e0 = l0**2 / 2
    e1 = l1**2 / 2
    δ = 1e-6
    step = step_of(rope_damper, e0, e1, numbers, h=0.1)
    above = step_of(rope_damper, e0, e1 + δ, numbers, h=0.1).S
    below = step_of(rope_damper, e0, e1 - δ, numbers, h=0.1).S
    difference = (above - below) / (2 * δ)
    # Where the rope is just straight the force has a corner, and differences straddle it.
    smooth = abs(l1 - 1) > 1e-4
    assert step.dS[:, 0][smooth] == pytest.approx(difference[smooth], rel=1e-4, abs=1e-3)
    # Viscosity never adds energy: the sign of each pair's work.
    assert (step.S * (e1 - e0) >= 0).all()
    assert step.loss == pytest.approx((step.S * (e1 - e0))[:, 0], abs=1e-14)
