"""Gradients of modes at the quadrature points of a film's strains, and the stiffness of the modes.

With the gradients G_a = ∂φ/∂X_a (q, r) of r modes at q quadrature points, a = 1, 2 along the film's
frame, the images of the frame vectors are

    F_a = G_a c                                                                             (1)

A stress S (3,) with the derivatives D = ∂S/∂E gives the coefficients the stiffness

    K = Σ_ac G_aᵀ T_ac G_c,     T_ac = (Σ_bd D_abcd F_b ⊗ F_d + S_ac 1) dA                  (2)

T does not depend on the number of modes: it is computed once at each point, and (2) is a product of
full matrices.  Arrays of many points have the points as their last index where a loop over
components is outside, so that NumPy works on long rows.
"""

from __future__ import annotations

import math

import basix
import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.core.forms.backend import evaluate
from gossamer_fx.core.forms.compilation import compile_expression
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.mechanics.bodies.membrane import Membrane

# (a, c, k): component k of a stress (S11, S22, S12) is S_ac.
STRESS_COMPONENTS = (
    (0, 0, 0),
    (1, 1, 1),
    (0, 1, 2),
    (1, 0, 2),
)


def own_cells(film: Membrane) -> Indices:
    """Local numbers of the cells that this rank owns."""
    count = film.space.mesh.topology.index_map(2).size_local
    return np.arange(count, dtype=np.int32)


def points_and_areas(film: Membrane) -> tuple[Array, Array]:
    """Quadrature points (p, 2) of the reference triangle, and the reference areas dA (cells, p)
    [m²] of this rank's own cells that they stand for."""
    degree = film.dx.metadata()["quadrature_degree"]
    points, weights = basix.make_quadrature(basix.CellType.triangle, degree)
    points = np.asarray(points, dtype=np.float64)
    weights = np.asarray(weights, dtype=np.float64)
    mesh = film.space.mesh
    cells = own_cells(film)
    determinant = compile_expression(ufl.JacobianDeterminant(mesh), points)
    values = evaluate(determinant, mesh, cells)
    values = values.reshape(len(cells), len(points))
    # The determinant is negative in cells whose corners are numbered clockwise.
    return points, abs(values) * weights


def mode_gradients(film: Membrane, φ: Array, points: Array) -> Array:
    """Gradients ∂φ_i/∂X_a (q, 2, r) [1/m] of modes φ (nodes, r) in the film's frame, two unit
    vectors in the plane of each cell, at points (p, 2) of own cells; q = cells · p."""
    cells = own_cells(film)
    r = φ.shape[1]
    q = len(cells) * len(points)
    # The deformation gradient of a motion has the gradients of its components: three modes at once.
    motion = fem.Function(film.space)
    gradient = compile_expression(film.deformation(motion), points)
    # Filled up with zeros to a multiple of three.
    motions = math.ceil(r / 3)
    padded = np.zeros((len(φ), 3 * motions))
    padded[:, :r] = φ
    found = np.empty((q, 2, r))
    for first in range(0, r, 3):
        three_modes = padded[:, first : first + 3]
        motion.x.array[:] = three_modes.ravel()
        values = evaluate(gradient, film.space.mesh, cells)
        values = values.reshape(q, 3, 2)
        count = min(3, r - first)
        found[..., first : first + count] = values[:, :count].swapaxes(1, 2)
    return found


def strain_operator(F: Array) -> Array:
    """Derivative B (3, 6, q) of the strains (E11, E22, 2 E12) by the gradients ∂x_i/∂X_a, of index
    3 a + i, where the frame vectors have the images F (2, 3, q)."""
    B = np.zeros((3, 2, 3, F.shape[2]))
    # δE11 = F_1·δF_1 and δE22 = F_2·δF_2
    B[0, 0] = F[0]
    B[1, 1] = F[1]
    # 2 δE12 = F_2·δF_1 + F_1·δF_2
    B[2, 0] = F[1]
    B[2, 1] = F[0]
    return B.reshape(3, 6, -1)


def stress_derivatives(B_mean: Array, D: Array, B: Array, S: Array) -> Array:
    """Stiffness T (q, 2, 3, 2, 3) [N m] at q points, for stresses that act at the mean of two
    gradients.

        T_ac = (Σ_bd D_abcd F_mean_b ⊗ F_d + S_ac 1) dA

    It is the derivative of the forces S_ab F_mean_b dA by the gradients F_c of the iterate: a
    material part with D = ∂S/∂E (3, 3, q), and the geometric part of S (3, q), both times dA [N/m ·
    m²].  S is also times the weight of the iterate in F_mean.  B and B_mean (3, 6, q) are
    derivatives of the strains at F and at F_mean.
    """
    DB = np.einsum("klq,ljq->kjq", D, B)
    T = np.einsum("kiq,kjq->qij", B_mean, DB)
    T = T.reshape(-1, 2, 3, 2, 3)
    # The geometric stiffness S_ac 1 acts on each coordinate alone.
    for i in range(3):
        for a, c, k in STRESS_COMPONENTS:
            T[:, a, i, c, i] += S[k]
    return T


def project(T: Array, G: Array) -> Array:
    """The stiffness K (3r, 3r) [N/m] of modes with gradients G (q, 2, r), Σ G_aᵀ T_ac G_c over the
    points; row 3 i + k is component k of the coefficient of mode i."""
    q, _, r = G.shape
    K: Array = np.zeros((r, 9 * r))
    for a in range(2):
        # Σ_c T_ac G_c at each point, then one product of full matrices over all points.
        T_a = np.ascontiguousarray(T[:, a].swapaxes(2, 3))
        TG = T_a.reshape(q, 9, 2) @ G
        K += G[:, a].T @ TG.reshape(q, 9 * r)
    # K has the order (mode, coordinate, coordinate, mode).
    by_mode = K.reshape(r, 3, 3, r).swapaxes(2, 3)
    return by_mode.reshape(3 * r, 3 * r)
