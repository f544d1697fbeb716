"""Frequencies of small vibrations about a state, by dense algebra on one rank, to compare with
formulas."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh, null_space

import gossamer_fx as gx
from gossamer_fx.solve.system.system import System


def dense(A: object) -> np.ndarray:
    """A matrix of a small system."""
    full = A.copy().convert("dense")  # held while its array is read
    return full.getDenseArray().copy()


def angular_frequencies(scene: gx.Scene, direction: int | None = None) -> np.ndarray:
    """ω [rad/s] of the vibrations about the initial state, ascending; of one component of the
    positions if wanted.

    K - ω²M on the coordinates that the supports leave free, projected on the null space of the
    constraints.
    """
    # At the end point the tangent is the stiffness of the state alone, without averages over a
    # step.
    system: System = scene.compile(gx.steppers.EndPoint())
    system.equations.set_inertia(0.0)
    system.equations.begin_step(1.0)
    K = dense(system.matrices.tangent())
    M = dense(system.unknowns.M)
    free = np.setdiff1d(np.arange(len(K)), system.unknowns.supports.held)
    coordinates = free
    Z = np.eye(len(K))
    if system.equations.constraints is not None:
        owned = system.equations.constraints.owned
        coordinates = free[free < owned.start]
        multipliers = free[free >= owned.start]
        # Vectors in the null space of the constraints' rows move without violating a joint.
        Z = null_space(K[np.ix_(multipliers, coordinates)])
        K = K[np.ix_(coordinates, coordinates)]
        M = M[np.ix_(coordinates, coordinates)]
        return roots(Z.T @ K @ Z, Z.T @ M @ Z)
    if direction is not None:
        coordinates = coordinates[coordinates % 3 == direction]
    return roots(K[np.ix_(coordinates, coordinates)], M[np.ix_(coordinates, coordinates)])


def roots(K: np.ndarray, M: np.ndarray) -> np.ndarray:
    """√ of the eigenvalues of the pencil; negative ones (round-off of rigid motions) count as
    zero."""
    return np.sqrt(np.maximum(eigh((K + K.T) / 2, (M + M.T) / 2, eigvals_only=True), 0.0))
