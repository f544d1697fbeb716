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
from typing import Any

import basix
import numpy as np
import numpy.typing as npt

from gossamer_fx.core.algebra.point_measures import Gather
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.item import Item
from gossamer_fx.mechanics.bodies.edge_lines import EdgeLine, edge_line
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.gas.patches import Patches, is_owned
from gossamer_fx.mechanics.terms.assembly import Assembly

Indices = npt.NDArray[np.int64]

# The volume of (3) is linear across a strip in x and in w, and constant in x,r: degree 2 in r.
QUADRATURE_DEGREE_ACROSS = 2

# Area of a ring over the square of its length, up to which it is round-off.
CLOSED = 1e-13


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

    def requires(self) -> Iterable[Item]:
        """The film, which joins the scene with the opening."""
        yield self.body

    def __post_init__(self) -> None:
        # Refuses a name that is not a group of curves of the mesh.
        self.body.mesh.curve(self.edges, f"Ring on '{self.body.name}'")

    def loop(self) -> EdgeLine:
        """Return the edges of the closed line in the order of a walk around it, the same on every
        rank.  Collective.

        The walk starts at the vertex with the lowest x on the mesh, of those the lowest y, then z:
        at the seam of a tube that is pressed flat, so that opposite edges lie on each other.  Edges
        that form no closed line raise `InputError`.
        """
        line = edge_line(self.body, self.edges, "Ring")
        check(
            line.is_closed,
            f"Ring: the edges '{self.edges}' of '{self.body.name}' form no closed line; "
            "name a group that does.",
        )
        return line


class Loop:
    """A ring in a running scene: its area vector (1) of the module, and the strips that close it.

    Attributes:
        line: the edges of the ring in the order of the walk.
        indices: global indices of the coordinates of its nodes in system vectors (nodes, 3).
    """

    def __init__(self, ring: Ring, system: Assembly) -> None:
        """Walk once around the ring, and tabulate the strips that close it.  Collective."""
        self.line = ring.loop()
        order = self.line.order
        self._system = system
        nodes = self.line.nodes[:, 0]
        if order == 2:
            nodes = np.concatenate([nodes, self.line.nodes[:, 1]])
        self._strips = _strips(len(self.line.nodes), order)
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
        length = float(self._weights @ np.linalg.norm(xs, axis=-1).sum(axis=0))
        if size <= CLOSED * length**2:
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

    def add_own(self, values: Array, gradient: Array) -> None:
        """Add a gradient of `aperture_gradient` to this rank's part of a vector of the system."""
        values[self._own] += gradient[self._mine]

    def _strip_tangents(self, X: Array) -> tuple[Array, Array]:
        """x,s and x,r (strips, g, 3) for the positions X (nodes, 3) of the nodes."""
        corners = X[self._strips]
        return self._ds @ corners, self._dr @ corners


def quadrature(degree: int) -> tuple[Array, Array]:
    """Points and weights (g,) on the interval [0, 1], exact for polynomials of a degree."""
    points, weights = basix.make_quadrature(basix.CellType.interval, degree)
    return np.asarray(points).ravel(), np.asarray(weights)


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
