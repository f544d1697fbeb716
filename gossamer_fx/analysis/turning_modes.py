"""Modes of a turning scene near a frequency, in real numbers.

With z = (φ, λ φ) the quadratic problem (λ² M + λ G + K) φ = 0 is (A - λ B) z = 0, and

    (A - σ B)⁻¹ B (x, y) = (u, x + σ u),     Q(σ) u = -(M y + G x + σ M x),     Q(σ) = K + σ G + σ² M

has the same vectors and the eigenvalues 1/(λ - σ), the largest of which are near σ.  For σ = iω its real part is taken,
with the eigenvalues ½ (1/(λ - iω) + 1/(λ + iω)): a real matrix that has those near ±iω as the largest (Parlett & Saad,
Linear Algebra Appl. 88 (1987) 575, doi:10.1016/0024-3795(87)90126-1).  Q(iω) is factorised as a real matrix of twice
the size.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.solvers import factorisation


class Inverse:
    """(A - σ B)⁻¹ B, or its real part, as a matrix: σ is `real`, or i `imaginary`; `problem` says if there is none."""

    def __init__(
        self, K: PETSc.Mat, G: PETSc.Mat, M: PETSc.Mat, real: float = 0.0, imaginary: float = 0.0
    ) -> None:
        self._G, self._M, self._σ, self._ω = G, M, real, imaginary
        Q = K.copy()
        Q.axpy(real**2 - imaginary**2, M, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        if imaginary:
            turning = [G.copy(), G.copy()]
            for matrix, factor in zip(turning, (-imaginary, imaginary), strict=True):
                matrix.scale(factor)
            Q = (
                PETSc.Mat()
                .createNest([[Q, turning[0]], [turning[1], Q]], comm=K.comm)
                .convert("aij", PETSc.Mat())
            )
        elif real:
            Q.axpy(real, G, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        self._pc = PETSc.PC().create(K.comm)
        self._pc.setOperators(Q)
        factorisation.choose(self._pc, Q)
        self.problem = factorisation.set_up(self._pc)
        self._b, self._u = Q.createVecRight(), Q.createVecRight()
        self._x, self._y, self._t = (K.createVecRight() for _ in range(3))
        self.n = self._x.getLocalSize()

    def operator(self) -> PETSc.Mat:
        """The matrix for an eigenvalue solver."""
        local, whole = self._x.getSizes()
        made = PETSc.Mat().createPython(((2 * local, 2 * whole),) * 2, self, self._M.comm)
        made.setUp()
        return made

    def mult(self, A: PETSc.Mat, z: PETSc.Vec, result: PETSc.Vec) -> None:
        n, values = self.n, z.array_r
        self._x.array[:], self._y.array[:] = values[:n], values[n:]
        b = self._b.array
        self._M.mult(self._x, self._t)
        b[:n] = -self._σ * self._t.array_r
        if self._ω:
            b[n:] = -self._ω * self._t.array_r
        for matrix, vector in ((self._M, self._y), (self._G, self._x)):
            matrix.mult(vector, self._t)
            b[:n] -= self._t.array_r
        self._pc.apply(self._b, self._u)
        u, out = self._u.array_r, result.array
        out[:n] = u[:n]
        out[n:] = self._x.array_r + (-self._ω * u[n:] if self._ω else self._σ * u[:n])

    def pair(self, z: npt.NDArray[np.complex128]) -> tuple[complex, npt.NDArray[np.complex128]]:
        """λ and this rank's part of φ of its part of a vector (φ, λ φ)."""
        φ, w = z[: self.n], z[self.n :]
        comm = self._M.comm.tompi4py()
        return complex(comm.allreduce(np.vdot(φ, w)) / comm.allreduce(np.vdot(φ, φ))), φ
