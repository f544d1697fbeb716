"""Edges that pierce triangles, exactly: signs of volumes that double precision does not tell are taken in fractions.

Layers that are pressed shut lie on each other to round-off, and would else seem to pierce one another.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from gossamer_fx.contact.broad_phase.box_tree import BoxTree, CollisionPrimitives, boxes_of
from gossamer_fx.contact.kernels.library import Array, Bytes, Integers, library, pointers

YES, UNSURE = 1, 2  # of piercing.c


def intersections(
    surface: CollisionPrimitives, x: Array, edges: Integers | None = None
) -> Integers:
    """Pairs (k, 2) of edges and triangles of which one pierces the other, without a common place.

    An edge that only touches a triangle does not pierce it.

    Args:
        x: points (m, 3).
        edges: which of the edges are asked for; none: all.
    """
    lines, triangles = surface.edges, surface.triangles
    query = np.arange(len(lines), dtype=np.int32) if edges is None else edges
    if not (len(query) and len(triangles)):
        return np.zeros((0, 2), dtype=np.int32)
    tree, boxes = BoxTree(boxes_of(x, x, triangles)), np.ascontiguousarray(boxes_of(x, x, lines))
    fixed = surface.all_fixed(lines), surface.all_fixed(triangles)
    near = tree.overlapping(query, boxes, surface.where(lines), surface.where(triangles), fixed)
    found: Bytes = np.empty(len(near), dtype=np.uint8)
    x = np.ascontiguousarray(x)
    library().lib.pierced(len(near), *pointers(near, lines, triangles, x, found))
    for i in np.flatnonzero(found == UNSURE):
        found[i] = _pierces_exactly(x[lines[near[i, 0]]], x[triangles[near[i, 1]]])
    return near[found == YES]


def _pierces_exactly(ends: Array, corners: Array) -> bool:
    """Whether the edge between two points (2, 3) pierces the triangle (3, 3)."""
    p, q = ends
    below, above = (_exact_sign(np.vstack([corners, end])) for end in ends)
    turns = {_exact_sign(np.array([p, q, corners[k], corners[(k + 1) % 3]])) for k in range(3)}
    return below * above < 0 and len(turns) == 1 and 0 not in turns


def _exact_sign(corners: Array) -> int:
    """Sign of the volume (b - a) × (c - a) · (d - a) of points (4, 3)."""
    origin, *others = ([Fraction(float(value)) for value in corner] for corner in corners)
    (a, b, c), (d, e, f), (g, h, i) = (
        [p - o for p, o in zip(other, origin, strict=True)] for other in others
    )
    volume = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return (volume > 0) - (volume < 0)
