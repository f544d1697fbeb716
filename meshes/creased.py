"""Plane films of any outline whose nodes lie on given lines, of one sheet or of two that make a
tube pressed flat."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh
from gossamer_fx.extend import check, check_arguments

from .arrays import (
    GMSH_LINE,
    GMSH_POINT,
    Length,
    Numbers,
    Points,
    add_triangles,
    check_cells,
    rim,
    sorted_sides,
)

Corners = Sequence[tuple[float, float]]
Segments = Sequence[tuple[tuple[float, float], tuple[float, float]]]
ON = 1e-7  # m: nodes that are nearer to a line are on it


@check_arguments
def creased_film(
    comm: MPI.Intracomm, corners: Corners, lines: Segments, size: Sequence[Length]
) -> Mesh:
    """Make a convex polygon in z = 0 of triangles with edges along given lines.

    Groups: "film"; its sides "side 1" and so on, from the first corner to the second and so on, and
    the points "corner 1" and so on.  Collective.

    Args:
        corners: (x, y) of its corners [m], counterclockwise.
        lines: both ends (x, y) of straight lines [m], which may pass over its rim, as
            `Miura.segments` returns them.
        size: of the cells at each corner [m].

    Raises:
        InputError: a size of cells is not positive, or gmsh cannot mesh the polygon.
    """

    _check_polygon("creased_film", corners, size)

    def build(model: Any) -> None:
        # Triangles first: gmsh's own geometry would not know which nodes are on the lines.
        points, triangles = _triangulated(model, corners, lines, size)
        film = model.addDiscreteEntity(2)
        add_triangles(model, film, points, triangles)
        model.addPhysicalGroup(2, [film], name="film")
        _name_rim(model, points, rim(triangles), corners)

    return gmsh_mesh(build, comm)


@check_arguments
def creased_tube(
    comm: MPI.Intracomm,
    corners: Corners,
    lines: Segments,
    size: Length,
    rows: Callable[[Points], Points],
    walls: Sequence[float],
) -> Mesh:
    """Make a closed tube pressed flat to a convex polygon in z = 0, with edges along lines in both
    sheets.

    Compartments end where `rows` has the values `walls`; lines of edges are there.  No triangle has
    all its nodes on the rim, where the sheets are joined: it could not open.  Groups: "top",
    "bottom"; "compartment 1" and so on, "ring 1" and so on between them; "side 1" and so on,
    "corner 1" and so on, as of `creased_film`.  Collective.

    Args:
        corners: (x, y) of the polygon's corners [m], counterclockwise.
        lines: both ends (x, y) of straight lines [m], which may pass over its rim.
        size: of the cells [m].
        rows: function of points (n, 3) [m] that returns (n,), monotonic along the tube.
        walls: its values between compartments, ascending; empty for one compartment.

    Raises:
        InputError: the size of cells is not positive, gmsh cannot mesh the polygon, or cells are so
            coarse that a triangle has all its nodes on the rim.
    """

    _check_polygon("creased_tube", corners, [size] * len(corners))

    def build(model: Any) -> None:
        points, triangles = _triangulated(model, corners, lines, [size] * len(corners))
        edges = rim(triangles)
        on_rim = np.zeros(len(points), dtype=bool)
        on_rim[edges] = True
        triangles = _opened(points, triangles, on_rim, lines)

        # The second sheet shares the nodes of the rim and has its own inside, with new numbers.
        inner_count = (~on_rim).sum()
        twin = np.arange(len(points))
        twin[~on_rim] = len(points) + np.arange(inner_count)

        # The compartment of each triangle, from the row of its middle.
        row = rows(points)
        wall_rows = np.asarray(walls)
        is_on_wall = np.abs(row[:, None] - wall_rows) < ON
        compartment = np.searchsorted(wall_rows, row[triangles].mean(axis=1))
        sides = np.unique(sorted_sides(triangles), axis=0)
        everything = np.vstack([points, points[~on_rim]])
        names: dict[str, list[int]] = {}
        first = True
        # The lower sheet is seen from below: its triangles turn round, so that normals point
        # outwards.
        below = twin[triangles][:, ::-1]
        for sheet, cells in (("top", triangles), ("bottom", below)):
            for i in range(len(walls) + 1):
                entity = model.addDiscreteEntity(2)
                # gmsh wants each node once: the first entity brings those of all.
                nodes = everything if first else everything[:0]
                add_triangles(model, entity, nodes, cells[compartment == i])
                first = False
                for name in (sheet, f"compartment {i + 1}"):
                    names.setdefault(name, []).append(entity)
        for name, entities in names.items():
            model.addPhysicalGroup(2, entities, name=name)
        # Both sheets have the line of a wall.
        for i in range(len(walls)):
            line = sides[is_on_wall[sides, i].all(axis=1)]
            _add_lines(model, f"ring {i + 1}", np.vstack([line, twin[line]]))
        _name_rim(model, points, edges, corners)

    return gmsh_mesh(build, comm)


def _check_polygon(name: str, corners: Corners, size: Sequence[float]) -> None:
    """Raise `InputError` unless corners are those of a convex polygon, counterclockwise, which
    cells of the given sizes [m] at the corners can fill."""
    points = np.array(corners, dtype=float)
    sides = np.roll(points, -1, axis=0) - points
    following = np.roll(sides, -1, axis=0)
    sine = sides[:, 0] * following[:, 1] - sides[:, 1] * following[:, 0]
    turns = np.arctan2(sine, (sides * following).sum(axis=1))
    # A polygon that crosses itself turns round several times.
    check(
        bool((turns > -ON).all()) and bool(np.isclose(turns.sum(), 2 * np.pi)),
        f"{name}: the corners are not those of a convex polygon, counterclockwise; give such ones.",
    )
    check(
        len(size) == len(points),
        f"{name}: size has {len(size)} numbers for {len(points)} corners; give one for each.",
    )
    x, y = points.T
    area = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    check_cells(name, area / (max(size) ** 2 / 2))


def _triangulated(
    model: Any, corners: Corners, lines: Segments, size: Sequence[float]
) -> tuple[Points, Numbers]:
    """Points (n, 3) [m] and triangles (m, 3), with normals along z, of a polygon with
    counterclockwise corners (x, y) [m], where cells have the given sizes [m], and with edges along
    straight lines between two ends (x, y) [m].  The present model of gmsh stays."""
    # A separate model, as the caller's may already have entities.
    current = model.getCurrent()
    model.add("outline")
    occ = model.occ
    tags = []
    for (x, y), h in zip(corners, size, strict=True):
        tags.append(occ.addPoint(x, y, 0, h))
    following = tags[1:] + tags[:1]
    loop = [occ.addLine(a, b) for a, b in zip(tags, following, strict=True)]
    # gmsh makes one surface of the closed loop.
    face = occ.addPlaneSurface([occ.addCurveLoop(loop)])
    cuts = []
    for first, last in lines:
        start = occ.addPoint(*first, 0)
        end = occ.addPoint(*last, 0)
        cuts.append((1, occ.addLine(start, end)))
    inside = []
    if cuts:
        inside, _ = occ.intersect(cuts, [(2, face)], removeTool=False)
    # A line that only touches the polygon leaves a point, by which nothing can be divided.
    occ.fragment([(2, face)], [cut for cut in inside if cut[0] == 1])
    occ.synchronize()
    for dim, tag in model.getEntities(0):
        x, y, _ = model.getValue(dim, tag, [])
        model.mesh.setSize([(dim, tag)], _size_at(x, y, corners, size))
    model.mesh.generate(2)
    # gmsh numbers nodes with gaps, and counts those at the ends of lines outside: only used ones.
    # Sorted, since gmsh lists the nodes entity by entity.
    numbers, coordinates, _ = model.mesh.getNodes()
    _, flat_nodes = model.mesh.getElementsByType(2)
    nodes = flat_nodes.reshape(-1, 3)
    used = np.unique(nodes)
    order = np.argsort(numbers)
    index = np.searchsorted(numbers[order], used)
    points = coordinates.reshape(-1, 3)[order][index]
    triangles = np.searchsorted(used, nodes).astype(np.int64)

    # Parts of a fragmented face may have normals of either sign.
    first = points[triangles[:, 0]]
    along_second = points[triangles[:, 1]] - first
    along_third = points[triangles[:, 2]] - first
    down = np.cross(along_second, along_third)[:, 2] < 0
    triangles[down] = triangles[down][:, ::-1]
    model.remove()
    model.setCurrent(current)
    return points, triangles


def _size_at(x: float, y: float, corners: Corners, size: Sequence[float]) -> float:
    """Size of cells [m] at the point (x, y) [m]: the mean of the corners' sizes, weighted by the
    inverse of the squared distance from each corner."""
    away = np.asarray(corners) - np.array([x, y])
    distance_squared = (away**2).sum(axis=1)
    # At a corner the distance is zero, and the weight of this corner hides all others.
    weight = 1 / (distance_squared + ON**2)
    return float(weight @ np.asarray(size) / weight.sum())


def _opened(points: Points, triangles: Numbers, on_rim: Any, lines: Segments) -> Numbers:
    """Return triangles (m, 3) between points (n, 3) [m] of which none has all its nodes on the rim,
    by the mask `on_rim` (n,), where it could not open.

    Such a triangle gives its inner edge to the node beyond it: the edge is flipped, unless it is on
    one of the fold lines with ends (x, y) [m].  A triangle without an edge that can be flipped
    raises `ValueError` with its centre.
    """
    triangles = triangles.copy()
    for t in np.flatnonzero(on_rim[triangles].all(axis=1)):
        for k in range(3):
            # The edge p-q of the triangle, and the corner c opposite to it.
            c, p, q = np.roll(triangles[t], -k)
            has_p = (triangles == p).any(axis=1)
            has_q = (triangles == q).any(axis=1)
            others = [s for s in np.flatnonzero(has_p & has_q) if s != t]
            # An edge on the rim has no other triangle; one on a fold line has to stay.
            if not others or _on_a_line(points[[p, q]], lines):
                continue
            # The neighbour beyond this edge, and its corner r opposite to it.
            neighbour = others[0]
            r = int(np.setdiff1d(triangles[neighbour], [p, q])[0])
            # Flip the edge: both triangles share c-r then.
            if not on_rim[r]:
                triangles[t] = (c, p, r)
                triangles[neighbour] = (c, r, q)
                break
        else:
            middle = points[triangles[t]].mean(axis=0)
            raise ValueError(
                f"a triangle at ({middle[0]:.4g}, {middle[1]:.4g}) m has all its nodes on the rim; "
                "mesh finer"
            )
    return triangles


def _on_a_line(ends: Points, lines: Segments) -> bool:
    """Whether all points (n, 3) [m], of which x and y count, are within `ON` of one straight line:
    that through one of the segments with ends (x, y) [m], also beyond its ends."""
    for start, end in lines:
        along = np.asarray(end) - np.asarray(start)
        # Distance from the line by the cross product.
        offset = ends[:, :2] - np.asarray(start)
        moment = offset[:, 0] * along[1] - offset[:, 1] * along[0]
        distance = np.abs(moment) / np.hypot(*along)
        if (distance < ON).all():
            return True
    return False


def _add_lines(model: Any, name: str, edges: Numbers) -> None:
    """Add edges (n, 2) between existing nodes, numbered from 0, as a named group of curves in
    gmsh."""
    entity = model.addDiscreteEntity(1)
    model.mesh.addElementsByType(entity, GMSH_LINE, [], (edges + 1).ravel())
    model.addPhysicalGroup(1, [entity], name=name)


def _name_rim(model: Any, points: Points, edges: Numbers, corners: Corners) -> None:
    """Add the groups "side 1", "corner 1" and so on of a polygon with counterclockwise corners (x,
    y) [m] in gmsh; `edges` (k, 2) number the points (n, 3) [m] of each edge on the rim, from 0."""
    for k, a in enumerate(corners):
        b = corners[(k + 1) % len(corners)]
        # Edges of the rim that lie on this side of the polygon.
        on = np.array([_on_a_line(points[edge], [(a, b)]) for edge in edges])
        _add_lines(model, f"side {k + 1}", edges[on])
        # The number of the corner's node is not known: it is found by its coordinates.
        entity = model.addDiscreteEntity(0)
        nearest = np.linalg.norm(points[:, :2] - a, axis=1).argmin()
        model.mesh.addElementsByType(entity, GMSH_POINT, [], [nearest + 1])
        model.addPhysicalGroup(0, [entity], name=f"corner {k + 1}")
