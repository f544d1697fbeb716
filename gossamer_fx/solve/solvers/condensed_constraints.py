"""Preconditioner for films and cables that are tied: tied coordinates are condensed exactly.

Problem.  Each tied node brings three Lagrange multipliers λ, whose zeros on the diagonal no
incomplete factorisation bears.  Newton's system is

    [ A  Cᵀ ] [z]   [r]
    [ C  0  ] [λ] = [s]                                                                       (1)

with the constant rows C of constraints that are linear in the coordinates: ties, seams, points held
on the ground, edges that slide in a plane.

Idea.  Solve each row of C for one coordinate of a film or cable, the slave.  All coordinates then
follow from the others, the masters y, and the right-hand side,

    z = T y + G s,    C T = 0,    C G = 1                                                     (2)

and the masters have a system without these multipliers,

    Tᵀ A T y = Tᵀ (r - A G s),    λ = Gᵀ (r - A z)                                            (3)

Algorithm.

1. Once: Gaussian elimination of the rows of C, so that a slave may be the master in another row
   (chains of ties).  Slaves are films and cables; of their coordinates in a row the one with the
   largest coefficient.
2. For each matrix: K = Tᵀ A T, with the unit matrix in the rows and columns of slaves and condensed
   multipliers, so that the numbering stays.  T differs from the unit matrix in few rows; A is
   copied and corrected in these rows and in those of their neighbours.
3. In each application: (3), with the two-level preconditioner (`solvers.two_level`) of K instead of
   its inverse.  (2) and the multipliers are exact, so that the Krylov iteration is that of the
   masters.

The matrix A is stored with the fill of K, so that the copy is one of memory.

Limits.  Scenes of films and cables only.  No contact, whose couplings change the pattern.

Tried, without gain: beams that hold a film at a few points factorised by themselves, and coupled by
a dense Schur complement.  The antenna of 170 thousand unknowns took as long as with a factorisation
of the whole, that of 47 thousand longer.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from gossamer_fx.core.algebra.point_measures import Gather
from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.solvers.coarse_space import Indices
from gossamer_fx.solve.solvers.eliminated_joints import EliminatedJoints, eliminated_unknowns
from gossamer_fx.solve.solvers.two_level import TwoLevel
from gossamer_fx.solve.system.system import System

# Coefficient of an equation below which it does not depend on a coordinate: round-off of the
# elimination of coefficients of about one.
NO_COEFFICIENT = 1e-12

# Marks of unknowns: 0 is held, 1 free, and 2 free and a coordinate of a film or cable.
HELD = 0
FILM = 2


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


class Ties:
    """The rules (2) of all slaves, the same on all ranks.

    Attributes:
        rules: by global index of the slave.
        gone: sorted global indices of slaves and condensed multipliers.
        owned: those of this rank, as indices of its part of a vector.
    """

    def __init__(self, system: System) -> None:
        """Eliminate the linear equations of the constraints of a system.  Collective."""
        numbering = system.numbering
        assert system.constraints is not None
        own_equations = system.constraints.linear_equations()
        equations = [each for part in numbering.comm.allgather(own_equations) for each in part]
        involved = np.unique([i for multiplier, row in equations for i in (multiplier, *row)])
        marks = _marks(system, involved)
        self.rules: dict[int, Rule] = {}
        condensed = []
        # Slaves by master, to find the rules into which a new one is substituted.
        users: dict[int, set[int]] = {}
        for multiplier, row in equations:
            if marks[multiplier] == HELD:
                continue
            found = self._solve(multiplier, row, marks)
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
        self.gone: Indices = np.array(sorted([*self.rules, *condensed]), dtype=np.int64)
        local = self.gone - numbering.start
        self.owned: Indices = local[(local >= 0) & (local < numbering.size_local)]

    def _solve(
        self, multiplier: int, row: dict[int, float], marks: dict[int, float]
    ) -> tuple[int, Rule] | None:
        """Solve the equation of a multiplier, with the coefficients `row` of its unknowns, for a
        new slave, once the slaves so far are substituted; returns the slave and its rule.  None if
        the equation has no free coordinate of a film or cable."""
        # The equation as a rule: 0 = Σ masters - s.
        equation = Rule({i: w for i, w in row.items() if marks[i] != HELD}, {multiplier: -1.0})
        for unknown in list(equation.masters):
            if unknown in self.rules:
                equation.substitute(unknown, self.rules[unknown])
        masters = {i: w for i, w in equation.masters.items() if abs(w) > NO_COEFFICIENT}
        candidates = [i for i in masters if marks[i] == FILM]
        if not candidates:
            return None
        slave = max(candidates, key=lambda i: abs(masters[i]))
        pivot = masters.pop(slave)
        return slave, Rule(
            {i: -w / pivot for i, w in masters.items()},
            {i: -w / pivot for i, w in equation.sides.items()},
        )


def _marks(system: System, unknowns: Indices) -> dict[int, float]:
    """The marks of unknowns of all ranks, by global index.  Collective."""
    marks = system.free_marks()
    for body in system.coordinates:
        if body.block.size == 3:
            marks.array[system.block(body).owned] *= FILM
    found = Gather(system.numbering, [unknowns.astype(PETSc.IntType)])(marks)[0]
    marks.destroy()
    return {int(unknown): float(mark) for unknown, mark in zip(unknowns, found, strict=True)}


class CondensedConstraints:
    """The preconditioner (3), as PETSc's Python preconditioner.

    In the code `near` are the unknowns on which the rows of K that differ from those of A depend;
    sparse matrices have columns for these only.
    """

    def __init__(self, system: System, ties: Ties) -> None:
        """Extend the pattern of the system's matrices by the fill of K.  Collective."""
        self._system = system
        self._ties = ties
        self._inner = PETSc.PC().create(system.comm)
        self._inner.setType("python")
        self._two_level = TwoLevel(system, ties.owned)
        self._inner.setPythonContext(self._two_level)
        self._find_rows(system.A)
        system.extend_pattern(self._add_fill)
        # Rows have more columns now.
        self._find_rows(system.A)
        self._K = system.A.duplicate()
        self._inner.setOperators(self._K)
        self._right = system.numbering.vector()
        self._gather = Gather(system.numbering, [self._near])

    def __str__(self) -> str:
        return f"{self._two_level}, {len(self._ties.rules)} tied coordinates condensed"

    def recover(self) -> None:
        """Become usable again after a matrix that could not be factorised."""
        self._two_level.recover()

    # ---- structure, once -------------------------------------------------------------------------

    def _find_rows(self, A: PETSc.Mat) -> None:
        """Find this rank's rows of A that differ in K, the unknowns `near` them, and the parts of E
        and G that these rows need.  Collective."""
        numbering = self._system.numbering
        gone = self._ties.gone
        own_gone = numbering.start + self._ties.owned
        none = np.zeros(0, dtype=np.int64)
        # The pattern is symmetric: these are the rows with entries in columns that vanish.
        columns = [A.getRow(int(row))[0] for row in own_gone]
        touched = np.unique(np.concatenate([none, *columns]))
        all_rows = np.union1d(np.concatenate(numbering.comm.allgather(touched)), gone)
        local = all_rows - numbering.start
        is_own = (local >= 0) & (local < numbering.size_local)
        self._rows = all_rows[is_own]
        self._columns = [A.getRow(int(row))[0] for row in self._rows]
        self._find_near()
        # Rows of slaves and condensed multipliers vanish: their positions among the rows that
        # change, those of the others, and the positions of the first ones among `near`.
        is_gone = np.isin(self._rows, gone)
        self._gone_rows = np.flatnonzero(is_gone)
        self._other_rows = np.flatnonzero(~is_gone)
        self._gone_near = np.searchsorted(self._near, own_gone)
        self._own_E = self._E[self._gone_near]
        self._own_G = self._G[self._gone_near]
        # Rows of T of the slaves on this rank, by their masters.
        is_kept = ~np.isin(self._near, gone)
        self._by_master = self._own_E.multiply(is_kept).T.tocsr()
        self._by_master.eliminate_zeros()

    def _find_near(self) -> None:
        """Find the unknowns near the rows that change, and the matrices E = T - 1 and G on them."""
        near = {int(column) for columns in self._columns for column in columns}
        rules = {}
        for unknown in near:
            if unknown in self._ties.rules:
                rules[unknown] = self._ties.rules[unknown]
        for rule in rules.values():
            near.update(rule.masters)
            near.update(rule.sides)
        self._near = np.array(sorted(near), dtype=PETSc.IntType)
        position = {int(unknown): k for k, unknown in enumerate(self._near)}
        # Rows, columns and values.  Slaves and multipliers have no column in T.
        of_E: list[tuple[int, int, float]] = []
        of_G: list[tuple[int, int, float]] = []
        for k in np.flatnonzero(np.isin(self._near, self._ties.gone)):
            of_E.append((int(k), int(k), -1.0))
        for slave, rule in rules.items():
            row = position[slave]
            for master, coefficient in rule.masters.items():
                of_E.append((row, position[master], coefficient))
            for multiplier, coefficient in rule.sides.items():
                of_G.append((row, position[multiplier], coefficient))
        self._E = _sparse(of_E, len(near))
        self._G = _sparse(of_G, len(near))

    def _changed_rows(self, values: Array) -> csr_matrix:
        """The rows of A that change, with columns near them, of the values of their entries."""
        starts = np.cumsum([0, *[len(columns) for columns in self._columns]])
        none = np.zeros(0, dtype=PETSc.IntType)
        columns = np.searchsorted(self._near, np.concatenate([none, *self._columns]))
        return csr_matrix((values, columns, starts), shape=(len(self._rows), len(self._near)))

    def _add_fill(self, pattern: PETSc.Mat) -> None:
        """Add the entries of K that A does not have, with the value zero."""
        count = sum(len(columns) for columns in self._columns)
        # Positive numbers, so that no entry cancels.
        A = self._changed_rows(np.ones(count))
        AE = A @ abs(self._E)
        others = self._rows[self._other_rows]
        self._add(pattern, 0.0 * AE[self._other_rows], others)
        of_slaves = (A + AE)[self._gone_rows]
        self._add(pattern, 0.0 * (abs(self._by_master) @ of_slaves), self._near)

    # ---- for each matrix -------------------------------------------------------------------------

    def setUp(self, pc: PETSc.PC) -> None:
        """Compute K of the present matrix A, and set up its preconditioner; called by PETSc.
        Collective."""
        matrix = pc.getOperators()[0]
        values = [matrix.getRow(int(row))[1] for row in self._rows]
        self._A = self._changed_rows(np.concatenate([np.zeros(0), *values]))
        self._own_A = self._A[self._gone_rows]
        # K = A + A E + Eᵀ (A + A E), with the unit matrix where T has no columns.
        AE = self._A @ self._E
        others = self._rows[self._other_rows]
        gone = self._rows[self._gone_rows]
        of_slaves = self._own_A + AE[self._gone_rows]
        K = self._K
        matrix.copy(K, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._add(K, AE[self._other_rows], others)
        self._add(K, self._by_master @ of_slaves, self._near)
        self._add(K, -self._own_A, gone)
        for row in gone:
            K.setValue(int(row), int(row), 1.0, addv=PETSc.InsertMode.ADD_VALUES)
        K.assemble()
        self._inner.setUp()
        pc.setFailedReason(self._inner.getFailedReason())

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
        start = self._system.numbering.start
        owned = self._ties.owned
        right = self._right
        # r - A G s: `shift` is G s.
        shift = self._G @ self._gather(r)[0]
        r.copy(right)
        right.array[self._rows - start] -= self._A @ shift
        # Tᵀ of it.
        self._gather.add(self._own_E.T @ right.array_r[owned], right)
        self._inner.apply(right, z)
        # z = T y + G s, without multipliers.
        z.array[owned] += self._own_E @ self._gather(z)[0]
        z.array[owned] += shift[self._gone_near]
        # λ = Gᵀ (r - A z).
        residual = r.array_r[owned] - self._own_A @ self._gather(z)[0]
        self._gather.add(self._own_G.T @ residual, z)


def for_constraints(
    system: System, max_iterations: int
) -> CondensedConstraints | EliminatedJoints | None:
    """The preconditioner of a system with constraints, as the context of PETSc's Python
    preconditioner: films and cables whose ties are condensed, or films with few other unknowns.
    None if the matrix is to be factorised.  A solve ends after `max_iterations`.  Collective."""
    if not system.active_sets:
        ties = Ties(system)
        if _leaves_films_only(system, ties):
            return CondensedConstraints(system, ties)
    few = eliminated_unknowns(system)
    if few is None:
        return None
    return EliminatedJoints(system, few, max_iterations)


def _leaves_films_only(system: System, ties: Ties) -> bool:
    """Whether all free unknowns are those of films and cables, once ties are condensed.
    Collective."""
    is_left = np.ones(system.numbering.size_local, dtype=bool)
    for body in system.coordinates:
        if body.block.size == 3:
            is_left[system.block(body).owned] = False
    is_left[ties.owned] = False
    is_left[system.supports.held] = False
    return not system.comm.allreduce(bool(is_left.any()), op=MPI.LOR)


def _sparse(entries: list[tuple[int, int, float]], size: int) -> csr_matrix:
    """A square sparse matrix of entries (row, column, value)."""
    rows, columns, values = np.array(entries).reshape(-1, 3).T
    indices = rows.astype(np.int64), columns.astype(np.int64)
    return csr_matrix((values, indices), shape=(size, size))
