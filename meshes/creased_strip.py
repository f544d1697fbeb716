"""A flat strip of two panels with a crease between them."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh

from .arrays import cell_corners, polyline


def creased_strip(comm: MPI.Intracomm, nx: int, ny: int, length: float, width: float) -> Mesh:
    """Two panels [-length, 0] and [0, length] by [0, width], each of nx × ny cells of two triangles.

    Groups: "film"; the edges "left", "right"; "crease", at x = 0.
    """

    def build(model: Any) -> None:
        along = np.linspace(-length, length, 2 * nx + 1)
        across = np.linspace(0, width, ny + 1)
        x, y = np.meshgrid(along, across)
        # gmsh counts from 1.
        ids = np.arange(1, x.size + 1).reshape(x.shape)
        a, b, c, d = cell_corners(ids)
        film = model.addDiscreteEntity(2)
        points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
        model.mesh.addNodes(2, film, range(1, x.size + 1), points.ravel())
        lower = np.stack([a, b, c], axis=-1).reshape(-1, 3)
        upper = np.stack([a, c, d], axis=-1).reshape(-1, 3)
        triangles = np.concatenate([lower, upper])
        model.mesh.addElementsByType(film, 2, [], triangles.ravel())
        model.addPhysicalGroup(2, [film], name="film")
        lines = {"left": ids[:, 0], "crease": ids[:, nx], "right": ids[:, -1]}
        for name, nodes in lines.items():
            edge = model.addDiscreteEntity(1)
            model.mesh.addElementsByType(edge, 1, [], polyline(nodes).ravel())
            model.addPhysicalGroup(1, [edge], name=name)

    return gmsh_mesh(build, comm)
