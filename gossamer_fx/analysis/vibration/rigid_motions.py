"""Rigid motions of items of a scene that nothing resists.

Problem.  An equilibrium is unique at most up to rigid motions that neither stiffness nor supports
nor loads resist.  A scene may consist of several parts, each with its own rigid motions about any
axis.

Algorithm, with the tangent K without inertia from which fixed coordinates were taken out.

1. The parts are the connected components of the graph of K: parts do not exert forces on each
   other.
2. Each part has six rigid motions about its centre, three translations and three rotations, the
   columns of R (unknowns, 6).  A rotation ω moves a position by ω × (q - centre), a director d by
   ω × d, and a force λ of a joint, a multiplier, by ω × λ.
3. The free motions R c satisfy K R c = 0 to round-off.  With the round-off D of the rows of K they
   are

       c with |D⁻¹ K R c|² < n,    |R c|² = n                                                 (1)

   for a part with n unknowns, found by a singular value decomposition.  A motion that would move a
   fixed coordinate is resisted, because K has no columns of these.
4. The free motions are described in words, along coordinate axes where possible.

Cost.  Six products with K, and a QR decomposition of six columns for each part.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.terms.point_constraints import multipliers_in_space
from gossamer_fx.solve.system.connected_parts import Labels, connected
from gossamer_fx.solve.system.system import System

# Parts whose motions are examined: the description of more would not be read.
MAX_PARTS = 64

# Round-off of a product of a row of K with a vector, over the sum of the magnitudes of the row.
ROW_ROUND_OFF = 16 * np.finfo(float).eps

# Round-off of the rows of constraints in K R, where R moves the farthest node by one: [1] for
# constraints in m, [1/m] for those of directions.  Constraints are satisfied to 1e-12.
CONSTRAINT_ROUND_OFF = 1e-10

# A motion that moves less than this, over the motion that moves most, moves nothing: the rotation
# of a straight line about its axis.
NO_MOTION = 1e-8

# What a rotation moves, over the largest move of a motion, below which it counts as none.
NEGLIGIBLE_ROTATION = 1e-6

# Distance of the nodes of a part from each other, over the extent of the scene and its distance
# from the origin, up to which they lie at one point.  Joints hold within 1e-12 of the extent.
ONE_POINT = 1e-10

# What a motion would move at fixed coordinates of its bodies, over what it moves at free ones, from
# which on these hold the bodies against it.
HELD_MOTION = 1e-6

# Translations below this, over the largest one, are round-off of their basis.
NEGLIGIBLE_TRANSLATION = 1e-8

# For words: coordinates below this fraction of the largest one are printed as zero, and directions
# that differ by less from an axis are named after it.
PRINTED_ZERO = 1e-6
ALONG_AXIS = 1e-9

TINY = 1e-300  # against division by zero


@dataclass
class _Nodes:
    """The nodes of one body on this rank.  Each has s vectors (n, s, 3): a position [m], and
    directors if s > 1, with their unknowns in the numbering of this rank (n, s, 3) and the part of
    each node, -1 if it is fixed."""

    unknowns: Labels
    vectors: Array
    part: Labels

    @property
    def is_free(self) -> npt.NDArray[np.bool_]:
        """Whether the nodes belong to a part, (n,)."""
        return self.part >= 0

    def arms(self, centre: Array) -> Array:
        """Vectors that a rotation about the parts' centres (parts, 3) [m] turns, (n, s, 3)."""
        # Fixed nodes have the part -1; any centre does for them, as their motion is not used.
        part = np.maximum(self.part, 0)
        arms = self.vectors.copy()
        arms[:, 0] -= centre[part]
        return arms


@dataclass(frozen=True)
class FreeMotions:
    """What nothing resists, in words, each once and the same on every rank.

    Attributes:
        rigid: rigid motions of parts, such as "translation z of 'film'".
        slack: motions of the same form, but of parts whose bodies are held against them elsewhere:
            the bodies have no stiffness across, as film and cables without tension.
    """

    rigid: tuple[str, ...]
    slack: tuple[str, ...]


def free_motions(
    system: System,
    K: PETSc.Mat,
    parts_of_scene: tuple[Labels, int],
    unbalanced: Array,
    stiffnesses: Sequence[tuple[Array, float]] = (),
) -> FreeMotions:
    """Rigid motions of the first `MAX_PARTS` parts, as of `parts`, that nothing resists.  K is the
    tangent at equilibrium without inertia and fixed coordinates, to which `stiffnesses` (g, κ) add
    κ g⊗g, as of gas; `unbalanced` (n,) are the forces [N] that are left there.  Collective."""
    part, count = parts_of_scene
    rigid: list[str] = []
    slack: list[str] = []
    for found in _motions(system, K, part, count, unbalanced, stiffnesses):
        # In a scene of one part there is nothing to distinguish.
        owner = ""
        if count > 1:
            owner = f" of {' and '.join(found.bodies)}"
        for motions, words in ((found.rigid, rigid), (found.slack, slack)):
            for description in _describe(motions, found.centre, found.radius):
                words.append(description + owner)
    return FreeMotions(tuple(dict.fromkeys(rigid)), tuple(dict.fromkeys(slack)))


# ---- parts ---------------------------------------------------------------------------------------


def parts(system: System, K: PETSc.Mat) -> tuple[Labels, int]:
    """Divide the unknowns of a scene into parts that no entry of the tangent K connects: the part
    (n,) of each unknown of this rank, -1 where it is fixed, and the number of parts on all ranks.
    Collective."""
    is_fixed = np.zeros(system.unknowns.numbering.size_local, dtype=bool)
    is_fixed[system.unknowns.supports.held] = True
    # Fixed components are left out: a support would otherwise connect parts that share it.
    label = connected(system, K, left_out=np.asarray(system.unknowns.supports.held, dtype=np.int64))

    # Number the labels that are in use from 0, in the same way on every rank.
    labels_of_ranks = system.comm.allgather(np.unique(label[~is_fixed]))
    known = np.unique(np.concatenate(labels_of_ranks))
    part = np.full(len(label), -1, dtype=np.int64)
    part[~is_fixed] = np.searchsorted(known, label[~is_fixed])
    return part, len(known)


# ---- free motions of each part -------------------------------------------------------------------


@dataclass(frozen=True)
class _PartMotions:
    """Motions of one part that nothing resists: names of its bodies, centre (3,) and radius [m],
    and motions (6, k), velocity of the centre and angular velocity, as of `FreeMotions`."""

    bodies: list[str]
    centre: Array
    radius: float
    rigid: Array
    slack: Array


def _motions(
    system: System,
    K: PETSc.Mat,
    part: Labels,
    count: int,
    unbalanced: Array,
    stiffnesses: Sequence[tuple[Array, float]],
) -> Iterator[_PartMotions]:
    """Yield the motions of each part that nothing resists, of at most `MAX_PARTS` parts.  A
    stiffness below the forces `unbalanced` (n,) [N] of its part is not known.  Collective."""
    # Where all unknowns are fixed, nothing can move.
    if count == 0:
        return
    comm = system.comm
    nodes = [_nodes_of(system, k, part) for k in range(len(system.unknowns.bodies))]
    names = _names(system, nodes, count)
    centre = _centres(comm, nodes, count)
    radius = _radii(system, nodes, centre)
    R = _rigid_motions(system, nodes, part, centre, radius)
    # Fixed unknowns do not move; what is tied to them resists.
    is_free = part >= 0
    R[:, ~is_free] = 0
    # A rotation by one over the radius turns the inner forces of a part with it, and changes an
    # unbalanced force f by f over the radius.
    is_coordinate = np.arange(len(part)) < _end_of_coordinates(system)
    counts = is_free & is_coordinate
    squares = np.zeros(count)
    np.add.at(squares, part[counts], unbalanced[counts] ** 2)
    comm.Allreduce(MPI.IN_PLACE, squares)
    errors = np.where(is_free, (np.sqrt(squares) / radius)[part], 0.0)
    D = _round_off(system, K, R, errors)
    for gradient, stiffness in stiffnesses:
        size_of_gradient = comm.allreduce(float(np.abs(gradient).sum()))
        D += ROW_ROUND_OFF * stiffness * size_of_gradient * np.abs(gradient)
    Y = np.zeros_like(R)  # D⁻¹ K R
    vector = system.unknowns.numbering.vector()
    product = system.unknowns.numbering.vector()
    for i in range(6):
        vector.array[:] = R[i]
        K.mult(vector, product)
        force = product.array_r.copy()
        for gradient, stiffness in stiffnesses:
            volume_change = comm.allreduce(float(gradient @ R[i]))
            force += stiffness * volume_change * gradient
        Y[i] = np.where(is_free, force / D, 0.0)
    holders = _Holders(system, part, count)
    for c in range(min(count, MAX_PARTS)):
        in_part = part == c
        size = comm.allreduce(int(in_part.sum()))
        forces = _triangle(comm, Y[:, in_part].T)
        # Without the forces of joints.
        moved = _triangle(comm, R[:, in_part & is_coordinate].T)
        motions = _null_space(forces, moved, size)
        # Rotations were scaled by the radius.
        motions[3:] /= radius[c]
        rigid, slack = holders.divide(c, motions, centre[c], float(radius[c]))
        yield _PartMotions(names[c], centre[c], float(radius[c]), rigid=rigid, slack=slack)


class _Holders:
    """The fixed coordinates of what each part is connected to by its bodies, whether or not these
    have stiffness: the mass connects the nodes of a cell."""

    def __init__(self, system: System, part: Labels, count: int) -> None:
        self._comm = system.comm
        piece = connected(system, system.unknowns.M)
        self._piece = piece
        self._part = part
        end = _end_of_coordinates(system)
        held = system.unknowns.supports.held
        self._held = held[held < end]
        # Each of these is one of three components of a position or a director.
        self._components = np.empty(len(self._held), dtype=np.int64)
        self._vectors = np.zeros((len(self._held), 3))
        self._are_positions = np.zeros(len(self._held), dtype=bool)
        q = system.unknowns.q0.array_r
        for body in system.unknowns.bodies:
            owned = system.unknowns.block(body).owned
            inside = (self._held >= owned.start) & (self._held < owned.stop)
            index = self._held[inside] - owned.start
            component = index % body.block.size
            self._components[inside] = component % 3
            self._are_positions[inside] = component < 3
            first = self._held[inside] - component % 3
            self._vectors[inside] = q[first[:, None] + np.arange(3)]

    def divide(self, c: int, motions: Array, centre: Array, radius: float) -> tuple[Array, Array]:
        """Divide motions (6, k) of part c into those that the fixed coordinates of its bodies
        allow, and a complement of them, which they do not.  Collective."""
        if not motions.size:
            return motions, motions
        own_pieces = np.unique(self._piece[self._part == c])
        gathered = np.unique(np.concatenate(self._comm.allgather(own_pieces)))
        concerned = np.isin(self._piece[self._held], gathered)
        arms = self._vectors[concerned] - np.where(
            self._are_positions[concerned][:, None], centre, 0.0
        )
        rows = self._components[concerned]
        moves = np.zeros((len(rows), motions.shape[1]))
        for k in range(motions.shape[1]):
            velocities = np.cross(motions[3:, k], arms)
            velocities[self._are_positions[concerned]] += motions[:3, k]
            moves[:, k] = velocities[np.arange(len(rows)), rows]
        square = self._comm.allreduce(moves.T @ moves)
        values, vectors = np.linalg.eigh(square)
        # Motions move the farthest node of the part by about one.
        sizes = np.linalg.norm(np.vstack([motions[:3], motions[3:] * radius]), axis=0)
        is_allowed = np.sqrt(np.maximum(values, 0.0)) < HELD_MOTION * max(sizes.max(), TINY)
        return motions @ vectors[:, is_allowed], motions @ vectors[:, ~is_allowed]


def _nodes_of(system: System, k: int, part: Labels) -> _Nodes:
    """Return this rank's nodes of body k of the system, with the part (n,) of each of its unknowns
    in `part`."""
    body = system.unknowns.bodies[k]
    owned = system.unknowns.block(body).owned
    shape = (-1, body.block.size // 3, 3)
    unknowns = np.arange(owned.start, owned.stop).reshape(shape)
    return _Nodes(
        unknowns=unknowns,
        vectors=system.unknowns.q0.array_r[owned].reshape(shape).copy(),
        part=part[unknowns].max(axis=(1, 2), initial=-1),
    )


def _names(system: System, nodes: Sequence[_Nodes], count: int) -> list[list[str]]:
    """Names of the bodies, in quotes, that have free nodes in each of the `count` connected parts
    of a scene."""
    has_nodes = np.zeros((len(nodes), count), dtype=bool)
    for k, one in enumerate(nodes):
        has_nodes[k, one.part[one.is_free]] = True
    system.comm.Allreduce(MPI.IN_PLACE, has_nodes, op=MPI.LOR)
    names = [f"'{body.name}'" for body in system.unknowns.bodies]
    return [[names[k] for k in np.flatnonzero(has_nodes[:, c])] for c in range(count)]


def _centres(comm: MPI.Intracomm, nodes: Sequence[_Nodes], count: int) -> Array:
    """Return the mean position of the free nodes of each part, (count, 3) [m].  Collective."""
    sums = np.zeros((count, 4))  # of positions, and number of nodes
    for one in nodes:
        positions = one.vectors[one.is_free, 0]
        ones = np.ones(len(positions))
        contributions = np.column_stack([positions, ones])
        np.add.at(sums, one.part[one.is_free], contributions)
    comm.Allreduce(MPI.IN_PLACE, sums)
    # A part of multipliers only has no node; its centre is not used.
    node_counts = np.maximum(sums[:, 3:], 1)
    return sums[:, :3] / node_counts


def _radii(system: System, nodes: Sequence[_Nodes], centre: Array) -> Array:
    """Longest arm of each part [m], (parts,); 1 for a single point.  The arms of nodes that lie at
    one point within round-off, as the ends of ropes in a joint, become zero.  Collective."""
    comm = system.comm
    radius = np.zeros(len(centre))
    spread = np.zeros(len(centre))
    for one in nodes:
        arms = np.linalg.norm(one.arms(centre)[one.is_free], axis=2)
        part = one.part[one.is_free]
        np.maximum.at(radius, part, arms.max(axis=1, initial=0.0))
        np.maximum.at(spread, part, arms[:, 0])
    comm.Allreduce(MPI.IN_PLACE, radius, op=MPI.MAX)
    comm.Allreduce(MPI.IN_PLACE, spread, op=MPI.MAX)
    # Joints hold within a fraction of the extent; positions have the round-off of coordinates.
    round_off = ONE_POINT * (
        system.unknowns.initial.extent() + np.abs(centre).max(axis=1, initial=0.0)
    )
    is_point = spread <= round_off
    for one in nodes:
        moved = one.is_free & is_point[np.maximum(one.part, 0)]
        one.vectors[moved, 0] = centre[one.part[moved]]
    # The directors of nodes at one point have the size one.
    return np.where(is_point & (radius <= round_off), 1.0, radius)


def _rigid_motions(
    system: System, nodes: Sequence[_Nodes], part: Labels, centre: Array, radius: Array
) -> Array:
    """Six rigid motions Rᵀ (6, n) of each part at this rank's unknowns: three translations by one,
    and three rotations about the centres (parts, 3) [m], which move the farthest node, at `radius`
    (parts,) [m], by one.  They are in [1/m] for directors, [N/m] for forces of joints, and zero for
    other multipliers and fixed nodes."""
    R = np.zeros((6, system.unknowns.numbering.size_local))
    multipliers = multipliers_in_space(system.unknowns)
    joint_forces = system.unknowns.q0.array_r[multipliers]
    scale_of_forces = radius[np.maximum(part[multipliers], 0)]
    for i, axis in enumerate(np.eye(3)):
        for one in nodes:
            # A translation moves positions and does not turn directors.
            translation = np.zeros_like(one.vectors)
            translation[:, 0] = axis
            # Translations and rotations of the same size make (1) independent of the unit of
            # length.
            scale = radius[np.maximum(one.part, 0)]
            rotation = np.cross(axis, one.arms(centre)) / scale[:, None, None]
            unknowns = one.unknowns[one.is_free]
            R[i, unknowns] = translation[one.is_free]
            R[3 + i, unknowns] = rotation[one.is_free]
        R[3 + i, multipliers] = np.cross(axis, joint_forces) / scale_of_forces
    return R


def _round_off(system: System, K: PETSc.Mat, R: Array, errors: Array) -> Array:
    """Error of each row of K R: the numbers D (n,) of equation (1) of the module, positive, in the
    units of K R: [N/m] for positions, [N] for directors, [1] for constraints in m and [1/m] for
    those of directions.  `errors` (n,) [N/m] are the norms of the unbalanced forces of a part over
    its radius."""
    magnitudes = K.convert("aij", PETSc.Mat())
    pointers, columns, values = magnitudes.getValuesCSR()
    magnitudes.setValuesCSR(pointers, columns, np.abs(values))
    magnitudes.assemble()
    # Multipliers that do not move add nothing: gradients of constraints between directors are
    # numbers near one, far above the stiffness [N m] of directors in scenes of small size.
    moved, sum_of_row = magnitudes.createVecs()
    moved.set(1.0)
    multipliers = np.arange(_end_of_coordinates(system), moved.getLocalSize())
    moved.array[multipliers] = np.abs(R[:, multipliers]).max(axis=0, initial=0.0)
    magnitudes.mult(moved, sum_of_row)
    D: Array = ROW_ROUND_OFF * sum_of_row.array_r
    magnitudes.destroy()
    if system.equations.constraints is not None:
        D[system.equations.constraints.owned] += CONSTRAINT_ROUND_OFF
    # Multipliers follow the coordinates of the bodies, and have no unbalanced force.  The factor of
    # two is a margin.
    end = _end_of_coordinates(system)
    D[:end] += 2 * errors[:end]
    # Rows of zeros give zeros, whatever they are divided by.
    return np.where(D > 0, D, 1.0)


def _end_of_coordinates(system: System) -> int:
    """The number of coordinates in this rank's part of a vector, which multipliers follow."""
    return int(system.unknowns.block(system.unknowns.bodies[-1]).owned.stop)


def _triangle(comm: MPI.Intracomm, columns: Array) -> Array:
    """The factor R (6, 6), the same on all ranks, of the QR decomposition of a matrix (n, 6) whose
    rows are distributed.  In contrast to a Cholesky factor of the product with its transpose, it
    loses no digits.  Collective."""
    # Six rows of zeros, as a rank may have fewer than six rows.
    padded = np.vstack([columns, np.zeros((6, 6))])
    own = np.asarray(np.linalg.qr(padded, mode="r"))
    stacked = np.vstack(comm.allgather(own))
    return np.asarray(np.linalg.qr(stacked, mode="r"))


def _null_space(forces: Array, moved: Array, n: int) -> Array:
    """The free motions of a part: the combinations c (6, k) of its six rigid motions that satisfy
    equation (1) of the module, from the triangular factors (6, 6) of D⁻¹ K R, `forces`, and of R,
    `moved`."""
    # Combinations of the six motions that satisfy the second condition of (1).
    moved_svd = np.linalg.svd(moved)
    σ = moved_svd.S
    kept = σ > NO_MOTION * max(float(σ.max()), TINY)
    unit_motions = moved_svd.Vh[kept].T / σ[kept] * n**0.5
    # Among these, the combinations that satisfy the first one.
    forces_svd = np.linalg.svd(forces @ unit_motions)
    is_free = n > forces_svd.S**2
    return unit_motions @ forces_svd.Vh[is_free].T


# ---- words ---------------------------------------------------------------------------------------


def _describe(motions: Array, centre: Array, radius: float) -> list[str]:
    """Translations and rotations in words that span k motions (6, k) of a part of a radius [m], its
    velocity at the centre (3,) [m] and its angular velocity; along the coordinate axes if
    possible."""
    if not motions.size:
        return []
    # Combinations whose rotation moves no node, compared with their velocity, are translations, all
    # others rotations.
    ω = motions[3:] * radius
    size = np.abs(np.vstack([motions[:3], ω])).max()
    svd = np.linalg.svd(ω, full_matrices=True)
    # Number of independent rotations; the last rows of Vh are the combinations without any.
    rank = int((NEGLIGIBLE_ROTATION * size < svd.S).sum())
    translations = motions @ svd.Vh[rank:].T
    rotations = _aligned(motions @ svd.Vh[:rank].T)

    directions = _along_axes(translations[:3])
    words = [f"translation {_direction(direction)}" for direction in directions]
    span: Array = np.zeros((3, 0))
    if directions:
        span = np.column_stack(directions)
    for k in range(rotations.shape[1]):
        description = _describe_rotation(
            velocity=rotations[:3, k],
            axis=rotations[3:, k],
            centre=centre,
            span=span,
        )
        words.append(description)
    return words


def _describe_rotation(velocity: Array, axis: Array, centre: Array, span: Array) -> str:
    """A rotation in words, with a point on its axis.  Its axis is the angular velocity (3,),
    `velocity` that of the centre, `span` (3, k) the directions of free translations."""
    words = f"rotation {_direction(axis)}"
    if span.size:
        # A free translation may be added to the rotation: take the smallest velocity.
        coefficients = np.linalg.lstsq(span, velocity, rcond=None)[0]
        velocity = velocity - span @ coefficients
    # The point of zero velocity on the perpendicular through the centre: ω × (point - centre) = -v.
    square = axis @ axis
    point = centre + np.cross(axis, velocity) / square
    # The point of the axis that is nearest to the origin.
    point -= (point @ axis) / square * axis
    if span.shape[1] >= 2:
        translations_and_axis = np.column_stack([span, axis])
        spanned = np.linalg.matrix_rank(translations_and_axis, tol=NEGLIGIBLE_ROTATION)
        if spanned == 3:
            # Free translations across the axis: it may pass through any point.
            return words
    size = max(float(np.abs(centre).max()), 1.0)
    if np.abs(point).max() < PRINTED_ZERO * size:
        return words
    return f"{words} about ({_numbers(point)})"


def _aligned(motions: Array) -> Array:
    """Combinations (6, k) of k motions whose rotations are along coordinate axes, if possible:
    Gauss-Jordan elimination with pivots among the rotations."""
    rows = motions.T.copy()
    pivots: list[int] = []
    for i in range(len(rows)):
        remaining = [j for j in range(3) if j not in pivots]
        # The largest of all entries that are left is the pivot: division by a small one would
        # enlarge round-off.
        rotations = np.abs(rows[i:, 3:])
        pivot = max(remaining, key=lambda j: float(rotations[:, j].max()))
        k = i + int(rotations[:, pivot].argmax())
        rows[[i, k]] = rows[[k, i]]
        rows[i] /= rows[i, 3 + pivot]
        for other in range(len(rows)):
            if other != i:
                rows[other] -= rows[other, 3 + pivot] * rows[i]
        pivots.append(pivot)
    order = np.argsort(pivots)
    return rows[order].T


def _along_axes(vectors: Array) -> list[Array]:
    """A basis of the span of vectors (3, k), along coordinate axes if possible."""
    if not vectors.size:
        return []
    svd = np.linalg.svd(vectors, full_matrices=False)
    threshold = NEGLIGIBLE_TRANSLATION * max(svd.S.max(), TINY)
    basis = svd.U[:, threshold < svd.S]
    # `_aligned` works on the last three components.
    padded = np.vstack([np.zeros_like(basis), basis])
    return list(_aligned(padded)[3:].T)


def _direction(d: Array) -> str:
    """A direction (3,) in words: the name of an axis, or components with the largest one
    positive."""
    d = d / np.linalg.norm(d)
    k = int(np.abs(d).argmax())
    if abs(d[k]) > 1 - ALONG_AXIS:
        return "xyz"[k]
    # A direction and its opposite are the same motion.
    upwards = d * np.sign(d[k])
    return f"({_numbers(upwards)})"


def _numbers(values: Array) -> str:
    """Numbers to three digits, round-off as zero."""
    is_zero = np.abs(values) < PRINTED_ZERO * np.abs(values).max()
    rounded = np.where(is_zero, 0.0, values)
    # Adding zero turns -0.0 into 0.0.
    return ", ".join(f"{value + 0.0:.3g}" for value in rounded)


def listed(motions: Iterable[str]) -> str:
    """Names of free motions, each once: every node of a slack film has the same three.

    >>> listed(("translation x of 'film'", "translation x of 'film'"))
    "translation x of 'film'"
    """
    return ", ".join(dict.fromkeys(motions))
