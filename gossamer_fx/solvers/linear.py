"""The linear system of a Newton step: sparse fields, bordered by a few scalars.

    [ A  G ] [δz]   [ r ]
    [ Hᵀ C ] [δy] = [ s ]

A preconditioner P ≈ A (a factorisation, or a coarse space and an incomplete factorisation in turn) becomes one of the
whole by block elimination: with Z = P⁻¹G and the small dense Σ = C - HᵀZ,

    δy = Σ⁻¹ (s - Hᵀ P⁻¹ r),    δz = P⁻¹ r - Z δy.

It is exact if P is, and a border costs one more application of P⁻¹ a Newton iteration, however dense it is.  Where P is
no factorisation, Z of an earlier iteration of the step does as well: Σ is made of it, too.
All options can be overridden by PETSc's, prefix `gx_` (e.g. `-gx_pc_type lu`).
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

import gossamer_fx.solvers.factorisation as factorisation
from gossamer_fx.model.body import Array
from gossamer_fx.system.system import System
from gossamer_fx.system.tangent import Tangent

MANY = 1000  # applications of a preconditioner that no solve makes
DIRECT_UP_TO = 3000  # unknowns up to which a factorisation is cheapest
SEARCHING_UP_TO = (
    900  # the same where what is coupled changes from step to step, and a factorisation fills
)
EASY = 10  # applications in a solve up to which a preconditioner needs no couplings beside the matrix that stays
REASONS = {
    int(getattr(PETSc.KSP.ConvergedReason, name)): words
    for name, words in {
        "DIVERGED_NANORINF": "numbers that are not finite",
        "DIVERGED_PCSETUP_FAILED": "its preconditioner could not be set up",
        "DIVERGED_MAX_IT": "too many iterations",
        "DIVERGED_BREAKDOWN": "breakdown",
    }.items()
}
RESTART = 60  # most Krylov iterations; an unfinished solution then serves Newton's iteration as an inexact one


class Composite:
    """Vectors (z, y): fields distributed as A is, scalars y at the end of rank 0's part."""

    def __init__(self, comm: MPI.Intracomm, fields: PETSc.Vec, scalars: int) -> None:
        self.comm, self.fields, self.scalars = comm, fields.duplicate(), scalars
        self.n = fields.getLocalSize()

    def vector(self) -> PETSc.Vec:
        local = self.n + (self.scalars if self.comm.rank == 0 else 0)
        return PETSc.Vec().createMPI((local, None), comm=self.comm)

    def join(self, z: PETSc.Vec | None, y: Array, x: PETSc.Vec) -> None:
        """x = (z, y); z None leaves the fields."""
        if not self.scalars:
            if z is not None:
                z.copy(x)
            return
        with x as values:
            if z is not None:
                values[: self.n] = z.array_r
            if self.comm.rank == 0:
                values[self.n :] = y

    def split(self, x: PETSc.Vec) -> tuple[PETSc.Vec, Array]:
        """(z, y) of x; z is overwritten by the next call."""
        if not self.scalars:
            x.copy(self.fields)
            return self.fields, np.zeros(0)
        with self.fields as values:
            values[:] = x.array_r[: self.n]
        y: Array = self.comm.bcast(x.array_r[self.n :].copy() if self.comm.rank == 0 else None)
        return self.fields, y


class Columns:
    """Owned parts of `count` columns as one array `values` (k, n) of the k that are not None, and their `places`."""

    def __init__(self, columns: list[Array | None]) -> None:
        self.count, self.places = (
            len(columns),
            [k for k, column in enumerate(columns) if column is not None],
        )
        self.values: Array = np.array([column for column in columns if column is not None])

    def products(self, z: Array) -> Array:
        """Each column times z (n,), or times each of z (k, n)."""
        found = np.zeros((self.count, *z.shape[:-1]))
        if self.places:
            found[self.places] = self.values @ z.T
        return found

    def add(self, z: PETSc.Vec, weights: Array) -> None:
        """z += Σ weights[k] columns[k]."""
        if self.places:
            with z as values:
                values += weights[self.places] @ self.values


class Bordered:
    """The bordered operator, as PETSc's Python matrix."""

    def __init__(self, composite: Composite, A: Tangent) -> None:
        self.composite, self.A = composite, A
        self._out = composite.fields.duplicate()

    def set(self, G: list[Array | None], H: list[Array | None], C: Array) -> None:
        """New coupling: owned parts of the columns and rows (None: zero), and the corner."""
        self.G, self.H, self.C = Columns(G), Columns(H), C

    def rows(self, z: Array) -> Array:
        """Hᵀz of the owned part of z (n,), or of several (k, n), whose products are the columns."""
        total: Array = np.zeros((self.H.count, *z.shape[:-1]))
        self.composite.comm.Allreduce(self.H.products(z), total)
        return total

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, out: PETSc.Vec) -> None:
        z, y = self.composite.split(x)
        self.A.mult(z, self._out)
        self.G.add(self._out, y)
        self.composite.join(self._out, self.rows(z.array_r) + self.C @ y, out)


class BorderedPreconditioner:
    """Block elimination with a preconditioner of the sparse part, as PETSc's Python preconditioner."""

    def __init__(self, operator: Bordered, sparse: PETSc.PC, system: System) -> None:
        self._operator, self._sparse, self._system = operator, sparse, system
        self._out = operator.composite.fields.duplicate()
        self._Z = Columns([])
        self._step: tuple[float, float] | None = None
        self._applications, self._enough = 0, 0  # since the last set-up, and with a Z of its own
        self._hard = False  # whether strong couplings are needed in this step

    def setUp(self, pc: PETSc.PC) -> None:
        operator = self._operator
        step = self._system.time, self._system.h
        self._hard = step == self._step and (self._hard or self._applications > EASY)
        if self._sparse.getType() in factorisation.TYPES:
            factorisation.replace(self._sparse, operator.A.whole())
        else:
            self._sparse.setOperators(
                operator.A.for_preconditioner() if self._hard else operator.A.A
            )
        self._sparse.setUp()
        if (
            self._sparse.getType() != "python"
            or step != self._step
            or self._applications > self._enough + 1
        ):
            self._solve_columns()
            self._step, self._enough = step, MANY
        elif self._enough == MANY:
            self._enough = self._applications
        self._applications = 0
        self._Σ = operator.C.copy()
        if self._Z.places:
            self._Σ[:, self._Z.places] -= operator.rows(self._Z.values)

    def _solve_columns(self) -> None:
        """Z = P⁻¹G."""
        operator, z = self._operator, self._operator.composite.fields
        solved: list[Array | None] = [None] * operator.G.count
        for k, g in zip(operator.G.places, operator.G.values, strict=True):
            with z as values:
                values[:] = g
            self._sparse.apply(z, self._out)
            solved[k] = self._out.array_r.copy()
        self._Z = Columns(solved)

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, out: PETSc.Vec) -> None:
        operator = self._operator
        self._applications += 1
        r, s = operator.composite.split(x)
        self._sparse.apply(r, self._out)
        right = s - operator.rows(self._out.array_r)
        try:
            δy: Array = np.linalg.solve(self._Σ, right)
        except (
            np.linalg.LinAlgError
        ):  # the iteration has gone astray: PETSc sees it and the step is retried
            δy = np.full_like(right, np.nan)
        self._Z.add(self._out, -δy)
        operator.composite.join(self._out, δy, out)


def configure(ksp: PETSc.KSP, pc: PETSc.PC, system: System, direct: bool) -> None:
    """Choose Krylov method and preconditioner of the sparse part; PETSc's options may override.

    A matrix with multipliers has zeros on its diagonal, which an incomplete factorisation cannot take: it is
    factorised, as are small ones and all if `direct`.  To let the coarse space hold what is tied, exactly, was tried:
    up to half a million unknowns of an antenna, on one and on two ranks, it took no less time than the factorisation.
    Nor does it pay to keep a factorisation for the next iteration, even of the last ones of a step: where films switch,
    the Krylov iterations that this costs take longer than another factorisation.
    """
    few = system.numbering.size <= (SEARCHING_UP_TO if system.active_sets else DIRECT_UP_TO)
    if direct or system.constraints is not None or few:
        ksp.setType("preonly")
        factorisation.choose(pc, system.A)
        return
    ksp.setType("gmres")
    ksp.setGMRESRestart(RESTART)
    ksp.setPCSide(PETSc.PC.Side.RIGHT)
    ksp.setTolerances(rtol=1e-3, max_it=RESTART)
    if PETSc.Options(pc.getOptionsPrefix()).getString("pc_type", "python") == "python":
        from gossamer_fx.solvers.two_level import TwoLevel

        pc.setType("python")
        pc.setPythonContext(TwoLevel(system))


def recover(pc: PETSc.PC) -> None:
    """Let a preconditioner forget that an earlier matrix could not be factorised."""
    if pc.getType() == "python":
        pc.getPythonContext().recover()
    elif factorisation.failure(pc) < 0:
        factorisation.renew(pc)


def reason(ksp: PETSc.KSP, pc: PETSc.PC) -> str:
    """Why the last linear system was not solved, in words."""
    code = int(ksp.getConvergedReason())
    return factorisation.reason(pc) or REASONS.get(code, f"PETSc's reason {code}")


def name(pc: PETSc.PC) -> str:
    """What a preconditioner is, in words."""
    kind = pc.getType()
    return str(pc.getPythonContext()) if kind == "python" else str(kind)
