"""The surface of a body as points and plane triangles, or straight lines, the same on every rank."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gossamer_fx.contact.arrays import Array, Int32Array, Int64Array
from gossamer_fx.model.body import MeshBody

# Linear pieces of one cell by its dofs, for cells of a dimension with a number of dofs: lines and
# triangles of order 1 and 2.  dolfinx numbers the vertices first, then the middles of the edges; edge k
# of a triangle is opposite to vertex k.
PIECES_OF_CELLS = {
    (1, 2): [[0, 1]],
    (1, 3): [[0, 2], [2, 1]],
    (2, 3): [[0, 1, 2]],
    (2, 6): [[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]],
}
# The vertices between which the middle nodes of cells of order 2 lie.
EDGES_OF_CELLS = {
    (1, 2): [],
    (1, 3): [(0, 1)],
    (2, 3): [],
    (2, 6): [(1, 2), (0, 2), (0, 1)],
}


@dataclass(frozen=True)
class Facets:
    """The n points of one body that can touch, and the flat pieces between them.

    Cells of order 2 are cut into linear pieces.  Points are numbered by the vertices of the mesh file,
    so that their numbers do not depend on the number of ranks.

    Attributes:
        nodes: global numbers (n,) of the points among the nodes of the body.
        X: positions (n, 3) in the stress-free shape [m].
        triangles: (t, 3) numbers of points; none for cables and beams.
        lines: (l, 2) numbers of points; none for films.
    """

    nodes: Int64Array
    X: Array
    triangles: Int32Array
    lines: Int32Array


def facets_of(body: MeshBody) -> Facets:
    """Return the facets of a film, cable or beam; collective."""
    space = body.space
    mesh = space.mesh
    dimension = mesh.topology.dim
    # Each rank brings the cells that it owns; together they are all cells, each once.
    own_count = mesh.topology.index_map(dimension).size_local
    dofs = space.dofmap.list[:own_count]
    dof_count = dofs.shape[1]
    kind_of_cell = (dimension, dof_count)

    corners = mesh.geometry.dofmap[:own_count, : dimension + 1]
    vertices = mesh.geometry.input_global_indices[corners].astype(np.int64)
    names = _names_of_dofs(vertices, dof_count, EDGES_OF_CELLS[kind_of_cell])
    nodes = body.block.index_map.local_to_global(dofs.ravel().astype(np.int32))
    table = np.concatenate([nodes.reshape(*dofs.shape, 1), names], axis=2)
    positions = space.tabulate_dof_coordinates()[dofs]
    all_dofs = np.concatenate(body.comm.allgather(table)).reshape(-1, 3)
    all_positions = np.concatenate(body.comm.allgather(positions)).reshape(-1, 3)

    # Sorting by name makes one point of the dofs that cells share.
    _, first, point = np.unique(all_dofs[:, 1:], axis=0, return_index=True, return_inverse=True)
    pieces = np.array(PIECES_OF_CELLS[kind_of_cell])
    facets = point.reshape(-1, dof_count)[:, pieces].reshape(-1, pieces.shape[1])
    facets = np.sort(facets, axis=1).astype(np.int32)
    facets = np.ascontiguousarray(facets[np.lexsort(facets.T[::-1])])
    is_film = dimension == 2
    no_triangles: Int32Array = np.zeros((0, 3), dtype=np.int32)
    no_lines: Int32Array = np.zeros((0, 2), dtype=np.int32)
    return Facets(
        nodes=all_dofs[first, 0],
        X=all_positions[first],
        triangles=facets if is_film else no_triangles,
        lines=no_lines if is_film else facets,
    )


def _names_of_dofs(
    vertices: Int64Array, dof_count: int, edges: list[tuple[int, int]]
) -> Int64Array:
    """Return two numbers (c, d, 2) for each dof of cells: the vertices of the edge on which it is.

    Args:
        vertices: numbers (c, k) of the cells' vertices in the mesh file.  A vertex is its own edge.
        dof_count: d.
        edges: of the middle nodes, which follow the vertices.
    """
    count, vertex_count = vertices.shape
    names = np.zeros((count, dof_count, 2), dtype=np.int64)
    names[:, :vertex_count] = vertices[:, :, None]
    for k, ends in enumerate(edges):
        names[:, vertex_count + k] = np.sort(vertices[:, list(ends)], axis=1)
    return names
