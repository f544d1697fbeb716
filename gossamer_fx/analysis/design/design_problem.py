"""A result and its limits as functions of one vector of scaled numbers, for methods of
minimisation.

The numbers are those of the parameters over their size, so that their changes are comparable.  A
field has a number for each entry on each rank, or a few amounts of given changes, its basis,

    θ = θ_start + Σ_j amount_j column_j,    dJ/d(amount_j) = Σ_i dJ/dθ_i column_ij.             (1)

Numbers, and amounts of a basis, are the same on all ranks.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from gossamer_fx.analysis.sensitivity.results import Gradient
from gossamer_fx.analysis.sensitivity.static import StaticGradients
from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.core.checks.errors import InputError, check, check_on_all, real_numbers
from gossamer_fx.core.checks.lookups import check_known
from gossamer_fx.core.checks.user_functions import ask
from gossamer_fx.core.model.body import Array
from gossamer_fx.records.probes.objective import Objective

LOGGER = logging.getLogger("gossamer_fx")

# A result over its largest derivative by a scaled number, below which it counts as zero.
ZERO = 1e-8


class Source(Protocol):
    """Where results and gradients come from: an equilibrium, or runs that a function makes."""

    comm: MPI.Intracomm

    def values(self) -> dict[str, Array]:
        """Present values (k,) of the parameters by name, of this rank."""

    def is_distributed(self, name: str) -> bool:
        """Whether each rank has its own part of the values of a parameter."""

    def set(self, values: Mapping[str, Array]) -> None:
        """Give the parameters other values.  Collective."""

    def gradient(self, objective: Any) -> Gradient:
        """A result and its derivatives with the present values.  Collective."""


class EquilibriumSource:
    """Results of an equilibrium, which is found again from the last one when parameters change,
    under the loads of its time."""

    def __init__(self, equilibrium: Equilibrium, by: Sequence[str]) -> None:
        self.comm = equilibrium.comm
        self._equilibrium = equilibrium
        equilibrium.find(at=equilibrium.time)
        # Forms are compiled once, for all evaluations.
        self._gradients = StaticGradients(equilibrium, by)
        self._gradients.factorise()
        self._variables = {variable.name: variable for variable in self._gradients.variables}

    def values(self) -> dict[str, Array]:
        return {name: variable.get() for name, variable in self._variables.items()}

    def is_distributed(self, name: str) -> bool:
        return self._variables[name].is_distributed

    def set(self, values: Mapping[str, Array]) -> None:
        """Change the scene, and find its equilibrium from the present state.  Collective."""
        for name, variable in self._variables.items():
            variable.set(values[name])
        # Masses and constants that the system keeps depend on parameters.
        self._equilibrium.system.parameters_changed()
        self._equilibrium.find(at=self._equilibrium.time)
        self._gradients.factorise()

    def gradient(self, objective: Objective) -> Gradient:
        return self._gradients.of(objective)


class RunSource:
    """Results of runs that a function makes: it takes values by name, makes a run with them, and
    returns the gradient of its result."""

    # Name of the function of the user's program, for messages.
    who = "minimise_runs"

    def __init__(
        self,
        evaluate: Callable[[dict[str, Array]], Gradient],
        start: Mapping[str, Any],
        comm: MPI.Intracomm,
    ) -> None:
        self.comm = comm
        self._evaluate = evaluate
        self._values = {}
        # Copies: the method must not change what the user gave.
        for name, value in start.items():
            numbers = real_numbers(value)
            if numbers is None or numbers.ndim > 1 or not np.isfinite(numbers).all():
                raise InputError(f"{self.who}: start['{name}'] is no number or list of numbers.")
            self._values[name] = np.atleast_1d(numbers)
        self._found: Gradient | None = None

    def values(self) -> dict[str, Array]:
        return {name: value.copy() for name, value in self._values.items()}

    def is_distributed(self, name: str) -> bool:
        """Whether the derivative by a parameter is a field; the first call makes a run."""
        return self.gradient(None)[name].function is not None

    def set(self, values: Mapping[str, Array]) -> None:
        """Give the parameters other values; the next gradient makes a run with them."""
        self._values = {name: np.array(value) for name, value in values.items()}
        self._found = None

    def gradient(self, objective: None) -> Gradient:
        """Make a run with the present values, and return its result with derivatives; the function
        of the user has one result, whatever the objective.  Collective."""
        # Each gradient is a run: one that is known is not made again.
        if self._found is not None:
            return self._found
        found = ask(self.comm, f"{self.who}: evaluate", lambda: self._evaluate(self.values()))
        check(
            isinstance(found, Gradient),
            f"{self.who}: evaluate returned a {type(found).__name__}; "
            "return what gx.analysis.gradient returns.",
        )
        known = {derivative.name: derivative for derivative in found}
        for name, value in self._values.items():
            check_known(f"{self.who}: the gradient", "derivative", name, known)
            size = len(known[name].values)
            check_on_all(
                self.comm,
                size == len(value),
                f"{self.who}: '{name}' has {len(value)} values and its derivative has {size}; "
                "give as many.",
            )
        self._found = found
        return found


@dataclass(frozen=True, eq=False)
class DesignVariable:
    """A parameter "item.parameter" as a part of the vector of scaled numbers.

    It starts at values (k,) of this rank.  `scale` is a number of one in the vector, in the unit of
    the parameter.  With a basis of columns (k, m) the numbers are their amounts, and the scale is
    1.
    """

    name: str
    start: Array
    scale: float
    basis: Array | None
    is_distributed: bool

    @property
    def size(self) -> int:
        """Numbers on this rank."""
        return len(self.start) if self.basis is None else self.basis.shape[1]

    def first(self) -> Array:
        """The scaled numbers (n,) at the start."""
        if self.basis is None:
            return self.start / self.scale
        # By (1) no amount of any column is the start.
        return np.zeros(self.size)

    def values(self, numbers: Array) -> Array:
        """The values (k,) of the parameter."""
        if self.basis is None:
            return numbers * self.scale
        return self.start + self.basis @ numbers

    def slope(self, derivative: Array, comm: MPI.Intracomm, is_field: bool) -> Array:
        """The derivative of a result with respect to the scaled numbers (n,), by (1), from that
        with respect to the values (k,) of this rank; the ranks are added up if these are those of a
        field.  Collective."""
        if self.basis is None:
            return derivative * self.scale
        slope = self.basis.T @ derivative
        # Each rank has the rows of (1) of the entries that it owns; numbers are known to all ranks.
        if is_field:
            comm.Allreduce(MPI.IN_PLACE, slope, op=MPI.SUM)
        return slope


class DesignProblem:
    """A result and its limits as functions of one vector of scaled numbers.

    The vector varies the parameters of the source, or the amounts of columns (k, m), by name, in
    place of the k values of a field.  After each iteration the result `of` is added to `history`,
    that of the start first.  `who` is the public function that needs it, for messages.
    """

    def __init__(
        self,
        who: str,
        source: Source,
        of: Any,
        basis: Mapping[str, Any],
    ) -> None:
        self.who = who
        self.comm = source.comm
        self._source = source
        self._of = of
        present = source.values()
        for name in basis:
            check_known(f"{who}: by, for the basis,", "name", name, present)
        self.variables = [
            self._variable(name, values, basis.get(name)) for name, values in present.items()
        ]
        # Numbers for which the source is set, and results there by the identity of the objective.
        self._at = self.start
        self._known: dict[int, tuple[float, Array]] = {}
        self._scale_of_value = self.size_at_start(of)
        self.history = [self.value(self.start)]
        # The log of an iteration also says how large the problem is.
        LOGGER.info("%s: %d numbers, value %.9g", who, self.size, self.history[0])

    def _variable(self, name: str, values: Array, columns: Any) -> DesignVariable:
        """The part of the vector that varies one parameter from its values (k,), or the amounts of
        columns (k, m) of a basis.  Collective."""
        is_field = self._source.is_distributed(name)
        if columns is None:
            # On all ranks one scale, also where one of them has no entry of a field.
            largest = float(np.abs(values).max(initial=0.0))
            scale = self.comm.allreduce(largest, op=MPI.MAX) or 1.0
            return DesignVariable(name, values, scale, None, is_field and self.comm.size > 1)
        basis = np.array(columns, dtype=float)
        check_on_all(
            self.comm,
            basis.ndim == 2 and basis.shape[0] == len(values) and basis.shape[1] > 0,
            f"{self.who}: the basis of '{name}' has the shape {basis.shape}; "
            f"give columns of the {len(values)} values that the rank has.",
        )
        return DesignVariable(name, values, 1.0, basis, False)

    # ---- the vector ------------------------------------------------------------------------------

    @property
    def start(self) -> Array:
        """Scaled numbers of this rank at the start."""
        return np.concatenate([variable.first() for variable in self.variables])

    @property
    def size(self) -> int:
        """Numbers of all ranks, those that all ranks share counted once.  Collective."""
        total = 0
        for variable in self.variables:
            if variable.is_distributed:
                total += self.comm.allreduce(variable.size)
            else:
                total += variable.size
        return total

    def distributed(self) -> list[str]:
        """Names of the parameters whose numbers are distributed over ranks."""
        return [variable.name for variable in self.variables if variable.is_distributed]

    def refuse_distributed(self, remedy: str) -> None:
        """Raise `InputError` if the numbers of a parameter are distributed over ranks."""
        names = self.distributed()
        check(
            not names,
            f"{self.who}: '{', '.join(names)}' is a field, which is distributed over "
            f"{self.comm.size} ranks; {remedy}, or use one rank.",
        )

    def parts(self, x: Array) -> Iterator[tuple[DesignVariable, Array]]:
        """The parameters, and the numbers of each in the vector of this rank."""
        ends = np.cumsum([variable.size for variable in self.variables])
        return zip(self.variables, np.split(x, ends[:-1]), strict=True)

    def parameters(self, x: Array) -> dict[str, Array]:
        """Values of the parameters by name, of this rank."""
        return {variable.name: variable.values(part) for variable, part in self.parts(x)}

    def amounts(self, x: Array) -> dict[str, Array]:
        """Amounts of the columns of each basis, by name."""
        found = {}
        for variable, part in self.parts(x):
            if variable.basis is not None:
                found[variable.name] = np.array(part)
        return found

    def bounds(self, given: Mapping[str, tuple[Any, Any]]) -> tuple[Array, Array]:
        """The smallest and the largest scaled numbers (n,), (n,) of this rank.  Collective.

        A pair (lower, upper) by name of a parameter is unscaled, in its unit; with a basis it
        bounds the amounts of the columns.  Each is one number for all entries, or an array with one
        for each number that the parameter has on this rank.  Parameters without bounds get infinite
        ones.
        """
        names = [variable.name for variable in self.variables]
        for name in given:
            check_known(f"{self.who}: by, for the bounds,", "name", name, names)
        lows = []
        highs = []
        for variable in self.variables:
            lower, upper = given.get(variable.name, (-math.inf, math.inf))
            low = self._bound(variable, lower)
            high = self._bound(variable, upper)
            # Bounds of a field are arrays, which may be wrong on one rank only.
            check_on_all(
                self.comm,
                bool((low <= high).all()),
                f"{self.who}: the bounds of '{variable.name}' are {lower!r} and {upper!r}; "
                "give the smaller one first.",
            )
            lows.append(low)
            highs.append(high)
        return np.concatenate(lows), np.concatenate(highs)

    def _bound(self, variable: DesignVariable, given: Any) -> Array:
        """A bound of one parameter, scaled (n,), from one number or an array (n,) in its unit, for
        each of its n numbers on this rank.  Collective."""
        bound = np.asarray(given, dtype=float)
        check_on_all(
            self.comm,
            bound.ndim == 0 or bound.shape == (variable.size,),
            f"{self.who}: a bound of '{variable.name}' has the shape {bound.shape}; "
            f"give one number, or the {variable.size} numbers that the rank has.",
        )
        return np.full(variable.size, bound / variable.scale)

    # ---- results ---------------------------------------------------------------------------------

    def move_to(self, x: Array) -> None:
        """Set the parameters, unless they are set already.  Collective."""
        # All ranks decide alike: a rank without entries would know every vector.
        is_known = np.array_equal(x, self._at)
        if self.comm.allreduce(is_known, op=MPI.LAND):
            return
        self._source.set(self.parameters(x))
        self._at = np.array(x)
        self._known = {}

    def evaluate(self, objective: Any, x: Array) -> tuple[float, Array]:
        """A result, and its derivatives (n,) with respect to the scaled numbers x (n,) of this
        rank.  Results of the present numbers are kept by the identity of the objective, so that a
        second call for one costs nothing.  Collective."""
        self.move_to(x)
        if id(objective) not in self._known:
            found = self._source.gradient(objective)
            slopes = []
            for variable in self.variables:
                derivative = found[variable.name]
                is_field = derivative.function is not None
                slopes.append(variable.slope(derivative.values, self.comm, is_field))
            self._known[id(objective)] = (found.value, np.concatenate(slopes))
        return self._known[id(objective)]

    def size_at_start(self, objective: Any) -> float:
        """Size of a result at the start, by which it is divided; of one that is zero there, its
        largest derivative by a scaled number.  Collective."""
        value, slope = self.evaluate(objective, self.start)
        largest = float(np.abs(slope).max(initial=0.0))
        largest = self.comm.allreduce(largest, op=MPI.MAX)
        if abs(value) <= ZERO * largest:
            return largest or 1.0
        return abs(value)

    def value(self, x: Array) -> float:
        """The result.  Collective."""
        return self.evaluate(self._of, x)[0]

    def scaled(self, x: Array) -> tuple[float, Array]:
        """The result over its size at the start, and its derivatives (n,), too.  Collective."""
        value, slope = self.evaluate(self._of, x)
        return value / self._scale_of_value, slope / self._scale_of_value

    def note(self, x: Array) -> None:
        """Log an iteration that has ended at x (n,), and add its result to the history.
        Collective."""
        self.history.append(self.value(x))
        iteration = len(self.history) - 1
        LOGGER.info("%s: iteration %d, value %.9g", self.who, iteration, self.history[-1])
