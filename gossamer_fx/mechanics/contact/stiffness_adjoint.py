"""Derivatives through the stiffness that pairs derive from their closing speed, for gradients of a
run.

Problem.  Without a given stiffness a pair that begins to touch in a step takes

    k = 4 σ v² A,    v = 1.25 |dD/dt|,                                                          (1)

σ the area density of both sides and dD/dt the rate of its distance at the start of this step
(`pair_stiffness`).  It keeps k while it has energy.  So the forces of later steps depend on the
state at the start of the first one, and on the masses of the bodies.

Algorithm, backwards over the steps, with one sum for each pair.

    1. Add μ·∂f/∂k = μ·f/k of the pair in the step: its forces are proportional to k.
    2. In the step in which the pair chose k, carry the sum to the start of the step by (1), and
       begin a new one.
    3. What (1) gives for σ is summed up for each body.

The reference speed, a lower bound of v that follows from the length of the first step, counts as
given, and so do the activation distances.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from gossamer_fx.mechanics.contact.arrays import Array, Int32Array, Int64Array
from gossamer_fx.mechanics.contact.narrow_phase.closest_points import closest_points
from gossamer_fx.mechanics.contact.pair_stiffness import SHORT_TIME, SPEED_RESERVE
from gossamer_fx.mechanics.contact.pair_table import ActivePairs
from gossamer_fx.mechanics.contact.stencils import TINY, derivatives_of


class StiffnessAdjoint:
    """Sums μ·∂f/∂k [J/J] of the pairs of one contact, and their derivatives by densities.

    Args:
        density: area densities (k,) [kg/m²] of bodies and obstacles.
        comm: of the contact.

    Attributes:
        by_density: derivative of the sums by the density of each body (k,) so far, this rank's
            share.
    """

    def __init__(self, density: Array, comm: MPI.Intracomm) -> None:
        self._density = density
        self._comm = comm
        self._identifier: Int64Array = np.zeros(0, dtype=np.int64)
        self._sum: Array = np.zeros(0)
        self.by_density: Array = np.zeros(len(density))

    def add(self, identifier: Int64Array, contribution: Array) -> None:
        """Add contributions (n,) of this rank's pairs; collective.

        All ranks have all sums: in an earlier step another rank may have the pair.

        Args:
            identifier: global numbers (n,) of the pairs, the same in all steps and on all ranks.
            contribution: for each pair (n,), the derivative of the objective by its stiffness.
        """
        of_ranks = self._comm.allgather((identifier, contribution))
        identifiers = np.concatenate([self._identifier, *(part for part, _ in of_ranks)])
        contributions = np.concatenate([self._sum, *(part for _, part in of_ranks)])
        self._identifier, row = np.unique(identifiers, return_inverse=True)
        self._sum = np.zeros(len(self._identifier))
        np.add.at(self._sum, row, contributions)

    def take(self, identifier: Int64Array) -> Array:
        """Return the sums (n,) of this rank's pairs that chose their stiffness in the present step,
        and forget them on all ranks; collective.

        Args:
            identifier: global numbers (n,) of the pairs; sums of pairs unknown here are zero.
        """
        found = np.zeros(len(identifier))
        order = np.argsort(identifier)
        known = np.isin(self._identifier, identifier)
        row = np.searchsorted(identifier[order], self._identifier[known])
        found[order[row]] = self._sum[known]
        taken = np.concatenate(self._comm.allgather(identifier))
        remains = ~np.isin(self._identifier, taken)
        self._identifier = self._identifier[remains]
        self._sum = self._sum[remains]
        return found

    def add_densities(
        self, bodies: Int32Array | Int64Array, by_stiffness: Array, stiffness: Array
    ) -> None:
        """Add what the stiffness of pairs gives for the densities.

        Args:
            bodies: numbers (n, 2) of both sides.
            by_stiffness: the sums (n,) of the pairs.
            stiffness: k (n,) [J].
        """
        density = self._density[bodies]
        # k is proportional to 2/(1/σ1 + 1/σ2); an obstacle has an infinite density.
        both_sides = 2 / np.maximum((1 / density).sum(axis=1), TINY)
        by_side = (by_stiffness * stiffness * both_sides)[:, None] / (2 * density**2)
        np.add.at(self.by_density, bodies, by_side)


def closing_derivatives(
    pairs: ActivePairs,
    x0: Array,
    v: Array,
    by_stiffness: Array,
    reference_speed: float,
    step: float,
) -> tuple[Array, Array]:
    """Return how a weighted sum of stiffnesses of contact pairs depends on the start of a step.

    A pair without a given stiffness takes k = 4 σ v² A, with the area density σ [kg/m²], the area A
    [m²], and the closing speed v = 1.25 |dD/dt| [m/s] of its distance D [m], or a lower bound.

    Args:
        pairs: n pairs that chose their stiffness k [J] in this step, by (1).
        x0, v: points [m] and velocities [m/s] (m, 3) at its start.
        by_stiffness: factors (n,).
        reference_speed: lower bound of v [m/s].
        step: length of the step [s].

    Returns:
        derivatives of Σ by_stiffness k by the four points of each pair (n, 4, 3), and by their
        velocities (n, 4, 3); zero where the lower bound counts.
    """
    duration = SHORT_TIME * step
    later = np.ascontiguousarray(x0 + duration * v)
    # D and its derivatives at both times.
    distance, gradient = derivatives_of(pairs, x0[pairs.points], closest_points(pairs, x0)[1])
    later_distance, later_gradient = derivatives_of(
        pairs, later[pairs.points], closest_points(pairs, later)[1]
    )
    rate = (later_distance - distance) / duration
    # Below the reference speed k does not depend on the motion.
    is_fast = SPEED_RESERVE * np.abs(rate) > reference_speed
    safe_rate = np.where(is_fast, rate, 1.0)
    by_rate = np.where(is_fast, 2 * by_stiffness * pairs.stiffness / safe_rate, 0.0)
    by_position = by_rate[:, None, None] * (later_gradient - gradient) / duration
    by_velocity = by_rate[:, None, None] * later_gradient
    return by_position, by_velocity
