"""Points, edges and triangles that may touch, and the surface of a body made of them.

They are named by rows of integers, and numbered over all ranks without gathering them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.rank_exchange import RankExchange
from gossamer_fx.core.forms.backend import geometry_nodes
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
    between two ranks are on both.  Cells of order 2 are cut into flat pieces, whose corners are
    points of the curved cell: sums of its nodes, weighted by the shape functions.  Points are
    numbered by the vertices of the mesh file, so that their numbers do not depend on the number of
    ranks.

    Attributes:
        nodes: global numbers (n, w), among the nodes of the body, of those that move each point; a
            point that is a node has this one first.
        weights: of these nodes in each point (n, w); zero where a point has fewer than w nodes.
        X: positions (n, 3) in the stress-free shape [m].
        area_factors: area (n,) for which each point stands, over its share of the pieces round it.
        rows: numbers, owners and sums of the points over all ranks.
        triangles: (t, 3) points, as indices of the arrays above; none for cables and beams.
        lines: (l, 2) points, as indices; none for films.
    """

    nodes: Int64Array
    weights: Array
    X: Array
    area_factors: Array
    rows: DistributedRows
    triangles: Int32Array
    lines: Int32Array

    def widened(self, width: int) -> Facets:
        """Return the same with `width` nodes for each point, of which the last have no weight."""
        added = width - self.nodes.shape[1]
        return replace(
            self,
            nodes=np.hstack([self.nodes, np.repeat(self.nodes[:, :1], added, axis=1)]),
            weights=np.pad(self.weights, [(0, 0), (0, added)]),
        )


def facets_of(body: MeshBody, piece_count: int) -> Facets:
    """Return this rank's points of a film, cable or beam and the flat pieces between them;
    collective.  `piece_count`: into how many pieces each edge is cut, see `curved_cells`."""
    space = body.space
    mesh = space.mesh
    dimension = mesh.topology.dim
    # Each rank brings the cells that it owns; together they are all cells, each once.
    own_count = mesh.topology.index_map(dimension).size_local
    dofs = space.dofmap.list[:own_count]
    lattice = CellLattice.of(dimension, dofs.shape[1], piece_count)

    corners = geometry_nodes(mesh)[:own_count, : dimension + 1]
    vertices = mesh.geometry.input_global_indices[corners].astype(np.int64)
    # A point is named by as many vertices as an edge has pieces, ascending: each as often as its
    # part in the point is.
    names = np.sort(vertices[:, lattice.corners], axis=2).reshape(-1, piece_count)
    # Sorting by name makes one point of those that cells share.
    points, first, point = np.unique(names, axis=0, return_index=True, return_inverse=True)
    cell, lattice_point = np.divmod(first, len(lattice.corners))
    dofs_of_points = dofs[cell[:, None], lattice.nodes[lattice_point]]
    weights = lattice.weights[lattice_point]
    last_vertex = body.comm.allreduce(int(names.max(initial=0)), op=MPI.MAX)
    X = space.tabulate_dof_coordinates()[dofs_of_points]

    pieces = point.reshape(own_count, len(lattice.corners))[:, lattice.pieces]
    sorted_facets = np.sort(pieces.reshape(-1, dimension + 1), axis=1)
    ordered: Int32Array = sorted_facets[np.lexsort(sorted_facets.T[::-1])].astype(np.int32)
    is_film = dimension == 2
    no_triangles: Int32Array = np.zeros((0, 3), dtype=np.int32)
    no_lines: Int32Array = np.zeros((0, 2), dtype=np.int32)
    numbers = body.block.index_map.local_to_global(dofs_of_points.ravel().astype(np.int32))
    return Facets(
        nodes=numbers.reshape(dofs_of_points.shape),
        weights=weights,
        X=np.einsum("nw,nwc->nc", weights, X),
        area_factors=lattice.area_factors[lattice_point],
        rows=DistributedRows(body.comm, points, last_vertex + 1),
        triangles=ordered if is_film else no_triangles,
        lines=no_lines if is_film else ordered,
    )


@dataclass(frozen=True)
class CellLattice:
    """The p points into which n pieces along each edge cut one cell with d dofs.

    A uniform load on a cell of order 2 is carried by the nodes in the middle of its edges alone.
    Contact carries it without bending the film if the areas a of the points integrate the shape
    functions N as the load does:

        Σ_i a_i N_k(x_i) = ∫ N_k dA    for every node k                                        (1)

    The shares of the pieces round a point do so for linear functions only.  The areas are those
    that are nearest to these shares, relative to them, among all that fulfil (1); on a line with
    two pieces they are Simpson's rule.  Two pieces along the edges of a triangle leave nothing to
    its corners, which would not touch; from three on all areas are above zero.

    Attributes:
        corners: the vertices (p, n) of the cell that name each point.
        nodes: dofs (p, w) of the cell that move each point; a point on a dof has that first.
        weights: of these dofs in the point (p, w).
        area_factors: area (p,) of each point over its share of the pieces round it.
        pieces: (q, dimension + 1) points.
    """

    corners: Int64Array
    nodes: Int64Array
    weights: Array
    area_factors: Array
    pieces: Int64Array

    @classmethod
    def of(cls, dimension: int, dof_count: int, piece_count: int) -> CellLattice:
        """Return the lattice of a line or triangle; with one piece its points are the vertices."""
        corners = np.array(list(combinations_with_replacement(range(dimension + 1), piece_count)))
        # Barycentric coordinates times the number of pieces, exact integers.
        parts = (corners[:, :, None] == np.arange(dimension + 1)).sum(axis=1)
        edges = EDGES_OF_CELLS[dimension, dof_count]
        shape = _shape_functions(parts / piece_count, edges)
        pieces = _pieces_of_lattice(parts)
        # Dofs with the largest weights first, so that points have the fewest of them.
        order = np.argsort(-np.abs(shape), axis=1, kind="stable")
        width = int((shape != 0).sum(axis=1).max())
        nodes = order[:, :width]
        return cls(
            corners=corners,
            nodes=nodes,
            weights=np.take_along_axis(shape, nodes, axis=1),
            area_factors=_area_factors(shape, pieces) if edges else np.ones(len(corners)),
            pieces=pieces,
        )


def _shape_functions(coordinates: Array, edges: list[tuple[int, int]]) -> Array:
    """Return the shape functions (p, d) of a cell at points with barycentric coordinates (p, k);
    `edges`: those with a middle node, none for order 1."""
    if not edges:
        return coordinates
    middles = [4 * coordinates[:, i] * coordinates[:, j] for i, j in edges]
    return np.column_stack([coordinates * (2 * coordinates - 1), *middles])


def _pieces_of_lattice(parts: Int64Array) -> Int64Array:
    """Return the pieces (q, k) of a cell between the points of its lattice, with barycentric
    integers (p, k): the sets of k points of which each two differ by one step along an edge."""
    index = {part.tobytes(): number for number, part in enumerate(parts)}
    dimension = parts.shape[1] - 1
    # Steps from the corner next to vertex 0 of a piece that lies as the cell does.
    steps = np.eye(dimension + 1, dtype=int) - np.eye(dimension + 1, dtype=int)[0]
    shapes = [steps]
    if dimension == 2:
        # Triangles between those are turned by half a turn.
        shapes.append(-steps)
    pieces = []
    for shape in shapes:
        for part in parts:
            corners = [corner.tobytes() for corner in part + shape]
            if all(corner in index for corner in corners):
                pieces.append([index[corner] for corner in corners])
    return np.array(pieces, dtype=np.int64)


def _area_factors(shape: Array, pieces: Int64Array) -> Array:
    """Return the factors (p,) of `CellLattice` for shape functions (p, d) of order 2."""
    share = np.bincount(pieces.ravel(), minlength=len(shape)) / pieces.size
    dof_count = shape.shape[1]
    vertex_count = 2 if dof_count == 3 else 3
    # ∫ N over the size of the cell: Simpson's rule on a line, the middles of the edges in a
    # triangle.
    of_vertices = 1 / 6 if vertex_count == 2 else 0.0
    integral = np.full(dof_count, (1 - vertex_count * of_vertices) / (dof_count - vertex_count))
    integral[:vertex_count] = of_vertices
    # Least squares of (a - share)²/share under (1).
    moments = shape.T * share
    change, *_ = np.linalg.lstsq(moments @ shape, integral - moments.sum(axis=1), rcond=None)
    factors = 1 + shape @ change
    assert factors.min() > 0, "corners of triangles need three pieces along the edges"
    return np.asarray(factors)


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
