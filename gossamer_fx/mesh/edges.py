"""The edges of a triangle mesh: their ends, the triangles on both sides, and the nodes of a film along them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from dolfinx import fem, la
from dolfinx import mesh as dmesh

from gossamer_fx.forms.spaces import cell_nodes

Indices = npt.NDArray[np.int32]
Integers = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

# edge i of the reference triangle lies opposite vertex i; a triangle passes it from vertex i + 1 to i + 2
_FROM, _TO = np.array([1, 2, 0]), np.array([2, 0, 1])


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """The edges of a triangle mesh on this rank: the `owned` ones first, then ghosts.

    Every edge has a direction that all ranks agree on: from the end with the lower global number to the other.  A
    triangle passes its edges in the order of its vertices, counterclockwise about its normal; on the left of an edge is
    the triangle that passes it forwards.

    vertices (n, 2)   local vertices: start and end
    cells (n, 2)      local triangles on the left and on the right, -1 for none.  Two that pass an edge in the same
                      direction, with opposite normals that is, and a third one, fill what is left free.
    sides (n, 2)      which edge of these triangles it is, 0 to 2; -1 for none
    count (n,)        triangles at the edge on all ranks: 1 on the boundary, 2 inside, more where sheets meet

    Both triangles of an owned edge are known to its owner if the mesh has ghosts that share facets (as meshes of
    `read_mesh` and `gmsh_mesh` have); `is_known` says where that is so.
    """

    domain: dmesh.Mesh
    owned: int
    vertices: Indices
    cells: Indices
    sides: Indices
    count: Integers

    @property
    def ends(self) -> Integers:
        """Global vertices (n, 2): start and end."""
        return _global_vertices(self.domain.topology, self.vertices)

    @property
    def is_boundary(self) -> npt.NDArray[np.bool_]:
        """Edges (n,) of one triangle only."""
        result: npt.NDArray[np.bool_] = self.count == 1
        return result

    @property
    def is_inside(self) -> npt.NDArray[np.bool_]:
        """Edges (n,) between two triangles."""
        result: npt.NDArray[np.bool_] = self.count == 2
        return result

    @property
    def is_known(self) -> npt.NDArray[np.bool_]:
        """Edges (n,) all triangles of which are on this rank, owned or ghost, and in `cells`."""
        result: npt.NDArray[np.bool_] = (self.cells >= 0).sum(axis=1) == self.count
        return result

    @cached_property
    def opposite(self) -> Indices:
        """Local vertices (n, 2) of the left and right triangle that are not on the edge; -1 for none."""
        corners = _corners(self.domain.topology)
        result: Indices = np.where(self.cells >= 0, corners[self.cells, self.sides], -1).astype(
            np.int32
        )
        return result

    def nodes(self, space: fem.FunctionSpace, edges: Indices) -> Indices:
        """Local nodes (k, order + 1) of a space along some edges, from their start to their end.

        The space is of Lagrange elements of order 1 or 2 on this mesh; each edge needs a triangle on this rank.
        """
        column = np.where(self.cells[edges, 0] >= 0, 0, 1)
        cells, sides = self.cells[edges, column], self.sides[edges, column]
        closure = np.array([space.dofmap.dof_layout.entity_closure_dofs(1, i) for i in range(3)])
        corners = np.array([space.dofmap.dof_layout.entity_closure_dofs(0, i)[0] for i in range(3)])
        forwards = _corners(self.domain.topology)[cells, _FROM[sides]] == self.vertices[edges, 0]
        first = corners[np.where(forwards, _FROM[sides], _TO[sides])]
        last = corners[np.where(forwards, _TO[sides], _FROM[sides])]
        middle = [closure[sides, k] for k in range(2, closure.shape[1])]
        places = np.stack([first, *middle, last], axis=1)
        result = cell_nodes(space)[cells[:, None], places]
        return result

    def tally(self, cells: Indices) -> tuple[Floats, Floats]:
        """How many of the given triangles each owned edge has, and the sum of the directions in which they pass it.

        `cells` are local; those that other ranks own are left to them.  Collective.
        """
        return _tally(self.domain, cells, self.owned)


def edges_of(domain: dmesh.Mesh) -> EdgeTable:
    """The edges of a mesh of triangles.  Collective; `Mesh.edges` keeps it."""
    topology = domain.topology
    topology.create_entities(1)
    for d0, d1 in ((1, 0), (2, 1), (2, 0)):
        topology.create_connectivity(d0, d1)
    index_map, corners = topology.index_map(1), _corners(topology)
    n, owned = index_map.size_local + index_map.num_ghosts, index_map.size_local
    vertices = topology.connectivity(1, 0).array.reshape(-1, 2)
    names = _global_vertices(topology, vertices)
    vertices = np.where((names[:, 0] < names[:, 1])[:, None], vertices, vertices[:, ::-1]).astype(
        np.int32
    )

    edges = topology.connectivity(2, 1).array.reshape(-1, 3)
    forwards = corners[:, _FROM] == vertices[edges, 0]
    # every pair of a triangle and one of its edges, edge by edge, forward ones first, in the order of global numbers
    cell, side = (index.ravel() for index in np.indices(edges.shape))
    local = np.arange(len(edges), dtype=np.int32)
    number = topology.index_map(2).local_to_global(local)
    order = np.lexsort((number[cell], ~forwards.ravel(), edges.ravel()))
    edge, cell, side = edges.ravel()[order], cell[order], side[order]
    starts = np.searchsorted(edge, np.arange(n))
    rank = np.arange(len(edge)) - starts[edge]
    alone_backwards = (rank == 0) & ~forwards.ravel()[order]
    column = np.where(alone_backwards, 1, rank)
    column = np.where((rank == 1) & alone_backwards[starts[edge]], 0, column)
    kept = column < 2
    table = np.full((2, n, 2), -1, dtype=np.int32)
    table[0, edge[kept], column[kept]] = cell[kept]
    table[1, edge[kept], column[kept]] = side[kept]

    count = la.vector(index_map)
    count.array[:owned] = _tally(domain, local, owned)[0]
    count.scatter_forward()
    return EdgeTable(
        domain, owned, vertices, table[0], table[1], np.rint(count.array).astype(np.int64)
    )


def _tally(domain: dmesh.Mesh, cells: Indices, n: int) -> tuple[Floats, Floats]:
    topology = domain.topology
    kept = cells[cells < topology.index_map(2).size_local]
    edges = topology.connectivity(2, 1).array.reshape(-1, 3)[kept]
    names = _global_vertices(topology, _corners(topology)[kept])
    direction = np.where(names[:, _FROM] < names[:, _TO], 1.0, -1.0)
    sums = [la.vector(topology.index_map(1)) for _ in range(2)]
    for vector, contribution in zip(sums, (np.ones_like(direction), direction), strict=True):
        np.add.at(vector.array, edges, contribution)
        vector.scatter_reverse(la.InsertMode.add)
    return sums[0].array[:n], sums[1].array[:n]


def _corners(topology: dmesh.Topology) -> Indices:
    """Local vertices (n, 3) of all local triangles."""
    corners: Indices = topology.connectivity(2, 0).array.reshape(-1, 3)
    return corners


def _global_vertices(topology: dmesh.Topology, vertices: Indices) -> Integers:
    names: Integers = (
        topology.index_map(0)
        .local_to_global(vertices.ravel().astype(np.int32))
        .reshape(vertices.shape)
    )
    return names
