"""A tube pressed flat: two strips that share their four edges."""

from __future__ import annotations

import math
from typing import Any

from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh


def flat_tube(comm: MPI.Comm, length: float, diameter: float, cells: int) -> Mesh:
    """A closed tube of `length` and `diameter` [m], pressed flat into z = 0, with `cells` edges of triangles across.

    The film of a cylinder is flat when it is unrolled, so the two strips of width π d/2 are stress-free; the ends are
    closed by joining the strips.  Interior nodes of the strips coincide in space and differ in topology; normals
    point outwards.  With even numbers of cells the alternating pattern is symmetric, and no triangle has all its nodes
    on the edges, where it could not open.

    Groups: "top", "bottom", the seams "inlet" (x = 0), "tip", "left", "right", and the points "tip left",
    "tip right".
    """
    width = math.pi * diameter / 2
    across = 2 * max(round(cells / 2), 1)
    along = 2 * max(round(across * length / width / 2), 1)

    def build(model: Any) -> None:
        geo = model.geo
        size = width / across
        corners = [(0, -width / 2), (length, -width / 2), (length, width / 2), (0, width / 2)]
        points = [geo.addPoint(x, y, 0, size) for x, y in corners]
        lines = [geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
        loop = geo.addCurveLoop(lines)
        strips = [geo.addPlaneSurface([loop]) for _ in range(2)]
        for line, n in zip(lines, (along, across, along, across), strict=True):
            geo.mesh.setTransfiniteCurve(line, n + 1)
        for strip in strips:
            geo.mesh.setTransfiniteSurface(strip, "AlternateLeft")
        geo.synchronize()
        for name, strip in zip(("top", "bottom"), strips, strict=True):
            model.addPhysicalGroup(2, [strip], name=name)
        for name, line in zip(("right", "tip", "left", "inlet"), lines, strict=True):
            model.addPhysicalGroup(1, [line], name=name)
        model.addPhysicalGroup(0, [points[1]], name="tip right")
        model.addPhysicalGroup(0, [points[2]], name="tip left")
        model.mesh.generate(2)
        model.mesh.reverse([(2, strips[1])])

    return gmsh_mesh(build, comm)
