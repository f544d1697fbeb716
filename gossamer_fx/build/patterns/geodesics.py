"""Geodesics: the shortest lines between points of a triangulated surface.

Problem.  A strip between geodesics is the straightest one, which wastes least film.  On a
polyhedron a geodesic is straight wherever triangles are unfolded into a plane, also across their
sides; it passes a corner only where it leaves an angle of π or more on both sides.

Algorithm (Xin & Wang, Computer-Aided Design 39, 1081-1090, 2007, doi:10.1016/j.cad.2007.08.001).

1. Dijkstra's algorithm on the centres of triangles gives a chain from one point to the other.
2. The chain is unfolded, and a thread in it is pulled taut: it bends at corners of the chain.
3. Where the angle on the other side of such a corner is less than π, the chain goes round it
   there, and step 2 is repeated.  Each time the thread is shorter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from gossamer_fx.build.patterns.seam_lines import Neighbours, SeamLine, without_points
from gossamer_fx.build.patterns.triangulation import Triangulation, as_list
from gossamer_fx.core.model.body import Array

# Weight of a corner from which on a point is the corner, and fraction of a side at which a crossing
# is at its end: round-off of points that are given at corners is below.
AT_CORNER = 1e-9

# Angle [rad] below π that makes a thread change to the other side of a corner: round-off of angles
# is below, and the thread would be shorter by some 1e-14 of its length.
ANGLE_TOLERANCE = 1e-7

# A point in the plane of unfolded triangles [m]
PlanePoint = tuple[float, float]


@dataclass(frozen=True, eq=False)
class _Bend:
    """A corner of a chain at which a taut thread bends.

    Attributes:
        portal: number of a side between two triangles of the chain that ends there.
        is_left: whether the corner is on the left of the thread.
        position: in the plane [m].
    """

    portal: int
    is_left: bool
    position: PlanePoint


@dataclass(frozen=True, eq=False)
class _Unfolded:
    """A chain of k + 1 triangles in a plane.  Its portals are the k sides between them.

    Attributes:
        left, right: numbers of the points at the ends of each portal, seen along the chain.
        left_positions, right_positions: their positions in the plane [m].
        start, end: of the thread [m].
    """

    left: list[int]
    right: list[int]
    left_positions: list[PlanePoint]
    right_positions: list[PlanePoint]
    start: PlanePoint
    end: PlanePoint


@dataclass(frozen=True, eq=False)
class SurfaceGraph:
    """What geodesics need of a surface.

    Attributes:
        surface: triangulated.
        neighbours: its triangles by their sides.
        links: distances [m] of the centres of neighbours, a sparse array (m, m).
        angles: sum [rad] of the angles at each point; infinite at the rim.
    """

    surface: Triangulation
    neighbours: Neighbours
    links: csr_array
    angles: Array


def graph_of(surface: Triangulation, neighbours: Neighbours) -> SurfaceGraph:
    """The graph of a surface with given neighbours."""
    corners = surface.points[surface.triangles]
    centres = corners.mean(axis=1)
    triangle, side = np.nonzero(neighbours.across >= 0)
    other = neighbours.across[triangle, side]
    lengths = np.linalg.norm(centres[triangle] - centres[other], axis=1)
    count = len(surface.triangles)
    links = coo_array((lengths, (triangle, other)), shape=(count, count))
    angles = np.zeros(len(surface.points))
    for k in range(3):
        to_next = corners[:, (k + 1) % 3] - corners[:, k]
        to_last = corners[:, (k + 2) % 3] - corners[:, k]
        sine = np.linalg.norm(np.cross(to_next, to_last), axis=1)
        cosine = np.einsum("nc,nc->n", to_next, to_last)
        np.add.at(angles, surface.triangles[:, k], np.arctan2(sine, cosine))
    triangle, side = np.nonzero(neighbours.across < 0)
    angles[surface.triangles[triangle, side]] = np.inf
    angles[surface.triangles[triangle, (side + 1) % 3]] = np.inf
    return SurfaceGraph(surface, neighbours, links.tocsr(), angles)


def geodesic(
    graph: SurfaceGraph, triangles: tuple[int, int], weights: tuple[Array, Array]
) -> SeamLine | None:
    """The geodesic between two points, given by their triangles and the weights (3,) of corners;
    None if the surface does not connect them, or they are one."""
    chain = _first_chain(graph, triangles)
    if not chain:
        return None
    ends = (_at_corner(weights[0]), _at_corner(weights[1]))
    unfolded = _unfold(graph, chain, ends)
    bends = _taut(unfolded)
    length = _length(unfolded, bends)
    while True:
        bend = _sharpest(graph, unfolded, bends)
        if bend is None:
            break
        shorter = _without_loops(_round(graph, chain, unfolded, bend))
        next_unfolded = _unfold(graph, shorter, ends)
        next_bends = _taut(next_unfolded)
        next_length = _length(next_unfolded, next_bends)
        # Without this, round-off might let the chain change for ever.
        if next_length >= length:
            break
        chain = shorter
        unfolded = next_unfolded
        bends = next_bends
        length = next_length
    return _line(graph.surface, chain, ends, unfolded, bends)


def _at_corner(weights: Array) -> Array:
    """Weights (3,) of a point, which is moved to a corner that is nearer than round-off."""
    if weights.max() > 1 - AT_CORNER:
        return np.asarray(weights == weights.max(), dtype=np.float64)
    return weights


def _first_chain(graph: SurfaceGraph, triangles: tuple[int, int]) -> list[int]:
    """A short chain of triangles, each a neighbour of the one before; empty if there is none."""
    first, last = triangles
    distance, before = dijkstra(graph.links, indices=first, return_predecessors=True)
    if not np.isfinite(distance[last]):
        return []
    chain = [last]
    while chain[-1] != first:
        chain.append(int(before[chain[-1]]))
    return chain[::-1]


def _unfold(graph: SurfaceGraph, chain: Sequence[int], ends: tuple[Array, Array]) -> _Unfolded:
    """Lay a chain of triangles into the plane, each next to the one before."""
    points = graph.surface.points
    corners = as_list(graph.surface.triangles[chain[0]])
    a, b, c = corners
    origin = (0.0, 0.0)
    along = (float(np.linalg.norm(points[b] - points[a])), 0.0)
    positions = {a: origin, b: along, c: _apex(points[[a, b, c]], origin, along)}
    start = _mean(ends[0], [positions[corner] for corner in corners])
    left = []
    right = []
    left_positions = []
    right_positions = []
    for t, following in pairwise(chain):
        corners = as_list(graph.surface.triangles[following])
        # Normals are consistent: the next triangle has the side in the opposite direction, which is
        # from left to right if seen along the chain.
        side = as_list(graph.neighbours.across[following]).index(t)
        tail = corners[side]
        head = corners[(side + 1) % 3]
        apex = corners[(side + 2) % 3]
        left.append(tail)
        right.append(head)
        left_positions.append(positions[tail])
        right_positions.append(positions[head])
        position = _apex(points[[tail, head, apex]], positions[tail], positions[head])
        positions = {tail: positions[tail], head: positions[head], apex: position}
    end = _mean(ends[1], [positions[corner] for corner in corners])
    return _Unfolded(left, right, left_positions, right_positions, start, end)


def _apex(corners: Array, a: PlanePoint, b: PlanePoint) -> PlanePoint:
    """The third corner in the plane, on the left of the way from a to b, of a triangle (3, 3) [m]
    of which two corners are laid at a and b."""
    side = corners[1] - corners[0]
    other = corners[2] - corners[0]
    square = float(side @ side)
    along = float(other @ side) / square
    across = float(np.linalg.norm(np.cross(side, other))) / square
    dx = b[0] - a[0]
    dy = b[1] - a[1]
    return a[0] + along * dx - across * dy, a[1] + along * dy + across * dx


def _mean(weights: Array, positions: Sequence[PlanePoint]) -> PlanePoint:
    """The weighted mean of three points."""
    x, y = weights @ np.array(positions)
    return float(x), float(y)


def _turn(origin: PlanePoint, a: PlanePoint, b: PlanePoint) -> float:
    """Twice the area [m²] of a triangle: positive if b is on the left of the way to a."""
    return (a[0] - origin[0]) * (b[1] - origin[1]) - (a[1] - origin[1]) * (b[0] - origin[0])


def _taut(unfolded: _Unfolded) -> list[_Bend]:
    """The bends of a taut thread: from its last bend, the portals that it passes leave it a funnel,
    which narrows until a portal is off it."""
    lefts = [*unfolded.left_positions, unfolded.end]
    rights = [*unfolded.right_positions, unfolded.end]
    bends: list[_Bend] = []
    apex = unfolded.start
    left = right = apex
    left_portal = right_portal = -1
    k = 0
    while k < len(lefts):
        bend = None
        if _turn(apex, right, rights[k]) >= 0:
            # At its apex a funnel has no other leg that could be passed.
            if apex in (left, right) or _turn(apex, left, rights[k]) < 0:
                right = rights[k]
                right_portal = k
            else:
                bend = _Bend(left_portal, True, left)
        if bend is None and _turn(apex, left, lefts[k]) <= 0:
            if apex in (left, right) or _turn(apex, right, lefts[k]) > 0:
                left = lefts[k]
                left_portal = k
            else:
                bend = _Bend(right_portal, False, right)
        if bend is not None:
            bends.append(bend)
            apex = bend.position
            left = right = apex
            k = left_portal = right_portal = bend.portal
        k += 1
    # The thread may end at a corner of the last portals.
    while bends and bends[-1].position == unfolded.end:
        bends.pop()
    return bends


def _vertices(unfolded: _Unfolded, bends: Sequence[_Bend]) -> list[PlanePoint]:
    """The points of a taut thread in the plane."""
    return [unfolded.start, *[bend.position for bend in bends], unfolded.end]


def _length(unfolded: _Unfolded, bends: Sequence[_Bend]) -> float:
    """Length [m] of a taut thread."""
    return sum(math.dist(a, b) for a, b in pairwise(_vertices(unfolded, bends)))


def _sharpest(graph: SurfaceGraph, unfolded: _Unfolded, bends: Sequence[_Bend]) -> _Bend | None:
    """The bend with the least angle on the other side, if that is less than π."""
    least = np.pi - ANGLE_TOLERANCE
    sharpest = None
    points = _vertices(unfolded, bends)
    for k, bend in enumerate(bends):
        x, y = bend.position
        before = math.atan2(points[k][1] - y, points[k][0] - x)
        after = math.atan2(points[k + 2][1] - y, points[k + 2][0] - x)
        inside = (after - before if bend.is_left else before - after) % (2 * np.pi)
        # A taut thread has at least π on the side of the chain; round-off may take a part of it.
        if inside < np.pi / 2:
            inside += 2 * np.pi
        ends = unfolded.left if bend.is_left else unfolded.right
        other_side = float(graph.angles[ends[bend.portal]]) - inside
        if other_side < least:
            least = other_side
            sharpest = bend
    return sharpest


def _round(
    graph: SurfaceGraph, chain: Sequence[int], unfolded: _Unfolded, bend: _Bend
) -> list[int]:
    """The chain with the triangles on the other side of a corner."""
    ends = unfolded.left if bend.is_left else unfolded.right
    corner = ends[bend.portal]
    first = last = bend.portal
    while first > 0 and ends[first - 1] == corner:
        first -= 1
    while last + 1 < len(ends) and ends[last + 1] == corner:
        last += 1
    # The triangles `first` to `last + 1` are around the corner.  It is an inner point of the
    # surface, whose sum of angles is finite, so that there are neighbours all around.
    found = []
    t = chain[first]
    while t != chain[last + 1]:
        found.append(t)
        k = as_list(graph.surface.triangles[t]).index(corner)
        side = k if bend.is_left else (k + 2) % 3
        t = int(graph.neighbours.across[t, side])
    return [*chain[:first], *found, *chain[last + 1 :]]


def _without_loops(chain: Sequence[int]) -> list[int]:
    """A chain without the parts between two visits of a triangle, in which a straight way is
    shorter."""
    found: list[int] = []
    number: dict[int, int] = {}
    for t in chain:
        if t in number:
            for left_out in found[number[t] + 1 :]:
                del number[left_out]
            del found[number[t] + 1 :]
            continue
        number[t] = len(found)
        found.append(t)
    return found


def _line(
    surface: Triangulation,
    chain: Sequence[int],
    ends: tuple[Array, Array],
    unfolded: _Unfolded,
    bends: Sequence[_Bend],
) -> SeamLine | None:
    """A taut thread on the surface; None if both ends are one."""
    fractions: Array = np.zeros(len(unfolded.left))
    vertices = _vertices(unfolded, bends)
    portals = [-1, *[bend.portal for bend in bends], len(fractions)]
    for k, (a, b) in enumerate(pairwise(vertices)):
        for portal in range(portals[k] + 1, min(portals[k + 1] + 1, len(fractions))):
            left = unfolded.left_positions[portal]
            right = unfolded.right_positions[portal]
            fractions[portal] = _fraction(left, right, a, b)
    low = np.array(unfolded.left, dtype=np.int64)
    high = np.array(unfolded.right, dtype=np.int64)
    fractions = np.clip(fractions, 0.0, 1.0)
    fractions[fractions < AT_CORNER] = 0.0
    fractions[fractions > 1 - AT_CORNER] = 1.0
    # A corner is met exactly, whichever portal ends there.
    crossings = (1 - fractions)[:, None] * surface.points[low]
    crossings += fractions[:, None] * surface.points[high]
    first = ends[0] @ surface.points[surface.triangles[chain[0]]]
    last = ends[1] @ surface.points[surface.triangles[chain[-1]]]
    points = np.concatenate([first[None], crossings, last[None]])
    lines = without_points(np.array(chain, dtype=np.int64), points[:-1], points[1:])
    return lines[0] if lines else None


def _fraction(left: PlanePoint, right: PlanePoint, a: PlanePoint, b: PlanePoint) -> float:
    """Where the way from a to b crosses a portal: 0 on its left end, 1 on its right end."""
    from_left = _turn(a, b, left)
    from_right = _turn(a, b, right)
    size = math.dist(a, b) * math.dist(left, right)
    if abs(from_left - from_right) > AT_CORNER * size:
        return from_left / (from_left - from_right)
    # The way goes along the portal, and begins or ends at one of its ends.
    on_left = min(math.dist(left, a), math.dist(left, b))
    on_right = min(math.dist(right, a), math.dist(right, b))
    return 0.0 if on_left <= on_right else 1.0
