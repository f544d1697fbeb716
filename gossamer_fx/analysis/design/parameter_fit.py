"""Parameters of a scene from measured results, by least squares with exact derivatives, and their
uncertainty.

Problem.  Results J_i(θ) of one equilibrium, or of runs and equilibria that a function makes, shall
be those that were measured, y_i, within their uncertainties σ_i:

    minimise Σ r_i²,    r_i = (J_i(θ) - y_i)/σ_i

Algorithm.  The trust-region method of `scipy.optimize.least_squares` takes the Jacobian ∂r_i/∂θ,
each row of which is one transposed solve with known factors.  Near the solution it converges as
Newton's method does, also where the parameters are so nearly dependent that a method with gradients
only takes hundreds of iterations.

Uncertainty.  For small and independent errors of what was measured the covariance of the parameters
is

    C = (JᵀJ)⁻¹ max(1, s²),    s² = Σ r_i²/(m - n)                                            (1)

for m results and n numbers.  The scatter s is about 1 if model and uncertainties are right; a
larger one shows that they are not, and widens the errors.

Source: W. H. Press et al., Numerical Recipes, 3rd ed. (2007), section 15.4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.design.design_problem import (
    DesignProblem,
    EquilibriumSource,
    RunSource,
)
from gossamer_fx.analysis.sensitivity.results import Gradient
from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.core.checks.arguments import Range, at_least, check_arguments, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.short_repr import short_repr
from gossamer_fx.core.model.body import Array
from gossamer_fx.records.probes.objective import Objective


@check_arguments
@dataclass(frozen=True, eq=False)
class Fit:
    """Parameters that were fitted to measured results.

    Attributes:
        parameters: values by name; of a field those of this rank.
        errors: standard deviations of the values by name; of a field with a basis, of its amounts.
        amounts: of the columns of each basis, by name of the field.
        covariance: of all numbers in the order of the parameters (n, n).
        results: computed, in the order of what was measured (m,).
        residuals: (computed - measured)/uncertainty (m,).
        scatter: √(Σ residuals²/(m - n)); about 1 if the model and the uncertainties are right.
        iterations: evaluations of the Jacobian.

    Example:
        >>> found = gx.analysis.Fit(
        ...     parameters={"film.E": np.array([2.5e9])},
        ...     errors={"film.E": np.array([1e7])},
        ...     amounts={},
        ...     covariance=np.array([[1e14]]),
        ...     results=np.array([1.0]),
        ...     residuals=np.array([0.1]),
        ...     scatter=0.1,
        ...     iterations=4,
        ... )
        >>> found.errors["film.E"] / found.parameters["film.E"]
        array([0.004])
    """

    parameters: dict[str, Array]
    errors: dict[str, Array]
    amounts: dict[str, Array]
    covariance: Array
    results: Array
    residuals: Array
    scatter: float
    iterations: int

    __repr__ = short_repr


Uncertainty = Annotated[float, positive()] | Sequence[Annotated[float, positive()]]


@check_arguments
def fit(
    equilibrium: Equilibrium,
    *,
    of: Annotated[Sequence[Objective], at_least(1)],
    measured: Sequence[float],
    by: Sequence[str],
    uncertainty: Uncertainty = 1.0,
    bounds: Mapping[str, tuple[Any, Any]] | None = None,
    basis: Mapping[str, Any] | None = None,
    iterations: Annotated[int, Range(1)] = 50,
    tolerance: Annotated[float, Range(0.0, 1.0, above=True)] = 1e-10,
) -> Fit:
    """Fit parameters of a scene to measured results of its equilibrium, by least squares.

    The scene has the parameters afterwards and stands in their equilibrium.

    Args:
        equilibrium: its scene is changed; `find` is called by the fit, at the time of the present
            loads.
        of: results with derivatives, see `gx.analysis.gradient`.
        measured: their values (m,), in the units of the results.
        by: names of the parameters.
        uncertainty: standard deviation of what was measured, one number or one for each result.
        bounds: for parameters by name the smallest and the largest value; with a basis, of its
            amounts.
        basis: for fields by name the changes (k, m) that are combined, see `minimise`.
        iterations: at most.
        tolerance: relative change of the sum of squares, and of the parameters, at which the fit
            ends.

    Returns:
        the fitted parameters with their standard deviations, and the scatter of the results.

    Raises:
        InputError: lists of different length, fewer results than numbers, parameters that the
            results do not determine, or a field on several ranks without a basis.
        NoEquilibrium: parameters without an equilibrium.

    Example:
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> scene = gx.Scene(spring, gx.Gravity(mass, (0.0, 0.0, -10.0)))
        >>> height = gx.probes.Position(mass.port(), "z")
        >>> found = gx.analysis.fit(
        ...     gx.Equilibrium(scene),
        ...     of=[height],
        ...     measured=[-1.2],
        ...     uncertainty=0.01,
        ...     by=["spring.length"],
        ... )
        >>> found.parameters["spring.length"].round(6), found.errors["spring.length"].round(6)
        (array([1.1]), array([0.01]))
    """
    problem = DesignProblem("fit", EquilibriumSource(equilibrium, by), of[0], basis or {})

    def evaluate(x: Array) -> Iterator[tuple[float, Array]]:
        for objective in of:
            yield problem.evaluate(objective, x)

    return _solve(problem, evaluate, measured, uncertainty, bounds, iterations, tolerance)


@check_arguments
def fit_runs(
    evaluate: Callable[[dict[str, Array]], Sequence[Gradient]],
    start: Annotated[Mapping[str, Any], at_least(1)],
    *,
    measured: Sequence[float],
    uncertainty: Uncertainty = 1.0,
    bounds: Mapping[str, tuple[Any, Any]] | None = None,
    iterations: Annotated[int, Range(1)] = 50,
    tolerance: Annotated[float, Range(0.0, 1.0, above=True)] = 1e-10,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> Fit:
    """Fit parameters to measured results of runs, or of several equilibria, by least squares.

    Args:
        evaluate: function of the values of the parameters by name, arrays (k,), that makes runs or
            equilibria with them and returns the gradients of all results in the order of
            `measured`.
        start: first values by name, numbers or arrays.
        measured: values of the results (m,), in their units.
        uncertainty: standard deviation of what was measured, one number or one for each result.
        bounds: for parameters by name the smallest and the largest value.
        iterations: at most.
        tolerance: relative change of the sum of squares, and of the parameters, at which the fit
            ends.
        comm: ranks of the runs.

    Returns:
        the fitted parameters with their standard deviations, and the scatter of the results.

    Raises:
        InputError: no start values, another number of gradients than of measured values, fewer
            results than numbers, parameters that the results do not determine, or a field on
            several ranks.

    Example:
        >>> def areas(values):
        ...     side = values["square.side"]
        ...     slope = gx.analysis.Derivative("square.side", "m", 2 * side, None)
        ...     return [gx.analysis.Gradient(float(side[0] ** 2), "m²", (slope,))] * 2
        >>> found = gx.analysis.fit_runs(
        ...     areas, {"square.side": 1.0}, measured=[3.9, 4.1], uncertainty=0.1
        ... )
        >>> found.parameters["square.side"].round(6), round(found.scatter, 3)
        (array([2.]), 1.414)
    """
    source = _Series(evaluate, start, len(measured), comm)
    problem = DesignProblem("fit_runs", source, None, {})

    def rows(x: Array) -> Iterator[tuple[float, Array]]:
        for number in range(len(measured)):
            yield problem.evaluate(source.numbers[number], x)

    return _solve(problem, rows, measured, uncertainty, bounds, iterations, tolerance)


class _Series(RunSource):
    """Several results of the same runs: one call of `evaluate` gives the gradients of all.
    `numbers` are their indices 0, 1, ..., which stand for objectives; they are kept here because
    the problem knows results by the identity of these objects."""

    who = "fit_runs"

    def __init__(
        self,
        evaluate: Callable[[dict[str, Array]], Sequence[Gradient]],
        start: Mapping[str, Any],
        count: int,
        comm: MPI.Intracomm,
    ) -> None:
        super().__init__(self._make_runs, start, comm)
        self._all = evaluate
        self._count = count
        self._series: list[Gradient] = []
        self.numbers = list(range(count))

    def _make_runs(self, values: dict[str, Array]) -> Gradient:
        """Make the runs, keep the gradients of all results, and return the first."""
        self._series = list(self._all(values))
        check(
            len(self._series) == self._count,
            f"fit_runs: evaluate returned {len(self._series)} gradients; "
            f"{self._count} values were measured.",
        )
        return self._series[0]

    def gradient(self, objective: int | None) -> Gradient:
        """The gradient of the result of an index, of the runs with the present values."""
        first = super().gradient(None)
        # Without a number the problem asks for shapes of derivatives only.
        if objective is None:
            return first
        return self._series[objective]


def _solve(
    problem: DesignProblem,
    evaluate: Callable[[Array], Iterator[tuple[float, Array]]],
    measured: Sequence[float],
    uncertainty: float | Sequence[float],
    bounds: Mapping[str, tuple[Any, Any]] | None,
    iterations: int,
    tolerance: float,
) -> Fit:
    """Minimise Σ ((result - y)/σ)² over scaled numbers (p,), with measured values y (n,) and their
    uncertainties σ (n,); `evaluate` yields each result and its derivatives (p,).  The parameters
    stay at the fitted values; a fit that ends at the limit of iterations is returned as it is.
    Collective."""
    # Imported here, as most scenes do not need it.
    from scipy.optimize import least_squares

    who = problem.who
    y = np.array(measured, dtype=float)
    given = np.asarray(uncertainty, dtype=float)
    check(
        given.ndim == 0 or given.shape == y.shape,
        f"{who}: there are {given.size} uncertainties and {len(y)} measured values; "
        "give one number, or one for each value.",
    )
    σ = np.broadcast_to(given, y.shape)
    _check(problem, evaluate, y, σ)
    names = ", ".join(variable.name for variable in problem.variables)
    undetermined = (
        f"{who}: the results do not determine {names}; fit fewer parameters, or measure more."
    )

    def residuals(x: Array) -> Array:
        # SciPy divides by zero where a column of the Jacobian depends on others.
        check(bool(np.isfinite(x).all()), undetermined)
        values = np.array([value for value, _ in evaluate(x)])
        return (values - y) / σ

    def jacobian(x: Array) -> Array:
        slopes = np.array([slope for _, slope in evaluate(x)])
        return slopes / σ[:, None]

    found = least_squares(
        residuals,
        problem.start,
        jac=jacobian,
        bounds=problem.bounds(bounds or {}),
        # Columns of a basis and parameters of different kinds have different effects.
        x_scale="jac",
        max_nfev=iterations,
        ftol=tolerance,
        xtol=tolerance,
        gtol=None,
    )
    # The last trial step may have been refused.
    problem.move_to(found.x)
    # With as many numbers as results no degree of freedom is left for a scatter.
    scatter = 0.0
    spare = len(y) - len(found.x)
    if spare:
        scatter = math.sqrt(float(found.fun @ found.fun) / spare)
    check(bool(np.linalg.matrix_rank(found.jac) == len(found.x)), undetermined)
    covariance = np.linalg.inv(found.jac.T @ found.jac) * max(1.0, scatter) ** 2
    # Of the scaled numbers, so far.
    deviations = np.sqrt(np.diag(covariance))
    errors: dict[str, Array] = {}
    scales = []
    for variable, part in problem.parts(deviations):
        errors[variable.name] = np.array(part * variable.scale)
        scales.append(np.full(variable.size, variable.scale))
    scale = np.concatenate(scales)
    return Fit(
        parameters=problem.parameters(found.x),
        errors=errors,
        amounts=problem.amounts(found.x),
        covariance=covariance * scale * scale[:, None],
        results=found.fun * σ + y,
        residuals=found.fun,
        scatter=scatter,
        iterations=int(found.njev),
    )


def _check(
    problem: DesignProblem,
    evaluate: Callable[[Array], Iterator[tuple[float, Array]]],
    y: Array,
    σ: Array,
) -> None:
    """Refuse measured values y (n,) and standard deviations σ (n,) that do not fit the results that
    `evaluate` yields, more numbers than results, and fields over several ranks.  Collective."""
    who = problem.who
    count = sum(1 for _ in evaluate(problem.start))
    check(
        count == len(y),
        f"{who}: there are {count} results and {len(y)} measured values; give as many.",
    )
    problem.refuse_distributed("give a basis")
    check(
        problem.size <= len(y),
        f"{who}: {problem.size} numbers are fitted to {len(y)} results; "
        "fit fewer, or measure more.",
    )
