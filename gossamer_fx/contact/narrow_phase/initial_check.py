"""What is checked before the first step: no layers may intersect or coincide."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from gossamer_fx.checks.errors import InputError
from gossamer_fx.contact.arrays import Array
from gossamer_fx.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.contact.narrow_phase.intersections import find_intersections

# Gap of a point, over the activation distance, below which two layers count as one: contact could not
# tell on which side of each other they are.
COINCIDENT = 1e-6


def refuse_intersections(mesh: CollisionMesh, x: Array, comm: MPI.Intracomm) -> None:
    """Raise `InputError` where edges intersect triangles at points x (m, 3) [m]; collective."""
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
        f"Contact: layers penetrate each other at the start, {count} edges of the mesh, the first of '{one}' through "
        f"'{other}' near {_point(middle)} m; open them, or leave one of the bodies out."
    )


def refuse_coincident(
    mesh: CollisionMesh, x: Array, nearest: Array, activation_distance: float
) -> None:
    """Raise `InputError` where body points touch something at the start, or are within it.

    Args:
        x: points (m, 3) [m].
        nearest: gap (m,) [m] of each point to what is nearest, the same on every rank.
        activation_distance: [m].
    """
    is_of_body = np.arange(mesh.points.count) < mesh.points.body_count
    close = np.flatnonzero(is_of_body & (nearest < COINCIDENT * activation_distance))
    if not len(close):
        return
    first = close[0]
    raise InputError(
        f"Contact: {len(close)} points of '{mesh.name_of(first)}' and others touch something at the start, or are "
        f"within it, the first at {_point(x[first])} m; open the layers by a little, or tie them there."
    )


def _point(x: Array) -> str:
    return f"({x[0]:.4g}, {x[1]:.4g}, {x[2]:.4g})"
