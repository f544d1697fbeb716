"""Laws compiled from plain Python functions: exact derivatives on both sides of every branch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import mesh
from mpi4py import MPI

from gossamer_fx.core.checks.errors import InputError
from gossamer_fx.core.forms.backend import evaluate
from gossamer_fx.core.forms.compilation import compile_expression, constant
from gossamer_fx.core.laws.law import compile_law
from gossamer_fx.core.laws.tracing import as_ufl, at_most, root

WORLD = MPI.COMM_WORLD


def choked(p: Any, q: Any, T: Any, R: Any, gamma: Any, laminar: Any) -> Any:
    """Flow of a nozzle from the higher of two pressures, linear near rest."""
    if p < q:
        return -choked(q, p, T, R, gamma, laminar)
    x = q / p
    scale = p / np.sqrt(R * T)
    if x <= (2 / (gamma + 1)) ** (gamma / (gamma - 1)):
        return scale * gamma**0.5 * (2 / (gamma + 1)) ** ((gamma + 1) / (2 * (gamma - 1)))
    if 1 - x >= laminar:
        return scale * (x ** (2 / gamma) - x ** ((gamma + 1) / gamma)) ** 0.5
    limit = 1 - laminar
    slope = (limit ** (2 / gamma) - limit ** ((gamma + 1) / gamma)) ** 0.5 / laminar
    return scale * slope * (1 - x)


def points(number: int) -> list[list[float]]:
    """Arguments of `choked`: far from its branches, near each of them, and at equal pressures."""
    rng = np.random.default_rng(number)
    p = 10 ** rng.uniform(3, 6)
    ratios = [rng.uniform(0, 1), 1 / rng.uniform(0, 1), 1.0, 1 - 10 ** rng.uniform(-9, -2)]
    ratios += [0.999 * (1 + 1e-12), 0.999 * (1 - 1e-12)]
    others = [rng.uniform(100, 900), rng.uniform(100, 4000), rng.uniform(1.05, 1.67), 1e-3]
    return [[p, p * ratio, *others] for ratio in ratios]


def complex_steps(law: Callable[..., Any], x: list[float]) -> np.ndarray:
    """Derivatives of a law of one output by all of its arguments."""
    slopes = []
    for column in range(len(x)):
        varied = np.array(x, dtype=complex)
        varied[column] += 1e-30j
        # NumPy compares complex numbers by their real parts first.
        slopes.append(law(*varied).imag / 1e-30)
    return np.array(slopes)


@pytest.mark.mpi(1)
def test_derivatives_are_exact_near_branches() -> None:
    names = ("p", "q", "T", "R", "gamma", "laminar")
    law = compile_law(choked, by=names, comm=WORLD)
    assert law.derivatives == "compiled"
    for number in range(100):
        for x in points(number):
            value, slopes = law(*x)
            exact = complex_steps(choked, x)
            assert value[0] == pytest.approx(choked(*np.array(x)), rel=1e-12, abs=1e-300)
            # Relative to the largest change by any of the arguments
            size = abs(exact * x).max()
            assert abs((slopes[0] - exact) * x).max() <= 1e-12 * size


def test_second_derivatives_are_those_of_the_first() -> None:
    names = ("p", "q", "T", "R", "gamma", "laminar")
    law = compile_law(choked, by=names, orders=2, comm=WORLD)
    for x in points(3)[:2]:
        _, _, second = law(*x)
        assert abs(second[0] - second[0].T).max() <= 1e-12 * abs(second).max()
        for column, value in enumerate(x):
            step = 1e-6 * value
            above = [*x[:column], value + step, *x[column + 1 :]]
            below = [*x[:column], value - step, *x[column + 1 :]]
            difference = (law(*above)[1] - law(*below)[1])[0] / (2 * step)
            size = abs(difference * x).max()
            assert abs((second[0][column] - difference) * x).max() <= 1e-6 * size


def friction(M: Any) -> Any:
    return (1 - M * M) / M**2 + np.log(M * M)


def test_derivatives_of_an_implicit_law() -> None:
    """F(M) = a and M² = b F(M₂): the derivatives of the second root go through the first."""

    def law(a: Any, b: Any) -> Any:
        first = root(lambda M: friction(M) - a, 0.0, 1.0)
        second = root(lambda M: friction(M) - b / first, 0.0, first)
        return second * a, first

    compiled = compile_law(law, by=("a", "b"), orders=2, comm=WORLD, output_count=2)
    assert compiled.derivatives == "compiled"
    for a, b in ((0.5, 2.0), (1e4, 500.0), (1e-3, 9.0)):
        value, slopes, second = compiled(a, b)
        expected = [complex(number).real for number in law(a, b)]
        assert value == pytest.approx(expected, rel=1e-10)
        by_a = np.array(law(a + 1e-30j, b)).imag / 1e-30
        by_b = np.array(law(a, b + 1e-30j)).imag / 1e-30
        assert slopes[:, 0] == pytest.approx(by_a, rel=1e-7)
        assert slopes[:, 1] == pytest.approx(by_b, rel=1e-7)
        step = 1e-5 * b
        difference = (compiled(a, b + step)[1] - compiled(a, b - step)[1]) / (2 * step)
        assert second[:, :, 1] == pytest.approx(difference, rel=1e-6, abs=1e-12)


def test_what_cannot_be_traced_names_its_derivatives() -> None:
    def by_table(x: Any) -> Any:
        return np.interp(x, [0.0, 1.0], [2.0, 5.0])

    def by_complex(x: Any) -> Any:
        # A symbol has no `conjugate`
        return (x + x.conjugate() * 0 if isinstance(x, float | complex) else x.conjugate()) ** 3

    def loses(x: Any) -> Any:
        return float(x.real) ** 2

    for function, kind, slope in (
        (by_table, "differences", 3.0),
        (by_complex, "complex steps", 0.27),
        (loses, "differences", 0.6),
    ):
        law = compile_law(function, by=("x",), comm=WORLD)
        value, slopes = law(0.3)
        assert law.derivatives == kind
        assert value[0] == function(0.3)
        assert slopes[0, 0] == pytest.approx(slope, rel=1e-8)


def test_errors_of_a_law_come_through_c() -> None:
    def law(x: float) -> float:
        if not isinstance(x, float):
            raise TypeError
        raise InputError("The valve is not there.")

    with pytest.raises(InputError, match="valve"):
        compile_law(law, by=("x",), comm=WORLD)(1.0)


def test_loops_that_end_by_a_comparison_are_called_back() -> None:
    def law(x: Any) -> Any:
        while abs(x) > 1.0:
            x = x / 2
        return x

    compiled = compile_law(law, by=("x",), comm=WORLD)
    value, slopes = compiled(5.0)
    assert compiled.derivatives != "compiled"
    assert (value[0], slopes[0, 0]) == (0.625, pytest.approx(0.125))


def test_a_table_of_many_points_has_no_branches() -> None:
    """`at_most` selects; the slopes are those of the piece in which x lies, also at its end."""
    points = np.linspace(0.0, 10.0, 101)

    def table(x: Any, scale: Any) -> Any:
        value: Any = points[-1] ** 2
        for low, high in zip(points[-2::-1], points[:0:-1], strict=True):
            inside = low**2 + (high + low) * (x - low)
            value = at_most(x, high, holds=inside, fails=value)
        return scale * at_most(x, 0.0, holds=0.0, fails=value)

    law = compile_law(table, by=("x", "scale"), comm=WORLD)
    assert law.derivatives == "compiled"
    for x in (-1.0, 0.05, 3.123, 3.2, 9.99, 11.0):
        value, slopes = law(x, 2.0)
        assert value[0] == pytest.approx(table(x, 2.0), rel=1e-13)
        piece = points[:-1] + points[1:]
        inside = 0 < x <= 10
        expected = 2.0 * piece[int(np.ceil(x / 0.1 - 1e-9)) - 1] if inside else 0.0
        assert slopes[0] == pytest.approx([expected, table(x, 1.0)], rel=1e-12)


def test_names_of_derivatives_are_checked() -> None:
    with pytest.raises(
        InputError,
        match=r"A law has no argument 'pressure'; its arguments are: p, q, T, R, gamma, laminar\.",
    ):
        compile_law(choked, by=("pressure",), comm=WORLD)


@pytest.mark.mpi(1)
def test_a_law_in_a_form() -> None:
    interval = mesh.create_interval(WORLD, 2 * WORLD.size, [0.0, 1.0])
    x = points(1)[0]
    arguments = [constant(interval, value) for value in x]
    expression = compile_expression(as_ufl(choked, *arguments), np.array([[0.5]]))
    value = evaluate(expression, interval, np.array([0], dtype=np.int32))
    assert float(value.ravel()[0]) == pytest.approx(choked(*x), rel=1e-12)


def test_expm1_does_not_cancel() -> None:
    law = compile_law(lambda x: np.expm1(x), by=("x",), comm=WORLD)
    assert law(1e-9)[0][0] == pytest.approx(np.expm1(1e-9), rel=1e-15)
    assert isinstance(as_ufl(lambda x: x * 2, ufl.as_ufl(1.0)), ufl.core.expr.Expr)
