"""Which facets a rank sends to others: those whose boxes overlap a region where another rank
searches.

A rank describes where it searches by a few boxes round groups of neighbouring primitives.  Every
rank gets these boxes, not the facets, and finds in a tree over them to whom its own primitives may
be near.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.algebra.rank_exchange import RankExchange
from gossamer_fx.mechanics.contact.arrays import Array, ByteArray, Int32Array, Int64Array
from gossamer_fx.mechanics.contact.broad_phase.box_tree import BoxTree, morton_order
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.geometry.facets import FilteredPrimitives
from gossamer_fx.mechanics.contact.geometry.surface_share import SurfaceTables

# Boxes by which a rank describes where it searches.  In a folded sail the one box round all
# primitives of a rank overlaps everything; with this many, boxes are about as flat as the folds.
GROUP_COUNT = 64


def group_boxes(boxes: Array) -> Array:
    """Return a few boxes that hold all of many boxes, each those of a group of neighbours. Returns
    boxes (g, 6) [m], at most `GROUP_COUNT`; none if there are no boxes."""
    if not len(boxes):
        return np.zeros((0, 6))
    ordered = boxes[morton_order(boxes)]
    starts = np.unique(np.linspace(0, len(boxes), GROUP_COUNT, endpoint=False).astype(int))
    lower = np.minimum.reduceat(ordered[:, :3], starts)
    upper = np.maximum.reduceat(ordered[:, 3:], starts)
    return np.hstack([lower, upper])


class SearchRegions:
    """Where other ranks search."""

    def __init__(self, comm: MPI.Intracomm, boxes: Array) -> None:
        """Exchange the boxes of groups, so that each rank knows where the others search;
        collective."""
        of_ranks = comm.allgather(group_boxes(boxes))
        # What is near this rank's own region needs no sending.
        of_ranks[comm.rank] = np.zeros((0, 6))
        self._rank = np.repeat(np.arange(comm.size), [len(of_rank) for of_rank in of_ranks])
        self._size = comm.size
        self._boxes = np.ascontiguousarray(np.concatenate(of_ranks))

    def destinations(self, boxes: Array) -> tuple[Int64Array, Int64Array]:
        """Return where to send primitives (edges or triangles): to the ranks that search near them.
        Returns which primitive (k,) and to which rank (k,); one may go to several."""
        none: Int64Array = np.zeros(0, dtype=np.int64)
        if not len(boxes) or not len(self._boxes):
            return none, none
        tree = BoxTree(_unfiltered(self._boxes, first_label=0))
        asked: Int32Array = np.arange(len(boxes), dtype=np.int32)
        found = tree.overlaps(_unfiltered(boxes, first_label=len(self._boxes)), asked)
        # Several groups of one rank may be near the same primitive.
        pairs = np.unique(found[:, 0].astype(np.int64) * self._size + self._rank[found[:, 1]])
        return pairs // self._size, pairs % self._size


def _unfiltered(boxes: Array, first_label: int) -> FilteredPrimitives:
    """Return primitives (boxes) that are connected to nothing and not fixed: each has a label for
    itself."""
    count = len(boxes)
    labels: Int32Array = np.arange(first_label, first_label + count, dtype=np.int32)
    is_fixed: ByteArray = np.zeros(count, dtype=np.uint8)
    return FilteredPrimitives(np.ascontiguousarray(boxes), labels[:, None], is_fixed)


def import_facets(mesh: CollisionMesh, lower: Array, upper: Array) -> None:
    """Let this rank know the edges and triangles of other ranks that may come near its own;
    collective. After it the points of the mesh are other ones, with other numbers: its own, and
    those of what it has received."""
    comm = mesh.comm
    # The only rank has all facets.
    if comm.size == 1:
        return
    surface = mesh.surface
    known = mesh.known
    vertices = surface.vertices[mesh.own_vertices]
    edge_boxes = _boxes(surface.edges[mesh.own_edges], lower, upper)
    searched = np.vstack([_boxes(vertices[:, None], lower, upper), edge_boxes])
    regions = SearchRegions(comm, searched)
    edge, edge_rank = regions.destinations(_boxes(surface.edges[mesh.sent_edges], lower, upper))
    edge = mesh.sent_edges[edge]
    triangles = surface.triangles[mesh.sent_triangles]
    triangle, triangle_rank = regions.destinations(_boxes(triangles, lower, upper))
    triangle = mesh.sent_triangles[triangle]

    # The points of what is sent, each once for each rank.
    points = np.concatenate([surface.edges[edge].ravel(), surface.triangles[triangle].ravel()])
    ranks = np.concatenate([np.repeat(edge_rank, 2), np.repeat(triangle_rank, 3)])
    pairs = np.unique(points.astype(np.int64) * comm.size + ranks)
    point = pairs // comm.size
    received = SurfaceTables(
        points=known.points.received(point, RankExchange(comm, pairs % comm.size)),
        edges=known.edges.received(edge, RankExchange(comm, edge_rank)),
        triangles=known.triangles.received(triangle, RankExchange(comm, triangle_rank)),
    )
    mesh.show(mesh.share.surface.united(received))


def _boxes(primitives: Int32Array, lower: Array, upper: Array) -> Array:
    """Return the boxes (n, 6) of primitives (n, k) from those of their points."""
    return np.hstack([lower[primitives].min(axis=1), upper[primitives].max(axis=1)])
