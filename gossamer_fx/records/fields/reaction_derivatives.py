"""Derivatives of the forces of supports, joints and connectors in an equilibrium.

Supports.  A component J of the force or moment of a support is J = w·r, with the residual r of the
coordinates that it holds and weights w that are a translation or a rotation there.  Hence

    ∂J/∂q = Kᵀ w + ∂w/∂q r,    ∂J/∂θ = w·∂r/∂θ                                                  (1)

with the tangent K that has the rows of held coordinates.

Joints and connectors.  With the measures e(X) of the vectors X = P q + o, their stresses or
multipliers S and the displacements c of the ports in that translation or rotation,

    J = -Σ S·De(X) c,    ∂J/∂q = -Pᵀ(S·D²e c + (De c)·dS/de De + ...),                           (2)

the dots being the change of c in a rotation.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.algebra.point_measures import (
    Gather,
    attach,
    evaluated_here,
    translation_weight,
)
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.lookups import check_no_contact
from gossamer_fx.core.model.body import Array, Port, Vector
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint, multiplier_rows
from gossamer_fx.mechanics.terms.rows import CompiledRows, Rows
from gossamer_fx.records.fields.reactions import GroundForce, owned_coordinates
from gossamer_fx.solve.system.system import System


class ReactionDerivative:
    """Derivatives of one component of the force [N], or moment [N m] about a point, of an item.

    Args:
        system: of the scene, at rest.
        force: of the item.
        direction: unit vector (3,) of the component.
        about: point (3,) [m] of the moment; None: a force.

    Raises:
        InputError: in a run; a scene with contact; the moment of a plate's clamped edge.

    All methods are collective.
    """

    def __init__(
        self, system: System, force: GroundForce, direction: Array, about: Vector | None
    ) -> None:
        check(
            system.unknowns.rule.is_static,
            "Reaction: it has derivatives in an equilibrium only; ask for that of an Equilibrium.",
        )
        check_no_contact(system, "Reaction", "with which its reactions have no derivative")
        check(
            about is None or not force.clamps,
            "Reaction: the moment of the clamped edge of a plate has no derivative; ask for its "
            "force, or for moments of other supports.",
        )
        self._system = system
        self._force = force
        self._direction = direction
        self._about = None if about is None else np.asarray(about, dtype=float)

    # ---- supports --------------------------------------------------------------------------------

    def residual_weights(self) -> PETSc.Vec:
        """w of (1), a new vector; zero without supports."""
        weights = self._system.unknowns.numbering.vector()
        for term, shares in self._force.support_shares():
            mine = owned_coordinates(self._system, term)
            owned = self._system.unknowns.block(term.body).owned
            motion = self._motion(self._system.unknowns.q0.array_r[owned], term.body)
            whole = np.zeros(weights.local_size)
            whole[owned] = motion.ravel()
            weights.array[mine] += whole[mine] * shares[mine]
        return weights

    def _motion(self, coordinates: Array, body: Any) -> Array:
        """Translation or rotation (nodes, vectors, 3) of all vectors of a body."""
        vectors = coordinates.reshape(-1, body.block.size // 3, 3).copy()
        if self._about is None:
            motion = np.zeros_like(vectors)
            motion[:, 0] = self._direction
            return motion
        vectors[:, 0] -= self._about
        return np.cross(self._direction, vectors)

    def add(self, by_position: PETSc.Vec) -> None:
        """Add ∂J/∂q of (1) and (2)."""
        system = self._system
        weights = self.residual_weights()
        if weights.norm() > 0:
            system.equations.set_end(system.unknowns.q0)
            system.equations.set_inertia(0.0)
            product = weights.duplicate()
            system.matrices.tangent_with_supports().multTranspose(weights, product)
            by_position.axpy(1.0, product)
            # Others hold the matrix, which is that of free coordinates again.
            system.matrices.assemble_tangent()
            product.destroy()
        weights.destroy()
        if self._about is not None:
            self._add_arms(by_position)
        for compiled, term in self._measures():
            self._add_measure(by_position, compiled, term)
        by_position.assemble()

    def _add_arms(self, by_position: PETSc.Vec) -> None:
        """Add ∂w/∂q r: free components of the arms of held ones."""
        reactions = self._system.unknowns.supports.forces
        assert reactions is not None or not list(self._force.support_shares())
        for term, shares in self._force.support_shares():
            assert reactions is not None
            mine = owned_coordinates(self._system, term)
            owned = self._system.unknowns.block(term.body).owned
            whole = np.zeros(by_position.local_size)
            whole[mine] = reactions.array_r[mine] * shares[mine]
            forces = whole[owned].reshape(-1, 3)
            by_position.array[owned] += np.cross(forces, self._direction).ravel()

    def add_scalars(self, by_scalars: Array) -> None:
        """Add w·∂r/∂y by the scalar unknowns y, such as pressures of gas."""
        weights = self.residual_weights()
        for scalars, part in self._system.matrices.scalars:
            columns, _, _ = scalars.coupling()
            own = np.zeros(len(columns))
            for k, column in enumerate(columns):
                if column is not None:
                    own[k] = float(column @ weights.array_r)
            by_scalars[part] += self._system.comm.allreduce(own)
        weights.destroy()

    # ---- joints and connectors -------------------------------------------------------------------

    def _measures(self) -> Iterator[tuple[Any, Any]]:
        """Joints and connectors with their compiled kinds."""
        for term in (*self._force.constraints, *self._force.connectors):
            [compiled] = self._system.equations.compiled_as(term.compiler)
            yield compiled, term

    def _add_measure(self, by_position: PETSc.Vec, compiled: Any, term: Any) -> None:
        """Add ∂J/∂q of a joint or connector, and ∂J/∂λ by the multipliers of a joint."""
        measure = term.measure
        rows = multiplier_rows(term, self._system.unknowns) if is_joint(term) else None
        slopes = None if rows is not None else compiled.stress_slopes(term)
        stresses = self._force.stresses_of(term)
        for i, (ports, indices, P, X) in enumerate(self._tuples(measure)):
            De = measure.H @ X + measure.L
            c, turn = self._displacements(ports, X)
            S = stresses[i]
            by_X = -np.einsum("m,mab,b->a", S, measure.H, c)
            # The displacements of a rotation are linear in X.
            by_X -= turn.T @ (S @ De)
            by_stress = -De @ c
            if rows is not None:
                by_position.setValues(rows[i], by_stress, addv=PETSc.InsertMode.ADD_VALUES)
            else:
                assert slopes is not None
                by_X += (by_stress @ slopes[i]) @ De
            by_position.setValues(indices, by_X @ P, addv=PETSc.InsertMode.ADD_VALUES)

    def _tuples(self, measure: Any) -> Iterator[tuple[Any, Any, Array, Array]]:
        """Ports, global indices of their unknowns, P and X of each tuple that this rank
        evaluates."""
        unknowns = self._system.unknowns
        own = [measure.ports[i] for i in evaluated_here(measure.ports)]
        attached = [attach(unknowns.numbering, unknowns.bodies, ports) for ports in own]
        gather = Gather(unknowns.numbering, [indices for indices, _, _ in attached])
        for ports, (indices, P, o), q in zip(own, attached, gather(unknowns.q0), strict=True):
            yield ports, indices, P, P @ q + o

    def _displacements(self, ports: Any, X: Array) -> tuple[Array, Array]:
        """Displacements c (3k,) of ports in the translation or rotation, zero of those that do not
        count, and their derivatives (3k, 3k) by X."""
        c = np.zeros(len(X))
        turn = np.zeros((len(X), len(X)))
        for k, port in enumerate(ports):
            if not (isinstance(port, Port) and self._force.is_counted(port)):
                continue
            weight = translation_weight(port)
            at = slice(3 * k, 3 * k + 3)
            if self._about is None:
                c[at] = weight * self._direction
                continue
            c[at] = np.cross(self._direction, X[at] - weight * self._about)
            turn[at, at] = np.cross(self._direction, np.eye(3)).T
        return c, turn

    def by_number(self, compiled: Any, term: Any, key: str) -> float:
        """∂J/∂number of a term at given coordinates, this rank's share; zero of other items."""
        if all(term is not own for own in self._force.connectors):
            return 0.0
        assert isinstance(compiled, CompiledRows) and isinstance(term, Rows)
        changes = compiled.stress_by_number(term, key)
        total = 0.0
        for i, (ports, _, _, X) in enumerate(self._tuples(term.measure)):
            De = term.measure.H @ X + term.measure.L
            c, _ = self._displacements(ports, X)
            total -= float(changes[i] @ (De @ c))
        return total


def is_joint(term: Any) -> bool:
    """Whether a term holds by multipliers."""
    return isinstance(term, PointConstraint)
