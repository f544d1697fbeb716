"""Consistent normals: triangles of a surface turned so that neighbours have them on the same side.

Two neighbours agree if they pass their common edge in opposite directions.  Starting from one
triangle of each connected surface, all others are turned to agree with a neighbour that is done.
The normals of a closed surface then point outwards if its volume is positive.  A surface with small
rims is treated like a closed one, see `mesh.enclosed_volume`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph

from gossamer_fx.core.mesh.enclosed_volume import has_inside, spanning_fans, volumes
from gossamer_fx.core.mesh.gmsh_reader import BadMesh, Integers, RawMesh
from gossamer_fx.core.mesh.quality import area_vectors
from gossamer_fx.core.model.body import Array

# Nodes of a triangle in gmsh's order after its second and third corner are exchanged, by number of
# nodes. Of order 2 the nodes in the middle of the edges 01, 12, 20 follow the corners.
_TURNED = {3: [0, 2, 1], 6: [0, 2, 1, 5, 4, 3]}


@dataclass(frozen=True)
class _Neighbours:
    """Pairs of triangles that share an edge which no third triangle has.

    Attributes:
        first, second: rows of the cells (n,).
        agree: whether the normals of both are on the same side (n,).
        at_rim: rows of cells with an edge that does not have exactly two triangles, as often as
            they have such edges.
        rim_edges: rows of points at start and end of these edges (k, 2), as the cell passes them.
    """

    first: Integers
    second: Integers
    agree: npt.NDArray[np.bool_]
    at_rim: Integers
    rim_edges: Integers


@dataclass(frozen=True)
class _Sums:
    """Volume [m³] and area [m²] of each surface (surfaces,)."""

    volume: Array
    area: Array


def oriented(raw: RawMesh) -> RawMesh:
    """Return the mesh with consistent normals, which point out of closed surfaces.

    A surface with rims counts as closed if they are small, see `mesh.enclosed_volume`.  Any other
    open surface keeps the side that the larger number of its triangles has.  Where three or more
    triangles share an edge, surfaces end.  A mesh of line elements is returned as it is.

    Args:
        raw: arrays of the whole mesh, which are not changed.

    Raises:
        BadMesh: a surface has one side only, as a Möbius strip.
    """
    if raw.kind != "triangle":
        return raw
    corners = raw.cells[:, :3]
    neighbours = _neighbours(corners)
    count = len(corners)
    links = (np.ones(len(neighbours.first)), (neighbours.first, neighbours.second))
    graph = sparse.coo_array(links, shape=(count, count)).tocsr()
    surfaces, surface_of_cell = csgraph.connected_components(graph, directed=False)
    turned = _disagreeing(graph, neighbours, surface_of_cell)
    inconsistent = (turned[neighbours.first] == turned[neighbours.second]) != neighbours.agree
    if inconsistent.any():
        raise BadMesh(
            "The mesh has a surface with one side only, as a Möbius strip, whose normals cannot "
            "agree; leave orient out."
        )

    # Relative to the middle of the mesh, so that the volume has no round-off of a distance from the
    # origin.
    points = raw.points - raw.points.mean(axis=0)
    of_cells = _sums(points[corners], surface_of_cell, turned, surfaces)
    volume = of_cells.volume
    rim_area = np.zeros(surfaces)
    if len(neighbours.at_rim):
        surface_of_rim = surface_of_cell[neighbours.at_rim]
        # Two surfaces that share a point have separate rims there.
        numbers = neighbours.rim_edges + surface_of_rim[:, None] * len(points)
        fans, _ = spanning_fans(points[neighbours.rim_edges], numbers)
        of_fans = _sums(fans, surface_of_rim, turned[neighbours.at_rim], surfaces)
        volume = volume + of_fans.volume
        rim_area = of_fans.area
    share_turned = np.bincount(surface_of_cell, turned, surfaces) / np.bincount(surface_of_cell)
    is_inside_out = volume < 0
    is_mostly_turned = share_turned > 0.5
    is_other_side = np.where(
        has_inside(volume, of_cells.area, rim_area), is_inside_out, is_mostly_turned
    )
    turned ^= is_other_side[surface_of_cell]

    cells = raw.cells.copy()
    cells[turned] = cells[turned][:, _TURNED[cells.shape[1]]]
    return replace(raw, cells=cells)


def _sums(
    triangles: Array, surface: Integers, turned: npt.NDArray[np.bool_], surfaces: int
) -> _Sums:
    """Return signed volumes [m³] and areas [m²] of surfaces.

    Args:
        triangles: corners (n, 3, 3) [m].
        surface: number of the surface of each (n,).
        turned: which of them are turned (n,).
    """
    volume = volumes(triangles)
    area = np.linalg.norm(area_vectors(triangles), axis=1)
    # NumPy declares sums of weights as integers.
    volume_sums: Array = np.asarray(
        np.bincount(surface, np.where(turned, -volume, volume), surfaces), dtype=float
    )
    area_sums: Array = np.asarray(np.bincount(surface, area, surfaces), dtype=float)
    return _Sums(volume_sums, area_sums)


def _neighbours(corners: Integers) -> _Neighbours:
    """Find the pairs of triangles that share an edge which no third triangle has.

    Args:
        corners: nodes (m, 3) of the triangles, in their order round each.
    """
    directed = np.vstack([corners[:, [i, (i + 1) % 3]] for i in range(3)])
    cell = np.tile(np.arange(len(corners)), 3)
    forwards = directed[:, 0] < directed[:, 1]
    low_ends = directed.min(axis=1)
    high_ends = directed.max(axis=1)
    keys = low_ends * (int(corners.max()) + 1) + high_ends
    order = np.argsort(keys, kind="stable")
    _, start, count = np.unique(keys[order], return_index=True, return_counts=True)
    inner = start[count == 2]
    first = order[inner]
    second = order[inner + 1]
    is_inner = np.zeros(len(keys), dtype=bool)
    is_inner[first] = True
    is_inner[second] = True
    return _Neighbours(
        first=cell[first],
        second=cell[second],
        agree=forwards[first] != forwards[second],
        at_rim=cell[~is_inner],
        rim_edges=directed[~is_inner],
    )


def _disagreeing(
    graph: sparse.csr_array, neighbours: _Neighbours, surface_of_cell: Integers
) -> npt.NDArray[np.bool_]:
    """Return whether each triangle must be turned to agree with the first one of its surface.

    Args:
        graph: (m, m), nonzero where two triangles are neighbours.
        surface_of_cell: number (m,) of the connected surface of each triangle.

    Returns:
        mask (m,).
    """
    agree = {}
    for pair, is_same in enumerate(neighbours.agree):
        first = int(neighbours.first[pair])
        second = int(neighbours.second[pair])
        agree[first, second] = bool(is_same)
        agree[second, first] = bool(is_same)
    turned = np.zeros(graph.shape[0], dtype=bool)
    _, roots = np.unique(surface_of_cell, return_index=True)
    for root in roots:
        order, before = csgraph.breadth_first_order(graph, root, directed=False)
        # Each triangle comes after the neighbour from which it was reached.
        for cell in map(int, order[1:]):
            reached_from = int(before[cell])
            # The same as that neighbour if both agree, the contrary if not.
            turned[cell] = turned[reached_from] == agree[reached_from, cell]
    return turned
