"""Cells of a film, and weights ≥ 0, that stand for all of them in the forces of a reduced model.

Energy-conserving sampling and weighting (Farhat, Avery, Chapman & Cortial, IJNME 98 (2014) 625, doi:10.1002/nme.4668):
non-negative least squares for the weights ξ with which few cells give the snapshots' reduced forces,
Σ_e ξ_e f_e = Σ_e f_e.  The sampled film stores the energy Σ_e ξ_e ∫_e ψ: convex where ψ is, and conserved as the
whole one is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import basix
import numpy as np
import ufl
from dolfinx import fem
from scipy.optimize import nnls

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.forms.backend import evaluate
from gossamer_fx.forms.compilation import compile_expression
from gossamer_fx.forms.strain_path import gradient
from gossamer_fx.model.terms import Array, Indices
from gossamer_fx.reduction.basis import Basis


@dataclass(frozen=True, eq=False)
class Sample:
    """This rank's sampled cells, their weights, and what they miss.

    error   of the snapshots' reduced forces, root mean square over their size (the largest of any rank)
    """

    cells: Indices
    weights: Array
    error: float


def every_cell(film: Membrane) -> Sample:
    """All cells, with weight one: no error."""
    cells = np.arange(film.space.mesh.topology.index_map(2).size_local, dtype=np.int32)
    return Sample(cells, np.ones(len(cells)), 0.0)


def sample_cells(basis: Basis, snapshots: Sequence[Array], most: int, seed: int = 0) -> Sample:
    """At most `most` cells of each rank.

    Args:
        snapshots: owned positions (n, 3) of the film's nodes; of many, about forty are taken.
    """
    comm = basis.film.comm
    chosen = [snapshots[i] for i in np.unique(np.linspace(0, len(snapshots) - 1, 40).astype(int))]
    forces = CellForces(basis)
    rng = np.random.default_rng(seed)
    # random combinations of the equations, four for each cell that may be taken, in place of all of them
    rows = 4 * most
    Y: Array = np.zeros((rows, forces.cells))
    for x in chosen:
        c, _ = basis.project(x)
        f = forces(c)  # (cells, 3r)
        scale = comm.allreduce(float(np.sum(f.sum(axis=0) ** 2) + np.sum(f**2))) ** 0.5
        Y += rng.standard_normal((rows, f.shape[1])) @ f.T / max(scale, 1e-300)
    areas = forces.areas
    Y = np.vstack([Y, float(np.linalg.norm(Y)) / max(float(np.linalg.norm(areas)), 1e-300) * areas])
    wanted = Y.sum(axis=1)
    weights = _sparse(Y, wanted, most)
    cells = np.flatnonzero(weights).astype(np.int32)
    size = float(np.linalg.norm(wanted))
    error = float(np.linalg.norm(Y @ weights - wanted)) / size if size else 0.0
    return Sample(cells, weights[cells], max(comm.allgather(error)))


def _sparse(Y: Array, wanted: Array, most: int) -> Array:
    """Weights ≥ 0 with at most `most` of them positive."""
    if Y.shape[1] <= most:
        return np.ones(Y.shape[1])
    weights: Array = nnls(Y, wanted, maxiter=20 * Y.shape[1])[0]
    kept = np.argsort(weights)[::-1][:most]
    kept = kept[weights[kept] > 0]
    result = np.zeros(Y.shape[1])
    result[kept] = nnls(Y[:, kept], wanted, maxiter=20 * len(kept))[0]
    return result


class CellForces:
    """Reduced forces ∂/∂c_i ∫_e ψ of each owned cell e, for given coefficients."""

    def __init__(self, basis: Basis) -> None:
        film = self._film = basis.film
        self._Φ = basis.values
        mesh = film.space.mesh
        self.cells = mesh.topology.index_map(2).size_local
        self._own = np.arange(self.cells, dtype=np.int32)
        degree = film.dx.metadata()["quadrature_degree"]
        rule = basix.make_quadrature(basix.CellType.triangle, degree)
        points, weights = (np.asarray(part, dtype=np.float64) for part in rule)
        self._x = fem.Function(film.space)
        J = compile_expression(ufl.JacobianDeterminant(mesh), points)
        self._dA = abs(evaluate(J, mesh, self._own).reshape(self.cells, -1)) * weights
        self.areas = self._dA.sum(axis=1)
        F = film.deformation(self._x)
        S = gradient(film.density, film.measure(self._x))
        numbers = [*(F[i, a] for a in range(2) for i in range(3)), *(S[i] for i in range(3))]
        self._state = compile_expression(ufl.as_vector(numbers), points)
        self._G = self._gradients(compile_expression(F, points))

    def _gradients(self, deformation: fem.Expression) -> Array:
        """∂φ_i/∂X_a (cells, points, 2, r)."""
        r, q = self._Φ.shape[1], self._dA.shape[1]
        G = np.empty((self.cells, q, 2, r))
        padded = np.zeros((len(self._Φ), 3 * -(-r // 3)))
        padded[:, :r] = self._Φ
        for first in range(0, r, 3):
            self._x.x.array[:] = padded[:, first : first + 3].ravel()
            F = evaluate(deformation, self._film.space.mesh, self._own).reshape(self.cells, q, 3, 2)
            here = min(3, r - first)
            G[..., first : first + here] = F[:, :, :here].swapaxes(2, 3)
        return G

    def __call__(self, c: Array) -> Array:
        """Forces (cells, 3r) of coefficients (r, 3)."""
        self._x.x.array[:] = (self._Φ @ c).ravel()
        numbers = evaluate(self._state, self._film.space.mesh, self._own).reshape(self.cells, -1, 9)
        F, S = numbers[:, :, :6].reshape(self.cells, -1, 2, 3), numbers[:, :, 6:]
        N1 = S[..., :1] * F[:, :, 0] + S[..., 2:] * F[:, :, 1]
        N2 = S[..., 1:2] * F[:, :, 1] + S[..., 2:] * F[:, :, 0]
        N = np.stack([N1, N2], axis=2) * self._dA[:, :, None, None]
        return np.einsum("eqar,eqai->eri", self._G, N, optimize=True).reshape(self.cells, -1)
