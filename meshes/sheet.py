"""A rectangular sheet with a regular pattern of triangles."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh

EDGES = ("bottom", "right", "top", "left")
CORNERS = ("bottom left", "bottom right", "top right", "top left")


def sheet(
    comm: MPI.Comm,
    nx: int,
    ny: int,
    width: float = 1.0,
    height: float = 1.0,
    crossed: bool = False,
    open_corners: bool = False,
) -> Mesh:
    """nx × ny cells, each of two triangles, on [0, width] × [0, height] in z = 0.

    The diagonals are parallel or, `crossed`, alternate; then a triangle fills every corner of the sheet, or, with
    `open_corners` and even nx and ny, no triangle has all its nodes on the edges.

    Groups: "film"; the edges `EDGES`; the corner points `CORNERS`.
    """

    pattern = "AlternateLeft" if open_corners else "Alternate" if crossed else "Left"

    def build(model: Any) -> None:
        geo = model.geo
        points = [geo.addPoint(x, y, 0) for x, y in ((0, 0), (width, 0), (width, height), (0, height))]
        lines = [geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
        surface = geo.addPlaneSurface([geo.addCurveLoop(lines)])
        for line, n in zip(lines, (nx, ny, nx, ny), strict=True):
            geo.mesh.setTransfiniteCurve(line, n + 1)
        geo.mesh.setTransfiniteSurface(surface, pattern)
        geo.synchronize()
        model.addPhysicalGroup(2, [surface], name="film")
        for name, line in zip(EDGES, lines, strict=True):
            model.addPhysicalGroup(1, [line], name=name)
        for name, point in zip(CORNERS, points, strict=True):
            model.addPhysicalGroup(0, [point], name=name)
        model.mesh.generate(2)

    return gmsh_mesh(build, comm)
