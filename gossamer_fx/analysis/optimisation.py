"""Minimisation of a result of an equilibrium by its exact gradients, with methods of SciPy.

The parameters are divided by their size, so that their changes are comparable.  In each evaluation the
parameters of the compiled scene are set, the equilibrium is found again from the last one, and one
transposed system is solved for the result and one for each constraint.
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gossamer_fx.analysis.equilibrium import Equilibrium
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import InputError, check
from gossamer_fx.model.body import Array
from gossamer_fx.sensitivity.objectives import Objective
from gossamer_fx.sensitivity.static import StaticGradients

LOGGER = logging.getLogger("gossamer_fx")

TINY = 1e-300  # against division by zero


@check_arguments
@dataclass(frozen=True, eq=False)
class Limit:
    """A result that a minimisation keeps within limits, a constraint.

    Args:
        of: a result with derivatives.
        low: smallest value, in the unit of the result.
        high: largest value; equal to `low` for a result that is to have a given value.

    Raises:
        InputError: no limit, or low above high.

    Example:
        >>> gx.analysis.Limit(gx.analysis.Energy(), high=2.0).high
        2.0
    """

    of: Objective
    _: KW_ONLY
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        check(
            self.low <= self.high and (self.low > -math.inf or self.high < math.inf),
            f"Limit: low is {self.low!r} and high is {self.high!r}; give one of them, or both in this order.",
        )


@check_arguments
@dataclass(frozen=True, eq=False)
class Optimum:
    """What a minimisation has found; the scene has its parameters and stands in its equilibrium.

    Attributes:
        value: the result.
        parameters: values by name.
        iterations: of the method.
        converged: whether the method ended by its tolerance.
        message: how it ended, in words of SciPy.
        values: the result after each iteration, that of the start first.

    Example:
        >>> gx.analysis.Optimum(0.0, {}, iterations=3, converged=True, message="").iterations
        3
    """

    value: float
    parameters: dict[str, Array]
    iterations: int
    converged: bool
    message: str
    values: list[float] = field(default_factory=list)


@check_arguments
def minimise(
    equilibrium: Equilibrium,
    *,
    of: Objective,
    by: Sequence[str],
    bounds: Mapping[str, tuple[Any, Any]] | None = None,
    limits: Sequence[Limit] = (),
    iterations: int = 100,
    tolerance: float = 1e-8,
    record: str | Path | None = None,
    restart: bool = False,
) -> Optimum:
    """Change parameters of a scene so that a result of its equilibrium gets least.

    Without limits the method is L-BFGS-B of `scipy.optimize`, with limits SLSQP.  It finds a local
    minimum near the start.

    Args:
        equilibrium: its scene is changed; `find` is called by the minimisation.
        of: a result with derivatives, see `gx.analysis.gradient`.
        by: names of the parameters.
        bounds: for parameters by name the smallest and the largest value, numbers or arrays.
        limits: results that are to stay within limits.
        iterations: at most.
        tolerance: relative change of the result at which the search ends.
        record: file to which the parameters are written after each iteration (JSON); rank 0 writes.
        restart: whether to start from the parameters in this file.

    Raises:
        InputError: a name that the scene has not, bounds of something else, no file to restart from, or a
            field on several ranks.
        NoEquilibrium: parameters without an equilibrium.

    Example:
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> scene = gx.Scene(spring, gx.Gravity(mass, (0.0, 0.0, -10.0)))
        >>> height = gx.probes.Position(mass.port(), "z")
        >>> from_wanted = gx.analysis.Functional(
        ...     lambda run: (height(run) + 1.5) ** 2,
        ...     lambda run: {mass: np.array([0.0, 0.0, 2 * (height(run) + 1.5)])},
        ...     unit="m²",
        ... )
        >>> found = gx.analysis.minimise(
        ...     gx.Equilibrium(scene), of=from_wanted, by=["spring.length"], tolerance=1e-14
        ... )
        >>> found.parameters["spring.length"].round(4)
        array([1.4])
    """
    from scipy import optimize

    check(iterations > 0, f"minimise: iterations is {iterations!r}; give a positive number.")
    check(
        0 < tolerance < 1,
        f"minimise: tolerance is {tolerance!r}; give a number between 0 and 1.",
    )
    problem = _Problem(equilibrium, of, by, limits, None if record is None else Path(record))
    if restart:
        problem.read()
    start = problem.start
    box = problem.box(bounds or {})
    LOGGER.info("minimise: %d parameters, value %.9g", len(start), problem.value(start))
    problem.values.append(problem.value(start))
    options: dict[str, Any] = {"maxiter": iterations, "ftol": tolerance}
    method = "L-BFGS-B"
    constraints: list[dict[str, Any]] = []
    if limits:
        method = "SLSQP"
        constraints = problem.constraints()
    else:
        # The scaled gradient may fall far below one before the value stands still.
        options["gtol"] = 0.0
    found = optimize.minimize(
        problem.scaled,
        start,
        jac=True,
        method=method,
        bounds=box,
        constraints=constraints,
        options=options,
        callback=problem.note,
    )
    problem.move_to(found.x)
    return Optimum(
        value=problem.value(found.x),
        parameters=problem.parameters(),
        iterations=int(found.nit),
        converged=bool(found.success),
        message=str(found.message),
        values=problem.values,
    )


class _Problem:
    """The result and its constraints as functions of one scaled vector of parameters."""

    def __init__(
        self,
        equilibrium: Equilibrium,
        of: Objective,
        by: Sequence[str],
        limits: Sequence[Limit],
        record: Path | None,
    ) -> None:
        self._equilibrium = equilibrium
        self._comm = equilibrium.comm
        self._of = of
        self._limits = limits
        self._record = record
        equilibrium.find()
        self._gradients = StaticGradients(equilibrium, by)
        self._variables = self._gradients.variables
        for variable in self._variables:
            check(
                self._comm.size == 1 or not variable.is_distributed,
                f"minimise: '{variable.name}' is a field, which is distributed over {self._comm.size} ranks; use one "
                "rank.",
            )
        self._scales = [
            float(np.abs(variable.get()).max(initial=0.0)) or 1.0 for variable in self._variables
        ]
        self.start = self._scaled_parameters()
        self._at: Array | None = None
        self._known: dict[int, tuple[float, Array]] = {}
        self._scale_of_value = 1.0
        self._scale_of_value = max(abs(self.value(self.start)), TINY)
        self.values: list[float] = []

    def _scaled_parameters(self) -> Array:
        pairs = zip(self._variables, self._scales, strict=True)
        return np.concatenate([variable.get() / scale for variable, scale in pairs])

    def _parts(self, x: Array) -> list[Array]:
        ends = np.cumsum([len(variable.get()) for variable in self._variables])
        return np.split(x, ends[:-1])

    def move_to(self, x: Array) -> None:
        """Set the parameters and find the equilibrium, unless it is known.  Collective."""
        if self._at is not None and np.array_equal(x, self._at):
            return
        for variable, part, scale in zip(
            self._variables, self._parts(x), self._scales, strict=True
        ):
            variable.set(part * scale)
        self._equilibrium.system.parameters_changed()
        self._equilibrium.find()
        self._gradients.factorise()
        self._at = np.array(x)
        self._known = {}

    def _evaluate(self, objective: Objective, x: Array) -> tuple[float, Array]:
        """A result and its scaled gradient."""
        self.move_to(x)
        if id(objective) not in self._known:
            found = self._gradients.of(objective)
            pairs = zip(found, self._scales, strict=True)
            slope = np.concatenate([derivative.values * scale for derivative, scale in pairs])
            self._known[id(objective)] = (found.value, slope)
        return self._known[id(objective)]

    def value(self, x: Array) -> float:
        """The result."""
        return self._evaluate(self._of, x)[0]

    def scaled(self, x: Array) -> tuple[float, Array]:
        """The result over its size at the start, and its gradient."""
        value, slope = self._evaluate(self._of, x)
        return value / self._scale_of_value, slope / self._scale_of_value

    def box(self, bounds: Mapping[str, tuple[Any, Any]]) -> list[tuple[float, float]] | None:
        """The bounds of the scaled parameters."""
        names = [variable.name for variable in self._variables]
        for name in bounds:
            check(name in names, f"minimise: bounds has '{name}', which is not in by.")
        if not bounds:
            return None
        found: list[tuple[float, float]] = []
        for variable, scale in zip(self._variables, self._scales, strict=True):
            low, high = bounds.get(variable.name, (-math.inf, math.inf))
            size = len(variable.get())
            lows = np.full(size, np.asarray(low, dtype=float) / scale)
            highs = np.full(size, np.asarray(high, dtype=float) / scale)
            check(
                bool((lows <= highs).all()),
                f"minimise: the bounds of '{variable.name}' are {low!r} and {high!r}; give the smaller one first.",
            )
            found += [(float(a), float(b)) for a, b in zip(lows, highs, strict=True)]
        return found

    def constraints(self) -> list[dict[str, Any]]:
        """The limits as SciPy's SLSQP takes them, over the size of each result at the start."""
        found: list[dict[str, Any]] = []
        for limit in self._limits:
            size = max(abs(self._evaluate(limit.of, self.start)[0]), TINY)
            if limit.low == limit.high:
                found.append(self._constraint("eq", limit.of, 1 / size, limit.low))
                continue
            if limit.low > -math.inf:
                found.append(self._constraint("ineq", limit.of, 1 / size, limit.low))
            if limit.high < math.inf:
                found.append(self._constraint("ineq", limit.of, -1 / size, limit.high))
        return found

    def _constraint(
        self, kind: str, objective: Objective, factor: float, value: float
    ) -> dict[str, Any]:
        """factor (J - value) is zero, or not negative."""
        return {
            "type": kind,
            "fun": lambda x: factor * (self._evaluate(objective, x)[0] - value),
            "jac": lambda x: factor * self._evaluate(objective, x)[1],
        }

    def parameters(self) -> dict[str, Array]:
        """Present values by name."""
        return {variable.name: variable.get() for variable in self._variables}

    def note(self, x: Array) -> None:
        """Log an iteration, and write its parameters."""
        self.values.append(self.value(x))
        LOGGER.info("minimise: iteration %d, value %.9g", len(self.values) - 1, self.values[-1])
        if self._record is None or self._comm.rank:
            return
        parameters = {name: values.tolist() for name, values in self.parameters().items()}
        content = {"value": self.values[-1], "parameters": parameters}
        # A search that is killed leaves the last complete file.
        unfinished = self._record.with_name(self._record.name + ".part")
        unfinished.write_text(json.dumps(content), encoding="utf-8")
        unfinished.replace(self._record)

    def read(self) -> None:
        """Start from the parameters of the record."""
        if self._record is None or not self._record.exists():
            raise InputError(
                f"minimise: there is no file {self._record} to restart from; give record, or restart=False."
            )
        known = json.loads(self._record.read_text(encoding="utf-8"))["parameters"]
        for variable in self._variables:
            values = np.array(known.get(variable.name, []), dtype=float)
            check(
                len(values) == len(variable.get()),
                f"minimise: the record has {len(values)} values of '{variable.name}'; the scene has "
                f"{len(variable.get())}.",
            )
            variable.set(values)
        self.start = self._scaled_parameters()
        self._at = None
