"""Derivatives of a step's contact forces and energy, for gradients of runs and equilibria.

The reversed step of a backward pass gives most of the derivative by the start of a step.  Here is
what it leaves out, and the derivatives by the numbers of a contact:

    by the start of a step    friction, the origin of pairs' vectors, and the stiffness that pairs
                              derive from closing speeds
    by a number               friction coefficient, given stiffness, masses of bodies

Stiffness.  Without a given stiffness a pair that begins to touch in a step takes

    k = 4 σ v² A,    v = 1.25 |dD/dt|,                                                          (1)

σ the area density of both sides and dD/dt the rate of its distance at the start of this step
(`active_set`).  It keeps k while it has energy.  So the forces of later steps depend on the
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
from petsc4py import PETSc

from gossamer_fx.core.model.body import MeshBody
from gossamer_fx.mechanics.contact.active_set import SHORT_TIME, SPEED_RESERVE
from gossamer_fx.mechanics.contact.contact_set import ContactSet
from gossamer_fx.mechanics.contact.contact_step import (
    energy_of_pairs,
    unit_energies,
)
from gossamer_fx.mechanics.contact.contract import Array, Int32Array, Int64Array
from gossamer_fx.mechanics.contact.pairs import (
    TINY,
    ActivePairs,
    closest_points,
    derivatives_of,
)


class StiffnessAdjoint:
    """Sums μ·∂f/∂k [J/J] of the pairs of one contact, and their derivatives by densities.

    Args:
        density: area densities (k,) [kg/m²] of bodies and obstacles.

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
        """Add contributions (n,) of this rank's pairs; collective. All ranks have all sums: in an
        earlier step another rank may have the pair."""
        of_ranks = self._comm.allgather((identifier, contribution))
        identifiers = np.concatenate([self._identifier, *(part for part, _ in of_ranks)])
        contributions = np.concatenate([self._sum, *(part for _, part in of_ranks)])
        self._identifier, row = np.unique(identifiers, return_inverse=True)
        self._sum = np.zeros(len(self._identifier))
        np.add.at(self._sum, row, contributions)

    def take(self, identifier: Int64Array) -> Array:
        """Return the sums (n,) of this rank's pairs that chose their stiffness in the present step,
        and forget them on all ranks; collective."""
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
        """Add to `by_density` what the stiffness (n,) [J] of pairs gives for the densities of both
        of their `bodies` (n, 2).  `by_stiffness`: the sums (n,) of the pairs."""
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
    """Return how a weighted sum of stiffnesses of contact pairs depends on the start of a step. A
    pair without a given stiffness takes k = 4 σ v² A, with the area density σ [kg/m²], the area A
    [m²], and the closing speed v = 1.25 |dD/dt| [m/s] of its distance D [m], or a lower bound.
    `by_stiffness`: the weights (n,) of the sum; `step`: length [s].  Returns derivatives of
    Σ by_stiffness k by the four points of each pair (n, 4, 3), and by their velocities (n, 4, 3);
    zero where the lower bound `reference_speed` counts."""
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


class ContactGradient:
    """Derivatives of the forces and of the energy of one contact, in the present step."""

    def __init__(self, contact_set: ContactSet) -> None:
        self._set = contact_set
        self._system = contact_set.system
        self._comm = contact_set.system.comm
        self._points = contact_set.points
        self._stiffness = contact_set.pair_stiffness
        # Of a backward pass, if stiffness is derived from closing speeds.
        self._stiffness_adjoint: StiffnessAdjoint | None = None

    # ---- by the start of a step ----

    def start_adjoint(self) -> None:
        """Begin a backward pass: forget the sums of pairs that derive their stiffness.
        Collective."""
        if self._set.pair_stiffness.given is not None:
            return
        self._stiffness_adjoint = StiffnessAdjoint(self._stiffness.densities(), self._comm)

    def add_product_with_start_derivative(
        self, μ: PETSc.Vec, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add (∂f/∂q0)ᵀ μ and (∂f/∂v0)ᵀ μ of what the reversed step leaves out of the forces f;
        collective. It is friction, how the force of a pair depends on the origin of its vectors,
        and the stiffness that pairs derive from their closing speed."""
        on_points = self._on_points(μ)
        found = np.zeros((self._points.count, 3))
        step = self._set.step
        if step is not None:
            x1 = self._set.end_points()
            for group in step.groups:
                group.add_start_product(x1, on_points, found)
        if self._stiffness_adjoint is not None:
            rates = np.zeros((self._points.count, 3))
            self._add_product_through_stiffness(on_points, found, rates)
            self._points.add(rates, by_velocity)
        self._points.add(found, by_position)

    def _add_product_through_stiffness(self, μ: Array, found: Array, rates: Array) -> None:
        """Add the part of (∂f/∂q0)ᵀ μ and (∂f/∂v0)ᵀ μ that the derived stiffness of pairs gives;
        collective. f are the contact forces [N] of the step from q0 with the velocities v0. `found,
        rates`: (m, 3), to which the products with respect to positions and velocities of the points
        at the start are added."""
        adjoint = self._stiffness_adjoint
        step = self._set.step
        assert adjoint is not None and step is not None
        pairs = step.pairs
        x1 = self._set.end_points()
        # Forces are proportional to the stiffness k of their pair: μ·∂f/∂k = μ·f/k.  Friction is
        # proportional to the normal force.
        identifiers: list[Int64Array] = [pairs.identifier]
        contributions: list[Array] = [np.zeros(len(pairs))]
        for group in step.groups:
            identifiers.append(group.step.pairs.identifier)
            contributions.append(group.works(x1, μ) / group.step.pairs.stiffness)
        adjoint.add(np.concatenate(identifiers), np.concatenate(contributions))
        # Pairs without energy at the start chose their stiffness in this step.
        had_energy, _ = self._set.history.stiffness_of(pairs.identifier)
        new = pairs.rows(~had_energy)
        by_stiffness = adjoint.take(new.identifier)
        sides = np.column_stack([new.points[:, 0], new.second_point])
        adjoint.add_densities(self._set.mesh.body[sides], by_stiffness, new.stiffness)
        system = self._system
        by_position, by_velocity = closing_derivatives(
            pairs=new,
            x0=step.x0,
            v=self._points.rates(system.v0, system.time, system.h),
            by_stiffness=by_stiffness,
            reference_speed=self._set.history.reference_speed,
            step=system.h,
        )
        np.add.at(found, new.points, by_position)
        np.add.at(rates, new.points, by_velocity)

    def add_energy_by_stiffness(self, share: float) -> None:
        """Add a share of the derivative of the energy at q0 by the derived stiffness of pairs;
        collective. Nothing happens where the stiffness is given as a number. `share`: factor [-] of
        the derivative, that of the energy in the objective."""
        if self._stiffness_adjoint is None:
            return
        self._set.stored_energy()
        pairs = self._set.pairs_with_energy()
        _, scaled = energy_of_pairs(pairs, self._set.accepted.x, self._set.law)
        # The sums are subtracted from the derivatives, as those of all forces are.
        self._stiffness_adjoint.add(
            pairs.identifier, -share * unit_energies(pairs, scaled, self._set.law)
        )

    # ---- by numbers ----

    def derivatives_by_mass(self) -> dict[MeshBody, float]:
        """Return the derivative [1/kg] of the result by the mass of each body, through the
        stiffness that pairs derived; collective."""
        if self._stiffness_adjoint is None:
            return {}
        mesh = self._set.mesh
        by_density = self._comm.allreduce(self._stiffness_adjoint.by_density)
        masses = mesh.body_masses(self._system)
        by_mass = -by_density[: len(masses)] * self._stiffness.densities()[: len(masses)] / masses
        return dict(zip(mesh.bodies, map(float, by_mass), strict=True))

    def work_by_friction(self, w: PETSc.Vec) -> float:
        """Return w·∂r/∂c [J] by the coefficient c of friction, this rank's share; collective."""
        on_points = self._on_points(w)
        step = self._set.step
        if step is None:
            return 0.0
        x1 = self._set.end_points()
        return sum(group.work_by_coefficient(x1, on_points) for group in step.groups)

    def work_by_stiffness(self, w: PETSc.Vec) -> float:
        """Return w·∂r/∂K [m³] by the given stiffness K, this rank's share; collective. All forces
        are proportional to it, those of friction included. r is the residual of the system.
        Without pairs the result is zero."""
        assert self._stiffness.given is not None, "only a given stiffness is a parameter"
        on_points = self._on_points(w)
        step = self._set.step
        if step is None:
            return 0.0
        forces = step.forces(self._set.end_points())
        return float(np.sum(on_points * forces.on_points)) / self._stiffness.given

    def energy_by_stiffness(self) -> float:
        """Return ∂ψ/∂K [m³] of the energy ψ at q0 by the given stiffness K, this rank's share."""
        assert self._stiffness.given is not None, "only a given stiffness is a parameter"
        return self._set.stored_energy() / self._stiffness.given

    def _on_points(self, w: PETSc.Vec) -> Array:
        """Return a displacement w of the system at the points (m, 3); collective."""
        return np.asarray(self._points.weights @ self._points.of_block_rows(w))
