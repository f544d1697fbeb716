"""Meshes of which nodes and triangles are known."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh

Points = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Groups = Mapping[str, Numbers]  # nodes of points (1,), or of the edges of curves (n, 2)


def mesh_of_arrays(
    comm: MPI.Intracomm, arrays: Callable[[], tuple[Points, Numbers, Groups]]
) -> Mesh:
    """A mesh of points (n, 3) [m] and triangles (m, 3) between them, which `arrays` makes on rank 0.

    Groups: "film", and those that it names.
    """

    def build(model: Any) -> None:
        points, triangles, groups = arrays()
        film = model.addDiscreteEntity(2)
        model.mesh.addNodes(2, film, range(1, len(points) + 1), points.ravel())
        model.mesh.addElementsByType(film, 2, [], (triangles + 1).ravel())
        model.addPhysicalGroup(2, [film], name="film")
        for name, nodes in groups.items():
            dim = 0 if nodes.ndim == 1 else 1
            entity = model.addDiscreteEntity(dim)
            model.mesh.addElementsByType(entity, 1 if dim else 15, [], (nodes + 1).ravel())
            model.addPhysicalGroup(dim, [entity], name=name)

    return gmsh_mesh(build, comm)


def joined(
    points: Points, triangles: Numbers, tolerance: float = 1e-9
) -> tuple[Points, Numbers, Numbers]:
    """Merge points that coincide; returns also the new number of each point."""
    _, first, where = np.unique(
        np.rint(points / tolerance), axis=0, return_index=True, return_inverse=True
    )
    return points[first], where.ravel()[triangles], where.ravel()


def rim(triangles: Numbers) -> Numbers:
    """Edges (n, 2) of one triangle only."""
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    return edges[count == 1]
