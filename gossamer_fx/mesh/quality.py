"""What can be wrong with the cells of a mesh: slivers, folded cells, seams that are not glued, cells that cross.

Every rank looks at its own cells; what concerns several ranks is summed, or told to the rank that a key falls to.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from dolfinx import la
from dolfinx import mesh as dmesh
from mpi4py import MPI

from gossamer_fx.mesh.edges import EdgeTable
from gossamer_fx.model.body import Array

Integers = npt.NDArray[np.int64]

ALIKE = 1e-9  # of a mesh's extent: points that are closer are the same


def corner_points(domain: dmesh.Mesh) -> Array:
    """Vertices (n, 3, 3) of the owned triangles, or (n, 2, 3) of line elements."""
    n, dim = domain.topology.index_map(domain.topology.dim).size_local, domain.topology.dim
    points: Array = domain.geometry.x[domain.geometry.dofmap[:n, : dim + 1]]
    return points


def box(comm: MPI.Intracomm, points: Array) -> tuple[Array, Array]:
    """Lowest and highest coordinates [m] of the points (n, 3) of all ranks."""
    low, high = points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)
    comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    return low, high


def extent(domain: dmesh.Mesh) -> float:
    """Diagonal [m] of the box around a mesh."""
    low, high = box(domain.comm, domain.geometry.x)
    return float(np.linalg.norm(high - low))


def area_vectors(corners: Array) -> Array:
    """Half the cross products (n, 3) of the edges of triangles."""
    area: Array = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    return area


def sizes(corners: Array) -> Array:
    """Areas [m²] or lengths [m] of cells with straight edges."""
    vectors = area_vectors(corners) if corners.shape[1] == 3 else corners[:, 1] - corners[:, 0]
    result: Array = np.linalg.norm(vectors, axis=1)
    return result


def shape_quality(corners: Array) -> Array:
    """4√3 A/(a² + b² + c²) of triangles: 1 if equilateral, 0 if all nodes are on a line."""
    squares = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=(1, 2))
    quality: Array = 4 * np.sqrt(3) * sizes(corners) / np.where(squares > 0, squares, 1.0)
    return quality


def turned_inside(domain: dmesh.Mesh) -> int:
    """Number of curved triangles (order 2) whose normal turns round within the cell; all ranks know it."""
    if domain.geometry.cmap.degree != 2:
        return 0
    n = domain.topology.index_map(2).size_local
    x = domain.geometry.x[domain.geometry.dofmap[:n]]
    flat = area_vectors(x[:, :3])
    turned = np.zeros(n, dtype=bool)
    # node 3 + i lies on the edge opposite vertex i; the tangents of a parabola at its end a are 4 m - 3 a - b
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        along_b = 4 * x[:, 3 + c] - 3 * x[:, a] - x[:, b]
        along_c = 4 * x[:, 3 + b] - 3 * x[:, a] - x[:, c]
        turned |= (np.cross(along_b, along_c) * flat).sum(axis=1) <= 0
    return int(domain.comm.allreduce(int(turned.sum())))


def folded(table: EdgeTable) -> int:
    """Number of triangles that lie upside down on their neighbours; all ranks know it.

    Those are cells with two neighbours or more, all of whose normals are opposite: a node was moved across an edge.
    """
    domain, topology = table.domain, table.domain.topology
    edges = topology.connectivity(2, 1).array.reshape(-1, 3)
    n = topology.index_map(2).size_local
    count, directions = table.tally(np.arange(n, dtype=np.int32))
    vectors = area_vectors(corner_points(domain))
    normals = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
    sums = la.vector(topology.index_map(1), 3)
    np.add.at(sums.array.reshape(-1, 3), edges[:n].ravel(), np.repeat(normals, 3, axis=0))
    pairs = la.vector(topology.index_map(1))
    pairs.array[: len(count)] = (count == 2) & (directions == 0)
    for vector in (sums, pairs):
        if vector is sums:
            vector.scatter_reverse(la.InsertMode.add)
        vector.scatter_forward()
    other = sums.array.reshape(-1, 3)[edges[:n]] - normals[:, None]
    met = pairs.array[edges[:n]] > 0
    opposite = (other * normals[:, None]).sum(axis=2) < -0.9
    found = (met.sum(axis=1) >= 2) & (opposite | ~met).all(axis=1)
    return int(domain.comm.allreduce(int(found.sum())))


def open_seams(domain: dmesh.Mesh, groups: Mapping[str, tuple[int, npt.NDArray[np.int32]]]) -> int:
    """Number of boundary facets (edges, or ends of curves) that coincide with another one without being joined to it.

    The sides of a slit that is meant are in named groups of their own, and not counted; `groups` are those of the mesh.
    Facets are sent to the rank that their rounded midpoint falls to; all ranks know the result.
    """
    topology, comm = domain.topology, domain.comm
    dim = topology.dim
    topology.create_entities(dim - 1)
    topology.create_connectivity(dim - 1, dim)
    facets = dmesh.exterior_facet_indices(topology)
    middles = dmesh.compute_midpoints(domain, dim - 1, facets) if len(facets) else np.zeros((0, 3))
    pitch = ALIKE * extent(domain) or 1.0
    side = np.zeros(len(facets), dtype=np.int64)  # zero in no group
    for number, (of, entities) in enumerate(groups.values(), start=1):
        side[np.isin(facets, entities) & (of == dim - 1)] = number
    keys = np.column_stack([np.rint(middles / pitch).astype(np.int64), side])
    home = (keys[:, :3] @ np.array([73856093, 19349663, 83492791], dtype=np.int64)) % comm.size
    received = np.concatenate(comm.alltoall([keys[home == rank] for rank in range(comm.size)]))
    _, at, counts = np.unique(received[:, :3], axis=0, return_inverse=True, return_counts=True)
    sides = np.bincount(
        np.unique(np.column_stack([at.ravel(), received[:, 3]])[received[:, 3] > 0], axis=0)[:, 0]
    )
    sides = np.pad(sides, (0, len(counts) - len(sides)))
    return int(comm.allreduce(int(counts[(counts > 1) & (sides < counts)].sum())))


def crossings(comm: MPI.Intracomm, corners: Array, nodes: Integers) -> int:
    """Number of triangles that another triangle pierces; all ranks know it.

    corners (n, 3, 3) of this rank's triangles, nodes (n, 3) their global nodes: triangles that share one are not
    tested.  Ranks pass their triangles round, so that none holds more than two shares.
    """
    pierced = np.zeros(len(corners), dtype=bool)
    visitor: tuple[Array, Integers] = (corners, nodes)
    for _ in range(comm.size):
        pierced |= _pierced(corners, nodes, *visitor)
        visitor = comm.sendrecv(
            visitor, dest=(comm.rank + 1) % comm.size, source=(comm.rank - 1) % comm.size
        )
    return int(comm.allreduce(int(pierced.sum())))


def _pierced(
    mine: Array, my_nodes: Integers, others: Array, other_nodes: Integers
) -> npt.NDArray[np.bool_]:
    """Which of `mine` are crossed by an edge of `others`, or cross one of theirs with an edge."""
    found = np.zeros(len(mine), dtype=bool)
    if not len(mine) or not len(others):
        return found
    from scipy.spatial import cKDTree

    (centres, radii), (their_centres, their_radii) = (_ball(corners) for corners in (mine, others))
    tree, reach = cKDTree(their_centres), radii + their_radii.max()
    for part in np.array_split(np.arange(len(mine)), len(mine) // 2000 + 1):
        near = tree.query_ball_point(centres[part], reach[part])
        i = np.repeat(part, [len(found_there) for found_there in near])
        j = np.concatenate([np.asarray(found_there, dtype=np.int64) for found_there in near])
        apart = np.linalg.norm(centres[i] - their_centres[j], axis=1) <= radii[i] + their_radii[j]
        apart &= ~(my_nodes[i][:, :, None] == other_nodes[j][:, None, :]).any(axis=(1, 2))
        i, j = i[apart], j[apart]
        hit = np.zeros(len(i), dtype=bool)
        for k in range(3):
            hit |= _segment_meets(mine[i, k], mine[i, (k + 1) % 3], others[j])
            hit |= _segment_meets(others[j, k], others[j, (k + 1) % 3], mine[i])
        found[i[hit]] = True
    return found


def _ball(corners: Array) -> tuple[Array, Array]:
    centre = corners.mean(axis=1)
    return centre, np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)


def _segment_meets(start: Array, end: Array, triangle: Array) -> npt.NDArray[np.bool_]:
    """Whether segments (n, 3) go through the inside of triangles (n, 3, 3); those that only touch do not."""
    a, b = triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0]
    normal = np.cross(a, b)
    squares = (normal**2).sum(axis=1)
    heights = [(normal * (point - triangle[:, 0])).sum(axis=1) for point in (start, end)]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = heights[0] / (heights[0] - heights[1])
        at = start + t[:, None] * (end - start) - triangle[:, 0]
        u = (np.cross(at, b) * normal).sum(axis=1) / squares
        v = (np.cross(a, at) * normal).sum(axis=1) / squares
        margin = 1e-6
        through = (np.minimum(*heights) < -margin * squares**0.75) & (
            np.maximum(*heights) > margin * squares**0.75
        )
        result: npt.NDArray[np.bool_] = through & (u > margin) & (v > margin) & (u + v < 1 - margin)
    return result
