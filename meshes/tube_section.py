"""A circular cylinder, closed by flat caps or open."""

from __future__ import annotations

import math
from typing import Any

from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh
from gossamer_fx.extend import check_arguments

from .arrays import Cells, Length, Order, check_cells


def capped_cylinder(
    comm: MPI.Intracomm, radius: float, length: float, around: int, along: int, order: int = 1
) -> Mesh:
    """Make a `cylinder` about the x axis that flat caps close, group "caps".  Collective.

    Args:
        radius, length: [m].
        around, along: edges of triangles around, a multiple of four, and along the wall.
        order: 1 for plane triangles, 2 for curved ones.

    Raises:
        InputError: a length is not positive, there are no edges, or the order is another one.
    """
    return cylinder(comm, radius, length, around, along, order, capped=True)


@check_arguments
def cylinder(
    comm: MPI.Intracomm,
    radius: Length,
    length: Length,
    around: Cells,
    along: Cells,
    order: Order = 1,
    capped: bool = False,
) -> Mesh:
    """Make a cylinder about the x axis from x = 0 to `length`.

    Its section is a regular polygon, or, with curved triangles, close to a circle. Normals point
    outwards.  The diagonals of the wall are parallel: where they alternate, nodes of four and of
    eight triangles bear unequal shares of the pressure, and a film of order 1 takes a chequered
    shape whose strains, about (edge/radius)², hide small ones.

    Groups: "wall", "first rim" (x = 0), "last rim", and the four lines "top", "bottom" (z =
    ±radius), "left", "right" (y = ±radius) along the wall; the points "first top" and so on, where
    these lines begin.  Collective.

    Args:
        radius, length: [m].
        around: edges of triangles around, at least 1, rounded to a multiple of four of at least 4.
        along: edges along the wall, at least 1.
        order: 1 for plane triangles, 2 for curved ones.
        capped: whether flat caps close both ends, group "caps".

    Raises:
        InputError: a length is not positive, there are no edges, or the order is another one.
    """
    quarter = max(round(around / 4), 1)
    check_cells("cylinder", 8 * quarter * along)

    def build(model: Any) -> None:
        geo = model.geo
        axes = ((0, 1), (1, 0), (0, -1), (-1, 0))
        arcs = []
        points = []
        for x in (0.0, length):
            centre = geo.addPoint(x, 0, 0)
            ring = [geo.addPoint(x, radius * y, radius * z) for y, z in axes]
            points.append(ring)
            # gmsh draws arcs below 180 degrees only.
            following = ring[1:] + ring[:1]
            arcs.append(
                [geo.addCircleArc(p, centre, q) for p, q in zip(ring, following, strict=True)]
            )
        lines = [geo.addLine(p, q) for p, q in zip(*points, strict=True)]
        # A quarter of the wall between two arcs and two lines along the axis.
        walls = []
        for i in range(4):
            next_line = lines[(i + 1) % 4]
            loop = geo.addCurveLoop([arcs[0][i], next_line, -arcs[1][i], -lines[i]])
            walls.append(geo.addSurfaceFilling([loop]))
        caps = []
        if capped:
            for rim_arcs in arcs:
                loop = geo.addCurveLoop(rim_arcs)
                caps.append(geo.addPlaneSurface([loop]))
        for arc in arcs[0] + arcs[1]:
            geo.mesh.setTransfiniteCurve(arc, quarter + 1)
        for line in lines:
            geo.mesh.setTransfiniteCurve(line, along + 1)
        for wall in walls:
            geo.mesh.setTransfiniteSurface(wall, "Left")
        geo.synchronize()
        model.addPhysicalGroup(2, walls, name="wall")
        if capped:
            model.addPhysicalGroup(2, caps, name="caps")
        model.addPhysicalGroup(1, arcs[0], name="first rim")
        model.addPhysicalGroup(1, arcs[1], name="last rim")
        # In the order of `axes`.
        names = ("top", "left", "bottom", "right")
        for name, line, point in zip(names, lines, points[0], strict=True):
            model.addPhysicalGroup(1, [line], name=name)
            model.addPhysicalGroup(0, [point], name=f"first {name}")
        # Triangles inside the caps are about as large as those at their rims.
        size = 2 * math.pi * radius / (4 * quarter)
        model.mesh.setSize(model.getEntities(0), size)
        model.mesh.generate(2)
        # gmsh's normals of the walls and of the last cap point inwards.
        inwards = [*walls, *caps[1:]]
        model.mesh.reverse([(2, surface) for surface in inwards])
        model.mesh.setOrder(order)

    return gmsh_mesh(build, comm)
