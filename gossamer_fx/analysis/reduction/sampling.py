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
from gossamer_fx.analysis.reduction.bending import ModalBending
from gossamer_fx.analysis.reduction.points import own_cells, points_and_areas
from gossamer_fx.analysis.reduction.reduced_energies import projected
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.backend import evaluate
from gossamer_fx.core.forms.compilation import compile_expression, compile_form
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.mechanics.bodies.membrane import Membrane

# Random motions for each cell that may be taken.  With as many equations as weights the fit would
# be exact for these motions and wrong for others.
EQUATIONS_PER_CELL = 4

# Motions that are drawn at once.
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


def sample_cells(basis: Basis, most: int, bending: ModalBending | None, seed: int = 0) -> Sample:
    """Sample at most `most` cells of each rank with positive weights, for the energy of a basis'
    examples; all cells if there are no more.  `bending` of the modes, which is not sampled, makes
    motions stiffer.  Collective.

    The examples give the equations for the weights of this rank's cells; every rank solves its own,
    and only the stiffness and the error are sums over ranks.  The seed of the random motions is the
    same on every rank.  `InputError`: the stiffness of an example plus its shift is not positive
    definite, e.g. of a buckled shape.
    """
    film = basis.film
    comm = film.comm
    superfluous = max(len(own_cells(film)) - most, 0)
    if comm.allreduce(superfluous) == 0:
        return every_cell(film)
    cells = CellEnergies(basis, bending)
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
    squares = []
    for c in basis.examples:
        cells.take(c)
        # K, sampled: stiffness (3r, 3r) [N/m] over all cells of all ranks.
        K = cells.stiffness(np.ones(len(weights)))
        sampled = cells.stiffness(weights)
        L = _factor(K)
        half = np.linalg.solve(L, sampled - K)
        missing = np.linalg.solve(L, half.T)
        error = float(np.linalg.norm(missing)) / len(K) ** 0.5
        squares.append(error**2)
    return float(np.sqrt(np.mean(squares)))


def _equations(
    cells: CellEnergies, basis: Basis, c: Array, random: np.random.Generator, count: int
) -> Iterator[Array]:
    """Yield energies (cells,) and work (cells,) of `count` random motions, one after the other,
    about the shape of coefficients c (r, 3) [m].  Collective.

    Motions are z = L⁻ᵀ ζ, with the stiffness Σ k_e = LLᵀ and random ζ.  The rows z·k_e z and z·f_e,
    stiffness and forces of cell e, are those of the equations that the weights of cells have to
    fulfil; they are dimensionless by the scaling.
    """
    r = basis.size
    cells.take(c)
    K = cells.stiffness(np.ones(cells.cell_count))
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
        for motion in z.T:
            energies, work = cells.motion(motion.reshape(r, 3))
            yield energies
            yield work / size


def _factor(K: Array) -> Array:
    """Cholesky factor L (3r, 3r) of a stiffness K [N/m] plus a multiple of 1, so that rigid motions
    have a stiffness too: the smallest eigenvalue of K after those of the six rigid motions, and at
    least a small share of the largest one."""
    symmetric = (K + K.T) / 2
    eigenvalues = np.linalg.eigvalsh(symmetric)
    shift = max(eigenvalues[RIGID_MOTIONS], MIN_STIFFNESS_RATIO * eigenvalues[-1])
    check(
        eigenvalues[0] + shift > 0,
        "reduce: cells are sampled about recorded shapes, and one of these is compressed so that "
        "its stiffness is negative; leave cells out, or record less violent motions.",
    )
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
    modes; those of its strains, without bending."""

    def __init__(self, basis: Basis, bending: ModalBending | None) -> None:
        film = basis.film
        space = film.space
        self._film = film
        self._modes = basis.values
        points, self._dA = points_and_areas(film)
        self.cell_count = len(self._dA)
        self.areas = self._dA.sum(axis=1)
        self._x = fem.Function(space)
        # A motion z, and the weights ξ of the cells
        self._z = fem.Function(space)
        self._weights = fem.Function(fem.functionspace(space.mesh, ("Discontinuous Lagrange", 0)))
        first, second = self._variations(self._z, self._z)
        self._motion = compile_expression(ufl.as_vector([second, first]), points)
        _, bilinear = self._variations(ufl.TestFunction(space), ufl.TrialFunction(space))
        self._stiffness = compile_form(self._weights * bilinear * film.dx)
        self._matrix = fem.create_matrix(self._stiffness)
        self._bending: Array = np.zeros(2 * (3 * basis.size,))
        if bending is not None:
            self._bending = np.kron(bending.stiffness, np.eye(3))

    def _variations(self, w: Expr, z: Expr) -> tuple[Expr, Expr]:
        """Variations of the energy density [J/m²] at x: the first along w, the second along w and
        z."""
        measure = self._film.measure(self._x)
        strain = ufl.variable(measure)
        S = ufl.diff(self._film.density(strain), strain)
        D = ufl.diff(S, strain)
        along_w = ufl.derivative(measure, self._x, w)
        along_z = ufl.derivative(measure, self._x, z)
        geometric = ufl.dot(S, ufl.derivative(along_w, self._x, z))
        return ufl.dot(S, along_w), ufl.dot(ufl.dot(D, along_z), along_w) + geometric

    def take(self, c: Array) -> None:
        """Set the shape of coefficients c (r, 3) [m]."""
        self._x.x.array[:] = (self._modes @ c).ravel()

    def stiffness(self, weights: Array) -> Array:
        """Σ ξ_e k_e (3r, 3r) [N/m] over the cells of all ranks, of weights ξ on this one, and the
        stiffness of bending, in the shape that `take` has set.  Collective."""
        self._weights.x.array[: self.cell_count] = weights
        self._matrix.set_value(np.float64(0))
        fem.assemble_matrix(self._matrix, self._stiffness)  # type: ignore[arg-type]
        own = projected(self._matrix, self._modes).reshape(self._bending.shape)
        return self._bending + self._film.comm.allreduce(own)

    def motion(self, z: Array) -> tuple[Array, Array]:
        """Energies z·k_e z and work z·f_e, (cells,) [J] each, of a motion with coefficients z (r,
        3) [m] about the shape that `take` has set, to second and first order."""
        self._z.x.array[:] = (self._modes @ z).ravel()
        values = evaluate(self._motion, self._film.space.mesh, own_cells(self._film))
        by_cell = np.einsum("cpk,cp->kc", values.reshape(*self._dA.shape, 2), self._dA)
        return by_cell[0], by_cell[1]
