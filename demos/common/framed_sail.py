"""A square film that springs stretch in a rigid frame, in equilibrium at the start; its centre is
at the origin."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import gossamer_fx as gx
from gossamer_fx.extend import Array

SIDE = 10.0  # of the sail [m]
GAP = 0.2  # between the sail and the frame, bridged by the springs [m]
SPIN = 0.01  # rad/s
RADIUS = 6378137.0 + 8e5  # of the orbit [m]; equatorial radius of the Earth (WGS 84)


def stretching(side: float, strain: float) -> Callable[[Array], Array]:
    """The displacement of a square [0, side]² [m] that is centred and stretched by a strain in its
    plane."""
    middle = np.array([[side / 2], [side / 2], [0.0]])

    def displacement(X: Array) -> Array:
        return (1 + strain) * (X - middle) - X

    return displacement


def framed_sail(
    mesh: gx.Mesh,
    law: gx.Miyazaki,
    *,
    cells: int,
    strain: float,
    tension: float,
    stiffness: float,
    thermal: gx.materials.ThermalExpansion | None = None,
) -> tuple[gx.Membrane, gx.RigidBody, list[gx.connectors.Spring]]:
    """A square sail, its frame, and a spring at each node on the edges, which balances the tension
    of the film; the centre is at the origin.

    Args:
        mesh: of the square [0, SIDE]².
        law: of the film.
        cells: of the mesh along an edge.
        strain: of both directions at the start.
        tension: force on an edge of the film over its stress-free length [N/m].
        stiffness: of each spring [N/m].
        thermal: expansion of the film.
    """
    film = gx.Membrane(
        mesh, law, thermal=thermal, displacement=stretching(SIDE, strain), name="sail"
    )
    frame = gx.RigidBody(30.0, (500.0, 500.0, 1000.0), comm=film.comm, name="frame")
    each = SIDE / cells
    middle = np.array([SIDE / 2, SIDE / 2, 0.0])
    springs = []
    for i in range(cells + 1):
        for j in range(cells + 1):
            outward = np.array([(i == cells) - (i == 0), (j == cells) - (j == 0), 0.0])
            if not outward.any():
                continue
            # A node of an edge carries the tension of its length, a corner half of it along both
            # edges.
            is_corner = np.count_nonzero(outward) == 2
            force = tension * each * (outward / 2 if is_corner else outward)
            size = float(np.linalg.norm(force))
            node = np.array([i * each, j * each, 0.0])
            hook = (1 + strain) * (node - middle) + GAP * force / size
            spring = gx.connectors.Spring(
                frame.port(hook.tolist()),
                film.port_at(node.tolist()),
                stiffness=stiffness,
                length=GAP - size / stiffness,
                name=f"tie {i} {j}",
            )
            springs.append(spring)
    return film, frame, springs
