"""The collision filter: parts that constraints keep together do not form pairs.

Cells of one film that share a node cannot be kept apart.  The same holds where a `Tie` or a
`BallJoint` joins bodies.  Every point therefore gets labels: two primitives with a label in common
are connected.

    1. The nodes of all bodies that are tied node to node form groups; a group is one label.
    2. A node that is tied to a point between other nodes, on an edge of another mesh, has the
       labels of these nodes in addition to its own.
    3. Lines may be tied to lines that are tied: step 2 is repeated until no label is added.
    4. A point between nodes of order 2 that are all tied has their labels, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_matrix, identity
from scipy.sparse.csgraph import connected_components

from gossamer_fx.core.algebra.point_measures import PointMeasure, evaluated_here
from gossamer_fx.core.model.body import Attached, Body, Port
from gossamer_fx.mechanics.contact.contract import Array, Int64Array, MaskArray
from gossamer_fx.mechanics.contact.geometry.facets import DistributedRows
from gossamer_fx.mechanics.contact.geometry.surface_share import SurfacePoints, SurfaceTables
from gossamer_fx.mechanics.terms.assembly import Assembly
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint

# The measure x_a - x_b of two points a, b, which a tie keeps at zero.
POINT_DIFFERENCE = np.hstack([np.eye(3), -np.eye(3)])


@dataclass(frozen=True)
class TiedLabels:
    """Labels of the t points that are tied; any other point has its own number as its only label.

    Attributes:
        numbers: of the tied points (t,), ascending.
        labels: numbers (t, w) of points that stand for what each is connected to.
        coincident: number (t,) of the first of the points that are tied node to node.
    """

    numbers: Int64Array
    labels: Int64Array
    coincident: Int64Array

    def labels_of(self, numbers: Int64Array) -> Int64Array:
        """Return the labels (m, w) of points, given their numbers (m,) over all ranks.  All labels
        of a point that is not tied are its number."""
        row, is_tied = self._rows(numbers)
        own = np.repeat(numbers[:, None], self.labels.shape[1], axis=1)
        return np.where(is_tied[:, None], self.labels[row], own)

    def edge_shares(self, surface: SurfaceTables, radii: Array, comm: MPI.Intracomm) -> Array:
        """Return the share (e,) of each edge in the area of all edges with which it coincides, as
        their ends are tied node to node; of an edge that is alone, 1.  Collective.

        Only edges of bodies with the same radius coincide: a rope on a film touches at another
        distance than its edges.  `radii`: of the bodies [m] (b,).
        """
        edges = surface.edges
        row, is_tied = self._rows(edges.points)
        ends = np.sort(np.where(is_tied, self.coincident[row], edges.points), axis=1)
        body = surface.points.body[surface.point_indices(edges.points[:, 0])]
        radius = np.unique(radii, return_inverse=True)[1][body]
        keys = np.column_stack([ends, radius])
        # Two ranks know an edge on their boundary; the owner counts its area.
        own_area = np.where(edges.owner == comm.rank, edges.area, 0.0)
        last = comm.allreduce(int(ends.max(initial=0)), op=MPI.MAX)
        area = DistributedRows(comm, keys, last + 1).sums(own_area)
        # Cables without a radius have no area.
        return np.divide(edges.area, area, out=np.ones(len(area)), where=area > 0)

    def with_points_between(self, points: SurfacePoints, comm: MPI.Intracomm) -> TiedLabels:
        """Return these labels and those of points between nodes that are all tied, step 4 of the
        module; collective.  Points whose nodes are tied node to node, with the same weights, are
        tied, too."""
        between: dict[int, dict[int, float]] = {}
        node_number = points.numbers_of_nodes()
        is_tied = np.isin(node_number, self.numbers) | (points.weights == 0)
        for k in np.flatnonzero(~points.is_node & is_tied.all(axis=1)):
            used = points.weights[k] != 0
            weights = map(float, points.weights[k, used])
            between[int(points.number[k])] = dict(
                zip(map(int, node_number[k, used]), weights, strict=True)
            )
        # Ties are along lines: unlike facets, all ranks know them.
        for of_rank in comm.allgather(between):
            between |= of_rank
        if not between:
            return self
        coincident = dict(zip(map(int, self.numbers), map(int, self.coincident), strict=True))
        labels: dict[int, list[int]] = {}
        for tied, row in zip(self.numbers, self.labels, strict=True):
            labels[int(tied)] = [int(label) for label in np.atleast_1d(row)]
        first: dict[frozenset[tuple[int, float]], int] = {}
        for number, weight_of in sorted(between.items()):
            position = frozenset((coincident[node], weight) for node, weight in weight_of.items())
            coincident[number] = first.setdefault(position, number)
            labels[number] = [coincident[number]]
            for node in weight_of:
                labels[number] += labels[node]
        numbers = sorted(labels)
        width = max(map(len, labels.values()))
        # Labels may be repeated.
        rows = [labels[number] + labels[number][:1] * width for number in numbers]
        return TiedLabels(
            numbers=np.array(numbers, dtype=np.int64),
            labels=np.array([row[:width] for row in rows], dtype=np.int64),
            coincident=np.array([coincident[number] for number in numbers], dtype=np.int64),
        )

    def _rows(self, numbers: Int64Array) -> tuple[Int64Array, MaskArray]:
        """Return the rows of points with some numbers in this table, and which of them are tied;
        the row of any other point has no meaning."""
        row = np.minimum(np.searchsorted(self.numbers, numbers), len(self.numbers) - 1)
        return row, self.numbers[row] == numbers


def tied_labels(
    system: Assembly, bodies: Sequence[Body], points: SurfacePoints
) -> TiedLabels | None:
    """Return the labels of all points that ties or joints connect, the same on every rank; None:
    there are none.  Collective.  Ties are along lines: unlike facets, all ranks know them."""
    ties = _ties(system, bodies, points)
    # Without ties, cells are filtered by the nodes that they share, which costs no labels.
    if not ties:
        return None
    tied = [point for sides in ties for side in sides for point in side]
    numbers = np.unique(np.array(tied, dtype=np.int64))
    index = {int(number): k for k, number in enumerate(numbers)}
    count = len(numbers)
    # Step 1 of the module: `label` (t,) is the group of each point.
    to_nodes = [(index[one[0]], index[other[0]]) for one, other in ties if len(other) == 1]
    label_count, label = connected_components(_graph(to_nodes, count), directed=False)
    to_lines = [
        (label[index[point]], label[index[end]])
        for one, other in ties
        if len(other) > 1
        for point in one
        for end in other
    ]
    # Steps 2 and 3: which labels (row) are connected to which others (column).
    connected = identity(label_count, dtype=bool, format="csr") + _graph(to_lines, label_count)
    while True:
        further = connected @ connected
        if further.nnz == connected.nnz:
            break
        connected = further
    # The point with the lowest number stands for all that are one: no other point has this label.
    _, first = np.unique(label, return_index=True)
    coincident = numbers[first]
    of_nodes = TiedLabels(
        numbers,
        labels=coincident[_padded(connected[label], label)],
        coincident=coincident[label],
    )
    return of_nodes.with_points_between(points, system.comm)


def _ties(
    system: Assembly, bodies: Sequence[Body], points: SurfacePoints
) -> list[tuple[list[int], list[int]]]:
    """Return the ties between bodies of a contact, the same on every rank; collective.

    A tie is a constraint that two points coincide: the number of one point, and the numbers of
    those on which the other point depends, one or more.  Ties to the ground and to other bodies are
    left out.
    """

    def nodes(port: Attached) -> list[tuple[int, int]]:
        """Return number of the body and node, for each node on whose position a port depends. Empty
        if the port is a direction, a point of the ground, or of a body that is not in the
        contact."""
        # A tie to the ground or of directions connects no surfaces.
        if not isinstance(port, Port) or any(port.vectors):
            return []
        number = next((k for k, body in enumerate(bodies) if port.body is body), None)
        if number is None:
            return []
        pairs = zip(port.nodes, port.weights, strict=True)
        return [(number, int(node)) for node, weight in pairs if weight]

    mine: list[tuple[list[tuple[int, int]], list[tuple[int, int]]]] = []
    for term in system.terms:
        if isinstance(term, PointConstraint) and _is_coincidence(term.measure):
            for number in evaluated_here(term.measure.ports):
                first, second = term.measure.ports[number]
                mine.append((nodes(first), nodes(second)))
    # A tie is known to the rank that evaluates it; labels are the same on all ranks.
    found = [tie for of_rank in system.comm.allgather(mine) for tie in of_rank]
    found = [(one, other) for one, other in found if one and other]
    wanted = sorted({node for sides in found for side in sides for node in side})
    number_of = _numbers_of(wanted, points, system.comm)
    ties: list[tuple[list[int], list[int]]] = []
    for sides in found:
        numbers = [[number_of[node] for node in side] for side in sides]
        # A node that is not a point of the surface connects nothing.
        if all(number >= 0 for side in numbers for number in side):
            # The shorter side is a node; the longer one may be the nodes of an edge.
            shorter, longer = sorted(numbers, key=len)
            ties.append((shorter, longer))
    return ties


def _numbers_of(
    wanted: list[tuple[int, int]], points: SurfacePoints, comm: MPI.Intracomm
) -> dict[tuple[int, int], int]:
    """Return the numbers of points by body and node; -1 for a node that is not a point of a
    surface.  Collective: a rank knows some of them."""
    if not wanted:
        return {}
    # One number for body and node.
    nodes = [node for _, node in wanted]
    is_node = points.is_node
    node = points.nodes[is_node, 0]
    base = 1 + max(*nodes, int(node.max(initial=0)))
    asked = np.array(wanted, dtype=np.int64) @ [base, 1]
    known = points.body[is_node] * base + node
    _, found, row = np.intersect1d(asked, known, assume_unique=True, return_indices=True)
    numbers = np.full(len(wanted), -1, dtype=np.int64)
    numbers[found] = points.number[is_node][row]
    comm.Allreduce(MPI.IN_PLACE, numbers, op=MPI.MAX)
    return dict(zip(wanted, map(int, numbers), strict=True))


def _is_coincidence(measure: PointMeasure) -> bool:
    """Return whether a measure is x_a - x_b: linear, without a constant."""
    is_linear = not measure.H.any() and not measure.c.any()
    return is_linear and np.array_equal(measure.L, POINT_DIFFERENCE)


def _graph(pairs: list[tuple[int, int]], count: int) -> csr_matrix:
    """Return the directed graph of the numbers below `count` with an edge for each pair."""
    ends = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return csr_matrix((np.ones(len(ends), dtype=bool), ends.T), shape=(count, count))


def _padded(rows: csr_matrix, own: Int64Array) -> Int64Array:
    """Return the columns (m, w) with an entry in each of m sparse rows, w being the length of the
    longest one.  `own` (m,) fills the rows with fewer columns."""
    widths = np.diff(rows.indptr)
    labels: Int64Array = np.repeat(own[:, None], widths.max(), axis=1).astype(np.int64)
    is_used = np.arange(labels.shape[1]) < widths[:, None]
    labels[is_used] = rows.indices
    return labels
