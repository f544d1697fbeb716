"""Cells of a film, and weights ≥ 0, that stand for all of them in a reduced model.

Few cells e with weights ξ_e > 0 are to give the forces and the stiffness of some snapshots, Σ_e ξ_e f_e = Σ_e f_e and
Σ_e ξ_e k_e = Σ_e k_e, found by non-negative least squares that stop when enough cells are taken (energy-conserving
sampling and weighting: Farhat, Avery, Chapman & Cortial, IJNME 98 (2014) 625, doi:10.1002/nme.4668).  The sampled film
stores the energy Σ_e ξ_e ∫_e ψ: convex where ψ is, and conserved as the whole one is.

Forces alone do not do: a film is ten thousand times stiffer in its plane than across it, and where its snapshots hardly
differ, cells that give their forces leave whole motions without stiffness.  So the energies z·k_e z of random motions z
are fitted beside the work z·f_e, and the motions are such that all of them have the same energy: z = L⁻ᵀ ζ with random
numbers ζ and LLᵀ = Σ_e k_e.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.forms.backend import evaluate
from gossamer_fx.forms.compilation import compile_expression
from gossamer_fx.model.body import Array, Indices
from gossamer_fx.reduction.basis import Basis
from gossamer_fx.reduction.mode_gradients import (
    mode_gradients,
    own_cells,
    points_and_areas,
    project,
    strain_operator,
    stress_derivatives,
)

EQUATIONS = 4  # random motions for each cell that may be taken
CHUNK = 64  # motions that are evaluated at once
RIGID = 6  # motions that no stiffness need resist


@dataclass(frozen=True, eq=False)
class Sample:
    """This rank's sampled cells, their weights, and what they miss.

    error   of the stiffness of all reduced motions about the snapshots, root mean square over its size
    """

    cells: Indices
    weights: Array
    error: float


def every_cell(film: Membrane) -> Sample:
    """All cells, with weight one: no error."""
    cells = own_cells(film)
    return Sample(cells, np.ones(len(cells)), 0.0)


def sample_cells(basis: Basis, most: int, seed: int = 0) -> Sample:
    """At most `most` cells of each rank, for the forces and the stiffness of the basis' examples."""
    film, comm = basis.film, basis.film.comm
    if comm.allreduce(max(len(own_cells(film)) - most, 0)) == 0:
        return every_cell(film)
    cells = CellEnergies(basis)
    rng = np.random.default_rng(seed)
    count = EQUATIONS * most // len(basis.examples) + 1
    rows = [row for c in basis.examples for row in _equations(cells, basis, c, rng, count)]
    Y = np.vstack([*rows, cells.areas])
    Y[-1] *= float(np.linalg.norm(Y[:-1])) / max(float(np.linalg.norm(Y[-1])), 1e-300)
    weights = fewest_weights(Y, Y.sum(axis=1), most)
    taken = np.flatnonzero(weights).astype(np.int32)
    errors = []
    for c in basis.examples:
        cells.take(c)
        K, kept = (comm.allreduce(cells.stiffness(w)) for w in (np.ones(len(weights)), weights))
        L = _factor(K)
        missing = np.linalg.solve(L, np.linalg.solve(L, kept - K).T)
        errors.append(float(np.linalg.norm(missing)) / len(K) ** 0.5)
    return Sample(taken, weights[taken], float(np.sqrt(np.mean(np.square(errors)))))


def _equations(
    cells: CellEnergies, basis: Basis, c: Array, rng: np.random.Generator, count: int
) -> Iterator[Array]:
    """Energies and work (2k, cells) of random motions about a snapshot with coefficients c, in portions."""
    comm, r = basis.film.comm, basis.size
    cells.take(c)
    K = comm.allreduce(cells.stiffness(np.ones(cells.count)))
    L = _factor(K)
    wave = c.copy()
    wave[: basis.fixed] = 0
    size = max(float(wave.ravel() @ K @ wave.ravel()), 1e-300) ** 0.5
    for first in range(0, count, CHUNK):
        ζ = rng.standard_normal((3 * r, min(CHUNK, count - first)))
        z = np.linalg.solve(L.T, ζ / (3 * r) ** 0.5)
        energies, work = cells.motions(z.T.reshape(-1, r, 3))
        yield np.vstack([energies, work / size])


def _factor(K: Array) -> Array:
    """L with LLᵀ = K and a little of the softest stiffness, which rigid motions lack."""
    λ = np.linalg.eigvalsh((K + K.T) / 2)
    return np.linalg.cholesky((K + K.T) / 2 + max(λ[RIGID], 1e-12 * λ[-1]) * np.eye(len(K)))


def fewest_weights(Y: Array, wanted: Array, most: int) -> Array:
    """Weights w ≥ 0, at most `most` of them positive, with Y w near `wanted`.

    Lawson & Hanson's active set (Solving Least Squares Problems, 1974, ch. 23), ended early.
    """
    size = np.maximum(np.linalg.norm(Y, axis=0), 1e-300)
    taken: list[int] = []
    w: Array = np.zeros(0)
    refused: set[int] = set()
    missing = wanted
    while len(taken) < most:
        gain = (missing @ Y) / size
        gain[[*taken, *refused]] = -np.inf
        best = int(gain.argmax()) if len(gain) else -1
        if best < 0 or gain[best] <= 1e-12 * np.linalg.norm(wanted):
            break
        taken, w = [*taken, best], np.append(w, 0.0)
        while taken:
            part = Y[:, taken]
            new = np.linalg.lstsq(part.T @ part, part.T @ wanted, rcond=1e-13)[0]
            falls = new <= 0
            if not falls.any():
                w = new
                break
            # only as far as the first weight that vanishes, which is left out
            share = (w[falls] / np.maximum(w[falls] - new[falls], 1e-300)).min()
            w = w + share * (new - w)
            w[falls] = np.where(w[falls] <= 1e-12 * w.max(initial=0.0), 0.0, w[falls])
            if share == 0.0:
                w[-1] = 0.0
            taken, w = [cell for cell, weight in zip(taken, w, strict=True) if weight > 0], w[w > 0]
        refused = refused | {best} if best not in taken else set()
        missing = wanted - Y[:, taken] @ w
    result = np.zeros(Y.shape[1])
    result[taken] = w
    return result


class CellEnergies:
    """What each owned cell adds to forces and stiffness of the modes about given coefficients."""

    def __init__(self, basis: Basis) -> None:
        film = self._film = basis.film
        self._Φ = basis.values
        points, dA = points_and_areas(film)
        self.count, self._points = dA.shape
        self.areas = dA.sum(axis=1)
        self._dA = dA.ravel()
        self._G = mode_gradients(film, basis.values, points)
        self._x = fem.Function(film.space)
        e, F = ufl.variable(film.measure(self._x)), film.deformation(self._x)
        S = ufl.diff(film.density(e), e)
        D = ufl.diff(S, e)
        numbers = [F[i, a] for a in range(2) for i in range(3)]
        numbers += [S[i] for i in range(3)] + [D[i, j] for i in range(3) for j in range(3)]
        self._state = compile_expression(ufl.as_vector(numbers), points)

    def take(self, c: Array) -> None:
        """Choose coefficients (r, 3)."""
        self._x.x.array[:] = (self._Φ @ c).ravel()
        values = (
            evaluate(self._state, self._film.space.mesh, own_cells(self._film)).reshape(-1, 18).T
        )
        self._F = values[:6].reshape(2, 3, -1)
        self._S, self._D = values[6:9] * self._dA, values[9:].reshape(3, 3, -1) * self._dA

    def stiffness(self, weights: Array) -> Array:
        """Σ ξ_e k_e (3r, 3r)."""
        on = np.repeat(weights > 0, self._points)
        ξ = np.repeat(weights, self._points)[on]
        B = strain_operator(self._F[:, :, on])
        return project(
            stress_derivatives(B, self._D[:, :, on] * ξ, B, self._S[:, on] * ξ), self._G[on]
        )

    def motions(self, z: Array) -> tuple[Array, Array]:
        """Energies z·k_e z and work z·f_e (k, cells) of motions z (k, r, 3)."""
        k = len(z)
        H = [
            (self._G[:, a] @ z.transpose(1, 0, 2).reshape(-1, 3 * k)).reshape(-1, k, 3)
            for a in range(2)
        ]
        F = self._F
        de = np.stack(
            [_dot(F[0], H[0]), _dot(F[1], H[1]), _dot(F[0], H[1]) + _dot(F[1], H[0])]
        )  # (3, k, q)
        S, D = self._S[:, None], self._D
        products = [(H[a] * H[b]).sum(axis=2).T for a, b in ((0, 0), (1, 1), (0, 1))]
        energy = (de * np.einsum("ijq,jkq->ikq", D, de)).sum(axis=0)
        energy = energy + S[0] * products[0] + S[1] * products[1] + 2 * S[2] * products[2]
        work = (S * de).sum(axis=0)
        return tuple(
            part.reshape(k, self.count, self._points).sum(axis=2) for part in (energy, work)
        )


def _dot(F: Array, H: Array) -> Array:
    """F (3, q) times each of H (q, k, 3): (k, q)."""
    return np.einsum("iq,qki->kq", F, H)
