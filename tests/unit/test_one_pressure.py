"""The one-dimensional gas against which the study `one_pressure` judges compartments."""

from __future__ import annotations

import numpy as np
import pytest

from demos.studies import one_pressure
from demos.studies.one_pressure import AIR, HIGH, WARM
from tests.rates import observed_order


def test_the_exact_shock_tube_has_the_values_of_the_literature():
    """E. F. Toro, Riemann Solvers and Numerical Methods for Fluid Dynamics (3rd ed. 2009), table
    4.3, test 1 (in units of the high pressure): 0.30313 between the waves."""
    found = one_pressure.sod_pressure(np.array([0.1, 0.6, 0.8, 0.95]), one_pressure.SOD_TIME)
    assert found / HIGH == pytest.approx([1.0, 0.30313, 0.30313, 0.1], abs=1e-5)


def test_finite_volumes_converge_to_the_exact_shock_tube():
    cells = [50, 100, 200]
    errors = [one_pressure.finite_volume_error(n) for n in cells]
    # At shocks every scheme is of first order.
    assert observed_order(1 / np.array(cells), errors) == pytest.approx(1, abs=0.15)


@pytest.mark.parametrize("mach", [0.2, 0.6, 0.95])
def test_a_steady_flow_passes_the_full_inlet_unchanged(mach):
    """Behind an isentropic inlet of the whole cross section the flux is that of the tube."""
    T = WARM / (1 + 0.2 * mach**2)
    p = HIGH * (T / WARM) ** 3.5
    u = mach * (AIR.gamma * AIR.R * T) ** 0.5
    state = (p / (AIR.R * T), u, p)
    flux = one_pressure.physical_flux(np.array(state)[:, None])[:, 0]
    assert one_pressure.inlet_flux(1.0, state) == pytest.approx(flux, rel=1e-6)


def test_a_slow_filling_is_that_of_one_pressure():
    """Through an inlet of a hundredth of the cross section the pressure is uniform within 1 %, and
    the gas takes the same time."""
    found = one_pressure.problem(None, "inlet 0.01", 1)
    assert 0 < found["difference"] < 0.81e-2
    assert found["t90/1-D"] == pytest.approx(1, abs=1e-3)


def test_a_chain_of_wide_openings_fills_later_than_a_smooth_tube():
    """Each opening takes the dynamic pressure of its flow."""
    late = [one_pressure.problem(None, "inlet 1", n)["t90/1-D"] for n in (1, 4)]
    assert late[0] < 1.0 < late[1]
