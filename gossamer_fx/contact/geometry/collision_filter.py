"""The collision filter: parts that constraints keep together do not form pairs.

Cells of one film that share a node cannot be kept apart.  The same holds where a `Tie` or a `BallJoint`
joins bodies.  Every point therefore gets labels: two primitives with a label in common are connected.

    1. The nodes of all bodies that are tied node to node form groups; a group is one label.
    2. A node that is tied to a point between other nodes, on an edge of another mesh, has the labels of
       these nodes in addition to its own.
    3. Lines may be tied to lines that are tied: step 2 is repeated until no label is added.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_matrix, identity
from scipy.sparse.csgraph import connected_components

from gossamer_fx.algebra.point_measures import PointMeasure, evaluated_here
from gossamer_fx.contact.arrays import Int32Array, Int64Array
from gossamer_fx.model.body import Attached, Body, Port
from gossamer_fx.terms.assembly import Assembly
from gossamer_fx.terms.point_constraints import PointConstraint

# The measure x_a - x_b of two points a, b, which a tie keeps at zero.
POINT_DIFFERENCE = np.hstack([np.eye(3), -np.eye(3)])


def filter_labels(
    system: Assembly,
    bodies: Sequence[Body],
    nodes: Sequence[Int64Array],
    point_count: int,
) -> Int32Array | None:
    """Return labels (m, w) of points, the same on every rank; None if nothing is tied.  Collective.

    Args:
        system: with the constraints of the scene.
        bodies: those of the contact.
        nodes: of each body, the global numbers (k,) of its nodes that are points, in their order.
        point_count: m; points of bodies are the first, and those of obstacles have a label each.
    """
    ties = _ties(system, bodies, nodes)
    # Without ties, cells are filtered by the nodes that they share, which costs no labels.
    if not ties:
        return None
    to_nodes = [(one[0], other[0]) for one, other in ties if len(other) == 1]
    label_count, label = connected_components(_graph(to_nodes, point_count), directed=False)
    to_lines = [
        (label[point], label[end])
        for one, other in ties
        if len(other) > 1
        for point in one
        for end in other
    ]
    connected = identity(label_count, dtype=bool, format="csr") + _graph(to_lines, label_count)
    while True:
        further = connected @ connected
        if further.nnz == connected.nnz:
            break
        connected = further
    return _padded(connected[label], label)


def _ties(
    system: Assembly, bodies: Sequence[Body], nodes: Sequence[Int64Array]
) -> list[tuple[list[int], list[int]]]:
    """Return for each tie the points of both sides, the shorter list first; the same on every rank."""
    starts = np.cumsum([0, *map(len, nodes)])
    point_of = [
        {int(node): int(start) + k for k, node in enumerate(of_body)}
        for of_body, start in zip(nodes, starts[:-1], strict=True)
    ]

    def points(port: Attached) -> list[int]:
        """The points on whose positions a port depends; none if it is of another body."""
        # A tie to the ground or of directions connects no surfaces.
        if not isinstance(port, Port) or any(port.vectors):
            return []
        number = next((k for k, body in enumerate(bodies) if port.body is body), None)
        if number is None:
            return []
        pairs = zip(port.nodes, port.weights, strict=True)
        found = [point_of[number].get(node) for node, weight in pairs if weight]
        if None in found:
            return []
        return [point for point in found if point is not None]

    mine: list[tuple[list[int], list[int]]] = []
    for term in system.terms:
        if isinstance(term, PointConstraint) and _is_coincidence(term.measure):
            for number in evaluated_here(term.measure.ports):
                first, second = term.measure.ports[number]
                mine.append((points(first), points(second)))
    ties: list[tuple[list[int], list[int]]] = []
    # A tie is known to the rank that evaluates it; labels are the same on all ranks.
    for of_rank in system.comm.allgather(mine):
        for one, other in of_rank:
            if one and other:
                # The shorter side is a node; the longer one may be the nodes of an edge.
                shorter, longer = sorted((one, other), key=len)
                ties.append((shorter, longer))
    return ties


def _is_coincidence(measure: PointMeasure) -> bool:
    """Return whether a measure is x_a - x_b: linear, without a constant."""
    is_linear = not measure.H.any() and not measure.c.any()
    return is_linear and np.array_equal(measure.L, POINT_DIFFERENCE)


def _graph(pairs: list[tuple[int, int]], count: int) -> csr_matrix:
    """Return the directed graph of `count` numbers with an edge for each pair."""
    ends = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return csr_matrix((np.ones(len(ends), dtype=bool), ends.T), shape=(count, count))


def _padded(rows: csr_matrix, own: Int64Array) -> Int32Array:
    """Return the columns (m, w) of the rows of a matrix; shorter rows repeat their own label (m,)."""
    widths = np.diff(rows.indptr)
    labels: Int32Array = np.repeat(own[:, None], widths.max(), axis=1).astype(np.int32)
    is_used = np.arange(labels.shape[1]) < widths[:, None]
    labels[is_used] = rows.indices
    return labels
