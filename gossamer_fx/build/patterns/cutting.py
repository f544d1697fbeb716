"""A triangulated surface cut along lines that cross its triangles.

Problem.  The strips on both sides of a seam need the same points along it, but seams follow planes
or geodesics and not the sides of triangles.

Algorithm.  Each segment of a line lies in one triangle of the surface, which may have been divided
by earlier lines.

1. Both ends become corners: a triangle with an end inside is divided into three, one with an end on
   a side, and its neighbour, into two.
2. From the first end the way goes to the second one: along a side, or across the triangle that lies
   in its direction to the opposite side, which is divided there, so that its neighbour is divided,
   too.  Lines that cross each other thus need no further work.
3. The sides on the way are the seam.  Corners of triangles that are connected across other sides
   are one point of a strip; on the seam each strip has its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gossamer_fx.build.patterns.closest import Numbers, barycentric
from gossamer_fx.build.patterns.seam_lines import SeamLine
from gossamer_fx.build.patterns.triangulation import Triangulation, as_list, as_rows, sides_of
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array

# Points of a line that are nearer to a corner than this fraction of a side are the corner: narrower
# triangles would hinder the flattening, and a chord is farther from the form.
SNAP = 1e-3

# Angle [rad] by which a rim turns at a corner.
CORNER_ANGLE = np.pi / 6

Edge = tuple[int, int]


@dataclass(frozen=True, eq=False)
class SeamEdges:
    """A part of a line that is between the same two strips, of k edges in the order of the line.

    Attributes:
        number: of the seam, which is that of the line where no lines cross.
        line: number of the line.
        strips: numbers of the strips on its left and on its right.
        left: points (k + 1,) of the strip on the left.
        right: those of the strip on the right, at the same positions.
    """

    number: int
    line: int
    strips: tuple[int, int]
    left: Numbers
    right: Numbers

    @property
    def names(self) -> tuple[str, str]:
        """Names of its edges in the panels on its left and on its right: "seam 0" in both, or "seam
        0 left" and "seam 0 right" of a panel that is sewn to itself."""
        name = f"seam {self.number}"
        if self.strips[0] == self.strips[1]:
            return f"{name} left", f"{name} right"
        return name, name


@dataclass(frozen=True, eq=False)
class CutMesh:
    """All strips of a cut surface as one mesh, in which they are not connected.

    Attributes:
        points: (n, 3) [m].
        triangles: (m, 3).
        strip: number of the strip of each triangle (m,).
        seams: edges between strips.
        rims: named edges (k, 2) of the rim.
        corners: named points (k,).
    """

    points: Array
    triangles: Numbers
    strip: Numbers
    seams: tuple[SeamEdges, ...]
    rims: dict[str, Numbers]
    corners: dict[str, Numbers]


def cut_surface(surface: Triangulation, lines: Sequence[SeamLine]) -> CutMesh:
    """Cut a surface along lines of it."""
    cutter = _Cutter(surface)
    for name, edges in rims_of(surface).items():
        for a, b in as_rows(edges):
            cutter.names.setdefault(_sorted(a, b), set()).add(name)
    for number, line in enumerate(lines):
        for k, triangle in enumerate(as_list(line.triangles)):
            cutter.cut(triangle, line.starts[k], line.ends[k], number)
    points = {name: nodes for name, nodes in surface.groups.items() if nodes.ndim == 1}
    return cutter.result(points)


def rims_of(surface: Triangulation) -> dict[str, Numbers]:
    """The named edges (k, 2) of the rim of a surface.  Edges without a name are "rim 1", ..., each
    from one corner, where the rim turns by more than `CORNER_ANGLE` or a name ends, to the next."""
    sides = sides_of(surface.triangles)
    _, first, count = np.unique(
        np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True
    )
    at_rim = sides[first[count == 1]]
    rim = {_sorted(a, b): (a, b) for a, b in as_rows(at_rim)}
    found = {}
    for name, edges in surface.groups.items():
        if edges.ndim == 2:
            named = [_sorted(a, b) for a, b in as_rows(edges) if _sorted(a, b) in rim]
            if named:
                found[name] = np.array(named)
                for edge in named:
                    rim.pop(edge, None)
    following = dict(rim.values())
    before = {b: a for a, b in following.items()}
    begins = [a for a in following if _is_corner(surface.points, before.get(a), a, following[a])]
    # A rim without corners begins at any of its points.
    number = 0
    for first_point in [*begins, *following]:
        chain = []
        a = first_point
        while a in following:
            b = following.pop(a)
            chain.append((a, b))
            a = b
            if a in begins:
                break
        if chain:
            number += 1
            while f"rim {number}" in surface.groups:
                number += 1
            found[f"rim {number}"] = np.array(chain)
    return found


def _is_corner(points: Array, before: int | None, at: int, after: int) -> bool:
    """Whether a rim turns sharply at a point, or begins there."""
    if before is None:
        return True
    u = points[at] - points[before]
    v = points[after] - points[at]
    cosine = float(u @ v) / float(np.linalg.norm(u) * np.linalg.norm(v))
    return cosine < np.cos(CORNER_ANGLE)


def _sorted(a: int, b: int) -> Edge:
    """An edge by its ends, the smaller number first."""
    return (a, b) if a < b else (b, a)


class _Cutter:
    """A mesh whose triangles are divided one after another.

    Attributes:
        names: names of rims, by edges.
        seam: number of the line and its direction (from, to), by edges.
    """

    def __init__(self, surface: Triangulation) -> None:
        self.points: list[Array] = list(surface.points)
        self.normals = surface.normals
        self.corners: dict[int, tuple[int, int, int]] = {}
        self.parent: dict[int, int] = {}
        self.children: list[set[int]] = [set() for _ in surface.triangles]
        self.at_edge: dict[Edge, set[int]] = {}
        self.names: dict[Edge, set[str]] = {}
        self.seam: dict[Edge, tuple[int, int, int]] = {}
        self.next_triangle = 0
        for t, (a, b, c) in enumerate(as_rows(surface.triangles)):
            self._add((a, b, c), t)

    def _add(self, corners: tuple[int, int, int], parent: int) -> None:
        t = self.next_triangle
        self.next_triangle += 1
        self.corners[t] = corners
        self.parent[t] = parent
        self.children[parent].add(t)
        for edge in _edges(corners):
            self.at_edge.setdefault(edge, set()).add(t)

    def _remove(self, t: int) -> int:
        """Remove a triangle; the number of the one of the surface that it was a part of."""
        for edge in _edges(self.corners[t]):
            self.at_edge[edge].discard(t)
        parent = self.parent.pop(t)
        self.children[parent].discard(t)
        del self.corners[t]
        return parent

    def _split_edge(self, a: int, b: int, position: Array) -> int:
        """Divide an edge, and the triangles at it; the number of the new point."""
        new = len(self.points)
        self.points.append(position)
        edge = _sorted(a, b)
        for t in sorted(self.at_edge[edge]):
            i, j, k = self.corners[t]
            while _sorted(i, j) != edge:
                i, j, k = j, k, i
            parent = self._remove(t)
            self._add((i, new, k), parent)
            self._add((new, j, k), parent)
        del self.at_edge[edge]
        if edge in self.names:
            names = self.names.pop(edge)
            self.names[_sorted(a, new)] = set(names)
            self.names[_sorted(new, b)] = set(names)
        if edge in self.seam:
            line, start, end = self.seam.pop(edge)
            self.seam[_sorted(start, new)] = (line, start, new)
            self.seam[_sorted(new, end)] = (line, new, end)
        return new

    def _point(self, parent: int, position: Array) -> int:
        """The number of a point at a position in a triangle of the surface, new or not."""
        pieces = sorted(self.children[parent])
        corners = np.array([[self.points[k] for k in self.corners[t]] for t in pieces])
        weights = barycentric(corners, np.broadcast_to(position, (len(pieces), 3)))
        best = int(weights.min(axis=1).argmax())
        t = pieces[best]
        numbers = self.corners[t]
        large = int(weights[best].argmax())
        if weights[best][large] > 1 - SNAP:
            return numbers[large]
        small = int(weights[best].argmin())
        if weights[best][small] < SNAP:
            return self._split_edge(numbers[(small + 1) % 3], numbers[(small + 2) % 3], position)
        new = len(self.points)
        self.points.append(position)
        a, b, c = numbers
        self._remove(t)
        for piece in ((a, b, new), (b, c, new), (c, a, new)):
            self._add(piece, parent)
        return new

    def cut(self, parent: int, start: Array, end: Array, line: int) -> None:
        """Cut along a segment in a triangle of the surface, which belongs to a line."""
        at = self._point(parent, start)
        goal = self._point(parent, end)
        while at != goal:
            following = self._step(parent, at, goal)
            edge = _sorted(at, following)
            self.seam.setdefault(edge, (line, at, following))
            at = following

    def _step(self, parent: int, at: int, goal: int) -> int:
        """The next point on the way from a point to another one."""
        direction = self.points[goal] - self.points[at]
        normal = self.normals[parent]
        best = (-np.inf, 0, 0, 0.0, 0.0)
        for t in sorted(self.children[parent]):
            if at not in self.corners[t]:
                continue
            i, j, k = self.corners[t]
            while i != at:
                i, j, k = j, k, i
            if goal in (j, k):
                return goal
            u = self.points[j] - self.points[at]
            v = self.points[k] - self.points[at]
            # Sines of the angles from u to the direction and from there to v, times its length
            length_u = float(np.linalg.norm(u))
            length_v = float(np.linalg.norm(v))
            from_u = float(np.cross(u, direction) @ normal)
            to_v = float(np.cross(direction, v) @ normal)
            inside = min(from_u / length_u, to_v / length_v)
            # Of thin triangles both sines are small, also backwards.  Where the angle is nearly π,
            # its middle is across, and the direction may be along u or v.
            ahead = float((u / length_u + v / length_v) @ direction)
            if ahead > -SNAP * float(np.linalg.norm(direction)) and inside > best[0]:
                best = (inside, j, k, from_u, to_v)
        _, j, k, from_u, to_v = best
        fraction = min(max(from_u / (from_u + to_v), 0.0), 1.0)
        if fraction < SNAP:
            return j
        if fraction > 1 - SNAP:
            return k
        position = self.points[j] + fraction * (self.points[k] - self.points[j])
        return self._split_edge(j, k, position)

    def result(self, points: dict[str, Numbers]) -> CutMesh:
        """The strips, with named points of the surface."""
        triangles = np.array([self.corners[t] for t in sorted(self.corners)])
        row_of = {t: row for row, t in enumerate(sorted(self.corners))}
        pairs: list[tuple[int, int]] = []
        # Rows of the triangles on the left and on the right of each edge of a seam
        sides: dict[Edge, tuple[int, int]] = {}
        for edge, found in self.at_edge.items():
            rows = [row_of[t] for t in sorted(found)]
            if len(rows) != 2:
                continue
            if edge not in self.seam:
                pairs.append((rows[0], rows[1]))
                continue
            _, start, end = self.seam[edge]
            is_left = _passes(triangles[rows[0]], start, end)
            sides[edge] = (rows[0], rows[1]) if is_left else (rows[1], rows[0])
        new = _separated(triangles, pairs)
        strip = _numbered(_components(len(triangles), pairs), sides, self.seam)
        renumbered = new.reshape(-1, 3)
        origin = np.zeros(int(new.max()) + 1, dtype=np.int64)
        origin[new] = triangles.ravel()

        def point_of(row: int, number: int) -> int:
            return int(renumbered[row, as_list(triangles[row]).index(number)])

        directed: dict[tuple[int, int, int], list[tuple[Edge, Edge]]] = {}
        for edge, (left, right) in sides.items():
            line, start, end = self.seam[edge]
            key = (line, int(strip[left]), int(strip[right]))
            of_left = (point_of(left, start), point_of(left, end))
            of_right = (point_of(right, start), point_of(right, end))
            directed.setdefault(key, []).append((of_left, of_right))
        seams: list[SeamEdges] = []
        for (line, a, b), edges in sorted(directed.items()):
            for chain in _chains(edges):
                seams.append(SeamEdges(len(seams), line, (a, b), *chain))
        rims: dict[str, list[Edge]] = {}
        for edge, names in self.names.items():
            for t in self.at_edge[edge]:
                row = row_of[t]
                start, end = edge if _passes(triangles[row], *edge) else edge[::-1]
                for name in names:
                    pair = (point_of(row, start), point_of(row, end))
                    rims.setdefault(name, []).append(pair)
        corners = {}
        for name, nodes in points.items():
            corners[name] = np.flatnonzero(np.isin(origin, nodes))
        return CutMesh(
            points=np.array(self.points)[origin],
            triangles=renumbered,
            strip=strip,
            seams=tuple(seams),
            rims={name: np.array(sorted(edges)) for name, edges in sorted(rims.items())},
            corners=corners,
        )


def _edges(corners: tuple[int, int, int]) -> tuple[Edge, Edge, Edge]:
    """The three edges of a triangle."""
    a, b, c = corners
    return _sorted(a, b), _sorted(b, c), _sorted(c, a)


def _passes(corners: Numbers, start: int, end: int) -> bool:
    """Whether a triangle passes from one corner to another counterclockwise."""
    numbers = as_list(corners)
    return bool(numbers[(numbers.index(start) + 1) % 3] == end)


def _components(count: int, pairs: Iterable[tuple[int, int]]) -> Numbers:
    """The number of the connected part of each of `count` things, by pairs that are connected."""
    rows = np.array(list(pairs), dtype=np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(rows)), (rows[:, 0], rows[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _separated(triangles: Numbers, pairs: Sequence[tuple[int, int]]) -> Numbers:
    """Numbers (3 m,) of points for the corners of m triangles, which are the same across the edges
    of pairs of triangles only."""
    same: list[tuple[int, int]] = []
    for first, second in pairs:
        of_second = as_list(triangles[second])
        for i, corner in enumerate(as_list(triangles[first])):
            if corner in of_second:
                same.append((3 * first + i, 3 * second + of_second.index(corner)))
    return _components(3 * len(triangles), same)


def _numbered(
    part: Numbers, sides: dict[Edge, tuple[int, int]], seam: dict[Edge, tuple[int, int, int]]
) -> Numbers:
    """Numbers (m,) of the strips of triangles, such that strips along lines that follow each other
    do so, too: by the mean number of the lines at a strip, with the right side of a line first."""
    count = int(part.max()) + 1
    lines: list[set[tuple[int, float]]] = [set() for _ in range(count)]
    for edge, (left, right) in sides.items():
        lines[part[left]].add((seam[edge][0], 0.5))
        lines[part[right]].add((seam[edge][0], -0.5))
    keys = []
    for number, found in enumerate(lines):
        values = [line for line, _ in found]
        # The side of its line tells two strips at one line apart.
        side = sum(offset for _, offset in found)
        mean = sum(values) / len(values) if values else 0.0
        keys.append((mean, side, number))
    order = sorted(range(count), key=keys.__getitem__)
    new = np.zeros(count, dtype=np.int64)
    new[order] = np.arange(count)
    return new[part]


def _chains(edges: Sequence[tuple[Edge, Edge]]) -> list[tuple[Numbers, Numbers]]:
    """Points of both sides along the connected chains of edges of a seam, which are given by (from,
    to) on the left and on the right."""
    following = {left[0]: (left[1], right) for left, right in edges}
    inner = {left[1] for left, _ in edges}
    chains = []
    for first in [*sorted(set(following) - inner), *sorted(following)]:
        left = [first]
        right: list[int] = []
        while left[-1] in following:
            end, (start_right, end_right) = following.pop(left[-1])
            if right and right[-1] != start_right:
                # Only the left side is connected: another line ends here on the right.
                following[left[-1]] = (end, (start_right, end_right))
                break
            right = right or [start_right]
            left.append(end)
            right.append(end_right)
        if len(left) > 1:
            chains.append((np.array(left), np.array(right)))
    check(bool(chains), "FormSurface.cut: a line has no edges on the surface; give another one.")
    return chains


def named_edges(mesh: CutMesh, strip: int) -> dict[str, Numbers]:
    """The edges (k, 2) at the boundary of a strip, by name."""
    found = {}
    for seam in mesh.seams:
        sides = zip(seam.strips, seam.names, (seam.left, seam.right), strict=True)
        for side, name, points in sides:
            if side == strip:
                found[name] = np.stack([points[:-1], points[1:]], axis=1)
    used = np.unique(mesh.triangles[mesh.strip == strip])
    for name, edges in mesh.rims.items():
        mine = edges[np.isin(edges[:, 0], used)]
        if len(mine):
            found[name] = mine
    return found
