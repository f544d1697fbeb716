"""Volume that a surface encloses, whose sign tells to which side the normals point, and triangles
turned so that normals agree and point outwards.

Volume (`enclosed_by`).  With triangles (x0, x1, x2) that close the surface, V = Σ x0·(x1×x2)/6, of
curved ones of order 2 Σ ⅓∫x·(∂x/∂ξ × ∂x/∂η) dξ dη; it is positive if the normals point outwards.
An open surface is closed for this purpose: each of its rims is spanned by a fan of triangles
between the edges of the rim and the mean of its points.  If the fans are small against the surface,
as those of the polar rings of a balloon, the surface has an inside; if they are not, as that of the
rim of a reflector, its sides are equal.

Consistent normals (`oriented`): triangles are turned so that neighbours have their normals on the
same side.  Two neighbours agree if they pass their common edge in opposite directions.  Fronts and
backs of triangles that are connected in this way are the two sides of a surface.  The normals of a
closed surface then point outwards if its volume is positive.  A surface with small rims is treated
like a closed one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import basix
import numpy as np
import numpy.typing as npt
from dolfinx import mesh as dmesh
from mpi4py import MPI
from scipy import sparse
from scipy.sparse import csgraph

from gossamer_fx.core.forms.backend import geometry_nodes
from gossamer_fx.core.mesh.edges import EdgeTable
from gossamer_fx.core.mesh.gmsh_reader import BadMesh, Integers, RawMesh
from gossamer_fx.core.mesh.quality import area_vectors, box
from gossamer_fx.core.model.body import Array

# Area of the fans over that of the surface, up to which the surface has an inside.  A tube of ten
# diameters with open ends has 1/20, a balloon with polar rings a few percent, half a sphere 1/2.
MAX_RIM_SHARE = 0.1

# Volume over the 3/2 power of the area, below which the surface is flat: a sphere has 0.09.
FLAT_VOLUME = 1e-6


@dataclass(frozen=True)
class Enclosed:
    """Volume [m³] that a surface encloses, positive if the normals point outwards; its area without
    the fans and that of the fans [m²], and the number of rims."""

    volume: float
    area: float
    rim_area: float
    rims: int

    @property
    def has_inside(self) -> bool:
        """Whether the surface is closed but for small rims, and not flat."""
        return bool(has_inside(self.volume, self.area, self.rim_area))


def enclosed_by(domain: dmesh.Mesh, table: EdgeTable) -> Enclosed:
    """What a mesh of triangles encloses; of several surfaces the sums.  Neighbouring triangles have
    their normals on the same side.  Collective."""
    comm = domain.comm
    low, high = box(comm, domain.geometry.x)
    owned = domain.topology.index_map(2).size_local
    # From the middle of the mesh, so that round-off of a distance from the origin does not count.
    nodes = domain.geometry.x[geometry_nodes(domain)[:owned]] - (low + high) / 2
    corners = nodes[:, :3]
    ends, numbers = _rim_edges(domain, table, nodes)
    # Rims are short, and one may be on several ranks: each rank spans all of them.
    all_ends = np.concatenate(comm.allgather(ends))
    all_numbers = np.concatenate(comm.allgather(numbers))
    rims = 0
    rim_volume = 0.0
    rim_area = 0.0
    if len(all_ends):
        fans, rims = spanning_fans(all_ends, all_numbers)
        rim_volume = float(volumes(fans).sum())
        rim_area = float(np.linalg.norm(area_vectors(fans), axis=1).sum())
    area = float(np.linalg.norm(area_vectors(corners), axis=1).sum())
    volume = float((volumes(corners) if nodes.shape[1] == 3 else _curved_volumes(nodes)).sum())
    return Enclosed(
        volume=comm.allreduce(volume, op=MPI.SUM) + rim_volume,
        area=comm.allreduce(area, op=MPI.SUM),
        rim_area=rim_area,
        rims=rims,
    )


def has_inside(volume: Array | float, area: Array | float, rim_area: Array | float) -> Any:
    """Return whether surfaces are not flat, and closed but for small rims, at most a tenth of their
    area, by the volume [m³] that they enclose, their area and that of what spans the rims [m²];
    numbers, or arrays of surfaces."""
    is_flat = np.abs(volume) < FLAT_VOLUME * np.asarray(area) ** 1.5
    return ~is_flat & (rim_area <= MAX_RIM_SHARE * np.asarray(area))


def volumes(corners: Array) -> Array:
    """Signed volumes (n,) [m³] of the tetrahedra between triangles (n, 3, 3) [m] and the origin,
    positive if the normal points away from it.

    >>> import numpy as np
    >>> volumes(np.eye(3)[None]).round(4)
    array([0.1667])
    """
    # The three vertices (n, 3) [m]
    x0, x1, x2 = corners.transpose(1, 0, 2)
    return np.einsum("ij,ij->i", x0, np.cross(x1, x2)) / 6


def _curved_volumes(nodes: Array) -> Array:
    """Signed volumes (n,) [m³] between the origin and triangles of order 2, nodes (n, 6, 3) [m]."""
    triangle = basix.CellType.triangle
    points, weights = (np.asarray(part) for part in basix.make_quadrature(triangle, 4))
    element = basix.create_element(basix.ElementFamily.P, triangle, 2)
    shapes = np.asarray(element.tabulate(1, points))[..., 0]
    x, along, across = np.einsum("kqd,ndi->knqi", shapes, nodes)
    return np.einsum("q,nqi,nqi->n", weights, x, np.cross(along, across)) / 3


def spanning_fans(ends: Array, numbers: npt.NDArray[np.int64]) -> tuple[Array, int]:
    """Corners (n, 3, 3) [m] of triangles that span the rims of a surface, from each edge to the
    mean of its rim's points, with normals that agree with the surface; and the number of rims.

    `ends` (n, 2, 3) [m] are start and end of the edges, in the direction in which the triangle of
    the surface passes them; edges that share one of the global `numbers` (n, 2), n > 0, are on one
    rim.
    """
    _, points = np.unique(numbers, return_inverse=True)
    starts, stops = points.reshape(-1, 2).T
    count = int(points.max()) + 1
    graph = sparse.coo_array((np.ones(len(ends)), (starts, stops)), shape=(count, count))
    rims, rim_of_point = csgraph.connected_components(graph, directed=False)
    rim = rim_of_point[starts]
    sums = np.zeros((rims, 3))
    np.add.at(sums, rim, ends[:, 0])
    middle = sums / np.bincount(rim, minlength=rims)[:, None]
    # Neighbours with the same side pass their common edge in opposite directions.
    return np.stack([middle[rim], ends[:, 1], ends[:, 0]], axis=1), rims


def _rim_edges(
    domain: dmesh.Mesh, table: EdgeTable, nodes: Array
) -> tuple[Array, npt.NDArray[np.int64]]:
    """Edges of this rank's triangles, with nodes (m, 3, 3) or (m, 6, 3) [m], that no other triangle
    has: both ends (n, 2, 3) [m], in the direction in which the triangle passes them, and their
    global numbers (n, 2).  A curved edge is given as two straight ones that span the same area."""
    topology = domain.topology
    owned = len(nodes)
    edges = topology.connectivity(2, 1).array.reshape(-1, 3)[:owned]
    vertices = topology.connectivity(2, 0).array.reshape(-1, 3)[:owned]
    numbers = topology.index_map(0).local_to_global(vertices.ravel()).reshape(-1, 3)
    cell, side = np.nonzero(table.count[edges] == 1)
    # Edge i is opposite vertex i; its triangle passes it from vertex i + 1 to vertex i + 2.
    first = (side + 1) % 3
    last = (side + 2) % 3
    ends = np.stack([nodes[cell, first], nodes[cell, last]], axis=1)
    numbers_of_ends = np.stack([numbers[cell, first], numbers[cell, last]], axis=1)
    if nodes.shape[1] == 3:
        return ends, numbers_of_ends
    # The area below a parabola is that of a triangle of 4/3 of its height.  Of the nodes of a cell
    # number 3 + i is on edge i.
    middle = ends.mean(axis=1)
    tips = middle + 4 / 3 * (nodes[cell, 3 + side] - middle)
    beyond_vertices = topology.index_map(0).size_global
    number_of_tips = beyond_vertices + topology.index_map(1).local_to_global(edges[cell, side])
    halves = [np.stack([ends[:, 0], tips], axis=1), np.stack([tips, ends[:, 1]], axis=1)]
    first_half = np.column_stack([numbers_of_ends[:, 0], number_of_tips])
    last_half = np.column_stack([number_of_tips, numbers_of_ends[:, 1]])
    return np.concatenate(halves), np.concatenate([first_half, last_half])


# ---- consistent normals --------------------------------------------------------------------------

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

    A surface with rims counts as closed if they are small.  Any other open surface keeps the side
    that the larger number of its triangles has.  Where three or more triangles share an edge,
    surfaces end.  A mesh of line elements is returned as it is.  A surface with one side only, as a
    Möbius strip, raises `BadMesh`.
    """
    if raw.kind != "triangle":
        return raw
    corners = raw.cells[:, :3]
    neighbours = _neighbours(corners)
    front, back = _sides(neighbours, len(corners))
    if (front == back).any():
        raise BadMesh(
            "The mesh has a surface with one side only, "
            "as a Möbius strip, whose normals cannot agree; leave orient out."
        )
    both_sides = np.minimum(front, back)
    _, roots, surface_of_cell = np.unique(both_sides, return_index=True, return_inverse=True)
    surfaces = len(roots)
    # At first those that do not agree with the first triangle of their surface.
    turned = front != front[roots][surface_of_cell]

    # Relative to the middle of the mesh, so that the volume has no round-off of a distance from the
    # origin.
    points = raw.points - raw.points.mean(axis=0)
    of_cells = _sums(points[corners], surface_of_cell, turned, surfaces)
    volume = of_cells.volume
    rim_area: Array = np.zeros(surfaces)
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
    """Signed volumes [m³] and areas [m²] of surfaces: the sums of triangles (n, 3, 3) [m] by the
    number of their surface (n,), with those reversed that are turned (n,)."""
    volume = volumes(triangles)
    area = np.linalg.norm(area_vectors(triangles), axis=1)
    # NumPy declares sums of weights as integers.
    volume_sums: Array = np.asarray(
        np.bincount(surface, np.where(turned, -volume, volume), surfaces), dtype=float
    )
    area_sums: Array = np.asarray(np.bincount(surface, area, surfaces), dtype=float)
    return _Sums(volume_sums, area_sums)


def _neighbours(corners: Integers) -> _Neighbours:
    """Pairs of the triangles with nodes (m, 3), in their order round each, that share an edge which
    no third triangle has."""
    directed = np.vstack([corners[:, [i, (i + 1) % 3]] for i in range(3)])
    cell = np.tile(np.arange(len(corners)), 3)
    forwards = directed[:, 0] < directed[:, 1]
    low_ends = directed.min(axis=1)
    high_ends = directed.max(axis=1)
    # One number for each pair of nodes; equal ones are the same edge.
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


def _sides(neighbours: _Neighbours, count: int) -> tuple[Integers, Integers]:
    """Numbers (count,) of the sides of surfaces that the fronts and the backs of triangles belong
    to: the front of a triangle is on the side of its neighbour's front if both agree, else on that
    of its back."""
    first = neighbours.first
    second = neighbours.second
    # Backs follow fronts.
    of_front = np.where(neighbours.agree, second, second + count)
    of_back = np.where(neighbours.agree, second + count, second)
    starts = np.concatenate([first, first + count])
    stops = np.concatenate([of_front, of_back])
    graph = sparse.coo_array((np.ones(len(starts)), (starts, stops)), shape=(2 * count, 2 * count))
    _, side = csgraph.connected_components(graph, directed=False)
    return side[:count], side[count:]
