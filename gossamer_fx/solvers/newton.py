"""PETSc's nonlinear solver on the equations of one step, with the mixed iteration of `discrete_gradient`."""

from __future__ import annotations

import math
import time
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from petsc4py import PETSc

import gossamer_fx.solvers.factorisation as factorisation
import gossamer_fx.solvers.linear as linear
from gossamer_fx.algebra.numbering import PREFIX
from gossamer_fx.checks.errors import check
from gossamer_fx.model.body import Array
from gossamer_fx.solvers.failures import Inadmissible, NotConverged
from gossamer_fx.solvers.tolerances import Tolerances
from gossamer_fx.system.system import System

SEARCHES = (
    5  # of places that a solved step turns out to need, before what is still missed is refused
)
LAST = 0.01  # residual that the last linear solve of a step leaves, over that of a solved step
EXPLODED = (
    1e12  # residual, over the first two (one may be round-off), from which no iteration returns
)
# residual over that of a solved step, and over the first, up to which a full matrix is not made and factorised anew
KEPT, CLOSE = 1e3, 1e-6
NEAR = 0.01  # residual over the first, from which on tangents are complete
# residual over the force that would stop all that moves, below which it counts as zero where bodies touch: film that
# flies free between two contacts has next to no forces, and its state changes with the round-off of its strains
STILL = 1e-12
FALLS, STANDS = (
    0.5,
    4.0,
)  # a residual that falls by less than the one is round-off below the other times its floor


def _weak[**P, T](method: Callable[P, T]) -> Callable[P, T]:
    """A method that does not keep its object: through a solver of PETSc no garbage collector sees a circle."""
    found = weakref.WeakMethod(method)

    def call(*args: P.args, **given: P.kwargs) -> T:
        known = found()
        assert known is not None
        result: T = known(*args, **given)
        return result

    return call


class Newton:
    """Solves r(q1, y) = 0, s(q1, y) = 0 for a compiled system.

    PETSc options with prefix `gx_` apply (e.g. `-gx_snes_monitor`), but for a line search: the residual follows the
    iterates one by one, so no other place may be asked for.  `direct` factorises
    the matrix whatever its size: without much inertia a film with slack parts is too ill-conditioned for the others.
    `subdomains` is a method of domain decomposition, see `subdomains.METHODS`.

    The first `careful` tangents of a step have no geometric stiffness (at rest: but that of films that pull).  With it
    a film under large compressive stress, or a stiff fold, has an indefinite tangent far from the solution, and the
    iteration is thrown away; without it the tangent is positive semi-definite beside the inertia, and the iteration
    slow but safe.
    """

    def __init__(
        self,
        system: System,
        tolerances: Tolerances,
        direct: bool = False,
        subdomains: str | None = None,
    ) -> None:
        self.system, self.tolerances = system, tolerances
        comm = system.comm
        self._scalars = sum(b.size for b in system.scalar_unknowns)
        self._composite = linear.Composite(comm, system.q1, self._scalars)
        self._x, self._F, self._start = (self._composite.vector() for _ in range(3))
        self._r, self._base = system.numbering.vector(), system.numbering.vector()
        self._diagonal = system.numbering.vector()
        self._rtol: float | None = None
        self.careful = 0
        self.energy = 0.0  # the largest so far [J], that the work of a residual is compared with; zero: not compared
        self.iterations = 0  # of the last solve, also if it failed
        self.all_iterations = self.linear_iterations = 0  # of all solves
        self.seconds = dict.fromkeys(("law", "residual", "tangent", "linear solver"), 0.0)

        self._direct, self._subdomains = direct, subdomains
        self._set_up()

    def _set_up(self) -> None:
        """Make PETSc's solvers for the system's matrices."""
        system, tolerances, comm = self.system, self.tolerances, self.system.comm
        self._snes = snes = PETSc.SNES().create(comm)
        snes.setOptionsPrefix(PREFIX)
        snes.setType("newtonls")
        options = PETSc.Options(PREFIX)
        search = options.getString("snes_linesearch_type", "basic")
        check(
            search == "basic",
            f"-gx_snes_linesearch_type {search}: the strains of the iteration follow each step of Newton's, so that a "
            "line search would lead it astray; leave the option out.",
        )
        options["snes_linesearch_type"] = "basic"
        snes.setFunction(_weak(self._function), self._F)
        snes.setMaxLinearSolveFailures(tolerances.max_iterations)
        ksp = snes.getKSP()
        self._tangent: Callable[[], PETSc.Mat] = lambda: system.assemble_tangent().A
        self._bordered: linear.Bordered | None = None
        if self._subdomains is not None:
            from gossamer_fx.solvers.subdomains import Subdomains, configure

            parts = Subdomains(system)
            self._tangent, J = parts.tangent, parts.matrix
            configure(ksp, self._subdomains)
            self._preconditioner = ksp.getPC()
        elif self._scalars or system.active_sets:
            self._bordered = linear.Bordered(self._composite, system.coupled_tangent)
            J = PETSc.Mat().createPython(
                (self._x.getSizes(), self._x.getSizes()), self._bordered, comm
            )
            J.setUp()
            sparse = PETSc.PC().create(comm)
            sparse.setOptionsPrefix(PREFIX)
            sparse.setOperators(system.A)
            linear.configure(ksp, sparse, system, self._direct)
            sparse.setFromOptions()
            self._preconditioner = sparse
            outer = ksp.getPC()
            outer.setOptionsPrefix(PREFIX + "border_")
            outer.setType("python")
            outer.setPythonContext(linear.BorderedPreconditioner(self._bordered, sparse, system))
        else:
            J = system.A
            self._preconditioner = ksp.getPC()
            linear.configure(ksp, self._preconditioner, system, self._direct)
        snes.setJacobian(_weak(self._jacobian), J)
        snes.setFromOptions()
        snes.setConvergenceTest(_weak(self._test))
        if system.active_sets:
            snes.setLineSearchPreCheck(_weak(self._limit_update))

    def solve(self, increment: PETSc.Vec, y: Array) -> tuple[PETSc.Vec, Array, int]:
        """Solve from a predicted q1 - q0 and y; q1 is then in the system.

        Returns what q1 - q0 is beyond its prediction, which the next call overwrites; y; and the iterations.

        Raises:
            NotConverged: with PETSc's reason and the place of the largest residual.
            Inadmissible: what is wrong with the solution.
        """
        increment.copy(self._base)
        self._base.scale(-1.0)  # strains follow from those of q0
        self._reference, self._floor, self._still = 0.0, 0.0, 0.0
        self._before = self._forces = math.inf
        self._balance = math.inf, 0.0
        self._early = 0.0  # the larger one of the first two residuals
        self._held = self.system.predict(increment)
        self._r.zeroEntries()
        with self._r as w:
            w[self.system.supports.held] = self._held
        self._composite.join(self._r, y, self._x)
        self.iterations = 0
        self._iterate()
        for _ in range(SEARCHES):
            if not self.system.extend_active_set():
                break
            self._iterate()
        problem = self.system.inadmissible()
        if problem:
            raise Inadmissible(problem)
        w, y = self._split(self._x)
        return w, y, self.iterations

    def _iterate(self) -> None:
        """Newton's iteration from the present x."""
        self._snes.setTolerances(
            stol=0.0, max_it=self.tolerances.max_iterations
        )  # a small step is no solution
        before = sum(self.seconds.values())
        started = time.perf_counter()
        self._x.copy(self._start)
        self._snes.solve(None, self._x)
        while self._snes.getConvergedReason() < 0 and factorisation.enlarge(self._preconditioner):
            self._start.copy(self._x)
            self._snes.solve(None, self._x)
        others = sum(self.seconds.values()) - before
        self.seconds["linear solver"] += time.perf_counter() - started - others
        reason, spent = self._snes.getConvergedReason(), int(self._snes.getIterationNumber())
        self.iterations += spent
        self.all_iterations += spent
        self.linear_iterations += self._snes.getLinearSolveIterations()
        if reason <= 0:
            complaint = self._complaint(reason, spent)
            linear.recover(self._preconditioner)
            raise NotConverged(complaint)

    @property
    def ksp(self) -> PETSc.KSP:
        """PETSc's solver of the linear systems."""
        return self._snes.getKSP()

    @property
    def round_off(self) -> float:
        """Residual [N] below which the last solve may not go."""
        return STANDS * self._floor

    def summary(self) -> str:
        """The linear solver, its iterations, and where the time of all solves went."""
        ksp, pc = self.ksp.getType(), linear.name(self._preconditioner)
        whole = sum(self.seconds.values()) or 1.0
        shares = ", ".join(
            f"{what} {seconds / whole:.0%}" for what, seconds in self.seconds.items()
        )
        krylov = self.linear_iterations / max(self.all_iterations, 1)
        return f"{ksp} with {pc}, {krylov:.1f} iterations for one of Newton's; {shares}"

    @contextmanager
    def _clock(self, what: str) -> Iterator[None]:
        started = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[what] += time.perf_counter() - started

    def _function(self, snes: PETSc.SNES, x: PETSc.Vec, F: PETSc.Vec) -> None:
        w, y = self._split(x)
        with self._clock("law"):
            self.system.set_increment(w, self._base)
        self._evaluate(y, F)

    def _limit_update(self, x: PETSc.Vec, update: PETSc.Vec) -> bool:
        """Keep an update within what contact can follow; whether it was changed."""
        with update as values:
            self.system.limit_update(values[: self._composite.n])
        return True

    def _split(self, x: PETSc.Vec) -> tuple[PETSc.Vec, Array]:
        """w and y of x; held coordinates have their values, which not every linear solver keeps exactly."""
        w, y = self._composite.split(x)
        with w as values:
            values[self.system.supports.held] = self._held
        return w, y

    def _evaluate(self, y: Array, F: PETSc.Vec) -> None:
        with self._clock("residual"):
            self._s = self.system.residual(y, self._r)
            self._balance = self.system.imbalance(self._r)
        self._composite.join(self._r, self._s, F)

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        near = self._forces < min(KEPT * self._limit, CLOSE * self._reference)
        if near and self.system.numbering.full and snes.getIterationNumber():
            self._composite.split(snes.getSolution())[0].copy(self._base)
            return
        with self._clock("tangent"):
            far = self._forces > NEAR * self._reference
            self._take_geometric_stiffness(
                0.0 if far and snes.getIterationNumber() < self.careful else 1.0
            )
            A = self._tangent()
            self._take_geometric_stiffness(1.0)
        if self._bordered is not None:
            self._bordered.set(*self.system.coupling())
            J.assemble()
        if (
            self._floor == 0 or self.system.active_sets
        ):  # what a predictor passes through may be stiff beyond measure
            A.getDiagonal(self._diagonal)
            floor = (
                self.tolerances.floor
                * np.finfo(float).eps
                * self.system.force_scale(self._diagonal)
            )
            self._floor = min(floor, self._floor or math.inf)
        self._composite.split(snes.getSolution())[0].copy(self._base)
        self._aim(snes.getKSP())

    def _take_geometric_stiffness(self, share: float) -> None:
        if share == self.system.geometric:
            return
        self.system.geometric = share
        for field in self.system.fields.values():
            field.γ.value = share

    def _aim(self, ksp: PETSc.KSP) -> None:
        """Solve the last linear systems tightly: what a loose one leaves of the residual, the energy feels."""
        forces = self._balance[0]
        if self._rtol is None:
            self._rtol = ksp.getTolerances()[0]
        last = 0 < forces * self._rtol < 10 * self._limit
        ksp.setTolerances(
            rtol=min(self._rtol, max(LAST * self._limit / forces, 1e-12)) if last else self._rtol
        )

    @property
    def _limit(self) -> float:
        """The residual [N] at which a step may count as solved."""
        return max(
            self.tolerances.relative * self._reference,
            self.tolerances.absolute,
            self._floor,
            self._still,
        )

    def _test(self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]) -> int:
        if not np.isfinite(norms[2]):
            return int(PETSc.SNES.ConvergedReason.DIVERGED_FNORM_NAN)
        self._before, self._forces = self._forces, self._balance[0]
        if iteration == 0:
            stopping = self._stopping()
            self._reference = min(self._forces, stopping)
            self._still = STILL * stopping if math.isfinite(stopping) else 0.0
        if self._solved():
            # convergence is judged on the true strain, and if it is not reached the iteration goes on from there
            w, y = self._split(snes.getSolution())
            with self._clock("law"):
                self.system.set_increment(w, None)
            self._evaluate(y, snes.getFunction()[0])
            if self._solved():
                return int(PETSc.SNES.ConvergedReason.CONVERGED_FNORM_ABS)
        if iteration < 2:
            self._early = self._forces if iteration == 0 else max(self._early, self._forces)
        if self._forces > EXPLODED * max(self._early, self._limit):
            return int(PETSc.SNES.ConvergedReason.DIVERGED_DTOL)
        if iteration >= self.tolerances.max_iterations:
            return int(PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT)
        return 0

    def _stopping(self) -> float:
        """Force [N] that stops and returns all that moves in a step.  With contact a predictor may have passed through
        things, whose forces then, thousands of times larger, are no measure for a residual; else infinite."""
        if not self.system.active_sets:
            return math.inf
        self.system.M.mult(self.system.v0, self._diagonal)
        return self.system.c * self.system.h * float(self._diagonal.norm()) or math.inf

    def _solved(self) -> bool:
        forces, violation = self._balance
        stands = self._forces > FALLS * self._before
        enough = forces <= self._limit and (stands or forces <= self._floor or self._works_little())
        balanced = enough or (stands and forces <= self.round_off)
        held = violation <= self.tolerances.constraint
        return balanced and held and bool((abs(self._s) <= self.tolerances.scalars).all())

    def _works_little(self) -> bool:
        """Whether the work of the residual in the step, by which its energy is off, is small."""
        if not self.energy:
            return True
        system = self.system
        forces = (
            self._r.array_r[: system.constraints.owned.start]
            if system.constraints
            else self._r.array_r
        )
        n = forces.size
        work = system.comm.allreduce(
            float(forces @ (system.q1.array_r[:n] - system.q0.array_r[:n]))
        )
        return abs(work) <= self.tolerances.energy * self.energy

    def _complaint(self, reason: int, iterations: int) -> str:
        names = {v: k for k, v in vars(PETSc.SNES.ConvergedReason).items() if isinstance(v, int)}
        linear_reason = self.ksp.getConvergedReason()
        why = names.get(reason, str(reason)).lower().replace("_", " ")
        if linear_reason < 0:
            why += f", linear solver: {linear.reason(self.ksp, self._preconditioner)}"
        forces, violation = self._balance
        if violation > self.tolerances.constraint:
            why += f", constraints off by {violation:.1e}"
        unsolved = next(
            filter(None, (border.unsolved() for border in self.system.scalar_unknowns)), ""
        )
        if unsolved:
            why += f", {unsolved},"
        return (
            f"{why} after {iterations} iterations, residual {forces:.1e} N of {self._reference:.1e} N at first, "
            f"largest in {self.system.locate(self._r)}"
        )
