"""A rectangular sheet with a regular pattern of triangles."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh

from .arrays import cell_corners, polyline

EDGES = ("bottom", "right", "top", "left")
CORNERS = ("bottom left", "bottom right", "top right", "top left")


def sheet(
    comm: MPI.Intracomm,
    nx: int,
    ny: int,
    width: float = 1.0,
    height: float = 1.0,
    crossed: bool = False,
) -> Mesh:
    """nx × ny cells, each of two triangles, on [0, width] × [0, height] in z = 0.

    The diagonals are parallel or, `crossed`, alternate; then a triangle fills every corner of the sheet.

    Groups: "film"; the edges `EDGES`; the corner points `CORNERS`.
    """

    def build(model: Any) -> None:
        geo = model.geo
        points = [
            geo.addPoint(0, 0, 0),
            geo.addPoint(width, 0, 0),
            geo.addPoint(width, height, 0),
            geo.addPoint(0, height, 0),
        ]
        lines = [geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
        surface = geo.addPlaneSurface([geo.addCurveLoop(lines)])
        for line, n in zip(lines, (nx, ny, nx, ny), strict=True):
            geo.mesh.setTransfiniteCurve(line, n + 1)
        pattern = "Alternate" if crossed else "Left"
        geo.mesh.setTransfiniteSurface(surface, pattern)
        geo.synchronize()
        model.addPhysicalGroup(2, [surface], name="film")
        for name, line in zip(EDGES, lines, strict=True):
            model.addPhysicalGroup(1, [line], name=name)
        for name, point in zip(CORNERS, points, strict=True):
            model.addPhysicalGroup(0, [point], name=name)
        model.mesh.generate(2)

    return gmsh_mesh(build, comm)


def crossed_sheet(
    comm: MPI.Intracomm, nx: int, ny: int, width: float = 1.0, height: float = 1.0
) -> Mesh:
    """nx × ny cells, each of the four triangles between its corners and its centre; domain and groups as of `sheet`.

    The pattern has the symmetries of the cells, and no triangle has all its nodes on the edges.
    """

    def build(model: Any) -> None:
        x, y = np.meshgrid(np.linspace(0, width, nx + 1), np.linspace(0, height, ny + 1))
        middles_x = (np.arange(nx) + 0.5) * width / nx
        middles_y = (np.arange(ny) + 0.5) * height / ny
        mx, my = np.meshgrid(middles_x, middles_y)
        all_x = np.append(x, mx)
        all_y = np.append(y, my)
        points = np.column_stack([all_x, all_y, np.zeros(all_x.size)])

        # Numbers of gmsh, from 1: those of the grid, then those of the centres.
        grid = np.arange(1, x.size + 1).reshape(x.shape)
        centres = np.arange(x.size + 1, len(points) + 1).reshape(mx.shape)
        a, b, c, d = cell_corners(grid)
        triangles = np.stack([(a, b, centres), (b, c, centres), (c, d, centres), (d, a, centres)])
        film = model.addDiscreteEntity(2)
        model.mesh.addNodes(2, film, range(1, len(points) + 1), points.ravel())
        model.mesh.addElementsByType(film, 2, [], triangles.transpose(0, 2, 3, 1).ravel())
        model.addPhysicalGroup(2, [film], name="film")
        edges = (grid[0], grid[:, -1], grid[-1], grid[:, 0])
        for name, nodes in zip(EDGES, edges, strict=True):
            edge = model.addDiscreteEntity(1)
            model.mesh.addElementsByType(edge, 1, [], polyline(nodes).ravel())
            model.addPhysicalGroup(1, [edge], name=name)
        corners = (grid[0, 0], grid[0, -1], grid[-1, -1], grid[-1, 0])
        for name, node in zip(CORNERS, corners, strict=True):
            corner = model.addDiscreteEntity(0)
            model.mesh.addElementsByType(corner, 15, [], [node])
            model.addPhysicalGroup(0, [corner], name=name)

    return gmsh_mesh(build, comm)
