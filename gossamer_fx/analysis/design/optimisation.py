"""The gradient of a result of an equilibrium or of a run with respect to parameters, and
minimisation of results by it, with methods of SciPy and of PETSc.

`gradient` chooses the adjoint of an equilibrium or of a run (`sensitivity`).

`minimise` and `minimise_runs` divide the parameters by their size, so that their changes are
comparable.  In each evaluation of an equilibrium the parameters of the compiled scene are set, the
equilibrium is found again from the last one, and one transposed system is solved for the result and
one for each constraint.

The bounded quasi-Newton methods of PETSc's TAO are for fields that are distributed over ranks.
Each rank has the numbers of its part of the fields; numbers that all ranks share belong to rank 0.
Nothing is gathered: a method exchanges scalar products only.

Sources: S. Benson, J. Moré, A limited-memory variable-metric algorithm for bound-constrained
minimization, Argonne preprint ANL/MCS-P909-0901 (2001): `blmvm`.  `bqnls` is the bounded
quasi-Newton line search of the TAO users manual.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.analysis.design.design_problem import (
    DesignProblem,
    EquilibriumSource,
    RunSource,
)
from gossamer_fx.analysis.sensitivity.results import Gradient
from gossamer_fx.analysis.sensitivity.static import StaticGradients
from gossamer_fx.analysis.sensitivity.tape import RunTape
from gossamer_fx.analysis.sensitivity.transient import TransientGradients
from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.core.checks.arguments import Range, at_least, check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.relations import rising, some
from gossamer_fx.core.checks.short_repr import short_repr
from gossamer_fx.core.model.body import Array
from gossamer_fx.records.probes.objective import Objective

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
        """A distributed vector of the numbers (n,) of each rank.  Collective."""
        own = numbers[self._is_own]
        vector = PETSc.Vec().createMPI((len(own), PETSc.DETERMINE), comm=self._comm)
        vector.setArray(own)
        return vector

    def fill(self, vector: PETSc.Vec, numbers: Array) -> None:
        """Copy the numbers (n,) of this rank to a distributed vector of `vector`."""
        vector.setArray(numbers[self._is_own])

    def numbers(self, vector: PETSc.Vec) -> Array:
        """The numbers (n,) of this rank in a distributed vector, with those that all ranks share.
        Collective."""
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
    """Name of a reason for which TAO ended, in words; its number if it has no name."""
    for name, value in vars(PETSc.TAO.ConvergedReason).items():
        if name.isupper() and value == reason:
            return name.lower().replace("_", " ")
    return str(reason)


@check_arguments
def gradient(source: Equilibrium | RunTape, *, of: Objective, by: Sequence[str]) -> Gradient:
    """The exact gradient of a result with respect to any number of parameters.

    Of an equilibrium it takes one solve with the transposed tangent, Kᵀ λ = ∂J/∂q, and
    dJ/dθ = ∂J/∂θ - λ·∂r/∂θ for each parameter θ.  Of a run it takes one such solve for each step of
    its `RunTape`, from the last to the first.  The lengths of the steps count as given.

    Parameters are named "item.parameter".  They are numbers and fields of the laws of films and
    cables (E, nu, thickness, density, EA, ...), "shape", the stress-free positions of nodes of a
    mesh, constant loads (pressure, force, g), stiffness and length of springs and ropes, stiffness
    and rest angle of creases and torsion springs.  Fixed coordinates do not move when the
    stress-free shape changes. Of a run, "body.initial_position" and "body.initial_velocity" are
    parameters, too, by which fixed coordinates count as zero; so are the gains of attitude control,
    and friction and stiffness of contact.
    Friction and yielding are piecewise smooth: the gradient is that of what slips in this run, as
    `Gradient.notes` says. Of gas they are pressure, temperature and volume of chambers and tanks at
    the start of the tape ("tank.pressure", "tank.volume", "bag.dead_volume"), area and
    discharge_coefficient of orifices, conductance and temperature of walls (coefficient of
    `FilmHeat`), pressure and temperature of reservoirs and surroundings.

    In a run the derivative of fluttering or touching films grows exponentially, as the distance of
    neighbouring motions does.  A warning tells for how long it predicts finite changes.

    Args:
        source: an equilibrium that was found, or the tape of a run that stands at its last step.
        of: a probe with derivatives (`probes.Position`, `probes.Displacement`, `probes.Velocity`),
            an `Integral`, an `EnclosedVolume`, the `Energy`, or a `Functional`; of a run, at its
            end.
        by: names of the parameters.

    Raises:
        InputError: no equilibrium was found, a parameter that the scene has not, a part of the
            scene that has no gradient, or a singular tangent.
        StepFailure: a step of the run cannot be repeated.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> equilibrium = gx.Equilibrium(gx.Scene(weight, spring))
        >>> result = equilibrium.find()
        >>> height = gx.probes.Position(mass.port(), "z")
        >>> found = gx.analysis.gradient(equilibrium, of=height, by=["spring.length"])
        >>> found["spring.length"].values.round(6), found["spring.length"].unit
        (array([-1.]), 'm/m')
    """
    if isinstance(source, RunTape):
        return TransientGradients(source, by).of(of)
    gradients = StaticGradients(source, by)
    gradients.factorise()
    return gradients.of(of)


# Methods of SciPy, and the bounded quasi-Newton methods of PETSc's TAO.
Method = Literal["L-BFGS-B", "SLSQP", "blmvm", "bqnls"]
TAO_METHODS = ("blmvm", "bqnls")


@check_arguments(rising("low", "high"), some("low", "high"))
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


@check_arguments
@dataclass(frozen=True, eq=False)
class Optimum:
    """What a minimisation has found; of an equilibrium, the scene has its parameters and stands in
    it.

    Attributes:
        value: the result.
        parameters: values by name; of a field those of this rank.
        iterations: of the method.
        converged: whether the method ended by its tolerance.
        message: how it ended, in words of SciPy or TAO.
        values: the result after each iteration, that of the start first.
        amounts: of the columns of each basis, by name of the field.

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
    amounts: dict[str, Array] = field(default_factory=dict)

    __repr__ = short_repr


@check_arguments
def minimise(
    equilibrium: Equilibrium,
    *,
    of: Objective,
    by: Sequence[str],
    bounds: Mapping[str, tuple[Any, Any]] | None = None,
    limits: Sequence[Limit] = (),
    basis: Mapping[str, Any] | None = None,
    method: Method | None = None,
    iterations: Annotated[int, Range(1)] = 100,
    tolerance: Annotated[float, Range(0.0, 1.0, above=True)] = 1e-8,
) -> Optimum:
    """Change parameters of a scene so that a result of its equilibrium gets least.

    It finds a local minimum near the present parameters: another call goes on.  A field has a
    number for each of its entries, or with a basis the amounts of a few given changes of it.

    Methods: "L-BFGS-B" and, with limits, "SLSQP" of `scipy.optimize`; the bounded quasi-Newton
    methods "blmvm" and "bqnls" of PETSc's TAO, for fields that are distributed over ranks, which
    are never gathered. Without a name it is "L-BFGS-B", with limits "SLSQP", of fields on several
    ranks "blmvm".

    Args:
        equilibrium: its scene is changed; `find` is called by the minimisation, at the time of the
            present loads.
        of: a result with derivatives, see `gx.analysis.gradient`.
        by: names of the parameters.
        bounds: for parameters by name the smallest and the largest value, numbers or arrays of this
            rank; with a basis, of its amounts.
        limits: results that are to stay within limits.
        basis: for fields by name an array (k, m) of m changes of the k values that this rank has.
            The field is its start plus a sum of amounts of them, which is zero at the start.
        method: see above.
        iterations: at most.
        tolerance: relative change of the result at which the search ends.

    Raises:
        InputError: a name that the scene has not, bounds or a basis of something else, a method of
            SciPy with a field on several ranks, or limits with a method of TAO.
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
    problem = DesignProblem("minimise", EquilibriumSource(equilibrium, by), of, basis or {})
    return _search(problem, bounds or {}, limits, method, iterations, tolerance)


@check_arguments
def minimise_runs(
    evaluate: Callable[[dict[str, Array]], Gradient],
    start: Annotated[Mapping[str, Any], at_least(1)],
    *,
    bounds: Mapping[str, tuple[Any, Any]] | None = None,
    method: Method | None = None,
    iterations: Annotated[int, Range(1)] = 100,
    tolerance: Annotated[float, Range(0.0, 1.0, above=True)] = 1e-8,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> Optimum:
    """Change parameters of a run so that a result of it gets least; each evaluation makes a new
    run.

    It finds a local minimum near the start, by "L-BFGS-B" of `scipy.optimize`, or by "blmvm" or
    "bqnls" of PETSc's TAO.

    Args:
        evaluate: function of the values of the parameters by name, arrays (k,), that makes a scene
            with them, records a run and returns `gx.analysis.gradient(tape, of=..., by=...)`.
        start: first values by name, numbers or arrays.
        bounds: for parameters by name the smallest and the largest value.
        method: see above; for fields on several ranks one of TAO.
        iterations: at most.
        tolerance: relative change of the result at which the search ends.
        comm: ranks of the runs.

    Raises:
        InputError: no gradient, one that lacks a parameter, no parameter, or what `minimise`
            refuses.
        StepFailure: parameters with which a step fails.

    Example:
        >>> def height_after_a_second(values):
        ...     ball = gx.PointMass(1.0, (0.0, 0.0, -1.0), name="ball")
        ...     stiffness = float(values["spring.stiffness"][0])
        ...     spring = gx.connectors.Spring(
        ...         ball.port(), gx.Ground((0.0, 0.0, 0.0)), stiffness=stiffness, length=0.9
        ...     )
        ...     run = gx.Simulation(gx.Scene(spring), gx.Midpoint(dt=0.05))
        ...     tape = gx.analysis.RunTape(run)
        ...     run.run(until=1.0)
        ...     height = gx.probes.Position(ball.port(), "z")
        ...     return gx.analysis.gradient(tape, of=height, by=["spring.stiffness"])
        >>> found = gx.analysis.minimise_runs(
        ...     height_after_a_second,
        ...     {"spring.stiffness": 30.0},
        ...     bounds={"spring.stiffness": (20.0, 60.0)},
        ... )
        >>> round(found.value, 2), found.parameters["spring.stiffness"].round()
        (-1.0, array([40.]))
    """
    problem = DesignProblem("minimise_runs", RunSource(evaluate, start, comm), None, {})
    return _search(problem, bounds or {}, (), method, iterations, tolerance)


def _search(
    problem: DesignProblem,
    bounds: Mapping[str, tuple[Any, Any]],
    limits: Sequence[Limit],
    method: Method | None,
    iterations: int,
    tolerance: float,
) -> Optimum:
    """Choose the method, minimise, and leave the source at the minimum.  Without a name it is SLSQP
    with limits, blmvm for fields on several ranks, else L-BFGS-B.  Collective."""
    who = problem.who
    distributed = problem.distributed()
    if method is None and limits:
        method = "SLSQP"
    elif method is None:
        method = "blmvm" if distributed else "L-BFGS-B"
    with_tao = method in TAO_METHODS
    check(
        method == "SLSQP" or not limits,
        f"{who}: '{method}' takes no limits; leave method out, or give bounds only.",
    )
    if not with_tao:
        problem.refuse_distributed("use method='blmvm' without limits, give a basis")
    # Two libraries, since SciPy's methods need the whole vector on each rank.
    if with_tao:
        ended = tao_minimise(problem, problem.bounds(bounds), method, iterations, tolerance)
        return _optimum(problem, *ended)
    from scipy import optimize

    options: dict[str, Any] = {"maxiter": iterations, "ftol": tolerance}
    if method == "L-BFGS-B":
        # The scaled gradient may fall far below one before the value stands still.
        options["gtol"] = 0.0
    low, high = problem.bounds(bounds)
    found = optimize.minimize(
        problem.scaled,
        problem.start,
        jac=True,
        method=method,
        # Infinite bounds would change its first step, which is projected onto bounds.
        bounds=optimize.Bounds(low, high) if bounds else None,
        constraints=_constraints(problem, limits),
        options=options,
        callback=problem.note,
    )
    return _optimum(problem, found.x, int(found.nit), bool(found.success), str(found.message))


def _optimum(
    problem: DesignProblem, x: Array, iterations: int, converged: bool, message: str
) -> Optimum:
    """What was found at scaled numbers x (n,) of this rank; the source gets the parameters.
    Collective."""
    # The last evaluation of a line search need not be the best one.
    problem.move_to(x)
    return Optimum(
        value=problem.value(x),
        parameters=problem.parameters(x),
        iterations=iterations,
        converged=converged,
        message=message,
        values=problem.history,
        amounts=problem.amounts(x),
    )


def _constraints(problem: DesignProblem, limits: Sequence[Limit]) -> list[dict[str, Any]]:
    """Return limits as SciPy's SLSQP takes them, over the size of each result at the start."""
    found: list[dict[str, Any]] = []
    for limit in limits:
        size = problem.size_at_start(limit.of)
        if limit.low == limit.high:
            found.append(_constraint(problem, "eq", limit.of, 1 / size, limit.low))
            continue
        # SLSQP knows lower bounds of functions only; the sign of an upper one is turned.
        if limit.low > -math.inf:
            found.append(_constraint(problem, "ineq", limit.of, 1 / size, limit.low))
        if limit.high < math.inf:
            found.append(_constraint(problem, "ineq", limit.of, -1 / size, limit.high))
    return found


def _constraint(
    problem: DesignProblem, kind: str, objective: Objective, factor: float, value: float
) -> dict[str, Any]:
    """A constraint of SciPy: factor (J - value) is zero for the kind "eq", and not negative for
    "ineq"."""
    return {
        "type": kind,
        "fun": lambda x: factor * (problem.evaluate(objective, x)[0] - value),
        "jac": lambda x: factor * problem.evaluate(objective, x)[1],
    }
