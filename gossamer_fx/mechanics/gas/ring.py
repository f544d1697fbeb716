"""Rings: closed lines of film edges, as openings for gas and as virtual walls between chambers.

Problem.  A folded tube has compartments that gas leaves through its folds.  No film closes such a
compartment, yet its volume, the pressure force on its film and the opening have to be defined, for
a ring of any deformed shape, such that energy and momentum are conserved.

Idea.  Strips between opposite edges of the ring span a surface x(s, r) = (1 - r) x_a(s) + r x_b(s)
between edge x_a of one side and edge x_b of the other.  With n = x,s × x,r

    a = ∫∫ n ds dr            area vector                                            (1)
    G[w] = ∫∫ n·w ds dr       gradient of the volume, quadratic in x                 (2)
    V = ⅓ G[x]                share of the enclosed volume, cubic in x               (3)

summed over the strips.  The sum of n over a closed surface is zero, so the pressure has no
resultant. The nodes of the ring bear the pressure on the strips.  A node is coupled to those of two
strips only, and the pressure is spread as the strips' areas are.  (A fan from the centre of the
ring was the alternative: it would couple every node to all others.)

Algorithm.

1. `Ring.loop` orders the edges to a walk around the ring, the same for any number of ranks.
2. `Loop` pairs the edges: the walk goes along both sides from its first vertex at once.  Of an odd
   number of edges the last spans a strip with its own end vertex.
3. `Loop.patches` has the strips as patches, which `gas.patches` evaluates with the triangles of the
   film.

Cost: proportional to the number of edges; every rank knows all nodes of a ring.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import basix
import numpy as np
import numpy.typing as npt

from gossamer_fx.core.algebra.point_measures import Gather
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.gas.patches import Patches, is_owned
from gossamer_fx.mechanics.terms.assembly import Assembly

Indices = npt.NDArray[np.int64]

# Coordinates that differ by less than this share of the ring's extent count as equal when the first
# vertex of a walk is chosen: far above round-off, far below the length of an edge.
COORDINATE_TOLERANCE = 1e-9

# The volume of (3) is linear across a strip in x and in w, and constant in x,r: degree 2 in r.
QUADRATURE_DEGREE_ACROSS = 2


class Edge(NamedTuple):
    """An edge of a film in global numbers of its vertices and nodes; `middle_node` is -1 for films
    of order 1.  `start` and `end` (3,) [m] are its ends on the mesh."""

    first_vertex: int
    last_vertex: int
    first_node: int
    last_node: int
    middle_node: int
    start: tuple[float, ...]
    end: tuple[float, ...]

    def reversed(self) -> Edge:
        """Return the same edge of a film in the opposite direction: its two ends are exchanged."""
        return Edge(
            first_vertex=self.last_vertex,
            last_vertex=self.first_vertex,
            first_node=self.last_node,
            last_node=self.first_node,
            middle_node=self.middle_node,
            start=self.end,
            end=self.start,
        )


@check_arguments
@dataclass(frozen=True, eq=False)
class Ring:
    """A closed line of film edges.

    As the `area` of an `Orifice` it is the opening |½ ∮ x × dx| [m²] in its deformed shape, taken
    half a step ahead of the known state: a folded tube chokes where it is folded.  In
    `Chamber(rings=...)` it is spanned by strips, which close the chamber.

    Args:
        body: the film.
        edges: name of a group of curves of its mesh.

    Raises:
        InputError: the mesh has no such group of curves.

    Example:
        >>> from gossamer_fx.meshes.tube import flat_tube
        >>> tube = gx.Membrane(flat_tube(comm, 0.2, 0.05, cells=4, compartments=2), law)
        >>> ring = gx.gas.Ring(tube, "ring 1")
        >>> opening = gx.Orifice(tank, gx.gas.Ambient(), area=ring, discharge_coefficient=0.8)
    """

    body: Membrane
    edges: str

    def __post_init__(self) -> None:
        # Refuses a name that is not a group of curves of the mesh.
        self.body.mesh.curve(self.edges, f"Ring on '{self.body.name}'")

    def requires(self) -> Iterable[Any]:
        yield self.body

    def loop(self) -> Indices:
        """Return the edges of a closed line in the order of a walk around it, the same on every
        rank: (n, 5), two end vertices, two end nodes and the node between them (or -1), in global
        numbers.  Collective.

        The walk starts at the vertex with the lowest x on the mesh, of those the lowest y, then z:
        at the same vertex for any number of ranks, and at the seam of a tube that is pressed flat,
        so that opposite edges lie on each other.  Edges that form no closed line raise
        `InputError`.
        """
        edges = sorted(
            edge for part in self.body.comm.allgather(self._own_edges()) for edge in part
        )
        message = (
            f"Ring: the edges '{self.edges}' of '{self.body.name}' form no closed line; "
            "name a group that does."
        )
        edges_at: dict[int, list[int]] = {}
        for i, edge in enumerate(edges):
            edges_at.setdefault(edge.first_vertex, []).append(i)
            edges_at.setdefault(edge.last_vertex, []).append(i)
        two_at_each_vertex = all(len(meeting) == 2 for meeting in edges_at.values())
        check(len(edges) > 2 and two_at_each_vertex, message)
        walk: list[Edge] = []
        i = 0
        vertex = edges[0].first_vertex
        while not walk or i != 0:
            edge = edges[i]
            if edge.first_vertex != vertex:
                edge = edge.reversed()
            walk.append(edge)
            vertex = edge.last_vertex
            # the other one of the two edges at the vertex
            i = sum(edges_at[vertex]) - i
        # A shorter walk means that the edges form several closed lines.
        check(
            len(walk) == len(edges),
            f"Ring: the edges '{self.edges}' of '{self.body.name}' form several closed lines; "
            "make a group of each line, and give a Ring for each.",
        )
        numbers = np.array([edge[:5] for edge in walk])
        starts = np.array([edge.start for edge in walk])
        return np.roll(numbers, -_lowest(starts), axis=0)

    def _own_edges(self) -> list[Edge]:
        """Return the edges of the ring that this rank owns, in global numbers."""
        film = self.body
        table = film.mesh.edges
        edges = film.mesh.curve(self.edges, f"Ring on '{film.name}'")
        own = edges[edges < table.owned]
        local = table.nodes(film.space, own)
        numbers = film.block.index_map.local_to_global(local.ravel())
        nodes = numbers.reshape(local.shape)
        coordinates = film.space.tabulate_dof_coordinates()
        result = []
        ends = table.ends[own]
        for k in range(len(own)):
            middle_node = -1
            if film.order == 2:
                middle_node = int(nodes[k, 1])
            edge = Edge(
                first_vertex=int(ends[k, 0]),
                last_vertex=int(ends[k, 1]),
                first_node=int(nodes[k, 0]),
                last_node=int(nodes[k, -1]),
                middle_node=middle_node,
                start=tuple(map(float, coordinates[local[k, 0]])),
                end=tuple(map(float, coordinates[local[k, -1]])),
            )
            result.append(edge)
        return result


class Loop:
    """A ring in a running scene: its area vector (1) of the module, and the strips that close it.

    Attributes:
        vertices: global end vertices of the edges in the order of the walk (n, 2).
        indices: global indices of the coordinates of its nodes in system vectors (nodes, 3).
    """

    def __init__(self, ring: Ring, system: Assembly) -> None:
        """Walk once around the ring, and tabulate the strips that close it.  Collective."""
        walk = ring.loop()
        order = ring.body.order
        self._system = system
        self.vertices = walk[:, :2]
        nodes = walk[:, 2]
        if order == 2:
            nodes = np.concatenate([walk[:, 2], walk[:, 4]])
        self._strips = _strips(len(walk), order)
        self._tabulate(order)
        self.indices = system.block(ring.body).to_global(nodes)
        self._gather = Gather(system.numbering, [self.indices])
        self._mine = is_owned(self.indices[:, 0], system.numbering)
        self._own = self.indices[self._mine] - system.numbering.start

    def patches(self) -> Patches:
        """The strips, each on the rank that owns its first node."""
        mine = self._strips[self._mine[self._strips[:, 0]]]
        return Patches(self.indices[mine, 0], self._ds, self._dr, self._test)

    def _tabulate(self, order: int) -> None:
        """Tabulate the shape functions of a strip at its quadrature points, (points, nodes of a
        strip) each: `_test`, values times the weight of the point, and `_ds` and `_dr`, derivatives
        along and across the strip.

        In the code s and r are the points along and across the strip, from 0 to 1, N and dN values
        and derivatives of the shape functions along it.
        """
        interval = basix.CellType.interval
        # Degree of (3) along a strip: order - 1 of x,s, order of x,r and order of w.
        degree_along = 3 * order - 1
        s, weights_s = quadrature(degree_along)
        r, weights_r = quadrature(QUADRATURE_DEGREE_ACROSS)
        element: Any = basix.create_element(basix.ElementFamily.P, interval, order)
        N, dN = element.tabulate(1, s[:, None])[..., 0]
        across = np.stack([1 - r, r], axis=1)
        across_slope = np.broadcast_to([-1.0, 1.0], across.shape)

        def at_points(along: Array, sideways: Array) -> Array:
            """Products (g, k) of functions along a strip and across; the nodes of side a come
            first."""
            products = np.einsum("si,rj->srji", along, sideways)
            points = len(along) * len(sideways)
            return products.reshape(points, -1)

        weights = np.outer(weights_s, weights_r)
        self._weights = weights.ravel()
        self._ds = at_points(dN, across)
        self._dr = at_points(N, across_slope)
        self._test = at_points(N, across) * weights.reshape(-1, 1)

    def aperture(self, h: float) -> float:
        """|a| [m²] of (1) at q0 + ½ h v0, for a step of length h [s]: the middle of the coming step
        to second order.  The middle of the iterate is not taken: then the flow would depend on the
        film, and the tangent on the flow.  Collective."""
        xs, xr = self._strip_tangents(self._predicted(h))
        return float(np.linalg.norm(self._area_vector(xs, xr)))

    def aperture_gradient(self, h: float) -> Array:
        """Return the derivative ∂|a|/∂q0 (nodes, 3) [m] of the opened area |a| [m²] by positions at
        the start of a step of length h [s], the same on every rank; zero for a ring without area.
        That by v0 is ½ h times as large.  Collective.

        With e = a/|a| the change of |a| is e·δa, and with the tangents x,s and x,r of the ring's
        strips e·δa = ∫∫ δx,s·(x,r × e) + δx,r·(e × x,s) ds dr.  In the code xs and xr are these
        tangents [m] at the quadrature points of all strips, X (nodes, 3) [m] the positions
        predicted from the start of the step, at which the area is taken.
        """
        X = self._predicted(h)
        xs, xr = self._strip_tangents(X)
        area_vector = self._area_vector(xs, xr)
        size = float(np.linalg.norm(area_vector))
        gradient = np.zeros_like(X)
        if size == 0:
            # A closed ring opens in no direction more than in another.
            return gradient
        e = np.broadcast_to(area_vector / size, xs.shape)
        weights = self._weights[:, None]
        by_xs = weights * _cross(xr, e)
        by_xr = weights * _cross(e, xs)
        of_strips = self._ds.T @ by_xs + self._dr.T @ by_xr
        np.add.at(gradient, self._strips, of_strips)
        return gradient

    def _predicted(self, h: float) -> Array:
        """Positions q0 + ½ h v0 (nodes, 3) [m] of the nodes.  Collective."""
        positions = self._gather(self._system.q0)[0]
        velocities = self._gather(self._system.v0)[0]
        return positions + h / 2 * velocities

    def _area_vector(self, xs: Array, xr: Array) -> Array:
        """a (3,) [m²] of (1) for the tangents of the strips."""
        return np.einsum("g,ngd->d", self._weights, _cross(xs, xr))

    def direction(self, vertices: Indices) -> Indices:
        """For each edge, by the global numbers (m, 2) of its ends, +1 if the walk passes it from
        the first to the second vertex, -1 for the opposite direction, 0 if it is not an edge of the
        ring; (m,)."""
        # a and b are the first and second vertex of an edge.
        passed = {(int(a), int(b)) for a, b in self.vertices}
        signs = np.zeros(len(vertices), dtype=np.int64)
        for i in range(len(vertices)):
            a = int(vertices[i, 0])
            b = int(vertices[i, 1])
            if (a, b) in passed:
                signs[i] = 1
            elif (b, a) in passed:
                signs[i] = -1
        return signs

    def add_own(self, values: Array, G: Array) -> None:
        values[self._own] += G[self._mine]

    def _strip_tangents(self, X: Array) -> tuple[Array, Array]:
        """x,s and x,r (strips, g, 3) for the positions X (nodes, 3) of the nodes."""
        corners = X[self._strips]
        return self._ds @ corners, self._dr @ corners


def quadrature(degree: int) -> tuple[Array, Array]:
    """Points and weights (g,) on the interval [0, 1], exact for polynomials of a degree."""
    points, weights = basix.make_quadrature(basix.CellType.interval, degree)
    return np.asarray(points).ravel(), np.asarray(weights)


def _lowest(points: Array) -> int:
    """Return the number of the point (n, 3) [m] that has the lowest x, of those the lowest y, then
    z.  Coordinates that differ by round-off count as equal; of equal points it is the first."""
    low = points.min(axis=0)
    high = points.max(axis=0)
    extent = float(np.linalg.norm(high - low))
    # A ring of no extent is compared by 1 m, to avoid a division by zero.
    resolution = COORDINATE_TOLERANCE * extent or 1.0
    # Rounding makes coordinates equal that differ by round-off only.
    x, y, z = np.rint((points - low) / resolution).T
    # lexsort sorts by its last key first.
    return int(np.lexsort((z, y, x))[0])


def _strips(n: int, order: int) -> Indices:
    """Return the nodes (strips, 2 (order + 1)) of the n/2 strips, rounded up, that close a ring of
    n edges: on either side the start, the end and, of order 2, the node between.  Vertex i of the
    walk is node i, the node on the edge that begins there is node n + i."""
    pairs = np.arange(n // 2)
    # start, end and middle node of the edges on the way there, and on the way back
    there = [pairs, pairs + 1, n + pairs]
    back = [
        (n - pairs) % n,
        n - 1 - pairs,
        2 * n - 1 - pairs,
    ]
    columns = there[: order + 1] + back[: order + 1]
    strips = np.stack(columns, axis=1)
    if n % 2:
        # The last edge of an odd number spans a triangle with its end vertex.
        last = n // 2
        edge = [last, last + 1, n + last][: order + 1]
        end_vertex = [last + 1] * (order + 1)
        strips = np.vstack([strips, edge + end_vertex])
    return strips


def _cross(a: Array, b: Array) -> Array:
    """Return a × b over the last axis of two arrays (n, g, 3); np.cross takes three times as long
    for so few vectors."""
    ax, ay, az = a.transpose(2, 0, 1)
    bx, by, bz = b.transpose(2, 0, 1)
    product = np.empty(a.shape)
    product[:, :, 0] = ay * bz - az * by
    product[:, :, 1] = az * bx - ax * bz
    product[:, :, 2] = ax * by - ay * bx
    return product
