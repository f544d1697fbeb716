"""Primitives that may touch: points, edges and triangles between the points of a contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gossamer_fx.mechanics.contact.arrays import Array, ByteArray, Int32Array

# The three sides of a triangle by its corners.
TRIANGLE_SIDES = [[0, 1], [1, 2], [0, 2]]


@dataclass(frozen=True)
class FilteredPrimitives:
    """n primitives of one kind as the broad phase sees them.

    Attributes:
        boxes: least and greatest coordinates (n, 6) [m].
        labels: numbers (n, l); two primitives with one in common are connected, and no pair.
        is_fixed: 1 where contact moves none of its points (n,); two such primitives never form a
            pair.
    """

    boxes: Array
    labels: Int32Array
    is_fixed: ByteArray


@dataclass(frozen=True)
class CollisionPrimitives:
    """Points, edges and triangles that may touch, as numbers of points.

    Attributes:
        vertices: points (p,) that may touch triangles.
        edges: (e, 2).
        triangles: (t, 3).
        is_fixed: 1 for points (m,) that contact does not move, those of obstacles.
        labels: numbers (m, w) of what points are connected to, see `geometry.collision_filter`;
            None: points are connected to nothing but the primitives that they are corners of.
    """

    vertices: Int32Array
    edges: Int32Array
    triangles: Int32Array
    is_fixed: ByteArray
    labels: Int32Array | None = None

    def filtered(self, primitives: Int32Array, lower: Array, upper: Array) -> FilteredPrimitives:
        """Return vertices, edges or triangles with their boxes and with what forms no pairs with
        them. `primitives`: points of vertices (n, 1), edges (n, 2) or triangles (n, 3), as numbers
        of points. Returns the primitives with the boxes (n, 6) [m] of their points, with their
        labels, of which connected primitives share one, and fixed where all of their points are."""
        least = lower[primitives].min(axis=1)
        greatest = upper[primitives].max(axis=1)
        boxes = np.ascontiguousarray(np.hstack([least, greatest]))
        is_fixed: ByteArray = np.asarray(self.is_fixed[primitives].all(axis=1), dtype=np.uint8)
        return FilteredPrimitives(boxes, self._labels_of(primitives), is_fixed)

    def _labels_of(self, primitives: Int32Array) -> Int32Array:
        """Return the labels (n, l) of vertices, edges or triangles: those of all their points. Two
        primitives with a label in common are connected and form no pair. `primitives`: numbers (n,
        k) of their points, which are the labels if nothing is tied."""
        if self.labels is None:
            return np.ascontiguousarray(primitives)
        count = primitives.shape[1] * self.labels.shape[1]
        return np.ascontiguousarray(self.labels[primitives].reshape(len(primitives), count))
