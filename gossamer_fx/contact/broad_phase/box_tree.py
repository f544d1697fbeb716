"""Search for pairs that may come near, motion check, and intersections, of points, edges and triangles.

Boxes of primitives are put into a binary tree in Morton order; boxes that overlap give the candidates.  Each point has
a box of its own that holds its way and a margin: as long as all points stay in theirs, less half of the reach, no pair
that was not found can be within the reach.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gossamer_fx.contact.kernels.library import Array, Bytes, Integers, library, pointers
from gossamer_fx.contact.potential import EDGE_EDGE, POINT_TRIANGLE

CHECKS = 1000  # positions on its way at which a distance is computed at most: a turn is a long way for a near pair


@dataclass(frozen=True)
class CollisionPrimitives:
    """Primitives between points: `vertices` (p,) and `edges` (e, 2), `triangles` (t, 3), as indices of points.

    fixed (m,): points that are not moved by contact; primitives of such points alone are no pair.
    places (m, w): numbers of places at which points are, if not each is at its own; see `contact.joined`.
    """

    vertices: Integers
    edges: Integers
    triangles: Integers
    fixed: Bytes
    places: Integers | None = None

    def where(self, primitives: Integers) -> Integers:
        """Places (n, l) of primitives (n, k); those with one in common hang together, and are no pair."""
        if self.places is None:
            return primitives
        size = primitives.shape[1] * self.places.shape[1]
        return np.ascontiguousarray(self.places[primitives].reshape(len(primitives), size))

    def all_fixed(self, primitives: Integers) -> Bytes:
        return np.ascontiguousarray(
            self.fixed[primitives.reshape(len(primitives), primitives[:1].size or 1)].all(axis=1),
            dtype=np.uint8,
        )


def boxes_of(lo: Array, hi: Array, primitives: Integers) -> Array:
    """Boxes (n, 6) of primitives (n, k) from those of their points."""
    return np.hstack([lo[primitives].min(axis=1), hi[primitives].max(axis=1)])


class BoxTree:
    """A binary tree of boxes (n, 6)."""

    def __init__(self, boxes: Array) -> None:
        n = len(boxes)
        self.n, self.size = n, 1 << max(int(np.ceil(np.log2(max(n, 1)))), 0)
        self.order = morton(boxes)
        self.boxes = np.empty((2 * self.size, 6))
        library().lib.build_tree(
            n,
            self.size,
            *pointers(np.ascontiguousarray(boxes)),
            *pointers(self.order),
            *pointers(self.boxes),
        )

    def overlapping(
        self,
        query: Integers,
        boxes: Array,
        of_queries: Integers,
        of_tree: Integers,
        fixed: tuple[Bytes, Bytes],
        same: bool = False,
    ) -> Integers:
        """Pairs (k, 2) of queried boxes and those of the tree that overlap, without a common place.

        Args:
            query: which of `boxes` are asked for.
            of_queries, of_tree: the places of the primitives, see `CollisionPrimitives.where`.
            same: whether both are one set, of which i < j are taken.
        """
        room = 8 * len(query) + 64
        while True:
            pairs: Integers = np.empty((room, 2), dtype=np.int32)
            found = library().lib.overlaps(
                self.n,
                self.size,
                *pointers(self.boxes),
                *pointers(self.order),
                len(query),
                *pointers(query, boxes),
                same,
                of_queries.shape[1],
                *pointers(of_queries),
                of_tree.shape[1],
                *pointers(of_tree, *fixed),
                room,
                *pointers(pairs),
            )
            if found <= room:
                return pairs[:found]
            room = int(found)


def morton(boxes: Array) -> Integers:
    """The order of boxes (n, 6) along a curve that fills space, 21 bits for each axis."""
    if not len(boxes):
        return np.zeros(0, dtype=np.int32)
    middle = (boxes[:, :3] + boxes[:, 3:]) / 2
    middle -= middle.min(axis=0)
    code = (middle / (middle.max() or 1.0) * (2**21 - 1)).astype(np.uint64)
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        code = (code | (code << np.uint64(shift))) & np.uint64(mask)
    return np.argsort(code @ np.array([1, 2, 4], dtype=np.uint64), kind="stable").astype(np.int32)


def candidates(
    surface: CollisionPrimitives, lo: Array, hi: Array, vertices: Integers, edges: Integers
) -> tuple[Integers, Bytes, np.ndarray]:
    """Pairs of primitives whose boxes overlap: points (n, 4), kind (n,), and numbers (n, 2) of the primitives.

    Args:
        lo, hi: boxes (m, 3) of the points.
        vertices, edges: which of the surface's are asked for (each rank asks for its own).
    """
    triangles, lines = surface.triangles, surface.edges
    points = surface.vertices[:, None]
    near: Integers = np.zeros((0, 2), dtype=np.int32)
    if len(triangles):
        tree = BoxTree(boxes_of(lo, hi, triangles))
        boxes = np.ascontiguousarray(boxes_of(lo, hi, points))
        fixed = surface.all_fixed(points), surface.all_fixed(triangles)
        at = surface.where(np.ascontiguousarray(points)), surface.where(triangles)
        near = tree.overlapping(vertices, boxes, *at, fixed)
    boxes = np.ascontiguousarray(boxes_of(lo, hi, lines)) if len(lines) else np.zeros((0, 6))
    fixed = surface.all_fixed(lines), surface.all_fixed(lines)
    of_lines = surface.where(lines)
    across = BoxTree(boxes).overlapping(edges, boxes, of_lines, of_lines, fixed, same=True)
    nodes = np.vstack(
        [
            np.hstack([points[near[:, 0]], triangles[near[:, 1]]]).reshape(-1, 4),
            np.hstack([lines[across[:, 0]], lines[across[:, 1]]]).reshape(-1, 4),
        ]
    )
    kind = np.repeat(
        np.array([POINT_TRIANGLE, EDGE_EDGE], dtype=np.uint8), [len(near), len(across)]
    )
    return (
        np.ascontiguousarray(nodes, dtype=np.int32),
        kind,
        np.vstack([near, across]).astype(np.int64),
    )


def refused(
    nodes: Integers,
    kind: Bytes,
    x0: Array,
    x1: Array,
    radius: Array,
    gap: Array,
    least: Array,
) -> np.ndarray:
    """Indices of the pairs that come nearer than their least distance, or may, on the straight way to x1.

    gap, least: distances (n,) [m] at x0, and to be kept on the way, less the radii.

    Additive continuous collision detection (Li, Kaufman & Jiang, ACM Trans. Graph. 40 (2021) 170, section 4).
    """
    free = np.empty(len(kind), dtype=np.uint8)
    arguments = pointers(nodes, kind, x0, x1, radius, gap, least)
    library().lib.motion(len(kind), *arguments, CHECKS, *pointers(free))
    return np.flatnonzero(free == 0)
