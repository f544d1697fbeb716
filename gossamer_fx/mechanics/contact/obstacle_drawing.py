"""Obstacles as solids for pictures: points, triangles and lines."""

from __future__ import annotations

from itertools import product

import numpy as np

from gossamer_fx.core.algebra.rotations import perpendicular_pair
from gossamer_fx.core.drawing import Solid
from gossamer_fx.core.model.body import Array, Indices, unit
from gossamer_fx.mechanics.contact.obstacles import (
    AXIS_BITS,
    Box,
    Cylinder,
    Obstacle,
    Plane,
    Sphere,
)

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

# The faces of a box by the numbers of its corners, in the order around each face.
BOX_FACES = [
    (0, 1, 3, 2),
    (4, 6, 7, 5),
    (0, 4, 5, 1),
    (2, 3, 7, 6),
    (0, 2, 6, 4),
    (1, 5, 7, 3),
]

NO_TRIANGLES: Indices = np.zeros((0, 3), dtype=np.int32)

DrawnSurface = tuple[Array, Indices, Indices]  # points (n, 3), triangles (t, 3), lines (l, 2)


def solid_of(obstacle: Obstacle, near: Array) -> Solid | None:
    """Return an obstacle as a solid to draw; None for a kind without a picture.

    Rooms and planes have lines but no triangles, which would hide what is in or behind them.

    Args:
        obstacle: what is drawn, in its position at the start; its directions have a length, which
            the contact has checked.
        near: points (n, 3) [m], n ≥ 1, where a plane is drawn, which has no end.
    """
    surface = _surface_of(obstacle, near)
    if surface is None:
        return None
    # X (k, 3) [m] are the points that triangles and lines connect.
    X, triangles, lines = surface
    if obstacle.body is not None:
        # Points of a rigid body are given by their components along its directors.
        X = np.array([obstacle.body.port_at(x).weights[1:] for x in X])
    return Solid(
        obstacle.name,
        X,
        triangles,
        lines,
        obstacle.body,
        obstacle.motion,
    )


def _surface_of(obstacle: Obstacle, near: Array) -> DrawnSurface | None:
    """Return the surface of an obstacle in its initial position.

    Args:
        near: points (n, 3) [m], in whose middle a plane is drawn.

    Returns:
        points (n, 3) [m], triangles (t, 3) and lines (l, 2) as indices of points; None for a kind
        without a picture.
    """
    if isinstance(obstacle, Plane):
        point = np.asarray(obstacle.point, dtype=float)
        return _grid(point, unit(obstacle.normal), near)
    if isinstance(obstacle, Box):
        return _box(obstacle)
    if isinstance(obstacle, Sphere):
        centre = np.asarray(obstacle.centre, dtype=float)
        # A ball is a capsule without length; any axis will do.
        upwards = np.array([0.0, 0.0, 1.0])
        return _capsule(centre, centre, upwards, obstacle.radius, obstacle.inside)
    if isinstance(obstacle, Cylinder):
        start = np.asarray(obstacle.start, dtype=float)
        end = np.asarray(obstacle.end, dtype=float)
        return _capsule(start, end, unit(end - start), obstacle.radius, obstacle.inside)
    return None


def _grid(point: Array, normal: Array, near: Array) -> DrawnSurface:
    """Return a square grid of lines on a plane.

    Args:
        point: of the plane, (3,) [m].
        normal: unit vector (3,).
        near: points (n, 3) [m], in the middle of which the grid is drawn.

    Returns:
        ends of the lines (k, 3) [m], no triangles, and the lines (l, 2) as indices of these points.
    """
    middle = (near.max(axis=0) + near.min(axis=0)) / 2
    # Projected onto the plane.
    middle = middle - (middle - point) @ normal * normal
    half = GRID_SIZE * float(np.ptp(near, axis=0).max()) / 2
    # Unit directions of both families of lines, within the plane
    u, v = perpendicular_pair(normal)
    ends = []
    for position in np.linspace(-half, half, GRID_FIELDS + 1):
        for across, along in ((u, v), (v, u)):
            start = position * across - half * along
            end = position * across + half * along
            ends.append([start, end])
    # X are the ends of all lines.
    X = middle + np.concatenate(ends)
    lines = np.arange(len(X), dtype=np.int32).reshape(len(ends), 2)
    return X, NO_TRIANGLES, lines


def _box(box: Box) -> DrawnSurface:
    """Return the surface of a box: its edges and, unless it is a room, its faces.

    Returns:
        the 8 corners (8, 3) [m]; 12 triangles (12, 3), or none for a room; 12 edges (12, 2).  The
        last two are indices of corners.
    """
    axes = np.asarray(box.axes, dtype=float)
    half = np.asarray(box.sizes, dtype=float) / 2
    signs = np.array(list(product((-1, 1), repeat=3)))
    # X are the corners; a, b, c, d below number those of a face.
    X = np.asarray(box.centre, dtype=float) + signs * half @ axes
    # The number of a corner has a bit for each axis; two corners of an edge differ in one bit.
    lines = []
    for corner in range(8):
        for bit in AXIS_BITS:
            if not corner & bit:
                lines.append((corner, corner | bit))
    faces = NO_TRIANGLES
    if not box.inside:
        triangles = []
        for a, b, c, d in BOX_FACES:
            triangles += [(a, b, c), (a, c, d)]
        faces = np.array(triangles, dtype=np.int32)
    return X, faces, np.array(lines, dtype=np.int32)


def _capsule(
    start: Array,
    end: Array,
    axis: Array,
    radius: float,
    inside: bool,
) -> DrawnSurface:
    """Return a ball, or a cylinder with half a ball at each end.

    Its lines are the circles around both ends, and `MERIDIANS` lines along it.

    Args:
        start: centre of one end, (3,) [m].
        end: centre of the other end, (3,) [m].
        axis: unit vector from start to end, (3,).
        radius: [m].

    Returns:
        points (n, 3) [m] on its circles; triangles (t, 3) and lines (l, 2) as indices of points.
    """
    angles = np.linspace(0, 2 * np.pi, CIRCLE_POINTS, endpoint=False)
    # Unit vectors u and v across the axis, orthogonal to each other
    u, v = perpendicular_pair(axis)
    circle = np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v)
    # Circles from the pole behind the start to the pole beyond the end, by their latitude.
    latitudes = np.linspace(0, np.pi / 2, CIRCLES)
    circles = [(start, -latitude) for latitude in latitudes[::-1]]
    circles += [(end, latitude) for latitude in latitudes]
    points = []
    for centre, latitude in circles:
        outward = np.cos(latitude) * circle + np.sin(latitude) * axis
        points.append(centre + radius * outward)
    # X are the points of all circles, one circle after the other.
    X = np.vstack(points)

    number = np.arange(len(X), dtype=np.int32).reshape(len(circles), CIRCLE_POINTS)
    following = np.roll(number, -1, axis=1)
    lines = []
    # The last circle before the start and the first one after the end are those of latitude zero.
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
