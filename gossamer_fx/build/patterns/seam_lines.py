"""Lines on triangulated surfaces: sections with planes, and lines through given points.

A line crosses triangles.  It is a chain of straight segments, each of them in one triangle, that
begin and end on sides of triangles or at given points.

Algorithm of a section.  A triangle has a segment if its corners are on both sides of the plane; a
corner in the plane counts as in front of it, so that a plane through corners or along sides of
triangles needs no cases apart.  A segment enters a triangle through the side that is passed
from the front to the back, counterclockwise about the normal, and leaves it through the other one,
which is the entrance of the next triangle.  All segments thus follow (normal of the plane) ×
(normal of the surface).

Algorithm of a line through points.  From one point to the next the line follows the section with
the plane through both that contains the mean normal of the surface there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gossamer_fx.build.patterns.closest import ClosestPoints, Numbers, barycentric
from gossamer_fx.build.patterns.triangulation import Triangulation, as_list, as_rows
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import InputError, check
from gossamer_fx.core.model.body import Array

# Distance of a corner from a plane, over the size of the surface, below which it is in the plane.
IN_PLANE = 1e-9

# Barycentric coordinate below which a point is on a side of a triangle: well above `IN_PLANE`.
ON_SIDE = 1e-6

# Distance of given points from the surface, over its size, that is refused.
FAR = 0.02

# Height over a side at the rim, over that of the triangle, below which the end of a line is on the
# rim: points of a round rim lie off its chords by h/8 of their length times the angle between them.
AT_RIM = 0.05

# Length of the way from a point to the next, over their distance, at which a search is given up.
LONGEST_WAY = 10.0


@check_arguments
@dataclass(frozen=True, eq=False)
class SeamLine:
    """A line on a surface, of k straight segments; made by `FormSurface.by_planes` and others.

    Attributes:
        triangles: number (k,) of the triangle of each segment.
        starts: (k, 3) [m].
        ends: (k, 3) [m]; each is the start of the next segment.

    Example:
        >>> points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
        >>> square = gx.patterns.surface((points, [[0, 1, 2], [0, 2, 3]]))
        >>> line, = square.by_planes([[0.25, 0, 0]], (1, 0, 0))
        >>> line.length, len(line.points)
        (1.0, 3)
    """

    triangles: Numbers
    starts: Array
    ends: Array

    @property
    def points(self) -> Array:
        """The points (k + 1, 3) [m] of the line, from its start to its end."""
        return np.concatenate([self.starts, self.ends[-1:]])

    @property
    def length(self) -> float:
        """Length [m]."""
        return float(np.linalg.norm(self.ends - self.starts, axis=1).sum())


@dataclass(frozen=True, eq=False)
class Neighbours:
    """The triangles of a surface by their sides.

    Attributes:
        across: for each triangle the one (m, 3) at the side from corner i to corner i + 1, -1 at
            the rim.
        at_corner: the triangles at each point.
    """

    across: Numbers
    at_corner: list[list[int]]


def neighbours_of(surface: Triangulation) -> Neighbours:
    """The neighbours of all triangles of a surface."""
    sides: dict[tuple[int, int], int] = {}
    at_corner: list[list[int]] = [[] for _ in surface.points]
    rows = as_rows(surface.triangles)
    for t, corners in enumerate(rows):
        for i in range(3):
            sides[corners[i], corners[(i + 1) % 3]] = t
            at_corner[corners[i]].append(t)
    # Normals are consistent, so that a neighbour passes the same side in the opposite direction.
    across = [
        [sides.get((corners[(i + 1) % 3], corners[i]), -1) for i in range(3)] for corners in rows
    ]
    return Neighbours(np.array(across, dtype=np.int64), at_corner)


@dataclass(frozen=True, eq=False)
class PlaneSection:
    """The section of a surface with a plane, triangle by triangle.

    Attributes:
        enters: side (m,) through which a segment enters each triangle, -1 without a segment.
        leaves: side (m,) through which it leaves.
        crossings: points (m, 3, 3) [m] where the plane crosses the sides; NaN elsewhere.
    """

    enters: Numbers
    leaves: Numbers
    crossings: Array


def section(surface: Triangulation, point: Array, normal: Array) -> PlaneSection:
    """The section of a surface with the plane through a point (3,) [m] with a unit normal (3,)."""
    size = surface.extent
    distance = (surface.points - point) @ normal
    distance[np.abs(distance) < IN_PLANE * size] = 0.0
    front = distance >= 0
    a = surface.triangles
    b = np.roll(a, -1, axis=1)
    crosses = front[a] != front[b]
    # From the lower to the higher number, so that both triangles of a side find the same point.
    low = np.minimum(a, b)
    high = np.maximum(a, b)
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = np.where(crosses, distance[low] / (distance[low] - distance[high]), np.nan)
    crossings = surface.points[low] + fraction[:, :, None] * (
        surface.points[high] - surface.points[low]
    )
    into_back = crosses & front[a]
    into_front = crosses & ~front[a]
    has_segment = crosses.any(axis=1)
    enters = np.where(has_segment, into_back.argmax(axis=1), -1)
    leaves = np.where(has_segment, into_front.argmax(axis=1), -1)
    return PlaneSection(enters, leaves, crossings)


def section_lines(
    surface: Triangulation, neighbours: Neighbours, cut: PlaneSection
) -> list[SeamLine]:
    """The connected lines of a section: from rim to rim, or closed."""
    with_segment = np.flatnonzero(cut.enters >= 0)
    before = neighbours.across[with_segment, cut.enters[with_segment]]
    starts = as_list(with_segment[before < 0])
    left = set(as_list(with_segment))
    found = []
    # Open lines first; what then is left is closed, and begins anywhere.
    for first in [*starts, *as_list(with_segment)]:
        chain = []
        t = first
        while t in left:
            left.discard(t)
            chain.append(t)
            t = int(neighbours.across[t, cut.leaves[t]])
        if chain:
            found += _line_of(chain, cut)
    return found


def _line_of(chain: list[int], cut: PlaneSection) -> list[SeamLine]:
    """The line of a chain of triangles; none if the plane only touches the surface there."""
    triangles = np.array(chain, dtype=np.int64)
    starts = cut.crossings[triangles, cut.enters[triangles]]
    ends = cut.crossings[triangles, cut.leaves[triangles]]
    return without_points(triangles, starts, ends)


def without_points(triangles: Numbers, starts: Array, ends: Array) -> list[SeamLine]:
    """A line without its segments of no length; none if no segment is left."""
    is_long = (starts != ends).any(axis=1)
    if not is_long.any():
        return []
    return [SeamLine(triangles[is_long], starts[is_long], ends[is_long])]


def points_on(
    surface: Triangulation, neighbours: Neighbours, given: Array, what: str, ends: Sequence[int]
) -> ClosestPoints:
    """The points of a surface that are closest to given ones (n, 3) [m], which are near it; those
    with the numbers `ends` are at the rim if it is near, so that a line from there cuts it."""
    on = surface.closest(given)
    farthest = int(on.distance.argmax())
    check(
        float(on.distance[farthest]) <= FAR * surface.extent,
        f"{what} {farthest + 1} is {on.distance[farthest]:.3g} m away from the surface; "
        "give points on it.",
    )
    weights = on.weights.copy()
    for k in ends:
        for side in np.flatnonzero(neighbours.across[on.triangle[k]] < 0):
            opposite = (side + 2) % 3
            if 0 < weights[k, opposite] < AT_RIM:
                weights[k, opposite] = 0.0
                weights[k] /= weights[k].sum()
    corners = surface.points[surface.triangles[on.triangle]]
    return replace(on, weights=weights, points=np.einsum("nk,nkc->nc", weights, corners))


def line_through(surface: Triangulation, neighbours: Neighbours, given: Array) -> SeamLine:
    """The line through points (n, 3) [m], which are moved to the closest ones of the surface."""
    size = surface.extent
    first_and_last = (0, len(given) - 1)
    on = points_on(surface, neighbours, given, "FormSurface.along: point", first_and_last)
    triangles: list[int] = []
    points: list[Array] = [on.points[0]]
    for k in range(len(given) - 1):
        p: Array = on.points[k]
        q: Array = on.points[k + 1]
        if np.linalg.norm(q - p) <= IN_PLANE * size:
            continue
        at_p = _triangles_at(surface, neighbours, int(on.triangle[k]), p)
        at_q = _triangles_at(surface, neighbours, int(on.triangle[k + 1]), q)
        way = _shortest_way(surface, neighbours, (p, q), (at_p, at_q))
        if way is None:
            raise InputError(
                f"FormSurface.along: there is no way on the surface from point {k + 1} to point "
                f"{k + 2}; give more points between them."
            )
        triangles += way[0]
        points += way[1]
    ends = np.array(points[1:])
    lines = []
    if triangles:
        lines = without_points(np.array(triangles), np.array(points[:-1]), ends)
    check(bool(lines), "FormSurface.along: all points are one; give points of a line.")
    return lines[0]


def _triangles_at(
    surface: Triangulation, neighbours: Neighbours, triangle: int, point: Array
) -> list[int]:
    """The triangles that have a point (3,) [m] of one of them, which is inside, on a side or at a
    corner."""
    around: set[int] = set()
    for corner in as_list(surface.triangles[triangle]):
        around |= set(neighbours.at_corner[corner])
    candidates = np.array(sorted(around))
    corners = surface.points[surface.triangles[candidates]]
    given = np.broadcast_to(point, (len(candidates), 3))
    weights = barycentric(corners, given)
    off = np.linalg.norm(np.einsum("nk,nkc->nc", weights, corners) - given, axis=1)
    sizes = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    has_point = (weights.min(axis=1) > -ON_SIDE) & (off < ON_SIDE * sizes)
    return sorted({triangle, *as_list(candidates[has_point])})


def _shortest_way(
    surface: Triangulation,
    neighbours: Neighbours,
    ends: tuple[Array, Array],
    at_ends: tuple[list[int], list[int]],
) -> tuple[list[int], list[Array]] | None:
    """The shortest of the ways between two points from any triangle at the first one to any at the
    second: triangles, and the ends of the segments in them."""
    p, q = ends
    common = [t for t in at_ends[0] if t in at_ends[1]]
    if common:
        return [common[0]], [q]
    normal = surface.normals[at_ends[0]].mean(axis=0) + surface.normals[at_ends[1]].mean(axis=0)
    across = np.cross(normal, q - p)
    length = float(np.linalg.norm(across))
    if length == 0:
        return None
    limit = LONGEST_WAY * float(np.linalg.norm(q - p))
    best = None
    least = limit
    # The section follows (normal of the plane) × (normal of the surface), from p to q, and that
    # with the other normal goes back.  They differ where the plane contains sides of triangles: one
    # of them takes the sides at a rim.
    ahead = section(surface, p, across / length)
    back = section(surface, p, -across / length)
    for exits, crossings in ((ahead.leaves, ahead.crossings), (back.enters, back.crossings)):
        for first in at_ends[0]:
            way = _walk(neighbours, (exits, crossings), first, ends, at_ends[1], least)
            if way is not None and way[2] < least * (1 - IN_PLANE):
                least = way[2]
                best = way[0], way[1]
    return best


def _walk(
    neighbours: Neighbours,
    section_exits: tuple[Numbers, Array],
    first: int,
    ends: tuple[Array, Array],
    targets: Iterable[int],
    limit: float,
) -> tuple[list[int], list[Array], float] | None:
    """The way along a section, given by the side (m,) at which it leaves each triangle and by its
    crossings, from a triangle to one of the targets: triangles, ends of segments, and length [m];
    None if it leaves the surface or is longer than a limit."""
    exits, crossings = section_exits
    goal = set(targets)
    triangles: list[int] = []
    points: list[Array] = []
    length = 0.0
    t = first
    position = ends[0]
    while t not in goal:
        if t < 0 or exits[t] < 0 or length > limit or len(triangles) > len(exits):
            return None
        following = crossings[t, exits[t]]
        length += float(np.linalg.norm(following - position))
        triangles.append(t)
        points.append(following)
        position = following
        t = int(neighbours.across[t, exits[t]])
    length += float(np.linalg.norm(ends[1] - position))
    return [*triangles, t], [*points, ends[1]], length
