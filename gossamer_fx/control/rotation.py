"""Rotations of flexible bodies: polar decomposition of a position gradient, and Euler angles."""

from __future__ import annotations

import numpy as np

from gossamer_fx.model.body import Array
from gossamer_fx.model.ports import unit


def position_gradient(vectors: Array, reference: Array) -> Array:
    """F (3, 3) with F R_i ≈ r_i in least squares, for attached vectors r and R, their values in the reference, (k, 3).

    Vectors that lie in a plane determine F in that plane; the normal goes to the normal.
    """
    r, R = vectors, reference
    values, axes = np.linalg.eigh(R.T @ R)
    plane = values > 1e-9 * values[-1]
    if plane.all():
        F: Array = r.T @ R @ np.linalg.inv(R.T @ R)
        return F
    in_plane, normal = axes[:, plane], axes[:, ~plane]
    images = r.T @ R @ in_plane / values[plane]
    n = np.cross(images[:, 0], images[:, 1])
    if np.linalg.det(np.hstack([in_plane, normal])) < 0:
        normal = -normal
    F = images @ in_plane.T + np.outer(unit(n), normal[:, 0])
    return F


def rotation(F: Array) -> Array:
    """R of the polar decomposition F = R U, U symmetric and positive definite (det F > 0)."""
    U, _, Vt = np.linalg.svd(F)
    R: Array = U @ Vt
    return R


def euler_angles(R: Array) -> Array:
    """(θ, β, γ) [rad] of R = R_w(γ) R_v(β) R_u(θ); θ, γ in (-π, π], β in [-π/2, π/2]."""
    θ = np.arctan2(R[2, 1], R[2, 2])
    β = np.arcsin(np.clip(-R[2, 0], -1.0, 1.0))
    γ = np.arctan2(R[1, 0], R[0, 0])
    return np.array([θ, β, γ])


def euler_axes(angles: Array) -> Array:
    """Rows: the axes about which θ, β and γ turn, R_w R_v e_u, R_w e_v and e_w."""
    _, β, γ = angles
    cβ, sβ, cγ, sγ = np.cos(β), np.sin(β), np.cos(γ), np.sin(γ)
    return np.array([[cγ * cβ, sγ * cβ, -sβ], [-sγ, cγ, 0.0], [0.0, 0.0, 1.0]])
