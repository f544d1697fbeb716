"""Preconditioner for films with a few other unknowns: hubs, tethers and multipliers are eliminated
exactly.

Problem.  An incomplete factorisation needs a diagonal without zeros, which Lagrange multipliers do
not have. A film of any size would therefore be factorised completely because of one hub.

Idea.  Order the unknowns into those of the films, f, and the few others, g.  A residual r = (r_f,
r_g) is to give a correction z = (z_f, z_g) with

    [ F  B ] [z_f]   [r_f]
    [ C  D ] [z_g] = [r_g]                                                                    (1)

Only F is large, and it has no zeros on its diagonal.  Factorise it incompletely, F̃ ≈ F, and
eliminate g exactly.  With Z = F̃⁻¹ B and the Schur complement Σ = D - C Z, block elimination of (1)
gives

    z_g = Σ⁻¹ (r_g - C F̃⁻¹ r_f)                                                               (2)
    z_f = F̃⁻¹ r_f - Z z_g                                                                     (3)

Algorithm.

1. Factorise F, with all couplings of contact, with `ILU_LEVELS` levels of fill.  Without the
   couplings of contact the packed sail of IKAROS takes 9 to 55 Krylov iterations, with them 1 to 8.
2. Once a step, compute Z by an application of F̃⁻¹ to each column of B, and factorise Σ.
3. In each Krylov iteration, apply (2) and (3).
4. Within a step keep F̃ for the next Newton iteration while solves with it take few Krylov
   iterations, and replace it within a solve that takes more.  F̃ of the first iterate is not kept:
   the first update is by far the largest one.
5. Where F is too ill-conditioned, as in slack film and long steps, Krylov iterations rise.  If a
   solve has taken more of them than a complete factorisation costs, factorise the other matrices of
   the step completely.  Each further step in a row in which that happens doubles the number of
   steps that begin with complete factorisations, up to `MAX_FACTORISED_STEPS`.

Cost.  Step 2 costs as many applications of F̃⁻¹ as there are eliminated unknowns, hence at most
`MAX_ELIMINATED`.  Step 3 costs one application of F̃⁻¹ and products with Z and C.

Several ranks.  F̃ is additive Schwarz: each rank factorises its part of F, which overlaps the others
by three cells.  Every rank keeps the columns of C and the rows of Z that belong to its own films,
and all of Σ, so that a Krylov iteration sums one small array over the ranks.

Limits.  Bodies whose nodes have three unknowns.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc
from scipy.linalg import lapack

import gossamer_fx.solve.solvers.factorisation as factorisation
from gossamer_fx.core.model.body import Array, Indices

if TYPE_CHECKING:
    from gossamer_fx.solve.system.system import System

# Levels of fill of F̃.  In the packed sail with 30 thousand unknowns solves take 2 to 194 Krylov
# iterations with none, 1 to 8 with two.  When the sail opens and long steps meet slack film, two
# levels take more than `MAX_APPLICATIONS` so often that half of the run's time goes into complete
# factorisations; with three none is needed, and 28 steps take 26 instead of 33 s of CPU time.  Five
# take 29 s.
ILU_LEVELS = 3

# Largest number of unknowns g, of all ranks: an application of F̃⁻¹ for each, once a step.
MAX_ELIMINATED = 60

# Krylov iterations of a solve that cost as much as a complete factorisation of as many unknowns.
# In films the work of a factorisation grows with the power 1.5 of their number, that of an
# application with the power 1 (George, SIAM J. Numer. Anal. 10 (1973) 345), so that this number
# grows with the square root.
MAX_APPLICATIONS = 30
UNKNOWNS_OF_MAX_APPLICATIONS = 30_000

# Number of unknowns above which matrices are not factorised completely: packed layers in contact
# fill like a solid.  A sail of a million unknowns needed more than 20 GB, and several minutes a
# matrix; a solve that has not converged then gives an inexact update.
MAX_UNKNOWNS_COMPLETE = 300_000

# Krylov iterations of the last solve up to which F̃ is kept for the next matrix of the same step: a
# new one costs as much as eight or nine.
MAX_APPLICATIONS_TO_KEEP = 7

# Largest number of steps in which matrices are factorised completely before F̃ is tried again.  One
# solve with many Krylov iterations says little about the next step: when ten steps followed it,
# complete factorisations took 11 % of the time of the sail of IKAROS at 3.5 s.
MAX_FACTORISED_STEPS = 8

# What `EliminatedJoints.problem` says when Σ has no inverse.
SINGULAR = "the Schur complement of the joints is singular"


def eliminated_unknowns(system: System) -> Indices | None:
    """Local indices (k,) of the few unknowns of this rank that are not films, those of rigid
    bodies, point masses, beams and multipliers, which the preconditioner eliminates exactly.
    Collective.

    None, on all ranks, if this preconditioner does not serve the scene: all ranks together have
    none or more than 60 of them, or matrices do not have blocks of three rows.
    """
    numbering = system.numbering
    if numbering.block_size != 3:
        return None
    is_film = np.zeros(numbering.size_local, dtype=bool)
    for body in system.coordinates:
        if body.block.size == 3:
            is_film[system.block(body).owned] = True
    eliminated = np.flatnonzero(~is_film).astype(PETSc.IntType)
    # Summed, so that all ranks decide alike.
    if not 0 < system.comm.allreduce(len(eliminated)) <= MAX_ELIMINATED:
        return None
    return eliminated


def max_applications(unknowns: int, max_iterations: int) -> float:
    """Krylov iterations of a solve that cost as much as a complete factorisation of all ranks'
    unknowns.

    They are 30 up to 30 thousand unknowns, then 30 (unknowns/30 000)^½, but less than
    `max_iterations`: a solve that reaches them has not converged, so that a factorisation pays.
    Above `MAX_UNKNOWNS_COMPLETE` unknowns none does.
    """
    if unknowns > MAX_UNKNOWNS_COMPLETE:
        return math.inf
    growth = math.sqrt(max(1.0, unknowns / UNKNOWNS_OF_MAX_APPLICATIONS))
    return min(MAX_APPLICATIONS * growth, max_iterations - 1)


class EliminatedJoints:
    """The preconditioner (2) and (3), as PETSc's Python preconditioner.

    `problem` says why the last factorisation failed, and is empty if it did not.  After a solve of
    `max_applications` Krylov iterations matrices are factorised completely for the rest of the
    step, at least.  All couplings of contact are part of its matrix.
    """

    needs_couplings = True

    def __init__(self, system: System, eliminated: Indices, max_iterations: int) -> None:
        self._system = system
        self._rest = eliminated
        films = np.setdiff1d(np.arange(system.numbering.size_local), eliminated)
        self._films = films
        # Films mostly stand one after the other, and a slice copies nothing.
        self._film_slice: Indices | slice = films
        if len(films) and films[-1] - films[0] == len(films) - 1:
            self._film_slice = slice(int(films[0]), int(films[-1]) + 1)
        self._comm = system.comm
        self._start = system.numbering.start
        nodes = (self._start + films[::3]) // 3
        self._film_set = PETSc.IS().createBlock(3, nodes.astype(PETSc.IntType), comm=self._comm)
        # Global indices of the eliminated unknowns of all ranks, in ascending order, and which of
        # them this rank owns.
        self._all_rest = np.concatenate(self._comm.allgather(self._start + eliminated))
        first = int(self._comm.exscan(len(eliminated)) or 0)
        self._own = slice(first, first + len(eliminated))
        self._incomplete = factorisation.new_incomplete(self._comm)
        self._right: PETSc.Vec = None
        self._solution: PETSc.Vec = None
        self._complete = PETSc.PC().create(self._comm)
        factorisation.choose(self._complete)
        self._is_complete = False
        self._hard_steps = factorisation.HardSteps(MAX_FACTORISED_STEPS)
        self._is_first = False  # whether the factors are those of the first matrix of the step
        self.max_applications = max_applications(system.numbering.size, max_iterations)
        self._step: tuple[float, float] | None = None  # time and length of the step of Z
        self._applications = 0  # since the last set-up
        self._is_kept = False  # whether the factors are those of an earlier matrix
        self._Z: Array = np.zeros((0, len(films)))
        self.problem = ""

    def __str__(self) -> str:
        kind = self._incomplete.getType()
        return f"{kind} of {ILU_LEVELS} levels and {len(self._all_rest)} unknowns eliminated"

    def keep_factors(self) -> bool:
        """Keep the factors of an earlier matrix for the next one, if they serve; returns whether
        they do: within the same time step, if they are not those of its first matrix, if the last
        solve with them took at most 7 Krylov iterations and no factorisation failed.  Applications
        are then counted from zero."""
        is_same_step = (self._system.time, self._system.h) == self._step
        is_usable = is_same_step and not (self._is_complete or self._is_first or self.problem)
        if not is_usable or not 0 < self._applications <= MAX_APPLICATIONS_TO_KEEP:
            return False
        self._applications = 0
        self._is_kept = True
        return True

    @property
    def is_outdated(self) -> bool:
        """Whether the present solve has taken more Krylov iterations with factors of an earlier
        matrix than new ones cost.  Where many points of a film switch, it would not converge with
        them: of a sail that opens, every other solve took all 60 iterations."""
        return self._is_kept and self._applications > MAX_APPLICATIONS_TO_KEEP

    def setUp(self, pc: PETSc.PC) -> None:
        """Set up for the present matrix, unless earlier factors serve; called by PETSc.  A
        factorisation that fails sets `problem`, and `apply` returns NaN then."""
        if self.keep_factors():
            return
        matrix = pc.getOperators()[0]
        step = self._system.time, self._system.h
        is_new_step = step != self._step
        self._step = step
        self._is_first = is_new_step
        if is_new_step:
            self._hard_steps.begin_step()
        # With factors of an earlier matrix, many iterations say nothing about those of the present
        # one.
        if self._applications > self.max_applications and not self._is_kept:
            self._hard_steps.extend()
        self._applications = 0
        self._is_kept = False
        self._is_complete = self._hard_steps.left > 0
        if self._is_complete:
            factorisation.replace(self._complete, matrix)
            self.problem = factorisation.set_up(self._complete)
        else:
            self._set_up_incomplete(matrix, is_new_step)

    def _set_up_incomplete(self, matrix: PETSc.Mat, is_new_step: bool) -> None:
        """Factorise the block F of the films incompletely, and eliminate the other unknowns g: Z =
        F̃⁻¹ B and the Schur complement D - C Z.

        The matrix has the blocks F (films), B (columns of g in the rows of the films), C (rows of
        g) and D (g by g); F̃ is the incomplete factorisation of F, whose failure sets `problem`.
        """
        F = matrix.createSubMatrix(self._film_set, self._film_set)
        self._factorise_incompletely(F)
        self.problem = ""
        has_failed = self._incomplete.getFailedReason() != PETSc.PC.FailedReason.NOERROR
        # All ranks must do the same from here.
        if self._comm.allreduce(has_failed):
            self.problem = "PETSc: the incomplete factorisation of the films failed"
            F.destroy()
            return
        if self._right is not None:
            self._right.destroy()
            self._solution.destroy()
        self._right, self._solution = F.createVecs()
        # The preconditioner retains it; on several ranks PETSc would hold what Python drops.
        F.destroy()
        self._take_rows(matrix)
        if is_new_step or len(self._Z) != len(self._all_rest):
            transposed_B = self._couplings_to_films(matrix)
            self._Z = np.array([self._solve_films(column) for column in transposed_B])
        coupling = self._sum(self._C @ self._Z[:, self._coupled].T)
        # LAPACK itself, as SciPy prints a warning where joints depend on each other.
        self._schur, self._pivots, zero_pivot = lapack.dgetrf(self._D - coupling)
        if zero_pivot:
            self.problem = SINGULAR

    def _factorise_incompletely(self, F: PETSc.Mat) -> None:
        """Set up F̃: an incomplete factorisation of F, on several ranks of overlapping parts of
        it."""
        # A new object: the pattern of contact differs from that of the matrix before.
        self._incomplete.destroy()
        self._incomplete = factorisation.new_incomplete(self._comm)
        self._incomplete.setOperators(F)
        factorisation.choose_fill(self._incomplete, ILU_LEVELS)
        self._incomplete.setUp()
        self._incomplete.setUpOnBlocks()

    def _sum(self, values: Array) -> Array:
        """Sum of an array over the ranks, on all of them.  Collective."""
        if self._comm.size == 1:
            return values
        total = np.zeros_like(values)
        self._comm.Allreduce(np.ascontiguousarray(values), total)
        return total

    def _take_rows(self, matrix: PETSc.Mat) -> None:
        """Read C (k, c) and D (k, k), where c counts this rank's unknowns of films that are coupled
        with the k eliminated ones, `_coupled`.  Collective.

        These are few: the nodes to which tethers are tied, and those that touch a hub.  The k
        sparse rows are sent to all ranks, each of which takes its own columns.
        """
        own_rows = [matrix.getRow(int(self._start + row)) for row in self._rest]
        all_rows = [row for rows in self._comm.allgather(own_rows) for row in rows]
        in_own_columns = np.zeros((len(all_rows), self._system.numbering.size_local))
        is_stored = np.zeros(in_own_columns.shape[1], dtype=bool)
        self._D = np.zeros((len(all_rows), len(all_rows)))
        for k, (columns, values) in enumerate(all_rows):
            is_own = (columns >= self._start) & (columns < self._start + len(is_stored))
            in_own_columns[k, columns[is_own] - self._start] = values[is_own]
            is_stored[columns[is_own] - self._start] = True
            is_rest = np.isin(columns, self._all_rest)
            self._D[k, np.searchsorted(self._all_rest, columns[is_rest])] = values[is_rest]
        self._coupled = np.flatnonzero(is_stored[self._films])
        self._C = in_own_columns[:, self._films[self._coupled]]

    def _couplings_to_films(self, matrix: PETSc.Mat) -> Array:
        """The transpose Bᵀ (k, films of this rank) of the block that couples films to the k
        eliminated unknowns, [N/m] for coordinates.  The matrix has the same pattern as its
        transpose, so that only the rows of coupled unknowns are read."""
        transpose = np.zeros((len(self._all_rest), len(self._films)))
        for film in self._coupled:
            columns, values = matrix.getRow(int(self._start + self._films[film]))
            is_rest = np.isin(columns, self._all_rest)
            eliminated = np.searchsorted(self._all_rest, columns[is_rest])
            transpose[eliminated, film] = values[is_rest]
        return transpose

    def _solve_films(self, values: Array) -> Array:
        """F̃⁻¹ times a vector, of which this rank has these values (films of this rank,).
        Collective."""
        # Only on one rank: where these values are zero, those of another rank may not be.
        if self._comm.size == 1 and not values.any():
            return np.zeros(len(values))
        self._right.array[:] = values
        self._incomplete.apply(self._right, self._solution)
        return self._solution.array_r.copy()

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Compute the correction z [m, or N for multipliers] of a residual r [N, or m and 1] by
        block elimination; called by PETSc.

            z_g = Σ⁻¹ (r_g - C F̃⁻¹ r_f),    z_f = F̃⁻¹ r_f - Z z_g

        for unknowns f of films and the few others g, with the Schur complement Σ.  After a
        factorisation that failed, z is NaN, so that the Krylov iteration ends.
        """
        self._applications += 1
        if self.problem:
            # The caller's iteration ends, and the step is repeated.
            z.array[:] = np.nan
            return
        if self._is_complete:
            self._complete.apply(r, z)
            return
        values = r.array_r
        of_films = self._solve_films(values[self._film_slice])
        right = -(self._C @ of_films[self._coupled])
        right[self._own] += values[self._rest]
        of_rest, _ = lapack.dgetrs(self._schur, self._pivots, self._sum(right))
        if not np.isfinite(of_rest).all():
            self.problem = SINGULAR
        with z as out:
            out[self._film_slice] = of_films - of_rest @ self._Z
            out[self._rest] = of_rest[self._own]

    def recover(self) -> None:
        """Become usable again after a step that was not solved.

        The next matrices are factorised if this one could not be.  Otherwise many Krylov iterations
        of the failed step count for nothing: its iterates were far from any solution, and the
        matrices of a shorter step are better conditioned.
        """
        self._step = None
        self._applications = 0
        self._hard_steps.restore()
        if self.problem:
            self._hard_steps.left = MAX_FACTORISED_STEPS
