"""Edges that pierce triangles, exactly: signs of volumes that double precision does not tell are taken in fractions.

Layers that are pressed shut lie on each other to round-off, and would else seem to pierce one another.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from gossamer_fx.contact.kernel import Array, Integers
from gossamer_fx.contact.search import Surface, Tree, boxes_of

ROUND_OFF = 1e-14  # error of a volume in double precision, over the sum of its terms' sizes


def intersections(surface: Surface, x: Array, edges: Integers | None = None) -> Integers:
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
    tree, boxes = Tree(boxes_of(x, x, triangles)), np.ascontiguousarray(boxes_of(x, x, lines))
    fixed = surface.all_fixed(lines), surface.all_fixed(triangles)
    near = tree.overlapping(query, boxes, surface.where(lines), surface.where(triangles), fixed)
    (p, q), (a, b, c) = lines[near[:, 0]].T, triangles[near[:, 1]].T
    sizes = np.abs(x).max(axis=1)
    sides = _signs(x, sizes, a, b, c, p) * _signs(x, sizes, a, b, c, q) < 0
    near, p, q, a, b, c = (part[sides] for part in (near, p, q, a, b, c))
    u, v, w = (_signs(x, sizes, p, q, *side) for side in ((a, b), (b, c), (c, a)))
    return near[(u == v) & (v == w) & (u != 0)]


def _signs(x: Array, sizes: Array, a: Integers, b: Integers, c: Integers, d: Integers) -> Integers:
    """Signs (n,) of the volumes (b - a) × (c - a) · (d - a) of points, whose largest coordinates are `sizes`; exact."""
    u, v, w = x[b] - x[a], x[c] - x[a], x[d] - x[a]
    volume = np.einsum("ni,ni->n", np.cross(u, v), w)
    of_a = sizes[a]
    unsure = np.flatnonzero(np.abs(volume) <= 6 * ROUND_OFF * (sizes[b] + of_a) * (sizes[c] + of_a) * (sizes[d] + of_a))
    sign = np.sign(volume).astype(np.int32)
    for i in unsure:
        sign[i] = _exact_sign(x[[a[i], b[i], c[i], d[i]]])
    return sign


def _exact_sign(corners: Array) -> int:
    origin, *others = ([Fraction(float(value)) for value in corner] for corner in corners)
    (a, b, c), (d, e, f), (g, h, i) = ([p - o for p, o in zip(other, origin, strict=True)] for other in others)
    volume = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    return (volume > 0) - (volume < 0)
