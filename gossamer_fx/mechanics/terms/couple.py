"""A torque on vectors that are attached to bodies."""

from __future__ import annotations

import numpy as np

from gossamer_fx.core.algebra.rotations import cross_matrices
from gossamer_fx.core.model.body import Array


class Couple:
    """A torque T on attached vectors r_i (directors, or arms between points): forces f_i = F × r_i
    with

        (tr S 1 - S) F = T,    S = Σ r_i r_iᵀ

    Then Σ r_i × f_i = T whatever the lengths and angles of the vectors, so the angular momentum
    grows by exactly hT also at the middle of a step, where directors are shorter than 1.  One
    vector alone takes the torque across it, f = T × r/|r|².
    """

    depends_on_position_only = True

    def __init__(self) -> None:
        self.torque: Array = np.zeros(3)

    def begin(
        self,
        t: float,
        lag: float,
        X: Array,
        V: Array,
    ) -> None:
        """Nothing to prepare: the torque is constant."""

    def _spread(self, r: Array) -> tuple[Array, Array]:
        """Return the matrix (tr S 1 - S)⁻¹ (3, 3) [1/m²] and its product F (3,) [N/m] with the
        torque.

        S = Σ r rᵀ is the sum over the vectors; the forces F × r on them have this torque.

        Args:
            r: the k attached vectors (k, 3) [m], or directors without a unit.

        Raises:
            numpy.linalg.LinAlgError: a single vector has no length, or several are exactly
                parallel.
        """
        S = r.T @ r
        matrix = np.trace(S) * np.eye(3)
        # With one vector the matrix would be singular: S is left out, which gives T × r/|r|².
        if len(r) > 1:
            matrix = matrix - S
        inverse = np.linalg.inv(matrix)
        return inverse, inverse @ self.torque

    def forces_by_torque(self, X: Array) -> Array:
        """The matrix (3k, 3) of the forces on the vectors X (3k,), which are linear in the
        torque."""
        r = X.reshape(-1, 3)
        inverse, _ = self._spread(r)
        arms = np.hstack(tuple(cross_matrices(r)))
        forces: Array = arms.T @ inverse
        return forces

    def force(self, X: Array) -> Array:
        r = X.reshape(-1, 3)
        forces: Array = np.cross(self._spread(r)[1], r).ravel()
        return forces

    def tangent(self, X: Array) -> Array:
        r = X.reshape(-1, 3)
        inverse, F = self._spread(r)
        # Of f_i = F × r_i with F constant; the change of F follows.
        K: Array = np.kron(np.eye(len(r)), cross_matrices(F))
        for j, d in enumerate(r):
            # dS F for a change of vector j, and with it dF = -(tr S 1 - S)⁻¹ (tr dS F - dS F)
            change = 2 * np.outer(F, d)
            if len(r) > 1:
                change -= (d @ F) * np.eye(3) + np.outer(d, F)
            dF = -inverse @ change
            for i, other in enumerate(r):
                K[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] -= cross_matrices(other) @ dF
        return K
