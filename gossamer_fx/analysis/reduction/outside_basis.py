"""An error estimate of reduced films: the energy that the whole film would release outside of the
basis.

In the shape that the modes give, the whole film has the nodal forces f.  Accelerations of the
modes, Φ a, balance a part of them.  The remainder would move the nodes of the whole film, and
release about

    ε = min over a of Σ_n ½ (f + M Φ a)_n · k_n⁻¹ (f + M Φ a)_n                            (1)

with the stiffness k_n of each node for itself, one value along the film's mean plane and one across
it.  With weights w_n = 1/k_n and P = MΦ, the minimum is

    ε = ½ (f·w f - y·(PᵀwP)⁻¹ y),      y = Pᵀw f                                           (2)

for each of the two directions.

Steps: 1. once, evaluate k_n in the examples of the basis, and the inverse of (2); 2. at each call,
assemble f on the whole film and evaluate (2).

Cost: as much as a residual of the whole film.

Limits: nodes with ports are left out, as their forces come from other bodies; loads on faces count
as balanced by the modes.
"""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem, la

from gossamer_fx.analysis.reduction.basis import scalar_mass_times
from gossamer_fx.analysis.reduction.bending import bending_energy
from gossamer_fx.analysis.reduction.reduced_membrane import ReducedMembrane
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.view import StateView

# Least stiffness of a node as a share of the mean: a node of slack film has none, and would release
# any energy.
MIN_STIFFNESS_RATIO = 1e-3

# Least stiffness across as a share of the mean stiffness in the plane: a film without tension has
# none across at any node.
MIN_ACROSS_RATIO = 1e-9

# Smallest divisor in place of zero
TINY = 1e-300


@check_arguments
class OutsideBasis:
    """Probe of the error of a reduced film: energy outside of its basis over the stored energy.

    Below 0.01 the modes represent the motion; above 0.1 they do not, and the whole film should be
    simulated.  A call costs as much as a residual of the whole film: call it every hundred steps.
    The module describes the estimate.

    Args:
        body: a reduced film, made by `reduce`, in the scene of the run.

    Raises:
        InputError: the body is not a reduced film.

    Example:
        >>> shapes = gx.reduction.Snapshots(film)
        >>> scene = gx.Scene(film, gx.Fixed(film, "left"), gx.Gravity(film))
        >>> gx.Simulation(scene, gx.Midpoint(dt=1e-3), outputs=[shapes]).run(until=5e-3)
        >>> reduced = gx.reduction.reduce(film, [shapes], modes=2)
        >>> outside = gx.reduction.OutsideBasis(reduced)
    """

    def __init__(self, body: ReducedMembrane) -> None:
        self.body = body
        self._estimate: _Estimate | None = None

    def __call__(self, run: StateView) -> float:
        """Energy outside of the basis over the stored energy, in the present state.  Collective."""
        film = self.body
        # Compiled at the first call: ports are known by then.
        if self._estimate is None:
            self._estimate = _Estimate(film)
        # Rank 0 has the coefficients (r, 3), the others none.
        own = run.system.unknowns.state[film].coordinates().reshape(-1, 3)
        return self._estimate(film.comm.bcast(own.copy()))


class _Estimate:
    """The energy ε of (1) for given coefficients, over the stored energy.

    It has the mass matrix times the modes, P = MΦ (n, r) [kg]; the compliances w (n,) [m/N] of this
    rank's nodes across the film and in it; and for each of them (PᵀwP)⁻¹ (r, r).
    """

    def __init__(self, film: ReducedMembrane) -> None:
        full = film.full
        index_map = full.space.dofmap.index_map
        self._comm = film.comm
        self._modes = film.basis.values
        self._n = index_map.size_local
        self._x = fem.Function(full.space)
        energy = full.density(full.measure(self._x)) * full.dx + bending_energy(full, self._x)
        force = ufl.derivative(energy, self._x, ufl.TestFunction(full.space))
        self._energy = compile_form(energy)
        self._force = compile_form(force)
        self._b = la.vector(index_map, 3)
        self._free = self._nodes_without_ports(film)
        stiffness = compile_form(ufl.derivative(force, self._x))
        self._weights = self._compliances(stiffness, film.basis.examples)
        self._P = scalar_mass_times(full, self._modes[: self._n])
        self._inverses = []
        for w in self._weights:
            normal = self._sum(self._P.T @ (w[:, None] * self._P))
            # Modes that move nodes with ports only make the matrix singular.
            self._inverses.append(np.linalg.pinv(normal))

    def _nodes_without_ports(self, film: ReducedMembrane) -> Array:
        """1 at owned nodes (n,) of the whole film without ports, else 0."""
        start, end = film.full.space.dofmap.index_map.local_range
        free = np.ones(self._n)
        for node in film.port_nodes:
            if start <= node < end:
                free[node - start] = 0.0
        return free

    def __call__(self, c: Array) -> float:
        """Energy that the full film would release outside of the basis, over its stored energy, in
        the shape of coefficients c (r, 3) [m].  Collective.

        Across the film and in it, the energy is ½ (f·w f - y·(PᵀwP)⁻¹ y) with y = Pᵀ w f and the
        nodal forces f [N].  A film without stored energy gives a huge ratio, not an error.
        """
        f = self._forces(c)
        normal = _normal(c)
        across = (f @ normal)[:, None]
        in_plane = f - across * normal
        released = 0.0
        directions = zip(self._weights, self._inverses, (across, in_plane), strict=True)
        for w, inverse, part in directions:
            # (2); one message for both sums
            own = self._P.T @ (w[:, None] * part)
            own_square = np.sum(w[:, None] * part**2)
            sums = self._sum(np.concatenate([own.ravel(), [own_square]]))
            y = sums[:-1].reshape(own.shape)
            energy = float(sums[-1] - np.sum(y * (inverse @ y))) / 2
            # Round-off may make it negative.
            released += max(energy, 0.0)
        stored = float(self._sum(np.array(fem.assemble_scalar(self._energy))))
        return released / max(stored, TINY)

    def _forces(self, c: Array) -> Array:
        """Forces (n, 3) [N] of the whole film at owned nodes in the shape of coefficients c (r, 3)
        [m].  Collective."""
        self._x.x.array[:] = (self._modes @ c).ravel()
        self._b.array[:] = 0
        fem.assemble_vector(self._b.array, self._force)
        self._b.scatter_reverse(la.InsertMode.add)
        forces: Array = self._b.array[: 3 * self._n].reshape(-1, 3)
        return forces.copy()

    def _compliances(self, stiffness: fem.Form, examples: Array) -> tuple[Array, Array]:
        """Compliances 1/k_n (n,) [m/N] of this rank's owned nodes, across the film and in it; zero
        at nodes with ports, which other terms of the scene move or load.  Collective.

        k_n is the largest stiffness of the node in all examples, as a film that starts without
        tension has none across; it is at least `MIN_STIFFNESS_RATIO` of the mean over the nodes,
        and across also `MIN_ACROSS_RATIO` of the mean in the film.
        """
        across = np.zeros(self._n)
        in_plane = np.zeros(self._n)
        for c in examples:
            normal = _normal(c)
            blocks = self._stiffness_of_nodes(stiffness, c)
            k_across = np.einsum("i,nij,j->n", normal, blocks, normal)
            # Mean of the two directions in the plane
            k_in_plane = (np.trace(blocks, axis1=1, axis2=2) - k_across) / 2
            across = np.maximum(across, k_across)
            in_plane = np.maximum(in_plane, k_in_plane)
        mean_across = self._mean(across)
        mean_in_plane = self._mean(in_plane)
        least_across = max(
            MIN_STIFFNESS_RATIO * mean_across,
            MIN_ACROSS_RATIO * mean_in_plane,
        )
        least_in_plane = MIN_STIFFNESS_RATIO * mean_in_plane
        return (
            self._free / np.maximum(across, least_across),
            self._free / np.maximum(in_plane, least_in_plane),
        )

    def _mean(self, values: Array) -> float:
        """Mean of values (n,) at owned nodes over the nodes of all ranks.  Collective."""
        nodes = self._comm.allreduce(self._n)
        return float(self._sum(np.array(values.sum()))) / nodes

    def _stiffness_of_nodes(self, stiffness: fem.Form, c: Array) -> Array:
        """Stiffness (n, 3, 3) [N/m] of each owned node for itself in the shape of coefficients c
        (r, 3) [m]: diagonal blocks of the matrix.  Collective."""
        self._x.x.array[:] = (self._modes @ c).ravel()
        K = fem.assemble_matrix(stiffness)
        K.scatter_reverse()
        entries_per_row = np.diff(K.indptr)
        rows = np.repeat(np.arange(len(entries_per_row)), entries_per_row)
        diagonal = (rows == K.indices) & (rows < self._n)
        blocks = np.zeros((self._n, 3, 3))
        blocks[rows[diagonal]] = K.data.reshape(-1, 3, 3)[diagonal]
        return blocks

    def _sum(self, values: Array) -> Array:
        """Sum over all ranks."""
        return self._comm.allreduce(values)


def _normal(c: Array) -> Array:
    """Unit normal (3,) of the film's mean plane, from the coefficients c (r, 3) of its modes, of
    which 1 and 2 are those of X and Y."""
    normal = np.cross(c[1], c[2])
    return normal / max(float(np.linalg.norm(normal)), TINY)
