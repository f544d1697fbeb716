"""The linear system of a Newton step: sparse fields, bordered by a few scalars.

    [ A  G ] [δz]   [ r ]
    [ Hᵀ C ] [δy] = [ s ]

A preconditioner P ≈ A (a factorisation, or a multigrid cycle) becomes one of the whole by block elimination: with
Z = P⁻¹G and the small dense Σ = C - HᵀZ,

    δy = Σ⁻¹ (s - Hᵀ P⁻¹ r),    δz = P⁻¹ r - Z δy.

It is exact if P is, and a border costs one more application of P⁻¹ a Newton iteration, however dense it is.
All options can be overridden by PETSc's, prefix `gx_` (e.g. `-gx_pc_type lu`).
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.parts import Array

DIRECT_UP_TO = 6000  # unknowns; above, multigrid is cheaper than a factorisation


class Composite:
    """Vectors (z, y): fields distributed as A is, scalars y at the end of rank 0's part."""

    def __init__(self, comm: MPI.Comm, fields: PETSc.Vec, scalars: int) -> None:
        self.comm, self.fields, self.scalars = comm, fields.duplicate(), scalars
        self.n = fields.getLocalSize()

    def vector(self) -> PETSc.Vec:
        local = self.n + (self.scalars if self.comm.rank == 0 else 0)
        return PETSc.Vec().createMPI((local, None), comm=self.comm)

    def join(self, z: PETSc.Vec | None, y: Array, x: PETSc.Vec) -> None:
        """x = (z, y); z None leaves the fields."""
        with x as values:
            if z is not None:
                values[: self.n] = z.array_r
            if self.comm.rank == 0:
                values[self.n :] = y

    def split(self, x: PETSc.Vec) -> tuple[PETSc.Vec, Array]:
        """(z, y) of x; z is overwritten by the next call."""
        with self.fields as values:
            values[:] = x.array_r[: self.n]
        y: Array = self.comm.bcast(x.array_r[self.n :].copy() if self.comm.rank == 0 else None)
        return self.fields, y


class Bordered:
    """The bordered operator and its preconditioner, as PETSc's Python types."""

    def __init__(self, composite: Composite, A: PETSc.Mat, pc: PETSc.PC) -> None:
        self._composite, self._A, self._pc = composite, A, pc
        self._out = composite.fields.duplicate()

    def set(self, G: list[Array | None], H: list[Array | None], C: Array) -> None:
        """New coupling: owned parts of the columns and rows (None: zero), and the corner."""
        self._G, self._H, self._C = G, H, C

    def _rows(self, z: PETSc.Vec) -> Array:
        """Hᵀz."""
        local = np.array([0.0 if h is None else h @ z.array_r for h in self._H])
        return self._composite.comm.allreduce(local)

    # matrix

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, out: PETSc.Vec) -> None:
        z, y = self._composite.split(x)
        self._A.mult(z, self._out)
        with self._out as values:
            for g, yk in zip(self._G, y, strict=True):
                if g is not None:
                    values += g * yk
        self._composite.join(self._out, self._rows(z) + self._C @ y, out)

    # preconditioner

    def setUp(self, pc: PETSc.PC) -> None:
        self._pc.setOperators(self._A)
        self._pc.setUp()
        z = self._composite.fields
        self._Z: list[Array | None] = []
        Σ = self._C.copy()
        for k, g in enumerate(self._G):
            if g is None:
                self._Z.append(None)
                continue
            with z as values:
                values[:] = g
            self._pc.apply(z, self._out)
            self._Z.append(self._out.array_r.copy())
            Σ[:, k] -= self._rows(self._out)
        self._Σ = Σ

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, out: PETSc.Vec) -> None:
        z, s = self._composite.split(x)
        self._pc.apply(z, self._out)
        δy = np.linalg.solve(self._Σ, s - self._rows(self._out))
        with self._out as values:
            for Z, yk in zip(self._Z, δy, strict=True):
                if Z is not None:
                    values -= Z * yk
        self._composite.join(self._out, δy, out)


def defaults(size: int, iterative_allowed: bool = True) -> dict[str, str]:
    """PETSc options for a sparse system of `size` unknowns."""
    if size <= DIRECT_UP_TO or not iterative_allowed:
        return {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
    return {
        "ksp_type": "gmres",
        "ksp_rtol": "1e-3",
        "ksp_gmres_restart": "60",
        "pc_type": "hypre",
    }
