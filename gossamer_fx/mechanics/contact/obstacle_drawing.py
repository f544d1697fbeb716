"""Surfaces of obstacles for pictures: points, triangles and lines."""

from __future__ import annotations

import numpy as np

from gossamer_fx.core.algebra.rotations import perpendicular_pair
from gossamer_fx.core.model.body import Array, Indices

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
    """Return a square grid of lines on a plane. `point`: of the plane, (3,) [m]; `normal`: unit
    vector (3,); `near`: points (n, 3) [m], in the middle of which the grid is drawn. Returns ends
    of the lines (k, 3) [m], no triangles, and the lines (l, 2) as indices of these points."""
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
