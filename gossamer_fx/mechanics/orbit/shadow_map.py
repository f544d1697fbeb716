"""Self-shadowing of a film by a depth map, as in computer graphics.

Algorithm, for light along the unit vector u:

1. Project the points of all triangles onto a plane across the light, and divide the plane into
   pixels.
2. For every pixel keep the smallest depth along u of the points in it.  This is the depth map.
3. A point is lit if its depth exceeds that of its pixel by no more than a margin, which allows for
   the slope of the triangle within a pixel.
4. The lit fraction of a triangle is the share of its points that are lit.

Ranks combine their maps by a minimum; triangles are not exchanged.  The cost is proportional to the
number of points and pixels.

Source: L. Williams, ACM SIGGRAPH Computer Graphics 12 (1978) 270, doi:10.1145/965139.807402.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from gossamer_fx import Membrane
from gossamer_fx.extend import Array, Assembly, cell_nodes

Indices = npt.NDArray[np.integer]

# Smallest number of sample points along the edge of a triangle, also where a triangle is smaller
# than a pixel.
_SAMPLES = 6

# Sample points for each pixel along the longest edge; more than one, so that no pixel of a triangle
# stays empty.
_SAMPLES_PER_PIXEL = 1.5

# Margin of the comparison of depths, in pixels: a part for the slope of the triangle, and a part
# for rounding to pixels.
_SLOPE_MARGIN = 2
_FLAT_MARGIN = 0.5

# Smallest cosine between light and normal of which the slope is computed; it limits the margin.
_GRAZING_COSINE = 1e-3


class ShadowMap:
    """The fraction of each triangle of a film that light reaches, where the film shades itself, by
    a depth map with a number of pixels across: `lit` is a function that is constant on triangles, 1
    in light and 0 in shade."""

    def __init__(self, film: Membrane, pixels: int) -> None:
        mesh = film.space.mesh
        self._film = film
        self._pixels = pixels
        self.lit = fem.Function(fem.functionspace(mesh, ("DG", 0)))
        self.lit.x.array[:] = 1.0
        self._owned = mesh.topology.index_map(2).size_local
        self._corners = cell_nodes(film.space)[: self._owned, :3]

    def update(self, system: Assembly, u: Array) -> None:
        """Compute `lit` of all triangles for light along a unit vector u (3,), with the shape at
        the start of the present step.  Collective."""
        x = system.coordinates[self._film].q0.x.array.reshape(-1, 3)
        triangles = x[self._corners]
        lit = lit_fractions(self._film.comm, triangles, u, self._pixels)
        self.lit.x.array[: self._owned] = lit
        self.lit.x.scatter_forward()


def lit_fractions(comm: MPI.Intracomm, triangles: Array, u: Array, pixels: int) -> Array:
    """Fraction (n,), from 0 to 1, of each of this rank's triangles (n, 3, 3) [m] that light along a
    unit vector u (3,) reaches, by a depth map with a number of pixels across.  Collective.

    >>> import numpy as np
    >>> from mpi4py import MPI
    >>> square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> behind = square - [0.0, 0.0, 1.0]
    >>> both = np.array([square, behind])
    >>> lit_fractions(MPI.COMM_SELF, both, np.array([0.0, 0.0, -1.0]), pixels=50)
    array([1., 0.])
    """
    # The right singular vectors of one row are that row and a basis across it.
    right_vectors = np.linalg.svd(u[None])[2]
    across = np.column_stack([right_vectors[1], right_vectors[2]])
    flat = triangles @ across
    depth = triangles @ u

    # Map of square pixels around the points of all ranks; one reduction finds both of its corners.
    low = flat.min(axis=(0, 1), initial=np.inf)
    high = flat.max(axis=(0, 1), initial=-np.inf)
    ends = np.concatenate([low, -high])
    comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MIN)
    low = ends[:2]
    high = -ends[2:]
    pixel = float((high - low).max()) / pixels

    # Triangles with equally many samples are processed together.
    longest = np.ptp(flat, axis=1).max(axis=-1, initial=0.0)
    counts = np.ceil(_SAMPLES_PER_PIXEL * longest / pixel).astype(int)
    counts = np.maximum(counts, _SAMPLES)
    groups = []
    for n in np.unique(counts):
        members = np.flatnonzero(counts == n)
        groups.append((members, _barycentric(n)))

    def samples(which: Indices, weights: Array) -> tuple[Indices, Indices, Array]:
        """Pixel indices i and j, and depths, of the sample points of some triangles."""
        positions = weights @ flat[which]
        indices = ((positions - low) / pixel).astype(int)
        depths = np.einsum("pk,nk->np", weights, depth[which])
        return indices[..., 0], indices[..., 1], depths

    nearest = np.full((pixels + 1, pixels + 1), np.inf)
    for which, weights in groups:
        i, j, depths = samples(which, weights)
        np.minimum.at(nearest, (i, j), depths)
    comm.Allreduce(MPI.IN_PLACE, nearest, op=MPI.MIN)

    # The samples are computed again instead of stored, which saves memory.
    slope = _slopes(triangles, u)
    lit = np.ones(len(triangles))
    for which, weights in groups:
        i, j, depths = samples(which, weights)
        margin = pixel * (_SLOPE_MARGIN * slope[which, None] + _FLAT_MARGIN)
        is_lit = depths <= nearest[i, j] + margin
        lit[which] = is_lit.mean(axis=1)
    return lit


def _slopes(triangles: Array, u: Array) -> Array:
    """Change of depth along a unit vector u (3,) per length across it, the tangent of incidence
    (n,), of triangles (n, 3, 3) [m]; limited to 1000, which is also that of triangles without area.
    """
    first = triangles[:, 1] - triangles[:, 0]
    second = triangles[:, 2] - triangles[:, 0]
    normals = np.cross(first, second)
    # Triangles without area get the cosine zero.
    lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    cosine = np.abs(normals @ u) / lengths
    sine = np.sqrt(1 - np.minimum(cosine, 1) ** 2)
    return sine / np.maximum(cosine, _GRAZING_COSINE)


def _barycentric(n: int) -> Array:
    """Barycentric coordinates (n², 3) of the centres of the n² equal triangles of a triangle."""
    i = np.repeat(np.arange(n), n)
    j = np.tile(np.arange(n), n)
    # Small triangles with the orientation of the large one, and those that are upside down.
    up = i + j < n
    down = i + j < n - 1
    # a, b: second and third barycentric coordinates [-], of the upright and the inverted ones.
    a_up = i[up] + 1 / 3
    a_down = i[down] + 2 / 3
    b_up = j[up] + 1 / 3
    b_down = j[down] + 2 / 3
    a = np.concatenate([a_up, a_down]) / n
    b = np.concatenate([b_up, b_down]) / n
    return np.column_stack([1 - a - b, a, b])
