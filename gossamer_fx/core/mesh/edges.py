"""Edges of a triangle mesh: their ends, the triangles on both sides, and the nodes along them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from dolfinx import mesh as dmesh

from gossamer_fx.core.forms.backend import cell_nodes

Indices = npt.NDArray[np.int32]
Integers = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

# Edge i of the reference triangle lies opposite vertex i.  A triangle passes it from vertex i + 1
# to vertex i + 2, counted modulo 3, which is counterclockwise.
_FROM = np.array([1, 2, 0])
_TO = np.array([2, 0, 1])


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """Edges of a triangle mesh on one rank: the `owned` ones first, then ghosts.

    Every edge has a direction on which all ranks agree: from the end with the lower global number
    to the other end.  A triangle passes its edges in the order of its vertices, counterclockwise
    about its normal.  The triangle on the left of an edge passes it forwards, from its start to its
    end.

    Where two triangles pass an edge in the same direction (their normals are opposite), the second
    one is stored in the free column; a third triangle and further ones are not stored.

    Both triangles of an owned edge are on its rank if the mesh has ghosts that share facets, as
    meshes of `read_mesh` and `gmsh_mesh` have; `is_known` tests it.

    Attributes:
        domain: the mesh.
        owned: number of edges that this rank owns.
        vertices: local vertices (n, 2), start and end.
        cells: local triangles (n, 2) on the left and on the right; -1 where there is none.
        sides: number of the edge, 0 to 2, in these triangles (n, 2); -1 where there is none.
        count: triangles at the edge on all ranks (n,): 1 on the boundary, 2 inside, more where
            several sheets meet.

    >>> import gossamer_fx as gx
    >>> from mpi4py import MPI
    >>> def square(model):
    ...     model.occ.addRectangle(0, 0, 0, 1, 1)
    ...     model.occ.synchronize()
    ...     model.mesh.setSize(model.getEntities(0), 1.0)
    ...     model.mesh.generate(2)
    >>> table = gx.gmsh_mesh(square, MPI.COMM_SELF).edges
    >>> int(table.is_boundary.sum())
    4
    """

    domain: dmesh.Mesh
    owned: int
    vertices: Indices
    cells: Indices
    sides: Indices
    count: Integers

    @property
    def ends(self) -> Integers:
        """Global numbers (n, 2) of the start and the end of each edge."""
        return _global_vertices(self.domain.topology, self.vertices)

    @property
    def is_boundary(self) -> npt.NDArray[np.bool_]:
        """Whether each edge (n,) belongs to one triangle only."""
        return self.count == 1

    @property
    def is_inside(self) -> npt.NDArray[np.bool_]:
        """Whether each edge (n,) lies between two triangles."""
        return self.count == 2

    @property
    def is_known(self) -> npt.NDArray[np.bool_]:
        """Whether `cells` contains all triangles of each edge (n,), owned or ghost."""
        return (self.cells >= 0).sum(axis=1) == self.count

    @cached_property
    def opposite(self) -> Indices:
        """Local vertices (n, 2) of the left and the right triangle that are not on the edge; -1
        where there is no triangle."""
        corners = _corners(self.domain.topology)
        vertices = np.where(self.cells >= 0, corners[self.cells, self.sides], -1)
        return vertices.astype(np.int32)

    def nodes(self, space: fem.FunctionSpace, edges: Indices) -> Indices:
        """Local nodes (k, order + 1) of a Lagrange space of order 1 or 2 along some edges (k,),
        from start to end; without meaning for edges that have no triangle on this rank."""
        layout = space.dofmap.dof_layout
        # Nodes of the reference triangle: those on edge i and at its ends, and that at vertex i.
        closure = np.array([layout.entity_closure_dofs(1, i) for i in range(3)])
        corners = np.array([layout.entity_closure_dofs(0, i)[0] for i in range(3)])

        # Any triangle of the edge will do: the left one if there is one.
        column = np.where(self.cells[edges, 0] >= 0, 0, 1)
        cells = self.cells[edges, column]
        sides = self.sides[edges, column]
        first_vertex = _corners(self.domain.topology)[cells, _FROM[sides]]
        forwards = first_vertex == self.vertices[edges, 0]
        first = corners[np.where(forwards, _FROM[sides], _TO[sides])]
        last = corners[np.where(forwards, _TO[sides], _FROM[sides])]
        # The closure lists both ends first; what follows is the middle node of order 2.
        middle = [closure[sides, k] for k in range(2, closure.shape[1])]
        node_in_cell = np.stack([first, *middle, last], axis=1)
        return cell_nodes(space)[cells[:, None], node_in_cell]

    def tally(self, cells: Indices) -> tuple[Floats, Floats]:
        """For each owned edge the number of the given triangles at it, and the sum of the
        directions in which they pass it: +1 forwards, -1 backwards, so that it is zero where two
        triangles have the same orientation.  Ghosts among the local numbers (m,) are ignored, since
        their owners count them.  Collective."""
        return _tally(self.domain, cells, self.owned)


def edges_of(domain: dmesh.Mesh) -> EdgeTable:
    """Create the table of edges of a triangle mesh.  Collective; `Mesh.edges` stores it."""
    topology = domain.topology
    topology.create_entities(1)
    for from_dim, to_dim in ((1, 0), (2, 1), (2, 0)):
        topology.create_connectivity(from_dim, to_dim)
    index_map = topology.index_map(1)
    owned = index_map.size_local
    n = owned + index_map.num_ghosts

    # Turn each edge so that its start has the lower global number.
    vertices = topology.connectivity(1, 0).array.reshape(-1, 2)
    numbers = _global_vertices(topology, vertices)
    is_rising = numbers[:, 0] < numbers[:, 1]
    vertices = np.where(is_rising[:, None], vertices, vertices[:, ::-1])
    vertices = vertices.astype(np.int32)

    cells, sides = _triangles_at_edges(topology, vertices, n)

    local_cells = np.arange(len(_corners(topology)), dtype=np.int32)
    count = la.vector(index_map)
    count.array[:owned] = _tally(domain, local_cells, owned)[0]
    count.scatter_forward()
    return EdgeTable(
        domain=domain,
        owned=owned,
        vertices=vertices,
        cells=cells,
        sides=sides,
        count=np.rint(count.array).astype(np.int64),
    )


def _triangles_at_edges(
    topology: dmesh.Topology, vertices: Indices, n: int
) -> tuple[Indices, Indices]:
    """Local triangles (n, 2) on the left and on the right of edges with the vertices (n, 2), and
    the number of the edge in them (n, 2), 0 to 2; -1 on a side without a triangle.

    The triangle on the left passes the edge from its start to its end.  A third triangle of an edge
    is left out.
    """
    edges = topology.connectivity(2, 1).array.reshape(-1, 3)
    corners = _corners(topology)
    is_forwards = (corners[:, _FROM] == vertices[edges, 0]).ravel()

    # All pairs of a triangle and one of its edges, sorted by edge.  At each edge those come first
    # that pass it forwards; global numbers make the order the same on all ranks.
    cell, side = (index.ravel() for index in np.indices(edges.shape))
    local_cells = np.arange(len(edges), dtype=np.int32)
    global_cells = topology.index_map(2).local_to_global(local_cells)
    order = np.lexsort((global_cells[cell], ~is_forwards, edges.ravel()))
    edge = edges.ravel()[order]
    cell = cell[order]
    side = side[order]
    is_forwards = is_forwards[order]

    # The first pair of an edge goes to the left column and the second to the right one; if the
    # first one passes the edge backwards (none passes it forwards), it is the other way round.
    starts = np.searchsorted(edge, np.arange(n))
    position = np.arange(len(edge)) - starts[edge]
    first_is_backwards = (position == 0) & ~is_forwards
    column = np.where(first_is_backwards, 1, position)
    column = np.where((position == 1) & first_is_backwards[starts[edge]], 0, column)

    # The third triangle of an edge, and further ones, are not stored.
    kept = column < 2
    cells = np.full((n, 2), -1, dtype=np.int32)
    sides = np.full((n, 2), -1, dtype=np.int32)
    cells[edge[kept], column[kept]] = cell[kept]
    sides[edge[kept], column[kept]] = side[kept]
    return cells, sides


def _tally(domain: dmesh.Mesh, cells: Indices, n: int) -> tuple[Floats, Floats]:
    """Number of triangles (n,) at each of the n owned edges, and the sum (n,) of the directions in
    which they pass it, +1 or -1; of the local `cells`, ghosts are ignored.  Collective."""
    topology = domain.topology
    owned_cells = cells[cells < topology.index_map(2).size_local]
    edges = topology.connectivity(2, 1).array.reshape(-1, 3)[owned_cells]
    numbers = _global_vertices(topology, _corners(topology)[owned_cells])
    is_rising = numbers[:, _FROM] < numbers[:, _TO]
    direction = np.where(is_rising, 1.0, -1.0)
    count = _sum_at_edges(topology, edges, np.ones_like(direction))
    sum_of_directions = _sum_at_edges(topology, edges, direction)
    return count[:n], sum_of_directions[:n]


def _sum_at_edges(topology: dmesh.Topology, edges: Indices, values: Floats) -> Floats:
    """Sum over all ranks of values that this rank contributes at some of its edges."""
    vector = la.vector(topology.index_map(1))
    np.add.at(vector.array, edges, values)
    # Contributions to ghost edges go to the ranks that own them.
    vector.scatter_reverse(la.InsertMode.add)
    return vector.array


def _corners(topology: dmesh.Topology) -> Indices:
    """Local vertices (n, 3) of all local triangles."""
    return topology.connectivity(2, 0).array.reshape(-1, 3)


def _global_vertices(topology: dmesh.Topology, vertices: Indices) -> Integers:
    """Global numbers of local vertices, in an array of the same shape."""
    flat = vertices.ravel().astype(np.int32)
    numbers: Integers = topology.index_map(0).local_to_global(flat)
    return numbers.reshape(vertices.shape)
