"""Surfaces of revolution, of rings of nodes: torus, capped hull, dish, gored balloon, tube with
bulkheads.

Nodes are on the surface, so that area and volume have errors of second order in the size of plane
cells, and of fourth order in that of curved ones.
Rings near an axis have fewer nodes than those far from it, so that cells are well shaped.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Annotated, NamedTuple

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh
from gossamer_fx.extend import Range, check_arguments

from .arrays import (
    Cells,
    Groups,
    Length,
    Middles,
    Numbers,
    Order,
    Points,
    check_cells,
    mesh_of_arrays,
    polyline,
    require_ascending,
)

# Nodes that each ring of a disc or cap has more than the one inside of it: equilateral triangles
# around the middle.
SECTORS = 6


class Ring(NamedTuple):
    """Nodes on a circle about the axis; a ring of one node is a pole.

    Attributes:
        radius, height: of the circle [m], along the axis.
        nodes: their number, the first one at the angle zero.
    """

    radius: float
    height: float
    nodes: int


class _Surface(NamedTuple):
    """Nodes and triangles of a row of rings: points (n, 3) [m], the nodes (k,) of each ring, and
    the triangles (m, 3) between each ring and the next one."""

    points: Points
    rings: list[Numbers]
    strips: list[Numbers]

    def between(self, first: int, last: int) -> Numbers:
        """Triangles (m, 3) from one ring to another one, by their numbers in the row."""
        return np.concatenate(self.strips[first:last])

    def circle(self, ring: int) -> Numbers:
        """Edges (k, 2) of a ring."""
        return _closed(self.rings[ring])


def _closed(nodes: Numbers) -> Numbers:
    """Edges (n, 2) of a closed line of nodes (n,)."""
    return polyline(np.append(nodes, nodes[0]))


def _surface(rings: Sequence[Ring], *, about_x: bool = False) -> _Surface:
    """Nodes and triangles of rings about the z axis, or about the x axis.

    Normals point away from the axis where the next ring is higher.
    """
    points = []
    numbers: list[Numbers] = []
    start = 0
    for ring in rings:
        angle = 2 * math.pi * np.arange(ring.nodes) / ring.nodes
        across = ring.radius * np.stack([np.cos(angle), np.sin(angle)])
        along = np.full(ring.nodes, ring.height)
        points.append(np.column_stack([*across, along]))
        numbers.append(np.arange(start, start + ring.nodes, dtype=np.int64))
        start += ring.nodes
    nodes = np.concatenate(points)
    if about_x:
        nodes = np.roll(nodes, 1, axis=1)
    strips = [_strip(lower, upper) for lower, upper in pairwise(numbers)]
    return _Surface(nodes, numbers, strips)


def _strip(lower: Numbers, upper: Numbers) -> Numbers:
    """Triangles (n, 3) between two rings of nodes, which may differ in number; nodes at the same
    angle are joined."""
    # A pole has no edges.
    below = len(lower) if len(lower) > 1 else 0
    above = len(upper) if len(upper) > 1 else 0
    triangles = []
    i = 0
    j = 0
    while i < below or j < above:
        a = lower[i % len(lower)]
        b = upper[j % len(upper)]
        # Next is the edge that ends first; of equal rings all diagonals are parallel.
        is_lower_first = (i + 1) * above <= (j + 1) * below
        if i < below and (is_lower_first or j == above):
            triangles.append((a, lower[(i + 1) % len(lower)], b))
            i += 1
        else:
            triangles.append((a, upper[(j + 1) % len(upper)], b))
            j += 1
    return np.array(triangles)


# Moves points at radii (k,) and heights (k,) [m] on the axis to the surface.
Profile = Callable[[Points, Points], tuple[Points, Points]]


def _middles(
    order: int, profile: Profile, *, rim: float | None = None, about_x: bool = False
) -> Middles | None:
    """Middle nodes of edges on a surface of revolution, see `mesh_of_arrays`; None for order 1.

    They are the points half-way, moved to the surface at the same angle.  Edges with both ends at
    the radius `rim` [m] are arcs of a circle.
    """
    if order == 1:
        return None

    def middles(a: Points, b: Points) -> Points:
        if about_x:
            a, b = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
        half_way = (a + b) / 2
        along = half_way[:, 2]
        radius = np.hypot(half_way[:, 0], half_way[:, 1])
        angle = np.arctan2(half_way[:, 1], half_way[:, 0])
        if rim is not None:
            out = np.minimum(np.hypot(a[:, 0], a[:, 1]), np.hypot(b[:, 0], b[:, 1]))
            radius = np.where(np.isclose(out, rim, rtol=1e-9, atol=0.0), rim, radius)
        radius, along = profile(radius, along)
        found = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), along])
        return np.roll(found, 1, axis=1) if about_x else found

    return middles


def _as_it_is(radius: Points, along: Points) -> tuple[Points, Points]:
    """The profile of discs and cylinders: nothing but the rim is curved."""
    return radius, along


def _ellipse(
    radius: Points, along: Points, semi_axes: tuple[float, float]
) -> tuple[Points, Points]:
    """Radii and heights moved from the middle of an ellipse to it; `semi_axes`: across and along
    the axis [m]."""
    factor = 1 / np.hypot(radius / semi_axes[0], along / semi_axes[1])
    return radius * factor, along * factor


def _disc(radius: float, height: float, cells: int) -> list[Ring]:
    """Rings of a flat disc of a radius [m] at a height [m], from its centre to its rim."""
    rings = [Ring(0.0, height, 1)]
    for k in range(1, cells + 1):
        rings.append(Ring(radius * k / cells, height, SECTORS * k))
    return rings


@check_arguments
def torus(
    comm: MPI.Intracomm,
    radius: Length,
    tube_radius: Length,
    around: Annotated[int, Range(3)],
    around_tube: Cells,
    order: Order = 1,
) -> Mesh:
    """Make a torus about the z axis; normals point outwards.

    Groups: "film"; the circles "outer", "top", "inner", "bottom".  Collective.

    Args:
        radius: from the axis to the middle of the tube [m].
        tube_radius: [m], the smaller one.
        around: edges along the torus, at least 3.
        around_tube: edges around the tube, rounded to a multiple of four of at least 4.
        order: of the geometry, 1 for plane triangles or 2 for curved ones.

    Raises:
        InputError: a radius is not positive, the tube reaches the axis, or there are too few edges.
    """
    require_ascending("torus", ("tube_radius", "radius"), (tube_radius, radius))
    quarter = max(round(around_tube / 4), 1)
    check_cells("torus", 8 * quarter * around)

    def arrays() -> tuple[Points, Numbers, Groups]:
        rings = []
        for k in range(4 * quarter):
            angle = math.pi / 2 * k / quarter
            out = radius + tube_radius * math.cos(angle)
            rings.append(Ring(out, tube_radius * math.sin(angle), around))
        surface = _surface(rings)
        # The last ring is followed by the first one.
        closing = _strip(surface.rings[-1], surface.rings[0])
        triangles = np.concatenate([*surface.strips, closing])
        circles = {
            name: surface.circle(k * quarter)
            for k, name in enumerate(("outer", "top", "inner", "bottom"))
        }
        return surface.points, triangles, circles

    def on_tube(out: Points, along: Points) -> tuple[Points, Points]:
        across, along = _ellipse(out - radius, along, (tube_radius, tube_radius))
        return radius + across, along

    return mesh_of_arrays(comm, arrays, _middles(order, on_tube))


@check_arguments
def hull(
    comm: MPI.Intracomm,
    radius: Length,
    length: Length,
    cells: Cells,
    cap_height: Length | None = None,
    order: Order = 1,
) -> Mesh:
    """Make a cylinder about the x axis from x = 0 to `length` that domes close; normals point
    outwards.

    Groups: "film", "wall", "first cap" (x < 0), "last cap"; the circles "first rim" (x = 0), "last
    rim"; the points "first pole", "last pole".  Collective.

    Args:
        radius, length: of the cylinder [m].
        cells: edges from a pole to its rim; six times as many are around.
        cap_height: of the domes, half ellipsoids [m]; None: the radius, half spheres.
        order: of the geometry, 1 for plane triangles or 2 for curved ones.

    Raises:
        InputError: a length is not positive, or there are no edges.
    """
    height = radius if cap_height is None else cap_height
    around = SECTORS * cells
    along = max(round(length * around / (2 * math.pi * radius)), 1)
    check_cells("hull", 2 * SECTORS * cells**2 + 2 * around * along)

    def arrays() -> tuple[Points, Numbers, Groups]:
        dome = []
        for k in range(cells):
            angle = math.pi / 2 * k / cells
            dome.append(Ring(radius * math.sin(angle), -height * math.cos(angle), SECTORS * k or 1))
        wall = [Ring(radius, x, around) for x in np.linspace(0.0, length, along + 1)]
        other = [Ring(r, length - x, count) for r, x, count in reversed(dome)]
        surface = _surface([*dome, *wall, *other], about_x=True)
        first = cells
        last = cells + along
        groups = {
            "first cap": surface.between(0, first),
            "wall": surface.between(first, last),
            "last cap": surface.between(last, len(surface.strips)),
            "first rim": surface.circle(first),
            "last rim": surface.circle(last),
            "first pole": surface.rings[0],
            "last pole": surface.rings[-1],
        }
        return surface.points, np.concatenate(surface.strips), groups

    def on_hull(out: Points, along: Points) -> tuple[Points, Points]:
        # Heights beyond the ends of the wall, where the domes are.
        beyond = along - np.clip(along, 0.0, length)
        in_dome, in_height = _ellipse(out, beyond, (radius, height))
        return in_dome, along - beyond + in_height

    return mesh_of_arrays(comm, arrays, _middles(order, on_hull, about_x=True))


@check_arguments
def dish(
    comm: MPI.Intracomm, radius: Length, focal_length: Length, cells: Cells, order: Order = 1
) -> Mesh:
    """Make a paraboloid z = r²/(4 f) about the z axis; normals point to its focus.

    Groups: "film", "rim", the point "centre".  Collective.

    Args:
        radius: of the rim [m].
        focal_length: f [m].
        cells: edges along a radius; six times as many are on the rim.
        order: of the geometry, 1 for plane triangles or 2 for curved ones.

    Raises:
        InputError: a length is not positive, or there are no edges.
    """
    check_cells("dish", SECTORS * cells**2)
    flat = _disc(radius, 0.0, cells)
    rings = [Ring(r, r**2 / (4 * focal_length), n) for r, _, n in flat]

    def on_dish(out: Points, along: Points) -> tuple[Points, Points]:
        height: Points = np.square(out) / (4 * focal_length)
        return out, height

    return _disc_mesh(comm, rings, _middles(order, on_dish, rim=radius))


@check_arguments
def whole_disc(comm: MPI.Intracomm, cells: Cells, radius: Length = 1.0, order: Order = 1) -> Mesh:
    """Make a disc about the origin in z = 0 of rings of triangles, the k-th ring with 6k nodes on
    its circle.

    Groups: "film", "rim", the point "centre".  Collective.

    Args:
        cells: number of rings, at least 1.
        radius: [m].
        order: of the geometry, 1, or 2 with arcs at the rim.

    Raises:
        InputError: there are no rings, or the radius is not positive.
    """
    check_cells("whole_disc", SECTORS * cells**2)
    return _disc_mesh(comm, _disc(radius, 0.0, cells), _middles(order, _as_it_is, rim=radius))


def _disc_mesh(
    comm: MPI.Intracomm, rings: list[Ring], middles: Middles | None, *, about_x: bool = False
) -> Mesh:
    """A mesh of rings from a centre to a rim, with normals along the axis, and with the groups
    "rim" and "centre".  Collective."""

    def arrays() -> tuple[Points, Numbers, Groups]:
        surface = _surface(rings, about_x=about_x)
        # Those of `_surface` point to the other side.
        triangles = np.concatenate(surface.strips)[:, ::-1]
        return (
            surface.points,
            triangles,
            {"rim": surface.circle(-1), "centre": surface.rings[0]},
        )

    return mesh_of_arrays(comm, arrays, middles)


@check_arguments
def balloon(
    comm: MPI.Intracomm,
    radius: Length,
    gores: Annotated[int, Range(3)],
    cells: Cells,
    height: Length | None = None,
    order: Order = 1,
) -> Mesh:
    """Make a closed ellipsoid about the z axis whose edges follow the seams of its gores; normals
    point outwards.

    Groups: "film", the gores "gore 1" and so on, counterclockwise from the x axis; the curves "seam
    1" and so on, where these begin, and "equator"; the points "south pole", "north pole".
    Collective.

    Args:
        radius: of the equator [m].
        gores: their number, at least 3.
        cells: edges across a gore at the equator.
        height: from pole to pole [m]; None: twice the radius, a sphere.
        order: of the geometry, 1 for plane triangles or 2 for curved ones.

    Raises:
        InputError: a length is not positive, or there are too few gores or edges.
    """
    half_height = radius if height is None else height / 2
    edge = 2 * math.pi * radius / (gores * cells)
    # The circumference of the ellipse over 2π, by Ramanujan; a quarter of it is from a pole to the
    # equator.
    mean_radius = (3 * (radius + half_height)) / 2 - math.sqrt(
        (3 * radius + half_height) * (radius + 3 * half_height)
    ) / 2
    quarter = max(round(math.pi / 2 * mean_radius / edge), 2)
    check_cells("balloon", 4 * gores * cells * quarter)

    def arrays() -> tuple[Points, Numbers, Groups]:
        # Rings from pole to pole, and for each the number of its nodes to a gore; a pole has one
        # node, at which all seams meet.
        rings = [Ring(0.0, -half_height, 1)]
        nodes_of_gore = [0]
        for k in range(1, 2 * quarter):
            angle = math.pi / 2 * k / quarter
            of_gore = max(round(cells * math.sin(angle)), 1)
            out = radius * math.sin(angle)
            rings.append(Ring(out, -half_height * math.cos(angle), gores * of_gore))
            nodes_of_gore.append(of_gore)
        rings.append(Ring(0.0, half_height, 1))
        nodes_of_gore.append(0)
        surface = _surface(rings)
        triangles = np.concatenate(surface.strips)
        middles = surface.points[triangles].mean(axis=1)
        azimuths = np.arctan2(middles[:, 1], middles[:, 0]) % (2 * math.pi)
        gore = np.floor(azimuths * gores / (2 * math.pi))
        groups: dict[str, Numbers] = {}
        for k in range(gores):
            counts = zip(surface.rings, nodes_of_gore, strict=True)
            seam = np.array([ring[k * m] for ring, m in counts])
            groups[f"gore {k + 1}"] = triangles[gore == k]
            groups[f"seam {k + 1}"] = polyline(seam)
        groups["equator"] = surface.circle(quarter)
        groups["south pole"] = surface.rings[0]
        groups["north pole"] = surface.rings[-1]
        return surface.points, triangles, groups

    def on_ellipsoid(out: Points, along: Points) -> tuple[Points, Points]:
        return _ellipse(out, along, (radius, half_height))

    return mesh_of_arrays(comm, arrays, _middles(order, on_ellipsoid))


class BulkheadTube(NamedTuple):
    """A closed tube and its bulkheads, each with a separate mesh: an edge of a mesh has at most
    two triangles.

    Attributes:
        wall: the tube with flat caps.
        bulkheads: discs across it; the rim of the k-th one has the nodes of "ring k" of the wall,
            to which a `Tie` joins it.
    """

    wall: Mesh
    bulkheads: list[Mesh]


@check_arguments
def bulkhead_tube(
    comm: MPI.Intracomm,
    radius: Length,
    length: Length,
    cells: Cells,
    compartments: Cells,
    order: Order = 1,
) -> BulkheadTube:
    """Make a closed tube about the x axis from x = 0 to `length`, divided by flat bulkheads;
    normals of the tube point outwards, those of bulkheads along x.

    Groups of the tube: "film", "first cap", "compartment 1" and so on, "last cap"; the circles
    "first rim" (x = 0), "ring 1" and so on at the bulkheads, "last rim".  Groups of a bulkhead:
    "film", "rim", the point "centre".  Collective.

    Args:
        radius, length: [m].
        cells: edges along the radius of a bulkhead; six times as many are around.
        compartments: of equal length; there is a bulkhead between each and the next.
        order: of the geometry, 1 for plane triangles or 2 for curved ones.

    Raises:
        InputError: a length is not positive, or there are no edges or compartments.
    """
    around = SECTORS * cells
    each = length / compartments
    along = max(round(each * around / (2 * math.pi * radius)), 1)
    check_cells("bulkhead_tube", 2 * SECTORS * cells**2 + 2 * around * along * compartments)

    def wall() -> tuple[Points, Numbers, Groups]:
        first = _disc(radius, 0.0, cells)
        # Between the rims, which belong to the caps.
        stations = np.linspace(0.0, length, along * compartments + 1)[1:-1]
        rows = [Ring(radius, x, around) for x in stations]
        last = reversed(_disc(radius, length, cells))
        surface = _surface([*first, *rows, *last], about_x=True)
        end = cells + along * compartments
        groups = {
            "first cap": surface.between(0, cells),
            "last cap": surface.between(end, len(surface.strips)),
            "first rim": surface.circle(cells),
            "last rim": surface.circle(end),
        }
        for k in range(compartments):
            start = cells + k * along
            groups[f"compartment {k + 1}"] = surface.between(start, start + along)
            if k:
                groups[f"ring {k}"] = surface.circle(start)
        return surface.points, np.concatenate(surface.strips), groups

    middles = _middles(order, _as_it_is, rim=radius, about_x=True)
    tube = mesh_of_arrays(comm, wall, middles)
    bulkheads = []
    for k in range(1, compartments):
        rings = _disc(radius, k * each, cells)
        bulkheads.append(_disc_mesh(comm, rings, middles, about_x=True))
    return BulkheadTube(tube, bulkheads)
