"""Minimisation by PETSc's TAO: bounded quasi-Newton methods for fields that are distributed over
ranks.

Each rank has the numbers of its part of the fields; numbers that all ranks share belong to rank 0.
Nothing is gathered: a method exchanges scalar products only.

Sources: S. Benson, J. Moré, A limited-memory variable-metric algorithm for bound-constrained
minimization, Argonne preprint ANL/MCS-P909-0901 (2001): `blmvm`.  `bqnls` is the bounded
quasi-Newton line search of the TAO users manual.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from gossamer_fx.analysis.design.design_problem import DesignProblem
from gossamer_fx.core.model.body import Array

# The search also ends where the scaled gradient is round-off of its size at the start.
GRADIENT_REDUCTION = 1e-14

# Number that TAO takes as infinite, of bounds that are not given.
UNBOUNDED = PETSc.INFINITY


class _Layout:
    """Copies numbers between the array of a rank, which has those that all ranks share, and a
    distributed vector, which has each number once."""

    def __init__(self, problem: DesignProblem) -> None:
        self._comm = problem.comm
        shared = []
        for variable in problem.variables:
            shared.append(np.full(variable.size, not variable.is_distributed))
        self._is_shared = np.concatenate(shared)
        self._is_own = ~self._is_shared | (self._comm.rank == 0)

    def vector(self, numbers: Array) -> PETSc.Vec:
        """A distributed vector of numbers."""
        own = numbers[self._is_own]
        vector = PETSc.Vec().createMPI((len(own), PETSc.DETERMINE), comm=self._comm)
        vector.setArray(own)
        return vector

    def fill(self, vector: PETSc.Vec, numbers: Array) -> None:
        """Copy numbers of this rank to a distributed vector."""
        vector.setArray(numbers[self._is_own])

    def numbers(self, vector: PETSc.Vec) -> Array:
        """All numbers that this rank needs.  Collective."""
        found = np.zeros(len(self._is_own))
        found[self._is_own] = vector.array_r
        shared = found[self._is_shared]
        # A few numbers; fields are not exchanged.
        self._comm.Bcast(shared, root=0)
        found[self._is_shared] = shared
        return found


def tao_minimise(
    problem: DesignProblem,
    bounds: tuple[Array, Array],
    method: str,
    iterations: int,
    tolerance: float,
) -> tuple[Array, int, bool, str]:
    """Minimise from `problem.start` by the bounded quasi-Newton method "blmvm" or "bqnls", with
    bounds (n,), (n,) of this rank's scaled numbers, up to a change of the scaled result.  A search
    that ends at the limit of iterations is not an error.  Collective.

    Returns scaled numbers (n,) of this rank, iterations, whether it ended by its tolerance, and how
    it ended, in words of TAO.
    """
    layout = _Layout(problem)
    low, high = bounds
    tao = PETSc.TAO().create(problem.comm)
    x = layout.vector(problem.start)

    def evaluate(tao: PETSc.TAO, at: PETSc.Vec, gradient: PETSc.Vec) -> float:
        value, slope = problem.scaled(layout.numbers(at))
        layout.fill(gradient, slope)
        return value

    # Of all iterations, as TAO itself keeps the last ones only.
    values: list[float] = []
    norms: list[float] = []

    def has_converged(tao: PETSc.TAO) -> None:
        """End where the result stands still, as SciPy's L-BFGS-B does."""
        values.append(tao.getObjectiveValue())
        reason = PETSc.TAO.ConvergedReason.CONTINUE_ITERATING
        if len(values) > 1:
            change = values[-2] - values[-1]
            if change <= tolerance * max(abs(values[-2]), abs(values[-1]), 1.0):
                reason = PETSc.TAO.ConvergedReason.CONVERGED_USER
        # Of the projected gradient: at a bound its outward part does not count.
        norms.append(tao.getSolutionStatus()[2])
        if norms[-1] <= GRADIENT_REDUCTION * norms[0]:
            reason = PETSc.TAO.ConvergedReason.CONVERGED_GTTOL
        if reason == PETSc.TAO.ConvergedReason.CONTINUE_ITERATING and len(values) > iterations:
            reason = PETSc.TAO.ConvergedReason.DIVERGED_MAXITS
        tao.setConvergedReason(reason)

    def monitor(tao: PETSc.TAO) -> None:
        # The start is known before the search.
        if tao.getIterationNumber() > 0:
            problem.note(layout.numbers(tao.getSolution()))

    tao.setType(method)
    tao.setObjectiveGradient(evaluate, None)
    tao.setVariableBounds(
        (
            layout.vector(np.where(np.isfinite(low), low, -UNBOUNDED)),
            layout.vector(np.where(np.isfinite(high), high, UNBOUNDED)),
        )
    )
    tao.setMaximumIterations(iterations)
    tao.setConvergenceTest(has_converged)
    tao.setMonitor(monitor)
    tao.solve(x)
    reason = tao.getConvergedReason()
    solution = layout.numbers(tao.getSolution())
    used = int(tao.getIterationNumber())
    tao.destroy()
    return solution, used, reason > 0, f"{method}: {_name_of(reason)}"


def _name_of(reason: int) -> str:
    """Name of a reason of TAO."""
    for name, value in vars(PETSc.TAO.ConvergedReason).items():
        if name.isupper() and value == reason:
            return name.lower().replace("_", " ")
    return str(reason)
