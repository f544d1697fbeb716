"""All points of a contact as functions of the unknowns.

The first points are those of bodies.  The points of obstacles follow: they stay, move as
prescribed, or are combinations of the vectors of a rigid body.

    x = W y + c(t)        points x (m, 3), block rows y (v, 3), weights W (m, v), prescribed part c
    y = S q               node rows q (u, 3), shape functions S (v, u)

A *node row* is a vector of three unknowns: the position of a node of a body, or a vector of a rigid
body.  A *block row* is a vector by which the pairs move: the position of point i of the first n, or
a vector of a rigid body.  Points of cells of order 2 are sums of nodes, weighted by the shape
functions; without such cells block rows are node rows, and S is left out.  Since both maps are
linear, forces Sᵀ Wᵀ F do the work of F, and have its resultant and moment.

Prescribed motions are functions of the user, asked for on all ranks and checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import block_diag, csr_matrix, identity

from gossamer_fx.core.algebra.point_measures import Gather, attach
from gossamer_fx.core.checks.errors import Inadmissible
from gossamer_fx.core.checks.user_functions import ask_numbers
from gossamer_fx.core.model.body import Attached, Body, Ground, Port
from gossamer_fx.mechanics.contact.contract import Array, Int32Array, Int64Array, MaskArray
from gossamer_fx.mechanics.contact.obstacles import PrescribedMotion
from gossamer_fx.mechanics.terms.assembly import Assembly

# Parts of a step at which the motion is asked for.  Multiples of the golden ratio, less whole
# numbers, are spread evenly and are not multiples of each other, so that a motion of a short period
# does not hide between them.
GOLDEN_RATIO = (1 + 5**0.5) / 2
SAMPLES = np.modf(GOLDEN_RATIO * np.arange(1, 9))[0]

# Displacements that are kept: those of both ends of a step and of all samples between them, twice.
KEPT_DISPLACEMENTS = 2 * (len(SAMPLES) + 2)


class ObstacleMotion:
    """The displacement of one obstacle over the time.

    Args:
        function: displacement (3,) [m] at a time [s].

    Raises:
        InputError: on all ranks, when a displacement is asked for: the function raises, or returns
            something other than three finite numbers, or not the same ones on all ranks.
    """

    def __init__(self, name: str, function: PrescribedMotion, comm: MPI.Intracomm) -> None:
        self.name = name
        self._function = function
        self._comm = comm
        # Newton's iteration asks for the end of the step again and again.
        self._known: dict[float, Array] = {}

    def at(self, time: float) -> Array:
        """Return the displacement (3,) [m] at a time [s]; collective.  The function of the user is
        not called again for the last `KEPT_DISPLACEMENTS` times."""
        if time not in self._known:
            what = f"Motion of the obstacle '{self.name}' at t = {time:.6g} s"
            displacement = ask_numbers(self._comm, what, lambda: self._function(time), (3,))
            while len(self._known) >= KEPT_DISPLACEMENTS:
                del self._known[next(iter(self._known))]
            self._known[time] = displacement
        return self._known[time]

    def deviation(self, time: float, step: float) -> float:
        """Return how far [m] the motion is from a straight and uniform one in a step; collective.

        A smooth motion deviates by its acceleration times step²/8, so that shorter steps bring it
        below any limit.  A jump deviates by at least half of its length, however short the step is.
        """
        start = self.at(time)
        way = self.at(time + step) - start
        deviations = [
            float(np.linalg.norm(self.at(time + float(part) * step) - (start + part * way)))
            for part in SAMPLES
        ]
        return max(deviations)


@dataclass(frozen=True)
class ObstaclePoints:
    """Points and directions of one obstacle.

    Attributes:
        at: where they are (k,), in space or on a body.
        is_point: whether each takes part in a prescribed motion (k,); directions do not.
        motion: displacement [m] over the time [s]; None: none.
        name: of the obstacle, for messages.
    """

    at: Sequence[Attached]
    is_point: Sequence[bool]
    motion: PrescribedMotion | None
    name: str = "obstacle"


def _weights_of(vectors: Sequence[Attached], system: Assembly) -> tuple[csr_matrix, Int64Array]:
    """Return the rows of W (k, o) for the k points and directions of obstacles, zero for those in
    space, and the first unknown of each of the o block rows of rigid bodies, which obstacles on one
    body share."""
    rows: list[int] = []
    weights: list[float] = []
    first_dofs: list[int] = []
    for number, vector in enumerate(vectors):
        if isinstance(vector, Port):
            unknowns, P, _ = attach(system.numbering, system.bodies, (vector,))
            # Three unknowns, and three columns of P, for each vector of which it is a combination.
            first_dofs += [int(unknown) for unknown in unknowns[::3]]
            weights += [float(weight) for weight in P[0, ::3]]
            rows += [number] * (len(unknowns) // 3)
    distinct, columns = np.unique(np.array(first_dofs, dtype=np.int64), return_inverse=True)
    shape = (len(vectors), len(distinct))
    return csr_matrix((weights, (rows, columns)), shape=shape), distinct


@dataclass(frozen=True, eq=False)
class MovingRows:
    """The w block rows that move the points of k contact pairs.

    Attributes:
        pairs: numbers (k,) of the pairs, ascending.
        block_rows: of each pair (k, w).
        weights: of the block rows in its four points (k, 4, w) [-].
    """

    pairs: Int64Array
    block_rows: Int64Array
    weights: Array


class ContactPoints:
    """The m points of a contact that this rank knows, of which the first n are points of bodies.

    Attributes:
        body_count: n.
        obstacle_count: number of points of obstacles, which every rank knows.
        count: m.
        first_dof: number (u,) of the first of the three unknowns of each node row in the system.
        shape: S (v, u); None: block rows are node rows.
        weights: W (m, v).
        prescribed: points (k,) with a prescribed motion.
    """

    body_count: int
    count: int
    first_dof: Int64Array
    shape: csr_matrix | None
    weights: csr_matrix
    prescribed: Int64Array

    def __init__(
        self, bodies: Sequence[Body], obstacles: Sequence[ObstaclePoints], system: Assembly
    ) -> None:
        self.comm = system.comm
        self._numbering = system.numbering
        self._blocks = [system.block(body) for body in bodies]
        self._motions: list[tuple[Int64Array, ObstacleMotion]] = []
        vectors: list[Attached] = []
        is_point: list[bool] = []
        for obstacle in obstacles:
            if obstacle.motion is not None:
                moved = len(vectors) + np.flatnonzero(obstacle.is_point)
                motion = ObstacleMotion(obstacle.name, obstacle.motion, system.comm)
                self._motions.append((moved, motion))
            vectors += obstacle.at
            is_point += obstacle.is_point
        # Every rank knows all obstacles: they have few points.
        self.obstacle_count = len(vectors)
        self._is_point = np.array(is_point, dtype=bool)
        self._of_obstacles, self._first_dofs = _weights_of(vectors, system)
        # Points on a rigid body have no constant part.
        self._fixed = np.zeros((len(vectors), 3))
        for number, vector in enumerate(vectors):
            if isinstance(vector, Ground):
                self._fixed[number] = vector.vector
        # Without obstacles on rigid bodies W is the identity, and products with it are left out.
        self._are_block_rows = not len(self._first_dofs)

    def is_position(self) -> MaskArray:
        """Return which points (m,) are positions: the others are directions of obstacles, such as
        normals, on which no force [N] but a moment acts."""
        return np.concatenate([np.ones(self.body_count, dtype=bool), self._is_point])

    @property
    def block_row_count(self) -> int:
        """v, the number of block rows."""
        return self.weights.shape[1]

    def set_points(self, body: Int64Array, nodes: Int64Array, weights: Array) -> None:
        """Let the first n points of a contact be some points of bodies, and set the map from
        unknowns to all points; collective.  `body`: number (n,) of the body of each point,
        ascending; `nodes, weights`: global numbers (n, w) among the nodes of the body, and the
        weights of these nodes in the point."""
        self.body_count = len(nodes)
        self.count = self.body_count + self.obstacle_count
        self.shape = None
        row_body = body
        row_node = nodes[:, 0]
        if nodes.shape[1] > 1:
            used = weights.nonzero()
            keys = np.column_stack([body[used[0]], nodes[used]])
            rows, row = np.unique(keys, axis=0, return_inverse=True)
            row_body, row_node = rows.T
            shape = (self.body_count, len(rows))
            of_points = csr_matrix((weights[used], (used[0], row.ravel())), shape=shape)
            of_rigid_bodies = identity(len(self._first_dofs), format="csr")
            self.shape = block_diag((of_points, of_rigid_bodies), format="csr")
        of_bodies = [
            block.to_global(row_node[row_body == k])[:, 0] for k, block in enumerate(self._blocks)
        ]
        self.first_dof = np.concatenate([*of_bodies, self._first_dofs]).astype(np.int64)
        # The identity for points of bodies, then the rows of obstacles.
        of_bodies_points = identity(self.body_count, format="csr")
        self.weights = block_diag((of_bodies_points, self._of_obstacles), format="csr")
        self._moved = [(self.body_count + numbers, motion) for numbers, motion in self._motions]
        self.prescribed = np.concatenate(
            [np.zeros(0, dtype=np.int64), *(points for points, _ in self._moved)]
        )
        # Points of bodies have no prescribed part.
        self._constants = np.vstack([np.zeros((self.body_count, 3)), self._fixed])
        self._dofs = self.first_dof[:, None] + np.arange(3)
        self._gather = Gather(self._numbering, [self._dofs])

    def at(self, q: PETSc.Vec, time: float) -> Array:
        """Return the points of a contact for coordinates q of the system at a time [s]; collective.

        Returns positions (m, 3) [m]; directions of obstacles among them have no unit.

        Raises:
            InputError: on all ranks, the motion of an obstacle raises or returns other than three
                numbers.
        """
        x = self.of_block_rows(q)
        if not self._are_block_rows:
            x = self.weights @ x
        if self.count > self.body_count:
            whole = np.zeros((self.count, 3))
            whole[: len(x)] = x
            x = whole + self._constants
            for points, motion in self._moved:
                x[points] += motion.at(time)
        return x

    def rates(self, v: PETSc.Vec, time: float, step: float) -> Array:
        """Return the velocities (m, 3) [m/s] of the points of a contact for rates v of the
        coordinates; of prescribed points the mean ones of a step [s] from a time on.  Collective.

        Raises:
            InputError: on all ranks, the motion of an obstacle raises or returns other than three
                numbers.
        """
        rates: Array = np.asarray(self.weights @ self.of_block_rows(v))
        for points, motion in self._moved:
            rates[points] = (motion.at(time + step) - motion.at(time)) / step
        return rates

    def refuse_jumps(self, time: float, step: float, limit: float) -> None:
        """Refuse a step in which the motion of an obstacle is far from straight and uniform;
        collective.

        `limit`: largest deviation [m].

        Raises:
            Inadmissible: names the obstacle, its deviation and the limit; the step is then tried in
                parts.
            InputError: the motion raises or returns other than three numbers.
        """
        for _, motion in self._moved:
            deviation = motion.deviation(time, step)
            if deviation > limit:
                raise Inadmissible(
                    f"the motion of the obstacle '{motion.name}' jumps or turns: it is "
                    f"{deviation:.3g} m off a straight way, of which contact can follow "
                    f"{limit:.3g} m; give a continuous motion, or a shorter step"
                )

    def of_block_rows(self, q: PETSc.Vec) -> Array:
        """Return the values (v, 3) of all block rows for a vector of the system; collective."""
        of_node_rows = self.of_node_rows(q)
        return of_node_rows if self.shape is None else np.asarray(self.shape @ of_node_rows)

    def of_node_rows(self, q: PETSc.Vec) -> Array:
        """Return the entries (u, 3) of a vector of the system at all node rows; collective."""
        if self.comm.size == 1:
            # Six times as fast as a scatter.
            return q.array_r[self._dofs]
        return self._gather(q)[0]

    def add(self, force: Array, r: PETSc.Vec) -> None:
        """Add the forces (m, 3) [N] on points, this rank's share, to a vector of the system, as
        Sᵀ Wᵀ force; collective."""
        on_rows = force[: self.body_count]
        if not self._are_block_rows:
            on_rows = np.asarray(self.weights.T @ force)
        if self.shape is not None:
            on_rows = np.asarray(self.shape.T @ on_rows)
        if self.comm.size == 1:
            values = r.array
            values[self._dofs] += on_rows
            return
        # The messages of the scatter are known beforehand, unlike those of single entries of a
        # vector.
        self._gather.add(on_rows, r)

    def block_rows_of(self, points: Int32Array) -> list[MovingRows]:
        """Return the block rows that move the points (n, 4) of contact pairs, for pairs that have
        as many each: one with a floor has one or three, one with a rigid body four more."""
        # Entries of W, of all points of all pairs.
        counts = np.diff(self.weights.indptr)[points].ravel()
        point = np.repeat(np.arange(points.size), counts)
        number_in_point = np.arange(len(point)) - np.repeat(np.cumsum(counts) - counts, counts)
        entry = self.weights.indptr[points.ravel()[point]] + number_in_point
        pair, corner = np.divmod(point, 4)
        # Points of one rigid body share its block rows.
        keys = pair * np.int64(self.block_row_count) + self.weights.indices[entry]
        distinct, row_of_entry = np.unique(keys, return_inverse=True)
        pair_of_row, block_row = np.divmod(distinct, self.block_row_count)
        widths = np.bincount(pair_of_row, minlength=len(points))
        number_in_pair = np.arange(len(distinct)) - (np.cumsum(widths) - widths)[pair_of_row]
        weights = np.zeros((len(points), 4, int(widths.max(initial=0))))
        weights[pair, corner, number_in_pair[row_of_entry]] = self.weights.data[entry]
        found = []
        for width in np.unique(widths):
            pairs = np.flatnonzero(widths == width)
            rows = block_row[widths[pair_of_row] == width].reshape(-1, width)
            found.append(MovingRows(pairs, rows, weights[pairs, :, :width]))
        return found
