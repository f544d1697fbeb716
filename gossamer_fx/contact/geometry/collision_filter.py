"""Points that constraints keep in one place: bodies hang together there, as the cells of one film do at a corner."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix, identity
from scipy.sparse.csgraph import connected_components

from gossamer_fx.algebra.point_measures import PointMeasure, evaluated_here
from gossamer_fx.contact.kernels.library import Integers
from gossamer_fx.model.body import Attached, Body, Port
from gossamer_fx.terms.assembly import Assembly
from gossamer_fx.terms.point_constraints import PointConstraint

DIFFERENCE = np.hstack([np.eye(3), -np.eye(3)])


def places_of(
    system: Assembly, bodies: Sequence[Body], nodes: Sequence[npt.NDArray[np.int64]], m: int
) -> Integers | None:
    """Numbers (m, w) of the places of points; those with a number in common hang together.  None: nothing does.

    A point that is tied to a node shares its place; one that is tied between the nodes of a line has the places of
    these nodes beside its own.  Collective; the same on every rank.

    Args:
        nodes: of each of the bodies, those that its points are, in the order of the points.
        m: number of points; those of bodies are the first.
    """
    ties = [
        t.measure
        for t in system.terms
        if isinstance(t, PointConstraint) and _is_coincidence(t.measure)
    ]
    if not ties:
        return None
    starts = np.cumsum([0, *map(len, nodes)])
    numbers = [
        {int(node): int(start) + i for i, node in enumerate(of_body)}
        for of_body, start in zip(nodes, starts, strict=False)
    ]

    def points(port: Attached) -> list[int]:
        """Of the nodes on which a point depends; none, if it belongs to something else."""
        body = next(
            (k for k, b in enumerate(bodies) if isinstance(port, Port) and port.body is b), None
        )
        if body is None or not isinstance(port, Port) or any(port.vectors):
            return []
        of_nodes = [
            numbers[body].get(node) for node, w in zip(port.nodes, port.weights, strict=True) if w
        ]
        return [] if None in of_nodes else [p for p in of_nodes if p is not None]

    own = [measure.ports[i] for measure in ties for i in evaluated_here(measure.ports)]
    mine = [(points(a), points(b)) for a, b in own]
    pairs = [
        sorted(pair, key=len) for part in system.comm.allgather(mine) for pair in part if all(pair)
    ]
    if not pairs:
        return None
    nodal = np.array([(a[0], b[0]) for a, b in pairs if len(b) == 1], dtype=np.int64).reshape(-1, 2)
    count, place = connected_components(_graph(nodal, m), directed=False)
    on_lines = [(place[p], place[q]) for a, b in pairs if len(b) > 1 for p in a for q in b]
    reach = identity(count, dtype=bool, format="csr") + _graph(
        np.array(on_lines, dtype=np.int64).reshape(-1, 2), count
    )
    while (further := reach @ reach).nnz > reach.nnz:  # a line that is tied to a line that is tied
        reach = further
    rows = reach[place]
    widths = np.diff(rows.indptr)
    found = np.repeat(place[:, None], widths.max(), axis=1).astype(np.int32)
    found[np.arange(found.shape[1]) < widths[:, None]] = rows.indices
    return found


def _graph(pairs: npt.NDArray[np.int64], n: int) -> csr_matrix:
    return csr_matrix((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(n, n))


def _is_coincidence(measure: PointMeasure) -> bool:
    """Whether a measure is x_a - x_b."""
    return np.array_equal(measure.L, DIFFERENCE) and not measure.H.any() and not measure.c.any()
