"""Pairs of primitives whose boxes overlap, and that can come near: a point and a triangle, or two
edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gossamer_fx.core.forms.c_source import CStruct, check_indices
from gossamer_fx.mechanics.contact.arrays import Array, ByteArray, Int32Array, Int64Array
from gossamer_fx.mechanics.contact.broad_phase.box_tree import BoxTree
from gossamer_fx.mechanics.contact.geometry.collision_primitives import CollisionPrimitives
from gossamer_fx.mechanics.contact.kernels.library import library
from gossamer_fx.mechanics.contact.pair_table import PairTable
from gossamer_fx.mechanics.contact.stencils import EdgeEdge, PointTriangle


@dataclass
class OverlappingPairs(PairTable):
    """n pairs whose boxes overlap.

    Attributes:
        primitives: numbers (n, 2) of the two primitives of each pair: vertex and triangle, or two
            edges.
    """

    primitives: Int64Array


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
        distance: [m].
    """

    x0: Array
    x1: Array
    margin: Array
    radius: Array
    distance: float

    def of(self, kind: int, asked: Int32Array, in_tree: Int32Array) -> CStruct:
        """Return the C structure for pairs of one kind.

        Args:
            kind: a point and a triangle, or two edges.
            asked: points (p, 1) or (p, 2) of the primitives that are asked for.
            in_tree: points (q, 3) or (q, 2) of those in the tree.

        Raises:
            ValueError: an array is not contiguous, or not of the type that C takes.
        """
        # The compiled C library of contact, which checks the arrays that it gets
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

    Pairs that are connected, by a shared point, a tie or a joint, are left out.

    Args:
        surface: all vertices, edges and triangles that may touch.
        lower, upper: least and greatest coordinates (m, 3) [m] of the points; a primitive has the
            box of its points.
        vertices, edges: numbers of the surface's vertices and edges that this rank asks for;
            together the ranks ask for all.
        expected: numbers of vertex-triangle and of edge-edge pairs that are likely; zero: not
            known.
        near: which of them to keep; None: all.

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

    triangle_pairs = np.hstack(
        [vertex_points[with_triangles[:, 0]], surface.triangles[with_triangles[:, 1]]]
    )
    edge_pairs = np.hstack([surface.edges[with_edges[:, 0]], surface.edges[with_edges[:, 1]]])
    points = np.vstack([triangle_pairs.reshape(-1, 4), edge_pairs.reshape(-1, 4)])
    counts = [len(with_triangles), len(with_edges)]
    kinds = np.array([PointTriangle.number, EdgeEdge.number], dtype=np.uint8)
    kind: ByteArray = np.repeat(kinds, counts)
    return OverlappingPairs(
        kind=kind,
        points=np.ascontiguousarray(points, dtype=np.int32),
        primitives=np.vstack([with_triangles, with_edges]).astype(np.int64),
    )


def _nearness(
    near: Nearness | None, kind: int, asked: Int32Array, in_tree: Int32Array
) -> CStruct | None:
    """Return the C structure of `near` for pairs of one kind; None if all pairs are wanted."""
    if near is None:
        return None
    return near.of(kind, asked, in_tree)
