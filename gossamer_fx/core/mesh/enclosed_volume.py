"""Volume that a surface encloses, and with its sign the side to which the normals point.

With triangles (x0, x1, x2) that close the surface, V = Σ x0·(x1×x2)/6; it is positive if the
normals point outwards.  An open surface is closed for this purpose: each of its rims is spanned by
a fan of triangles between the edges of the rim and the mean of its points.  If the fans are small
against the surface, as those of the polar rings of a balloon, the surface has an inside; if they
are not, as that of the rim of a reflector, its sides are equal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import mesh as dmesh
from mpi4py import MPI

from gossamer_fx.core.mesh.edges import EdgeTable
from gossamer_fx.core.mesh.quality import area_vectors, box, corner_points
from gossamer_fx.core.model.body import Array

# Area of the fans over that of the surface, up to which the surface has an inside.  A tube of ten
# diameters with open ends has 1/20, a balloon with polar rings a few percent, half a sphere 1/2.
MAX_RIM_SHARE = 0.1

# Volume over the 3/2 power of the area, below which the surface is flat: a sphere has 0.09.
FLAT_VOLUME = 1e-6


@dataclass(frozen=True)
class Enclosed:
    """What a surface encloses.

    Attributes:
        volume: [m³], positive if the normals point outwards.
        area: of the surface without the fans [m²].
        rim_area: of the fans [m²].
        rims: number of rims.
    """

    volume: float
    area: float
    rim_area: float
    rims: int

    @property
    def has_inside(self) -> bool:
        """Whether the surface is closed but for small rims, and not flat."""
        return bool(has_inside(self.volume, self.area, self.rim_area))


def enclosed_by(domain: dmesh.Mesh, table: EdgeTable) -> Enclosed:
    """Return volume [m³] and areas [m²] of what a mesh of triangles encloses.  Collective.

    Rims of an open surface are spanned by triangles; of several surfaces it is the sums.

    Args:
        domain: the mesh, whose neighbouring triangles have their normals on the same side.
        table: its edges.
    """
    comm = domain.comm
    corners = corner_points(domain)
    low, high = box(comm, corners.reshape(-1, 3))
    # From the middle of the mesh, so that round-off of a distance from the origin does not count.
    corners = corners - (low + high) / 2
    ends, numbers = _rim_edges(domain, table, corners)
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
    volume = float(volumes(corners).sum())
    return Enclosed(
        volume=comm.allreduce(volume, op=MPI.SUM) + rim_volume,
        area=comm.allreduce(area, op=MPI.SUM),
        rim_area=rim_area,
        rims=rims,
    )


def has_inside(volume: Array | float, area: Array | float, rim_area: Array | float) -> Any:
    """Return whether surfaces are closed but for small rims, and not flat.

    Arrays of surfaces, and numbers of one, are taken; the result has their shape.

    Args:
        volume: that they enclose with their rims spanned [m³].
        area: without what spans the rims [m²].
        rim_area: of what spans the rims [m²].
    """
    is_flat = np.abs(volume) < FLAT_VOLUME * np.asarray(area) ** 1.5
    return ~is_flat & (rim_area <= MAX_RIM_SHARE * np.asarray(area))


def volumes(corners: Array) -> Array:
    """Signed volumes (n,) [m³] of the tetrahedra between triangles and the origin.

    Args:
        corners: vertices (n, 3, 3) [m] of the triangles; a volume is positive if the normal points
            away from the origin.

    >>> import numpy as np
    >>> volumes(np.eye(3)[None]).round(4)
    array([0.1667])
    """
    # The three vertices (n, 3) [m]
    x0, x1, x2 = corners.transpose(1, 0, 2)
    result: Array = np.einsum("ij,ij->i", x0, np.cross(x1, x2)) / 6
    return result


def spanning_fans(ends: Array, numbers: npt.NDArray[np.int64]) -> tuple[Array, int]:
    """Return triangles that span the rims of a surface, from each edge to the mean of its rim's
    points.

    Args:
        ends: start and end (n, 2, 3) [m] of edges on the rims, in the direction in which the
            triangle of the surface passes them.
        numbers: of these points (n, 2), global, n > 0; edges that share a number are on one rim.

    Returns:
        corners (n, 3, 3) [m] of the triangle at each edge, whose normals agree with the surface,
        and the number of rims.
    """
    # Imported here: a closed surface has no rims.
    from scipy import sparse
    from scipy.sparse import csgraph

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
    domain: dmesh.Mesh, table: EdgeTable, corners: Array
) -> tuple[Array, npt.NDArray[np.int64]]:
    """Return the edges of this rank's triangles that no other triangle has.

    Args:
        corners: vertices (m, 3, 3) [m] of the triangles that this rank owns.

    Returns:
        both ends (n, 2, 3) [m] of each edge, in the direction in which its triangle passes it, and
        their global numbers (n, 2).
    """
    topology = domain.topology
    owned = len(corners)
    edges = topology.connectivity(2, 1).array.reshape(-1, 3)[:owned]
    vertices = topology.connectivity(2, 0).array.reshape(-1, 3)[:owned]
    numbers = topology.index_map(0).local_to_global(vertices.ravel()).reshape(-1, 3)
    cell, side = np.nonzero(table.count[edges] == 1)
    # Edge i is opposite vertex i; its triangle passes it from vertex i + 1 to vertex i + 2.
    first = (side + 1) % 3
    last = (side + 2) % 3
    ends = np.stack([corners[cell, first], corners[cell, last]], axis=1)
    return ends, np.stack([numbers[cell, first], numbers[cell, last]], axis=1)
