"""Dampers of the hub of IKAROS: the gradient of the energy of the swing against differences, and
the search."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demos.design import swing_damper
from demos.sails import ikaros

PITCH = 0.64
UNTIL = 3.0
DT = 0.25


def test_the_slope_of_the_energy_left_is_that_of_differences(comm):
    steady, _, _ = ikaros.steady(comm, PITCH, swing_damper.SPIN, held=False)

    def left(logarithm: float) -> swing_damper.Run:
        return swing_damper.swing(steady, comm, math.exp(logarithm), UNTIL, DT, PITCH)

    middle = left(0.5)
    step = 1e-3
    difference = (left(0.5 + step).energy - left(0.5 - step).energy) / (2 * step)
    assert middle.slope == pytest.approx(difference, rel=1e-4)
    assert middle.slope < 0
    # Energy is lost, and not below that of the steady spin.
    assert 0.0 < middle.share < 1.0


def test_more_damping_is_found_for_a_short_time(comm):
    """Within 3 s, a twelfth of an oscillation, the swing is damped best by dampers that are nearly
    a brake."""
    found = swing_damper.main(until=UNTIL, dt=DT, pitch=PITCH, start=1.0, iterations=3, comm=comm)
    assert found["damping [N s/m]"] > 1.0
    assert (
        found["energy left over that at the start"] < 0.7 * found["the same with the first damping"]
    )
    assert np.isfinite(found["slope at the end over the energy"])
