"""Solutions with the transposed tangent of an equilibrium, also of one whose tangent is singular.

Problem.  Where rigid motions or slack film are free, the tangent A = K + Σ κ g⊗g has a null space,
and its factors give a solution of any size without a word.

Idea.  Aᵀ λ = b has solutions if b is orthogonal to the null space N of A, b·N = 0: then the result
whose derivative b is does not depend on the free motions, and λ is known up to null vectors of Aᵀ.
With a small multiple of the mass M, which a null vector cannot be without,

    (A + σ M)ᵀ Δλ = b - Aᵀ λ,    λ += Δλ                                                      (1)

converges in the complement of N by the factor σ/(ω² + σ) for a mode of the frequency ω, and leaves
of the residual the part of b in N: so both cases are told apart by the residual, whatever moves
freely.  The same iteration with the mass alone, z = σ (A + σ M)⁻ᵀ M z from a random vector, leaves
a null vector of Aᵀ: a parameter θ changes no equilibrium only if z·∂r/∂θ = 0.

The gas of closed films, which may hold what K leaves free, is treated in the same way: the formula
of Sherman, Morrison and Woodbury loses the digits by which K is nearly singular, and (1) brings
them back.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.analysis.sensitivity.backward import TransposedSolver
from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.system.system import System

# σ M over K, as norms.  Frequencies whose squares are more than some ten times this part of the
# largest one, 3e-6 of it, are told from zero.
SHIFT_RATIO = 1e-12

# Corrections (1) at most, and the factor by which each must reduce the residual.
MAX_CORRECTIONS = 30
LEAST_REDUCTION = 0.5

# Residual of (1) over the right side, and over the round-off of the product with A, up to which
# the equation counts as solved.
SOLVED = 1e-9
ROUND_OFF_MARGIN = 100.0
EPSILON = float(np.finfo(float).eps)

# Iterations for a null vector, each of which must leave more than this share of it.
NULL_ITERATIONS = 5
NULL_SHARE = 0.5

DIFFERENT_PATTERN = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN


class StaticSolver:
    """Solves (K + Σ κ g⊗g)ᵀ x = b at the equilibria of one scene."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._comm = system.comm
        # Factors of K, and of K + σ M; they are told apart because the second matrix is our own.
        self._of_regular: TransposedSolver | None = None
        self._of_shifted: TransposedSolver | None = None
        self._M: PETSc.Mat | None = None
        self._residual = system.unknowns.numbering.vector()
        self._correction = system.unknowns.numbering.vector()

    def factorise(self, is_regular: bool, gas: Sequence[tuple[Array, float]]) -> None:
        """Take the tangent of the system, which has no inertia and is in equilibrium.

        Args:
            is_regular: whether the tangent is known to be regular.
            gas: this rank's parts of the gradients g (n,) [m²] of volumes, zero where coordinates
                are fixed, and stiffnesses κ [Pa/m³].

        Raises:
            InputError: the factorisation fails.

        Collective.
        """
        system = self._system
        self._K = system.matrices.tangent()
        self._gas = gas
        self._rows = self._K.norm(PETSc.NormType.INFINITY)
        self._shift = 0.0
        if is_regular and not gas:
            if self._of_regular is None:
                self._of_regular = TransposedSolver(self._K)
            self._solver = self._of_regular
            self._solver.factorise(self._K)
            return
        if self._M is None:
            self._M = system.unknowns.M.copy()
            system.unknowns.supports.clear(self._M, 0.0)
        self._shift = SHIFT_RATIO * self._K.norm() / (self._M.norm() or 1.0)
        shifted = self._K.copy()
        shifted.axpy(self._shift, self._M, DIFFERENT_PATTERN)
        if self._of_shifted is None:
            self._of_shifted = TransposedSolver(shifted)
        self._solver = self._of_shifted
        self._solver.factorise(shifted)
        self._solver.add_to_inverse(gas)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Set x to a solution; returns whether there is one.  Collective."""
        self._solver.solve(b, x)
        if not self._shift:
            return True
        before = self._residual_of(b, x)
        for _ in range(MAX_CORRECTIONS):
            self._solver.solve(self._residual, self._correction)
            x.axpy(1.0, self._correction)
            after = self._residual_of(b, x)
            if not after < LEAST_REDUCTION * before:
                break
            before = after
        round_off = ROUND_OFF_MARGIN * EPSILON * self._rows * float(x.norm())
        # Written so that NaN counts as not solved.
        return self._residual_of(b, x) <= SOLVED * float(b.norm()) + round_off

    def _residual_of(self, b: PETSc.Vec, x: PETSc.Vec) -> float:
        """Norm of b - (K + Σ κ g⊗g)ᵀ x, which is in `_residual`.  Collective."""
        self._K.multTranspose(x, self._residual)
        for gradient, stiffness in self._gas:
            volume = self._comm.allreduce(float(gradient @ x.array_r))
            self._residual.array[:] += stiffness * volume * gradient
        self._residual.aypx(-1.0, b)
        return float(self._residual.norm())

    def null_vector(self) -> PETSc.Vec | None:
        """A vector of Aᵀ z = 0, of which every part of the null space has a random share and the
        largest entry is one; None if there is none.  Collective."""
        if not self._shift:
            return None
        assert self._M is not None
        z, product = self._K.createVecs()
        z.array[:] = np.random.default_rng(self._comm.rank).standard_normal(z.getLocalSize())
        size = 0.0
        for _ in range(NULL_ITERATIONS):
            self._M.mult(z, product)
            product.scale(self._shift)
            before = float(z.norm())
            self._solver.solve(product, z)
            size = float(z.norm()) / before
        largest = self._comm.allreduce(float(np.abs(z.array_r).max(initial=0.0)), op=MPI.MAX)
        if not size > NULL_SHARE:
            return None
        z.scale(1 / largest)
        return z
