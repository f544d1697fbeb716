"""Points, edges and triangles that may touch, and the surface of a body made of them.

They are named by rows of integers, and numbered over all ranks without gathering them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.rank_exchange import RankExchange
from gossamer_fx.core.forms.backend import geometry_nodes
from gossamer_fx.core.mesh.linear_pieces import linear_pieces
from gossamer_fx.core.model.body import MeshBody
from gossamer_fx.mechanics.contact.contract import Array, ByteArray, Int32Array, Int64Array


class DistributedRows:
    """Rows of which several ranks may have the same one, numbered in lexicographic order.

    Every row is sent to a rank that follows from its first entry.  There equal rows meet, and are
    counted once; numbers, sums and owners come back.

    Args:
        rows: integers (n, w), of this rank.
        bound: more than any first entry.

    Attributes:
        numbers: of this rank's rows (n,); they do not depend on how rows are distributed.
        owners: lowest rank (n,) that has each row.
        count: number of distinct rows on all ranks.
    """

    def __init__(self, comm: MPI.Intracomm, rows: Int64Array, bound: int) -> None:
        """Exchange and number the rows; collective."""
        # Ranges of first entries in the order of the ranks: so numbers are in the order of rows.
        meeting_rank = rows[:, 0] * comm.size // max(bound, 1)
        self._exchange = RankExchange(comm, meeting_rank)
        met = self._exchange.send(rows)
        distinct, row_of = np.unique(met, axis=0, return_inverse=True)
        self._row_of = row_of.ravel()
        self._met_count = len(distinct)
        self.count = comm.allreduce(self._met_count)
        # exscan leaves rank 0 without a value.
        first = int(comm.exscan(self._met_count) or 0)
        self.numbers: Int64Array = self._exchange.answer(first + self._row_of)
        owner = np.full(self._met_count, comm.size)
        np.minimum.at(owner, self._row_of, self._exchange.source)
        self.owners: Int64Array = self._exchange.answer(owner[self._row_of])

    def sums(self, values: Array) -> Array:
        """Return for each row of this rank the sum (n,) of the values that all ranks have for equal
        rows; collective.  `values`: (n,), one for each row of this rank, in any unit."""
        met = self._exchange.send(values)
        total = np.bincount(self._row_of, met, self._met_count).astype(float)
        return self._exchange.answer(total[self._row_of])


# The vertices between which the middle nodes of cells of order 2 lie, for cells of a dimension with
# a number of dofs.  dolfinx numbers the vertices first, then the middles of the edges.
EDGES_OF_CELLS = {(1, 2): [], (1, 3): [(0, 1)], (2, 3): [], (2, 6): [(1, 2), (0, 2), (0, 1)]}


@dataclass(frozen=True)
class Facets:
    """This rank's points of one body that can touch, and the flat pieces between them.

    A rank has the pieces of the cells that it owns and their n points; points on the boundary
    between two ranks are on both.  Cells of order 2 are cut into linear pieces.  Points are
    numbered by the vertices of the mesh file, so that their numbers do not depend on the number of
    ranks.

    Attributes:
        nodes: global numbers (n,) of the points among the nodes of the body.
        X: positions (n, 3) in the stress-free shape [m].
        rows: numbers, owners and sums of the points over all ranks.
        triangles: (t, 3) points, as indices of the arrays above; none for cables and beams.
        lines: (l, 2) points, as indices; none for films.
    """

    nodes: Int64Array
    X: Array
    rows: DistributedRows
    triangles: Int32Array
    lines: Int32Array


def facets_of(body: MeshBody) -> Facets:
    """Return this rank's points of a film, cable or beam and the flat pieces between them;
    collective."""
    space = body.space
    mesh = space.mesh
    dimension = mesh.topology.dim
    # Each rank brings the cells that it owns; together they are all cells, each once.
    own_count = mesh.topology.index_map(dimension).size_local
    dofs = space.dofmap.list[:own_count]
    dof_count = dofs.shape[1]

    corners = geometry_nodes(mesh)[:own_count, : dimension + 1]
    vertices = mesh.geometry.input_global_indices[corners].astype(np.int64)
    names = _names_of_dofs(vertices, dof_count, EDGES_OF_CELLS[dimension, dof_count]).reshape(-1, 2)
    # Sorting by name makes one point of the dofs that cells share.
    points, first, point = np.unique(names, axis=0, return_index=True, return_inverse=True)
    dof_of_point = dofs.ravel()[first].astype(np.int32)
    last_vertex = body.comm.allreduce(int(names.max(initial=0)), op=MPI.MAX)

    sorted_facets = np.sort(linear_pieces(point.reshape(-1, dof_count), dimension), axis=1)
    ordered: Int32Array = sorted_facets[np.lexsort(sorted_facets.T[::-1])].astype(np.int32)
    is_film = dimension == 2
    no_triangles: Int32Array = np.zeros((0, 3), dtype=np.int32)
    no_lines: Int32Array = np.zeros((0, 2), dtype=np.int32)
    return Facets(
        nodes=body.block.index_map.local_to_global(dof_of_point),
        X=space.tabulate_dof_coordinates()[dof_of_point],
        rows=DistributedRows(body.comm, points, last_vertex + 1),
        triangles=ordered if is_film else no_triangles,
        lines=no_lines if is_film else ordered,
    )


def _names_of_dofs(
    vertices: Int64Array, dof_count: int, edges: list[tuple[int, int]]
) -> Int64Array:
    """Return two numbers (c, d, 2) for each of the d = `dof_count` degrees of freedom of c cells,
    by which ranks name it.  They are the vertices, in ascending order, of the edge on which it is;
    a vertex is twice itself.  `vertices`: numbers (c, k) of the cells' vertices in the mesh file;
    `edges`: the vertices (0 to k - 1) of the edges with a middle node."""
    count, vertex_count = vertices.shape
    names = np.zeros((count, dof_count, 2), dtype=np.int64)
    names[:, :vertex_count] = vertices[:, :, None]
    for k, ends in enumerate(edges):
        names[:, vertex_count + k] = np.sort(vertices[:, list(ends)], axis=1)
    return names


# The three sides of a triangle by its corners.
TRIANGLE_SIDES = [[0, 1], [1, 2], [0, 2]]


@dataclass(frozen=True)
class FilteredPrimitives:
    """n primitives of one kind as the broad phase sees them.

    Attributes:
        boxes: least and greatest coordinates (n, 6) [m].
        labels: numbers (n, l); two primitives with one in common are connected, and no pair.
        is_fixed: 1 where contact moves none of its points (n,); two such primitives never form a
            pair.
    """

    boxes: Array
    labels: Int32Array
    is_fixed: ByteArray


@dataclass(frozen=True)
class CollisionPrimitives:
    """Points, edges and triangles that may touch, as numbers of points.

    Attributes:
        vertices: points (p,) that may touch triangles.
        edges: (e, 2).
        triangles: (t, 3).
        is_fixed: 1 for points (m,) that contact does not move, those of obstacles.
        labels: numbers (m, w) of what points are connected to, see `geometry.collision_filter`;
            None: points are connected to nothing but the primitives that they are corners of.
    """

    vertices: Int32Array
    edges: Int32Array
    triangles: Int32Array
    is_fixed: ByteArray
    labels: Int32Array | None = None

    def filtered(self, primitives: Int32Array, lower: Array, upper: Array) -> FilteredPrimitives:
        """Return vertices, edges or triangles as the broad phase sees them.  `primitives`: their
        points (n, 1), (n, 2) or (n, 3); `lower, upper`: corners (m, 3) [m] of a box round each
        point.  The box of a primitive holds those of its points; it is fixed where all of them are.
        """
        # Point by point: along the short axis of (n, k) NumPy takes several times as long.
        corners = primitives.T
        boxes = np.empty((len(primitives), 6))
        np.minimum.reduce(lower[corners], out=boxes[:, :3])
        np.maximum.reduce(upper[corners], out=boxes[:, 3:])
        is_fixed: ByteArray = np.minimum.reduce(self.is_fixed[corners])
        return FilteredPrimitives(boxes, self._labels_of(primitives), is_fixed)

    def _labels_of(self, primitives: Int32Array) -> Int32Array:
        """Return the labels (n, l) of vertices, edges or triangles, those of all their points;
        `primitives`: numbers (n, k) of these, which are the labels if nothing is tied."""
        if self.labels is None:
            return np.ascontiguousarray(primitives)
        count = primitives.shape[1] * self.labels.shape[1]
        return np.ascontiguousarray(self.labels[primitives].reshape(len(primitives), count))
