"""Gradients of modes at the quadrature points of a film's strains, and the stiffness that follows from them.

With G_a (q, r) the gradients ∂φ_i/∂X_a at the q quadrature points, the images of the two frame vectors are F_a = G_a c,
and a stress S with the derivatives D adds Σ_ac G_aᵀ T_ac G_c to the stiffness of the coefficients, where

    T_ac = (Σ_bd D_abcd F_b ⊗ F_d + S_ac 1) dA.
"""

from __future__ import annotations

import basix
import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.forms.backend import evaluate
from gossamer_fx.forms.compilation import compile_expression
from gossamer_fx.model.body import Array, Indices


def own_cells(film: Membrane) -> Indices:
    """The cells that this rank owns."""
    return np.arange(film.space.mesh.topology.index_map(2).size_local, dtype=np.int32)


def points_and_areas(film: Membrane) -> tuple[Array, Array]:
    """Quadrature points (p, 2) of the reference triangle, and the reference area dA (cells, p) of each in own cells."""
    degree = film.dx.metadata()["quadrature_degree"]
    rule = basix.make_quadrature(basix.CellType.triangle, degree)
    points, weights = (np.asarray(part, dtype=np.float64) for part in rule)
    cells = own_cells(film)
    J = compile_expression(ufl.JacobianDeterminant(film.space.mesh), points)
    return points, abs(
        evaluate(J, film.space.mesh, cells).reshape(len(cells), len(points))
    ) * weights


def mode_gradients(film: Membrane, φ: Array, points: Array) -> Array:
    """∂φ_i/∂X_a (q, 2, r) in the film's frame, at the points of own cells; φ (n, r) at owned and ghost nodes."""
    cells, r = own_cells(film), φ.shape[1]
    x = fem.Function(film.space)
    F = compile_expression(film.deformation(x), points)
    q = len(cells) * len(points)
    found = np.empty((q, 2, r))
    padded = np.zeros((len(φ), 3 * -(-r // 3)))
    padded[:, :r] = φ
    for first in range(0, r, 3):  # three modes at once, as components of one motion
        x.x.array[:] = padded[:, first : first + 3].ravel()
        values = evaluate(F, film.space.mesh, cells).reshape(q, 3, 2)
        count = min(3, r - first)
        found[..., first : first + count] = values[:, :count].swapaxes(1, 2)
    return found


def strain_operator(F: Array) -> Array:
    """What the strains (E11, E22, 2 E12) gain by the gradient ∂/∂X_a of a motion along x: (3, 6, q) of F (2, 3, q)."""
    B = np.zeros((3, 2, 3, F.shape[2]))
    B[0, 0] = B[2, 1] = F[0]
    B[1, 1] = B[2, 0] = F[1]
    return B.reshape(3, 6, -1)


def stress_derivatives(B_mean: Array, D: Array, B: Array, S: Array) -> Array:
    """T (q, 2, 3, 2, 3) of strain operators (3, 6, q), D (3, 3, q) and S (3, q), of which both hold dA."""
    T = np.einsum("kiq,kjq->qij", B_mean, np.einsum("klq,ljq->kjq", D, B)).reshape(-1, 2, 3, 2, 3)
    for i in range(3):
        for a, c, k in ((0, 0, 0), (1, 1, 1), (0, 1, 2), (1, 0, 2)):
            T[:, a, i, c, i] += S[k]
    return T


def project(T: Array, G: Array) -> Array:
    """Σ_ac G_aᵀ T_ac G_c (3r, 3r)."""
    q, _, r = G.shape
    K: Array = np.zeros((r, 9 * r))
    for a in range(2):
        TG = np.ascontiguousarray(T[:, a].swapaxes(2, 3)).reshape(q, 9, 2) @ G
        K += G[:, a].T @ TG.reshape(q, 9 * r)
    return K.reshape(r, 3, 3, r).swapaxes(2, 3).reshape(3 * r, 3 * r)
