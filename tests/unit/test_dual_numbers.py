"""Dual numbers differentiate formulas as calculus does, also formulas with a complex step
inside."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from gossamer_fx.core.algebra.dual_numbers import Dual, jacobian, variables
from gossamer_fx.mechanics.gas.openings import isentropic_flow
from gossamer_fx.presets.gases import NITROGEN

FORMULAS = [
    (lambda x, y: 3 * x * y - y / x + 2, (0.7, 1.3)),
    (lambda x, y: 1 / (1 + x**2) - (5 - y) ** 0.5, (0.7, 1.3)),
    (lambda x, y: -(x - y) * (x + y) / (2 * y), (2.0, -3.0)),
]


@pytest.mark.parametrize(("formula", "point"), FORMULAS)
def test_values_and_slopes_are_those_of_calculus(formula, point) -> None:
    found = formula(*variables(np.array(point)))
    assert found.value == pytest.approx(formula(*point), rel=1e-15)
    for i, orders in enumerate([(1, 0), (0, 1)]):
        exact = mpmath.diff(formula, point, orders)
        # Numerical differences of mpmath have ten digits at its usual precision.
        assert found.slopes[i] == pytest.approx(float(exact), rel=1e-10)


def test_a_complex_step_inside_gives_second_derivatives() -> None:
    """∂ṁ/∂p_u by a complex step, and its derivatives by p_u and p_d, of a flow that is not
    choked."""
    ε = 1e-30
    pu, pd = variables(np.array([1e5, 8e4]))
    slope = isentropic_flow(NITROGEN, pu + 1j * ε, 300.0, pd, 1e-5).imag / ε

    def flow(a, b):
        return isentropic_flow(NITROGEN, mpmath.mpf(a), 300.0, mpmath.mpf(b), 1e-5)

    with mpmath.workdps(40):
        for i, orders in enumerate([(2, 0), (1, 1)]):
            exact = mpmath.diff(flow, (1e5, 8e4), orders)
            assert slope.slopes[i] == pytest.approx(float(exact), rel=1e-9)


def test_branches_are_taken_by_values_and_plain_numbers_have_no_slopes() -> None:
    x, y = variables(np.array([1.0, 2.0]))
    assert x < y
    assert x <= 1.0
    assert y > 1.5
    assert y >= x
    assert not y < 2.0
    # d(xy) = y dx + x dy = 2 dx + dy; the number 4 has no derivative.
    values = np.array([x * y, 4.0], dtype=object)
    assert np.array_equal(jacobian(values, 2), [[2, 1], [0, 0]])
    complex_number = Dual(1 + 2j, np.array([3 + 4j]))
    assert complex_number.imag.slopes[0] == 4.0
    small = Dual(0.1, np.array([1.0]))
    assert small.expm1().slopes[0] == pytest.approx(np.exp(0.1))
