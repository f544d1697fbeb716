"""Preconditioner for films, beams and rigid bodies: their constraints are condensed exactly.

Problem.  Each tied node brings three Lagrange multipliers λ, and so does each node of a beam, whose
two directors stay orthonormal.  No incomplete factorisation bears their zeros on the diagonal.
Newton's system is

    [ A  Bᵀ ] [z]   [r]
    [ C  0  ] [λ] = [s]                                                                       (1)

with the gradients C of the constraints at the end of the step, and B in the middle, where the
forces act.

Idea.  Coordinates that fulfil the constraints follow from others, y, and the right-hand side,

    z = R y + G s,    C R = 0,    C G = 1                                                     (2)

With L and H, which are to B what R and G are to C, y has a system without these multipliers,

    Lᵀ A R y = Lᵀ (r - A G s),    λ = Hᵀ (r - A z)                                            (3)

A constraint that is linear in the coordinates (ties, seams, ball joints, rigid regions, points held
on the ground, edges that slide in a plane) has B = C.  Its equation is solved for one coordinate,
the slave.

Directors d_i that stay orthonormal can only turn, by a vector θ,

    δd_i = θ × d_i                                                                            (4)

so that R has three columns for the six or nine numbers of a frame, with d_i at the end of the step,
and L the same in the middle (discrete null space method, Betsch, CMAME 194 (2005) 5159,
doi:10.1016/j.cma.2005.01.004).

Algorithm.

1. Once: Gaussian elimination of the linear equations, so that a slave may follow a coordinate that
   is itself a slave (chains of ties).  The slave is the coordinate with the largest coefficient, of
   a film or cable if the equation has one, else of the position of another body.
2. For each matrix: R = V R_d, of the elimination V and the rotations R_d of (4); L in the same way.
3. K = Lᵀ A R, with the unit matrix in the rows and columns of what is gone, so that the numbering
   stays; θ has the numbers of the first director.  R differs from the unit matrix in few rows; A is
   copied and corrected in these rows and in those of their neighbours.
4. In each application: (3), with the two-level preconditioner (`solvers.two_level`) of K instead of
   its inverse.  (2) and the multipliers are exact, so that the Krylov iteration is that of y.

The matrix A is stored with the fill of K, so that the copy is one of memory.

Contact.  Its couplings C change their pattern.  The operator of the iteration adds products
Lᵀ C R y; the two-level preconditioner gets K + Lᵀ C R with the strong ones, as a new matrix.

Limits.  No multipliers of other joints.  Of directors that are held in part the multipliers remain.
No frames together with gas.

Tried, without gain: beams that hold a film at a few points factorised by themselves, and coupled by
a dense Schur complement.  The antenna of 170 thousand unknowns took as long as with a factorisation
of the whole, that of 47 thousand longer.  Incomplete factors kept for the next iteration of a step
take 1.4 times the time, a factorisation of K as a symmetric matrix 1.5 times.
"""

from __future__ import annotations

import itertools
import weakref
from dataclasses import dataclass, field

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_matrix, identity

import gossamer_fx.solve.solvers.eliminated_joints as eliminated_joints
import gossamer_fx.solve.solvers.factorisation as factorisation
from gossamer_fx.core.algebra.point_measures import Gather
from gossamer_fx.core.algebra.rotations import cross_matrices
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.terms.assembly import Frames
from gossamer_fx.solve.solvers.coarse_space import NONE, Indices
from gossamer_fx.solve.solvers.two_level import TwoLevel
from gossamer_fx.solve.system.system import System

# Coefficient of an equation below which it does not depend on a coordinate: round-off of the
# elimination of coefficients of about one.
NO_COEFFICIENT = 1e-12

# Share of films and cables in the unknowns from which Krylov iterations take less time than a
# factorisation: that of beams or hubs alone has little fill.
MIN_FILM_SHARE = 0.5

# Unknowns from which frames are condensed.  With 49 thousand a step of a taut film between two
# beams takes 0.94 s of CPU time and 2.5 Krylov iterations for one of Newton's, with all factorised
# 1.63 s.
MIN_UNKNOWNS_WITH_FRAMES = 40_000

# Krylov iterations after which a factorisation costs less than more of them: with frames 5 for 47
# thousand unknowns of an antenna, 9 for 170 thousand.  In its almost slack film, solutions of a few
# digits may also double Newton's iterations.  14 steps of the former take 0.97 of the time of
# factorisations alone, with a limit of 8 they take 1.11.
MAX_ITERATIONS = 6

# The same with neither frames nor contact.  Of a sheet of 46 thousand unknowns in two tied halves a
# factorisation costs as much as 35 iterations; six steps that end none take 0.52 of the time of
# factorisations alone, with a limit of 12 0.57, with 6 0.85.
MAX_ITERATIONS_OF_TIES = 60

# Relative residual of a solution from which a factorisation without scaling is not accurate enough.
# Antennas have 1e-12.
MAX_RESIDUAL = 1e-9

# Largest number of steps that are factorised before Krylov iterations are tried again.
MAX_FACTORISED_STEPS = 64

KSP_REASON = PETSc.KSP.ConvergedReason

# Marks of unknowns: held, a free position, and a free coordinate of a film or cable; 1 for other
# free ones.  A slave has the largest mark in its equation, at least that of positions.
HELD = 0
POSITION = 2
FILM = 3


@dataclass
class Rule:
    """One slave coordinate [m] as a sum over its masters and over right-hand sides s of (1): their
    coefficients [-], by global index of the master or of the multiplier."""

    masters: dict[int, float]
    sides: dict[int, float] = field(default_factory=dict)

    def substitute(self, slave: int, rule: Rule) -> None:
        """Replace the master `slave`, itself a slave, by its own rule; changes this one."""
        factor = self.masters.pop(slave)
        for master, coefficient in rule.masters.items():
            self.masters[master] = self.masters.get(master, 0.0) + factor * coefficient
        for multiplier, coefficient in rule.sides.items():
            self.sides[multiplier] = self.sides.get(multiplier, 0.0) + factor * coefficient


class Condensation:
    """The unknowns that follow from others, the same on all ranks.

    Attributes:
        rules: of slaves, by global index.
        frames: directors that can only turn.
        changed: sorted global indices of the unknowns whose rows in R are not those of the unit
            matrix: slaves, directors and condensed multipliers.
        gone: those of them whose columns in R vanish: all but first directors, in whose place is θ.
        owned: those of `gone` that this rank owns, as indices of its part of a vector.
    """

    def __init__(self, system: System, frames: list[Frames]) -> None:
        """Find all constraints of a system that can be condensed, with its free `frames`.
        Collective."""
        assert system.equations.constraints is not None
        self.frames = frames
        own_equations = system.equations.constraints.linear_equations()
        equations = [each for part in system.comm.allgather(own_equations) for each in part]
        involved = np.unique([i for multiplier, row in equations for i in (multiplier, *row)])
        marks_of_involved = _marks(system, involved)
        marks = [float(mark) for mark in marks_of_involved]
        self._marks = {int(unknown): mark for unknown, mark in zip(involved, marks, strict=True)}
        self.rules: dict[int, Rule] = {}
        gone: list[Indices] = [self._eliminate(equations)]
        places_of_turns: list[Indices] = [NONE]
        for each in self.frames:
            gone.append(each.directors[:, 3:].ravel())
            gone.append(each.multipliers.ravel())
            places_of_turns.append(each.directors[:, :3].ravel())
        self.gone: Indices = np.sort(np.concatenate(gone))
        self.changed: Indices = np.union1d(self.gone, np.concatenate(places_of_turns))
        local = self.gone - system.unknowns.numbering.start
        self.owned = local[(local >= 0) & (local < system.unknowns.numbering.size_local)]

    def _eliminate(self, equations: list[tuple[int, dict[int, float]]]) -> Indices:
        """Find the rules of all slaves; returns these and the condensed multipliers."""
        condensed = []
        # Slaves by master, to find the rules into which a new one is substituted.
        users: dict[int, set[int]] = {}
        for multiplier, row in equations:
            if self._marks[multiplier] == HELD:
                continue
            found = self._solve(multiplier, row)
            if found is None:
                continue
            slave, rule = found
            for user in users.pop(slave, set()):
                self.rules[user].substitute(slave, rule)
                for master in rule.masters:
                    users.setdefault(master, set()).add(user)
            for master in rule.masters:
                users.setdefault(master, set()).add(slave)
            self.rules[slave] = rule
            condensed.append(multiplier)
        return np.array([*self.rules, *condensed], dtype=np.int64)

    def _solve(self, multiplier: int, row: dict[int, float]) -> tuple[int, Rule] | None:
        """Solve the equation of a multiplier, with the coefficients `row` of its unknowns, for a
        new slave, once the slaves so far are substituted; returns the slave and its rule.  None if
        the equation has no free position."""
        marks = self._marks
        # The equation as a rule: 0 = Σ masters - s.
        equation = Rule({i: w for i, w in row.items() if marks[i] != HELD}, {multiplier: -1.0})
        for unknown in list(equation.masters):
            if unknown in self.rules:
                equation.substitute(unknown, self.rules[unknown])
        masters = {i: w for i, w in equation.masters.items() if abs(w) > NO_COEFFICIENT}
        candidates = [i for i in masters if marks[i] >= POSITION]
        if not candidates:
            return None
        slave = max(candidates, key=lambda i: (marks[i], abs(masters[i])))
        pivot = masters.pop(slave)
        return slave, Rule(
            {i: -w / pivot for i, w in masters.items()},
            {i: -w / pivot for i, w in equation.sides.items()},
        )

    def leaves_no_multiplier(self, system: System) -> bool:
        """Whether all free multipliers of all ranks are condensed.  Collective."""
        assert system.equations.constraints is not None
        is_left = np.zeros(system.unknowns.numbering.size_local, dtype=bool)
        is_left[system.equations.constraints.owned] = True
        is_left[self.owned] = False
        is_left[system.unknowns.supports.held] = False
        return not system.comm.allreduce(bool(is_left.any()), op=MPI.LOR)


def _marks(system: System, unknowns: Indices) -> Array:
    """The marks (n,) of unknowns (n,) of all ranks, by global index.  Collective."""
    marks = system.unknowns.free_marks()
    is_position = np.repeat(system.unknowns.position_marks, 3) > 0
    marks.array[: len(is_position)][is_position] *= POSITION
    for body in system.unknowns.coordinates:
        if body.block.size == 3:
            marks.array[system.unknowns.block(body).owned] *= FILM / POSITION
    found = Gather(system.unknowns.numbering, [unknowns.astype(PETSc.IntType)])(marks)[0]
    marks.destroy()
    return found


def _free_frames(system: System) -> list[Frames]:
    """The frames of all ranks of which nothing is held, one object for each number of directors.
    Collective."""
    assert system.equations.constraints is not None
    parts = system.comm.allgather(system.equations.constraints.frames())
    by_size: dict[int, list[Frames]] = {}
    for each in itertools.chain.from_iterable(parts):
        by_size.setdefault(each.directors.shape[1], []).append(each)
    found = []
    for size, alike in sorted(by_size.items()):
        unknowns = np.concatenate([np.hstack([f.directors, f.multipliers]) for f in alike])
        marks = _marks(system, unknowns.ravel()).reshape(unknowns.shape)
        unknowns = unknowns[(marks != HELD).all(axis=1)]
        found.append(Frames(unknowns[:, :size], unknowns[:, size:], alike[0].products))
    return found


def _turns(d: Array) -> Array:
    """The matrices (n, 3k, 3) of (4), by which k directors d (n, 3k) turn with θ."""
    directors = d.reshape(len(d), d.shape[1] // 3, 3)
    return -cross_matrices(directors).reshape(*d.shape, 3)


def _right_inverses(products: Array, d: Array) -> Array:
    """Matrices G (n, 3k, m) with C G = 1, for the gradients C (n, m, 3k) of the measures with these
    products at directors d (n, 3k)."""
    C = np.einsum("mab,nb->nma", products, d)
    try:
        inverses = np.linalg.solve(C @ C.transpose(0, 2, 1), C)
    except np.linalg.LinAlgError:
        # Dependent directors, perhaps on this rank only: all ranks find that K is not finite.
        inverses = np.full_like(C, np.nan)
    return inverses.transpose(0, 2, 1)


class CondensedConstraints:
    """The preconditioner (3), as PETSc's Python preconditioner.

    `problem` says why a factorisation of the whole matrix failed, and is empty if none did;
    `are_ties_alone` says that there are neither frames nor contact.

    In the code `near` are the unknowns on which the rows of K that differ from those of A depend;
    sparse matrices have columns for these only.
    """

    adds_couplings = True

    def __init__(self, system: System, condensation: Condensation) -> None:
        """Extend the pattern of the system's matrices by the fill of K.  Collective."""
        self._system = system
        self._condensation = condensation
        self.inner = PETSc.PC().create(system.comm)
        self.inner.setType("python")
        has_frames = bool(condensation.frames)
        self.are_ties_alone = not has_frames and not system.equations.active_sets
        self._two_level = TwoLevel(system, condensation.owned, is_difficult=has_frames)
        self.inner.setPythonContext(self._two_level)
        self.problem = ""
        self._hard_steps = factorisation.HardSteps(MAX_FACTORISED_STEPS)
        self._step: tuple[float, float] | None = None  # time and length of the last step
        # This rank's changed rows of R - 1 at the end and of L - 1 in the middle of the step.
        self._own_E: csr_matrix
        self._own_E_middle: csr_matrix
        self._find_rows(system.matrices.A)
        # Before the matrix is made again, with more entries.
        self._A = self._rows_of(system.matrices.A)
        system.matrices.extend_pattern(self._add_fill)
        # Rows have more columns now.
        self._find_rows(system.matrices.A)
        self.K = system.matrices.A.duplicate()
        # After the matrices are made again.
        self.tangent = system.matrices.coupled_tangent
        self._coupled = self.K  # K with strong couplings of contact
        self._right = system.unknowns.numbering.vector()
        self._work = system.unknowns.numbering.vector()
        self._product = system.unknowns.numbering.vector()
        self._gather = Gather(system.unknowns.numbering, [self._near])

    def __str__(self) -> str:
        turned = sum(len(each.directors) for each in self._condensation.frames)
        words = f"{self._two_level}, {len(self._condensation.rules)} tied coordinates condensed"
        if turned:
            words += f" and {turned} frames"
        return words

    def recover(self) -> None:
        """Become usable again after a step that was not solved: its hard solves do not count."""
        self._two_level.recover()
        self._hard_steps.restore()
        self._step = None

    # ---- structure, once -------------------------------------------------------------------------

    def _find_rows(self, A: PETSc.Mat) -> None:
        """Find this rank's rows of A that differ in K, and the unknowns `near` them.  Collective.

        Rows and unknowns are those of whole blocks, as PETSc takes them out of a matrix.
        """
        numbering = self._system.unknowns.numbering
        changed = self._condensation.changed
        is_own = (changed >= numbering.start) & (changed < numbering.start + numbering.size_local)
        own_changed = changed[is_own]
        # The pattern is symmetric: these are the rows with entries in columns that change.
        touched = _columns(A, own_changed)
        all_rows = np.union1d(np.concatenate(numbering.comm.allgather(touched)), changed)
        is_own = (all_rows >= numbering.start) & (all_rows < numbering.start + numbering.size_local)
        self._rows = self._whole_blocks(all_rows[is_own])
        near = {int(unknown) for unknown in _columns(A, self._rows)}
        self._find_near(near)
        size = numbering.block_size
        self._row_set = _index_set(self._rows, size)
        self._near_set = _index_set(self._near, size)
        self._part: PETSc.Mat | None = None
        self._scalar_part: PETSc.Mat | None = None
        # Positions among rows and among `near` of what changes on this rank.
        self._own_changed = own_changed - numbering.start
        self._changed_rows = np.searchsorted(self._rows, own_changed)
        self._changed_near = np.searchsorted(self._near, own_changed)
        # Rows of what is gone become those of the unit matrix.
        is_gone = np.isin(self._rows, self._condensation.gone)
        self._gone_rows = np.flatnonzero(is_gone)
        self._other_rows = np.flatnonzero(~is_gone)
        count = len(self._gone_rows)
        diagonal = np.searchsorted(self._near, self._rows[self._gone_rows])
        self._unit_rows = csr_matrix(
            (np.ones(count), (np.arange(count), diagonal)), shape=(count, len(self._near))
        )
        self._is_kept = ~np.isin(self._near, self._condensation.gone)

    def _whole_blocks(self, unknowns: Indices) -> Indices:
        """All unknowns (n,) of the blocks of some global indices, sorted."""
        size = self._system.unknowns.numbering.block_size
        blocks = np.unique(unknowns // size)
        return (size * blocks[:, None] + np.arange(size)).ravel()

    def _find_near(self, near: set[int]) -> None:
        """Complete the unknowns `near` rows that change, and find the constant parts of R and G on
        them: the matrix V of the elimination, and its right-hand sides."""
        rules = {}
        for unknown in near:
            if unknown in self._condensation.rules:
                rules[unknown] = self._condensation.rules[unknown]
        for rule in rules.values():
            near.update(rule.masters)
            near.update(rule.sides)
        some = np.array(sorted(near), dtype=PETSc.IntType)
        near_frames = []
        for each in self._condensation.frames:
            unknowns = np.hstack([each.directors, each.multipliers])
            is_near = np.isin(unknowns, some).any(axis=1)
            some = np.union1d(some, unknowns[is_near])
            near_frames.append((each, is_near))
        self._near = self._whole_blocks(some).astype(PETSc.IntType)
        # With positions among `near` instead of global indices.
        self._frames = []
        for each, is_near in near_frames:
            directors = np.searchsorted(self._near, each.directors[is_near])
            multipliers = np.searchsorted(self._near, each.multipliers[is_near])
            self._frames.append(
                Frames(
                    directors.astype(PETSc.IntType),
                    multipliers.astype(PETSc.IntType),
                    each.products,
                )
            )
        position = {int(unknown): k for k, unknown in enumerate(self._near)}
        # Rows, columns and values.  Slaves and multipliers of ties have no column.
        of_V: list[tuple[int, int, float]] = []
        of_ties: list[tuple[int, int, float]] = []
        is_in_frame = np.isin(self._near, self._turned())
        is_gone = np.isin(self._near, self._condensation.gone)
        for k in np.flatnonzero(is_in_frame | ~is_gone):
            of_V.append((int(k), int(k), 1.0))
        for slave, rule in rules.items():
            row = position[slave]
            for master, coefficient in rule.masters.items():
                of_V.append((row, position[master], coefficient))
            for multiplier, coefficient in rule.sides.items():
                of_ties.append((row, position[multiplier], coefficient))
        self._V = _sparse(of_V, len(self._near))
        self._of_ties = _sparse(of_ties, len(self._near))
        # Rows of R_d that are those of the unit matrix.
        self._unturned = np.flatnonzero(~is_in_frame)

    def _turned(self) -> Indices:
        """Global indices of all directors and multipliers of frames."""
        parts = [NONE]
        for each in self._condensation.frames:
            parts += [each.directors.ravel(), each.multipliers.ravel()]
        return np.concatenate(parts)

    def _add_fill(self, pattern: PETSc.Mat) -> None:
        """Add the entries of K that A does not have, with the value zero."""
        A = self._A
        # Positive numbers, so that no entry cancels.
        A.data[:] = 1.0
        E = abs(self._map([np.ones((*each.directors.shape, 3)) for each in self._frames]))
        AE = A @ E
        others = self._rows[self._other_rows]
        self._add(pattern, 0.0 * AE[self._other_rows], others)
        of_changed = (A + AE)[self._changed_rows]
        self._add(pattern, 0.0 * (self._columns_of(E) @ of_changed), self._near)

    def _map(self, turns: list[Array]) -> csr_matrix:
        """R - 1 for matrices of (4), or L - 1, on the unknowns near."""
        size = len(self._near)
        blocks = []
        for each, values in zip(self._frames, turns, strict=True):
            blocks.append(_blocks(each.directors, each.directors[:, :3], values, size))
        unit = csr_matrix(
            (np.ones(len(self._unturned)), (self._unturned, self._unturned)), shape=(size, size)
        )
        return self._V @ sum(blocks, unit) - identity(size, format="csr")

    def _sides(self, right_inverses: list[Array]) -> csr_matrix:
        """G for right inverses of the gradients of frames, or H, on the unknowns near."""
        G = self._of_ties
        for each, values in zip(self._frames, right_inverses, strict=True):
            G = G + self._V @ _blocks(each.directors, each.multipliers, values, len(self._near))
        return G

    def _columns_of(self, E: csr_matrix) -> csr_matrix:
        """The transpose of the rows of E = L - 1 that this rank owns, without rows of unknowns that
        are gone."""
        return E[self._changed_near].multiply(self._is_kept).T.tocsr()

    # ---- for each matrix -------------------------------------------------------------------------

    def setUp(self, pc: PETSc.PC) -> None:
        """Compute K of the present matrix A, and set up its preconditioner, unless matrices of this
        step are factorised; called by PETSc.  Collective."""
        step = self._system.unknowns.time, self._system.unknowns.h
        if step != self._step:
            self._hard_steps.begin_step()
        self._step = step
        if not self.is_factorised:
            self._condense(pc.getOperators()[0])
            pc.setFailedReason(self.inner.getFailedReason())

    @property
    def is_factorised(self) -> bool:
        """Whether A is factorised as a whole in the present step, as `CondensedSolver` decided."""
        return self._hard_steps.left > 0

    def give_up(self) -> None:
        """Factorise the rest of this attempt at a step, and further ones, see `HardSteps`."""
        self._hard_steps.extend()
        # The present one does not count.
        self._hard_steps.left += 1

    def _condense(self, matrix: PETSc.Mat) -> None:
        """Compute K of a matrix A, and set up its preconditioner.  Collective."""
        E, E_middle = self._turn()
        self._A = self._rows_of(matrix)
        self._own_A = self._A[self._changed_rows]
        # K = A + A (R - 1) + (L - 1)ᵀ A R, with the unit matrix where R has no columns.
        AE = self._A @ E
        others = self._rows[self._other_rows]
        gone = self._rows[self._gone_rows]
        of_changed = self._own_A + AE[self._changed_rows]
        K = self.K
        matrix.copy(K, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._add(K, AE[self._other_rows], others)
        self._add(K, self._columns_of(E_middle) @ of_changed, self._near)
        self._add(K, self._unit_rows - self._A[self._gone_rows], gone)
        K.assemble()
        if self._coupled.handle != K.handle:
            self._coupled.destroy()
        self._coupled = self._with_strong_couplings()
        self.inner.setOperators(self._coupled, K)
        self.inner.setUp()

    def _with_strong_couplings(self) -> PETSc.Mat:
        """K + Lᵀ C R with those couplings C of contact that a preconditioner needs, as a new
        matrix; K itself if there are none.  Collective."""
        strong = self.tangent.strong_couplings()
        if not strong:
            return self.K
        total = self.K.copy()
        # The pattern of K is fixed, and the couplings have entries elsewhere.
        total.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, False)
        R = self._as_matrix(self._own_E)
        L = self._as_matrix(self._own_E_middle)
        for C in strong:
            scalar = C.convert("aij", PETSc.Mat())
            CR = scalar.matMult(R)
            condensed = L.transposeMatMult(CR)
            condensed.convert(total.getType())
            total.axpy(1.0, condensed, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            for matrix in (C, scalar, CR, condensed):
                matrix.destroy()
        R.destroy()
        L.destroy()
        return total

    def _as_matrix(self, own_E: csr_matrix) -> PETSc.Mat:
        """R or L of all ranks, from this rank's changed rows of R - 1 or L - 1.  Collective."""
        R = PETSc.Mat().create(self.K.comm)
        R.setType("aij")
        R.setSizes(self.K.getSizes())
        R.setBlockSize(self.K.getBlockSize())
        R.setUp()
        # Before the diagonal, with which PETSc assembles R: to add a row later is to copy R.
        self._add(R, own_E, self._rows[self._changed_rows])
        ones = self.K.createVecLeft()
        ones.set(1.0)
        R.setDiagonal(ones, addv=PETSc.InsertMode.ADD_VALUES)
        ones.destroy()
        R.assemble()
        return R

    def _rows_of(self, matrix: PETSc.Mat) -> csr_matrix:
        """This rank's rows of a matrix that change, with columns near them.  Collective."""
        reused = None
        if self._part is not None:
            reused = [self._part]
        (self._part,) = matrix.createSubMatrices([self._row_set], [self._near_set], reused)
        self._scalar_part = self._part.convert("aij", out=self._scalar_part or PETSc.Mat())
        starts, columns, values = self._scalar_part.getValuesCSR()
        return csr_matrix((values, columns, starts), shape=(len(self._rows), len(self._near)))

    def _turn(self) -> tuple[csr_matrix, csr_matrix]:
        """Compute G and H for the directors of the present iterate; returns R - 1 and L - 1.
        Collective."""
        system = self._system
        end = self._gather(system.unknowns.q1)[0]
        start = self._gather(system.unknowns.q0)[0]
        α = system.unknowns.rule.alpha
        E, self._G = self._at(end)
        E_middle, H = self._at((1 - α) * start + α * end)
        self._own_E = E[self._changed_near]
        self._own_E_middle = E_middle[self._changed_near]
        self._own_H = H[self._changed_near]
        return E, E_middle

    def _at(self, q: Array) -> tuple[csr_matrix, csr_matrix]:
        """R - 1 and G for unknowns q (n,) near."""
        turns = []
        inverses = []
        for each in self._frames:
            d = q[each.directors]
            turns.append(_turns(d))
            inverses.append(_right_inverses(each.products, d))
        return self._map(turns), self._sides(inverses)

    def _add(self, matrix: PETSc.Mat, values: csr_matrix, rows: Indices) -> None:
        """Add a sparse matrix (rows, near) to the rows of a matrix with these global indices; the
        collective assembly is left to the caller."""
        is_stored = np.diff(values.indptr) > 0
        starts = values.indptr[np.append(is_stored, True)]
        if len(values.data):
            matrix.setValuesIJV(
                starts.astype(PETSc.IntType),
                self._near[values.indices],
                values.data,
                addv=PETSc.InsertMode.ADD_VALUES,
                rowmap=rows[is_stored].astype(PETSc.IntType),
            )

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Compute the correction z of a residual r, with multipliers [N] and coordinates [m], by
        (3); called by PETSc."""
        self.inner.apply(self.condensed(r), z)
        self.expand(r, z)

    def condensed(self, r: PETSc.Vec) -> PETSc.Vec:
        """Lᵀ (r - A G s) of a residual, in a vector that the next call overwrites.  Collective."""
        right = self._right
        # G s of the residual's violations s.
        self._shift = self._G @ self._gather(r)[0]
        r.copy(right)
        right.array[self._rows - self._system.unknowns.numbering.start] -= self._A @ self._shift
        if self.tangent.is_coupled:
            self._work.zeroEntries()
            self._work.array[self._own_changed] = -self._shift[self._changed_near]
            self.tangent.add_couplings(self._work, right)
        self._project(right)
        return right

    def _project(self, r: PETSc.Vec) -> None:
        """Turn r into Lᵀ r, in place.  Collective."""
        of_changed = r.array_r[self._own_changed]
        self._gather.add(self._own_E_middle.T @ of_changed, r)

    def add_couplings(self, y: PETSc.Vec, out: PETSc.Vec) -> None:
        """Add Lᵀ C R y to `out`, with all couplings C of contact.  Collective."""
        if not self.tangent.is_coupled:
            return
        z = self._work
        y.copy(z)
        z.array[self._own_changed] += self._own_E @ self._gather(y)[0]
        product = self._product
        product.zeroEntries()
        self.tangent.add_couplings(z, product)
        self._project(product)
        out.axpy(1.0, product)

    def expand(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Turn z = y into all coordinates and multipliers, in place; r is the residual of the last
        `condensed`.  Collective."""
        own = self._own_changed
        # z = R y + G s, without multipliers.
        z.array[own] += self._own_E @ self._gather(z)[0]
        z.array[own] += self._shift[self._changed_near]
        # λ = Hᵀ (r - A z), where A has the couplings of contact.
        residual = r.array_r[own] - self._own_A @ self._gather(z)[0]
        if self.tangent.is_coupled:
            self._work.zeroEntries()
            self.tangent.add_couplings(z, self._work)
            residual -= self._work.array_r[own]
        self._gather.add(self._own_H.T @ residual, z)


class _WeakContext:
    """Operator and preconditioner of a `CondensedSolver`, to which it has only a weak reference:
    the garbage collector does not see those that PETSc holds."""

    def __init__(self, solver: CondensedSolver) -> None:
        self._solver = weakref.ref(solver)

    def mult(self, matrix: PETSc.Mat, y: PETSc.Vec, out: PETSc.Vec) -> None:
        """Called by PETSc."""
        solver = self._solver()
        assert solver is not None
        solver.multiply(y, out)

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, y: PETSc.Vec) -> None:
        """Called by PETSc."""
        solver = self._solver()
        assert solver is not None
        solver.precondition(r, y)


class CondensedSolver:
    """Solves (3) by GMRES and recovers (2), as PETSc's Python solver of the whole system, whose
    preconditioner is `CondensedConstraints`.

    The residual of K is measured with each entry over the root of its diagonal entry, which is
    nearly the root of an energy: that of stiff beams in newtons is far larger than that of a film,
    so that a reduction of its norm says nothing about the film.  An antenna of 47 thousand unknowns
    takes 4.4 instead of 9.7 iterations for one of Newton's, at tolerances with which these are as
    many.

    A solve that takes more than `MAX_ITERATIONS`, of ties alone `MAX_ITERATIONS_OF_TIES`, is ended
    by a factorisation of the whole matrix, and so are the others of the step and some steps more:
    with solutions of a few digits Newton's iteration may not converge there.
    """

    def __init__(self, preconditioner: CondensedConstraints) -> None:
        self._condensed = preconditioner
        K = preconditioner.K
        context = _WeakContext(self)
        operator = PETSc.Mat().createPython(K.getSizes(), context, K.comm)
        operator.setUp()
        self._krylov = PETSc.KSP().create(K.comm)
        self._krylov.setType("fgmres")
        self._krylov.setGMRESRestart(MAX_ITERATIONS_OF_TIES)
        self._krylov.setPCSide(PETSc.PC.Side.RIGHT)
        self._krylov.setOperators(operator)
        pc = self._krylov.getPC()
        pc.setType("python")
        pc.setPythonContext(context)
        self._complete: PETSc.PC = None  # a factorisation of A, in hard steps
        # Diagonal^(-1/2).
        self._scale = K.createVecLeft()
        self._work = K.createVecLeft()

    def multiply(self, y: PETSc.Vec, out: PETSc.Vec) -> None:
        """Set out = D^(-1/2) (K + Lᵀ C R) y, with the diagonal D of K and couplings C."""
        self._condensed.K.mult(y, out)
        self._condensed.add_couplings(y, out)
        out.pointwiseMult(out, self._scale)

    def precondition(self, r: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set y to the preconditioned residual r, which is scaled."""
        self._work.pointwiseDivide(r, self._scale)
        self._condensed.inner.apply(self._work, y)

    def solve(self, ksp: PETSc.KSP, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Solve (1) for a residual r to the relative tolerance of `ksp`; called by PETSc, after the
        set-up of the preconditioner.  Collective."""
        if not self._condensed.is_factorised:
            # Factors take much memory and are seldom needed.
            if self._complete is not None:
                self._complete.destroy()
                self._complete = None
            self._iterate(ksp, r, z)
        if self._condensed.is_factorised:
            self._factorise(ksp, r, z)

    def _iterate(self, ksp: PETSc.KSP, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Solve (1) by Krylov iterations, or find that it is to be factorised.  Collective."""
        right = self._condensed.condensed(r)
        self._condensed.K.getDiagonal(self._scale)
        self._scale.sqrtabs()
        self._scale.reciprocal()
        right.pointwiseMult(right, self._scale)
        are_ties_alone = self._condensed.are_ties_alone
        most = MAX_ITERATIONS_OF_TIES if are_ties_alone else MAX_ITERATIONS
        self._krylov.setTolerances(rtol=ksp.getTolerances()[0], max_it=most)
        self._krylov.solve(right, z)
        reason = self._krylov.getConvergedReason()
        self._condensed.problem = ""
        ksp.setIterationNumber(self._krylov.getIterationNumber())
        ksp.setConvergedReason(reason)
        if reason < 0:
            self._condensed.give_up()
        else:
            self._condensed.expand(r, z)

    def _factorise(self, ksp: PETSc.KSP, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Solve (1) by a factorisation, with scaled rows and columns only where it is not accurate
        without.  Collective."""
        A = self._condensed.tangent.for_factorisation()
        if self._complete is not None and A.handle != self._complete.getOperators()[0].handle:
            # Couplings of contact have changed the pattern.
            self._complete.destroy()
            self._complete = None
        if self._complete is None:
            self._complete = factorisation.new(A, is_scaled=False)
        if not self._is_accurate(A, r, z):
            self._complete.destroy()
            self._complete = factorisation.new(A, is_scaled=True)
            self._is_accurate(A, r, z)
        reason = KSP_REASON.CONVERGED_ITS
        if self._condensed.problem:
            reason = KSP_REASON.DIVERGED_PCSETUP_FAILED
        ksp.setIterationNumber(ksp.getIterationNumber() + 1)
        ksp.setConvergedReason(reason)
        if A.comm.size > 1 and A.handle != self._condensed.tangent.A.handle:
            # The preconditioner retains it; on several ranks PETSc would hold what Python drops.
            A.destroy()

    def _is_accurate(self, A: PETSc.Mat, r: PETSc.Vec, z: PETSc.Vec) -> bool:
        """Set z to the solution of A z = r by the present factorisation; whether it is accurate.
        Sets `problem`.  Collective."""
        self._complete.setOperators(A)
        self._condensed.problem = factorisation.set_up(self._complete)
        if self._condensed.problem:
            return False
        self._complete.apply(r, z)
        A.mult(z, self._work)
        self._work.axpy(-1.0, r)
        # Written so that NaN counts as inaccurate.
        return bool(self._work.norm() <= MAX_RESIDUAL * r.norm())


def for_constraints(
    system: System, max_iterations: int, is_alone: bool
) -> CondensedConstraints | eliminated_joints.EliminatedJoints | None:
    """The preconditioner of a system with constraints, as the context of PETSc's Python
    preconditioner: films whose constraints are condensed, or films with few other unknowns.  None
    if the matrix is to be factorised.  A solve ends after `max_iterations`.  `is_alone` says that
    there are no scalar unknowns, so that `CondensedSolver` serves, which frames need.  Collective.
    """
    others = eliminated_joints.other_unknowns(system)
    are_few = system.comm.allreduce(len(others)) <= eliminated_joints.MAX_ELIMINATED
    is_large = (
        not are_few and is_alone and system.unknowns.numbering.size >= MIN_UNKNOWNS_WITH_FRAMES
    )
    of_films = system.comm.allreduce(system.unknowns.numbering.size_local - len(others))
    has_films = of_films >= MIN_FILM_SHARE * system.unknowns.numbering.size
    has_contact = bool(system.equations.active_sets)
    if has_films and not (are_few and has_contact):
        frames = _free_frames(system)
        if is_large or not frames:
            condensation = Condensation(system, frames)
            if condensation.leaves_no_multiplier(system):
                return CondensedConstraints(system, condensation)
    if not eliminated_joints.can_be_eliminated(system, others):
        return None
    return eliminated_joints.EliminatedJoints(system, others, max_iterations)


def _columns(A: PETSc.Mat, rows: Indices) -> Indices:
    """Sorted global indices of the columns in which rows of this rank have entries."""
    return np.unique(np.concatenate([NONE, *(A.getRow(int(row))[0] for row in rows)]))


def _index_set(unknowns: Indices, size: int) -> PETSc.IS:
    """The index set of unknowns of whole blocks of a size, on this rank alone."""
    blocks = unknowns[::size] // size
    return PETSc.IS().createBlock(size, blocks.astype(PETSc.IntType), comm=MPI.COMM_SELF)


def _blocks(rows: Indices, columns: Indices, values: Array, size: int) -> csr_matrix:
    """A square sparse matrix of dense blocks (n, r, c) at rows (n, r) and columns (n, c)."""
    all_rows = np.broadcast_to(rows[:, :, None], values.shape).ravel()
    all_columns = np.broadcast_to(columns[:, None, :], values.shape).ravel()
    return csr_matrix((values.ravel(), (all_rows, all_columns)), shape=(size, size))


def _sparse(entries: list[tuple[int, int, float]], size: int) -> csr_matrix:
    """A square sparse matrix of entries (row, column, value)."""
    rows, columns, values = np.array(entries).reshape(-1, 3).T
    indices = rows.astype(np.int64), columns.astype(np.int64)
    return csr_matrix((values, indices), shape=(size, size))
