"""The midpoint rule is of second order in h where the motion is smooth: a taut film that never
wrinkles."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.studies.time_order import TAUT, taut_sheet
from tests.rates import observed_order

LINEAR = gx.Linear(**TAUT)
MIYAZAKI = gx.Miyazaki(**TAUT)
UNTIL = 1e-3  # s, a quarter of a period of the lowest mode


def drum(
    law: gx.Linear | gx.Miyazaki, dt: float, order: int = 1, n: int = 4
) -> tuple[np.ndarray, gx.Simulation]:
    """Positions and velocities [m], [m/s] of a stretched square film after a blow, its edges
    held."""
    run = gx.Simulation(taut_sheet(MPI.COMM_SELF, law, order, n), gx.Midpoint(dt=dt))
    run.run(until=UNTIL)
    return np.array([run.system.unknowns.q0.array_r, run.system.unknowns.v0.array_r]), run


@pytest.mark.parametrize(
    "law, order",
    [(LINEAR, 1), (LINEAR, 2), (MIYAZAKI, 1)],
    ids=["P1", "P2", "P1 Miyazaki"],
)
def test_positions_and_velocities_converge_with_order_two(law, order):
    n = 4 // order
    steps = [5e-5, 2.5e-5, 1.25e-5, 6.25e-6]
    # A fifth of the finest step serves as exact: its error is 4 % of that of the finest.
    exact, _ = drum(law, 1.25e-6, order, n)
    errors = []
    for h in steps:
        found, run = drum(law, h, order, n)
        errors.append(np.sqrt(((found - exact) ** 2).mean(axis=1)))
        # Energy is exact for any step.
        assert abs(run.energy_error) <= 1e-12
    print(np.array(errors))
    for position_or_velocity in np.array(errors).T:
        # The order between each two steps, and over all of them.
        assert -np.diff(np.log2(position_or_velocity)) == pytest.approx(np.full(3, 2.0), abs=0.2)
        assert observed_order(steps, position_or_velocity) == pytest.approx(2, abs=0.1)


def test_taut_film_moves_as_one_that_cannot_wrinkle():
    """Path average and correction add nothing, not even noise: the same motion, in as many
    iterations."""
    (linear, run_linear), (wrinkling, run_wrinkling) = (
        drum(law, 5e-5) for law in (LINEAR, MIYAZAKI)
    )
    error = abs(linear - wrinkling).max()
    # Round-off of two code paths for one law.
    assert error <= 1e-10 * abs(linear).max()
    assert run_wrinkling.iterations <= run_linear.iterations + 5 and run_wrinkling.substeps == 0
