"""Obstacles that films, cables and beams touch: fixed, moved as prescribed, or parts of rigid
bodies.

An obstacle is made of boundaries, off which points are kept, and of solids: corners, edges and
triangles like those of films, with a radius around them.  Planes and rooms are boundaries; a sphere
is a corner with a radius, a cylinder an edge with a radius, a box eight corners.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from gossamer_fx.core.algebra.rotations import perpendicular_pair
from gossamer_fx.core.checks.arguments import POSITIVE, check_arguments, not_negative, positive
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.relations import at_most_one
from gossamer_fx.core.drawing import (
    BOX_CORNERS,
    BOX_EDGES,
    BOX_TRIANGLES,
    Solid,
    box_surface,
)
from gossamer_fx.core.model.body import Array, Attached, Ground, Indices, Port, Vector, unit
from gossamer_fx.mechanics.bodies.frames import along, ground_frame
from gossamer_fx.mechanics.bodies.rigid_body import RigidBody
from gossamer_fx.mechanics.contact.pairs import (
    EdgeEdge,
    PairStencil,
    PointInCylinder,
    PointInSphere,
    PointPlane,
)

# Displacement [m], three numbers, over the time [s]
PrescribedMotion = Callable[[float], Sequence[float]]

# Largest error of the products of a box's axes: they are orthonormal to round-off.
ORTHONORMALITY = 1e-9

Radius = Annotated[float, positive("m")]


@dataclass(frozen=True)
class ObstacleBoundary:
    """A boundary off which points are kept.

    Attributes:
        stencil: of its pairs; an own one is a `LawBoundary`.
        points: three vectors that describe it as its stencil says: an origin and two directions.
        shape: number that the stencil needs, such as the radius of a room [m]; 0: it needs none.
    """

    stencil: type[PairStencil]
    points: tuple[Attached, Attached, Attached]
    shape: float = 0.0


@dataclass(frozen=True)
class ObstacleSolid:
    """Corners, and edges (e, 2) and triangles (t, 3) between them, with a radius around them.

    Attributes:
        corners, edges, triangles: points, and the numbers of the corners of primitives.
        radius: around all of it [m], or that of each corner.
        edge_stencil: of pairs of its edges and those of bodies.
        edge_shape: the number that this stencil needs, as `shape` of a boundary.
    """

    corners: tuple[Attached, ...]
    edges: tuple[tuple[int, int], ...] = ()
    triangles: tuple[tuple[int, int, int], ...] = ()
    radius: float | tuple[float, ...] = 0.0
    edge_stencil: type[PairStencil] = EdgeEdge
    edge_shape: float = 0.0


@check_arguments(at_most_one("body", "motion"))
@dataclass(frozen=True, eq=False, kw_only=True)
class Obstacle:
    """Something solid.  Points and directions are those at the start, in space.

    Args:
        body: the rigid body of which it is a part; None: it stays, or moves as prescribed.
        motion: displacement [m] of the obstacle, three numbers, over the time [s]; its work is
            supplied energy.  It is continuous: steps in which it jumps are refused.
        friction: coefficient of Coulomb friction with it; None: that of the contact.
        name: in messages and outputs.

    Raises:
        InputError: a vector that is not three finite numbers, a radius that is not positive, a
            negative friction, or both `body` and `motion`; in a run: a motion that raises or
            returns something other than three finite numbers.
    """

    body: RigidBody | None = None
    motion: PrescribedMotion | None = None
    friction: Annotated[float, not_negative()] | None = None
    name: str = "obstacle"

    def parts(self) -> tuple[list[ObstacleBoundary], list[ObstacleSolid]]:
        """Return the boundaries and solids that make it up, in its position at the start.

        Boundaries keep points on one side; solids have corners, edges and triangles like those of
        films. Each kind of obstacle overrides this method.
        """
        raise NotImplementedError

    def picture(self, near: Array) -> DrawnSurface | None:
        """Return its surface at the start, for pictures; None: it is not drawn.

        Rooms and planes have lines but no triangles, which would hide what is in or behind them.

        Args:
            near: points (n, 3) [m], in whose middle a plane is drawn, which has no end.

        Returns:
            points (k, 3) [m], and triangles (t, 3) and lines (l, 2) as numbers of points.
        """
        return None

    def solid(self, near: Array) -> Solid | None:
        """Return it as a solid to draw near points (n, 3) [m], n ≥ 1; None without a picture."""
        surface = self.picture(near)
        if surface is None:
            return None
        X, triangles, lines = surface
        if self.body is not None:
            # Points of a rigid body are given by their components along its directors.
            X = np.array([self.body.port_at(x).weights[1:] for x in X])
        return Solid(self.name, X, triangles, lines, self.body, self.motion)

    def requires(self) -> Iterable[Any]:
        return () if self.body is None else (self.body,)

    def frame(self) -> tuple[Attached, ...]:
        """Return an origin and three axes that move with the rigid body of the obstacle; without
        one those of space."""
        if self.body is None:
            frame = ground_frame()
            return frame.origin, *frame.directors
        return Port(self.body, (0,)), *self.body.frame().directors

    def fixed_point(self, point: Array | Vector) -> Attached:
        """Return a point (3,) [m] that moves with the obstacle."""
        x, y, z = (float(value) for value in point)
        if self.body is None:
            return Ground((x, y, z))
        return self.body.port_at((x, y, z))

    def fixed_direction(self, direction: Array) -> Attached:
        """Return a direction (3,) that turns with the obstacle."""
        if self.body is None:
            x, y, z = direction
            return Ground((float(x), float(y), float(z)))
        return along(direction, self.body.frame())


def unit_vector(vector: Vector | Array, owner: str) -> Array:
    """Return the direction (3,) of a vector, of length one.  `owner` is named in the `InputError`
    about a vector of length zero."""
    direction = np.asarray(vector, dtype=float)
    length = np.linalg.norm(direction)
    check(bool(length > 0), f"{owner} has no length; give a direction.")
    return direction / length


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Plane(Obstacle):
    """The half-space behind a plane.

    Args:
        point: on the plane [m].
        normal: towards the side where bodies are.
        body, motion, friction, name: see `Obstacle`.

    Example:
        >>> import gossamer_fx as gx
        >>> floor = gx.contact.Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), friction=0.3)
    """

    point: Vector
    normal: Vector

    def parts(self) -> tuple[list[ObstacleBoundary], list[ObstacleSolid]]:
        """Return one boundary, with an origin on the plane [m] and the unit normal, and no solid.

        Raises:
            InputError: the normal has no length.
        """
        normal = unit_vector(self.normal, f"Plane '{self.name}': its normal")
        # The third vector of a plane is not used, and repeats the origin.
        origin = self.fixed_point(self.point)
        boundary = ObstacleBoundary(PointPlane, (origin, self.fixed_direction(normal), origin))
        return [boundary], []

    def picture(self, near: Array) -> DrawnSurface:
        return grid(np.asarray(self.point, dtype=float), unit(self.normal), near)


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Sphere(Obstacle):
    """A ball, or the room within it.

    Args:
        centre: [m].
        radius: [m].
        inside: whether bodies are kept within it.
        body, motion, friction, name: see `Obstacle`.

    Example:
        >>> import gossamer_fx as gx
        >>> ball = gx.contact.Sphere(centre=(0.0, 0.0, 0.1), radius=0.05)
    """

    centre: Vector
    radius: Radius
    inside: bool = False

    def parts(self) -> tuple[list[ObstacleBoundary], list[ObstacleSolid]]:
        """Return for a ball a solid of one corner with a radius [m], for a room (`inside`) one
        boundary with this radius, whose three points are all the centre [m]."""
        centre = self.fixed_point(self.centre)
        if self.inside:
            points = (centre, centre, centre)
            return [ObstacleBoundary(PointInSphere, points, self.radius)], []
        return [], [ObstacleSolid((centre,), radius=self.radius)]

    def picture(self, near: Array) -> DrawnSurface:
        # A ball is a cylinder without length; any axis will do.
        upwards = np.array([0.0, 0.0, 1.0])
        centre = np.asarray(self.centre, dtype=float)
        return rounded_cone((centre, centre), upwards, (self.radius, self.radius), self.inside)


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Cylinder(Obstacle):
    """A cylinder with half a ball at each end, or the room within an endless one.

    Args:
        start, end: of its axis [m].
        radius: [m].
        inside: whether bodies are kept within it.
        body, motion, friction, name: see `Obstacle`.

    Example:
        >>> import gossamer_fx as gx
        >>> mast = gx.contact.Cylinder(start=(0.0, 0.0, 0.0), end=(0.0, 0.0, 2.0), radius=0.1)
    """

    start: Vector
    end: Vector
    radius: Radius
    inside: bool = False

    def parts(self) -> tuple[list[ObstacleBoundary], list[ObstacleSolid]]:
        """Return for a mast a solid of one edge with a radius [m], for a room (`inside`) a boundary
        without ends: a point on the axis and two unit directions across it.

        Raises:
            InputError: start and end are the same point.
        """
        axis = unit_vector(np.subtract(self.end, self.start), f"Cylinder '{self.name}': its axis")
        start = self.fixed_point(self.start)
        if not self.inside:
            solid = ObstacleSolid(
                (start, self.fixed_point(self.end)), ((0, 1),), radius=self.radius
            )
            return [], [solid]
        first, second = perpendicular_pair(axis)
        points = (start, self.fixed_direction(first), self.fixed_direction(second))
        return [ObstacleBoundary(PointInCylinder, points, self.radius)], []

    def picture(self, near: Array) -> DrawnSurface:
        ends = (np.asarray(self.start, dtype=float), np.asarray(self.end, dtype=float))
        axis = unit(ends[1] - ends[0])
        return rounded_cone(ends, axis, (self.radius, self.radius), self.inside)


@check_arguments
@dataclass(frozen=True, eq=False, kw_only=True)
class Box(Obstacle):
    """A box, or the room within it.

    Args:
        centre: [m].
        sizes: lengths of its edges [m].
        axes: directions of its edges, orthonormal rows (3, 3); by default those of space.
        inside: whether bodies are kept within it.
        body, motion, friction, name: see `Obstacle`.

    Raises:
        InputError: sizes that are not positive, axes that are not orthonormal; see also `Obstacle`.

    Example:
        >>> import gossamer_fx as gx
        >>> bus = gx.contact.Box(centre=(0.0, 0.0, 0.0), sizes=(0.2, 0.2, 0.3))
    """

    centre: Vector
    sizes: Annotated[Vector, POSITIVE]
    axes: Sequence[Vector] = field(default=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    inside: bool = False

    def __post_init__(self) -> None:
        """Check sizes [m] and axes in addition to what `Obstacle` checks."""
        axes = np.asarray(self.axes, dtype=float)
        is_orthonormal = axes.shape == (3, 3) and bool(
            np.allclose(axes @ axes.T, np.eye(3), rtol=0, atol=ORTHONORMALITY)
        )
        check(
            is_orthonormal,
            f"Box '{self.name}': its axes are not three orthonormal directions; give them as rows.",
        )

    def parts(self) -> tuple[list[ObstacleBoundary], list[ObstacleSolid]]:
        """Return for a box a solid of 8 corners, 12 edges and 12 triangles, two on each face, for a
        room (`inside`) six boundaries."""
        if self.inside:
            return self._boundaries(), []
        points = tuple(self.fixed_point(corner) for corner in self._corners())
        return [], [ObstacleSolid(points, BOX_EDGES, BOX_TRIANGLES)]

    def _corners(self) -> Array:
        """The corners (8, 3) [m], in the order of `BOX_CORNERS`."""
        from_centre = BOX_CORNERS * np.asarray(self.sizes, dtype=float) / 2
        return np.asarray(self.centre, dtype=float) + from_centre @ np.asarray(self.axes, float)

    def picture(self, near: Array) -> DrawnSurface:
        corners = self._corners()
        triangles = box_surface(corners)
        if self.inside:
            triangles = triangles[:0]
        return corners, triangles, np.array(BOX_EDGES, dtype=np.int32)

    def _boundaries(self) -> list[ObstacleBoundary]:
        """Return the six planes around a room, with normals towards its middle."""
        axes = np.asarray(self.axes, dtype=float)
        centre = np.asarray(self.centre, dtype=float)
        half = np.asarray(self.sizes, dtype=float) / 2
        boundaries = []
        for k in range(3):
            for sign in (-1, 1):
                origin = self.fixed_point(centre + sign * half[k] * axes[k])
                normal = self.fixed_direction(-sign * axes[k])
                boundaries.append(ObstacleBoundary(PointPlane, (origin, normal, origin)))
        return boundaries


# ---- drawing -------------------------------------------------------------------------------------


# Points of each circle of a ball or cylinder, and circles from its equator to a pole.
CIRCLE_POINTS = 32
CIRCLES = 9

# A plane is drawn as a square grid with this number of fields along each side.
GRID_FIELDS = 6

# Side of the grid over the largest size of the shapes for which it is drawn: they should not reach
# its edge.
GRID_SIZE = 1.2

# Lines along a cylinder, evenly spaced.
MERIDIANS = 4

NO_TRIANGLES: Indices = np.zeros((0, 3), dtype=np.int32)

DrawnSurface = tuple[Array, Indices, Indices]  # points (n, 3), triangles (t, 3), lines (l, 2)


def grid(point: Array, normal: Array, near: Array) -> DrawnSurface:
    """Return a square grid of lines on a plane with a point (3,) [m] and a unit normal (3,), in the
    middle of the points `near` (n, 3) [m]."""
    middle = (near.max(axis=0) + near.min(axis=0)) / 2
    # Projected onto the plane.
    middle = middle - (middle - point) @ normal * normal
    half = GRID_SIZE * float(np.ptp(near, axis=0).max()) / 2
    # Unit directions of both families of lines, within the plane
    u, v = perpendicular_pair(normal)
    ends = []
    for position in np.linspace(-half, half, GRID_FIELDS + 1):
        for across, parallel in ((u, v), (v, u)):
            start = position * across - half * parallel
            end = position * across + half * parallel
            ends.append([start, end])
    # X are the ends of all lines.
    X = middle + np.concatenate(ends)
    lines = np.arange(len(X), dtype=np.int32).reshape(len(ends), 2)
    return X, NO_TRIANGLES, lines


def rounded_cone(
    ends: tuple[Array, Array], axis: Array, radii: tuple[float, float], inside: bool
) -> DrawnSurface:
    """Return the surface around two balls: a cone, or with equal radii a cylinder, with round ends.
    Its lines are the circles where the balls touch the mantle, and `MERIDIANS` lines along it.  The
    ends are the centres (3,) [m] of the balls, the axis a unit vector (3,) from one to the other,
    and the radii [m] theirs.  A room has no triangles."""
    angles = np.linspace(0, 2 * np.pi, CIRCLE_POINTS, endpoint=False)
    # Unit vectors u and v across the axis, orthogonal to each other
    u, v = perpendicular_pair(axis)
    circle = np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v)
    # The mantle touches both balls at one latitude, which is zero on a cylinder.
    length = float(np.linalg.norm(ends[1] - ends[0]))
    tangent = float(np.arcsin((radii[0] - radii[1]) / length)) if length else 0.0
    # Circles from the pole behind the start to the pole beyond the end, by their latitude.
    behind = np.linspace(-np.pi / 2, tangent, CIRCLES)
    beyond = np.linspace(tangent, np.pi / 2, CIRCLES)
    points = []
    for centre, radius, latitudes in zip(ends, radii, (behind, beyond), strict=True):
        for latitude in latitudes:
            outward = np.cos(latitude) * circle + np.sin(latitude) * axis
            points.append(centre + radius * outward)
    # X are the points of all circles, one circle after the other.
    X = np.vstack(points)

    number = np.arange(len(X), dtype=np.int32).reshape(2 * CIRCLES, CIRCLE_POINTS)
    following = np.roll(number, -1, axis=1)
    lines = []
    # The last circle before the start and the first one after the end are those of the mantle.
    for k in (CIRCLES - 1, CIRCLES):
        lines.append(np.column_stack([number[k], following[k]]))
    for meridian in number[:, :: CIRCLE_POINTS // MERIDIANS].T:
        lines.append(np.column_stack([meridian[:-1], meridian[1:]]))
    if inside:
        return X, NO_TRIANGLES, np.vstack(lines)

    # Two triangles for each field between two circles.
    a = number[:-1].ravel()
    b = following[:-1].ravel()
    c = following[1:].ravel()
    d = number[1:].ravel()
    first = np.column_stack([a, b, c])
    second = np.column_stack([a, c, d])
    return X, np.vstack([first, second]), np.vstack(lines)
