"""Which Newton iterations are given up before their last iterate."""

from __future__ import annotations

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.solve.solvers.newton import Newton

# Residuals [N] that come down and then alternate, as those of film that switches its state.
STALLED = [40.0, 1.0, 0.1, *[0.2, 0.09, 0.3, 0.15] * 2]

# Iterations that are allowed: two fifths of them are as many as alternate.
ALLOWED = 20

SHARES = [1.0] * (len(STALLED) - 1)


def newton_of(comm, friction: float = 0.0) -> Newton:
    """The solver of a film above a floor, at rest, with a tolerance of 1e-9 N."""
    film = gx.Membrane(
        sheet(comm, 2, 2), gx.Linear(1e6, 0.3, density=1e3, thickness=1e-4), name="film"
    )
    floor = gx.contact.Plane(point=(0, 0, -0.01), normal=(0, 0, 1))
    contact = gx.Contact(film, floor, distance=1e-3, friction=friction)
    run = gx.Simulation(
        gx.Scene(film, contact),
        gx.Midpoint(dt=1e-3, tolerances=gx.Tolerances(absolute=1e-9, max_iterations=ALLOWED)),
    )
    run.run(until=1e-3)
    return run.solver.newton


@pytest.mark.mpi
def test_residuals_that_no_longer_fall_are_given_up(comm) -> None:
    newton = newton_of(comm)
    newton._norm = STALLED[-1]
    newton._norms = STALLED
    newton._kept_shares = SHARES
    assert newton._has_stalled()
    # Contact shortens all updates much: the iteration is on its way.
    newton._kept_shares = [0.3] * len(SHARES)
    assert not newton._has_stalled()
    newton._kept_shares = SHARES
    # The residual falls again.
    newton._norms = [*STALLED[:-4], 60.0, 40.0, 25.0, 15.0]
    newton._norm = newton._norms[-1]
    assert not newton._has_stalled()
    # One residual below 0.7 of the least one before, and the iteration goes on.
    for ratio, has_stalled in ((0.69, False), (0.71, True)):
        newton._norms = [*STALLED[:-4], 0.09, 0.3, 0.2, ratio * 0.1]
        newton._norm = newton._norms[-1]
        assert newton._has_stalled() == has_stalled


def test_a_first_residual_of_round_off_does_not_count(comm) -> None:
    """The predictor may be nearly exact: then the first residual is the least of all."""
    newton = newton_of(comm)
    # The last four are equal: they do not fall again.
    falling = 10.0 ** -np.minimum(np.arange(10), 6)
    newton._norms = [1e-12, *falling]
    newton._norm = falling[-1]
    assert not newton._has_stalled()


def test_friction_may_stay_at_one_residual(comm) -> None:
    newton = newton_of(comm, friction=0.3)
    newton._norms = STALLED
    newton._kept_shares = SHARES
    newton._norm = STALLED[-1]
    assert not newton._has_stalled()


def test_residuals_within_the_tolerance_wait_for_the_other_tests(comm) -> None:
    newton = newton_of(comm)
    newton._norms = [1.0, *[1e-10] * ALLOWED]
    newton._norm = 1e-10
    assert not newton._has_stalled()
