"""A binary tree of boxes, in which all boxes that overlap with a given one are found in logarithmic
time."""

from __future__ import annotations

import numpy as np

from gossamer_fx.core.forms.c_source import CStruct
from gossamer_fx.mechanics.contact.arrays import Array, Int32Array
from gossamer_fx.mechanics.contact.geometry.collision_primitives import FilteredPrimitives
from gossamer_fx.mechanics.contact.kernels.library import library

# Overlaps for which there is room at first, for each box that is asked for; a surface has about six
# neighbours a point, and a search with too little room is made once more with enough of it.
EXPECTED_OVERLAPS = 8

# Room over the number of overlaps that the search before has found: layers that are packed have
# many more than a surface, and about as many in the next search.
ROOM_FACTOR = 1.25

# Bits of each axis in a Morton code of 63 bits, and the shifts and masks that spread them out so
# that two zeros follow each bit.
MORTON_BITS = 21
MORTON_SPREADING = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


class BoxTree:
    """A tree over the boxes of n primitives."""

    def __init__(self, primitives: FilteredPrimitives) -> None:
        """Sort the boxes along a Morton curve, and build the tree over them from its leaves.

        Args:
            primitives: n vertices, edges or triangles with their boxes (n, 6): least, then greatest
                coordinates [m].

        Raises:
            ValueError: an array is not contiguous, or not of the type that C takes.
        """
        # The compiled C library of contact, which checks the arrays that it gets
        c = library()
        count = len(primitives.boxes)
        # The tree is complete: its leaves are the next power of two, its root is node 1.
        levels = int(np.ceil(np.log2(max(count, 1))))
        leaf_count = 1 << levels
        # Neighbours in space become neighbours in the tree, so that inner boxes are small.
        order = morton_order(primitives.boxes)
        nodes = np.empty((2 * leaf_count, 6))
        self._primitives = primitives
        self._tree = c.struct(
            "box_tree",
            {
                "box_count": count,
                "leaf_count": leaf_count,
                "order": c.array("order", order, "int32", (count,)),
                "nodes": c.array("nodes", nodes, "float64", (2 * leaf_count, 6), writable=True),
            },
        )
        boxes = c.array("boxes", primitives.boxes, "float64", (count, 6))
        c.lib.build_box_tree(self._tree.pointer, boxes)

    def overlaps(
        self,
        others: FilteredPrimitives,
        which: Int32Array,
        in_tree: bool = False,
        expected: int = 0,
        near: CStruct | None = None,
    ) -> Int32Array:
        """Return the pairs of another primitive (vertex, edge or triangle) and one of the tree
        whose boxes overlap.

        Primitives with a label in common, which are connected, and those that are both fixed form
        no pair.

        Args:
            others: primitives that are asked for.
            which: numbers (q,) of those that are asked for by this rank.
            in_tree: whether they are the primitives of the tree; pairs (i, j) then have i < j.
            expected: number of pairs that are likely; zero: not known.
            near: structure `nearness` of the kernels, by which pairs are left out that cannot come
                near; None: none is.

        Returns:
            numbers (k, 2) of the primitive in `others` and of that in the tree.

        Raises:
            ValueError: an array is not contiguous, or not of the type that C takes.
        """
        # The compiled C library of contact, which checks the arrays that it gets
        c = library()
        query = _query(others, which, in_tree)
        of_query = _filter(others)
        of_tree = _filter(self._primitives)
        near_pointer = c.ffi.NULL
        if near is not None:
            near_pointer = near.pointer
        room = max(EXPECTED_OVERLAPS * len(which) + 64, int(ROOM_FACTOR * expected))
        while True:
            pairs: Int32Array = np.empty((room, 2), dtype=np.int32)
            found = c.lib.find_overlaps(
                self._tree.pointer,
                query.pointer,
                of_query.pointer,
                of_tree.pointer,
                near_pointer,
                room,
                c.array("pairs", pairs, "int32", (room, 2), writable=True),
            )
            if found <= room:
                return pairs[:found]
            room = int(found)


def _query(primitives: FilteredPrimitives, which: Int32Array, in_tree: bool) -> CStruct:
    """Return the C structure of the primitives, vertices, edges or triangles, whose overlaps are
    asked for.

    Args:
        primitives: n primitives with boxes (n, 6) [m].
        which: numbers (q,) of those that are asked for.
    """
    # The compiled C library of contact, which checks the arrays that it gets
    c = library()
    count = len(primitives.boxes)
    return c.struct(
        "box_query",
        {
            "count": len(which),
            "primitive": c.array("which", which, "int32", (len(which),)),
            "boxes": c.array("boxes", primitives.boxes, "float64", (count, 6)),
            "in_tree": in_tree,
        },
    )


def _filter(primitives: FilteredPrimitives) -> CStruct:
    """Return the C structure of what forms no pairs: connected primitives, and two fixed ones.

    Args:
        primitives: n primitives, with labels (n, w), of which connected ones share one, and with a
            mark (n,) of those that contact does not move.
    """
    # The compiled C library of contact, which checks the arrays that it gets
    c = library()
    count, label_count = primitives.labels.shape
    return c.struct(
        "primitive_filter",
        {
            "label_count": label_count,
            "labels": c.array("labels", primitives.labels, "int32", (count, label_count)),
            "is_fixed": c.array("is_fixed", primitives.is_fixed, "uint8", (count,)),
        },
    )


def morton_order(boxes: Array) -> Int32Array:
    """Return the order of boxes along a Morton curve, on which neighbours in space follow each
    other.

    Args:
        boxes: least, then greatest coordinates (n, 6) [m].

    Returns:
        numbers of the boxes (n,) in this order; boxes with the same code stay in theirs.
    """
    if not len(boxes):
        return np.zeros(0, dtype=np.int32)
    middle = (boxes[:, :3] + boxes[:, 3:]) / 2
    middle -= middle.min(axis=0)
    extent = middle.max() or 1.0
    code = (middle / extent * (2**MORTON_BITS - 1)).astype(np.uint64)
    for shift, mask in MORTON_SPREADING:
        code = (code | (code << np.uint64(shift))) & np.uint64(mask)
    interleaved = code @ np.array([1, 2, 4], dtype=np.uint64)
    return np.argsort(interleaved, kind="stable").astype(np.int32)
