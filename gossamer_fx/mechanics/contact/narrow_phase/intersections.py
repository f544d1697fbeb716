"""Edges that intersect triangles, decided exactly.

The sign of a volume says on which side of a plane a point lies.  Layers that are pressed together
lie on each other to round-off, where double precision may give any sign; there the volume is
computed in fractions.  An edge that only touches a triangle does not intersect it.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np

from gossamer_fx.core.forms.c_source import check_indices
from gossamer_fx.mechanics.contact.arrays import Array, ByteArray, Int32Array
from gossamer_fx.mechanics.contact.broad_phase.box_tree import BoxTree
from gossamer_fx.mechanics.contact.geometry.collision_primitives import CollisionPrimitives
from gossamer_fx.mechanics.contact.kernels.library import library

# Of `enum intersection` in kernels/contact.h.
INTERSECTS = 1
UNSURE = 2


def find_intersections(
    surface: CollisionPrimitives, x: Array, edges: Int32Array | None = None
) -> Int32Array:
    """Return the pairs of an edge and a triangle that intersect and are not connected. Signs that
    round-off makes uncertain are computed again in exact fractions. `edges`: numbers (q,) of the
    edges that are asked for; None: all. Returns numbers (k, 2) of edge and triangle; empty if
    nothing intersects."""
    if edges is None:
        edges = np.arange(len(surface.edges), dtype=np.int32)
    if not len(edges) or not len(surface.triangles):
        return np.zeros((0, 2), dtype=np.int32)
    x = np.ascontiguousarray(x)
    tree = BoxTree(surface.filtered(surface.triangles, x, x))
    near = tree.overlaps(surface.filtered(surface.edges, x, x), edges)
    found = _floating_point_answers(surface, x, near)
    # Fractions are slow, and rarely needed: only where the sign is within round-off.
    for row in np.flatnonzero(found == UNSURE):
        edge, triangle = near[row]
        found[row] = intersects_exactly(x[surface.edges[edge]], x[surface.triangles[triangle]])
    return near[found == INTERSECTS]


def _floating_point_answers(surface: CollisionPrimitives, x: Array, near: Int32Array) -> ByteArray:
    """Return for pairs of edges and triangles whether they intersect, as far as doubles can decide.
    `near`: numbers (k, 2) of edge and triangle. Returns (k,): 0, `INTERSECTS`, or `UNSURE` where a
    sign is within round-off."""
    # The compiled C library of contact, which checks the arrays that it gets
    c = library()
    check_indices("The points of edges", surface.edges, len(x))
    check_indices("The points of triangles", surface.triangles, len(x))
    count = len(near)
    edge_count = len(surface.edges)
    triangle_count = len(surface.triangles)
    candidates = c.struct(
        "edge_triangle_pairs",
        {
            "count": count,
            "pairs": c.array("pairs", near, "int32", (count, 2)),
            "edges": c.array("edges", surface.edges, "int32", (edge_count, 2)),
            "triangles": c.array("triangles", surface.triangles, "int32", (triangle_count, 3)),
            "x": c.array("x", x, "float64", (len(x), 3)),
        },
    )
    found: ByteArray = np.empty(count, dtype=np.uint8)
    answers = c.array("found", found, "uint8", (count,), writable=True)
    c.lib.find_intersections(candidates.pointer, answers)
    return found


def intersects_exactly(ends: Array, corners: Array) -> bool:
    """Return whether an edge intersects a triangle, decided in exact fractions. An edge that only
    touches the triangle does not intersect it. `ends`: of the edge (2, 3) [m]; `corners`: of the
    triangle (3, 3) [m]."""
    below = sign_of_volume(np.vstack([corners, ends[:1]]))
    above = sign_of_volume(np.vstack([corners, ends[1:]]))
    # Both ends are on one side of the plane, or one end is on it.
    if below * above >= 0:
        return False
    # The line of the edge passes through the triangle if it turns the same way about all three
    # sides.
    around = [corners[0], corners[1], corners[2], corners[0]]
    turns = {sign_of_volume(np.vstack([ends, side])) for side in pairwise(around)}
    return len(turns) == 1 and 0 not in turns


def sign_of_volume(corners: Array) -> int:
    """Return the exact sign, -1, 0 or 1, of the volume (b - a) × (c - a) · (d - a). `corners`: the
    points a, b, c, d as rows (4, 3), finite numbers."""
    rows = [[Fraction(float(value)) for value in corner] for corner in corners]
    origin = rows[0]
    # u, v and w are the exact edge vectors b - a, c - a and d - a.
    u = _difference(rows[1], origin)
    v = _difference(rows[2], origin)
    w = _difference(rows[3], origin)
    volume = (
        u[0] * (v[1] * w[2] - w[1] * v[2])
        - v[0] * (u[1] * w[2] - w[1] * u[2])
        + w[0] * (u[1] * v[2] - v[1] * u[2])
    )
    return (volume > 0) - (volume < 0)


def _difference(a: list[Fraction], b: list[Fraction]) -> list[Fraction]:
    return [first - second for first, second in zip(a, b, strict=True)]
