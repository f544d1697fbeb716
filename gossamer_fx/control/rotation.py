"""Rotations of flexible bodies: polar decomposition of a position gradient, and Euler angles."""

from __future__ import annotations

import numpy as np

from gossamer_fx.model.body import Array
from gossamer_fx.model.ports import unit

# Eigenvalue of a moment matrix over the largest one below which the vectors lie in a plane.
FLATNESS = 1e-9


def position_gradient(vectors: Array, reference: Array) -> Array:
    """F (3, 3) such that F maps the reference vectors to the present ones, in least squares.

    Vectors that lie in a plane determine F in that plane only; F then maps the normal of the reference
    plane to the unit normal of the present one.

    Args:
        vectors: attached vectors now, (k, 3).
        reference: the same vectors in the reference, (k, 3), at least two of them not parallel.
    """
    moments = reference.T @ reference
    decomposition = np.linalg.eigh(moments)
    eigenvalues = decomposition.eigenvalues
    axes = decomposition.eigenvectors
    spans = eigenvalues > FLATNESS * eigenvalues[-1]
    if spans.all():
        F: Array = vectors.T @ reference @ np.linalg.inv(moments)
        return F
    in_plane = axes[:, spans]
    normal = axes[:, ~spans]
    images = vectors.T @ reference @ in_plane / eigenvalues[spans]
    # A right-handed basis, so that det F > 0.
    if np.linalg.det(np.hstack([in_plane, normal])) < 0:
        normal = -normal
    image_of_normal = unit(np.cross(images[:, 0], images[:, 1]))
    F = images @ in_plane.T + np.outer(image_of_normal, normal[:, 0])
    return F


def rotation(F: Array) -> Array:
    """R (3, 3) of the polar decomposition F = R U, U symmetric and positive definite, for det F > 0."""
    U, _, Vt = np.linalg.svd(F)
    R: Array = U @ Vt
    return R


def euler_angles(R: Array) -> Array:
    """(θ, β, γ) [rad] of R = R_w(γ) R_v(β) R_u(θ); θ and γ in (-π, π], β in [-π/2, π/2]."""
    θ = np.arctan2(R[2, 1], R[2, 2])
    # Round-off may exceed the range of the arc sine.
    β = np.arcsin(np.clip(-R[2, 0], -1.0, 1.0))
    γ = np.arctan2(R[1, 0], R[0, 0])
    return np.array([θ, β, γ])


def euler_axes(angles: Array) -> Array:
    """Axes about which the Euler angles (θ, β, γ) [rad] turn, as rows (3, 3).

    They are R_w R_v e_u, R_w e_v and e_w; the rows are dependent at β = ±π/2.
    """
    cos_β = np.cos(angles[1])
    sin_β = np.sin(angles[1])
    cos_γ = np.cos(angles[2])
    sin_γ = np.sin(angles[2])
    return np.array(
        [
            [cos_γ * cos_β, sin_γ * cos_β, -sin_β],
            [-sin_γ, cos_γ, 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
