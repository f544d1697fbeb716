"""Connected parts of a scene: unknowns between which no entry of a matrix makes a link."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from gossamer_fx.core.model.body import Array
from gossamer_fx.solve.system.system import System

Labels = npt.NDArray[np.int64]

# Entries below this fraction of the largest of their row are round-off, and connect nothing.
NEGLIGIBLE_ENTRY = 1e-14


def connected(
    system: System, A: PETSc.Mat, left_out: Labels | None = None, *, with_zeros: bool = False
) -> Labels:
    """Labels (n,) of the unknowns of this rank, equal where entries of a matrix A connect them, or
    where they are components of one node that are not among `left_out`.  `with_zeros`: entries that
    are zero or round-off now connect, too, as of a slack rope.  Collective."""
    numbering = system.unknowns.numbering
    n = numbering.size_local
    rows, columns, _ = entries(A, least=-1.0 if with_zeros else NEGLIGIBLE_ENTRY)
    is_left_out = np.zeros(n, dtype=bool)
    if left_out is not None:
        is_left_out[left_out] = True

    # Edges between unknowns of this rank, numbered from 0, and those of other ranks, numbered from
    # n.
    is_own = (columns >= numbering.start) & (columns < numbering.start + n)
    others, index = np.unique(columns[~is_own], return_inverse=True)
    targets = columns.copy()
    targets[is_own] -= numbering.start
    targets[~is_own] = n + index

    # The components of a node belong together, even if no stiffness couples them.
    node_sources, node_targets = _edges_within_nodes(system, is_left_out)
    sources = np.concatenate([rows, node_sources])
    targets = np.concatenate([targets, node_targets])
    size = n + len(others)
    ones = np.ones(len(sources), dtype=np.int8)
    graph = csr_matrix((ones, (sources, targets)), shape=(size, size))
    count, component = connected_components(graph, directed=False)
    return _common_labels(system, component, count, others)


def _edges_within_nodes(system: System, is_fixed: npt.NDArray[np.bool_]) -> tuple[Labels, Labels]:
    """Edges of a graph that connect the free components of each node with each other: unknowns (m,)
    at their first and second ends."""
    sources: list[Labels] = []
    targets: list[Labels] = []
    for body in system.unknowns.bodies:
        owned = system.unknowns.block(body).owned
        unknowns = np.arange(owned.start, owned.stop)
        components = unknowns.reshape(-1, body.block.size)
        for i in range(1, body.block.size):
            first = components[:, i - 1]
            second = components[:, i]
            are_free = ~is_fixed[first] & ~is_fixed[second]
            sources.append(first[are_free])
            targets.append(second[are_free])
    return np.concatenate(sources), np.concatenate(targets)


def _common_labels(system: System, component: Labels, count: int, others: Labels) -> Labels:
    """Labels of the parts of this rank's unknowns (n,) that agree on all ranks: the smallest index
    of an unknown in the part.  `component` has the parts, of `count`, on this rank alone: of its n
    unknowns, and then of those of other ranks with the global indices `others`.  Collective."""
    n = system.unknowns.numbering.size_local
    own_indices = system.unknowns.numbering.start + np.arange(n)
    smallest = np.full(count, np.iinfo(np.int64).max)
    np.minimum.at(smallest, component[:n], own_indices)
    vector = system.unknowns.numbering.vector()
    received = PETSc.Vec().createSeq(len(others))
    source = PETSc.IS().createGeneral(others.astype(PETSc.IntType), comm=MPI.COMM_SELF)
    scatter = PETSc.Scatter().create(vector, source, received, None)
    # A part may extend over many ranks, so that the smallest index spreads from rank to rank.
    has_changed = True
    while has_changed:
        vector.array[:] = smallest[component[:n]]
        scatter.scatter(vector, received)
        before = smallest.copy()
        np.minimum.at(smallest, component[n:], received.array_r.astype(np.int64))
        changed_here = bool((before != smallest).any())
        has_changed = system.comm.allreduce(changed_here, op=MPI.LOR)
    return smallest[component[:n]]


def entries(K: PETSc.Mat, least: float = NEGLIGIBLE_ENTRY) -> tuple[Labels, Labels, Array]:
    """Local rows, global columns and values of the entries of K that are more than a share of the
    largest of their row, by default more than round-off."""
    pointers, columns, values = K.convert("aij", PETSc.Mat()).getValuesCSR()
    size = len(pointers) - 1
    rows = np.repeat(np.arange(size), np.diff(pointers))
    magnitudes = np.abs(values)
    largest = np.zeros(size)
    np.maximum.at(largest, rows, magnitudes)
    kept = magnitudes > least * largest[rows]
    return rows[kept].astype(np.int64), columns[kept].astype(np.int64), values[kept]
