"""Two-level preconditioner for large meshes: a coarse space, then an incomplete factorisation.

Problem.  The tangent A of a film has stiff in-plane modes.  In a step that is many times longer
than the time in which a wave crosses a cell, they couple unknowns as far apart as the edges of the
film.  An incomplete factorisation L ≈ A couples unknowns a few cells apart only, so that Krylov
iterations grow with the mesh.

Idea.  What the incomplete factorisation does not resolve varies slowly in space, and a coarse space
of affine functions on patches of nodes resolves it (`solvers.coarse_space`); P is its prolongation.

Algorithm, for a residual r.

1. Coarse solution z0 = P (Pᵀ A P)⁻¹ Pᵀ r                                                     (1)
2. Its residual     r1 = r - A z0                                                             (2)
3. Local correction z = z0 + L⁻¹ r1                                                           (3)

This is one V-cycle of PETSc's multigrid that smooths on the way up only, and not symmetric, which
GMRES does not require.

Levels of fill of L.  Where a film switches between taut and slack, the tangent has narrow stiff
bands in an almost slack film.  Measured on a fluttering film of 78 thousand unknowns: with two
levels most systems are not solved within 60 iterations, four levels take 25, six take 6, and eight
cost more than they save.  In a quiet film two levels serve as well as six, for a third of the time.
On a film of 300 thousand unknowns, in the worst steps, six levels do not solve a system within 60
iterations, and Newton's iteration takes 173 such solves for two steps; with ten they are solved in
18, and two steps take 32 to 42 solves.  Therefore L starts with two levels, gets six when a solve
has taken many iterations, and for the rest of a step ten when it has taken many more.

Complete factors.  Six levels of fill store as many numbers as complete factors of a few thousand
unknowns on one rank, which need no coarse space and one Krylov iteration.  In systems with contact
`FactorisedIfDifficult` replaces both levels by them as soon as a solve asks for six levels, unless
the factors turn out to fill up.  Times are those of a Newton iteration with complete factors from
the start, over the time with six levels:

    folded tube, unknowns                    2022   4758   8070
    numbers stored for an unknown              57     78    101
    time in the first 3 ms                   0.63   0.83   0.84
    time up to the half of its way           0.94

Stacked films in short steps are not difficult.  Their complete factors, of 113 numbers for an
unknown of 1500 and 281 of 4335, would take 1.3 and 3 times the time of two levels.  Where joints
are eliminated (`solvers.eliminated_joints`) complete factors of the films took 0.9 to 1.1 of the
time of incomplete ones, so that they are not used there.

Several ranks factorise parts that overlap by three cells (additive Schwarz); without overlap the
number of iterations doubles.  PETSc's options of L have the prefix `gx_local_`.

Cost.  An application is one product with A, one solve with L and one coarse solve, and a Krylov
iteration makes one of them.  The set-up of L is most of the cost of a Newton iteration; (Pᵀ A P) is
set up about once a step.

Limits.  L needs a diagonal without zeros, so that Lagrange multipliers are eliminated first
(`solvers.condensed_constraints`, `solvers.eliminated_joints`), or the matrix is factorised.
"""

from __future__ import annotations

from petsc4py import PETSc

import gossamer_fx.solve.solvers.factorisation as factorisation
from gossamer_fx.solve.solvers.coarse_space import NONE, CoarseSpace, Indices, new_multigrid
from gossamer_fx.solve.system.system import System

# Levels of fill of the incomplete factorisation, to start with and for difficult systems; see the
# module.
ILU_LEVELS = 2
ILU_LEVELS_DIFFICULT = 6
ILU_LEVELS_WORST = 10

# Applications in a solve up to which the coarse matrix of an earlier A of the same step is used
# again.
REUSE_COARSE_UP_TO = 10

# Applications in a solve above which six levels of fill, and ten, cost less than the iterations
# that they save.
MORE_FILL_ABOVE = 20
MOST_FILL_ABOVE = 40


class TwoLevel:
    """The preconditioner (1) to (3), as PETSc's Python preconditioner, for bodies on meshes without
    Lagrange multipliers."""

    def __init__(
        self, system: System, condensed: Indices = NONE, is_difficult: bool = False
    ) -> None:
        """Unknowns of this rank that are `condensed` (k,) have the rows and columns of the unit
        matrix.  L of `is_difficult` systems has more levels of fill from the start.  Collective."""
        self._system = system
        self._coarse = CoarseSpace(system, condensed)
        self._local = factorisation.new_incomplete(system.comm)
        self._multigrid = new_multigrid(self._coarse.interpolations, self._local)
        self._step: tuple[float, float] | None = None  # time and length of the last set-up's step
        self._is_difficult = is_difficult
        self._levels = 0  # of fill; 0: not chosen yet
        self._applications = 0  # since the last set-up

    def __str__(self) -> str:
        return f"a coarse space and {self._local.getType()} of {self._levels} levels"

    def wants_more_fill(self) -> bool:
        """Whether the next set-up takes six levels of fill or more."""
        return bool(self._levels) and self._wanted_fill(False) >= ILU_LEVELS_DIFFICULT

    def setUp(self, pc: PETSc.PC) -> None:
        """Set up both levels for the present matrix; called by PETSc.  If an incomplete
        factorisation fails, PETSc is told so on all ranks, and the linear solve ends.  Collective.
        """
        # The matrix to be preconditioned, and the same without couplings of contact.
        self._A, self._fixed = pc.getOperators()
        step = self._system.unknowns.time, self._system.unknowns.h
        begins_step = step != self._step
        self._step = step
        self._set_up_coarse_space(begins_step)
        self._set_up_local_part(begins_step)
        self._applications = 0
        reasons = PETSc.PC.FailedReason
        has_failed = self._local.getFailedReason() != reasons.NOERROR
        # All ranks must report the same, as PETSc decides on each rank whether to go on.
        if self._system.comm.allreduce(has_failed):
            pc.setFailedReason(reasons.SUBPC_ERROR)
        else:
            pc.setFailedReason(reasons.NOERROR)

    def _set_up_coarse_space(self, begins_step: bool) -> None:
        """Compute the coarse matrix, unless that of an earlier A of this step still serves."""
        if begins_step or self._applications > REUSE_COARSE_UP_TO:
            # The product needs the same pattern every time.
            self._coarse.set_up(self._fixed, self._multigrid)

    def _set_up_local_part(self, begins_step: bool) -> None:
        """Factorise A incompletely, with the levels of fill that the last solve suggests.
        Collective."""
        self._multigrid.setOperators(self._A)
        # This sets those of the incomplete factorisation, too.
        self._multigrid.getMGSmoother(len(self._coarse.interpolations)).setOperators(self._A)
        wanted = self._wanted_fill(begins_step)
        if wanted != self._levels:
            self._choose_fill(wanted)
        self._multigrid.setUp()
        self._local.setUpOnBlocks()

    def _wanted_fill(self, begins_step: bool) -> int:
        """Levels of fill: 2 at first, 6 after a solve that took more than 20 applications or from
        the start, and 10 for the rest of a step after one that took more than 40."""
        if not self._levels:
            return ILU_LEVELS_DIFFICULT if self._is_difficult else ILU_LEVELS
        if self._levels == ILU_LEVELS and self._applications <= MORE_FILL_ABOVE:
            return ILU_LEVELS
        if self._levels == ILU_LEVELS_DIFFICULT and self._applications > MOST_FILL_ABOVE:
            return ILU_LEVELS_WORST
        if self._levels == ILU_LEVELS_WORST and not begins_step:
            return ILU_LEVELS_WORST
        return ILU_LEVELS_DIFFICULT

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Compute z from r by (1) to (3); called by PETSc."""
        self._applications += 1
        self._multigrid.apply(r, z)

    def recover(self) -> None:
        """Become usable again after a matrix, such as an infinite one, that could not be
        factorised."""
        self._local.reset()
        self._local.setFailedReason(PETSc.PC.FailedReason.NOERROR)
        self._multigrid.destroy()
        self._multigrid = new_multigrid(self._coarse.interpolations, self._local)
        self._step = None

    def _choose_fill(self, levels: int) -> None:
        """Choose the levels of fill, 0 or more, of the incomplete factorisations of this rank."""
        self._levels = levels
        factorisation.choose_fill(self._local, levels)


class FactorisedIfDifficult:
    """The two-level preconditioner of a small system with contact on one rank, until it is
    difficult; from then on a complete factorisation, with all couplings of contact, unless this
    fills up.  As PETSc's Python preconditioner.

    It concerns time only, and a restarted run learns it again: it is not in checkpoints.
    """

    def __init__(self, system: System) -> None:
        self._two_level = TwoLevel(system)
        self._factors = factorisation.BlockFactors()
        self._may_factorise = True
        # Whether the present factors are complete.
        self.is_exact = False

    @staticmethod
    def serves(system: System) -> bool:
        """Whether a system has contact, is on one rank and small enough."""
        is_small = system.unknowns.numbering.size <= factorisation.MAX_UNKNOWNS_DIFFICULT
        has_contact = bool(system.equations.active_sets)
        return is_small and has_contact and factorisation.has_blocks(system.matrices.A)

    @property
    def needs_couplings(self) -> bool:
        """Whether the next set-up takes the tangent with all couplings of contact."""
        return self._may_factorise and (self.is_exact or self._two_level.wants_more_fill())

    @property
    def problem(self) -> str:
        """Why the last complete factorisation failed."""
        return self._factors.problem if self.is_exact else ""

    def __str__(self) -> str:
        return str(self._factors if self.is_exact else self._two_level)

    def setUp(self, pc: PETSc.PC) -> None:
        """Set up for the present matrix, completely where `needs_couplings`; called by PETSc."""
        self.is_exact = self.needs_couplings
        if not self.is_exact:
            self._two_level.setUp(pc)
            return
        self._factors.setUp(pc)
        self._may_factorise = self._factors.fill <= factorisation.MAX_FILL

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Compute z from r; called by PETSc."""
        if self.is_exact:
            self._factors.apply(pc, r, z)
        else:
            self._two_level.apply(pc, r, z)

    def recover(self) -> None:
        """Become usable again after a matrix that could not be factorised incompletely."""
        self._two_level.recover()
