"""Masses of bodies without mesh as points, for forces that differ from place to place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from gossamer_fx.extend import (
    Array,
    Assembly,
    Attached,
    AttachedKineticEnergy,
    Gather,
    NodeKineticEnergy,
    Port,
    add_blocks,
    attach_all,
    evaluated_here,
    translation_weight,
)

Kinetic = NodeKineticEnergy | AttachedKineticEnergy


class MassPoints:
    """Points X_p = B_p q + o_p of mass m_p, moved by unknowns q, that have the kinetic energy of given terms.

    Arrays over this rank's n points: indices (n, D), B (n, 3, D), o (n, 3), mass (n,).
    """

    def __init__(self, terms: Sequence[Kinetic], system: Assembly) -> None:
        indices, B, o, m = [], [], [], []
        for term in terms:
            places, masses = _places(term)
            own = evaluated_here(places)
            if not own:
                continue
            k = masses.shape[1]
            i, P, offset = attach_all(
                system.numbering, system.bodies, [places[j] for j in own], 3 * k
            )
            for row, j in enumerate(own):
                points, weights = equivalent_points(
                    masses[j, :, :], np.array([translation_weight(port) for port in places[j]])
                )
                spread = np.kron(points, np.eye(3)).reshape(len(points), 3, 3 * k)
                indices += [i[row]] * len(points)
                B += list(spread @ P[row])
                o += list(spread @ offset[row])
                m += list(weights)
        width = max((len(i) for i in indices), default=0)
        n = len(m)
        padded = [np.pad(i, (0, width - len(i)), constant_values=i[0]) for i in indices]
        self.indices = np.array(padded, dtype=PETSc.IntType).reshape(n, width)
        self.B = np.array([np.pad(b, ((0, 0), (0, width - b.shape[1]))) for b in B]).reshape(
            n, 3, width
        )
        self.o, self.mass = np.array(o).reshape(n, 3), np.array(m)
        self._gather = Gather(system.numbering, [self.indices])

    def __call__(self, q: PETSc.Vec) -> Array:
        """Positions (n, 3) in a state; called on all ranks together."""
        positions: Array = np.einsum("nax,nx->na", self.B, self._gather(q)[0]) + self.o
        return positions

    def add(self, forces: Array, r: PETSc.Vec) -> None:
        """Add forces (n, 3) on the points to a vector."""
        values = np.einsum("nax,na->nx", self.B, forces)
        r.setValues(self.indices.ravel(), values.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def add_matrices(self, K: Array, A: PETSc.Mat) -> None:
        """Add matrices (n, 3, 3) between the points' positions."""
        add_blocks(
            A,
            self.indices,
            self.indices,
            np.einsum("nax,nab,nby->nxy", self.B, K, self.B, optimize=True),
        )


def equivalent_points(mass: Array, translation_weight: Array) -> tuple[Array, Array]:
    """Points c (p, k) and masses (p,) with Σ m c cᵀ = mass (k, k), each an affine combination of k vectors.

    One at the centre of mass, if that is all there is; else a pair on each principal axis, at equal distances to both
    sides, which gives mass, centre and second moments, and no third ones.

    Args:
        translation_weight: (k,) 1 for positions, 0 for directors.
    """
    towards = mass @ translation_weight
    total = float(translation_weight @ towards)
    centre = towards / total
    moments, axes = np.linalg.eigh(mass - total * np.outer(centre, centre))
    kept = moments > 1e-13 * max(total, float(np.abs(mass).max()))
    pairs = int(kept.sum())
    if not pairs:
        return centre[None], np.array([total])
    each = total / (2 * pairs)
    arms = (np.sqrt(moments[kept] / (2 * each)) * axes[:, kept]).T
    return np.concatenate([centre + arms, centre - arms]), np.full(2 * pairs, each)


def _places(term: Kinetic) -> tuple[Sequence[tuple[Attached, ...]], Array]:
    """The vectors of each mass (k, k), and those masses, as far as this rank knows them."""
    if isinstance(term, AttachedKineticEnergy):
        return term.ports, term.mass
    start, body = term.body.block.index_map.local_range[0], term.body
    k = body.block.size // 3
    return [
        tuple(Port(body, (start + i,), weights=(1.0,), vectors=(j,)) for j in range(k))
        for i in range(len(term.mass))
    ], term.mass.reshape(-1, k, k)
