"""Rectangular sheets with a regular pattern of triangles."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh
from gossamer_fx.extend import check_arguments

from .arrays import (
    Cells,
    Groups,
    Length,
    Numbers,
    Order,
    Points,
    around_centres,
    cell_corners,
    check_cells,
    mesh_of_arrays,
    plane_grid,
    polyline,
)

EDGES = ("bottom", "right", "top", "left")
CORNERS = ("bottom left", "bottom right", "top right", "top left")


@check_arguments
def sheet(
    comm: MPI.Intracomm,
    nx: Cells,
    ny: Cells,
    width: Length = 1.0,
    height: Length = 1.0,
    crossed: bool = False,
    order: Order = 1,
) -> Mesh:
    """Make a rectangular sheet [0, width] × [0, height] in z = 0 of nx × ny cells of two triangles.

    Groups: "film"; the edges `EDGES`; the corner points `CORNERS`.  Collective.

    Args:
        nx, ny: cells along x and y, at least 1.
        width, height: [m].
        crossed: whether diagonals alternate instead of being parallel; then a triangle fills every
            corner of the sheet if nx and ny are even.
        order: of the geometry, 1, or 2 with nodes in the middle of edges, to be moved to a curve.

    Raises:
        InputError: a length is not positive, or there are no cells.
    """
    check_cells("sheet", 4 * nx * ny)

    def build(model: Any) -> None:
        geo = model.geo
        points = [
            geo.addPoint(0, 0, 0),
            geo.addPoint(width, 0, 0),
            geo.addPoint(width, height, 0),
            geo.addPoint(0, height, 0),
        ]
        # Edge k goes from corner k to the next one, as `EDGES` names them.
        lines = []
        for k in range(4):
            following = points[(k + 1) % 4]
            lines.append(geo.addLine(points[k], following))
        surface = geo.addPlaneSurface([geo.addCurveLoop(lines)])

        # As many nodes as the numbers of cells ask for, at even distances.
        for line, cells in zip(lines, (nx, ny, nx, ny), strict=True):
            geo.mesh.setTransfiniteCurve(line, cells + 1)
        pattern = "Alternate" if crossed else "Left"
        geo.mesh.setTransfiniteSurface(surface, pattern)
        geo.synchronize()

        model.addPhysicalGroup(2, [surface], name="film")
        for name, line in zip(EDGES, lines, strict=True):
            model.addPhysicalGroup(1, [line], name=name)
        for name, point in zip(CORNERS, points, strict=True):
            model.addPhysicalGroup(0, [point], name=name)
        model.mesh.generate(2)
        model.mesh.setOrder(order)

    return gmsh_mesh(build, comm)


@check_arguments
def crossed_sheet(
    comm: MPI.Intracomm, nx: Cells, ny: Cells, width: Length = 1.0, height: Length = 1.0
) -> Mesh:
    """Make a rectangular sheet [0, width] × [0, height] of cells of four triangles around a centre.

    The pattern has the symmetries of the cells, and no triangle has all its nodes on the edges.
    Groups: "film"; the edges `EDGES`; the corner points `CORNERS`.  Collective.

    Args:
        nx, ny: cells along x and y, at least 1.
        width, height: [m].

    Raises:
        InputError: a length is not positive, or there are no cells.
    """
    check_cells("crossed_sheet", 4 * nx * ny)

    def arrays() -> tuple[Points, Numbers, Groups]:
        corners = plane_grid(np.linspace(0, width, nx + 1), np.linspace(0, height, ny + 1))
        # gmsh has no such pattern: the centres of the cells are further nodes, after those of the
        # grid.
        middles_x = (np.arange(nx) + 0.5) * width / nx
        middles_y = (np.arange(ny) + 0.5) * height / ny
        points = np.vstack([corners, plane_grid(middles_x, middles_y)])

        grid = np.arange(len(corners)).reshape(ny + 1, nx + 1)
        centre = np.arange(len(corners), len(points)).reshape(ny, nx)
        triangles = around_centres(cell_corners(grid), centre)
        groups = {
            "bottom": polyline(grid[0]),
            "right": polyline(grid[:, -1]),
            "top": polyline(grid[-1]),
            "left": polyline(grid[:, 0]),
            "bottom left": grid[0, :1],
            "bottom right": grid[0, -1:],
            "top right": grid[-1, -1:],
            "top left": grid[-1, :1],
        }
        return points, triangles, groups

    return mesh_of_arrays(comm, arrays)
