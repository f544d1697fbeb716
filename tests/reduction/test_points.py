"""The compiled kernel of reduced films compared with NumPy and dolfinx."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.analysis.reduction.points import (
    Points,
    mode_gradients,
    own_cells,
    points_and_areas,
)
from gossamer_fx.core.forms.backend import evaluate, interpolation_points
from gossamer_fx.core.forms.compilation import compile_expression
from gossamer_fx.core.forms.strain_path import with_derivative
from gossamer_fx.extend import InitialState
from gossamer_fx.mechanics.terms.discrete_gradient import PathAverage
from gossamer_fx.mechanics.terms.element_energies import quadrature_element
from gossamer_fx.meshes.sheet import sheet

LAW = gx.Miyazaki(E=2e8, nu=0.3, density=1400.0, thickness=1e-5)
# A film that is three times as thick on one half: areas and stresses scale with it.
HEAVY = {"thickness": lambda X: np.where(X[0] > 1.0, 3e-5, 1e-5)}


# (a, c, k): component k of a stress (S11, S22, S12) is S_ac.
STRESS_COMPONENTS = (
    (0, 0, 0),
    (1, 1, 1),
    (0, 1, 2),
    (1, 0, 2),
)


def strain_operator(F: np.ndarray) -> np.ndarray:
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


def stress_derivatives(
    B_mean: np.ndarray, D: np.ndarray, B: np.ndarray, S: np.ndarray
) -> np.ndarray:
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


def project(T: np.ndarray, G: np.ndarray) -> np.ndarray:
    """The stiffness K (3r, 3r) [N/m] of modes with gradients G (q, 2, r), Σ G_aᵀ T_ac G_c over the
    points; row 3 i + k is component k of the coefficient of mode i."""
    q, _, r = G.shape
    K: np.ndarray = np.zeros((r, 9 * r))
    for a in range(2):
        # Σ_c T_ac G_c at each point, then one product of full matrices over all points.
        T_a = np.ascontiguousarray(T[:, a].swapaxes(2, 3))
        TG = T_a.reshape(q, 9, 2) @ G
        K += G[:, a].T @ TG.reshape(q, 9 * r)
    # K has the order (mode, coordinate, coordinate, mode).
    by_mode = K.reshape(r, 3, 3, r).swapaxes(2, 3)
    return by_mode.reshape(3 * r, 3 * r)


def strains(F: np.ndarray) -> np.ndarray:
    """(E11, E22, 2 E12) of F (q, 2, 3)."""
    a = F[:, 0]
    b = F[:, 1]
    return np.stack([((a * a).sum(1) - 1) / 2, ((b * b).sum(1) - 1) / 2, (a * b).sum(1)], axis=1)


@pytest.mark.parametrize(("order", "properties"), [(1, None), (2, None), (1, HEAVY)])
def test_the_kernel_is_what_numpy_says(order, properties) -> None:
    film = gx.Membrane(
        sheet(MPI.COMM_SELF, 3, 3, 2.0, 2.0),
        LAW,
        order=order,
        properties=properties,
    )
    rng = np.random.default_rng(1)
    shapes = gx.reduction.Snapshots(film)
    X = film.space.tabulate_dof_coordinates()
    shapes.positions += [X + 0.05 * rng.standard_normal(X.shape) for _ in range(3)]
    reduced = gx.reduction.reduce(film, [shapes], modes=4)
    system = gx.Simulation(gx.Scene(reduced), gx.Midpoint(dt=0.1)).system
    energies = next(c for c in system.equations.compiled if type(c).__name__ == "ReducedEnergies")
    force = energies._forces[0][1]
    points: Points = force.points
    c0 = reduced.basis.examples[0]
    c1 = reduced.basis.examples[1]
    points.move(c0)
    points.set_true_strains()
    points.keep()
    points.law.begin_step()
    points.move(c1)
    points.set_true_strains()

    at, dA = points_and_areas(film)
    dA = dA.ravel()
    G = mode_gradients(film, reduced.basis.values, at)
    F0 = G @ c0
    F1 = G @ c1
    # Products of gradients with unit entries: round-off.
    assert np.allclose(points.start, strains(F0), atol=1e-13) and np.allclose(
        points.strain, strains(F1), atol=1e-13
    )

    Q = fem.functionspace(
        film.space.mesh, quadrature_element(film.space.mesh, film.dx.metadata(), (3,))
    )
    e0 = fem.Function(Q)
    e1 = fem.Function(Q)
    e0.x.array[:], e1.x.array[:] = strains(F0).ravel(), strains(F1).ravel()
    e_chosen = ufl.variable(e1)
    stress = PathAverage().stress(
        list(film.terms(InitialState([film], film.comm)))[1], e0, e_chosen
    )
    expression = compile_expression(with_derivative(stress, e_chosen), interpolation_points(Q))
    response = evaluate(expression, film.space.mesh, own_cells(film)).reshape(-1, 12)
    # Two implementations of the path average: numerics near corners differ in the last digits.
    assert np.allclose(points.response, response, rtol=1e-9, atol=1e-9 * abs(response).max())

    # the stress that is linear in the strain, about a strain that is not the true one
    # As in an iteration, whose chosen strain has not converged.
    points.strain[:] *= 0.9
    S = points.response[:, :3]
    D = points.response[:, 3:].reshape(-1, 3, 3)
    s = (S + np.einsum("qij,qj->qi", D, strains(F1) - points.strain)) * dA[:, None]
    mid = (F0 + F1) / 2
    N = np.stack(
        [s[:, :1] * mid[:, 0] + s[:, 2:] * mid[:, 1], s[:, 1:2] * mid[:, 1] + s[:, 2:] * mid[:, 0]],
        axis=1,
    )
    assert np.allclose(
        points.forces(0.5), np.einsum("qai,qax->ix", G, N), rtol=1e-11, atol=1e-11 * abs(N).max()
    )

    B0, B = (strain_operator(np.ascontiguousarray(F.transpose(1, 2, 0))) for F in (mid, F1))
    weighted = np.moveaxis(D, 0, 2) * dA, S.T * dA
    K = project(stress_derivatives(B0, weighted[0], B, 0.3 * weighted[1]), G)
    # Sums over all points in another order.
    assert np.allclose(points.stiffness(0.5, 0.3), K, rtol=1e-11, atol=1e-11 * abs(K).max())
