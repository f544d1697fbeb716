"""A square film that springs stretch in a rigid frame, in equilibrium at the start; its centre is
at the origin."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import gossamer_fx as gx
from gossamer_fx.core.model.body import Array


def stretching(side: float, strain: float) -> Callable[[Array], Array]:
    """The displacement of a square [0, side]² [m] that is centred and stretched by a strain in its
    plane."""
    middle = np.array([[side / 2], [side / 2], [0.0]])

    def displacement(X: Array) -> Array:
        moved: Array = (1 + strain) * (X - middle) - X
        return moved

    return displacement


def springs_to_frame(
    film: gx.Membrane,
    frame: gx.RigidBody,
    *,
    side: float,
    cells: int,
    strain: float,
    tension: float,
    gap: float,
    stiffness: float,
) -> list[gx.connectors.Spring]:
    """A spring at each node on the edges of the film, which balances the tension of the film.

    Args:
        film: stretched by `stretching(side, strain)`.
        frame: to which the springs lead.
        side: of the stress-free film [m].
        cells: of the mesh along an edge.
        strain: of both directions at the start.
        tension: force on an edge of the film over its stress-free length [N/m].
        gap: length of the springs at the start [m].
        stiffness: of each spring [N/m].
    """
    each = side / cells
    middle = np.array([side / 2, side / 2, 0.0])
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
            hook = (1 + strain) * (node - middle) + gap * force / size
            spring = gx.connectors.Spring(
                frame.port(hook.tolist()),
                film.port_at(node.tolist()),
                stiffness=stiffness,
                length=gap - size / stiffness,
                name=f"tie {i} {j}",
            )
            springs.append(spring)
    return springs
