"""Rotations of flexible bodies: polar decomposition of a position gradient, and Euler angles."""

from __future__ import annotations

import numpy as np

from gossamer_fx.core.model.body import Array, unit

# Eigenvalue of a moment matrix over the largest one below which the vectors lie in a plane.
FLATNESS = 1e-9


def position_gradient(vectors: Array, reference: Array) -> Array:
    """F (3, 3) such that F maps the k reference vectors (k, 3), not all parallel, to the present
    ones (k, 3) in the same unit, in least squares.

    Vectors that lie in a plane determine F in that plane only; F then maps the normal of the
    reference plane to the unit normal of the present one, and is not finite if the present vectors
    are parallel.
    """
    weights, in_plane, normal = _weights(reference)
    if normal is None:
        F: Array = vectors.T @ weights
        return F
    images = vectors.T @ weights
    image_of_normal = unit(np.cross(images[:, 0], images[:, 1]))
    F = images @ in_plane.T + np.outer(image_of_normal, normal)
    return F


def _weights(reference: Array) -> tuple[Array, Array, Array | None]:
    """Weights (k, b) by which k vectors give, in least squares, the images of b orthonormal axes of
    the reference (k, 3), in its inverse unit.

    Also the axes (3, b), all of space if the reference spans it, else of its plane, b = 2; and the
    normal (3,) of that plane, right-handed with the axes, or None.
    """
    moments = reference.T @ reference
    decomposition = np.linalg.eigh(moments)
    eigenvalues = decomposition.eigenvalues
    spans = eigenvalues > FLATNESS * eigenvalues[-1]
    if spans.all():
        return reference @ np.linalg.inv(moments), np.eye(3), None
    in_plane = decomposition.eigenvectors[:, spans]
    normal = decomposition.eigenvectors[:, ~spans][:, 0]
    # A right-handed basis, so that det F > 0.
    if np.linalg.det(np.column_stack([in_plane, normal])) < 0:
        normal = -normal
    return reference @ in_plane / eigenvalues[spans], in_plane, normal


def position_gradient_derivative(vectors: Array, reference: Array) -> Array:
    """Derivatives (3, 3, 3k) of `position_gradient` by the k present vectors, flattened, in their
    inverse unit."""
    weights, in_plane, normal = _weights(reference)
    if normal is None:
        return _derivative_of_product(weights)
    first = vectors.T @ weights[:, 0]
    second = vectors.T @ weights[:, 1]
    of_images = _derivative_of_product(weights)
    across = np.cross(first, second)
    length = np.linalg.norm(across)
    direction = across / length
    of_across = np.cross(of_images[:, 0], second, axisa=0, axisb=0, axisc=0)
    of_across = of_across + np.cross(first, of_images[:, 1], axisa=0, axisb=0, axisc=0)
    # A unit vector changes across itself.
    of_normal = (of_across - np.outer(direction, direction @ of_across)) / length
    in_plane_part = np.einsum("ibm,jb->ijm", of_images, in_plane)
    return in_plane_part + np.einsum("im,j->ijm", of_normal, normal)


def _derivative_of_product(weights: Array) -> Array:
    """Derivatives (3, b, 3k) of vectorsᵀ weights, weights (k, b), with respect to the vectors (k,
    3), flattened."""
    k, columns = weights.shape
    blocks = np.einsum("ic,kb->ibkc", np.eye(3), weights)
    return np.asarray(blocks.reshape(3, columns, 3 * k))


def rotation_derivative(F: Array, of_F: Array) -> Array:
    """Rotations δω (3, m) [rad] of the rotation R in the polar decomposition F = V R of a position
    gradient of positive determinant, for m changes δF (3, 3, m).

    δF Rᵀ = δV + V [δω]×, of which the skew part is (tr V 1 - V) δω.
    """
    R = rotation(F)
    V = F @ R.T
    turned = np.einsum("ijm,kj->ikm", of_F, R)
    skew = turned - turned.transpose(1, 0, 2)
    axial = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    return np.linalg.solve(np.trace(V) * np.eye(3) - V, axial)


def rotation(F: Array) -> Array:
    """R (3, 3) of the polar decomposition F = R U, U symmetric and positive definite, for det F >
    0."""
    U, _, Vt = np.linalg.svd(F)
    return U @ Vt


def euler_angles(R: Array) -> Array:
    """(θ, β, γ) [rad] of R = R_w(γ) R_v(β) R_u(θ); θ and γ in (-π, π], β in [-π/2, π/2]."""
    θ = np.arctan2(R[2, 1], R[2, 2])
    # Round-off may exceed the range of the arc sine.
    β = np.arcsin(np.clip(-R[2, 0], -1.0, 1.0))
    γ = np.arctan2(R[1, 0], R[0, 0])
    return np.array([θ, β, γ])


def euler_axes(angles: Array) -> Array:
    """Axes about which Euler angles (θ, β, γ) [rad] turn, as rows (3, 3): R_w R_v e_u, R_w e_v and
    e_w of the rotation R = R_w(γ) R_v(β) R_u(θ); they are dependent at β = ±π/2."""
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
