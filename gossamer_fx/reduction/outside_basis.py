"""How far a reduced film is from what its modes can hold: the energy that the whole film would release beside them."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem, la

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.forms.compilation import compile_form
from gossamer_fx.model.body import Array
from gossamer_fx.probes.run import Run
from gossamer_fx.reduction.basis import scalar_mass_times
from gossamer_fx.reduction.reduced_membrane import ReducedMembrane

SOFTEST = 1e-3  # least stiffness of a node, over the mean: slack film has none
SLACK = 1e-9  # least stiffness across, over the one in the film: one without tension has none


@check_arguments
class OutsideBasis:
    """Probe: energy that a reduced film's basis keeps the whole film from releasing, over the stored energy.

    Below 0.01 the modes hold the motion; from 0.1 on they do not, and the film itself should be asked.  In the shape
    that the modes give, the whole film has the nodal forces f.  No acceleration Φ a of the modes balances all of them;
    what is left would move the nodes, and release about

        ε = min over a of Σ_n ½ (f + M Φ a)_n · k_n⁻¹ (f + M Φ a)_n

    with the stiffness k_n of each node by itself, along the film's mean plane and across it.  Nodes at which ports are
    attached are left out: their forces come from elsewhere; loads on faces are taken as what modes balance.  An
    evaluation takes as long as a residual of the whole film; ask for it every hundred steps, or so.

    Args:
        body: made by `reduce`, in the scene of the run.
    """

    def __init__(self, body: ReducedMembrane) -> None:
        check(
            isinstance(body, ReducedMembrane),
            f"OutsideBasis: '{getattr(body, 'name', body)}' is no reduced film; give one that `reduce` has made.",
        )
        self.body = body
        self._estimate: _Estimate | None = None

    def __call__(self, run: Run) -> float:
        film = self.body
        if self._estimate is None:
            self._estimate = _Estimate(film)
        # rank 0 has the coefficients (r, 3), the others none
        c = film.comm.bcast(run.system.state[film].coordinates().reshape(-1, 3).copy())
        return self._estimate(c)


class _Estimate:
    """The energy ε for given coefficients, over the stored one."""

    def __init__(self, film: ReducedMembrane) -> None:
        basis, full = film.basis, film.full
        self._Φ, self._comm, self._n = (
            basis.values,
            film.comm,
            full.space.dofmap.index_map.size_local,
        )
        self._x = x = fem.Function(full.space)
        energy = full.density(full.measure(x)) * full.dx
        force = ufl.derivative(energy, x, ufl.TestFunction(full.space))
        self._energy, self._force = compile_form(energy), compile_form(force)
        self._b = la.vector(full.space.dofmap.index_map, 3)
        self._free = np.ones(self._n)
        start, end = full.space.dofmap.index_map.local_range
        held = np.array([node for node in film.port_nodes if start <= node < end], dtype=np.int64)
        self._free[held - start] = 0.0
        self._weights = self._softness(compile_form(ufl.derivative(force, x)), basis.examples)
        self._MΦ = scalar_mass_times(full, basis.values[: self._n])
        self._inverse = [
            np.linalg.pinv(self._sum(self._MΦ.T @ (w[:, None] * self._MΦ))) for w in self._weights
        ]

    def __call__(self, c: Array) -> float:
        f = self._forces(c)
        normal = _normal(c)
        across = f @ normal
        released = 0.0
        for w, inverse, part in zip(
            self._weights,
            self._inverse,
            (across[:, None], f - across[:, None] * normal),
            strict=True,
        ):
            own = self._MΦ.T @ (w[:, None] * part)
            total = self._sum(np.concatenate([own.ravel(), [np.sum(w[:, None] * part**2)]]))
            y = total[:-1].reshape(own.shape)
            released += max(float(total[-1] - np.sum(y * (inverse @ y))), 0.0) / 2
        stored = float(self._sum(np.array(fem.assemble_scalar(self._energy))))
        return released / max(stored, 1e-300)

    def _forces(self, c: Array) -> Array:
        """Nodal forces (n, 3) of the film in the shape of the coefficients."""
        self._x.x.array[:] = (self._Φ @ c).ravel()
        self._b.array[:] = 0
        fem.assemble_vector(self._b.array, self._force)
        self._b.scatter_reverse(la.InsertMode.add)
        forces: Array = self._b.array[: 3 * self._n].reshape(-1, 3).copy()
        return forces

    def _softness(self, stiffness: fem.Form, examples: Array) -> tuple[Array, Array]:
        """1/k_n (n,) across the film and in it, zero at ports; k_n is the largest in all shapes (k, r, 3), as a film
        that begins without tension has none across."""
        across, along = np.zeros(self._n), np.zeros(self._n)
        for c in examples:
            normal, blocks = _normal(c), self._blocks(stiffness, c)
            k = np.einsum("i,nij,j->n", normal, blocks, normal)
            across = np.maximum(across, k)
            along = np.maximum(along, (np.trace(blocks, axis1=1, axis2=2) - k) / 2)
        n = self._comm.allreduce(self._n)
        of_all = [float(self._sum(np.array(k.sum()))) / n for k in (across, along)]
        least = max(SOFTEST * of_all[0], SLACK * of_all[1]), SOFTEST * of_all[1]
        softness = [
            self._free / np.maximum(k, floor)
            for k, floor in zip((across, along), least, strict=True)
        ]
        return softness[0], softness[1]

    def _blocks(self, stiffness: fem.Form, c: Array) -> Array:
        """The stiffness (n, 3, 3) of each node by itself in the shape of the coefficients."""
        self._x.x.array[:] = (self._Φ @ c).ravel()
        K = fem.assemble_matrix(stiffness)
        K.scatter_reverse()
        rows = np.repeat(np.arange(len(K.indptr) - 1), np.diff(K.indptr))
        on = (rows == K.indices) & (rows < self._n)
        blocks = np.zeros((self._n, 3, 3))
        blocks[rows[on]] = K.data.reshape(-1, 3, 3)[on]
        return blocks

    def _sum(self, values: Array) -> Array:
        total: Array = self._comm.allreduce(values)
        return total


def _normal(c: Array) -> Array:
    """Of the film's mean plane, from the coefficients of X and Y."""
    n = np.cross(c[1], c[2])
    return n / max(float(np.linalg.norm(n)), 1e-300)
