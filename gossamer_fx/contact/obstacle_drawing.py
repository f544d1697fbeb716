"""Obstacles as pictures show them."""

from __future__ import annotations

from itertools import product

import numpy as np

from gossamer_fx.algebra.rotations import perpendicular_pair
from gossamer_fx.contact.obstacles import Box, Cylinder, Obstacle, Plane, Sphere
from gossamer_fx.drawing.solids import Solid
from gossamer_fx.model.body import Array, Indices
from gossamer_fx.model.ports import unit

AROUND, RINGS = 32, 9  # points of a circle; circles from the middle of a ball to its pole
FIELDS, SIDE = (
    6,
    1.2,
)  # of the grid that stands for a plane, along each side; its side over the size of what it is for
NONE: Indices = np.zeros((0, 3), dtype=np.int32)
DrawnSurface = tuple[Array, Indices, Indices]  # points, triangles, lines


def solid_of(obstacle: Obstacle, near: Array) -> Solid | None:
    """An obstacle as a solid; none of a kind that is not known.  A plane is drawn where the points near (n, 3) are."""
    found: DrawnSurface
    if isinstance(obstacle, Plane):
        found = _grid(np.asarray(obstacle.point, dtype=float), unit(obstacle.normal), near)
    elif isinstance(obstacle, Box):
        found = _box(obstacle)
    elif isinstance(obstacle, Sphere):
        centre = np.asarray(obstacle.centre, dtype=float)
        found = _round(centre, centre, np.array([0.0, 0.0, 1.0]), obstacle.radius, obstacle.inside)
    elif isinstance(obstacle, Cylinder):
        start, end = np.asarray(obstacle.start, dtype=float), np.asarray(obstacle.end, dtype=float)
        found = _round(start, end, unit(end - start), obstacle.radius, obstacle.inside)
    else:
        return None
    X, triangles, lines = found
    if obstacle.body is not None:
        X = np.array([obstacle.body.port_at(x).weights[1:] for x in X])
    return Solid(obstacle.name, X, triangles, lines, obstacle.body, obstacle.motion)


def _grid(point: Array, normal: Array, near: Array) -> DrawnSurface:
    """Lines on a plane, beside the points near."""
    middle = (near.max(axis=0) + near.min(axis=0)) / 2
    middle = middle - (middle - point) @ normal * normal
    half = SIDE * float(np.ptp(near, axis=0).max()) / 2
    u, v = perpendicular_pair(normal)
    across_grid = np.linspace(-half, half, FIELDS + 1)[:, None]
    ends = [
        [s * p - half * q, s * p + half * q] for s, (p, q) in product(across_grid, ((u, v), (v, u)))
    ]
    X = middle + np.concatenate(ends)
    return X, NONE, np.arange(len(X), dtype=np.int32).reshape(len(ends), 2)


def _box(box: Box) -> DrawnSurface:
    axes, half = np.asarray(box.axes, dtype=float), np.asarray(box.sizes, dtype=float) / 2
    X = (
        np.asarray(box.centre, dtype=float)
        + np.array(list(product((-1, 1), repeat=3))) * half @ axes
    )
    lines = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]
    return (
        X,
        NONE if box.inside else np.array(triangles, dtype=np.int32),
        np.array(lines, dtype=np.int32),
    )


def _round(start: Array, end: Array, axis: Array, radius: float, inside: bool) -> DrawnSurface:
    """A ball, or a cylinder with half a ball at each end; circles around both ends and lines along."""
    angles = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    u, v = perpendicular_pair(axis)
    circle = np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v)
    tilts = np.linspace(0, np.pi / 2, RINGS)
    rings = [(start, -t) for t in tilts[::-1]] + [(end, t) for t in tilts]
    X = np.vstack([at + radius * (np.cos(t) * circle + np.sin(t) * axis) for at, t in rings])
    number = np.arange(len(X), dtype=np.int32).reshape(len(rings), AROUND)
    beside = np.roll(number, -1, axis=1)
    quarters = number[:, :: AROUND // 4]
    lines = [np.column_stack([number[k], beside[k]]) for k in (RINGS - 1, RINGS)]
    lines += [np.column_stack([one[:-1], one[1:]]) for one in quarters.T]
    a, b, c, d = (part.ravel() for part in (number[:-1], beside[:-1], beside[1:], number[1:]))
    triangles = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return X, NONE if inside else triangles, np.vstack(lines)
