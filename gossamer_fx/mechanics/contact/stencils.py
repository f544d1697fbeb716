"""The stencil of each kind of contact pair: all that is different from one kind to the next.

A kind is a row of `kernels/stencils.c` and the class here that has its number: together they say
what the distance is, its derivatives, the range of the energy, and whether a point may get behind
the other side.  Everything else asks the stencil.  A new kind is a new class, wherever it is
written, and a row in C: see `cone.py`.

The C functions give a number s for each pair, in which the energy is concave (`contact.potential`):

    two surfaces       s is the squared distance of the closest points [m²]
    planes             s is the signed distance [m]
    inside of a room   s is minus the squared distance from its middle [m²]

`distance` makes metres of it, and `gap` takes off the radii of both sides.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np

from gossamer_fx.mechanics.contact.contract import Array, ByteArray, MaskArray, Sides

# A table of pairs, `pair_table.PairTable`, whose module imports this one.
type Pairs = Any

# ε over the width of a pair of edges.  With a fiftieth of it, barriers near the ends of edges are
# so steep that a fine sail needs 40 % more steps.
ROUNDING = 0.05

# No length: divisions by smaller ones are meaningless.
TINY = 1e-300


class PairStencil:
    """A kind of pair; each subclass with a number is one.

    Its methods take n pairs of this kind:

        s           what the C functions call the squared distance (n,), see the module
        radius      of both sides together (n,) [m]
        shape       the number (n,) that the kind needs besides points; zero if it needs none
        reach       activation distance (n,) [m], the gap below which pairs have energy
        x           the four points of each pair (n, 4, 3) [m], of which directions are vectors [-];
                    complex ones are differentiated by a complex step
        parameters  (u, v) (n, 2) [-] of the closest points along both sides; of boundaries zero
    """

    number: ClassVar[int]
    sides: ClassVar[Sides]

    def __init_subclass__(cls) -> None:
        """Enter a kind with a number into `STENCILS` and `SIDES`."""
        if "number" in vars(cls):
            taken = STENCILS.get(cls.number)
            if taken is not None:
                raise TypeError(f"{cls.__name__}: {type(taken).__name__} is number {cls.number}.")
            STENCILS[cls.number] = cls()
            SIDES[cls.number] = cls.sides

    def distance(self, s: Array) -> Array:
        """Return the distance (n,) [m] of both sides without radii; in rooms it is negative."""
        return np.sqrt(np.maximum(s, 0))

    def gap(self, s: Array, radius: Array, shape: Array) -> Array:
        """Return the distance (n,) [m] less the radii of both sides."""
        return self.distance(s) - radius

    def energy_range(
        self, reach: Array, radius: Array, shape: Array, is_barrier: bool
    ) -> tuple[Array, Array]:
        """Return width and offset (n,) of x = (s - offset)/width, in the unit of s. x is zero where
        the sides meet, and one where the gap is the activation distance."""
        # With the sum R of both radii, a pair with the gap d has the squared distance (R + d)².
        width: Array = (radius + reach) ** 2 - radius**2
        return width, radius**2

    def gap_weights(self, parameters: Array) -> Array:
        """Return the weights (n, 4) of the points in the vector from the second side to the first.
        It leads between the closest points; of boundaries it is the first point."""
        raise NotImplementedError

    def derivatives(self, x: Array, parameters: Array, shape: Array) -> tuple[Array, Array]:
        """Return the distance D (n,) [m] and its derivatives (n, 4, 3) by the points. That by the
        first point of a boundary's pair is the unit normal, towards the body."""
        # Closest points are stationary, so that their parameters count as constant.
        weights = self.gap_weights(parameters)
        between = np.einsum("nk,nkc->nc", weights, x)
        distance = lengths_of(between)
        direction = between / np.maximum(distance, TINY)[:, None]
        return distance, weights[:, :, None] * direction[:, None]

    def taper(self, shape: Array) -> Array | None:
        """Return T (n,) [m] if closest points minimise |z| - T v, z being the vector between the
        points (u, v) of both sides; None: they minimise |z|."""
        return None

    def parameter_derivatives(self, x: Array, parameters: Array, shape: Array) -> Array:
        """Return the derivatives (n, 2, 4, 3) [1/m] of (u, v) by the points; zero for
        boundaries."""
        from gossamer_fx.mechanics.contact.narrow_phase.closest_point_derivatives import (
            parameter_derivatives,
        )

        return parameter_derivatives(self.sides, x, parameters, self.taper(shape))


# The stencil of each kind, and its sides, by the number of the kind.
STENCILS: dict[int, PairStencil] = {}
SIDES = np.zeros(256, dtype=np.uint8)


class PointTriangle(PairStencil):
    """A point and a triangle."""

    number = 0
    sides = Sides.POINT_TRIANGLE

    def gap_weights(self, parameters: Array) -> Array:
        u, v = parameters.T
        return np.column_stack([np.ones_like(u), u + v - 1, -u, -v])


class EdgeEdge(PairStencil):
    """Two edges, whose squared distance is rounded where they are almost parallel."""

    number = 1
    sides = Sides.EDGE_EDGE

    def gap_weights(self, parameters: Array) -> Array:
        u, v = parameters.T
        return np.column_stack([1 - u, u, v - 1, -v])

    def energy_range(
        self, reach: Array, radius: Array, shape: Array, is_barrier: bool
    ) -> tuple[Array, Array]:
        width, offset = super().energy_range(reach, radius, shape, is_barrier)
        if not is_barrier:
            return width, offset
        # Squared distances of edges are rounded, so that they are not zero at a crossing.  Barriers
        # shall be infinite there, and begin at the same distance: offset + width is constant.
        width = width / (1 + ROUNDING / 2)
        return width, offset + ROUNDING / 2 * width


class BoundaryStencil(PairStencil):
    """A point and a boundary, behind which it cannot get."""

    sides = Sides.POINT_BOUNDARY

    def gap_weights(self, parameters: Array) -> Array:
        return np.broadcast_to([1.0, 0.0, 0.0, 0.0], (len(parameters), 4))

    def parameter_derivatives(self, x: Array, parameters: Array, shape: Array) -> Array:
        return np.zeros((len(x), 2, 4, 3), dtype=x.dtype)


class PointPlane(BoundaryStencil):
    """A point and a plane, whose first direction is its unit normal; its second one is not used,
    and s is the distance [m]."""

    number = 2

    def distance(self, s: Array) -> Array:
        return s

    def energy_range(
        self, reach: Array, radius: Array, shape: Array, is_barrier: bool
    ) -> tuple[Array, Array]:
        return reach, radius

    def derivatives(self, x: Array, parameters: Array, shape: Array) -> tuple[Array, Array]:
        r = x[:, 0] - x[:, 1]
        normal = x[:, 2]
        gradient = np.zeros_like(x)
        gradient[:, 0] = normal
        gradient[:, 1] = -normal
        gradient[:, 2] = r
        return (r * normal).sum(axis=1), gradient


class Room(BoundaryStencil):
    """A point within a round room, whose radius [m] is its `shape`."""

    def distance(self, s: Array) -> Array:
        length: Array = np.sqrt(np.maximum(-s, 0))
        return -length

    def gap(self, s: Array, radius: Array, shape: Array) -> Array:
        return (shape - radius) + self.distance(s)

    def energy_range(
        self, reach: Array, radius: Array, shape: Array, is_barrier: bool
    ) -> tuple[Array, Array]:
        room = shape - radius
        return room**2 - (room - reach) ** 2, -(room**2)


class PointInSphere(Room):
    """A point in a sphere, whose origin is the centre, and which has no directions."""

    number = 3

    def derivatives(self, x: Array, parameters: Array, shape: Array) -> tuple[Array, Array]:
        r = x[:, 0] - x[:, 1]
        distance = lengths_of(r)
        gradient = np.zeros_like(x)
        gradient[:, 0] = -r / np.maximum(distance, TINY)[:, None]
        gradient[:, 1] = -gradient[:, 0]
        return -distance, gradient


class PointInCylinder(Room):
    """A point in a cylinder, whose directions are two unit vectors across its axis."""

    number = 4

    def derivatives(self, x: Array, parameters: Array, shape: Array) -> tuple[Array, Array]:
        r = x[:, 0] - x[:, 1]
        across = np.einsum("nc,nkc->nk", r, x[:, 2:])
        distance = lengths_of(across)
        share = across / np.maximum(distance, TINY)[:, None]
        gradient = np.zeros_like(x)
        gradient[:, 0] = -np.einsum("nk,nkc->nc", share, x[:, 2:])
        gradient[:, 1] = -gradient[:, 0]
        gradient[:, 2:] = -share[:, :, None] * r[:, None]
        return -distance, gradient


def stencils_of(kind: ByteArray) -> Iterator[tuple[PairStencil, Any]]:
    """Yield each stencil among pairs of the kinds (n,), and its rows as a mask, or a slice of
    all."""
    present = np.bincount(kind).nonzero()[0]
    if len(present) == 1:
        # The usual scene of boundaries, or a table of one kind, is not copied.
        yield STENCILS[int(present[0])], slice(None)
        return
    for number in present:
        yield STENCILS[int(number)], kind == number


def is_boundary(kind: ByteArray) -> MaskArray:
    """Return which pairs (n,) are of a point and a boundary: a plane, or the inside of a room."""
    return np.asarray(SIDES[kind] == Sides.POINT_BOUNDARY)


def gaps_of(pairs: Pairs, s: Array, radius: Array) -> Array:
    """Return the gaps (n,) [m] of pairs: their distance less the radii of both sides (n,) [m]."""
    gap = np.empty(len(pairs))
    for stencil, rows in stencils_of(pairs.kind):
        gap[rows] = stencil.gap(s[rows], radius[rows], pairs.shapes[rows])
    return gap


def gap_weights_of(kind: ByteArray, parameters: Array) -> Array:
    """Return the weights (n, 4) of pairs' points in the vector from their second side to the first.
    It leads between the closest points, which have the parameters (u, v) (n, 2); of boundaries it
    is the first point."""
    weights = np.empty((len(kind), 4), dtype=parameters.dtype)
    for stencil, rows in stencils_of(kind):
        weights[rows] = stencil.gap_weights(parameters[rows])
    return weights


def derivatives_of(pairs: Pairs, x: Array, parameters: Array) -> tuple[Array, Array]:
    """Return the distances (n,) [m] of pairs, and their derivatives (n, 4, 3) by their points x."""
    distance = np.empty(len(pairs), dtype=x.dtype)
    gradient = np.empty_like(x)
    for stencil, rows in stencils_of(pairs.kind):
        distance[rows], gradient[rows] = stencil.derivatives(
            x[rows], parameters[rows], pairs.shapes[rows]
        )
    return distance, gradient


def parameter_derivatives_of(pairs: Pairs, x: Array, parameters: Array) -> Array:
    """Return the derivatives (n, 2, 4, 3) [1/m] of (u, v) of pairs by their points x (n, 4, 3)."""
    found = np.empty((len(pairs), 2, 4, 3))
    for stencil, rows in stencils_of(pairs.kind):
        found[rows] = stencil.parameter_derivatives(x[rows], parameters[rows], pairs.shapes[rows])
    return found


# ---- vectors, also complex ones ----


def lengths_of(vectors: Array) -> Array:
    """Return the lengths (...) of vectors (..., k). Of complex vectors it is the analytic function
    of them, and not the norm: a complex step differentiates it."""
    return np.sqrt((vectors * vectors).sum(axis=-1))
