"""A rectangular sheet with a regular pattern of triangles."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh

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
            geo.addPoint(x, y, 0) for x, y in ((0, 0), (width, 0), (width, height), (0, height))
        ]
        lines = [geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
        surface = geo.addPlaneSurface([geo.addCurveLoop(lines)])
        for line, n in zip(lines, (nx, ny, nx, ny), strict=True):
            geo.mesh.setTransfiniteCurve(line, n + 1)
        geo.mesh.setTransfiniteSurface(surface, "Alternate" if crossed else "Left")
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
        mx, my = np.meshgrid(
            (np.arange(nx) + 0.5) * width / nx, (np.arange(ny) + 0.5) * height / ny
        )
        points = np.column_stack([np.append(x, mx), np.append(y, my), np.zeros(x.size + mx.size)])
        grid = np.arange(1, x.size + 1).reshape(x.shape)
        centres = np.arange(x.size + 1, len(points) + 1).reshape(mx.shape)
        a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
        triangles = np.stack([(a, b, centres), (b, c, centres), (c, d, centres), (d, a, centres)])
        film = model.addDiscreteEntity(2)
        model.mesh.addNodes(2, film, range(1, len(points) + 1), points.ravel())
        model.mesh.addElementsByType(film, 2, [], triangles.transpose(0, 2, 3, 1).ravel())
        model.addPhysicalGroup(2, [film], name="film")
        for name, nodes in zip(EDGES, (grid[0], grid[:, -1], grid[-1], grid[:, 0]), strict=True):
            edge = model.addDiscreteEntity(1)
            model.mesh.addElementsByType(
                edge, 1, [], np.column_stack([nodes[:-1], nodes[1:]]).ravel()
            )
            model.addPhysicalGroup(1, [edge], name=name)
        for name, node in zip(
            CORNERS, (grid[0, 0], grid[0, -1], grid[-1, -1], grid[-1, 0]), strict=True
        ):
            corner = model.addDiscreteEntity(0)
            model.mesh.addElementsByType(corner, 15, [], [node])
            model.addPhysicalGroup(0, [corner], name=name)

    return gmsh_mesh(build, comm)
