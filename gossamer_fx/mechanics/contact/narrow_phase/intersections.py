"""Edges that intersect triangles, decided exactly, and initial states that contact refuses.

The sign of a volume says on which side of a plane a point lies.  Layers that are pressed together
lie on each other to round-off, where double precision may give any sign; there the volume is
computed in fractions.  An edge that only touches a triangle, or lies in its plane, does not
intersect it.

At the start no layers may intersect or coincide, and no point may be inside an obstacle.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.errors import InputError
from gossamer_fx.core.forms.c_source import check_indices
from gossamer_fx.mechanics.contact.broad_phase.box_tree import BoxTree
from gossamer_fx.mechanics.contact.contract import Array, ByteArray, Int32Array, MaskArray
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.geometry.facets import CollisionPrimitives
from gossamer_fx.mechanics.contact.kernels.library import library

# Of `enum intersection` in kernels/contact.h.
INTERSECTS = 1
UNSURE = 2

# Direction of rays that tell inside from outside: along no axis or diagonal, so that rays from the
# nodes of regular meshes do not meet edges of regular surfaces.
RAY = np.array([0.53771, 0.31877, 0.78058])


def find_intersections(
    surface: CollisionPrimitives, x: Array, edges: Int32Array | None = None
) -> Int32Array:
    """Return the pairs of an edge and a triangle that intersect and are not connected, as their
    numbers (k, 2).  Signs that round-off makes uncertain are computed again in exact fractions.
    `x`: the points (m, 3) [m]; `edges`: numbers (q,) of those that are asked for; None: all."""
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
    """Return for pairs of edges and triangles, given by their numbers `near` (k, 2), whether they
    intersect: 0, `INTERSECTS`, or `UNSURE` where a sign is within round-off, (k,)."""
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
    """Return whether an edge intersects a triangle, decided in exact fractions.  An edge that only
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


# Gap of a point, over the activation distance, below which two layers count as one: contact could
# not tell on which side of each other they are.
COINCIDENT = 1e-6


def refuse_intersections(mesh: CollisionMesh, x: Array, comm: MPI.Intracomm) -> None:
    """Raise `InputError` on all ranks where edges intersect triangles; collective.

    Raises:
        InputError: names the number of intersecting edges, and of the first one both bodies and its
            middle.
    """
    surface = mesh.surface
    found = find_intersections(surface, x, mesh.own_edges)
    first = None
    if len(found):
        edge, triangle = found[0]
        first = (
            mesh.name_of(surface.edges[edge, 0]),
            mesh.name_of(surface.triangles[triangle, 0]),
            x[surface.edges[edge]].mean(axis=0),
        )
    counts = comm.allgather((len(found), first))
    count = sum(number for number, _ in counts)
    if not count:
        return
    one, other, middle = next(example for _, example in counts if example)
    raise InputError(
        f"Contact: layers penetrate each other at the start, {count} edges of the mesh, the first "
        f"of '{one}' through '{other}' near {_point(middle)} m; open them, or leave one of the "
        "bodies out."
    )


def refuse_coincident(
    mesh: CollisionMesh, x: Array, nearest: Array, activation_distance: float
) -> None:
    """Raise `InputError` where body points touch something at the start, or are within it;
    collective.

    `nearest`: gap (m,) [m] of each point to what is nearest on any rank.

    Raises:
        InputError: names a body, the number of such points and the first of them.
    """
    of_bodies = nearest[: mesh.points.body_count]
    is_close = of_bodies < COINCIDENT * activation_distance
    count, first = _count_and_first(mesh, x, is_close)
    if not count:
        return
    name, point = first
    raise InputError(
        f"Contact: {count} points of '{name}' and others touch something at the start, or are "
        f"within it, the first at {_point(point)} m; open the layers by a little, or tie them "
        "there."
    )


def refuse_points_inside(mesh: CollisionMesh, x: Array) -> None:
    """Raise `InputError` where points of bodies are inside a box, or another obstacle with a closed
    surface of triangles, at the start; collective.

    Such a surface keeps points apart on both sides, so that a body within it would be taken for one
    that is kept there.  Spheres and cylinders are a radius round a point or an axis:
    `refuse_coincident` finds their points.

    Raises:
        InputError: names a body, the obstacle, the number of such points and the first of them.
    """
    triangles = mesh.surface.triangles
    is_of_obstacle = triangles[:, 0] >= mesh.points.body_count
    owner = mesh.body[triangles[:, 0]]
    of_bodies = x[: mesh.points.body_count]
    for obstacle in np.unique(owner[is_of_obstacle]):
        surface = triangles[is_of_obstacle & (owner == obstacle)]
        if not _is_closed(surface):
            continue
        count, first_inside = _count_and_first(mesh, x, _are_inside(of_bodies, x[surface]))
        if count:
            name, point = first_inside
            raise InputError(
                f"Contact: {count} points of '{name}' and others are inside the obstacle "
                f"'{mesh.names[obstacle]}' at the start, the first at {_point(point)} m; move one "
                "of them, or give a box inside=True to keep bodies within it."
            )


def _is_closed(triangles: Array) -> bool:
    """Whether two of the triangles (t, 3), numbers of corners, meet at each of their edges."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, triangles_at = np.unique(edges, axis=0, return_counts=True)
    return bool((triangles_at == 2).all())


def _are_inside(points: Array, corners: Array) -> MaskArray:
    """Which points (n, 3) [m] are inside a closed surface of triangles with corners (t, 3, 3) [m]:
    a ray from there crosses it an odd number of times.

    Source: Möller & Trumbore, J. Graphics Tools 2 (1997) 21.
    """
    is_inside: MaskArray = np.zeros(len(points), dtype=bool)
    for corner, second, third in corners:
        a, b = second - corner, third - corner
        across = np.cross(RAY, b)
        determinant = a @ across
        if determinant == 0:  # parallel to the ray, which does not cross it
            continue
        r = points - corner
        # The ray meets the plane of the triangle at corner + u a + v b, `distance` from its start.
        u = r @ across / determinant
        turned = np.cross(r, a)
        v = turned @ RAY / determinant
        distance = turned @ b / determinant
        is_inside ^= (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
    return is_inside


def _count_and_first(
    mesh: CollisionMesh, x: Array, is_wrong: MaskArray
) -> tuple[int, tuple[str, Array]]:
    """Return how many points of bodies are wrong on all ranks, each counted once, and name of the
    body and position (3,) [m] of the one with the lowest number; collective.  An empty name and
    zeros if there is none.  `is_wrong`: mask (n,) of the points of bodies that this rank knows."""
    wrong = np.flatnonzero(is_wrong & mesh.shared.is_own)
    first: list[tuple[int, str, Array]] = []
    if len(wrong):
        point = wrong[0]
        number = int(mesh.known.points.number[point])
        first = [(number, mesh.name_of(point), x[point])]
    of_ranks = mesh.comm.allgather((len(wrong), first))
    firsts = [example for _, examples in of_ranks for example in examples]
    if not firsts:
        return 0, ("", np.zeros(3))
    _, name, position = min(firsts, key=lambda example: example[0])
    return sum(count for count, _ in of_ranks), (name, position)


def _point(x: Array) -> str:
    """Return a point (3,) as messages show it."""
    return f"({x[0]:.4g}, {x[1]:.4g}, {x[2]:.4g})"
