"""Defects of a mesh: slivers, folded cells, seams that are not glued.

Every rank examines its own cells.  Counts are summed over all ranks; data that concern several
ranks are sent to the rank to which a key is assigned.  All functions that take a mesh or a
communicator are collective.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import la
from dolfinx import mesh as dmesh
from mpi4py import MPI

from gossamer_fx.core.algebra.rank_exchange import RankExchange
from gossamer_fx.core.forms.backend import geometry_element, geometry_nodes
from gossamer_fx.core.mesh.edges import EdgeTable
from gossamer_fx.core.model.body import Array

Integers = npt.NDArray[np.int64]

# Points that are closer than this fraction of the mesh's extent count as one point.
ALIKE = 1e-9

# Quality of a cell, see `cell_quality`, below which it has no size.
NO_SIZE = 1e-9

# A neighbour lies upside down if the cosine between both normals is below this: they enclose more
# than 154 degrees.
UPSIDE_DOWN_COSINE = -0.9

# Cosine of an angle of one degree: triangles that enclose less lie in one plane.
SMOOTH_COSINE = 0.9998

# Share of the area of a plane mesh from which what lies upside down is taken for the second layer
# of a film that is folded, and not for a defect.
FOLDED_FILM_SHARE = 0.4

# Large primes that spread the three integer coordinates of a point over the ranks.
# Source: M. Teschner et al., Proc. Vision, Modeling, Visualization (2003) 47.
HASH_PRIMES = np.array([73856093, 19349663, 83492791], dtype=np.int64)


def corner_points(domain: dmesh.Mesh) -> Array:
    """Vertices (n, 3, 3) [m] of the owned triangles of a mesh, or (n, 2, 3) of its line
    elements."""
    dim = domain.topology.dim
    owned = domain.topology.index_map(dim).size_local
    return domain.geometry.x[geometry_nodes(domain)[:owned, : dim + 1]]


def box(comm: MPI.Intracomm, points: Array) -> tuple[Array, Array]:
    """Lowest and highest coordinates, (3,) each [m], of the points (n, 3) [m] of all ranks; inf and
    -inf if there are none."""
    # The lowest with the opposite sign, so that one message has both.
    highest = np.concatenate(
        [-points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)]
    )
    comm.Allreduce(MPI.IN_PLACE, highest, op=MPI.MAX)
    return -highest[:3], highest[3:]


def extent(domain: dmesh.Mesh) -> float:
    """Diagonal [m] of the box around a mesh."""
    low, high = box(domain.comm, domain.geometry.x)
    return float(np.linalg.norm(high - low))


def area_vectors(corners: Array) -> Array:
    """Normals (n, 3) of triangles (n, 3, 3) [m], about which vertices are counterclockwise, with
    the area [m²] as length.

    >>> import numpy as np
    >>> area_vectors(np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]))
    array([[0. , 0. , 0.5]])
    """
    first = corners[:, 1] - corners[:, 0]
    second = corners[:, 2] - corners[:, 0]
    return np.cross(first, second) / 2


def sizes(corners: Array) -> Array:
    """Areas (n,) [m²] of triangles (n, 3, 3) [m], or lengths (n,) [m] of line elements (n, 2, 3)
    [m], by their corners."""
    vectors: npt.NDArray[Any] = corners[:, 1] - corners[:, 0]
    if corners.shape[1] == 3:
        vectors = area_vectors(corners)
    return np.linalg.norm(vectors, axis=1)


def shape_quality(corners: Array) -> Array:
    """Quality 4√3 A/(a² + b² + c²) (n,) of triangles (n, 3, 3) [m] with the sides a, b, c and the
    area A: 1 if equilateral, 0 if degenerate.

    >>> import numpy as np
    >>> flat = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
    >>> shape_quality(np.array([flat]))
    array([0.])
    """
    edges = corners - np.roll(corners, 1, axis=1)
    squares = (edges**2).sum(axis=(1, 2))
    # A cell whose nodes coincide has no edges; its area is zero, so any divisor gives zero.
    divisor = np.where(squares > 0, squares, 1.0)
    return 4 * np.sqrt(3) * sizes(corners) / divisor


def cell_quality(corners: Array, extent: float) -> Array:
    """Quality (n,) of triangles (n, 3, 3) [m], see `shape_quality`, or of line elements (n, 2, 3)
    [m]: their lengths over the extent [m] of the mesh."""
    if corners.shape[1] == 3:
        return shape_quality(corners)
    return sizes(corners) / (extent or 1.0)


def aspects(corners: Array) -> Array:
    """Aspect ratios c²/(4A) (n,) of triangles (n, 3, 3) [m] with the longest edge c and the area A:
    1 for half a square, very large without area.

    >>> import numpy as np
    >>> aspects(np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]))
    array([1.])
    """
    edges = corners - np.roll(corners, 1, axis=1)
    longest = (edges**2).sum(axis=2).max(axis=1)
    # A cell without area is refused elsewhere.
    return np.maximum(longest / np.maximum(4 * sizes(corners), 1e-300), 1.0)


def turned_inside(domain: dmesh.Mesh) -> int:
    """Count curved triangles (order 2) of the whole mesh whose normal, examined at the three
    corners, reverses within the cell.  Collective."""
    if geometry_element(domain).degree != 2:
        return 0
    owned = domain.topology.index_map(2).size_local
    x = domain.geometry.x[geometry_nodes(domain)[:owned]]
    straight_normal = area_vectors(x[:, :3])
    turned = np.zeros(owned, dtype=bool)
    # Node 3 + i lies on the edge opposite vertex i.  A parabola from a to b with the middle node m
    # has the tangent 4 m - 3 a - b at a.
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        tangent_to_b = 4 * x[:, 3 + c] - 3 * x[:, a] - x[:, b]
        tangent_to_c = 4 * x[:, 3 + b] - 3 * x[:, a] - x[:, c]
        normal = np.cross(tangent_to_b, tangent_to_c)
        turned |= _dot(normal, straight_normal) <= 0
    return int(domain.comm.allreduce(int(turned.sum())))


def _neighbours(table: EdgeTable) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Normals (n, 3) of the owned triangles, those (n, 3, 3) of the neighbours at their edges, and
    whether there is one neighbour of the same orientation (n, 3).  Collective."""
    domain = table.domain
    topology = domain.topology
    edges = topology.connectivity(2, 1).array.reshape(-1, 3)
    owned = topology.index_map(2).size_local
    count, directions = table.tally(np.arange(owned, dtype=np.int32))
    vectors = area_vectors(corner_points(domain))
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    # Cells without area get the normal zero.
    normals = vectors / np.maximum(lengths, 1e-300)

    # Sum of the normals of both triangles at each edge; subtracting the own one gives the other.
    sums = la.vector(topology.index_map(1), 3)
    normals_at_edges = np.repeat(normals, 3, axis=0)
    np.add.at(sums.array.reshape(-1, 3), edges[:owned].ravel(), normals_at_edges)
    sums.scatter_reverse(la.InsertMode.add)
    sums.scatter_forward()

    # Only edges are compared whose two triangles have the same orientation: they pass the edge in
    # opposite directions, whose sum is zero.
    comparable = la.vector(topology.index_map(1))
    comparable.array[: len(count)] = (count == 2) & (directions == 0)
    comparable.scatter_forward()

    other = sums.array.reshape(-1, 3)[edges[:owned]] - normals[:, None]
    return normals, other, comparable.array[edges[:owned]] > 0


def share_of_bent_edges(table: EdgeTable) -> float:
    """Share of the interior edges, counted from both sides, at which neighbouring triangles enclose
    an angle between a degree and a right angle, as on a curved surface.  Collective."""
    normals, other, has_neighbour = _neighbours(table)
    cosines = _dot(other, normals[:, None])
    is_bent = has_neighbour & (cosines < SMOOTH_COSINE) & (cosines > 0)
    own = np.array([is_bent.sum(), has_neighbour.sum()])
    bent, edges = table.domain.comm.allreduce(own).tolist()
    return bent / max(edges, 1)


def folded(table: EdgeTable) -> int:
    """Count triangles of the whole mesh that lie upside down on their neighbours: with two
    neighbours or more, all of whose normals enclose more than 154° with theirs, since a node was
    moved across an edge.  One neighbour is not enough: it may be a sharp fold.  Collective."""
    normals, other, has_neighbour = _neighbours(table)
    domain = table.domain
    is_opposite = _dot(other, normals[:, None]) < UPSIDE_DOWN_COSINE
    all_opposite = (is_opposite | ~has_neighbour).all(axis=1)
    found = (has_neighbour.sum(axis=1) >= 2) & all_opposite
    return int(domain.comm.allreduce(int(found.sum())))


def folded_in_plane(table: EdgeTable) -> tuple[int, float]:
    """Number, and share of the area, of triangles of a plane mesh that lie upside down; zero for a
    mesh that is not plane, or whose neighbouring triangles pass edges in the same direction.
    Collective.

    Nodes that were moved across edges turn triangles over, which then cover a part of the plane
    again.  Each connected part of the mesh is judged by itself.  A film that is folded once, such
    as a tube that is pressed flat, has as much area on either side; neither side counts as upside
    down where the smaller one has more than 0.4 of it.
    """
    domain = table.domain
    comm = domain.comm
    vectors = area_vectors(corner_points(domain))
    areas = np.linalg.norm(vectors, axis=1)
    # Squares of the components have no sign, so that triangles on both sides add up.
    products = comm.allreduce(np.einsum("ni,nj->ij", vectors, vectors))
    normal = np.linalg.eigh(products)[1][:, -1]
    heights = vectors @ normal
    is_plane = bool((abs(heights) >= (1 - ALIKE) * areas).all())
    count, directions = table.tally(np.arange(len(areas), dtype=np.int32))
    agrees = not ((count == 2) & (directions != 0)).any()
    is_turned = heights < 0
    flags = np.array([not is_plane or not agrees, is_turned.any(), (~is_turned).any()], dtype=int)
    excluded, some_turned, some_upright = comm.allreduce(flags).tolist()
    if excluded or not (some_turned and some_upright):
        return 0, 0.0
    # Separate parts may lie either side up.
    part, parts = connected_cells(domain)
    sums = np.zeros((4, parts))
    for row, weights in zip(
        sums, (np.ones(len(areas)), is_turned, areas, areas * is_turned), strict=True
    ):
        row += np.bincount(part, weights, parts)
    comm.Allreduce(MPI.IN_PLACE, sums)
    total, turned, area, turned_area = sums
    is_mostly_turned = turned_area > area / 2
    turned = np.where(is_mostly_turned, total - turned, turned)
    turned_area = np.where(is_mostly_turned, area - turned_area, turned_area)
    is_defect = turned_area <= FOLDED_FILM_SHARE * area
    count_of_defects = int(turned[is_defect].sum())
    share = float(turned_area[is_defect].sum() / area.sum())
    return count_of_defects, share


def connected_cells(domain: dmesh.Mesh) -> tuple[Integers, int]:
    """Label (n,) of the part of the mesh to which each owned cell belongs, from 0, and the number
    of parts: cells of a part are connected by vertices.  Collective."""
    # Imported here, as few meshes need it.
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    comm = domain.comm
    topology = domain.topology
    vertices = topology.connectivity(topology.dim, 0).array.reshape(-1, topology.dim + 1)
    owned = topology.index_map(topology.dim).size_local
    index_map = topology.index_map(0)
    size = index_map.size_local + index_map.num_ghosts
    first = np.repeat(vertices[:, 0], vertices.shape[1])
    ones = np.ones(vertices.size, dtype=np.int8)
    graph = csr_matrix((ones, (first, vertices.ravel())), shape=(size, size))
    count, local = connected_components(graph, directed=False)
    # Parts of this rank, and those of the owners of its ghost vertices, are linked.
    offset = comm.exscan(count) or 0
    labels = la.vector(index_map)
    labels.array[:] = offset + local
    labels.scatter_forward()
    links = np.unique(np.stack([offset + local, labels.array.astype(np.int64)]), axis=1)
    gathered = np.concatenate(comm.allgather(links), axis=1)
    number = comm.allreduce(count)
    weights = np.ones(gathered.shape[1], dtype=np.int8)
    whole = csr_matrix((weights, (gathered[0], gathered[1])), shape=(number, number))
    parts, of_local = connected_components(whole, directed=False)
    part = of_local[offset + local[vertices[:owned, 0]]]
    return part.astype(np.int64), int(parts)


def open_seams(domain: dmesh.Mesh, groups: Mapping[str, tuple[int, npt.NDArray[np.int32]]]) -> int:
    """Count boundary facets of the whole mesh, edges of triangles or ends of line elements, whose
    middle coincides with that of another one, to 1e-9 of the mesh's extent, but which are not glued
    to it.  A slit that is intended has its two sides in different named `groups` (dimension and
    local entities by name); its facets are not counted.  Collective."""
    topology = domain.topology
    comm = domain.comm
    dim = topology.dim
    topology.create_entities(dim - 1)
    topology.create_connectivity(dim - 1, dim)
    facets = dmesh.exterior_facet_indices(topology)
    midpoints = np.zeros((0, 3))
    if len(facets):
        midpoints = dmesh.compute_midpoints(domain, dim - 1, facets)

    # Number of the named group of each facet; zero for facets in no group.
    side = np.zeros(len(facets), dtype=np.int64)
    for number, (group_dim, entities) in enumerate(groups.values(), start=1):
        in_group = np.isin(facets, entities) & (group_dim == dim - 1)
        side[in_group] = number

    # Facets coincide if their rounded midpoints do.  Those with the same midpoint are collected on
    # the same rank, which is a hash of the midpoint.
    pitch = ALIKE * extent(domain) or 1.0
    rounded = np.rint(midpoints / pitch).astype(np.int64)
    keys = np.column_stack([rounded, side])
    home = (keys[:, :3] @ HASH_PRIMES) % comm.size
    received = RankExchange(comm, home).send(keys)
    _, midpoint, counts = np.unique(
        received[:, :3],
        axis=0,
        return_inverse=True,
        return_counts=True,
    )

    # Number of different named groups at each midpoint.
    in_named_group = received[:, 3] > 0
    midpoint_and_side = np.column_stack([midpoint.ravel(), received[:, 3]])[in_named_group]
    sides = np.bincount(np.unique(midpoint_and_side, axis=0)[:, 0])
    sides = np.pad(sides, (0, len(counts) - len(sides)))
    # Facets that coincide are intended if each of them is in another group.
    is_open = (counts > 1) & (sides < counts)
    return int(comm.allreduce(int(counts[is_open].sum())))


def _dot(a: Array, b: Array) -> Array:
    """Dot products over the last axis."""
    return (a * b).sum(axis=-1)
