"""What a gradient returns: a value, and its derivatives by name, with units."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from gossamer_fx.analysis.sensitivity.variables import Variable
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.model.body import Array

# Lines that a gradient is printed in, and numbers of a derivative in one of them.
MAX_LINES = 5
MAX_NUMBERS = 6


@check_arguments
@dataclass(frozen=True, eq=False)
class Derivative:
    """The derivative of a result with respect to one parameter.

    Attributes:
        name: "item.parameter".
        unit: SI unit of the derivative.
        values: for a field (k,) the entries of this rank; for numbers (k,) all, on every rank.
        function: the same as a function on the mesh, which can be drawn; None for numbers.  Its
            values are derivatives with respect to single entries, so that they are the smaller, the
            finer the mesh is.
        comm: ranks over which the values are distributed; None where each rank has all of them.

    Example:
        >>> found = gx.analysis.Derivative("spring.length", "m/m", np.array([-1.0]), None)
        >>> found.along(0.1)
        -0.1
    """

    name: str
    unit: str
    values: Array
    function: fem.Function | None
    comm: MPI.Intracomm | None = None

    @check_arguments
    def along(self, change: Array | float) -> float:
        """The change of the result, to first order, for a change of the parameter: one for each
        entry of `values` on this rank, or one number for all.  Collective if the values are
        distributed."""
        share = float(np.sum(self.values * change))
        comm = self.comm
        if comm is None and self.function is not None:
            comm = self.function.function_space.mesh.comm
        if comm is None:
            return share
        # A rank without entries, as of the initial state of a rigid body, adds nothing.
        return float(comm.allreduce(share))


@check_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Gradient:
    """A result and its derivatives.

    Attributes:
        value: the result.
        unit: SI unit of the result.
        derivatives: in the order in which they were asked for.
        growth: of a run: by how much the adjoint grew from the end to the start, as a factor; None
            for an equilibrium.  See `gx.analysis.gradient`.
        notes: one sentence for each item of the scene that makes the result piecewise smooth, e.g.
            friction.

    Example:
        >>> by_length = gx.analysis.Derivative("spring.length", "m/m", np.array([-1.0]), None)
        >>> found = gx.analysis.Gradient(-1.1, "m", (by_length,))
        >>> print(found)
        -1.1 m
        by spring.length: -1 m/m
    """

    value: float
    unit: str
    derivatives: tuple[Derivative, ...]
    growth: float | None = None
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> Derivative:
        """The derivative by a parameter, named as in `by`; KeyError for another name."""
        for derivative in self.derivatives:
            if derivative.name == name:
                return derivative
        known = ", ".join(derivative.name for derivative in self.derivatives)
        raise KeyError(f"'{name}'; the gradient has: {known}")

    def __iter__(self) -> Iterator[Derivative]:
        return iter(self.derivatives)

    def __str__(self) -> str:
        """The value and the derivatives, in at most five lines; of long arrays the largest entry of
        this rank."""
        lines = [f"{self.value:.6g} {self.unit}".rstrip()]
        shown = self.derivatives[: MAX_LINES - 1]
        if len(self.derivatives) >= MAX_LINES:
            shown = self.derivatives[: MAX_LINES - 2]
        for one in shown:
            words = ", ".join(f"{value:.6g}" for value in one.values[:MAX_NUMBERS])
            if len(one.values) > MAX_NUMBERS:
                largest = float(np.abs(one.values).max())
                words = f"{len(one.values)} values up to {largest:.4g}"
            lines.append(f"by {one.name}: {words} {one.unit}".rstrip())
        more = len(self.derivatives) - len(shown)
        if more:
            lines.append(
                f"and {more} more: {', '.join(one.name for one in self.derivatives[-more:])}"
            )
        return "\n".join(lines)

    __repr__ = __str__


def collected(
    value: float,
    unit: str,
    variables: Sequence[Variable],
    comm: MPI.Intracomm,
    growth: float | None = None,
    notes: Sequence[str] = (),
) -> Gradient:
    """The gradient that variables have summed up.  Collective."""
    derivatives = []
    for variable in variables:
        values = variable.sum.copy()
        if not variable.is_distributed:
            comm.Allreduce(MPI.IN_PLACE, values, op=MPI.SUM)
        derivatives.append(
            Derivative(
                variable.name,
                _quotient(unit, variable.unit),
                values,
                variable.function(values),
                comm if variable.is_distributed else None,
            )
        )
    return Gradient(value, unit, tuple(derivatives), growth, tuple(notes))


def _quotient(unit: str, by: str) -> str:
    """Unit of the derivative of a result in `unit` by a parameter in the unit `by`."""
    if not by:
        return unit
    divisor = f"({by})" if "/" in by or " " in by else by
    return f"{unit or '1'}/{divisor}"
