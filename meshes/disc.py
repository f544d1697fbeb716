"""A quarter of a disc or ring, structured like a polar grid but without a bad triangle at the centre."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh


def quarter_disc(comm: MPI.Intracomm, cells: int, radius: float = 1.0, order: int = 1) -> Mesh:
    """The part x, y ≥ 0 of a disc of `radius` [m] about the origin, with `cells` edges along a radius.

    `order` 2 gives curved triangles, for films of order 2.

    Groups: "film", "rim", "x axis" (y = 0), "y axis" (x = 0), the points "centre", "rim on x axis".
    """

    def build(model: Any) -> None:
        geo = model.geo
        a = radius
        half = max(round(cells / 2), 1)
        centre = geo.addPoint(0, 0, 0)
        px = geo.addPoint(a, 0, 0)
        py = geo.addPoint(0, a, 0)
        d = a / 2**0.5
        pd = geo.addPoint(d, d, 0)
        mx = geo.addPoint(a / 2, 0, 0)
        my = geo.addPoint(0, a / 2, 0)
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
        surfaces = [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops]
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


def ring(
    comm: MPI.Intracomm, inner: float, outer: float, radial: int, around: int, order: int = 1
) -> Mesh:
    """A flat ring about the origin between two radii [m], `radial` cells across and 4·round(around/4) around.

    Groups: "film", "hub" (the inner circle), "rim".
    """

    def build(model: Any) -> None:
        geo = model.geo
        centre = geo.addPoint(0, 0, 0)
        axes = ((1, 0), (0, 1), (-1, 0), (0, -1))
        circles = []
        for r in (inner, outer):
            points = [geo.addPoint(r * x, r * y, 0) for x, y in axes]
            circles.append(
                (
                    points,
                    [geo.addCircleArc(points[i], centre, points[(i + 1) % 4]) for i in range(4)],
                )
            )
        (hub_points, hub), (rim_points, rim) = circles
        spokes = [geo.addLine(p, q) for p, q in zip(hub_points, rim_points, strict=True)]
        surfaces = [
            geo.addPlaneSurface(
                [geo.addCurveLoop([spokes[i], rim[i], -spokes[(i + 1) % 4], -hub[i]])]
            )
            for i in range(4)
        ]
        for arc in hub + rim:
            geo.mesh.setTransfiniteCurve(arc, max(round(around / 4), 1) + 1)
        for spoke in spokes:
            geo.mesh.setTransfiniteCurve(spoke, radial + 1)
        for surface in surfaces:
            geo.mesh.setTransfiniteSurface(surface, "Alternate")
        geo.synchronize()
        model.addPhysicalGroup(2, surfaces, name="film")
        model.addPhysicalGroup(1, hub, name="hub")
        model.addPhysicalGroup(1, rim, name="rim")
        model.mesh.generate(2)
        model.mesh.setOrder(order)

    return gmsh_mesh(build, comm)
