"""Equilibrium paths past limit points, by the arc length.

Problem.  Under a load that only grows, `Equilibrium.find` jumps where a scene snaps through: beyond
a limit point there is no equilibrium nearby, and unstable equilibria are not found at all.

Idea.  The load factor λ is one more unknown y of Newton's iteration (E. Riks, Int. J. Solids
Struct. 15 (1979) 529, doi:10.1016/0020-7683(79)90081-7).  With the unit tangent (t, τ) of the path
at its last point (q0, λ0), the additional equation is that of the plane normal to the tangent at a
distance s,

    <t, q - q0> + τ (λ - λ0)/Λ² = s,    <a, b> = a·M b/W                                       (1)

M is the mass matrix, so that neither the mesh nor units matter; Λ is the first step of λ, and W is
such that displacements and load have equal parts in this step.

Algorithm, for each step from a point of the path.

1. Predict along the tangent, and solve the equations of equilibrium and (1) by Newton's iteration
   (`solvers.newton`), whose linear systems have one more scalar unknown (`solvers.linear`).
   ∂r/∂λ, in which prescribed coordinates move along, is a central difference: exact for loads that
   are linear in λ.
2. Solve with the tangent matrix for the tangent of the path, and count the negative eigenvalues of
   the stiffness by its inertia (`vibration.natural_modes`), less one for each Lagrange multiplier.
3. A step that fails, or in which the tangent turns by more than 60°, is repeated with half of its
   length.  The next step is longer after few iterations and shorter after many.
4. If the load's part τ changes its sign in the step, there is a limit point; if only the number of
   negative eigenvalues changes, a branch point.  Either is located by bisection of s, and becomes a
   point of the path.
5. At the first branch point a path may turn.  There the matrix of Newton's iteration has a null
   vector, which is normal to the tangent by (1) and found by inverse iteration; the next step is
   predicted along it, and ends on the other path.
6. The last step ends at the wanted load exactly.

Cost.  Each iteration evaluates the residual twice more than that of `find`; each point costs two
factorisations, and a located point about 14 solutions.

Limits.  Where more than two paths cross in a point, one of them is taken as the branch.  Friction
and contact are refused, as a solution is repeated from one state.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.analysis.sensitivity.variables import (
    SHAPE,
    AdjointFields,
    Variable,
    find_variables,
)
from gossamer_fx.analysis.statics.continuation import FINAL_REDUCTION, FINAL_TOLERANCE
from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.analysis.vibration.rigid_motions import listed
from gossamer_fx.analysis.vibration.spectrum import UNKNOWN, count_unstable
from gossamer_fx.core.checks.arguments import Range, check_arguments, collective, positive
from gossamer_fx.core.checks.errors import InputError, NoEquilibrium, NotConverged, check
from gossamer_fx.core.checks.lookups import check_known, check_no_contact
from gossamer_fx.core.checks.short_repr import short_repr
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.records.outputs.output import Output, evaluate_probe
from gossamer_fx.records.outputs.static_records import OpenedOutputs
from gossamer_fx.solve.solvers.convergence import Tolerances
from gossamer_fx.solve.solvers.newton import Border, ExtraUnknown, Newton, with_border
from gossamer_fx.solve.steppers.history import MOTION, History
from gossamer_fx.solve.system.system import System
from gossamer_fx.solve.system.totals import Totals
from gossamer_fx.solve.view import (
    LOAD_FACTOR,
    Account,
    Axis,
    StateView,
    chamber_state,
    chamber_states,
)

# Step of the difference ∂r/∂λ, over the first step of λ: its error is of second order.
DIFFERENCE_STEP = 1e-3

# Newton iterations of a step: after this number the next step is as long, and after the other it
# has failed.
WANTED_ITERATIONS = 4
MAX_ITERATIONS = 12

# Largest and smallest factor of the length from step to step.
MAX_GROWTH = 2.0
MIN_GROWTH = 0.5

# A step that ends early, at a limit or branch point, counts as at least this share of the length
# that it was to have, when the next length is chosen.
SHARE_OF_SHORT_STEP = 1 / 8

# Smallest load [N], against division by zero and so that `Tolerances` accepts a share of it, and
# smallest length of a step.
TINY_LOAD = 1e-80
TINY_LENGTH = 1e-300

# Cosine of the largest angle between the tangents at both ends of a step.  In a step that is
# shorter than the second number times the first one, a kink of the path (a film that wrinkles)
# may turn the tangent by more.
MIN_COSINE = 0.5
KINK_STEP_RATIO = 1e-2

# Length of a step over the first one, below which the path is given up.
MIN_STEP_RATIO = 1e-6

# Length within which a branch point is located, over that of a limit point, at which the load does
# not depend on the length: loads of both are then the same for all steps to 1e-4.
BRANCH_WIDTH = 0.1

# Change of the load in the first step on a branch, over that of a step times the tolerance: the
# branch begins where its load does not change, and the branch point is known to the tolerance.
BRANCH_LOAD_CHANGE = 10.0
# Move of the first step on a branch, over the extent of the scene, where the load has moved nothing
# before; it grows from there.
BRANCH_MOVE = 1e-5
# Growth of this step until the load has changed so much.
BRANCH_GROWTH = 4.0

# Inverse iterations for a branch: the eigenvalue that vanishes is smaller than the others by a
# factor like the tolerance of the branch point.
INVERSE_ITERATIONS = 4

# Pseudo-time of a step [s]: so long that dampers do not resist.
DURATION = 1e3

# Move over the extent of the scene that positions do not show.
EPSILON = float(np.finfo(float).eps)

# Change of a probe along a branch over its value, below which it is round-off.
ROUND_OFF = 1e-9

# A number of the state of a scene, e.g. a probe.
Measure = Callable[[Any], float]


@check_arguments
@dataclass(frozen=True)
class EquilibriumPath:
    """The points of an equilibrium path, in the order in which they were found.

    Attributes:
        loads: load factor of each point, (n,).
        columns: values of the probes at each point by their names, (n,) each.
        unstable: number of negative eigenvalues of the stiffness at each point, (n,): zero for a
            stable equilibrium.  -1 where it is not known: loads that follow an open film make the
            stiffness unsymmetric, and openings let gas flow.
        limit_points: indices of the points at which the load has a maximum or minimum.
        branch_points: indices of the points at which another path crosses this one; where a branch
            was asked for, the points behind the first of them lie on it.
        iterations: Newton iterations of all solutions.
        complete: whether the path has reached the wanted load.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> pull = gx.loads.Force(mass.port(), lambda t: (0.0, 0.0, -5.0 * t))
        >>> equilibrium = gx.Equilibrium(gx.Scene(weight, spring, pull))
        >>> found = gx.analysis.path(equilibrium, 1.0)
        >>> found.complete, found.limit_points, found.unstable.any()
        (True, (), np.False_)
    """

    loads: Array
    _: KW_ONLY
    columns: Mapping[str, Array] = field(default_factory=dict)
    unstable: Indices
    limit_points: tuple[int, ...]
    branch_points: tuple[int, ...]
    iterations: int
    complete: bool

    __repr__ = short_repr


@check_arguments
@collective
def path(
    equilibrium: Equilibrium,
    until: float,
    *,
    by: str = "",
    start: float = 0.0,
    first_step: Annotated[float, positive()] | None = None,
    max_steps: Annotated[int, positive()] = 200,
    probes: Mapping[str, Measure] | None = None,
    branch: str = "",
    outputs: Sequence[Output] = (),
    resume: bool = False,
    tolerance: Annotated[float, positive(), Range(0.0, 0.1)] = 1e-4,
) -> EquilibriumPath:
    """Follow the equilibria of a scene from a load to another one, also where the load falls.

    Without `by` the load factor is the load parameter `at` of `Equilibrium.find`, so that a path
    may have any loads, prescribed motions and temperatures that are functions of time.  With
    `by="item.quantity"`, a name as of `analysis.gradient`, it multiplies the value of that number
    or field in the scene, e.g. a force, a pressure, gravity or an initial stress; the product stays
    there, and is the value of a next path unless that one resumes.

    The equilibrium has the state of the last point then, which need not be stable, and its `result`
    is that of the first point.

    Args:
        equilibrium: of a scene without contact; its present state is the first guess.
        until: load factor at which the path ends.
        by: what the load factor multiplies, while other loads have their present time; "": it is
            the time of the loads.
        start: load factor of the first point, which is found by `Equilibrium.find`.
        first_step: first step of the load factor; default: a twentieth of the way.
        max_steps: number of points after which the path ends in any case.
        probes: what is measured at each point, by name: `gx.probes.Position(port, "z")` or any
            function of the equilibrium.
        branch: name of the probe that grows on the path to which this one turns at its first branch
            point; "": it goes straight on.
        outputs: write each point, e.g. `Recording("path")`, whose report has curves over the load.
        resume: whether to continue the last path of this equilibrium from its last point, as if it
            had not ended there; `by`, `start`, `first_step` and `branch` are those of that path.
        tolerance: length within which limit points are located, over that of the step; branch
            points, at which the load changes along the path, within a tenth of it.

    Raises:
        InputError: a name that the scene does not have, a scene with contact or with a part that
            moves freely, `until` equal to `start`, a probe for the branch that does not change
            along it, or nothing to resume.
        NoEquilibrium: at the first point, or the path cannot be followed.

    Example:
        >>> pull = gx.loads.Force(mass.port(), (0.0, 0.0, -10.0), name="pull")
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> equilibrium = gx.Equilibrium(gx.Scene(pull, spring))
        >>> height = gx.probes.Position(mass.port(), "z")
        >>> probes = {"z": height}
        >>> found = gx.analysis.path(equilibrium, 2.0, by="pull.force", start=1.0, probes=probes)
        >>> found.columns["z"][[0, -1]].round(6)
        array([-1.1, -1.2])
    """
    system = equilibrium.system
    check_no_contact(system, "path", "which a path does not follow")
    follower = equilibrium.followed
    if resume:
        check(
            isinstance(follower, _Follower) and not (by or start or first_step or branch),
            "path: resume continues the path that was found last, with its by, start, first_step "
            "and branch; leave these out, and call path before and not find.",
        )
        assert isinstance(follower, _Follower)
        start = follower.view.point.factor
        branch = follower.branch
    check(until != start, f"path: until is {until!r}, and so is start; give two loads.")
    measures = dict(probes or {})
    if branch:
        check_known("path: branch", "probe", branch, measures)
    if not isinstance(follower, _Follower) or not resume:
        load = _Load(system, by)
        load.set(start)
        found = equilibrium.find(at=load.time(start))
        # Along a free motion any step is as good as another one: the path would wander there, and
        # count signs of round-off.
        check(
            not found.free,
            f"path: nothing resists {listed(found.free)}; hold it by gx.Fixed, "
            "or start from a load that holds it.",
        )
        step = first_step or abs(until - start) / 20
        follower = _Follower(equilibrium, load, start=start, toward=until, first_step=step)
        follower.branch = branch
        equilibrium.followed = follower
    with OpenedOutputs(follower.view, outputs) as opened:
        return follower.follow(until, max_steps, measures, tolerance, opened.write)


class _Load:
    """What the load factor changes: the time of the loads, or a number of an item."""

    def __init__(self, system: System, name: str) -> None:
        """`name` is "item.quantity", of which the factor multiplies the present value, or "" for
        the time.  Raises `InputError` if the scene has no such number, or it is zero, a shape or a
        stiffness that is assembled once."""
        self._system = system
        self._time = system.unknowns.time
        self._variable: Variable | None = None
        if not name:
            return
        check(
            name.rpartition(".")[2] != SHAPE,
            f"path: by is {name!r}, which no load factor multiplies; give a load or a stiffness.",
        )
        try:
            found = find_variables(system, [name], AdjointFields(system), in_time=False)
        except InputError as error:
            raise InputError(str(error).replace("gradient: ", "path: ", 1)) from None
        item, _, what = name.rpartition(".")
        for one in system.unknowns.items:
            if getattr(one, "name", None) == item:
                self._refuse_constant_stiffness(name, what, one)
        self._variable = found[0]
        self._given = found[0].get()
        size = system.comm.allreduce(float(np.abs(self._given).sum()))
        check(
            size > 0,
            f"path: '{name}' is zero in the scene, so that no load factor changes it; "
            "give it the value at the load factor 1.",
        )

    def _refuse_constant_stiffness(self, name: str, what: str, item: object) -> None:
        """Raise `InputError` if a parameter of an item enters a matrix that is assembled once."""
        for term in self._system.unknowns.terms_of(item):
            if all(one.name != what for one in getattr(term, "parameters", ())):
                continue
            kinds: list[Any] = self._system.equations.compiled_as(term.compiler)
            check(
                not any(kind.has_constant_stiffness for kind in kinds),
                f"path: '{name}' changes a stiffness that is assembled once; "
                "give a load, a pressure or an initial stress.",
            )

    def set(self, factor: float) -> None:
        """Change the number to a load factor times its value in the scene; nothing if the load
        factor is the time."""
        if self._variable is None:
            return
        self._variable.set(factor * self._given)
        for compiled in self._system.equations.differentiable:
            compiled.parameters_changed()

    def time(self, factor: float) -> float:
        """Time of the loads [s] at a load factor; that before the path if it multiplies a
        number."""
        return factor if self._variable is None else self._time


class _LoadFactor(ExtraUnknown):
    """The load factor as the last scalar unknown of Newton's iteration, and (1) as its equation.

    Attributes:
        row: W⁻¹ M t of (1), zero at fixed coordinates; (n,) of this rank.
        weight: τ/Λ² of (1).
        predicted: load factor at which (1) holds for the predicted coordinates.
        scale: s of (1), by which the equation is divided.
        load_norm: norm of ∂r/∂λ [N] at the last `border_at_point`.
    """

    def __init__(self, system: System, load: _Load, difference: float) -> None:
        """`difference` is the step of the load factor in differences ∂/∂λ."""
        self._system = system
        self._load = load
        self._difference = difference
        self._increment = system.unknowns.numbering.vector()  # predicted, of the present step
        # w with the fixed coordinates of another load, and the residual there.
        self._moved = system.unknowns.numbering.vector()
        self._shifted = system.unknowns.numbering.vector()
        # Load factor for which the system is set, None: unknown; and w of fixed coordinates there.
        self._applied: float | None = None
        self._fixed_values: Array = np.zeros(0)
        self.row: Array = np.zeros(self._moved.getLocalSize())
        self.weight = 0.0
        self.predicted = 0.0
        self.scale = 1.0
        self.load_norm = 0.0

    def begin_step(self, factor: float) -> Array:
        """Begin a step of the length `DURATION` to a load factor; returns a first guess of the
        scene's scalar unknowns.  Collective."""
        self._load.set(factor)
        self._system.unknowns.time = self._load.time(factor) - DURATION
        self._applied = None
        return self._system.equations.begin_step(DURATION)

    def take_increment(self, increment: PETSc.Vec) -> None:
        """Take the predicted increment of the coordinates of the step that was begun."""
        increment.copy(self._increment)
        self._applied = None

    def apply(self, value: float) -> Array | None:
        if value == self._applied:
            return None
        self._load.set(value)
        self._system.unknowns.time = self._load.time(value) - self._system.unknowns.h
        self._system.equations.begin_without_search(self._system.unknowns.h)
        self._fixed_values = self._system.equations.predict(self._increment)
        self._applied = value
        return self._fixed_values

    def residual(self, w: PETSc.Vec, value: float) -> float:
        along = float(self._system.comm.allreduce(float(self.row @ w.array_r)))
        return (along + self.weight * (value - self.predicted)) / self.scale

    def border_at_point(self, w: PETSc.Vec, y: Array) -> Border:
        """Derivatives by the load factor at a solution w and y, with its true strains, and at whose
        load factor the system stands then.  Also sets `load_norm`.  Collective."""
        border = self.border(w, y, None)
        forces = border[0]
        self.load_norm = math.sqrt(self._system.comm.allreduce(float(forces @ forces)))
        self.evaluate_at(float(y[-1]), w, y, None)
        return border

    def border(self, w: PETSc.Vec, y: Array, base: PETSc.Vec | None) -> Border:
        """See `ExtraUnknown`: central differences, in which fixed coordinates move along.  Leaves
        the system at a shifted load factor.  Collective."""
        forces = []
        equations = []
        for side in (1, -1):
            factor = float(y[-1]) + side * self._difference
            equations.append(self.evaluate_at(factor, w, y, base))
            forces.append(self._shifted.array_r.copy())
        self._applied = None
        width = 2 * self._difference
        of_equations = (equations[0] - equations[1]) / width
        last = np.append(of_equations, self.weight / self.scale)
        return (forces[0] - forces[1]) / width, self.row / self.scale, last

    def evaluate_at(self, factor: float, w: PETSc.Vec, y: Array, base: PETSc.Vec | None) -> Array:
        """Evaluate r at an iterate under the load of a factor, to `_shifted`, and return s of the
        scene; strains are linear from w = `base`, or the true ones.  Collective."""
        self.apply(factor)
        w.copy(self._moved)
        with self._moved as values:
            values[self._system.unknowns.supports.held] = self._fixed_values
        self._system.equations.set_increment(self._moved, base)
        return self._system.equations.residual(y[:-1], self._shifted)


@dataclass
class _Point:
    """A solution: length s of its step, load factor, tangent (direction t, slope τ) with <t, t> +
    (τ/Λ)² = 1, number of negative eigenvalues, and Newton iterations.  At a branch point at which
    the path `turns` the tangent is that of the branch."""

    length: float
    factor: float
    direction: PETSc.Vec
    slope: float
    unstable: int
    iterations: int = 0
    turns: bool = False


class _PathView(StateView):
    """The last point of a path as a `solve.view.StateView`, for outputs: its `time` and its `step`
    are the number of the point, from 0."""

    axis = Axis("point of the path")

    def __init__(self, equilibrium: Equilibrium) -> None:
        self.comm = equilibrium.comm
        self.scene = equilibrium.scene
        self.system = equilibrium.system
        self.step = 0
        self.point: _Point
        self.iterations = 0
        self.residual = 0.0
        self.seconds = 0.0
        self.compile_seconds = equilibrium.compile_seconds

    @property
    def time(self) -> float:
        return float(self.step)

    @property
    def totals(self) -> Totals:
        return self.system.balance.totals()

    @property
    def account(self) -> Account:
        point = self.point
        words = LOAD_FACTOR.words(point.factor, digits=4)
        stability = {UNKNOWN: "", 0: ", stable"}.get(point.unstable, ", unstable")
        return Account(
            kind="equilibrium",
            method={"kind": "arc length"},
            until=self.time,
            iterations=self.iterations,
            last_iterations=point.iterations,
            seconds=self.seconds,
            compile_seconds=self.compile_seconds,
            columns={
                "residual": self.residual,
                LOAD_FACTOR.column: point.factor,
                "unstable": point.unstable,
            },
            caption=f"{words}{stability}",
            details={"summary": f"{self.step + 1} points of a path to {words}{stability}"},
        )

    @property
    def chambers(self) -> dict[str, Any]:
        return chamber_states(self.system)

    def chamber(self, name: str) -> Any:
        return chamber_state(self.system, name)


class _Follower:
    """Makes the steps of a path.

    Attributes:
        view: of the last point.
        branch: name of the probe that grows on the branch to which the path turns; "": none.
    """

    def __init__(
        self,
        equilibrium: Equilibrium,
        load: _Load,
        *,
        start: float,
        toward: float,
        first_step: float,
    ) -> None:
        """Compute the tangent of the path in the equilibrium found last, at the load factor
        `start`, in the direction of the load factor `toward`.  Collective."""
        started = time.process_time()
        system = equilibrium.system
        self._equilibrium = equilibrium
        self._system = system
        self._load = load
        self._until = toward
        self._sign = math.copysign(1.0, toward - start)
        self._first_step = first_step
        self._factor = _LoadFactor(system, load, DIFFERENCE_STEP * first_step)
        self._newton = Newton(system, Tolerances(), direct=True, extra=self._factor)
        self._zero = system.unknowns.numbering.vector()
        self._product = system.unknowns.numbering.vector()
        # w and scalar unknowns of the last solution, the load factor at their end.
        self._w = system.unknowns.numbering.vector()
        self._y: Array = np.zeros(0)
        self._displacement_weight = 0.0  # 1/W of (1)
        self._largest_load = 0.0  # norm of the external forces [N]
        self._iterations = 0
        # A first step of the load has this length, as displacements have an equal part.
        self._first_length = math.sqrt(2.0)
        self._length = self._first_length
        self.branch = ""
        self.view = _PathView(equilibrium)
        system.equations.set_inertia(0.0)
        self._last = self._first_point(start)
        self._show(self._last, started)

    def _first_point(self, start: float) -> _Point:
        """The state of the equilibrium, with the tangent towards the wanted load.  Sets 1/W of (1),
        zero if the load moves nothing, and the length of the first step."""
        factor = self._factor
        self._begin_at_point(start)
        factor.row[:] = 0.0
        factor.weight = self._sign
        factor.scale = 1.0
        direction, slope = self._tangent()
        unstable = self._count_unstable()
        square = self._mass_square(direction) * self._first_step**2
        if not math.isfinite(square):
            raise NoEquilibrium(
                "path: the tangent at the first point is singular; "
                "hold what is free, prestress what is slack, or start from a larger load."
            )
        # Stresses that balance each other, as of a heated plate between clamps, leave round-off.
        moved = self._largest_move(direction) * self._first_step
        if moved > EPSILON * self._system.unknowns.initial.extent():
            self._displacement_weight = 1 / square
        else:
            self._first_length = 1.0
            self._length = 1.0
        return self._unit(_Point(0.0, start, direction, slope, unstable))

    def _begin_at_point(self, factor: float) -> None:
        """Evaluate the residual of the accepted state, for `_tangent`.  Collective."""
        self._w.zeroEntries()
        self._factor.take_increment(self._w)
        guess = self._factor.begin_step(factor)
        self._y = np.append(guess, factor)
        self._factor.evaluate_at(factor, self._w, self._y, None)

    def _tangent(self) -> tuple[PETSc.Vec, float]:
        """The tangent (dq, dλ) of the path at the last solution, with the left side of (1) equal
        to one: its coordinates as a new vector, and its load factor.  Collective."""
        matrices = self._system.matrices
        matrices.assemble_tangent()
        # First that of the scene, as the other one moves the system to other load factors.
        of_scene = matrices.coupling()
        border = self._factor.border_at_point(self._w, self._y)
        self._newton.factorise(with_border(of_scene, border))
        right = np.zeros(len(self._y))
        right[-1] = 1.0
        dq, dy = self._newton.solve_linear(self._zero, right)
        return dq.copy(), float(dy[-1])

    def _null_direction(self) -> tuple[PETSc.Vec, float]:
        """The null vector (dq, dλ), of any length, of the matrix of the last `_tangent`, which was
        at a branch point: its coordinates as a new vector, and its load factor.  Collective."""
        # Any vector that has a part along the null vector will do.
        generator = np.random.default_rng(self._system.comm.rank)
        dq = self._zero.duplicate()
        with dq as values:
            values[:] = generator.standard_normal(values.size)
        right = np.zeros(len(self._y))
        for _ in range(INVERSE_ITERATIONS):
            self._mass_square(dq)  # sets `_product` = M dq
            self._product.normalize()
            solved, dy = self._newton.solve_linear(self._product, right)
            solved.copy(dq)
        return dq, float(dy[-1])

    def _mass_square(self, direction: PETSc.Vec) -> float:
        """t·M t, and M t in `_product`; fixed coordinates do not count."""
        self._system.unknowns.M.mult(direction, self._product)
        with self._product as values:
            values[self._system.unknowns.supports.held] = 0.0
        return float(direction.dot(self._product))

    def _largest_move(self, direction: PETSc.Vec) -> float:
        """The largest part of a direction [m], of which `_mass_square` was asked last, in a
        coordinate that has mass and is not fixed: multipliers do not count.  Collective."""
        parts = np.abs(direction.array_r)[self._product.array_r != 0]
        largest = float(parts.max(initial=0.0))
        return float(self._system.comm.allreduce(largest, op=MPI.MAX))

    def _unit(self, point: _Point) -> _Point:
        """Scale the tangent of a point to the length one, and return the point."""
        square = self._displacement_weight * self._mass_square(point.direction)
        length = math.sqrt(square + (point.slope / self._first_step) ** 2)
        point.direction.scale(1 / length)
        point.slope /= length
        return point

    def _count_unstable(self) -> int:
        """Number of negative eigenvalues of the stiffness of the last `direction`.  Collective."""
        return count_unstable(self._system, self._system.matrices.coupled_tangent.whole())

    # ---- steps -----------------------------------------------------------------------------------

    def _solve(self, length: float, *, at: float | None = None) -> _Point:
        """Solve for the point at a length s from the last one, or at the load factor `at`, of which
        the length is then an estimate.

        The system stands at the point, which is not accepted yet.  Raises `NotConverged`.
        Collective.
        """
        last = self._last
        newton = self._newton
        factor = self._factor
        system = self._system
        # Row of (1), which also orients the new tangent; `_mass_square` sets `_product` = M t.
        self._mass_square(last.direction)
        row = self._displacement_weight * self._product.array_r
        weight = last.slope / self._first_step**2
        factor.row[:] = row
        factor.weight = weight
        factor.scale = max(length, TINY_LENGTH)
        factor.predicted = last.factor + length * last.slope
        if at is not None:
            factor.row[:] = 0.0
            factor.weight = 1.0
            factor.scale = self._first_step
            factor.predicted = at
        system.equations.set_end(system.unknowns.q0)
        guess = factor.begin_step(factor.predicted)
        increment = last.direction.copy()
        increment.scale(length)
        factor.take_increment(increment)
        target = FINAL_REDUCTION * self._equilibrium.search.tolerance * self._load_scale()
        newton.tolerances = Tolerances(
            relative=0.0,
            absolute=target,
            scalars=FINAL_TOLERANCE,
            constraint=FINAL_TOLERANCE,
            max_iterations=MAX_ITERATIONS,
        )
        try:
            w, self._y, used = newton.solve(increment, np.append(guess, factor.predicted))
            w.copy(self._w)
            self.view.residual = newton.imbalance / self._load_scale()
        finally:
            self._iterations += newton.iterations
            increment.destroy()
        factor.row[:] = row
        factor.weight = weight
        factor.scale = 1.0
        direction, slope = self._tangent()
        unstable = self._count_unstable()
        if not math.isfinite(direction.norm()):
            raise NotConverged("the tangent of the path is singular")
        point = _Point(length, float(self._y[-1]), direction, slope, unstable, used)
        return self._unit(point)

    def _load_scale(self) -> float:
        """Largest external force so far [N], or that of the first step."""
        external = float(self._system.equations.external_forces().norm())
        first = self._factor.load_norm * self._first_step
        self._largest_load = max(self._largest_load, external, first)
        return max(self._largest_load, TINY_LOAD)

    def _has_event(self, point: _Point) -> bool:
        """Whether a limit or branch point lies between the last point and another one."""
        counts = {point.unstable, self._last.unstable}
        has_branch = not self._last.turns and len(counts) > 1 and UNKNOWN not in counts
        return has_branch or self._is_past_limit(point)

    def _is_past_limit(self, point: _Point) -> bool:
        """Whether a limit point lies between the last point and another one."""
        return not self._last.turns and point.slope * self._last.slope < 0

    def _locate(self, end: _Point, tolerance: float) -> _Point:
        """The point just behind the first limit or branch point before a point `end`, within a
        tolerance times the length of its step.  Frees the tangent of `end`.  Collective."""
        end.direction.destroy()
        low = 0.0
        high = end.length
        width = tolerance * end.length
        if not self._is_past_limit(end):
            width *= BRANCH_WIDTH
        while high - low > width:
            middle = (low + high) / 2
            tried = self._solve(middle)
            tried.direction.destroy()
            if self._has_event(tried):
                high = middle
            else:
                low = middle
        # A little farther, where both signs of a limit point have changed in spite of round-off.
        return self._solve(high + width)

    def _accept(self, point: _Point) -> None:
        """Make the solution of the last `_solve` the state of the scene."""
        system = self._system
        system.commit(self._zero)
        # A point of the path is an equilibrium, from which histories go on.
        for kind in system.equations.compiled:
            kind.begin_search()
        # Sets the time of the load itself: adding the pseudo-time to the time would round it.
        self._equilibrium.take_over(self._load.time(point.factor))
        self._last.direction.destroy()
        self._last = point

    def _turn(self, measure: Measure, name: str) -> None:
        """Let the path go on from its last point, a branch point, along the branch on which a probe
        grows: `_last` gets the tangent of the branch.  Collective."""
        last = self._last
        system = self._system
        direction, slope = self._null_direction()
        branch = _Point(0.0, last.factor, direction, slope, last.unstable, turns=True)
        if not self._displacement_weight:
            # The load has moved nothing up to here: on the branch a length of one is a small move.
            square = self._mass_square(direction)
            length = BRANCH_MOVE * system.unknowns.initial.extent() / self._largest_move(direction)
            self._displacement_weight = 1 / (square * length**2)
        self._unit(branch)
        # Central difference of the probe along the branch.
        history = History(system)
        here = history.save(MOTION)
        values = []
        for sign in (1, -1):
            history.restore(here.moved_by(sign * direction.array_r))
            values.append(float(measure(self._equilibrium)))
        history.restore(here)
        grown = values[0] - values[1]
        check(
            abs(grown) > ROUND_OFF * max(map(abs, values)),
            f"path: the probe '{name}' does not change along the branch at the load factor "
            f"{last.factor:.6g}; give one that does.",
        )
        if grown < 0:
            direction.scale(-1.0)
            branch.slope = -branch.slope
        last.direction.destroy()
        self._last = branch

    def _branch_length(self, tolerance: float) -> float:
        """Length of the first step on a branch, in which the load changes noticeably or Newton's
        iteration fails.  Collective."""
        length = self._first_length
        change = BRANCH_LOAD_CHANGE * tolerance * self._first_step
        while True:
            try:
                point = self._solve(length)
            except NotConverged:
                return length
            point.direction.destroy()
            if abs(point.factor - self._last.factor) > change:
                return length
            length *= BRANCH_GROWTH

    def _next(self, length: float, shortest: float, tolerance: float) -> _Point:
        """The next point of the path, not accepted yet, by a step of at most a length.  It may be a
        limit or branch point, or that of the wanted load.  Raises `NoEquilibrium` if steps longer
        than `shortest` fail.  Collective."""
        reason = "none"
        # Length below which the tangent may turn by any angle.
        kink = KINK_STEP_RATIO / MIN_STEP_RATIO * shortest
        while length > shortest:
            try:
                point = self._solve(length)
                if length > kink and self._cosine(point) < MIN_COSINE:
                    point.direction.destroy()
                    length /= 2
                    continue
                if self._has_event(point):
                    point = self._locate(point, tolerance)
                # A point at or beyond the wanted load: solve at this load instead.
                if (point.factor - self._until) * self._sign >= 0:
                    share = (self._until - self._last.factor) / (point.factor - self._last.factor)
                    point.direction.destroy()
                    point = self._solve(share * point.length, at=self._until)
                    point.factor = self._until
            except NotConverged as failure:
                reason = str(failure)
                length /= 2
            else:
                return point
        self._stand_at_last()
        raise NoEquilibrium(
            f"path: no further equilibrium from the load factor {self._last.factor:.6g} on, "
            f"last failure: {reason}."
        )

    def _stand_at_last(self) -> None:
        """Give load, reactions and time of the last point to the system, whose state is that point,
        after steps that were not accepted.  Collective."""
        self._begin_at_point(self._last.factor)
        self._system.unknowns.time = self._load.time(self._last.factor)

    def _cosine(self, point: _Point) -> float:
        """Cosine of the angle between the tangents at the last point and at another one."""
        self._mass_square(point.direction)  # sets `_product` = M t
        along = self._displacement_weight * float(self._last.direction.dot(self._product))
        return along + point.slope * self._last.slope / self._first_step**2

    def _show(self, point: _Point, started: float) -> None:
        """Let the view have a point, for which the CPU time from `started` [s] on was spent."""
        self.view.point = point
        self.view.iterations = self._iterations
        self.view.seconds += time.process_time() - started

    def _measured(self, name: str, probe: Measure) -> float:
        """The value of a probe at the last point; `InputError` unless it is a finite number, the
        same on all ranks.  Collective."""
        return evaluate_probe(self._equilibrium, f"Probe '{name}'", probe)

    def follow(
        self,
        until: float,
        max_steps: int,
        probes: Mapping[str, Measure],
        tolerance: float,
        write: Callable[[], None],
    ) -> EquilibriumPath:
        """Follow the path from the last point to a load, and at its first branch point to a branch;
        `write` lets outputs write a point.  Collective."""
        self._until = until
        self._sign = math.copysign(1.0, until - self._last.factor)
        points = [self._last]
        measured = {name: [self._measured(name, probe)] for name, probe in probes.items()}
        write()
        limit_points = []
        branch_points = []
        is_complete = False
        while not is_complete and len(points) <= max_steps:
            started = time.process_time()
            point = self._next(self._length, MIN_STEP_RATIO * self._first_length, tolerance)
            is_complete = point.factor == until
            if self._is_past_limit(point):
                limit_points.append(len(points))
            elif self._has_event(point):
                branch_points.append(len(points))
            self._accept(point)
            self.view.step += 1
            self._show(point, started)
            points.append(point)
            for name, probe in probes.items():
                measured[name].append(self._measured(name, probe))
            write()
            growth = math.sqrt(WANTED_ITERATIONS / max(point.iterations, 1))
            length = max(point.length, SHARE_OF_SHORT_STEP * self._length)
            self._length = length * min(max(growth, MIN_GROWTH), MAX_GROWTH)
            if self.branch and branch_points == [len(points) - 1]:
                self._turn(probes[self.branch], self.branch)
                self._length = self._branch_length(tolerance)
                self._stand_at_last()
                self.branch = ""
        return EquilibriumPath(
            np.array([point.factor for point in points]),
            columns={name: np.array(values) for name, values in measured.items()},
            unstable=np.array([point.unstable for point in points], dtype=np.int32),
            limit_points=tuple(limit_points),
            branch_points=tuple(branch_points),
            iterations=self._iterations,
            complete=is_complete,
        )
