"""Newton's method for the equations of one step, with the mixed iteration for strains.

Problem.  A step from q0 to q1 = q0 + p + w has the equations

    r(w, y) = 0    balance of forces [N], and constraints in the rows of multipliers          (1)
    s(w, y) = 0    equations of the scalar unknowns y, such as gas pressures                  (2)

The predicted increment p comes from the stepper.  A film switches between taut, wrinkled and slack,
so that a plain Newton iteration cycles or diverges at steps of practical length.

Idea.  The strains ε at the quadrature points are unknowns in addition to w, and are eliminated
point by point (Magisano, Leonetti & Garcea, IJNME 109 (2017) 1237).  An iterate k has the strain
that is linear in the last update, not the true strain e(q1):

    ε_k = e(q_{k-1}) + De(q_{k-1}) (w_k - w_{k-1})                                            (3)

`terms.element_energies` evaluates (3) and the stress.  Therefore the residual depends on the
sequence of iterates, and a line search, which evaluates it elsewhere, must not be used.

Algorithm.

1. Start at w = 0 and at the first guess of y.  Fixed coordinates have their values of the end of
   the step.
2. Compute ε from (3), then r and s.
3. If r and s pass the test of convergence (`solvers.convergence`), replace ε by the true strain
   e(q1) and evaluate r and s again.  If they pass again, go to step 6; otherwise, and once after
   the first iteration of a time step, continue with these strains.
4. Assemble the tangent.  The first `geometric_stiffness_delay` tangents of a step have no geometric
   stiffness, as long as the residual is above `COMPLETE_TANGENT_RATIO` of the first one.
5. Solve the linear system (`solvers.linear`), shorten the update where contact requires it, go to
   2.
6. If contact pairs were missing, add them and continue from 2, at most `MAX_ACTIVE_SET_UPDATES`
   times.
7. Refuse an inadmissible solution, e.g. one with interpenetration.

Cost.  An iteration is one evaluation of the stress, one residual, one tangent and one linear
system. A fluttering sheet takes 4 to 9 iterations a step, see the tables of `docs/theory/step.md`.

Limits.  The iteration is local: a step that is too long fails (`NotConverged`) and the caller
shortens it.  It fails at its last iterate, at residuals that grow beyond measure, and, in time
steps with contact and without friction, when they no longer fall (`solvers.convergence`).
"""

from __future__ import annotations

import math
import time
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from petsc4py import PETSc

import gossamer_fx.solve.solvers.factorisation as factorisation
import gossamer_fx.solve.solvers.linear as linear
from gossamer_fx.core.algebra.numbering import PREFIX
from gossamer_fx.core.checks.errors import Inadmissible, InputError, NotConverged, check
from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.solvers.convergence import ConvergenceTest, Residual, StallRule, Tolerances
from gossamer_fx.solve.system.residual_sizes import (
    body_imbalances,
    force_scales,
    out_of_balance,
)
from gossamer_fx.solve.system.system import System

# Contact pairs may be found missing only once a step is solved.  A step that still misses some
# after this number of extensions is judged as it is, and usually refused as inadmissible.
MAX_ACTIVE_SET_UPDATES = 5

# The last linear solve of a step reduces the residual to this fraction of its tolerance: what a
# loose linear solve leaves of the residual would appear as an error of the energy.
FINAL_LINEAR_RATIO = 0.01

# No relative tolerance of a linear solve is smaller: round-off of the Krylov method.
MIN_LINEAR_RTOL = 1e-12

# The factors of a full matrix are reused once the residual is below this multiple of its tolerance
# and below this fraction of the first residual.  The last iterations of a step then cost no
# factorisation.
REUSE_FACTORS_BELOW_TOLERANCE = 1e3
REUSE_FACTORS_RATIO = 1e-6

# Residual over the first one below which the message of a failure names the absolute tolerance that
# would pass it: friction can keep an iteration at forces that are far below those of the scene.
SMALL_RESIDUAL_RATIO = 1e-5

# Residual over the first one below which tangents have their geometric stiffness, whatever the
# delay: without it the iteration converges only linearly.
COMPLETE_TANGENT_RATIO = 0.01


# Column (n,) of ∂r/∂y, row (n,) of the derivative of its equation by w, and column (m + 1,) of the
# other equations and its own, of an extra unknown; n counts this rank's unknowns.
Border = tuple[Array, Array, Array]

# Columns of G, columns of H (None: zero), and C (m, m) of (1) of `solvers.linear`.
Coupling = tuple[list[Array | None], list[Array | None], Array]


def with_border(coupling: Coupling, border: Border) -> Coupling:
    """A coupling of m scalar unknowns with that of an extra one behind them."""
    columns, rows, corner = coupling
    column, row, last = border
    count = len(corner)
    whole = np.zeros((count + 1, count + 1))
    whole[:count, :count] = corner
    whole[:, count] = last
    return [*columns, column], [*rows, row], whole


def _weak_method(method: Any) -> Callable[..., Any]:
    """A bound method with only a weak reference to its object.  The garbage collector does not see
    references held by a solver of PETSc, so an ordinary bound method would make a reference cycle
    that is never freed."""
    # `weakref.WeakMethod` would make two more calls in each.
    reference = weakref.ref(method.__self__)
    function = method.__func__

    def call(*args: Any) -> Any:
        return function(reference(), *args)

    return call


class ExtraUnknown(ABC):
    """A scalar unknown of the solver itself, e.g. the load factor of a path, as the last of y, with
    an equation; equations (1) and (2) depend on it."""

    @abstractmethod
    def apply(self, value: float) -> Array | None:
        """Let the system have the equations of this value.  Returns w of this rank's fixed
        coordinates, in the order of `supports.held`; None if nothing has changed.  An `InputError`
        ends the iteration, and is the reason of its failure.  Collective."""

    @abstractmethod
    def residual(self, w: PETSc.Vec, value: float) -> float:
        """Residual of its equation, over the size of what it balances.  Collective."""

    @abstractmethod
    def border(self, w: PETSc.Vec, y: Array, base: PETSc.Vec | None) -> Border:
        """Derivatives by this unknown at an iterate w and y (m + 1,), whose strains are linear from
        w = `base`, or without it the true ones.  Collective."""


class Newton:
    """Solves r(w, y) = 0, s(w, y) = 0 for a compiled system, see the module for the algorithm.

    PETSc options with prefix `gx_` apply (e.g. `-gx_snes_monitor`), except a line search, see the
    module.

    Without geometric stiffness the tangent is positive semi-definite in addition to the inertia, so
    that the iteration is slow but safe.  With it, film under large compressive stress or a stiff
    fold has an indefinite tangent far from the solution, and the iteration may diverge.  At rest
    (statics) the geometric stiffness of film in tension is never left out.

    Statics need `direct` factorisations: with little inertia, film with slack parts is too
    ill-conditioned for an iterative solver.

    Attributes:
        geometric_stiffness_delay: number of tangents at the start of a step without geometric
            stiffness; a stepper sets it.
        largest_energy: so far [J], the scale of the work of a residual; zero: it is not judged.
        round_off_energy: energy [J] that round-off gives to a scene at rest, the largest of all
            steps.
        convergence: test of convergence of the last solve.
        ksp: PETSc's solver of the linear systems.
        stall_rule: when an iteration is given up; None: not before its last iterate.
        iterations: of the last solve, also if it failed.
        all_iterations: of all solves.
        linear_iterations: Krylov iterations of all solves.
        seconds: wall time [s] of all solves by part of the iteration.
    """

    def __init__(
        self,
        system: System,
        tolerances: Tolerances,
        direct: bool = False,
        extra: ExtraUnknown | None = None,
    ) -> None:
        """`extra` is a scalar unknown behind those of the scene."""
        self.system = system
        self._extra = extra
        # Why the extra unknown of an iterate has no equations; None: it has.
        self._refusal: InputError | None = None
        self.tolerances = tolerances
        self.geometric_stiffness_delay = 0
        self.largest_energy = 0.0
        self.round_off_energy = 0.0
        self.iterations = 0
        self.all_iterations = 0
        self.linear_iterations = 0
        self.seconds = dict.fromkeys(("law", "residual", "tangent", "linear solver"), 0.0)

        self._scalar_count = system.matrices.scalar_count
        if extra is not None:
            self._scalar_count += 1
        # Vectors of the unknowns (w, y), of the residuals (r, s), and of (w, y) at the start of an
        # iteration.
        self._composite = linear.Composite(system.comm, system.unknowns.q1, self._scalar_count)
        self._x = self._composite.vector()
        self._F = self._composite.vector()
        self._start = self._composite.vector()
        # Whether the linear system of this iterate has a solution that is finite.
        self._has_update = True
        # Whether the present iteration follows one that has solved the step.
        self._is_refining = False
        # Norms of the residual evaluated last.
        self._residual = Residual(math.inf)
        # Shares of the lengths of the updates of an iteration that remain, see `_limit_update`.
        self._kept_shares: list[float] = []
        self._r = system.unknowns.numbering.vector()
        # Scalar unknowns of the last residual.
        self._y: Array = np.zeros(self._scalar_count)
        # w of the last residual, and that from which the strains of the next one are linear.
        self._w_evaluated = system.unknowns.numbering.vector()
        self._linearisation_point = system.unknowns.numbering.vector()
        self._diagonal = system.unknowns.numbering.vector()
        self.convergence = ConvergenceTest(tolerances, bool(system.equations.active_sets))
        self.stall_rule: StallRule | None = None
        has_plateaus = any(kind.has_plateaus for kind in system.equations.active_sets)
        if system.equations.active_sets and not has_plateaus and not system.unknowns.rule.is_static:
            self.stall_rule = StallRule(tolerances.max_iterations)
        self._default_linear_rtol: float | None = None
        self._direct = direct
        self._set_up()

    # ---- PETSc's solvers -------------------------------------------------------------------------

    def _set_up(self) -> None:
        """Make PETSc's solvers for the matrix of the linear systems: the stored tangent, or one
        that also contains scalar unknowns and couplings of contact.  Collective."""
        system = self.system
        self._snes = PETSc.SNES().create(system.comm)
        self._snes.setOptionsPrefix(PREFIX)
        self._snes.setType("newtonls")
        self.ksp = self._snes.getKSP()
        self._refuse_line_search()
        self._snes.setFunction(_weak_method(self._function), self._F)
        # A linear solve that ends at its limit of iterations still gives an inexact Newton step.
        self._snes.setMaxLinearSolveFailures(self.tolerances.max_iterations)
        self._tangent: Callable[[], PETSc.Mat] = lambda: system.matrices.assemble_tangent().A
        self._bordered: linear.Bordered | None = None
        if self._scalar_count or system.equations.active_sets:
            J = self._set_up_bordered()
        else:
            self._preconditioner = self.ksp.getPC()
            linear.configure(self.ksp, self._preconditioner, system, self._direct)
            # After `configure`, which may make the matrices of the system again.
            J = system.matrices.A
        self._snes.setJacobian(_weak_method(self._jacobian), J)
        self._snes.setFromOptions()
        self._snes.setConvergenceTest(_weak_method(self._test))
        self._snes.setLineSearchPreCheck(_weak_method(self._limit_update))

    def _refuse_line_search(self) -> None:
        """Check that PETSc's options ask for full Newton steps."""
        options = PETSc.Options(PREFIX)
        kind = options.getString("snes_linesearch_type", "basic")
        check(
            kind == "basic",
            f"-gx_snes_linesearch_type {kind}: "
            "the strains of the iteration follow each step of Newton's, "
            "so that a line search would lead it astray; leave the option out.",
        )
        options["snes_linesearch_type"] = "basic"

    def _set_up_bordered(self) -> PETSc.Mat:
        """Set up linear solvers with scalar unknowns (gas pressures) or couplings of contact, whose
        matrix is not stored; its preconditioner acts on the stored tangent of the coordinates and
        eliminates the scalar unknowns.  Collective."""
        system = self.system
        sparse = PETSc.PC().create(system.comm)
        sparse.setOptionsPrefix(PREFIX)
        # First, as it may make the matrices of the system again.
        linear.configure(self.ksp, sparse, system, self._direct)
        sparse.setOperators(system.matrices.A)
        sparse.setFromOptions()
        self._preconditioner = sparse
        self._bordered = linear.Bordered(self._composite, system.matrices.coupled_tangent)
        sizes = self._x.getSizes()
        J = PETSc.Mat().createPython((sizes, sizes), self._bordered, system.comm)
        J.setUp()
        outer = self.ksp.getPC()
        outer.setOptionsPrefix(PREFIX + "border_")
        outer.setType("python")
        outer.setPythonContext(linear.BorderedPreconditioner(self._bordered, sparse, system))
        return J

    # ---- a solve ---------------------------------------------------------------------------------

    def solve(self, increment: PETSc.Vec, y: Array) -> tuple[PETSc.Vec, Array, int]:
        """Solve the equations of a step from a predicted increment p = q1 - q0 [m] and a first
        guess y of the scalar unknowns; q1 is then in the system.  Collective.

        Returns:
            w = q1 - q0 - p, in a vector that the next call overwrites; y, with the extra unknown at
                its end; and the number of Newton iterations.

        Raises:
            NotConverged: with PETSc's reason and where the residual is largest.
            Inadmissible: with what is wrong with the solution, e.g. that films intersect.
        """
        # On several ranks PETSc keeps the objects that Python has dropped until all ranks ask for
        # this: here, so that those of a rejected step are freed before the next attempt.
        PETSc.garbage_cleanup(self.system.comm)
        self.convergence = ConvergenceTest(self.tolerances, bool(self.system.equations.active_sets))
        # With w = 0 at the predictor, w = -p is the start of the step: strains are linear from
        # there.
        increment.copy(self._linearisation_point)
        self._linearisation_point.scale(-1.0)
        self._refusal = None
        if self._extra is not None:
            # The fixed coordinates of the first iterate are those of the predicted value.
            self._extra.apply(float(y[-1]))
        self._fixed_values = self.system.equations.predict(increment)
        self._r.zeroEntries()
        self._r.array[self.system.unknowns.supports.held] = self._fixed_values
        self._composite.join(self._r, y, self._x)
        self.iterations = 0
        self._iterate()
        for _ in range(MAX_ACTIVE_SET_UPDATES):
            if not self.system.equations.extend_active_set():
                break
            self._iterate()
        problem = self.system.equations.inadmissible()
        if problem:
            raise Inadmissible(problem)
        w, y = self._split(self._x)
        return w, y, self.iterations

    def _iterate(self) -> None:
        """Newton's iteration from the present x = (w, y), which is changed in place.
        Collective."""
        # stol = 0: PETSc must not take a small update for a solution.
        self._snes.setTolerances(stol=0.0, max_it=self.tolerances.max_iterations)
        seconds_before = sum(self.seconds.values())
        started = time.perf_counter()
        self._x.copy(self._start)
        self._has_update = True
        self._is_refining = False
        self._snes.solve(None, self._x)
        # A factorisation that lacks workspace is repeated with more; the step is not rejected for
        # it.
        while self._snes.getConvergedReason() < 0 and factorisation.enlarge(self._preconditioner):
            self._start.copy(self._x)
            self._has_update = True
            self._snes.solve(None, self._x)
        # What the callbacks did not take was spent in the linear solver.
        in_callbacks = sum(self.seconds.values()) - seconds_before
        self.seconds["linear solver"] += time.perf_counter() - started - in_callbacks
        reason = self._snes.getConvergedReason()
        iterations = int(self._snes.getIterationNumber())
        self.iterations += iterations
        self.all_iterations += iterations
        self.linear_iterations += self._snes.getLinearSolveIterations()
        if reason <= 0:
            message = self._failure_message(reason, iterations)
            linear.recover(self.ksp.getPC())
            if self._refusal is not None:
                raise NotConverged(str(self._refusal)) from self._refusal
            raise NotConverged(message)

    # ---- linear systems at a solution ------------------------------------------------------------

    def factorise(self, coupling: Coupling) -> None:
        """Factorise the matrix (1) of `solvers.linear`, of the tangent that was assembled last and
        of a coupling as of `with_border`, for `solve_linear`.  Collective."""
        assert self._bordered is not None
        self._bordered.set(*coupling)
        self.ksp.getOperators()[0].assemble()
        # Before a solution uses its factors: one that lacks workspace is repeated with more.
        factorisation.set_up(self._preconditioner)

    def solve_linear(self, r: PETSc.Vec, s: Array) -> tuple[PETSc.Vec, Array]:
        """The solution (δz, δy) of that system for a right side (r, s); δz is in a vector that the
        next call overwrites.  Collective."""
        self._composite.join(r, s, self._F)
        self.ksp.solve(self._F, self._x)
        return self._composite.split(self._x)

    # ---- callbacks of PETSc: residual and tangent ------------------------------------------------

    def _function(self, snes: PETSc.SNES, x: PETSc.Vec, F: PETSc.Vec) -> None:
        """Set F to the residual of (1) and (2) at x, with the strains (3); called by PETSc.
        Collective."""
        if self._refusal is None and self._has_update:
            try:
                w, y = self._split(x)
                w.copy(self._w_evaluated)
                started = time.perf_counter()
                self.system.equations.set_increment(w, self._linearisation_point)
                self._add_time("law", started)
                self._evaluate(y, F)
            except InputError as refusal:
                if self._extra is None:
                    raise
                self._refusal = refusal
        if self._refusal is not None or not self._has_update:
            # Laws and contacts have nothing to compute at infinite positions; NaN ends the
            # iteration.
            F.set(math.nan)

    def _evaluate(self, y: Array, F: PETSc.Vec) -> None:
        """Set F to the residual with the strains that the system has, and store its norms.
        Collective."""
        started = time.perf_counter()
        s = self._residuals(y)
        imbalance, violation = out_of_balance(self.system.equations, self._r)
        self._residual = Residual(imbalance, violation, float(abs(s).max(initial=0.0)))
        self._add_time("residual", started)
        self._composite.join(self._r, s, F)

    def _residuals(self, y: Array) -> Array:
        """Set the vector `_r` to r of (1), and return s of (2) and that of the extra unknown.
        Collective."""
        self._y = y
        if self._extra is None:
            return self.system.equations.residual(y, self._r)
        s = self.system.equations.residual(y[:-1], self._r)
        return np.append(s, self._extra.residual(self._w_evaluated, float(y[-1])))

    def _coupling(self) -> Coupling:
        """Columns of G, columns of H, and C of (1) of `solvers.linear`: the coupling of all scalar
        unknowns with the coordinates, as `Matrices.coupling` returns it, that of the extra unknown
        last.  Collective."""
        coupling = self.system.matrices.coupling()
        if self._extra is None:
            return coupling
        try:
            border = self._extra.border(self._w_evaluated, self._y, self._linearisation_point)
        except InputError as refusal:
            # The next residual ends the iteration; up to there the matrix has to be regular.
            self._refusal = refusal
            nothing = np.zeros(self._composite.n)
            border = nothing, nothing, np.append(np.zeros(len(self._y) - 1), 1.0)
        return with_border(coupling, border)

    def _split(self, x: PETSc.Vec) -> tuple[PETSc.Vec, Array]:
        """w and y of x; fixed coordinates get their values, which not every linear solver keeps
        exactly."""
        w, y = self._composite.split(x)
        if self._extra is not None:
            changed = self._extra.apply(float(y[-1]))
            if changed is not None:
                self._fixed_values = changed
        w.array[self.system.unknowns.supports.held] = self._fixed_values
        return w, y

    def _limit_update(self, x: PETSc.Vec, update: PETSc.Vec) -> bool:
        """Shorten an update where contact requires it; whether it may have changed.  Called by
        PETSc. Collective."""
        length = float(update.norm())
        self._has_update = math.isfinite(length)
        if not (self._has_update and self.system.equations.active_sets):
            return False
        self.system.equations.limit_update(update.array[: self._composite.n])
        self._kept_shares.append(float(update.norm()) / max(length, factorisation.TINY))
        return True

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        """Assemble the tangent at the iterate; called by PETSc.  Collective.

        Near the solution the last factors of a dense matrix are used again.  In the first
        iterations of a step, far from the solution, the tangent may be without geometric stiffness,
        which would make it indefinite.
        """
        iteration = snes.getIterationNumber()
        test = self.convergence
        may_reuse = self.system.unknowns.numbering.full and iteration
        is_near = may_reuse and test.norm < min(
            REUSE_FACTORS_BELOW_TOLERANCE * test.tolerance,
            REUSE_FACTORS_RATIO * test.reference,
        )
        if self._is_refining or is_near:
            self._w_evaluated.copy(self._linearisation_point)
            return
        started = time.perf_counter()
        is_far = test.norm > COMPLETE_TANGENT_RATIO * test.reference
        is_delayed = is_far and iteration < self.geometric_stiffness_delay
        if is_delayed:
            self._set_geometric_stiffness(0.0)
        A = self._tangent()
        if is_delayed:
            # Complete again at once, so that no other user of the system gets a tangent without it.
            self._set_geometric_stiffness(1.0)
        self._add_time("tangent", started)
        if self._bordered is not None:
            self._bordered.set(*self._coupling())
            J.assemble()
        self._update_round_off_floor(A)
        self._w_evaluated.copy(self._linearisation_point)
        self._choose_linear_tolerance()

    def _set_geometric_stiffness(self, share: float) -> None:
        """Choose the share of the geometric stiffness in tangents, 0 or 1."""
        self.system.unknowns.geometric = share
        for at in self.system.unknowns.coordinates.values():
            at.γ.value = share

    def _update_round_off_floor(self, A: PETSc.Mat) -> None:
        """Estimate the round-off of the residual [N] from the diagonal of the tangent A [N/m].
        Collective.

        Once a step, but at each tangent with contact: bodies that penetrate each other in the
        predictor have stiffnesses there that are far too large, so the smallest estimate counts.
        """
        is_first = self.convergence.round_off_floor == 0
        if not is_first and not self.system.equations.active_sets:
            return
        A.getDiagonal(self._diagonal)
        self.convergence.lower_floor(*force_scales(self.system.equations, self._diagonal))
        if is_first:
            unknowns = self.system.unknowns
            energy = unknowns.increment.round_off_energy(unknowns.M, self._diagonal, unknowns.q1)
            self.round_off_energy = max(self.round_off_energy, energy)

    def _choose_linear_tolerance(self) -> None:
        """Set the relative tolerance of the next linear solve: tight if it is likely the last of
        the step."""
        if self._default_linear_rtol is None:
            self._default_linear_rtol = self.ksp.getTolerances()[0]
        rtol = self._default_linear_rtol
        # The ordinary tolerance would end within a factor of ten of convergence, or below.
        tolerance = self.convergence.tolerance
        imbalance = self._residual.imbalance
        if 0 < imbalance * rtol < 10 * tolerance:
            last = FINAL_LINEAR_RATIO * tolerance / imbalance
            rtol = min(rtol, max(last, MIN_LINEAR_RTOL))
        self.ksp.setTolerances(rtol=rtol)

    # ---- the test of convergence -----------------------------------------------------------------

    @property
    def round_off(self) -> float:
        """Residual [N] that round-off alone explains in the last solve."""
        return self.convergence.round_off

    @property
    def imbalance(self) -> float:
        """Norm of the residual [N] that was evaluated last in a solve."""
        return self._residual.imbalance

    def _test(self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]) -> int:
        """The test of convergence: 0 to go on, or PETSc's code of convergence (> 0) or divergence
        (< 0). The residual is evaluated again where the first test passes.  Called by PETSc.
        Collective."""
        reasons = PETSc.SNES.ConvergedReason
        if not np.isfinite(norms[2]):
            return int(reasons.DIVERGED_FNORM_NAN)
        self._is_refining = False
        test = self.convergence
        test.record(self._residual.imbalance, is_first=iteration == 0)
        if iteration == 0:
            self._kept_shares = []
            if self.system.equations.active_sets:
                test.limit_reference(self._stopping_force(), self._external_force)
        if self._is_solved():
            # Convergence is judged at the true strain.  If that does not pass, the iteration goes
            # on from it.
            w, y = self._split(snes.getSolution())
            started = time.perf_counter()
            self.system.equations.set_increment(w, None)
            self._add_time("law", started)
            self._evaluate(y, snes.getFunction()[0])
            if self._is_solved():
                is_alone = iteration == 1 and self.tolerances.max_iterations > 1
                self._is_refining = is_alone and self._leaves_remainder()
                if not self._is_refining:
                    return int(reasons.CONVERGED_FNORM_ABS)
        if test.diverges():
            return int(reasons.DIVERGED_DTOL)
        if iteration >= self.tolerances.max_iterations:
            return int(reasons.DIVERGED_MAX_IT)
        rule = self.stall_rule
        if rule is not None and rule.has_stalled(test, self._kept_shares):
            return int(reasons.DIVERGED_LOCAL_MIN)
        return 0

    def _is_solved(self) -> bool:
        """Whether the residual evaluated last passes the test of convergence.  Collective."""
        return self.convergence.is_solved(
            self._residual,
            self._energy_error_is_small,
            lambda: body_imbalances(self.system.unknowns, self._r),
        )

    def _leaves_remainder(self) -> bool:
        """Whether a time step that one iteration has solved gets another one, with the same
        factors, until its residual is round-off.  Such steps are alike, so that what they leave
        adds up: 4000 steps of a free rigid body lost 2e-11 of its energy, and lose 1e-15."""
        return not self.system.unknowns.rule.is_static and self._residual.imbalance > self.round_off

    def _stopping_force(self) -> float:
        """Norm [N] of the force that stops all motion within the step and reverses it."""
        # `_diagonal` serves as space for M v0.
        self.system.unknowns.M.mult(self.system.unknowns.v0, self._diagonal)
        return (
            self.system.unknowns.increment.c * self.system.unknowns.h * float(self._diagonal.norm())
        )

    def _external_force(self) -> float:
        """Norm [N] of the forces of loads, gas and supports at the last residual.  What rests on
        something has no motion to stop: then these are the scale of the contact forces."""
        external, _ = out_of_balance(self.system.equations, self.system.equations.external_forces())
        return external

    def _energy_error_is_small(self, factor: float) -> bool:
        """Whether the work of the residual in the step, |r·(q1 - q0)| [J], the error of the total
        energy, is below `factor` times the energy tolerance times the largest energy so far; True
        if no energy is known.  Collective."""
        if not self.largest_energy:
            return True
        system = self.system
        forces = self._r.array_r
        if system.equations.constraints:
            # Rows of multipliers hold violations of constraints, which are not forces.
            forces = forces[: system.equations.constraints.owned.start]
        n = forces.size
        moved = system.unknowns.q1.array_r[:n] - system.unknowns.q0.array_r[:n]
        work = abs(system.comm.allreduce(float(forces @ moved)))
        tolerance = factor * self.tolerances.energy
        if work <= tolerance * self.largest_energy:
            return True
        # What starts from rest has hardly any energy before its first step.
        return work <= tolerance * system.balance.kinetic_energy_of_step()

    # ---- reports ---------------------------------------------------------------------------------

    def summary(self) -> str:
        """The linear solver, its iterations, and the shares of the wall time of all solves, in one
        line."""
        ksp = linear.krylov_name(self.ksp)
        preconditioner = linear.name(self._preconditioner)
        total = sum(self.seconds.values()) or 1.0
        shares = ", ".join(
            f"{part} {seconds / total:.0%}" for part, seconds in self.seconds.items()
        )
        krylov = self.linear_iterations / max(self.all_iterations, 1)
        return f"{ksp} with {preconditioner}, {krylov:.1f} iterations for one of Newton's; {shares}"

    def _add_time(self, part: str, started: float) -> None:
        """Add the wall time since `started` to a part of `seconds`."""
        self.seconds[part] += time.perf_counter() - started

    def _failure_message(self, reason: int, iterations: int) -> str:
        """Why the iteration failed, how far it came, and where the residual is largest, in
        words."""
        names = {v: k for k, v in vars(PETSc.SNES.ConvergedReason).items() if isinstance(v, int)}
        why = names.get(reason, str(reason)).lower().replace("_", " ")
        if reason == PETSc.SNES.ConvergedReason.DIVERGED_LOCAL_MIN:
            # PETSc has no code for an iteration that stalls.
            why = "the residual no longer falls"
        if self.ksp.getConvergedReason() < 0 or not self._has_update:
            why += f", linear solver: {linear.reason(self.ksp, self._preconditioner)}"
        residual = self._residual
        if residual.violation > self.tolerances.constraint:
            why += f", constraints off by {residual.violation:.1e}"
        unsolved = [scalars.unsolved() for scalars in self.system.equations.scalar_unknowns]
        first_unsolved = next(filter(None, unsolved), "")
        if first_unsolved:
            why += f", {first_unsolved},"
        reference = self.convergence.reference
        remedy = ""
        # The tolerances of statics follow from the loads.
        if (
            residual.imbalance < SMALL_RESIDUAL_RATIO * reference
            and not self.system.unknowns.rule.is_static
        ):
            remedy = (
                "; if forces of this size do not matter, "
                f"give Tolerances(absolute={2 * residual.imbalance:.0e})"
            )
        return (
            f"{why} after {iterations} iterations, "
            f"residual {residual.imbalance:.1e} N of {reference:.1e} N at first, "
            f"largest in {self.system.unknowns.locate(self._r)}{remedy}"
        )
