"""The shadow that a film throws on itself: a map of what light meets first."""

from __future__ import annotations

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from gossamer_fx.bodies import Membrane
from gossamer_fx.extend import Array, Assembly, cell_nodes

_SAMPLES = 6  # least number of points along the edge of a triangle


class ShadowMap:
    """Part of each triangle that light reaches, as the function `lit` of a film, constant on triangles.

    Points of all triangles are drawn on a map across the light, which keeps the least way that the light has to go; a
    point further than that by more than two pixels of its slope is in the shade.  Ranks combine their maps, not their
    triangles.

    Args:
        film: that shades itself.
        pixels: across the map.
    """

    def __init__(self, film: Membrane, pixels: int) -> None:
        mesh = film.space.mesh
        self._film, self._pixels = film, pixels
        self.lit = fem.Function(fem.functionspace(mesh, ("DG", 0)))
        self.lit.x.array[:] = 1.0
        self._owned = mesh.topology.index_map(2).size_local
        self._corners = cell_nodes(film.space)[: self._owned, :3]

    def update(self, system: Assembly, u: Array) -> None:
        """Find what light along u reaches at the start of the step; called on all ranks together."""
        x = system.fields[self._film].q0.x.array.reshape(-1, 3)
        self.lit.x.array[: self._owned] = lit_parts(
            self._film.comm, x[self._corners], u, self._pixels
        )
        self.lit.x.scatter_forward()


def lit_parts(comm: MPI.Intracomm, triangles: Array, u: Array, pixels: int) -> Array:
    """Part (n,) of each of this rank's triangles (n, 3, 3) that light along u (3,) reaches."""
    e1, e2 = np.linalg.svd(u[None])[2][1:]
    flat, depth = triangles @ np.column_stack([e1, e2]), triangles @ u
    ends = np.concatenate(
        [flat.min(axis=(0, 1), initial=np.inf), -flat.max(axis=(0, 1), initial=-np.inf)]
    )
    comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MIN)
    low, high = ends[:2], -ends[2:]
    pixel = float((high - low).max()) / pixels
    counts = np.maximum(
        np.ceil(1.5 * np.ptp(flat, axis=1).max(axis=-1, initial=0.0) / pixel).astype(int), _SAMPLES
    )
    nearest = np.full((pixels + 1, pixels + 1), np.inf)
    groups = [(np.flatnonzero(counts == n), _barycentric(n)) for n in np.unique(counts)]
    for which, weights in groups:
        i, j = np.moveaxis(((weights @ flat[which] - low) / pixel).astype(int), -1, 0)
        np.minimum.at(nearest, (i, j), np.einsum("pk,nk->np", weights, depth[which]))
    comm.Allreduce(MPI.IN_PLACE, nearest, op=MPI.MIN)
    edges = np.stack([triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]], axis=1)
    normals = np.cross(edges[:, 0], edges[:, 1])
    c = np.abs(normals @ u) / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    slope = np.sqrt(1 - np.minimum(c, 1) ** 2) / np.maximum(c, 1e-3)
    lit = np.ones(len(triangles))
    for which, weights in groups:
        i, j = np.moveaxis(((weights @ flat[which] - low) / pixel).astype(int), -1, 0)
        ways = np.einsum("pk,nk->np", weights, depth[which])
        free = ways <= nearest[i, j] + pixel * (2 * slope[which, None] + 0.5)
        lit[which] = free.mean(axis=1)
    return lit


def _barycentric(n: int) -> Array:
    """Weights (p, 3) of the centres of the n² equal triangles of a triangle."""
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    up, down = i + j < n, i + j < n - 1
    a = np.concatenate([i[up] + 1 / 3, i[down] + 2 / 3]) / n
    b = np.concatenate([j[up] + 1 / 3, j[down] + 2 / 3]) / n
    return np.column_stack([1 - a - b, a, b])
