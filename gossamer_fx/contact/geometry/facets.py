"""The points of a body that contact sees, and the linear lines and triangles between them, on every rank alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gossamer_fx.model.body import Array, MeshBody

# linear pieces of elements of order 1 and 2, by the numbers of dofs in a cell
PIECES = {
    2: [[0, 1]],
    3: [[0, 1, 2]],
    (1, 3): [[0, 2], [2, 1]],
    6: [[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]],
}


@dataclass(frozen=True)
class Facets:
    """n points of one body: its `nodes` (n,) in the body's block, and their places X (n, 3) in the stress-free shape.

    `triangles` (t, 3) or `lines` (l, 2) are numbers of points; those of order 2 are cut into linear ones.  Points are
    numbered by the vertices of the mesh as it was read, so that the numbers do not depend on the ranks.
    """

    nodes: npt.NDArray[np.int64]
    X: Array
    triangles: npt.NDArray[np.int32]
    lines: npt.NDArray[np.int32]


def facets_of(body: MeshBody) -> Facets:
    """The facets of a film, cable or beam; collective."""
    space: Any = body.space
    mesh, index_map = space.mesh, body.block.index_map
    tdim = mesh.topology.dim
    own = space.dofmap.list[: mesh.topology.index_map(tdim).size_local]
    width = own.shape[1]
    pieces = np.array(PIECES[(1, 3)] if (tdim, width) == (1, 3) else PIECES[width])
    corners = mesh.geometry.input_global_indices[
        mesh.geometry.dofmap[: len(own), : tdim + 1]
    ].astype(np.int64)
    names = np.zeros(
        (*own.shape, 2), dtype=np.int64
    )  # a node by the ends of the edge on which it is
    names[:, : tdim + 1] = corners[:, :, None]
    if width == 6:
        for at, (a, b) in zip((3, 4, 5), ((1, 2), (0, 2), (0, 1)), strict=True):
            names[:, at] = np.sort(corners[:, [a, b]], axis=1)
    elif (tdim, width) == (1, 3):
        names[:, 2] = np.sort(corners, axis=1)
    nodes = index_map.local_to_global(own.ravel().astype(np.int32)).reshape(own.shape)
    places = space.tabulate_dof_coordinates()[own]
    table = np.concatenate([nodes[:, :, None], names], axis=2)
    cells = np.concatenate(body.comm.allgather(table)).reshape(-1, 3)
    X = np.concatenate(body.comm.allgather(places)).reshape(-1, 3)
    _, first, which = np.unique(cells[:, 1:], axis=0, return_index=True, return_inverse=True)
    all_pieces = np.sort(
        which.reshape(-1, width)[:, pieces].reshape(-1, pieces.shape[1]), axis=1
    ).astype(np.int32)
    all_pieces = all_pieces[np.lexsort(all_pieces.T[::-1])]
    none = np.zeros((0, 5 - pieces.shape[1]), dtype=np.int32)
    triangles, lines = (all_pieces, none) if tdim == 2 else (none, all_pieces)
    return Facets(
        cells[first, 0], X[first], np.ascontiguousarray(triangles), np.ascontiguousarray(lines)
    )
