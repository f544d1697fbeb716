"""How contact forces depend on the closest points at the start of a step, for gradients of a run.

The vector r of a pair leads between the closest points (u0, v0) of the start of the step.  The
energy of the pair does not depend on this origin.  The force of a step does, slightly: the
correction along the change of the measures (`contact.potential`, equation 3) is another one for
another r.  The reversed step of a gradient keeps the origin, so that this derivative is added to
what the reversed step gives:

    (∂F/∂(u0, v0) ∂(u0, v0)/∂x0)ᵀ μ                                                              (1)

It is a part of 1e-9 of a gradient where films touch slowly, and of up to 1e-2 of the derivative of
a single pair that crosses much of its activation distance in a step.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gossamer_fx.mechanics.contact.arrays import Array
from gossamer_fx.mechanics.contact.pair_table import ActivePairs
from gossamer_fx.mechanics.contact.potential import ContactLaw, PairState, evaluate
from gossamer_fx.mechanics.contact.stencils import is_wall, parameter_derivatives_of

# Change of the origin, as a part of the sides, in the central difference for ∂F/∂(u0, v0).  Its
# errors, of 1e-8 and less, are those of a small part of the force.
ORIGIN_DIFFERENCE = 1e-4


def forces_by_origin(
    pairs: ActivePairs, x0: Array, x1: Array, law: ContactLaw, alpha: float
) -> Array:
    """Return ∂F/∂(u0, v0) (n, 2, 4, 3) [N] of the forces on the points of n pairs in a step.

    Args:
        pairs: with the column `start`; zero for walls, which have no parameters.
        x0, x1: points (m, 3) [m] at the start and at the end.
        law: of the energy.
        alpha: weight of the end in the configuration where forces act.
    """
    assert pairs.start is not None, "a step has the starts of its pairs"
    found = np.zeros((len(pairs), 2, 4, 3))
    for parameter in range(2):
        for sign in (1.0, -1.0):
            start = pairs.start.copy()
            start[:, parameter] += sign * ORIGIN_DIFFERENCE
            moved = replace(pairs, start=start)
            response = evaluate(moved, x0, x1, law, alpha, by_pair=True, push_back=0.0)
            forces = np.asarray(response.forces).reshape(-1, 4, 3)
            found[:, parameter] += sign * forces / (2 * ORIGIN_DIFFERENCE)
    found[is_wall(pairs.kind)] = 0.0
    return found


def add_product_through_origins(
    pairs: ActivePairs, x0: Array, x1: Array, law: ContactLaw, alpha: float, μ: Array, found: Array
) -> None:
    """Add (1) of all pairs to `found` (m, 3).

    Args:
        pairs: with the column `start`.
        x0, x1: points (m, 3) [m] at the start and at the end of the step.
        law: of the energy.
        alpha: weight of the end in the configuration where forces act.
        μ: displacements (m, 3) of the points.
        found: to which the product is added.
    """
    state = evaluate(pairs, x0, x1, law, alpha, push_back=0.0).state
    pairs = pairs.rows((state == PairState.TOUCHES) & ~is_wall(pairs.kind))
    if not len(pairs):
        return
    assert pairs.start is not None, "a step has the starts of its pairs"
    by_origin = forces_by_origin(pairs, x0, x1, law, alpha)
    by_parameters = np.einsum("nikc,nkc->ni", by_origin, μ[pairs.points])
    of_points = parameter_derivatives_of(pairs, x0[pairs.points], pairs.start[:, :2])
    np.add.at(found, pairs.points, np.einsum("ni,nikc->nkc", by_parameters, of_points))
