"""Obstacles as pictures show them."""

from __future__ import annotations

from itertools import product

import numpy as np

from gossamer_fx.algebra.rotations import perpendicular_pair
from gossamer_fx.contact.obstacles import AXIS_BITS, Box, Cylinder, Obstacle, Plane, Sphere
from gossamer_fx.drawing.solids import Solid
from gossamer_fx.model.body import Array, Indices
from gossamer_fx.model.ports import unit

# Points of each circle of a ball or cylinder, and circles from its equator to a pole.
CIRCLE_POINTS = 32
CIRCLES = 9

# A plane is drawn as a square grid with so many fields along each side, a little larger than what it is for.
GRID_FIELDS = 6
GRID_SIZE = 1.2

# The faces of a box by the numbers of its corners, in the order around each face.
BOX_FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]

NO_TRIANGLES: Indices = np.zeros((0, 3), dtype=np.int32)

DrawnSurface = tuple[Array, Indices, Indices]  # points (n, 3), triangles (t, 3), lines (l, 2)


def solid_of(obstacle: Obstacle, near: Array) -> Solid | None:
    """Return an obstacle as a solid to draw; None for a kind without a picture.

    Rooms and planes have lines but no triangles, which would hide what is in or behind them.

    Args:
        obstacle: what is drawn.
        near: points (n, 3) [m] where a plane is drawn, which has no end.
    """
    surface = _surface_of(obstacle, near)
    if surface is None:
        return None
    X, triangles, lines = surface
    if obstacle.body is not None:
        # Of a part of a rigid body, points count along the directors of the body.
        X = np.array([obstacle.body.port_at(x).weights[1:] for x in X])
    return Solid(obstacle.name, X, triangles, lines, obstacle.body, obstacle.motion)


def _surface_of(obstacle: Obstacle, near: Array) -> DrawnSurface | None:
    if isinstance(obstacle, Plane):
        return _grid(np.asarray(obstacle.point, dtype=float), unit(obstacle.normal), near)
    if isinstance(obstacle, Box):
        return _box(obstacle)
    if isinstance(obstacle, Sphere):
        centre = np.asarray(obstacle.centre, dtype=float)
        upwards = np.array([0.0, 0.0, 1.0])
        return _capsule(centre, centre, upwards, obstacle.radius, obstacle.inside)
    if isinstance(obstacle, Cylinder):
        start = np.asarray(obstacle.start, dtype=float)
        end = np.asarray(obstacle.end, dtype=float)
        return _capsule(start, end, unit(end - start), obstacle.radius, obstacle.inside)
    return None


def _grid(point: Array, normal: Array, near: Array) -> DrawnSurface:
    """Return lines on a plane where the points near (n, 3) are."""
    middle = (near.max(axis=0) + near.min(axis=0)) / 2
    middle = middle - (middle - point) @ normal * normal
    half = GRID_SIZE * float(np.ptp(near, axis=0).max()) / 2
    u, v = perpendicular_pair(normal)
    positions = np.linspace(-half, half, GRID_FIELDS + 1)[:, None]
    ends = [
        [position * across - half * along, position * across + half * along]
        for position, (across, along) in product(positions, ((u, v), (v, u)))
    ]
    X = middle + np.concatenate(ends)
    lines = np.arange(len(X), dtype=np.int32).reshape(len(ends), 2)
    return X, NO_TRIANGLES, lines


def _box(box: Box) -> DrawnSurface:
    axes = np.asarray(box.axes, dtype=float)
    half = np.asarray(box.sizes, dtype=float) / 2
    signs = np.array(list(product((-1, 1), repeat=3)))
    X = np.asarray(box.centre, dtype=float) + signs * half @ axes
    lines = [(corner, corner | bit) for corner in range(8) for bit in AXIS_BITS if not corner & bit]
    triangles = []
    for a, b, c, d in BOX_FACES:
        triangles += [(a, b, c), (a, c, d)]
    faces: Indices = NO_TRIANGLES if box.inside else np.array(triangles, dtype=np.int32)
    return X, faces, np.array(lines, dtype=np.int32)


def _capsule(
    start: Array,
    end: Array,
    axis: Array,
    radius: float,
    inside: bool,
) -> DrawnSurface:
    """Return a ball, or a cylinder with half a ball at each end.

    Its lines are the circles around both ends and four lines along it.
    """
    angles = np.linspace(0, 2 * np.pi, CIRCLE_POINTS, endpoint=False)
    u, v = perpendicular_pair(axis)
    circle = np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v)
    # Circles from the pole behind the start to the pole beyond the end, by their latitude.
    latitudes = np.linspace(0, np.pi / 2, CIRCLES)
    circles = [(start, -latitude) for latitude in latitudes[::-1]]
    circles += [(end, latitude) for latitude in latitudes]
    X = np.vstack(
        [
            centre + radius * (np.cos(latitude) * circle + np.sin(latitude) * axis)
            for centre, latitude in circles
        ]
    )
    number = np.arange(len(X), dtype=np.int32).reshape(len(circles), CIRCLE_POINTS)
    following = np.roll(number, -1, axis=1)
    lines = [np.column_stack([number[k], following[k]]) for k in (CIRCLES - 1, CIRCLES)]
    for meridian in number[:, :: CIRCLE_POINTS // 4].T:
        lines.append(np.column_stack([meridian[:-1], meridian[1:]]))
    corners = (number[:-1], following[:-1], following[1:], number[1:])
    a, b, c, d = (part.ravel() for part in corners)
    triangles = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return X, NO_TRIANGLES if inside else triangles, np.vstack(lines)
