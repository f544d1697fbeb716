"""Modes of a scene in a turning frame, near a frequency, in real arithmetic.

Problem.  (λ² M + λ G + K) φ = 0 is quadratic in λ, and its solutions are complex although K, G and
M are real.

Idea.  With z = (φ, λ φ) it is linear, (A - λ B) z = 0, and shift and invert at σ gives

    (A - σ B)⁻¹ B (x, y) = (u, x + σ u)                                                       (1)
    Q(σ) u = -(M y + G x + σ M x),    Q(σ) = K + σ G + σ² M                                   (2)

with the same vectors and the eigenvalues 1/(λ - σ), of which the largest belong to λ near σ.

For an imaginary σ = iω, the real part of the operator is used.  It has the eigenvalues

    ½ (1/(λ - iω) + 1/(λ + iω))                                                               (3)

which are largest near ±iω (Parlett & Saad, Linear Algebra Appl. 88 (1987) 575).  Q(iω)
is factorised as a real matrix of twice the size,

    [ K - ω² M    -ω G     ]
    [ ω G         K - ω² M ]                                                                  (4)

λ follows from the vector: it is the factor between the two halves of z.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from gossamer_fx.solve.solvers import factorisation

DIFFERENT_PATTERN = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN

Shape = npt.NDArray[np.complex128]


class Inverse:
    """The operator (1) for the shift σ = `real` [1/s], or its real part for σ = i `imaginary`, from
    tangent, Coriolis and mass matrix without fixed coordinates.  `problem` says why Q(σ) could not
    be factorised, and is empty if it was."""

    def __init__(
        self, K: PETSc.Mat, G: PETSc.Mat, M: PETSc.Mat, real: float = 0.0, imaginary: float = 0.0
    ) -> None:
        self._G = G
        self._M = M
        self._σ = real
        self._ω = imaginary
        Q = self._shifted_matrix(K)
        self._pc = PETSc.PC().create(K.comm)
        self._pc.setOperators(Q)
        factorisation.choose(self._pc, Q)
        self.problem = factorisation.set_up(self._pc)
        self._right = Q.createVecRight()
        self._u = Q.createVecRight()
        self._x = K.createVecRight()
        self._y = K.createVecRight()
        self._product = K.createVecRight()
        self.n = self._x.getLocalSize()

    def _shifted_matrix(self, K: PETSc.Mat) -> PETSc.Mat:
        """Q(σ) = K + σ G + σ² M [N/m] of (2), or (4) for σ = iω: the real matrix [[K - ω² M, -ω G],
        [ω G, K - ω² M]] of twice the size."""
        Q = K.copy()
        Q.axpy(self._σ**2 - self._ω**2, self._M, DIFFERENT_PATTERN)
        if self._ω:
            minus_ωG = self._G.copy()
            minus_ωG.scale(-self._ω)
            ωG = self._G.copy()
            ωG.scale(self._ω)
            nested = PETSc.Mat().createNest([[Q, minus_ωG], [ωG, Q]], comm=K.comm)
            # MUMPS does not factorise a nested matrix.
            return nested.convert("aij", PETSc.Mat())
        if self._σ:
            Q.axpy(self._σ, self._G, DIFFERENT_PATTERN)
        return Q

    def operator(self) -> PETSc.Mat:
        """The operator on z = (x, y) as a matrix for an eigenvalue solver."""
        local, total = self._x.getSizes()
        sizes = (2 * local, 2 * total)
        operator = PETSc.Mat().createPython((sizes, sizes), self, self._M.comm)
        operator.setUp()
        return operator

    def mult(self, matrix: PETSc.Mat, z: PETSc.Vec, result: PETSc.Vec) -> None:
        """Set result to (u, x + σ u) with Q(σ) u = -(M y + G x + σ M x) for z = (x, y), see (1), or
        to its real part; called by SLEPc.  Collective."""
        n = self.n
        self._x.array[:] = z.array_r[:n]
        self._y.array[:] = z.array_r[n:]

        # Right-hand side of (2); its imaginary part is the second half.
        right = self._right.array
        self._M.mult(self._x, self._product)
        right[:n] = -self._σ * self._product.array_r
        if self._ω:
            right[n:] = -self._ω * self._product.array_r
        self._M.mult(self._y, self._product)
        right[:n] -= self._product.array_r
        self._G.mult(self._x, self._product)
        right[:n] -= self._product.array_r
        self._pc.apply(self._right, self._u)

        # Real part of σ u: of iω u it is -ω times the imaginary part of u.
        u = self._u.array_r
        σu = self._σ * u[:n]
        if self._ω:
            σu = -self._ω * u[n:]
        out = result.array
        out[:n] = u[:n]
        out[n:] = self._x.array_r + σu

    def pair(self, z: Shape) -> tuple[complex, Shape]:
        """The λ [1/s] that fits an eigenvector z = (φ, λφ) best, and φ; of z and φ this rank's
        parts.  Collective."""
        φ = z[: self.n]
        λφ = z[self.n :]
        comm = self._M.comm.tompi4py()
        product = comm.allreduce(np.vdot(φ, λφ))
        square = comm.allreduce(np.vdot(φ, φ))
        return complex(product / square), φ
