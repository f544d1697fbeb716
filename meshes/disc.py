"""A quarter of a disc or ring, structured like a polar grid but without a bad triangle at the
centre."""

from __future__ import annotations

from typing import Any, NamedTuple

from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh
from gossamer_fx.extend import check_arguments

from .arrays import Cells, Length, Order, check_cells, require_ascending


@check_arguments
def quarter_disc(comm: MPI.Intracomm, cells: Cells, radius: Length = 1.0, order: Order = 1) -> Mesh:
    """Make the part x, y ≥ 0 of a disc about the origin, of four-sided patches without a bad
    triangle.

    Groups: "film", "rim", "x axis" (y = 0), "y axis" (x = 0), the points "centre", "rim on x axis".
    Collective.

    Args:
        cells: edges of triangles along a radius, at least 1, rounded to an even number of at least
            2.
        radius: [m].
        order: 1 for plane triangles, 2 for curved ones, for films of order 2.

    Raises:
        InputError: the radius is not positive, there are no cells, or the order is another one.
    """
    check_cells("quarter_disc", 6 * cells**2)

    def build(model: Any) -> None:
        geo = model.geo
        a = radius
        # Three four-sided patches meet at a point inside; a radius passes through two of them.
        half = max(round(cells / 2), 1)
        centre = geo.addPoint(0, 0, 0)
        # Points p on the rim and m at mid-radius: on the x axis, the y axis and the diagonal (d).
        px = geo.addPoint(a, 0, 0)
        py = geo.addPoint(0, a, 0)
        d = a / 2**0.5
        pd = geo.addPoint(d, d, 0)
        mx = geo.addPoint(a / 2, 0, 0)
        my = geo.addPoint(0, a / 2, 0)
        # On the diagonal, between the circle through mx and my, 0.35 a, and the corner of their
        # square, 0.5 a.
        md = geo.addPoint(0.41 * a, 0.41 * a, 0)
        inner_x = geo.addLine(centre, mx)
        outer_x = geo.addLine(mx, px)
        inner_y = geo.addLine(centre, my)
        outer_y = geo.addLine(my, py)
        to_x = geo.addLine(mx, md)
        to_y = geo.addLine(my, md)
        spoke = geo.addLine(md, pd)
        arc_x = geo.addCircleArc(px, centre, pd)
        arc_y = geo.addCircleArc(pd, centre, py)
        loops = [
            [inner_x, to_x, -to_y, -inner_y],
            [outer_x, arc_x, -spoke, -to_x],
            [spoke, arc_y, -outer_y, to_y],
        ]
        surfaces = []
        for loop in loops:
            curve = geo.addCurveLoop(loop)
            surfaces.append(geo.addPlaneSurface([curve]))
        for line in (inner_x, outer_x, inner_y, outer_y, to_x, to_y, spoke, arc_x, arc_y):
            geo.mesh.setTransfiniteCurve(line, half + 1)
        for surface in surfaces:
            geo.mesh.setTransfiniteSurface(surface, "Alternate")
        geo.synchronize()
        model.addPhysicalGroup(2, surfaces, name="film")
        model.addPhysicalGroup(1, [arc_x, arc_y], name="rim")
        model.addPhysicalGroup(1, [inner_x, outer_x], name="x axis")
        model.addPhysicalGroup(1, [inner_y, outer_y], name="y axis")
        model.addPhysicalGroup(0, [centre], name="centre")
        model.addPhysicalGroup(0, [px], name="rim on x axis")
        model.mesh.generate(2)
        model.mesh.setOrder(order)

    return gmsh_mesh(build, comm)


class Circle(NamedTuple):
    """Numbers in gmsh of a circle's four points on the axes, and of the arcs between them."""

    points: list[int]
    arcs: list[int]


@check_arguments
def ring(
    comm: MPI.Intracomm,
    inner: Length,
    outer: Length,
    radial: Cells,
    around: Cells,
    order: Order = 1,
) -> Mesh:
    """Make a flat ring about the origin between two radii.

    Groups: "film", "hub" (the inner circle), "rim".  Collective.

    Args:
        inner, outer: radii [m].
        radial: cells of two triangles from hub to rim, at least 1.
        around: cells around, at least 1, rounded to a multiple of four of at least 4.
        order: 1 for plane triangles, 2 for curved ones.

    Raises:
        InputError: a radius is not positive, the inner one is not the smaller one, there are no
            cells, or the order is another one.
    """
    require_ascending("ring", ("inner", "outer"), (inner, outer))
    check_cells("ring", 2 * radial * around)

    def build(model: Any) -> None:
        geo = model.geo
        centre = geo.addPoint(0, 0, 0)

        def circle(radius: float) -> Circle:
            """Draw a circle of a radius [m] about the origin."""
            # Four quarters, since gmsh draws only arcs of less than half a circle.
            axes = (
                (1, 0),
                (0, 1),
                (-1, 0),
                (0, -1),
            )
            points = [geo.addPoint(radius * x, radius * y, 0) for x, y in axes]
            following = points[1:] + points[:1]
            arcs = [geo.addCircleArc(p, centre, q) for p, q in zip(points, following, strict=True)]
            return Circle(points, arcs)

        hub = circle(inner)
        rim = circle(outer)
        # Spokes divide the ring into four-sided patches, which gmsh fills with rows of cells.
        spokes = [geo.addLine(p, q) for p, q in zip(hub.points, rim.points, strict=True)]
        surfaces = []
        for i in range(4):
            next_spoke = spokes[(i + 1) % 4]
            curve = geo.addCurveLoop([spokes[i], rim.arcs[i], -next_spoke, -hub.arcs[i]])
            surfaces.append(geo.addPlaneSurface([curve]))
        cells_of_arc = max(round(around / 4), 1)
        for arc in hub.arcs + rim.arcs:
            geo.mesh.setTransfiniteCurve(arc, cells_of_arc + 1)
        for spoke in spokes:
            geo.mesh.setTransfiniteCurve(spoke, radial + 1)
        for surface in surfaces:
            # Alternating diagonals give the mesh no sense of rotation.
            geo.mesh.setTransfiniteSurface(surface, "Alternate")
        geo.synchronize()
        model.addPhysicalGroup(2, surfaces, name="film")
        model.addPhysicalGroup(1, hub.arcs, name="hub")
        model.addPhysicalGroup(1, rim.arcs, name="rim")
        model.mesh.generate(2)
        model.mesh.setOrder(order)

    return gmsh_mesh(build, comm)
