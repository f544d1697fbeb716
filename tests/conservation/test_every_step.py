"""Energy and momenta are conserved for every step: round-off grows neither as 1/h² nor with the
distance to 0."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from tests.small_scenes import run_until

# Over four decades: 1/h² grows by 1e8, so that any such round-off would show.
STEPS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
FAR = 7e6  # m: the radius of an orbit; its unit in the last place is 1e-9 m


def errors(scene: gx.Scene, h: float, steps: int) -> tuple[float, float]:
    """Closing error of the energy, and change of the angular momentum over its size."""
    run = gx.Simulation(scene, gx.Midpoint(dt=h))
    run.run(until=steps * h)
    H0 = run.first.angular_momentum
    H = run.totals.angular_momentum
    return abs(run.energy_error), float(np.linalg.norm(H - H0) / np.linalg.norm(H0))


@pytest.mark.parametrize("h", STEPS)
def test_free_rigid_body(comm, h):
    body = gx.RigidBody(1.0, (0.6, 1.1, 1.5), spin=(1.5, 0.0, 0.5))
    # Two seconds, or 300 steps.
    # A few hundred steps at 1e-16 each.
    assert max(errors(gx.Scene(body), h, min(round(2 / h), 300))) < 1e-13


def test_one_iteration_is_enough_where_no_more_are_allowed(comm):
    """It leaves 3e-13 of the first residual, of which a second one would leave round-off."""
    left = gx.PointMass(1e-3, velocity=(0.0, -0.01, 0.0), name="left")
    right = gx.PointMass(1e-3, (0.1, 0.0, 0.0), velocity=(0.0, 0.01, 0.0), name="right")
    spring = gx.connectors.Spring(left.port(), right.port(), stiffness=1.0, length=0.09)
    tolerances = gx.Tolerances(max_iterations=1)
    run = run_until(0.03, left, right, spring, dt=3e-3, tolerances=tolerances, halvings=0)
    assert run.iterations == run.step == 10
    assert abs(run.energy_error) < 1e-12


@pytest.mark.parametrize("spring", ["axial", "to the ground", "between masses"])
@pytest.mark.parametrize("h", STEPS)
def test_oscillator_far_from_the_origin(comm, h, spring):
    """Its amplitude of 0.5 m is known to 2e-9 of itself, its energy to 4e-9 in each step."""
    mass = gx.PointMass(1.0, (FAR + 1.5, 0.0, 0.0))
    centre = (FAR, 0.0, 0.0)
    if spring == "axial":
        spring = gx.connectors.AxialSpring(
            mass.port(),
            40.0,
            direction=(1.0, 0.0, 0.0),
            origin=(FAR + 1.0, 0.0, 0.0),
        )
    else:
        other = (
            gx.PointMass(1.0, centre, name="other").port()
            if spring == "between masses"
            else gx.Ground(centre)
        )
        spring = gx.connectors.Spring(mass.port(), other, stiffness=40.0, length=1.0)
    run = run_until(200 * h, mass, spring, dt=h)
    # The docstring's 4e-9 a step, with chance signs over 200 steps.
    assert abs(run.energy_error) < 4e-9 * np.sqrt(200)


def wrinkling_film(comm) -> gx.Membrane:
    return gx.Membrane(
        sheet(comm, 6, 6),
        gx.Miyazaki(1e9, 0.3, density=1400.0, thickness=1e-4),
        velocity=lambda X: np.vstack([0 * X[0], 0 * X[0], 3 * np.sin(3 * X[0]) * np.cos(2 * X[1])]),
    )


@pytest.mark.parametrize("h", STEPS[2:])
def test_film_that_wrinkles(comm, h):
    assert max(errors(gx.Scene(wrinkling_film(comm)), h, 40)) < 1e-13


# With energy = 0.9 the test on the energy never acts; with 1e-12 it closes the balance.
@pytest.mark.parametrize("energy, least, most", [(0.9, 1e-10, 1e-6), (1e-12, 0.0, 1e-10)])
def test_a_step_far_too_long_closes_by_the_work_of_its_residual(comm, energy, least, most):
    """Its predictor is so bad that a residual of 1e-10 of the predictor's, which is enough
    otherwise, does work."""
    tolerances = gx.Tolerances(energy=energy)
    run = run_until(2.0, wrinkling_film(comm), dt=0.1, tolerances=tolerances)
    assert least <= abs(run.energy_error) < most
