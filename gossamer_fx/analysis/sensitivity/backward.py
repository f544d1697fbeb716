"""The adjoint of the midpoint rule: derivatives of the end of a step carried to its start, by
linear systems with the transposed tangent (`TransposedSolver`).

Problem.  A result J of the last state of a run depends on parameters θ through all steps.  Finite
differences take one run for each parameter, and lose digits.  Differentiating forwards takes one
linear system for each parameter and step.

Idea.  Go backwards: from the derivatives of J with respect to the end of a step, compute those with
respect to its start.  This takes one transposed linear system for each step, whatever the number of
parameters.  A step of length h from positions and velocities (q0, v0) to (q1, v1) solves

    r(q1; q0, v0, θ) = c M (q1 - q0 - h v0) + f(q0, q1, θ) = 0,    c = 2/h²                      (1)
    v1 = 2 (q1 - q0)/h - v0                                                                      (2)

with the mass matrix M and the forces f of the step.

Algorithm, for a step with known a = dJ/dq1 and b = dJ/dv1.

1. Repeat the step from the tape, and take its tangent A = c M + ∂f/∂q1 at the solution.
2. Solve for the adjoint μ:

       Aᵀ μ = a + 2 b/h                                                                          (3)

3. Carry the derivatives to the start of the step:

       dJ/dq0 = c M μ - Bᵀ μ - 2 b/h,    B = ∂f/∂q0                                              (4)
       dJ/dv0 = h c M μ - b                                                                      (5)

   The rule is symmetric in time, f(q0, q1; h) = f(q1, q0; -h).  So B is the tangent of the reversed
   step, which starts at q1 and ends at q0.  Terms therefore need no further code for the adjoint
   (`terms.assembly.Differentiable`).
4. Add what the step contributes to the gradient:

       dJ/dθ -= μ·∂r/∂θ                                                                          (6)

Scalar unknowns y, e.g. the pressures and masses of gas, have equations s(y1; q0, q1, y0) = 0 and
act in r. With dJ/dy1 and the blocks G = ∂r/∂y1, Hᵀ = ∂s/∂q1, C = ∂s/∂y1 of Newton's method, (3)
becomes

    [ Aᵀ  H  ] [μ]   [ a + 2 b/h ]
    [ Gᵀ  Cᵀ ] [ν] = [ dJ/dy1    ]                                                               (7)

It is solved by one more system with Aᵀ for each column of H.  Each kind of scalar unknown adds its
own part to the derivatives at the start of the step (`gas.adjoint.GasAdjoint`).

Lagrange multipliers are part of q1 and have neither mass nor rate.  The multipliers of the step act
in the reversed step, too.  Their equations e(q1) = 0 do not depend on q0, so that their rows of μ
do not count in (4).  Fixed and prescribed coordinates are given functions of time: their entries of
a, b and μ are zero.

Cost.  For each step: the iterations that repeat it, one factorisation, one transposed solve, and
one tangent of the reversed step.

Forces that are not symmetric in time, e.g. friction, whose directions are those of the start of the
step, are left out of the reversed step.  They give their products (∂f/∂q0)ᵀ μ and (∂f/∂v0)ᵀ μ
themselves (`Differentiable.add_start_derivatives`).  Products by history variables, e.g. by a
torque that is held over several steps, are summed up from the last step to the one in which the
variable was set.

History variables that follow from the end of a step, e.g. the rest angle of a fold that slips, add
to a before (3) is solved (`Differentiable.add_end_derivatives`).

Limits.  Friction and yielding are piecewise smooth: derivatives are those of the pairs and folds
that slip in the run.  In chaotic motion the derivatives grow exponentially with the number of steps
(`sensitivity.transient`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.analysis.sensitivity.tape import RecordedState, RunTape
from gossamer_fx.core.checks.errors import InputError, StepFailure, check
from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.solvers import factorisation
from gossamer_fx.solve.steppers.history import name_of_scalars
from gossamer_fx.solve.system.residual_sizes import out_of_balance
from gossamer_fx.solve.system.system import System

if TYPE_CHECKING:
    # Scenes without gas do not load it.
    from gossamer_fx.mechanics.gas.adjoint import GasAdjoint


# Relative residual above which a solution is refined, once.  That brings the solution of an
# ill-conditioned tangent, as a stiff film has, from 1e-9 to the round-off of its residual; it costs
# a tenth of a step.
MAX_LINEAR_RESIDUAL = 1e-13


class TransposedSolver:
    """Solves Aᵀ x = b by factors of A; matrices of one pattern share the ordering of the first."""

    def __init__(self, A: PETSc.Mat) -> None:
        # A scene of gas between rigid walls has no coordinates, and MUMPS factorises no empty
        # matrix.
        self._is_empty = A.getSize()[0] == 0
        self._pc = PETSc.PC().create(A.comm)
        self._pc.setOperators(A)
        if not self._is_empty:
            factorisation.choose(self._pc, A)
        self._correction, self._residual = A.createVecs()
        self._update: factorisation.LowRankUpdate | None = None

    def factorise(self, A: PETSc.Mat) -> None:
        """Factorise a matrix with the pattern of the first one; `InputError` if it is singular.
        Collective."""
        self._A = A
        if self._is_empty:
            return
        factorisation.replace(self._pc, A)
        problem = factorisation.set_up(self._pc)
        if problem:
            raise InputError(
                f"gradient: the tangent cannot be factorised, {problem}; "
                "hold the rigid motions of the scene, or give slack film a residual stiffness."
            )

    def add_to_inverse(self, stiffnesses: Sequence[tuple[Array, float]]) -> None:
        """Solve with A + Σ κ g⊗g from now on, κ ≠ 0, by its factors of A and this rank's parts of g
        (n,). Collective."""
        self._update = None
        if stiffnesses:
            self._update = factorisation.LowRankUpdate(self._A, stiffnesses, self._solve)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Set x = A⁻ᵀ b, or (A + Σ κ g⊗g)⁻ᵀ b after `add_to_inverse`.  Collective."""
        self._solve(b, x)
        if self._update is not None:
            self._update.correct(x)

    def _solve(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Set x = A⁻ᵀ b, refined once if its residual is more than round-off."""
        if self._is_empty:
            return
        self._pc.applyTranspose(b, x)
        self._A.multTranspose(x, self._residual)
        self._residual.aypx(-1.0, b)
        # Written so that NaN is refined, too: what asks for the solution then finds it.
        if self._residual.norm() <= MAX_LINEAR_RESIDUAL * b.norm():
            return
        self._pc.applyTranspose(self._residual, self._correction)
        x.axpy(1.0, self._correction)


# Largest residual of a step that was made again, over the inertia in it.  More means that something
# changed the scene between the steps, e.g. an event, which the tape does not know.
MAX_RESIDUAL = 1e-3

TINY = 1e-300  # against division by zero


class BackwardSteps:
    """Carries derivatives backwards through the steps of a tape, one at a time.

    `μ` is the adjoint vector of the last step, and `inertia` its z = c (q1 - q0 - h v0) [m/s²], of
    which M z is in (1); `residual` is the largest one of the steps so far, over the inertia in it.
    """

    def __init__(self, tape: RunTape) -> None:
        self._tape = tape
        self._system: System = tape.system
        numbering = self._system.unknowns.numbering
        self.μ = numbering.vector()
        self.inertia = numbering.vector()
        self.residual = 0.0
        self._right_side = numbering.vector()
        self._Mμ = numbering.vector()
        self._Bμ = numbering.vector()
        self._scratch = numbering.vector()
        self._solver: TransposedSolver | None = None
        self._irreversible = [
            one for one in self._system.equations.differentiable if not one.reversible
        ]
        # Only what such forces need.
        self._by_position = numbering.vector() if self._irreversible else None
        self._by_velocity = numbering.vector() if self._irreversible else None
        self.scalars = ScalarParts(self._system)

    def start(self) -> None:
        """Begin a new pass from the last step to the first."""
        self.scalars.start()
        for compiled in self._system.equations.differentiable:
            compiled.start_adjoint()

    def add_energy_by_history(self, share: float) -> None:
        """Add a share of the derivative of the stored energy by history variables; the system
        stands in the state.  Collective."""
        for compiled in self._system.equations.differentiable:
            compiled.add_energy_by_history(share)

    # ---- the step itself -------------------------------------------------------------------------

    def repeat(self, start: RecordedState, end: RecordedState) -> None:
        """Make the system stand at the end of a recorded step that it has not accepted.  `start`
        has the history variables at its start, `end` its length and contact pairs.  Collective."""
        system = self._system
        h = end.h
        self._tape.restore(start)
        y = system.equations.begin_recorded_step(h, end.active_sets)
        for k, scalars in enumerate(system.equations.scalar_unknowns):
            if not scalars.repeats(end.saved.variables[name_of_scalars(k)]):
                raise StepFailure(
                    f"gradient: the step from t = {start.time:.9g} s cannot be repeated: a valve "
                    "that an event opened or closed has no gradient."
                )
        system.equations.set_inertia(2 / h**2)
        self._end_at(start, end)
        # On several ranks pairs of contact are not recorded but searched for, about the predicted
        # step: those that only its end has are added here.
        while system.equations.extend_active_set():
            self._end_at(start, end)
        system.equations.residual(y, self._scratch)
        self._check_residual(start, end)

    def _end_at(self, start: RecordedState, end: RecordedState) -> None:
        """Set q1 to the end of a step, by the increment from its prediction, and `inertia`.  What
        earlier steps have left of round-off in the increment is dropped."""
        system = self._system
        system.unknowns.increment.remainder.set(0.0)
        self._right_side.array[:] = end.h * start.v
        system.equations.predict(self._right_side)
        self._right_side.array[:] = end.q - start.q - end.h * start.v
        system.equations.set_increment(self._right_side, None)
        self.inertia.array[:] = 2 / end.h**2 * self._right_side.array_r

    def _check_residual(self, start: RecordedState, end: RecordedState) -> None:
        """Raise `StepFailure` if the residual of the repeated step [N], in `_scratch`, is more than
        `MAX_RESIDUAL` of its momenta over its length, as after an event that changed the scene.
        Keeps the largest ratio in `residual`.  Collective."""
        system = self._system
        forces, _ = out_of_balance(system.equations, self._scratch)
        # The change of momentum alone would be no scale for a step without any: both are added.
        self._right_side.array[:] = abs(end.v - start.v) + abs(end.v) + abs(start.v)
        system.unknowns.M.mult(self._right_side, self._Mμ)
        scale = float(self._Mμ.norm()) / end.h
        self.residual = max(self.residual, forces / max(scale, TINY))
        if forces > MAX_RESIDUAL * max(scale, TINY):
            raise StepFailure(
                f"gradient: the step from t = {start.time:.9g} s cannot be repeated, "
                f"its residual is {forces / max(scale, TINY):.1e} of its momenta; "
                "an event or a change of a parameter between steps has no gradient."
            )

    # ---- its adjoint -----------------------------------------------------------------------------

    def solve(self, start: RecordedState, end: RecordedState, a: PETSc.Vec, b: PETSc.Vec) -> None:
        """Repeat a step and solve (3), with scalar unknowns (7), for the adjoint vector μ.
        Derivatives of the result by positions [1/m] and velocities [s/m] at the end of the step,
        times its unit, are a and b; history variables of later steps add to `a`.  Collective."""
        system = self._system
        self.repeat(start, end)
        for compiled in system.equations.differentiable:
            compiled.add_end_derivatives(a)
        A = system.matrices.tangent()
        if self._solver is None:
            self._solver = TransposedSolver(A)
        self._solver.factorise(A)
        self._right_side.waxpy(2 / end.h, b, a)
        self._right_side.array[system.unknowns.supports.held] = 0
        self._solver.solve(self._right_side, self.μ)
        if self.scalars.size:
            self._solve_with_scalars(end.h)

    def _solve_with_scalars(self, h: float) -> None:
        """Replace μ, the solution of a step of length h [s] without scalar unknowns (e.g. pressures
        of gas), by that of (7).  Collective."""
        assert self._solver is not None
        system = self._system
        scalars = self.scalars
        G, H, C = system.matrices.coupling()
        # Z = A⁻ᵀ H, of which zero columns need no solve.
        Z = np.zeros((scalars.size, len(self.μ.array_r)))
        for k, column in enumerate(H):
            if column is not None:
                self._right_side.array[:] = column
                self._solver.solve(self._right_side, self._scratch)
                Z[k] = self._scratch.array_r
        columns = np.array([np.zeros(Z.shape[1]) if one is None else one for one in G])
        products = np.column_stack([columns @ Z.T, columns @ self.μ.array_r])
        system.comm.Allreduce(MPI.IN_PLACE, products, op=MPI.SUM)
        ν = np.linalg.solve(C.T - products[:, :-1], scalars.c - products[:, -1])
        self.μ.array[:] -= ν @ Z
        scalars.take(ν, self.μ.array_r, h)

    def carry(self, start: RecordedState, end: RecordedState, a: PETSc.Vec, b: PETSc.Vec) -> None:
        """Replace the derivatives with respect to the end of a step by those with respect to its
        start, by (4) and (5); after `solve`.  Collective."""
        system = self._system
        h = end.h
        c = 2 / h**2
        system.unknowns.M.mult(self.μ, self._Mμ)
        # Before the step is reversed: these derivatives are those of the solved step.
        by_position, by_velocity = self._irreversible_products()
        self._multiply_by_reversed(start, end)
        a.set(0.0)
        a.axpy(c, self._Mμ)
        a.axpy(-1.0, self._Bμ)
        a.axpy(-2 / h, b)
        b.scale(-1.0)
        b.axpy(h * c, self._Mμ)
        if by_position is not None and by_velocity is not None:
            a.axpy(-1.0, by_position)
            b.axpy(-1.0, by_velocity)
        if self.scalars.size:
            # The system stands in the reversed step now.
            with a as by_position, b as by_velocity:
                self.scalars.carry(by_position, by_velocity)
        self.clear(a)
        self.clear(b)

    def _irreversible_products(self) -> tuple[PETSc.Vec | None, PETSc.Vec | None]:
        """(∂f/∂q0)ᵀ μ and (∂f/∂v0)ᵀ μ of the forces that differ in the reversed step; None if there
        are none.  Collective."""
        if self._by_position is None or self._by_velocity is None:
            return None, None
        self._by_position.set(0.0)
        self._by_velocity.set(0.0)
        for compiled in self._irreversible:
            compiled.add_start_derivatives(self.μ, self._by_position, self._by_velocity)
        return self._by_position, self._by_velocity

    def clear(self, vector: PETSc.Vec) -> None:
        """Set the entries of fixed coordinates and of multipliers to zero."""
        vector.array[self._system.unknowns.supports.held] = 0
        if self._system.equations.constraints:
            vector.array[self._system.equations.constraints.owned] = 0

    def _multiply_by_reversed(self, start: RecordedState, end: RecordedState) -> None:
        """Set Bμ = Bᵀ μ, by the tangent of the reversed step."""
        self.reverse(start, end)
        μ = self._scratch
        self.μ.copy(μ)
        self.clear(μ)
        # A product needs no sum of the matrices that contact couples.
        self._system.matrices.assemble_tangent().mult_transpose(μ, self._Bμ)

    def reverse(self, start: RecordedState, end: RecordedState) -> None:
        """Make the system stand at the end of the reversed step: it starts at q1 and ends at q0.
        Collective."""
        system = self._system
        # The pairs of contact stay, which accepting another start would forget.
        system.reverse_step(end.q, -end.v, end.time, self._with_multipliers_of(start, end))
        system.equations.set_inertia(0.0)

    def _with_multipliers_of(self, start: RecordedState, end: RecordedState) -> Array:
        """The coordinates of the start with the multipliers of the step."""
        q = np.array(start.q)
        constraints = self._system.equations.constraints
        if constraints:
            q[constraints.owned] = end.q[constraints.owned]
        return q


class ScalarParts:
    """The adjoints of all scalar unknowns of a scene, one after the other; `c` (size,) are
    derivatives dJ/dy1 of the result by them at the end of the present step, see (7)."""

    def __init__(self, system: System) -> None:
        self.parts: list[GasAdjoint] = []
        self._sizes: list[int] = []
        for scalars in system.equations.scalar_unknowns:
            adjoint = scalars.adjoint()
            check(
                adjoint is not None,
                f"gradient: '{type(scalars).__name__}' of the scene has no derivatives; "
                "leave it out.",
            )
            self.parts.append(adjoint)
            self._sizes.append(scalars.size)
        self.size = sum(self._sizes)
        self.c: Array = np.zeros(self.size)

    def start(self) -> None:
        """Begin new sums."""
        self.c = np.zeros(self.size)
        for part in self.parts:
            part.start()

    def take(self, ν: Array, μ: Array, h: float) -> None:
        """Add the derivatives by parameters of the scalar unknowns in the solved step of length h
        [s], with ν (size,) and this rank's μ (n,) of (7), and carry c to its start.  Collective."""
        at_start = []
        for part, own in zip(self.parts, self._split(ν), strict=True):
            part.linearise(h)
            at_start.append(part.take(own, μ))
        self.c = np.concatenate(at_start)

    def carry(self, by_position: Array, by_velocity: Array) -> None:
        """Add what the geometry at the start of the step gives, in the reversed step.
        Collective."""
        for part in self.parts:
            part.carry(by_position, by_velocity)

    def finish(self, by_position: Array) -> None:
        """Add what the initial state gives; the system stands at it.  Collective."""
        for part, own in zip(self.parts, self._split(self.c), strict=True):
            part.finish(own, by_position)

    def _split(self, values: Array) -> list[Array]:
        """The shares of the parts in values of all scalar unknowns."""
        return np.split(values, np.cumsum(self._sizes)[:-1])
