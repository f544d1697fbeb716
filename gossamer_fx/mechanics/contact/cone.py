"""A cone as an obstacle, or the room within one: its stencils, its parts and its picture.

Outside it is the hull of two balls.  Its distance from an edge follows from the balls of radius
R(v) along its axis,

    s = min over (u, v) of |z(u, v)| - T v,    R(v) = R₀ + T v,                                (1)

z leading from the point v of the axis to the point u of the edge.  |z| is the square root of a
function that is linear in the measures, so that s is concave in them, as all distances are
(`contact.contact_step`).  At the minimum z is normal to the mantle.

Inside, a point at the height z above the apex and at the distance ρ from the axis is

    s = z sin α - ρ cos α,    α half of the angle at the apex,                                 (2)

from the mantle.  With ρ from the products of r with two directions across the axis, and z from r·r
less their squares, s is concave, too.  Heights count from an origin behind the apex, so that they
are positive beyond the boundary as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from gossamer_fx.core.algebra.rotations import perpendicular_pair
from gossamer_fx.core.checks.arguments import DISTINCT, check_arguments, not_negative
from gossamer_fx.core.model.body import Vector
from gossamer_fx.mechanics.contact.contract import Array
from gossamer_fx.mechanics.contact.obstacles import (
    DrawnSurface,
    Obstacle,
    ObstacleBoundary,
    ObstacleSolid,
    rounded_cone,
    unit_vector,
)
from gossamer_fx.mechanics.contact.pairs import (
    ROUNDING,
    TINY,
    BoundaryStencil,
    EdgeEdge,
    lengths_of,
)


class EdgeCone(EdgeEdge):
    """An edge and the axis of a cone; its `shape` is T [m] of (1), and s a distance [m]."""

    number = 5

    def distance(self, s: Array) -> Array:
        return s

    def energy_range(
        self, reach: Array, radius: Array, shape: Array, is_barrier: bool
    ) -> tuple[Array, Array]:
        if not is_barrier:
            return reach, radius
        # Rounding adds at most ε/2 to |z|², with ε = ROUNDING width².  Barriers shall be infinite
        # where the sides touch, and begin at the same distance.
        # The sum of both radii at the smaller ball of the cone, whose radius is R₀ or R₀ + T.
        least_radius = radius + np.minimum(shape, 0)
        lift = np.sqrt(least_radius**2 + ROUNDING / 2 * reach**2) - least_radius
        return reach - lift, radius + lift

    def derivatives(self, x: Array, parameters: Array, shape: Array) -> tuple[Array, Array]:
        length, gradient = super().derivatives(x, parameters, shape)
        return length - shape * parameters[:, 1], gradient

    def taper(self, shape: Array) -> Array:
        return shape


class PointInCone(BoundaryStencil):
    """A point in a cone, whose origin is behind the apex, on the axis.

    Its directions are two orthogonal vectors across the axis of the length cos α; its `shape` is s
    [m] of a point on the mantle, which is not zero as heights do not count from the apex.
    """

    number = 6

    def distance(self, s: Array) -> Array:
        return s

    def gap(self, s: Array, radius: Array, shape: Array) -> Array:
        return s - shape - radius

    def energy_range(
        self, reach: Array, radius: Array, shape: Array, is_barrier: bool
    ) -> tuple[Array, Array]:
        return reach, shape + radius

    def derivatives(self, x: Array, parameters: Array, shape: Array) -> tuple[Array, Array]:
        r = x[:, 0] - x[:, 1]
        directions = x[:, 2:]
        products = np.einsum("nc,nkc->nk", r, directions)
        across = lengths_of(products)
        # cos²α, as the length of the first direction has it; Q of `kernels/stencils.c`.
        square = (directions[:, 0] ** 2).sum(axis=1)
        ratio = (across / square) ** 2
        height = np.sqrt((1 - square) * ((r * r).sum(axis=1) - across**2 / square))
        share = products / np.maximum(across, TINY)[:, None]
        by_product = -share - (1 / square - 1)[:, None] * products / height[:, None]
        gradient = np.zeros_like(x)
        gradient[:, 0] = ((1 - square) / height)[:, None] * r
        gradient[:, 0] += np.einsum("nk,nkc->nc", by_product, directions)
        gradient[:, 1] = -gradient[:, 0]
        gradient[:, 2:] = by_product[:, :, None] * r[:, None]
        by_square = (ratio - (r * r).sum(axis=1)) / (2 * height)
        gradient[:, 2] += 2 * by_square[:, None] * directions[:, 0]
        return height - across, gradient


Radius = Annotated[float, not_negative("m")]


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Cone(Obstacle):
    """A cone or frustum with round ends, or the endless room within its mantle.

    The mantle goes through a circle round each end; one of the circles may be a point, the apex.
    Each end is closed by the ball that touches the mantle at its circle.

    Args:
        start, end: middles of both circles, on the axis [m].
        radii: of the circles round start and end [m]; one may be zero.
        inside: whether bodies are kept within the mantle, which then goes on without an end beyond
            the larger circle, and to the apex beyond the smaller one.
        body, motion, friction, name: see `Obstacle`.

    Raises:
        InputError: start and end are the same point; radii that are negative or equal; see also
            `Obstacle`.

    Example:
        >>> import gossamer_fx as gx
        >>> nozzle = gx.contact.Cone(start=(0, 0, 0), end=(0, 0, 0.3), radii=(0.2, 0.05))
        >>> funnel = gx.contact.Cone(start=(0, 0, 0), end=(0, 0, 1), radii=(0, 0.5), inside=True)
    """

    start: Vector
    end: Vector
    radii: Annotated[tuple[Radius, Radius], DISTINCT]
    inside: bool = False

    def _balls(self) -> tuple[tuple[Array, Array], Array, tuple[float, float]]:
        """Return the centres (3,) [m] of the balls that touch the mantle at its circles, the unit
        vector along the axis, and the radii [m] of the balls."""
        between = np.subtract(self.end, self.start)
        axis = unit_vector(between, f"Cone '{self.name}': its axis")
        slope = (self.radii[0] - self.radii[1]) / float(np.linalg.norm(between))
        stretch = math.hypot(1, slope)
        first = np.asarray(self.start, dtype=float) - slope * self.radii[0] * axis
        second = np.asarray(self.end, dtype=float) - slope * self.radii[1] * axis
        return (first, second), axis, (stretch * self.radii[0], stretch * self.radii[1])

    def parts(self) -> tuple[list[ObstacleBoundary], list[ObstacleSolid]]:
        (first, second), axis, radii = self._balls()
        if self.inside:
            return [self._boundary(axis)], []
        solid = ObstacleSolid(
            (self.fixed_point(first), self.fixed_point(second)),
            ((0, 1),),
            radius=radii,
            edge_stencil=EdgeCone,
            edge_shape=radii[1] - radii[0],
        )
        return [], [solid]

    def _boundary(self, axis: Array) -> ObstacleBoundary:
        """Return the mantle as a boundary, given the unit vector from start to end."""
        length = float(np.linalg.norm(np.subtract(self.end, self.start)))
        # Height [m] of the start above the apex, along the axis; negative if the end is larger.
        slope = (self.radii[0] - self.radii[1]) / length
        apex = np.asarray(self.start, dtype=float) + self.radii[0] / slope * axis
        upwards = -math.copysign(1, slope) * axis
        # The origin is as far behind the apex as the larger circle is before it.
        height = max(self.radii) / abs(slope)
        cosine = 1 / math.hypot(1, slope)
        sine = abs(slope) * cosine
        first, second = (
            self.fixed_direction(cosine * across) for across in perpendicular_pair(axis)
        )
        origin = self.fixed_point(apex - height * upwards)
        return ObstacleBoundary(PointInCone, (origin, first, second), height * sine)

    def picture(self, near: Array) -> DrawnSurface:
        centres, axis, radii = self._balls()
        return rounded_cone(centres, axis, radii, self.inside)
