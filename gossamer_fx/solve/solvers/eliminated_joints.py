"""Preconditioner for films with other unknowns, few of which are coupled with films: hubs, hinged
panels, tethers and multipliers are eliminated exactly.

Problem.  An incomplete factorisation needs a diagonal without zeros, which Lagrange multipliers do
not have. A film of any size would therefore be factorised completely because of one hub.

Idea.  Order the unknowns into those of the films, f, and the others, g.  A residual r = (r_f,
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
2. Once a step, compute Z by an application of F̃⁻¹ to each column of B that is not zero.  For each
   matrix factorise Σ, which is sparse: C Z couples only unknowns g that are coupled with films.
3. In each Krylov iteration, apply (2) and (3).
4. Within a step keep F̃ for the next Newton iteration while solves with it take few Krylov
   iterations, and replace it within a solve that takes more.  F̃ of the first iterate is not kept:
   the first update is by far the largest one.
5. Where F is too ill-conditioned, as in slack film and long steps, Krylov iterations rise.  If a
   solve has taken more of them than a complete factorisation costs, factorise the other matrices of
   the step completely.  Each further step in a row in which that happens doubles the number of
   steps that begin with complete factorisations, up to `MAX_FACTORISED_STEPS`.

Cost.  Step 2 costs as many applications of F̃⁻¹ as unknowns g are coupled with films, at most
`MAX_ELIMINATED`.  Step 3 costs one application of F̃⁻¹ and products with Z and C.

Several ranks.  F̃ is additive Schwarz: each rank factorises its part of F, which overlaps the others
by three cells.  Every rank keeps the columns of C and the rows of Z that belong to its own films,
and all of Σ, so that a Krylov iteration sums one small array over the ranks.

Limits.  Bodies whose nodes have three unknowns.
"""

from __future__ import annotations

import contextlib
import math
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import SuperLU, splu

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

# Largest number of unknowns g that are coupled with films, of all ranks: an application of F̃⁻¹ for
# each, once a step.  A film of 48 thousand unknowns on ropes between hinged panels, with 10
# iterations in a step, takes 0.55 of the CPU time of a factorisation with 6 columns that are not
# zero, 0.73 with 24, 0.84 with 48, 1.2 with 96.
MAX_ELIMINATED = 60

# Largest share of unknowns g in all unknowns, if they are more than `MAX_ELIMINATED`: every rank
# factorises all of Σ.  Films between beams, which have 28 to 44 % of the unknowns, take 2.5 times
# the time of a factorisation, hinged panels with 15 % of them 0.66 to 1.18.
MAX_SHARE = 0.125

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


def other_unknowns(system: System) -> Indices:
    """Local indices (k,) of the unknowns of this rank that are not films: those of rigid bodies,
    point masses, beams and multipliers."""
    is_film = np.zeros(system.unknowns.numbering.size_local, dtype=bool)
    for body in system.unknowns.coordinates:
        if body.block.size == 3:
            is_film[system.unknowns.block(body).owned] = True
    return np.flatnonzero(~is_film).astype(PETSc.IntType)


def can_be_eliminated(system: System, unknowns: Indices) -> bool:
    """Whether this preconditioner serves a scene, with these local indices of `other_unknowns` on
    each rank.  Collective.

    Matrices have blocks of three rows, there are such unknowns, at most 60 of them are coupled with
    films, and they are not more than an eighth of all, unless they are at most 60.  With contact
    all coordinates of bodies count as coupled.
    """
    numbering = system.unknowns.numbering
    rest = np.concatenate(system.comm.allgather(numbering.start + unknowns))
    largest = max(MAX_ELIMINATED, MAX_SHARE * numbering.size)
    if numbering.block_size != 3 or not 0 < len(rest) <= largest:
        return False
    if system.equations.active_sets:
        assert system.equations.constraints is not None
        multipliers = system.equations.constraints.owned
        coupled = len(unknowns) - (multipliers.stop - multipliers.start)
    else:
        rows = numbering.start + unknowns
        coupled = sum(
            not np.isin(system.matrices.A.getRow(int(row))[0], rest).all() for row in rows
        )
    return system.comm.allreduce(coupled) <= MAX_ELIMINATED


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
        films = np.setdiff1d(np.arange(system.unknowns.numbering.size_local), eliminated)
        self._films = films
        # Films mostly stand one after the other, and a slice copies nothing.
        self._film_slice: Indices | slice = films
        if len(films) and films[-1] - films[0] == len(films) - 1:
            self._film_slice = slice(int(films[0]), int(films[-1]) + 1)
        self._comm = system.comm
        self._start = system.unknowns.numbering.start
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
        self.max_applications = max_applications(system.unknowns.numbering.size, max_iterations)
        self._step: tuple[float, float] | None = None  # time and length of the step of Z
        self._applications = 0  # since the last set-up
        self._is_kept = False  # whether the factors are those of an earlier matrix
        self._Z: Array = np.zeros((0, len(films)))
        self._bound: Indices = np.zeros(0, dtype=np.int64)  # those of the rows of Z
        self._schur: SuperLU | None = None
        self.problem = ""

    def __str__(self) -> str:
        kind = self._incomplete.getType()
        return f"{kind} of {ILU_LEVELS} levels and {len(self._all_rest)} unknowns eliminated"

    def keep_factors(self) -> bool:
        """Keep the factors of an earlier matrix for the next one, if they serve; returns whether
        they do: within the same time step, if they are not those of its first matrix, if the last
        solve with them took at most 7 Krylov iterations and no factorisation failed.  Applications
        are then counted from zero."""
        is_same_step = (self._system.unknowns.time, self._system.unknowns.h) == self._step
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
        step = self._system.unknowns.time, self._system.unknowns.h
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
        before = self._bound
        self._take_rows(matrix)
        if is_new_step or not np.array_equal(self._bound, before):
            self._Z = self._solved_columns(self._couplings_to_films(matrix))
        coupling = self._sum(self._C @ self._Z[:, self._coupled].T)
        self._factorise_schur(coupling)

    def _factorise_schur(self, coupling: Array) -> None:
        """Factorise Σ = D - C Z, with C Z (b, b) of the unknowns that are coupled with films."""
        rows = np.repeat(self._bound, len(self._bound))
        columns = np.tile(self._bound, len(self._bound))
        schur = self._D - csc_matrix((coupling.ravel(), (rows, columns)), shape=self._D.shape)
        self._schur = None
        # SuperLU does not stop at numbers that are not finite.
        if np.isfinite(schur.data).all():
            with contextlib.suppress(RuntimeError):  # of a pivot that is zero
                self._schur = splu(schur)
        if self._schur is None:
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
        """Read D (k, k) of the k eliminated unknowns, which of them are coupled with films,
        `_bound` (b,), and their C (b, c), where c counts this rank's unknowns of films that are
        coupled with any, `_coupled`.  Collective.

        Both are few: the nodes to which tethers are tied, those that touch a hub, and the bodies
        that they are tied to.  The k sparse rows are sent to all ranks.
        """
        own_rows = [matrix.getRow(int(self._start + row)) for row in self._rest]
        all_rows = [row for rows in self._comm.allgather(own_rows) for row in rows]
        columns = np.concatenate([columns for columns, _ in all_rows])
        values = np.concatenate([values for _, values in all_rows])
        count = len(all_rows)
        rows = np.repeat(np.arange(count), [len(columns) for columns, _ in all_rows])
        is_rest = np.isin(columns, self._all_rest)
        of_rest = np.searchsorted(self._all_rest, columns[is_rest])
        self._D = csc_matrix((values[is_rest], (rows[is_rest], of_rest)), shape=(count, count))
        self._bound = np.unique(rows[~is_rest])
        end = self._start + self._system.unknowns.numbering.size_local
        is_own = ~is_rest & (columns >= self._start) & (columns < end)
        own_columns = np.searchsorted(self._films, columns[is_own] - self._start)
        self._coupled = np.unique(own_columns)
        self._C = np.zeros((len(self._bound), len(self._coupled)))
        place = np.searchsorted(self._bound, rows[is_own])
        self._C[place, np.searchsorted(self._coupled, own_columns)] = values[is_own]

    def _couplings_to_films(self, matrix: PETSc.Mat) -> Array:
        """The transpose Bᵀ (b, films of this rank) of the block that couples films to the b
        eliminated unknowns, [N/m] for coordinates.  The matrix has the same pattern as its
        transpose, so that only the rows of coupled unknowns are read."""
        transpose = np.zeros((len(self._bound), len(self._films)))
        bound = self._all_rest[self._bound]
        for film in self._coupled:
            columns, values = matrix.getRow(int(self._start + self._films[film]))
            is_bound = np.isin(columns, bound)
            transpose[np.searchsorted(bound, columns[is_bound]), film] = values[is_bound]
        return transpose

    def _solved_columns(self, columns: Array) -> Array:
        """F̃⁻¹ times each of some vectors (b, films of this rank), of which many may be zero: a rope
        at the centre of a rigid body does not turn it.  Collective."""
        solved = np.zeros_like(columns)
        sizes = self._sum(np.abs(columns).sum(axis=1))
        for k in np.flatnonzero(sizes):
            solved[k] = self._solve_films(columns[k])
        return solved

    def _solve_films(self, values: Array) -> Array:
        """F̃⁻¹ times a vector, of which this rank has these values (films of this rank,).
        Collective."""
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
        right = np.zeros(len(self._all_rest))
        right[self._bound] = -(self._C @ of_films[self._coupled])
        right[self._own] += values[self._rest]
        assert self._schur is not None, "problem is empty"
        of_rest = self._schur.solve(self._sum(right))
        if not np.isfinite(of_rest).all():
            self.problem = SINGULAR
        with z as out:
            out[self._film_slice] = of_films - of_rest[self._bound] @ self._Z
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
