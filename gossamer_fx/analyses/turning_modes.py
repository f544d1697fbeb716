"""Modes of a turning scene near a frequency, in real numbers.

With z = (φ, λ φ) the quadratic problem (λ² M + λ G + K) φ = 0 is (A - λ B) z = 0.  The real part of the inverse at iω,

    Re (A - iω B)⁻¹ B,

is a real matrix with the same vectors and the eigenvalues ½ (1/(λ - iω) + 1/(λ + iω)): those near ±iω are the largest
(Parlett & Saad, Linear Algebra Appl. 88 (1987) 575, doi:10.1016/0024-3795(87)90126-1).  It takes one factorisation of
Q = K - ω² M + iω G, twice as large in real numbers.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.checks.errors import NoEquilibrium
from gossamer_fx.solvers import factorisation


class NearFrequency:
    """The real part of the inverse at iω, as a matrix of twice as many unknowns.

    Raises:
        NoEquilibrium: ω is an eigenvalue to round-off, so that there is no inverse.
    """

    def __init__(self, K: PETSc.Mat, G: PETSc.Mat, M: PETSc.Mat, ω: float) -> None:
        self._G, self._M, self._ω = G, M, ω
        real, imaginary = K.copy(), G.copy()
        real.axpy(-(ω**2), M, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        imaginary.scale(ω)
        minus = imaginary.copy()
        minus.scale(-1.0)
        nest = PETSc.Mat().createNest([[real, minus], [imaginary, real]], comm=K.comm)
        self._Q = PETSc.Mat()
        nest.convert("aij", self._Q)
        self._pc = PETSc.PC().create(K.comm)
        self._pc.setOperators(self._Q)
        factorisation.choose(self._pc)
        problem = factorisation.set_up(self._pc)
        if problem:
            raise NoEquilibrium(f"modes: {ω / (2 * np.pi):.6g} Hz cannot be inverted, {problem}; ask for another.")
        self._b, self._u = self._Q.createVecRight(), self._Q.createVecRight()
        self._x, self._y, self._t = (K.createVecRight() for _ in range(3))
        self.n = self._x.getLocalSize()

    def operator(self) -> PETSc.Mat:
        """The matrix for an eigenvalue solver."""
        size = self._b.getSizes()
        made = PETSc.Mat().createPython((size, size), self, self._Q.comm)
        made.setUp()
        return made

    def mult(self, A: PETSc.Mat, z: PETSc.Vec, result: PETSc.Vec) -> None:
        """u = -Q⁻¹ (M y + G x + iω M x), w = x + iω u of z = (x, y): the real parts of u and w."""
        n, ω, values = self.n, self._ω, z.array_r
        self._x.array[:], self._y.array[:] = values[:n], values[n:]
        b = self._b.array
        self._M.mult(self._x, self._t)
        b[n:] = -ω * self._t.array_r
        self._M.mult(self._y, self._t)
        b[:n] = -self._t.array_r
        self._G.mult(self._x, self._t)
        b[:n] -= self._t.array_r
        self._pc.apply(self._b, self._u)
        u = self._u.array_r
        out = result.array
        out[:n], out[n:] = u[:n], self._x.array_r - ω * u[n:]

    def pair(self, z: npt.NDArray[np.complex128]) -> tuple[complex, npt.NDArray[np.complex128]]:
        """λ and this rank's part of φ of its part of a vector (φ, λ φ)."""
        φ, w = z[: self.n], z[self.n :]
        comm = self._Q.comm.tompi4py()
        return complex(comm.allreduce(np.vdot(φ, w)) / comm.allreduce(np.vdot(φ, φ))), φ
