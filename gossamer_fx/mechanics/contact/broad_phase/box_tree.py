"""A binary tree of boxes, in which all boxes that overlap with a given one are found in logarithmic
time: pairs of a point and a triangle, or of two edges, that can come near.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gossamer_fx.core.forms.c_source import CStruct, check_indices
from gossamer_fx.mechanics.contact.contract import Array, ByteArray, Int32Array
from gossamer_fx.mechanics.contact.geometry.facets import (
    CollisionPrimitives,
    FilteredPrimitives,
)
from gossamer_fx.mechanics.contact.kernels.library import library
from gossamer_fx.mechanics.contact.pairs import EdgeEdge, PairTable, PointTriangle

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
        `primitives`: n vertices, edges or triangles with their boxes (n, 6): least, then greatest
        coordinates [m]."""
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
        whose boxes overlap: numbers (k, 2) of the primitive in `others` and of that in the tree.

        Primitives with a label in common, which are connected, and those that are both fixed form
        no pair.  `which`: numbers (q,) of those in `others` that are asked for; `in_tree`: whether
        `others` are the primitives of the tree, so that pairs (i, j) have i < j; `expected`: how
        many pairs are likely, 0: not known; `near`: which of them to keep, None: all.
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
            # Not all were written: search again with as much room as they need.
            room = int(found)


def _query(primitives: FilteredPrimitives, which: Int32Array, in_tree: bool) -> CStruct:
    """Return the C structure of those primitives, given by their numbers `which` (q,), whose
    overlaps are asked for; `in_tree` as in `BoxTree.overlaps`."""
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
    `primitives`: n primitives, with labels (n, w), of which connected ones share one, and with a
    mark (n,) of those that contact does not move."""
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
    """Return the numbers (n,) of boxes (n, 6) in their order along a Morton curve, on which
    neighbours in space follow each other; boxes with the same code stay in the given order."""
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


@dataclass(frozen=True, eq=False)
class OverlappingPairs(PairTable):
    """n pairs whose boxes overlap.

    Attributes:
        primitives: numbers (n, 2) of the two primitives of each pair: vertex and triangle, or two
            edges.
    """

    primitives: Int32Array


@dataclass(frozen=True)
class Nearness:
    """Which pairs of overlapping boxes can come near: their gap, less what they can come closer, is
    below a distance.

    In packed layers that is one pair in three to six, so that it is asked while boxes are compared.

    Attributes:
        x0: points (m, 3) [m] at the start.
        x1: points (m, 3) [m] at the end of a straight motion.
        margin: distances (m,) [m] from it within which points may be.
        radius: of the body at each point (m,) [m].
        distance: gap [m] below which a pair is near.
    """

    x0: Array
    x1: Array
    margin: Array
    radius: Array
    distance: float

    def of(self, kind: int, asked: Int32Array, in_tree: Int32Array) -> CStruct:
        """Return the C structure for pairs of one kind, the number of a stencil.  `asked`: points
        (p, 1) or (p, 2) of the primitives that are asked for; `in_tree`: points (q, 3) or (q, 2) of
        those in the tree."""
        c = library()
        points = len(self.x0)
        check_indices("The points of primitives", asked, points)
        check_indices("The points of primitives", in_tree, points)
        return c.struct(
            "nearness",
            {
                "kind": kind,
                "query_points": c.array("asked", asked, "int32", asked.shape),
                "tree_points": c.array("in_tree", in_tree, "int32", in_tree.shape),
                "x0": c.array("x0", self.x0, "float64", (points, 3)),
                "x1": c.array("x1", self.x1, "float64", (points, 3)),
                "margin": c.array("margin", self.margin, "float64", (points,)),
                "radius": c.array("radius", self.radius, "float64", (points,)),
                "distance": self.distance,
            },
        )


def _nearness(
    near: Nearness | None, kind: int, asked: Int32Array, in_tree: Int32Array
) -> CStruct | None:
    """What C takes of a nearness for pairs of a kind; None where all overlaps are kept."""
    if near is None:
        return None
    return near.of(kind, asked, in_tree)


def find_overlaps(
    surface: CollisionPrimitives,
    lower: Array,
    upper: Array,
    vertices: Int32Array,
    edges: Int32Array,
    expected: tuple[int, int] = (0, 0),
    near: Nearness | None = None,
) -> OverlappingPairs:
    """Return all pairs of vertex and triangle, or of two edges, whose boxes overlap and that may
    touch.

    Pairs that are connected, by a shared point, a tie or a joint, are left out.  `lower` and
    `upper` (m, 3) [m] are the corners of a box round each point, `vertices` and `edges` the numbers
    of those that this rank asks for, `expected` how many pairs of both kinds are likely (zero: not
    known), and `near` selects pairs among the overlapping ones (None: all).
    """
    vertex_points = np.ascontiguousarray(surface.vertices[:, None])
    with_triangles: Int32Array = np.zeros((0, 2), dtype=np.int32)
    # Cables and beams have edges only.
    if len(surface.triangles):
        # The tree is built over the triangles, which are asked by fewer points.
        tree = BoxTree(surface.filtered(surface.triangles, lower, upper))
        with_triangles = tree.overlaps(
            surface.filtered(vertex_points, lower, upper),
            vertices,
            expected=expected[0],
            near=_nearness(near, PointTriangle.number, vertex_points, surface.triangles),
        )
    all_edges = surface.filtered(surface.edges, lower, upper)
    with_edges = BoxTree(all_edges).overlaps(
        all_edges,
        edges,
        in_tree=True,
        expected=expected[1],
        near=_nearness(near, EdgeEdge.number, surface.edges, surface.edges),
    )

    counts = [len(with_triangles), len(with_edges)]
    points: Int32Array = np.empty((sum(counts), 4), dtype=np.int32)
    of_triangles, of_edges = np.split(points, counts[:1])
    of_triangles[:, 0] = surface.vertices[with_triangles[:, 0]]
    of_triangles[:, 1:] = surface.triangles[with_triangles[:, 1]]
    of_edges[:, :2] = surface.edges[with_edges[:, 0]]
    of_edges[:, 2:] = surface.edges[with_edges[:, 1]]
    kinds = np.array([PointTriangle.number, EdgeEdge.number], dtype=np.uint8)
    kind: ByteArray = np.repeat(kinds, counts)
    return OverlappingPairs(
        kind=kind,
        points=points,
        primitives=np.vstack([with_triangles, with_edges]),
    )
