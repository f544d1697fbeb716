"""Derivatives of a step's contact forces and energy, for gradients of runs and equilibria.

The reversed step of a backward pass gives most of the derivative by the start of a step.  Here is
what it leaves out, and the derivatives by the numbers of a contact:

    by the start of a step    friction, the origin of pairs' vectors (`origin_derivative`), and the
                              stiffness that pairs derive from closing speeds (`stiffness_adjoint`)
    by a number               friction coefficient, given stiffness, masses of bodies
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.model.body import MeshBody
from gossamer_fx.mechanics.contact.arrays import Array
from gossamer_fx.mechanics.contact.contact_set import ContactSet
from gossamer_fx.mechanics.contact.origin_derivative import add_product_through_origins
from gossamer_fx.mechanics.contact.potential import energy_of_pairs, evaluate, unit_energies
from gossamer_fx.mechanics.contact.stiffness_adjoint import StiffnessAdjoint, closing_derivatives


class ContactGradient:
    """Derivatives of the forces and of the energy of one contact, in the present step.

    Args:
        contact_set: whose pairs, points and stiffness are read.
    """

    def __init__(self, contact_set: ContactSet) -> None:
        self._set = contact_set
        self._system = contact_set.system
        self._comm = contact_set.system.comm
        self._points = contact_set.points
        self._friction = contact_set.friction
        self._stiffness = contact_set.pair_stiffness
        # Weight of the end of a step in the configuration where forces act: 1 in an equilibrium.
        self._alpha = contact_set.system.rule.alpha
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
        collective.

        It is friction, how the force of a pair depends on the origin of its vectors, and the
        stiffness that pairs derive from their closing speed.

        Args:
            μ: vector of the system with the adjoint displacements, one for each unknown.
            by_position, by_velocity: vectors of the system to which the products with respect to
                the start positions q0 and velocities v0 are added.
        """
        contact_set = self._set
        on_points = self._on_points(μ)
        found = np.zeros((self._points.count, 3))
        if contact_set.pairs is not None:
            x0 = contact_set.x0
            x1 = contact_set.end_points()
            add_product_through_origins(
                pairs=contact_set.pairs,
                x0=x0,
                x1=x1,
                law=contact_set.law,
                alpha=self._alpha,
                μ=on_points,
                found=found,
            )
            if self._friction is not None:
                self._friction.add_product_with_start_derivative(x0, x1, on_points, found)
        if self._stiffness_adjoint is not None:
            rates = np.zeros((self._points.count, 3))
            self._add_product_through_stiffness(on_points, found, rates)
            self._points.add(rates, by_velocity)
        self._points.add(found, by_position)

    def _add_product_through_stiffness(self, μ: Array, found: Array, rates: Array) -> None:
        """Add the part of (∂f/∂q0)ᵀ μ and (∂f/∂v0)ᵀ μ that the derived stiffness of pairs gives;
        collective.

        f are the contact forces [N] of the step from q0 with the velocities v0.

        Args:
            μ: adjoint displacements (m, 3) of the points that this rank knows.
            found, rates: (m, 3), to which the products with respect to positions and velocities of
                the points at the start are added.
        """
        adjoint = self._stiffness_adjoint
        pairs = self._set.pairs
        assert adjoint is not None and pairs is not None
        x0 = self._set.x0
        x1 = self._set.end_points()
        response = evaluate(
            pairs,
            x0,
            x1,
            self._set.law,
            self._alpha,
            by_pair=True,
            push_back=self._set.forces.push_back,
        )
        forces = np.asarray(response.forces).reshape(-1, 4, 3)
        work = np.einsum("nkc,nkc->n", forces, μ[pairs.points])
        if self._friction is not None:
            # Friction is proportional to the normal force of its pair.
            identifier, of_friction = self._friction.works(x0, x1, μ)
            order = np.argsort(pairs.identifier)
            row = order[np.searchsorted(pairs.identifier[order], identifier)]
            np.add.at(work, row, of_friction)
        # Forces are proportional to the stiffness k of their pair: μ·∂f/∂k = μ·f/k.
        adjoint.add(pairs.identifier, work / pairs.stiffness)
        # Pairs without energy at the start chose their stiffness in this step.
        had_energy, _ = self._set.history.stiffness_of(pairs.identifier)
        new = pairs.rows(~had_energy)
        by_stiffness = adjoint.take(new.identifier)
        sides = np.column_stack([new.points[:, 0], new.second_point])
        adjoint.add_densities(self._set.mesh.body[sides], by_stiffness, new.stiffness)
        system = self._system
        by_position, by_velocity = closing_derivatives(
            pairs=new,
            x0=x0,
            v=self._points.rates(system.v0, system.time, system.h),
            by_stiffness=by_stiffness,
            reference_speed=self._set.history.reference_speed,
            step=system.h,
        )
        np.add.at(found, new.points, by_position)
        np.add.at(rates, new.points, by_velocity)

    def add_energy_by_stiffness(self, share: float) -> None:
        """Add a share of the derivative of the energy at q0 by the derived stiffness of pairs;
        collective.

        Nothing happens where the stiffness is given as a number.

        Args:
            share: factor [-] of the derivative, that of the energy in the objective.
        """
        if self._stiffness_adjoint is None:
            return
        self._set.stored_energy()
        pairs = self._set.pairs_with_energy()
        _, scaled = energy_of_pairs(pairs, self._set.x0, self._set.law)
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
        """Return w·∂r/∂c [J] by the coefficient c of friction, this rank's share; collective.

        Args:
            w: vector of the system, one number for each unknown, by which the residual r is
                multiplied.
        """
        on_points = self._on_points(w)
        if self._friction is None or self._set.pairs is None:
            return 0.0
        return self._friction.work_by_coefficient(self._set.x0, self._set.end_points(), on_points)

    def work_by_stiffness(self, w: PETSc.Vec) -> float:
        """Return w·∂r/∂K [m³] by the given stiffness K, this rank's share; collective.

        All forces are proportional to it, those of friction included.

        r is the residual of the system. The forces of the pairs are computed again, so that
        `StepForces.point_forces` changes; without pairs the result is zero.

        Args:
            w: vector of the system, one number for each unknown, by which the residual is
                multiplied.

        Raises:
            AssertionError: the stiffness is derived from closing speeds, not given.
        """
        assert self._stiffness.given is not None, "only a given stiffness is a parameter"
        on_points = self._on_points(w)
        if self._set.pairs is None:
            return 0.0
        forces = self._set.forces
        forces.compute(self._set.x0, self._set.end_points())
        return float(np.sum(on_points * forces.point_forces)) / self._stiffness.given

    def energy_by_stiffness(self) -> float:
        """Return ∂ψ/∂K [m³] of the energy ψ at q0 by the given stiffness K, this rank's share."""
        assert self._stiffness.given is not None, "only a given stiffness is a parameter"
        return self._set.stored_energy() / self._stiffness.given

    def _on_points(self, w: PETSc.Vec) -> Array:
        """Return a displacement w of the system at the points (m, 3); collective."""
        return np.asarray(self._points.weights @ self._points.of_block_rows(w))
