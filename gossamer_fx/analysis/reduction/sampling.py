"""Sampling of cells: few cells of a film, with weights ≥ 0, that stand for all of them.

Problem.  A reduced film has few unknowns, but its strains are integrated over all cells: a step
costs as much per cell as one of the whole film.

Idea (energy-conserving sampling and weighting: Farhat, Avery, Chapman & Cortial, Int. J. Numer.
Meth. Eng. 98 (2014) 625, doi:10.1002/nme.4668).  Integrate over few cells e with weights ξ_e > 0.
The sampled film stores the energy Σ_e ξ_e ∫_e ψ: it is convex where ψ is, and conserved as that of
the whole film is.  The weights are to give the forces f and the stiffness k of some snapshots:

    Σ_e ξ_e f_e = Σ_e f_e,      Σ_e ξ_e k_e = Σ_e k_e                                       (1)

Forces alone are not enough.  A film is ten thousand times stiffer in its plane than across it;
where snapshots hardly differ, cells that give their forces leave whole motions without stiffness.
The stiffness is therefore fitted in random motions z that all have the same energy:

    z = L⁻ᵀ ζ,      LLᵀ = Σ_e k_e,      ζ random                                           (2)

Algorithm.

1. For each example of the basis, evaluate stiffness k_e and forces f_e of all cells
   (`CellEnergies`).
2. Draw motions (2); each gives the two equations Σ_e ξ_e z·k_e z = Σ_e z·k_e z and
   Σ_e ξ_e z·f_e = Σ_e z·f_e.  One more equation keeps the area.
3. Find non-negative weights by the active set method of Lawson and Hanson, ended when enough cells
   are taken (`fewest_weights`).
4. Measure what the sampled stiffness misses (`Sample.error`).

Each rank samples its own cells; equations hold for its own sums, so the weights are local too.

Cost: `EQUATIONS_PER_CELL` rows for each cell that may be taken, and a least-squares problem for
each cell that is taken.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.analysis.reduction.basis import Basis
from gossamer_fx.analysis.reduction.points import (
    mode_gradients,
    own_cells,
    points_and_areas,
    project,
    strain_operator,
    stress_derivatives,
)
from gossamer_fx.core.forms.backend import evaluate
from gossamer_fx.core.forms.compilation import compile_expression
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.mechanics.bodies.membrane import Membrane

# Random motions for each cell that may be taken.  With as many equations as weights the fit would
# be exact for these motions and wrong for others.
EQUATIONS_PER_CELL = 4

# Motions that are evaluated at once: the gradients of 64 motions at all points fit into memory.
MOTIONS_AT_ONCE = 64

# Rigid motions have no stiffness; the next eigenvalue is the softest stiffness.
RIGID_MOTIONS = 6

# Eigenvalues of the stiffness below this share of the largest are round-off.
MIN_STIFFNESS_RATIO = 1e-12

# Gain of the next cell, as a share of the size of what is wanted, below which the fit is exact.
MIN_GAIN = 1e-12

# A weight below this share of the largest counts as zero.
MIN_WEIGHT_RATIO = 1e-12

# Singular values that least squares leave out, as a share of the largest: those of normal equations
# are squares.
LEAST_SQUARES_CUTOFF = 1e-13

# Smallest divisor in place of zero
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Sample:
    """Sampled cells of this rank, in rising order, and their weights ξ > 0.

    `error` is the root mean square, over all reduced motions and examples, of the stiffness that
    the sample misses as a share of the stiffness; the same on every rank.
    """

    cells: Indices
    weights: Array
    error: float


def every_cell(film: Membrane) -> Sample:
    """All cells of a film, with the weight one: the error is zero."""
    cells = own_cells(film)
    return Sample(cells, np.ones(len(cells)), 0.0)


def sample_cells(basis: Basis, most: int, seed: int = 0) -> Sample:
    """Sample at most `most` cells of each rank with positive weights, for the energy of a basis'
    examples; all cells if there are no more.  Collective.

    The examples give the equations for the weights of this rank's cells; every rank solves its own,
    and only the stiffness and the error are sums over ranks.  The seed of the random motions is the
    same on every rank.  An example whose stiffness plus its shift is not positive definite, e.g. of
    a buckled shape, raises `LinAlgError`.
    """
    film = basis.film
    comm = film.comm
    superfluous = max(len(own_cells(film)) - most, 0)
    if comm.allreduce(superfluous) == 0:
        return every_cell(film)
    cells = CellEnergies(basis)
    random = np.random.default_rng(seed)
    count = EQUATIONS_PER_CELL * most // len(basis.examples) + 1
    rows = []
    for c in basis.examples:
        rows += list(_equations(cells, basis, c, random, count))
    equations = np.vstack([*rows, cells.areas])
    # The area counts as much as all other equations together.
    others = float(np.linalg.norm(equations[:-1]))
    area = float(np.linalg.norm(equations[-1]))
    equations[-1] *= others / max(area, TINY)
    weights = fewest_weights(equations, equations.sum(axis=1), most)
    taken = np.flatnonzero(weights).astype(np.int32)
    return Sample(taken, weights[taken], _error(cells, basis, weights))


def _error(cells: CellEnergies, basis: Basis, weights: Array) -> float:
    """Error of the sampled stiffness: the root mean square of ‖L⁻¹ (K_sampled - K) L⁻ᵀ‖/√(3r) over
    the examples, with weights (cells,).

    K = LLᵀ is the stiffness of the r modes over all cells.  Collective, the same on every rank.
    """
    comm = basis.film.comm
    squares = []
    for c in basis.examples:
        cells.take(c)
        # K, sampled: stiffness (3r, 3r) [N/m] over all cells of all ranks.
        K = comm.allreduce(cells.stiffness(np.ones(len(weights))))
        sampled = comm.allreduce(cells.stiffness(weights))
        L = _factor(K)
        half = np.linalg.solve(L, sampled - K)
        missing = np.linalg.solve(L, half.T)
        error = float(np.linalg.norm(missing)) / len(K) ** 0.5
        squares.append(error**2)
    return float(np.sqrt(np.mean(squares)))


def _equations(
    cells: CellEnergies, basis: Basis, c: Array, random: np.random.Generator, count: int
) -> Iterator[Array]:
    """Yield energies and work (2k, cells) of `count` random motions, k at a time, about the shape
    of coefficients c (r, 3) [m].  Collective.

    Motions are z = L⁻ᵀ ζ, with the stiffness Σ k_e = LLᵀ and random ζ.  The rows z·k_e z and z·f_e,
    stiffness and forces of cell e, are those of the equations that the weights of cells have to
    fulfil; they are dimensionless by the scaling.
    """
    r = basis.size
    cells.take(c)
    K = basis.film.comm.allreduce(cells.stiffness(np.ones(cells.cell_count)))
    L = _factor(K)
    # Forces are scaled by those that the waves of the shape would need, so that work and energy
    # have the same size.
    wave = c.copy()
    wave[: basis.fixed_count] = 0
    wave_energy = float(wave.ravel() @ K @ wave.ravel())
    size = max(wave_energy, TINY) ** 0.5
    for first in range(0, count, MOTIONS_AT_ONCE):
        number = min(MOTIONS_AT_ONCE, count - first)
        ζ = random.standard_normal((3 * r, number))
        z = np.linalg.solve(L.T, ζ / (3 * r) ** 0.5)
        energies, work = cells.motions(z.T.reshape(-1, r, 3))
        yield np.vstack([energies, work / size])


def _factor(K: Array) -> Array:
    """Cholesky factor L (3r, 3r) of a stiffness K [N/m] plus a multiple of 1, so that rigid motions
    have a stiffness too: the smallest eigenvalue of K after those of the six rigid motions, and at
    least a small share of the largest one."""
    symmetric = (K + K.T) / 2
    eigenvalues = np.linalg.eigvalsh(symmetric)
    shift = max(eigenvalues[RIGID_MOTIONS], MIN_STIFFNESS_RATIO * eigenvalues[-1])
    return np.linalg.cholesky(symmetric + shift * np.eye(len(K)))


# ---- weights -------------------------------------------------------------------------------------


def fewest_weights(Y: Array, wanted: Array, most: int) -> Array:
    """Weights w (n,) ≥ 0, at most `most` of them positive, such that Y w is near `wanted`
    (equations,). Each rank solves for its own cells.

    The active set method of Lawson and Hanson (Solving Least Squares Problems, 1974, ch. 23,
    doi:10.1137/1.9781611971217), ended early; `scipy.optimize.nnls` cannot be.

    1. Take the column of Y along which the residual falls fastest.
    2. Solve the least squares problem of the columns that are taken.
    3. If weights are negative, go from the last weights towards the solution until the first of
       them vanishes, leave it out, and repeat step 2.
    4. Repeat from step 1 until enough columns are taken or none reduces the residual.
    """
    sizes = np.maximum(np.linalg.norm(Y, axis=0), TINY)
    taken: list[int] = []
    weights: Array = np.zeros(0)
    # Columns that step 3 has left out at once; they are not tried again before another is taken.
    refused: set[int] = set()
    missing = wanted
    while len(taken) < most:
        gain = (missing @ Y) / sizes
        gain[[*taken, *refused]] = -np.inf
        # A rank may have no cells.
        if len(gain) == 0:
            break
        best = int(gain.argmax())
        if gain[best] <= MIN_GAIN * np.linalg.norm(wanted):
            break
        taken, weights = _solve([*taken, best], np.append(weights, 0.0), Y, wanted)
        refused.add(best)
        if best in taken:
            refused.clear()
        missing = wanted - Y[:, taken] @ weights
    result = np.zeros(Y.shape[1])
    result[taken] = weights
    return result


def _solve(
    taken: Sequence[int], weights: Array, Y: Array, wanted: Array
) -> tuple[list[int], Array]:
    """Steps 2 and 3 of `fewest_weights` for the taken columns (k) of Y and their weights, zero for
    the new one: the columns that remain, and their weights; both may be empty."""
    taken = list(taken)
    while taken:
        part = Y[:, taken]
        # Normal equations are faster by the ratio of equations to columns; the weights need not be
        # exact.
        normal = part.T @ part
        solution = np.linalg.lstsq(normal, part.T @ wanted, rcond=LEAST_SQUARES_CUTOFF)[0]
        negative = solution <= 0
        if not negative.any():
            return taken, solution
        decrease = np.maximum(weights[negative] - solution[negative], TINY)
        share = (weights[negative] / decrease).min()
        weights = weights + share * (solution - weights)
        smallest = MIN_WEIGHT_RATIO * weights.max(initial=0.0)
        weights[negative & (weights <= smallest)] = 0.0
        # The new column, whose weight was zero, has to go if nothing else can: else the loop is
        # endless.
        if share == 0.0:
            weights[-1] = 0.0
        positive = weights > 0
        taken = [column for column, stays in zip(taken, positive, strict=True) if stays]
        weights = weights[positive]
    return taken, weights


# ---- cells ---------------------------------------------------------------------------------------


class CellEnergies:
    """Forces f_e and stiffness k_e of each own cell of a film, about given coefficients of its
    modes.

    Sizes below: q quadrature points of all own cells, r modes, k motions.
    """

    def __init__(self, basis: Basis) -> None:
        film = basis.film
        self._film = film
        self._modes = basis.values
        points, dA = points_and_areas(film)
        self.cell_count, self._points_per_cell = dA.shape
        self.areas = dA.sum(axis=1)
        self._dA = dA.ravel()
        self._G = mode_gradients(film, basis.values, points)
        self._x = fem.Function(film.space)
        strain = ufl.variable(film.measure(self._x))
        F = film.deformation(self._x)
        S = ufl.diff(film.density(strain), strain)
        D = ufl.diff(S, strain)
        # One expression for all that is needed at a point: F (2, 3) row by row, S (3) and
        # D (3, 3)
        components = [F[i, a] for a in range(2) for i in range(3)]
        components += [S[i] for i in range(3)]
        components += [D[i, j] for i in range(3) for j in range(3)]
        self._response = compile_expression(ufl.as_vector(components), points)

    def take(self, c: Array) -> None:
        """Evaluate the film in the shape of coefficients c (r, 3) [m]: at the points, the images
        `_F` (2, 3, q) of the frame vectors, and times the area the stress `_S` (3, q) [N m] and its
        derivatives `_D` (3, 3, q) [N m] by the strain."""
        self._x.x.array[:] = (self._modes @ c).ravel()
        values = evaluate(self._response, self._film.space.mesh, own_cells(self._film))
        by_component = values.reshape(-1, 18).T
        self._F = by_component[:6].reshape(2, 3, -1)
        # Stress and derivatives have the area in them from here on.
        self._S = by_component[6:9] * self._dA
        self._D = by_component[9:].reshape(3, 3, -1) * self._dA

    def stiffness(self, weights: Array) -> Array:
        """Σ ξ_e k_e (3r, 3r) [N/m] for weights ξ of this rank's cells, in the shape that `take` has
        set."""
        # Only points of cells that count
        on = np.repeat(weights > 0, self._points_per_cell)
        ξ = np.repeat(weights, self._points_per_cell)[on]
        # B (3, 6, q): derivative of the strains by the gradients F. D and S (times area) are in N
        # m; `_G` (q, 2, r) [1/m] are the gradients of the modes.
        B = strain_operator(self._F[:, :, on])
        D = self._D[:, :, on] * ξ
        S = self._S[:, on] * ξ
        return project(stress_derivatives(B, D, B, S), self._G[on])

    def motions(self, z: Array) -> tuple[Array, Array]:
        """Energies z·k_e z and work z·f_e, (k, cells) [J] each, of motions with coefficients z (k,
        r, 3) [m] about the shape that `take` has set, to second and first order."""
        # F1, F2 (3, q): images of the frame vectors; S11, S22, S12 (1, q) [N m]: stress times area;
        # H1, H2 (q, k, 3): gradients of the motions along the frame vectors.
        F1, F2 = self._F
        S11, S22, S12 = self._S[:, None]
        H1 = self._gradients(z, 0)
        H2 = self._gradients(z, 1)
        # Changes of the strains (3, k, q), to first order in the motion
        de = np.stack([_dot(F1, H1), _dot(F2, H2), _dot(F1, H2) + _dot(F2, H1)])
        material = (de * np.einsum("ijq,jkq->ikq", self._D, de)).sum(axis=0)
        energy = material + S11 * _product(H1, H1) + S22 * _product(H2, H2)
        energy = energy + 2 * S12 * _product(H1, H2)
        work = (np.stack([S11, S22, S12]) * de).sum(axis=0)
        return self._in_cells(energy), self._in_cells(work)

    def _gradients(self, z: Array, a: int) -> Array:
        """Gradients (q, k, 3) of motions z (k, r, 3) along frame vector a."""
        k = len(z)
        columns = z.transpose(1, 0, 2).reshape(-1, 3 * k)
        return (self._G[:, a] @ columns).reshape(-1, k, 3)

    def _in_cells(self, values: Array) -> Array:
        """Sums (k, cell_count) over the points of each cell of values (k, q)."""
        return values.reshape(len(values), self.cell_count, self._points_per_cell).sum(axis=2)


def _dot(F: Array, H: Array) -> Array:
    """Products (k, q) of F (3, q) and H (q, k, 3) at each point."""
    return np.einsum("iq,qki->kq", F, H)


def _product(A: Array, B: Array) -> Array:
    """Products (k, q) of A and B (q, k, 3) at each point."""
    return (A * B).sum(axis=2).T
