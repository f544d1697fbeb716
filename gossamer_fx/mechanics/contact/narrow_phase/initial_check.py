"""What is checked before the first step: no layers may intersect or coincide."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.checks.errors import InputError
from gossamer_fx.mechanics.contact.arrays import Array, MaskArray
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.narrow_phase.intersections import find_intersections

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
        f"of '{one}' through "
        f"'{other}' near {_point(middle)} m; open them, or leave one of the bodies out."
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
    """Raise `InputError` where points of bodies are inside a box at the start; collective.

    The surface of a box keeps points apart on both sides, so that a body within it would be taken
    for one that is kept there.  Spheres and cylinders are a radius round a point or an axis:
    `refuse_coincident` finds their points.

    Raises:
        InputError: names a body, the box, the number of such points and the first of them.
    """
    triangles = mesh.surface.triangles
    is_of_box = triangles[:, 0] >= mesh.points.body_count
    owner = mesh.body[triangles[:, 0]]
    of_bodies = x[: mesh.points.body_count]
    for box in np.unique(owner[is_of_box]):
        corners = x[triangles[is_of_box & (owner == box)]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        heights = np.einsum("pk,tk->pt", of_bodies, normals)
        heights -= np.einsum("tk,tk->t", corners[:, 0], normals)
        # The height of the middle over each face tells which side is inside.
        middle = corners.reshape(-1, 3).mean(axis=0)
        inside_sign = np.sign(((middle - corners[:, 0]) * normals).sum(axis=1))
        is_inside = (heights * inside_sign > 0).all(axis=1)
        count, first_inside = _count_and_first(mesh, x, is_inside)
        if count:
            name, point = first_inside
            raise InputError(
                f"Contact: {count} points of '{name}' and others are inside the box "
                f"'{mesh.names[box]}' at the start, the first at {_point(point)} m; move one of "
                "them, or give the "
                "box inside=True to keep bodies within it."
            )


def _count_and_first(
    mesh: CollisionMesh, x: Array, is_wrong: MaskArray
) -> tuple[int, tuple[str, Array]]:
    """Return how many points of bodies are wrong on all ranks, and the first one; collective.
    `is_wrong`: mask of the points of bodies (n,) that this rank knows. Returns their number, each
    point counted once, and name of the body and position (3,) [m] of the one with the lowest
    number; an empty name and zeros if there is none."""
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
    return f"({x[0]:.4g}, {x[1]:.4g}, {x[2]:.4g})"
