"""Measures of vectors attached to bodies: how they follow from the unknowns, as arrays over many of
them.

A port is a constant linear map of the unknowns of one body (`model.body.Port`).  A measure is a
quadratic function of a few ports, such as half the squared distance of two points.  Springs,
joints, ropes and ties are made of such measures; a kind of terms evaluates all of its measures at
once.

Sizes in this file:

    k   ports of one measure, so that its stacked vectors X have 3k components
    m   measures of the same ports, e.g. the three products of two directors
    n   tuples of ports at which the measures are evaluated on this rank
    D   unknowns on which one tuple depends
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from gossamer_fx.core.algebra.block_entries import Numbers, block_entry
from gossamer_fx.core.algebra.numbering import GlobalIndices, Numbering
from gossamer_fx.core.checks.arguments import Mark
from gossamer_fx.core.checks.errors import check_on_all
from gossamer_fx.core.model.body import Array, Attached, Body, Ground, Port

# Entries of a dense block, per block, from which PETSc takes blocks one by one faster than all in
# one call: the call with all of them first sorts the rows.
LARGE_BLOCK = 50

# Singular values below this fraction of the largest one count as zero.
RANK_TOLERANCE = 1e-12

Ports = tuple[Attached, ...]


def is_evaluated_here(ports: Ports) -> bool:
    """Whether this rank evaluates a tuple of ports: it owns the first node of the first port of a
    body."""
    first = next(port for port in ports if isinstance(port, Port))
    start, end = first.body.block.index_map.local_range
    return bool(start <= first.nodes[0] < end)


def evaluated_here(tuples: Sequence[Ports]) -> list[int]:
    """Which of the tuples of ports this rank evaluates, by index."""
    return [i for i, ports in enumerate(tuples) if is_evaluated_here(ports)]


def refuse_ports_outside(
    comm: MPI.Intracomm,
    bodies: Sequence[Body],
    tuples_by_name: Iterable[tuple[str, Sequence[Ports]]],
) -> None:
    """Raise `InputError` on all ranks if an item, given by its name, has a port of a body that is
    not in the scene on one of them.  Collective; ranks may have different tuples of ports."""
    known = {id(body) for body in bodies}
    message = ""
    for name, tuples in tuples_by_name:
        for port in itertools.chain.from_iterable(tuples):
            if isinstance(port, Port) and id(port.body) not in known:
                message = (
                    f"'{name}' has a port of '{port.body.name}', which is not in the scene; "
                    "add that body to the scene, or return it from `requires` of the item."
                )
    # An error on one rank alone would leave the others waiting in their next message.
    check_on_all(comm, not message, message)


def translation_weight(port: Attached) -> float:
    """Displacement of a port over that of all bodies in a common translation: 1 for a point,
    `Ground` included, and 0 for a director or a difference of points."""
    if isinstance(port, Ground):
        return 1.0
    # A port without vectors means the positions of its nodes.
    vectors = port.vectors or (0,) * len(port.nodes)
    pairs = zip(port.weights, vectors, strict=True)
    return sum((weight for weight, vector in pairs if vector == 0), 0.0)


# The weights of a direction add up to zero: it has no position, and no mass in translation.
PointPort = Annotated[
    Port,
    Mark(
        lambda port: bool(np.isclose(translation_weight(port), 1.0)),
        "a point of a body, as film.port('tip')",
    ),
]


def attach(
    numbering: Numbering, bodies: list[Body], ports: Ports
) -> tuple[GlobalIndices, Array, Array]:
    """Linear map X = P q + offset from the unknowns to the stacked vectors of k ports, not all of
    them `Ground`: global indices (D,) of the unknowns, P (3k, D), with lengths [m] where a point
    depends on a director, else dimensionless, and the offset (3k,), nonzero for ports of the ground
    ([m] for points, [-] for directions).
    """
    indices = []
    offset = np.zeros(3 * len(ports))
    # Port and weight of each node; a node has three columns of P.
    columns: list[tuple[int, float]] = []
    for j, port in enumerate(ports):
        if isinstance(port, Ground):
            offset[3 * j : 3 * j + 3] = port.vector
            continue
        vectors = np.array(port.vectors or (0,) * len(port.nodes))
        nodes = np.array(port.nodes, dtype=np.int64)
        unknowns = numbering.to_global(bodies.index(port.body), nodes)
        rows = np.arange(len(vectors))[:, None]
        indices.append(unknowns[rows, 3 * vectors[:, None] + np.arange(3)].ravel())
        columns += [(j, weight) for weight in port.weights]
    P = np.zeros((3 * len(ports), 3 * len(columns)))
    for k, (j, weight) in enumerate(columns):
        rows_of_port = slice(3 * j, 3 * j + 3)
        columns_of_node = slice(3 * k, 3 * k + 3)
        P[rows_of_port, columns_of_node] = weight * np.eye(3)
    return np.concatenate(indices), P, offset


def attach_all(
    numbering: Numbering, bodies: list[Body], tuples: Sequence[Ports], rows: int
) -> tuple[GlobalIndices, Array, Array]:
    """Maps X = P q + offset from the unknowns to the stacked vectors of n tuples of ports, as
    `attach` has them, as arrays.

    Tuples with fewer unknowns than others take their first one several times, with weight zero.

    Args:
        numbering: global indices of the unknowns of all bodies.
        bodies: of the system, in the order of the numbering.
        tuples: n tuples of k ports each, those of this rank; may be empty.
        rows: 3k, needed where a rank has no tuple.

    Returns:
        Global indices (n, D), maps P (n, rows, D) and offsets (n, rows).  D is the largest number
            of unknowns of a tuple on this rank.
    """
    attached = [attach(numbering, bodies, ports) for ports in tuples]
    n = len(attached)
    D = max((len(unknowns) for unknowns, _, _ in attached), default=0)
    # Arrays of this shape also exist where a rank has no tuple.
    indices = np.zeros((n, D), dtype=PETSc.IntType)
    P = np.zeros((n, rows, D))
    offsets = np.zeros((n, rows))
    for k, (unknowns, map_of_tuple, offset) in enumerate(attached):
        count = len(unknowns)
        indices[k] = unknowns[0]
        indices[k, :count] = unknowns
        P[k, :, :count] = map_of_tuple
        offsets[k] = offset
    return indices, P, offsets


class Measure(ABC):
    """Measures of n tuples of points: functions of a few vectors that are linear maps of the
    unknowns.

    Attributes:
        ports: of each tuple; none if the measures are those of a mesh.
    """

    ports: Sequence[Ports]

    @property
    @abstractmethod
    def kind(self) -> Any:
        """Hashable key of the measures that may be one array."""

    @property
    @abstractmethod
    def count(self) -> int:
        """n."""

    @property
    @abstractmethod
    def here(self) -> list[int]:
        """Which of the tuples this rank evaluates, by index."""

    @staticmethod
    @abstractmethod
    def arrays(numbering: Numbering, bodies: list[Body], measures: Sequence[Any]) -> PointMeasures:
        """Measures of one kind as arrays."""


@dataclass(frozen=True, eq=False)
class PointMeasure(Measure):
    """Quadratic measures e_i = ½ X·H_i X + L_i·X + c_i of the stacked vectors X (3k,) of k ports.

    Args:
        ports: n tuples of k ports, not all of them `Ground`.  A tuple is evaluated on the rank of
            its first port; each rank may list all tuples, or its own only.
        H: (m, 3k, 3k), symmetric.
        L: (m, 3k).
        c: (m,), or (n, m) where the tuples differ.

    Example:
        Half the squared distance of two points, e = ½ |x_a - x_b|²:

        >>> a = mass.port()
        >>> b = gx.Ground((0.0, 0.0, 0.0))
        >>> difference = np.hstack([np.eye(3), -np.eye(3)])
        >>> H = (difference.T @ difference)[None]
        >>> measure = PointMeasure([(a, b)], H, np.zeros((1, 6)), np.zeros(1))
    """

    ports: Sequence[Ports]
    H: Array
    L: Array
    c: Array

    @property
    def kind(self) -> Any:
        return self.H.shape, nodes_of(self)

    @property
    def count(self) -> int:
        return len(self.ports)

    @property
    def here(self) -> list[int]:
        return evaluated_here(self.ports)

    @staticmethod
    def arrays(
        numbering: Numbering, bodies: list[Body], measures: Sequence[PointMeasure]
    ) -> PointMeasures:
        return PointMeasures(numbering, bodies, measures)

    def at(self, X: Array) -> Array:
        """e (m,) of the stacked vectors X (3k,) of one tuple, where `c` is (m,)."""
        return X @ self.H @ X / 2 + self.L @ X + self.c


def nodes_of(measure: PointMeasure) -> int:
    """The largest number of nodes that one tuple of ports of a measure depends on."""
    counts = []
    for ports in measure.ports:
        counts.append(sum(len(port.nodes) for port in ports if isinstance(port, Port)))
    return max(counts, default=0)


class PointMeasures:
    """Point measures of one kind that this rank evaluates, as arrays: e_i = ½ Y·H_i Y + L_i·Y +
    c_i, Y = P (q - z).

    Measures become one array if they have as many measures m and unknowns D.  z (n, D) is where
    they are stationary, if there is ground: ½|x - g|² of a point g far from the origin would
    otherwise be a small difference of large numbers.

    P is kept only where it has fewer rows than columns, 3k < D, as for the points of a reduced
    film, which depend on many unknowns.  Else H and L are those of Y = q - z, as products with P
    would cost more than they save; in the methods 3k then stands for D.

    In some methods `on`, a slice or an array of indices, picks tuples; the other arguments are then
    those of the picked ones.

    Attributes:
        owner: (n,) index of the measure to which each tuple of ports belongs.
        indices: (n, D) global indices of the unknowns.
        c: (n, m).
        share_unknowns: whether all tuples depend on the same unknowns, as those of a reduced film
            do.
        is_linear: whether no measure is quadratic; `each_is_linear` (n,) of each tuple.
    """

    def __init__(
        self, numbering: Numbering, bodies: list[Body], measures: Sequence[PointMeasure]
    ) -> None:
        """Convert the measures that this rank evaluates to arrays."""
        self.m = measures[0].H.shape[0]
        rows = measures[0].H.shape[1]
        tuples: list[Ports] = []
        constants = []
        counts = []
        for measure in measures:
            here = evaluated_here(measure.ports)
            tuples += [measure.ports[i] for i in here]
            # Constants of a measure may differ from tuple to tuple.
            all_constants = np.broadcast_to(measure.c, (len(measure.ports), self.m))
            constants.append(all_constants[here])
            counts.append(len(here))
        self.owner = np.repeat(np.arange(len(measures)), counts)
        self.indices, P, offset = attach_all(numbering, bodies, tuples, rows)
        self.n, self.D = self.indices.shape
        H = np.array([measure.H for measure in measures])[self.owner]
        L = np.array([measure.L for measure in measures])[self.owner]
        self._z = self._stationary(P, H, L, offset)
        # The measures of X = P (q - z) + X_z, with X_z the vectors at q = z.
        X_z = np.einsum("nax,nx->na", P, self._z) + offset
        HX_z = np.einsum("nmab,nb->nma", H, X_z)
        value_at_z = np.einsum("na,nma->nm", X_z, HX_z / 2 + L)
        self.c = np.concatenate(constants) + value_at_z
        L = HX_z + L
        self._P: Array | None
        self._H: Array
        self._L: Array
        if rows < self.D:
            self._P = P
            self._H = H
            self._L = L
        else:
            self._P = None
            self._H = np.einsum("nax,nmab,nby->nmxy", P, H, P, optimize=True)
            self._L = np.einsum("nax,nma->nmx", P, L)
        many = self._P is not None and self.n > 1
        self.share_unknowns = many and bool((self.indices == self.indices[:1]).all())
        linear_measures = np.array([not measure.H.any() for measure in measures], dtype=bool)
        self.each_is_linear = linear_measures[self.owner]
        self.is_linear = bool(linear_measures.all())
        # The gradient of linear measures is the same in every state; it is computed once.
        self._constant_slope: Array | None = None
        if self.is_linear:
            self._constant_slope = self.forces(self._L)

    def _stationary(self, P: Array, H: Array, L: Array, offset: Array) -> Array:
        """Points z (n, D) of the unknowns about which n sets of m strains ½ X·H X + L·X + c are
        expanded: zero without ports of the ground, else their least-squares stationary points, so
        that no large numbers cancel."""
        z = np.zeros((self.n, self.D))
        slope_of_vectors = np.einsum("nmab,nb->nma", H, offset) + L
        slope = np.einsum("nax,nma->nmx", P, slope_of_vectors)
        for k in np.flatnonzero(offset.any(axis=1)):
            stiffness = (P[k].T @ H[k] @ P[k]).reshape(-1, self.D)
            # The stiffness is singular where a measure does not depend on a direction.
            z[k] = np.linalg.lstsq(stiffness, -slope[k].ravel(), rcond=RANK_TOLERANCE)[0]
        return z

    def vectors(self, q: Array) -> Array:
        """Y (n, 3k) at the unknowns q (n, D)."""
        u = q - self._z
        if self._P is None:
            return u
        return (self._P @ u[..., None])[..., 0]

    def measure(self, Y: Array) -> Array:
        """e (n, m) of Y (n, 3k)."""
        mean_slope = self._times(Y) / 2 + self._L
        return (mean_slope @ Y[..., None])[..., 0] + self.c

    def strain(self, q: Array) -> Array:
        """e (n, m) at the unknowns q (n, D)."""
        if self._constant_slope is None:
            return self.measure(self.vectors(q))
        u = q - self._z
        return (self._constant_slope @ u[..., None])[..., 0] + self.c

    def gradient(self, q: Array) -> Array:
        """∂e/∂q (n, m, D)."""
        if self._constant_slope is not None:
            return self._constant_slope
        return self.forces(self.slope(self.vectors(q)))

    def slope(self, Y: Array, on: Any = slice(None)) -> Array:
        """∂e/∂Y (n, m, 3k) at Y (n, 3k)."""
        return self._times(Y, on) + self._L[on]

    def geometric(self, S: Array, on: Any = slice(None)) -> Array:
        """Σ_i S_i ∂²e_i/∂Y² (n, 3k, 3k) of stresses S (n, m)."""
        return np.einsum("nm,nmab->nab", S, self._H[on])

    def forces(self, f: Array, on: Any = slice(None)) -> Array:
        """Forces (n, j, D) on the unknowns that follow from forces f (n, j, 3k) on Y, j of them on
        each tuple; of the slopes ∂e/∂Y they are the gradients ∂e/∂q."""
        if self._P is None:
            return f
        return f @ self._P[on]

    def stiffness(self, K: Array, on: Any = slice(None)) -> Array:
        """Stiffness (n, D, D) of the unknowns that follows from a stiffness K (n, 3k, 3k) of Y."""
        if self._P is None:
            return K
        P = self._P[on]
        return P.transpose(0, 2, 1) @ (K @ P)

    def sum_of_stiffness(self, K: Array, on: Any = slice(None)) -> Array:
        """The sum (D, D) of `stiffness` over the tuples, all of which have the same unknowns
        (`share_unknowns`)."""
        stored_maps: Any = self._P  # not None where unknowns are shared
        P = stored_maps[on]
        # The sum over the tuples is part of one product of matrices.
        rows = P.shape[0] * P.shape[1]
        KP = (K @ P).reshape(rows, self.D)
        return P.reshape(rows, self.D).T @ KP

    def second(self, v: Array) -> Array:
        """Second derivative D²e[v, v] (n, m) along rates v (n, D)."""
        Y = v
        if self._P is not None:
            Y = (self._P @ v[..., None])[..., 0]
        return np.einsum("na,nmab,nb->nm", Y, self._H, Y, optimize=True)

    def _times(self, Y: Array, on: Any = slice(None)) -> Array:
        """H Y (n, m, 3k).  Matrix products take less time here than np.einsum."""
        return (self._H[on] @ Y[:, None, :, None])[..., 0]


class Gather:
    """Fetch unknowns at arrays of global indices, of any shape, from all ranks in one scatter."""

    def __init__(self, numbering: Numbering, indices: Sequence[GlobalIndices]) -> None:
        """Make the scatter to this rank from the owners of the unknowns.  Collective."""
        self._shapes = [some.shape for some in indices]
        # The empty array gives the result a type if there are no others.
        nothing = np.zeros(0, dtype=PETSc.IntType)
        needed = np.concatenate([nothing, *[some.ravel() for some in indices]])
        ends = itertools.accumulate((some.size for some in indices), initial=0)
        self._parts = list(itertools.pairwise(ends))
        self._values = PETSc.Vec().createSeq(len(needed))
        # Of this rank alone: on several ranks one of PETSc's own communicator would never be freed.
        source = PETSc.IS().createGeneral(needed.astype(PETSc.IntType), comm=PETSc.COMM_SELF)
        self._scatter = PETSc.Scatter().create(numbering.vector(), source, self._values, None)

    def __call__(self, q: PETSc.Vec) -> list[Array]:
        """The values of a vector at the indices, in arrays of their shapes.  Collective."""
        self._scatter.scatter(q, self._values)
        values = self._values.array_r.copy()
        found = []
        for (start, end), shape in zip(self._parts, self._shapes, strict=True):
            found.append(values[start:end].reshape(shape))
        return found

    def add(self, values: Array, r: PETSc.Vec) -> None:
        """Add values of all index arrays, one array after the other as (n,), to a distributed
        vector, which is changed in place.  Values with the same index add up, also those of
        different ranks.  Collective."""
        self._values.array[:] = values.ravel()
        self._scatter.scatter(
            self._values,
            r,
            addv=PETSc.InsertMode.ADD_VALUES,
            mode=PETSc.ScatterMode.REVERSE,
        )


def add_blocks(A: PETSc.Mat, rows: GlobalIndices, columns: GlobalIndices, values: Array) -> None:
    """Add n dense blocks (n, r, c) to a PETSc matrix at their global rows (n, r) and columns (n,
    c); n may be zero, and entries that coincide add up.  The collective assembly is left to the
    caller."""
    n, r, c = values.shape
    # This rank has nothing to add.
    if n == 0:
        return
    if r * c >= LARGE_BLOCK * n:
        for row, column, block in zip(rows, columns, values, strict=True):
            A.setValues(row, column, np.ascontiguousarray(block), addv=PETSc.InsertMode.ADD_VALUES)
        return
    # All rows of all blocks as one compressed sparse matrix, with c entries in each row.
    row_starts = np.arange(0, n * r * c + 1, c, dtype=PETSc.IntType)
    columns_of_rows = np.repeat(columns, r, axis=0)
    A.setValuesIJV(
        row_starts,
        columns_of_rows.ravel().astype(PETSc.IntType),
        values.ravel(),
        addv=PETSc.InsertMode.ADD_VALUES,
        rowmap=rows.ravel().astype(PETSc.IntType),
    )


class FixedBlocks:
    """Blocks of three rows and columns at fixed positions of a matrix, entered in one call."""

    def __init__(
        self, numbering: Numbering, rows: Numbers, columns: Numbers, blocks: Array
    ) -> None:
        """Take the array of the blocks (b, 9), each column by column, whose values may change, and
        the global indices `rows` and `columns` (b,) at which they begin, in ascending order of the
        rows."""
        self._numbering = numbering
        self._block_rows = rows // 3
        self._block_columns = columns // 3
        self._blocks = blocks
        # The last matrix of `add`, and what adds to it if it is on one rank and of fixed pattern.
        self._matrix: PETSc.Mat | None = None
        self._enter: Callable[[], None] | None = None
        # What PETSc takes otherwise.  A matrix whose own blocks have this size takes them as they
        # are, by their numbers.
        if numbering.block_size == 3:
            block_rows, counts = np.unique(self._block_rows, return_counts=True)
            self._rows = block_rows.astype(PETSc.IntType)
            self._starts = np.append(0, np.cumsum(counts)).astype(PETSc.IntType)
            self._columns = self._block_columns.astype(PETSc.IntType)
        else:
            self._rows = (rows[:, None] + np.arange(3)).astype(PETSc.IntType)
            self._columns = (columns[:, None] + np.arange(3)).astype(PETSc.IntType)

    def add(self, A: PETSc.Mat) -> None:
        """Add the blocks to a matrix, which is not assembled afterwards."""
        if A is not self._matrix:
            self._matrix = A
            self._enter = None
            if A is self._numbering.fixed:
                self._enter = block_entry(A, self._block_rows, self._block_columns, self._blocks)
        if self._enter is not None:
            self._enter()
            A.stateIncrease()
            return
        blocks = self._blocks.reshape(-1, 3, 3).transpose(0, 2, 1)
        if self._numbering.block_size == 3:
            A.setValuesBlockedIJV(
                self._starts,
                self._columns,
                blocks.ravel(),
                addv=PETSc.InsertMode.ADD_VALUES,
                rowmap=self._rows,
            )
        else:
            add_blocks(A, self._rows, self._columns, blocks)
