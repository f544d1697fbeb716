"""The generalised-α method is second order, and drifts where the midpoint rule does not."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from meshes.sheet import sheet

COMM = MPI.COMM_WORLD


def oscillator(stepper) -> float:
    """Error of x at t = 1 s of x'' = -100 x, from x = 1 at rest."""
    mass = gx.PointMass(1.0, (1.0, 0.0, 0.0))
    run = gx.Simulation(gx.Scene(mass, gx.AxialSpring(mass.port(), 100.0, (1.0, 0.0, 0.0))), stepper)
    run.run(until=1.0)
    return abs(float(run.system.q0.array_r[0]) - np.cos(10.0))


def test_second_order() -> None:
    errors = [oscillator(gx.GeneralizedAlpha(dt=dt, spectral_radius=0.8)) for dt in (4e-3, 2e-3, 1e-3)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2, abs=0.1)


def fluttering(stepper) -> float:
    """Closing error of the ledger of a spinning, fluttering film after 0.1 s."""
    law = gx.Miyazaki(E=1e7, nu=0.3, density=1400.0, thickness=1e-4, residual=1e-3)
    film = gx.Membrane(
        sheet(COMM, 4, 4),
        law,
        velocity=lambda x: np.vstack([-10 * (x[1] - 0.5), 10 * (x[0] - 0.5), np.sin(np.pi * x[0])]),
    )
    run = gx.Simulation(gx.Scene(film), stepper)
    run.run(until=0.1)
    return abs(run.energy_error)


def test_drifts_where_the_midpoint_rule_does_not() -> None:
    assert fluttering(gx.Midpoint(dt=2e-3)) < 1e-12
    assert fluttering(gx.GeneralizedAlpha(dt=2e-3, spectral_radius=0.8)) > 1e-6


def test_constraints_are_refused() -> None:
    body = gx.RigidBody(1.0, (1.0, 1.0, 1.0))
    with pytest.raises(gx.InputError, match="use Midpoint"):
        gx.Simulation(gx.Scene(body), gx.GeneralizedAlpha(dt=0.1))
