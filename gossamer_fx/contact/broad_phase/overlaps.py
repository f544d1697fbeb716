"""Pairs of primitives whose boxes overlap: a point and a triangle, or two edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gossamer_fx.contact.arrays import Array, ByteArray, Int32Array, Int64Array
from gossamer_fx.contact.broad_phase.box_tree import BoxTree
from gossamer_fx.contact.geometry.collision_primitives import CollisionPrimitives
from gossamer_fx.contact.pair_table import PairKind, PairTable


@dataclass
class OverlappingPairs(PairTable):
    """n pairs whose boxes overlap.

    Attributes:
        primitives: numbers (n, 2) of the two primitives of each pair: vertex and triangle, or two
            edges.
    """

    primitives: Int64Array


def find_overlaps(
    surface: CollisionPrimitives,
    lower: Array,
    upper: Array,
    vertices: Int32Array,
    edges: Int32Array,
    expected: tuple[int, int] = (0, 0),
) -> OverlappingPairs:
    """Return all pairs of vertex and triangle, or of two edges, whose boxes overlap and that may
    touch.

    Pairs that are connected, by a shared point, a tie or a joint, are left out.

    Args:
        surface: all vertices, edges and triangles that may touch.
        lower, upper: least and greatest coordinates (m, 3) [m] of the points; a primitive has the
            box of its points.
        vertices, edges: numbers of the surface's vertices and edges that this rank asks for;
            together the ranks ask for all.
        expected: numbers of vertex-triangle and of edge-edge pairs that are likely; zero: not
            known.

    Returns:
        table of vertex-triangle pairs, then of edge-edge pairs.

    Raises:
        ValueError: an array is not contiguous, or not of the type that C takes.
    """
    vertex_points = np.ascontiguousarray(surface.vertices[:, None])
    with_triangles: Int32Array = np.zeros((0, 2), dtype=np.int32)
    # Cables and beams have edges only.
    if len(surface.triangles):
        # The tree is built over the triangles, which are asked by fewer points.
        tree = BoxTree(surface.filtered(surface.triangles, lower, upper))
        with_triangles = tree.overlaps(
            surface.filtered(vertex_points, lower, upper), vertices, expected=expected[0]
        )
    all_edges = surface.filtered(surface.edges, lower, upper)
    with_edges = BoxTree(all_edges).overlaps(all_edges, edges, in_tree=True, expected=expected[1])

    triangle_pairs = np.hstack(
        [vertex_points[with_triangles[:, 0]], surface.triangles[with_triangles[:, 1]]]
    )
    edge_pairs = np.hstack([surface.edges[with_edges[:, 0]], surface.edges[with_edges[:, 1]]])
    points = np.vstack([triangle_pairs.reshape(-1, 4), edge_pairs.reshape(-1, 4)])
    counts = [len(with_triangles), len(with_edges)]
    kinds = np.array([PairKind.POINT_TRIANGLE, PairKind.EDGE_EDGE], dtype=np.uint8)
    kind: ByteArray = np.repeat(kinds, counts)
    return OverlappingPairs(
        kind=kind,
        points=np.ascontiguousarray(points, dtype=np.int32),
        primitives=np.vstack([with_triangles, with_edges]).astype(np.int64),
    )
