"""Preconditioner for films that touch beams and rigid bodies at a few points.

Problem.  Beams and rigid bodies have multipliers, whose zeros on the diagonal no incomplete
factorisation bears, and may have many unknowns.  A film of any size would be factorised because of
them.

Idea.  With the unknowns f of films and the rest g the matrix is

    [ F  B ]
    [ C  D ]                                                                                  (1)

F is large, and D is sparse.  B and C have few columns and rows that are not zero, those of the k
unknowns c of g at which films are attached.  With a preconditioner F̃ of the films and Z = F̃⁻¹ B_c,
block elimination of a residual (r_f, r_g) gives

    S = D - C Z,    z_g = S⁻¹ (r_g - C F̃⁻¹ r_f),    z_f = F̃⁻¹ r_f - Z z_c                     (2)

S differs from D in a dense block of k rows only, and is factorised.

Algorithm.

1. For each matrix: F is a copy with the unit matrix in the rows and columns of g, so that the
   numbering stays; F̃ is the two-level preconditioner (`solvers.two_level`) of it.
2. Once a step: Z, by k applications of F̃⁻¹.
3. For each matrix: S, and its factorisation.
4. In each application: (2).

Limits.  `MAX_COUPLED` unknowns c.  No contact.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

import gossamer_fx.solve.solvers.factorisation as factorisation
import gossamer_fx.solve.solvers.linear as linear
from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.solvers.coarse_space import Indices
from gossamer_fx.solve.solvers.two_level import TwoLevel
from gossamer_fx.solve.system.system import System

# Largest number k of unknowns at which films are attached: an application of F̃⁻¹ for each, once a
# step.
MAX_COUPLED = 60


class CoupledBodies:
    """The preconditioner (2), as PETSc's Python preconditioner.

    `problem` says why the last factorisation of S failed, and is empty if it did not.
    """

    def __init__(self, system: System, condensed: Indices, rest: Indices, coupled: Indices) -> None:
        """Prepare for matrices with the pattern of the system.

        Args:
            system: the compiled scene.
            condensed: unknowns (m,) of this rank with rows and columns of the unit matrix.
            rest: unknowns g of this rank, in whole blocks.
            coupled: global indices (k,) of the unknowns c, sorted, the same on all ranks.
        """
        self._system = system
        self._comm = system.comm
        numbering = system.numbering
        self._rest = rest
        self._coupled = coupled
        self._is_film = np.ones(numbering.size_local, dtype=bool)
        self._is_film[rest] = False
        self._films = PETSc.PC().create(self._comm)
        self._films.setType("python")
        self._two_level = TwoLevel(system, np.union1d(condensed, rest))
        self._films.setPythonContext(self._two_level)
        size = numbering.block_size
        blocks = (numbering.start + rest[::size]) // size
        self._rest_set = PETSc.IS().createBlock(size, blocks.astype(PETSc.IntType), comm=self._comm)
        # This rank's part of the unknowns c: their positions among c and among its unknowns g.
        local = coupled - numbering.start
        self._own = np.flatnonzero(np.isin(local, rest))
        self._own_in_rest = np.searchsorted(rest, local[self._own])
        # Positions of c in the rows of S, on all ranks.
        first = int(self._comm.exscan(len(rest)) or 0)
        positions = self._comm.allgather(first + self._own_in_rest)
        self._in_S = np.concatenate(positions).astype(PETSc.IntType)
        self._factors = PETSc.PC().create(self._comm)
        factorisation.choose(self._factors)
        self._F: PETSc.Mat | None = None
        self._step: tuple[float, float] | None = None  # time and length of the step of Z
        self._Z: Array = np.zeros((0, numbering.size_local))
        self.problem = ""

    def __str__(self) -> str:
        return f"{self._two_level} and {len(self._coupled)} unknowns at which films are attached"

    def recover(self) -> None:
        """Become usable again after a matrix that could not be factorised."""
        linear.recover(self._films)
        self._step = None

    def setUp(self, pc: PETSc.PC) -> None:
        """Set up F̃, Z and S for the present matrix; called by PETSc.  Collective."""
        matrix = pc.getOperators()[0]
        start = self._system.numbering.start
        if self._F is None:
            self._F = matrix.duplicate()
            self._F.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
            self._films.setOperators(self._F)
            self._right, self._solution = self._F.createVecs()
        matrix.copy(self._F, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        self._F.zeroRowsColumns((start + self._rest).astype(PETSc.IntType), diag=1.0)
        self._films.setUp()
        pc.setFailedReason(self._films.getFailedReason())
        self.problem = ""
        if pc.getFailedReason() != PETSc.PC.FailedReason.NOERROR:
            return
        self._take_rows(matrix)
        step = self._system.time, self._system.h
        if step != self._step:
            self._step = step
            self._Z = self._solve_columns(matrix)
            # These applications say nothing about the Krylov iterations of a solve.
            self._two_level.applications = 0
        S = matrix.createSubMatrix(self._rest_set, self._rest_set)
        S = S.convert("aij")
        S.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        coupling = self._sum(self._C @ self._Z.T)
        own = self._in_S[self._own]
        S.setValues(own, self._in_S, -coupling[self._own], addv=PETSc.InsertMode.ADD_VALUES)
        S.assemble()
        factorisation.replace(self._factors, S)
        self.problem = factorisation.set_up(self._factors)
        self._right_of_rest, self._solution_of_rest = S.createVecs()

    def _take_rows(self, matrix: PETSc.Mat) -> None:
        """Read C (k, n) of the n unknowns of this rank, zero but for films.  Collective."""
        start = self._system.numbering.start
        own_rows = [matrix.getRow(int(self._coupled[k])) for k in self._own]
        all_rows = [row for rows in self._comm.allgather(own_rows) for row in rows]
        self._C = np.zeros((len(all_rows), len(self._is_film)))
        for k, (columns, values) in enumerate(all_rows):
            is_own = (columns >= start) & (columns < start + len(self._is_film))
            self._C[k, columns[is_own] - start] = values[is_own]
        self._C[:, ~self._is_film] = 0.0

    def _solve_columns(self, matrix: PETSc.Mat) -> Array:
        """Z (k, n) of the n unknowns of this rank.  The pattern is symmetric, so that only rows of
        films with entries in C are read.  Collective."""
        start = self._system.numbering.start
        B = np.zeros_like(self._C)
        for film in np.flatnonzero(self._C.any(axis=0)):
            columns, values = matrix.getRow(int(start + film))
            is_coupled = np.isin(columns, self._coupled)
            B[np.searchsorted(self._coupled, columns[is_coupled]), film] = values[is_coupled]
        Z = np.zeros_like(B)
        for k, column in enumerate(B):
            self._right.array[:] = column
            self._films.apply(self._right, self._solution)
            Z[k] = self._solution.array_r
        Z[:, ~self._is_film] = 0.0
        return Z

    def _sum(self, values: Array) -> Array:
        """Sum of an array over the ranks, on all of them.  Collective."""
        if self._comm.size == 1:
            return values
        total: Array = self._comm.allreduce(values)
        return total

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """Compute the correction z of a residual r by (2); called by PETSc.  After a factorisation
        that failed, z is NaN, so that the Krylov iteration ends."""
        if self.problem:
            z.set(np.nan)
            return
        r.copy(self._right)
        self._right.array[self._rest] = 0.0
        self._films.apply(self._right, z)
        right = r.array_r[self._rest]
        right[self._own_in_rest] -= self._sum(self._C @ z.array_r)[self._own]
        self._right_of_rest.array[:] = right
        self._factors.apply(self._right_of_rest, self._solution_of_rest)
        of_rest = self._solution_of_rest.array_r
        at_films = np.zeros(len(self._coupled))
        at_films[self._own] = of_rest[self._own_in_rest]
        with z as values:
            values -= self._sum(at_films) @ self._Z
            values[self._rest] = of_rest
