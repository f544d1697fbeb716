"""What layers may not be at the start: through each other, or in one place."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from gossamer_fx.checks.errors import InputError
from gossamer_fx.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.contact.kernels.library import Array
from gossamer_fx.contact.narrow_phase.intersections import intersections

COINCIDENT = 1e-6  # distance over that of contact, below which layers cannot be told apart


def refuse_intersections(bodies: CollisionMesh, x: Array, comm: MPI.Intracomm) -> None:
    """Raise `InputError` where edges pierce triangles at points x (m, 3); collective."""
    surface = bodies.surface
    found = intersections(surface, x, bodies.own_edges)
    first = [
        (
            bodies.names[bodies.body[surface.edges[edge, 0]]],
            bodies.names[bodies.body[surface.triangles[triangle, 0]]],
            *x[surface.edges[edge]].mean(axis=0).tolist(),
        )
        for edge, triangle in found[:1]
    ]
    counts = comm.allgather((len(found), first))
    count = sum(n for n, _ in counts)
    if count:
        one, other, a, b, c = next(place for _, places in counts for place in places)
        raise InputError(
            f"Contact: layers pierce each other at the start, {count} edges of the mesh, the first of '{one}' through "
            f"'{other}' near ({a:.4g}, {b:.4g}, {c:.4g}) m; open them, or leave one of the bodies out."
        )


def refuse_coincident(bodies: CollisionMesh, x: Array, least: Array, distance: float) -> None:
    """Raise `InputError` where points x (m, 3) with the distances `least` (m,) touch something; all ranks know them."""
    film = np.arange(bodies.points.m) < bodies.points.n
    close = np.flatnonzero(film & (least < COINCIDENT * distance))
    if len(close):
        a, b, c = x[close[0]]
        name = bodies.names[bodies.body[close[0]]]
        raise InputError(
            f"Contact: {len(close)} points of '{name}' and others touch something at the start, or are within it, "
            f"the first at ({a:.4g}, {b:.4g}, {c:.4g}) m; open the layers by a little, or tie them there."
        )
