"""Representation of the masses of rigid and reduced bodies by points, for forces that vary in
space.
"""

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
    """Mass points whose total kinetic energy equals that of given terms.

    Point p of mass m_p has the position X_p = B_p q + o_p, with the unknowns q of the system.

    Args:
        terms: kinetic energies of bodies without mesh, and of masses that are attached to bodies.
        system: the assembled system.

    Attributes:
        indices: global indices (n, D) of the unknowns that move each of this rank's n points.
        B: matrices (n, 3, D) of these unknowns.
        o: offsets (n, 3) [m].
        mass: masses (n,) [kg].
    """

    def __init__(self, terms: Sequence[Kinetic], system: Assembly) -> None:
        """Replace each mass by points, and find the unknowns that move them.  Collective.

        The points are those of this rank's ports; B (n, 3, D) and o (n, 3) [m] give their positions
        B q + o from the unknowns q."""
        indices: list[Array] = []
        matrices: list[Array] = []
        offsets: list[Array] = []
        point_masses: list[float] = []
        for term in terms:
            ports, masses = _ports_and_masses(term)
            own = evaluated_here(ports)
            if not own:
                continue
            # k: number of vectors (position, directors) of a body; P (3k, D), offset (3k,): the
            # vectors of a port are P times its D unknowns plus the offset.
            k = masses.shape[1]
            own_ports = [ports[j] for j in own]
            unknowns, P, offset = attach_all(system.numbering, system.bodies, own_ports, 3 * k)
            for row, j in enumerate(own):
                is_position = np.array([translation_weight(port) for port in ports[j]])
                points, weights = equivalent_points(masses[j, :, :], is_position)
                # From the k vectors to the points, component by component.
                spread = np.kron(points, np.eye(3)).reshape(len(points), 3, 3 * k)
                indices += [unknowns[row]] * len(points)
                matrices += list(spread @ P[row])
                offsets += list(spread @ offset[row])
                point_masses += list(weights)

        # Points have different numbers of unknowns.  Shorter rows are filled up with an index of
        # their own and the coefficient zero.
        width = max((len(row) for row in indices), default=0)
        n = len(point_masses)
        padded = []
        for of_point in indices:
            missing = width - len(of_point)
            padded.append(np.pad(of_point, (0, missing), constant_values=of_point[0]))
        padded_matrices = []
        for matrix in matrices:
            padded_matrices.append(np.pad(matrix, ((0, 0), (0, width - matrix.shape[1]))))
        self.indices = np.array(padded, dtype=PETSc.IntType).reshape(n, width)
        self.B = np.array(padded_matrices).reshape(n, 3, width)
        self.o = np.array(offsets).reshape(n, 3)
        self.mass = np.array(point_masses)
        # One exchange brings the unknowns of all points, also those that other ranks own.
        self._gather = Gather(system.numbering, [self.indices])

    def __call__(self, q: PETSc.Vec) -> Array:
        """Positions (n, 3) [m] of the points at the unknowns q.  Collective."""
        unknowns = self._gather(q)[0]
        positions: Array = np.einsum("nax,nx->na", self.B, unknowns) + self.o
        return positions

    def add(self, forces: Array, r: PETSc.Vec) -> None:
        """Add forces (n, 3) [N] on the points to a vector of the system.  Collective."""
        values = np.einsum("nax,na->nx", self.B, forces)
        r.setValues(self.indices.ravel(), values.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
        r.assemble()

    def add_matrices(self, K: Array, A: PETSc.Mat) -> None:
        """Add stiffness matrices (n, 3, 3) [N/m] of the points to a matrix of the system."""
        blocks = np.einsum("nax,nab,nby->nxy", self.B, K, self.B, optimize=True)
        add_blocks(A, self.indices, self.indices, blocks)


def equivalent_points(mass: Array, translation_weight: Array) -> tuple[Array, Array]:
    """Mass points that have the same mass matrix as a body that is moved by k vectors.

    If the whole mass moves with the centre, there is one point.  Otherwise there is a pair of
    points on each principal axis, at equal distances to both sides of the centre.  Mass, centre and
    second moments are exact; third moments are zero.

    Args:
        mass: mass matrix (k, k) of the vectors: masses [kg] of positions, first [kg m] and second
            moments [kg m²] of directors.
        translation_weight: (k,), 1 for positions and 0 for directors.

    Returns:
        points c (p, k), each an affine combination of the k vectors, and masses m (p,) [kg], such
        that Σ m c cᵀ is the mass matrix.

    Raises:
        numpy.linalg.LinAlgError: the body has no mass.

    >>> import numpy as np
    >>> points, masses = equivalent_points(np.diag([2.0, 8.0]), np.array([1.0, 0.0]))
    >>> (masses[:, None] * points).T @ points
    array([[2., 0.],
           [0., 8.]])
    """
    towards = mass @ translation_weight
    total = float(translation_weight @ towards)
    centre = towards / total
    about_centre = mass - total * np.outer(centre, centre)
    # Pairs of points on the principal axes have the second moments and no products of inertia.
    moments, axes = np.linalg.eigh(about_centre)
    # Moments below this are round-off.
    kept = moments > 1e-13 * max(total, float(np.abs(mass).max()))
    pairs = int(kept.sum())
    if not pairs:
        return centre[None], np.array([total])
    each = total / (2 * pairs)
    arms = (np.sqrt(moments[kept] / (2 * each)) * axes[:, kept]).T
    points = np.concatenate([centre + arms, centre - arms])
    return points, np.full(2 * pairs, each)


def _ports_and_masses(term: Kinetic) -> tuple[Sequence[tuple[Attached, ...]], Array]:
    """The k vectors of each of n masses, and the mass matrices (n, k, k), of the nodes of this
    rank.

    A vector is a port: a position [m] or a director [-] of a body.  Entries of the matrices are
    masses [kg] for two positions, first moments [kg m] and second moments [kg m²] with directors.

    Args:
        term: kinetic energy of the nodes of a body, or of masses attached to ports.
    """
    if isinstance(term, AttachedKineticEnergy):
        return term.ports, term.mass
    body = term.body
    start = body.block.index_map.local_range[0]
    k = body.block.size // 3
    ports = []
    for i in range(len(term.mass)):
        vectors = [Port(body, (start + i,), weights=(1.0,), vectors=(j,)) for j in range(k)]
        ports.append(tuple(vectors))
    return ports, term.mass.reshape(-1, k, k)
