"""Lines of edges of films, in order, with their arc length, by which seams join films.

A line is a named group of curves of a film's mesh that is connected and has no branches, open or
closed.  Points of it are found by the fraction σ of its arc length on the mesh, 0 <= σ <= 1, which
is the cut pattern.  Every rank knows all of a line, in the same order for any number of ranks.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array, Port
from gossamer_fx.core.model.item import Item
from gossamer_fx.core.model.state import State
from gossamer_fx.mechanics.bodies.meshed import Meshed

Numbers = npt.NDArray[np.int64]

# A point this near to a node, as a fraction of the edge, is taken to be the node.  Generators of
# meshes place the nodes of like lines with relative differences of 1e-6 to 1e-4.
NODE_FRACTION = 1e-3

# Coordinates that differ by less than this fraction of the size of a line count as equal, and so do
# mean squared distances of two lines that differ by less than this fraction of them.
COORDINATE_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class EdgeLine:
    """A line of n edges of a body of order p, in the order of a walk along it.

    Attributes:
        body: the film or plate.
        group: name of the group of curves.
        vertices: global vertices (n, 2) of the mesh, start and end of each edge.
        nodes: global nodes (n, p + 1) of the body along each edge.
        X: their coordinates (n, p + 1, 3) on the mesh [m].
        is_closed: whether the line ends where it begins.
    """

    body: Meshed
    group: str
    vertices: Numbers
    nodes: Numbers
    X: Array
    is_closed: bool

    @cached_property
    def edge_lengths(self) -> Array:
        """Length (n,) [m] of each edge on the mesh; curved ones as the chords between their
        nodes."""
        chords: Array = np.linalg.norm(np.diff(self.X, axis=1), axis=2)
        return chords.sum(axis=1)

    @property
    def length(self) -> float:
        """Length [m] of the line on the mesh."""
        return float(self.edge_lengths.sum())

    @cached_property
    def fractions(self) -> Array:
        """σ (n + 1,) at the ends of the edges, from 0 to 1."""
        sums = np.concatenate([[0.0], np.cumsum(self.edge_lengths)])
        return sums / sums[-1]

    @property
    def order(self) -> int:
        """Order p of the body: an edge has p + 1 nodes."""
        return int(self.nodes.shape[1]) - 1

    def reversed(self) -> EdgeLine:
        """The same line, walked in the opposite direction."""
        return replace(
            self,
            vertices=self.vertices[::-1, ::-1],
            nodes=self.nodes[::-1, ::-1],
            X=self.X[::-1, ::-1],
        )

    def begun_at(self, k: int) -> EdgeLine:
        """The same closed line, beginning with its edge k."""
        return replace(
            self,
            vertices=np.roll(self.vertices, -k, axis=0),
            nodes=np.roll(self.nodes, -k, axis=0),
            X=np.roll(self.X, -k, axis=0),
        )

    def directions(self, ends: Numbers) -> Numbers:
        """For each edge of a body, by the global numbers (m, 2) of its vertices, 1 if the line
        passes it from the first to the second, -1 for the opposite direction, and 0 if it is not an
        edge of the line; (m,)."""
        base = 1 + max(int(ends.max(initial=0)), int(self.vertices.max()))
        forwards = self.vertices @ [base, 1]
        backwards = self.vertices @ [1, base]
        edges = ends @ [base, 1]
        return np.isin(edges, forwards).astype(np.int64) - np.isin(edges, backwards)

    def all_nodes(self) -> tuple[Numbers, Array]:
        """Global numbers (m,) of the nodes in the order of the line, and the fraction σ (m,) of its
        arc length of each.  A closed line does not repeat its first node."""
        # The last node of an edge is the first one of the next.
        nodes = self.nodes[:, :-1].ravel()
        starts = self.fractions[:-1, None]
        widths = np.diff(self.fractions)[:, None]
        local = np.linspace(0.0, 1.0, self.order + 1)[:-1]
        fractions = (starts + widths * local).ravel()
        if self.is_closed:
            return nodes, fractions
        all_nodes = np.append(nodes, self.nodes[-1, -1])
        all_fractions = np.append(fractions, 1.0)
        return all_nodes, all_fractions

    def locate(self, fraction: float) -> tuple[int, float]:
        """The edge at σ, and the position on it from 0 to 1."""
        k = int(np.searchsorted(self.fractions, fraction, side="right")) - 1
        # σ = 1 belongs to the last edge; the search puts it behind.
        k = min(max(k, 0), len(self.nodes) - 1)
        start = self.fractions[k]
        width = self.fractions[k + 1] - start
        return k, float(np.clip((fraction - start) / width, 0.0, 1.0))

    def port(self, fraction: float) -> Port:
        """The point of the film at a fraction σ of the arc length of the line: the weighted sum of
        the nodes of an edge, or one node if that is closer than `NODE_FRACTION` of the edge."""
        # Number k of the edge, and position ξ on it from 0 to 1.
        k, ξ = self.locate(fraction)
        # A port at a node depends on one node instead of two or three: fewer entries of the matrix.
        nearest = round(ξ * self.order)
        if abs(ξ - nearest / self.order) < NODE_FRACTION:
            return Port(self.body, (int(self.nodes[k, nearest]),))
        values, _ = shape_functions(self.order, np.array([ξ]))
        nodes = tuple(int(node) for node in self.nodes[k])
        weights = tuple(float(value) for value in values[0])
        return Port(self.body, nodes, weights=weights)

    def positions(self, state: State) -> Array:
        """Positions (n + 1, 3) [m] of the ends of the line's n edges in a state, on every rank.
        Collective."""
        ends = np.append(self.nodes[:, 0], self.nodes[-1, -1])
        first, last = self.body.block.index_map.local_range
        mine = np.flatnonzero((ends >= first) & (ends < last))
        own = state[self.body].positions()[ends[mine] - first]
        found = np.zeros((len(ends), 3))
        # Only the nodes of the line are exchanged, not those of the film.
        for which, positions in self.body.comm.allgather((mine, own.copy())):
            found[which] = positions
        return found


class SewnEdges(Item, ABC):
    """Two edges of films that are sewn together; `constraints.Seam` is one."""

    @abstractmethod
    def lines(self, start: State) -> tuple[EdgeLine, EdgeLine]:
        """Both edges, so that points of like fractions of arc length belong together.
        Collective."""


def shape_functions(order: int, ξ: Array) -> tuple[Array, Array]:
    """Values and derivatives by ξ, (k, order + 1) each, of the Lagrange functions of order 1 or 2
    on [0, 1] at points ξ (k,), nodes from start to end."""
    if order == 1:
        one = np.ones_like(ξ)
        values = [1 - ξ, ξ]
        slopes = [-one, one]
    else:
        values = [(1 - ξ) * (1 - 2 * ξ), 4 * ξ * (1 - ξ), ξ * (2 * ξ - 1)]
        slopes = [4 * ξ - 3, 4 - 8 * ξ, 4 * ξ - 1]
    return np.stack(values, axis=1), np.stack(slopes, axis=1)


def edge_line(body: Meshed, group: str, user: str) -> EdgeLine:
    """Find the line of edges of a named group of curves of a film, the same on every rank.  A group
    that has no edges, branches, or consists of several lines raises `InputError`, whose message
    begins with the `user`.  Collective."""
    # X (n, p + 1, 3) [m] are the nodes along each edge, p the order of the film.
    table = body.mesh.edges
    curve = body.mesh.curve(group, user)
    # Each edge is sent once, by its owner.
    own = curve[curve < table.owned]
    local = table.nodes(body.space, own)
    nodes = body.block.index_map.local_to_global(local.ravel()).reshape(local.shape)
    X = body.space.tabulate_dof_coordinates()[local]
    parts = body.comm.allgather((table.ends[own], nodes, X))
    vertices = np.concatenate([part[0] for part in parts])
    nodes = np.concatenate([part[1] for part in parts])
    X = np.concatenate([part[2] for part in parts])
    check(
        len(nodes) > 0, f"{user}: the group '{group}' of '{body.name}' has no edges; name a line."
    )
    order, forwards, is_closed = _walk(vertices, X, f"{user}: '{group}' of '{body.name}'")
    # Edges that are walked backwards have their vertices and nodes reversed.
    is_forwards = forwards[:, None]
    return EdgeLine(
        body=body,
        group=group,
        vertices=np.where(is_forwards, vertices[order], vertices[order, ::-1]),
        nodes=np.where(is_forwards, nodes[order], nodes[order, ::-1]),
        X=np.where(is_forwards[:, None], X[order], X[order, ::-1]),
        is_closed=is_closed,
    )


def _walk(vertices: Numbers, X: Array, what: str) -> tuple[Numbers, npt.NDArray[np.bool_], bool]:
    """Order the n edges of a line, with the global vertices (n, 2) and coordinates (n, p + 1, 3)
    [m] of the nodes from the first vertex, as they follow each other in a walk along it.

    The walk begins at the end with the lowest coordinates, or at the lowest vertex of a closed
    line, there along the edge to the lower neighbour: that is the same for any numbering.  Returned
    are the edges (n,) in the order of the walk, whether each is passed from its first vertex to the
    second, and whether the line is closed.
    """
    edges_at: dict[int, list[int]] = {}
    point: dict[int, Array] = {}
    ends_of: list[tuple[int, int]] = [(int(pair[0]), int(pair[1])) for pair in vertices]
    for i, (first, last) in enumerate(ends_of):
        edges_at.setdefault(first, []).append(i)
        edges_at.setdefault(last, []).append(i)
        point[first] = X[i, 0]
        point[last] = X[i, -1]
    # A line has no vertex with three edges, and two ends, or none if it is closed.  Further closed
    # parts also pass this check; the walk does not reach them, and is refused at its end.
    most_edges = max(len(meeting) for meeting in edges_at.values())
    ends = [vertex for vertex, meeting in edges_at.items() if len(meeting) == 1]
    check(
        most_edges <= 2 and len(ends) in (0, 2),
        f"{what} is not one line: it branches or has several parts; make a group of each line.",
    )
    coordinates = np.array(list(point.values()))
    low = coordinates.min(axis=0)
    size = float(np.linalg.norm(np.ptp(coordinates, axis=0)))
    # Where all points coincide, any number serves.
    resolution = COORDINATE_TOLERANCE * size or 1.0

    def rounded(vertex: int) -> tuple[float, ...]:
        """Coordinates of a vertex as whole numbers, so that round-off does not choose between equal
        ones."""
        return tuple(np.rint((point[vertex] - low) / resolution).tolist())

    def other(edge: int, vertex: int) -> int:
        """The other end of an edge."""
        first, last = ends_of[edge]
        return last if vertex == first else first

    start = min(ends or point, key=rounded)
    edge = min(edges_at[start], key=lambda one: rounded(other(one, start)))
    walk = []
    forwards = []
    vertex = start
    while True:
        walk.append(edge)
        forwards.append(ends_of[edge][0] == vertex)
        vertex = other(edge, vertex)
        further = [one for one in edges_at[vertex] if one != edge]
        if not further or vertex == start:
            break
        edge = further[0]
    kind = "lines" if ends else "closed lines"
    check(
        len(walk) == len(vertices),
        f"{what} is not one line: its edges form several {kind}; make a group of each line.",
    )
    return np.array(walk), np.array(forwards), not ends


def aligned(a: EdgeLine, b: EdgeLine, start: State) -> EdgeLine:
    """The line b, reversed if need be, so that points of like fraction σ are close to those of a in
    the initial state.  Of a closed line the beginning is chosen, too: the vertex for which the mean
    squared distance is smallest.  Collective."""
    x_a = a.positions(start)
    x_b = b.positions(start)
    # An open line begins at one of its two ends, a closed one at any vertex.
    first_edges: Sequence[int] = (0,)
    if b.is_closed:
        first_edges = range(len(b.nodes))
    least = np.inf
    nearest = b
    for line, x in ((b, x_b), (b.reversed(), x_b[::-1])):
        for k in first_edges:
            candidate = line
            if k > 0:
                candidate = line.begun_at(k)
            points = np.roll(x[:-1], -k, axis=0)
            last = x[-1:]
            if b.is_closed:
                last = points[:1]
            x_candidate = np.vstack([points, last])
            distance = _mean_square(a.fractions, x_a, candidate.fractions, x_candidate)
            # Round-off must not choose between two that are equally far.
            if distance < least * (1 - COORDINATE_TOLERANCE):
                least = distance
                nearest = candidate
    return nearest


def _mean_square(σ_a: Array, x_a: Array, σ_b: Array, x_b: Array) -> float:
    """Mean of |x_a - x_b|² [m²] at the points of a, of two lines given by the fractions σ (n,) and
    the positions x (n, 3) [m] of their points; b is linear between its points."""
    at_points_of_a = np.stack([np.interp(σ_a, σ_b, component) for component in x_b.T], axis=1)
    squared_distances = ((x_a - at_points_of_a) ** 2).sum(axis=1)
    return float(squared_distances.mean())
