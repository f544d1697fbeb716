"""Accelerations of the masses at points: of bodies without mesh, and of tapes on a film."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.algebra.numbering import GlobalIndices
from gossamer_fx.core.algebra.point_measures import (
    Gather,
    add_blocks,
    attach_all,
    evaluated_here,
    translation_weight,
)
from gossamer_fx.core.model.body import Array, Body
from gossamer_fx.core.model.terms import Parameter
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
)
from gossamer_fx.mechanics.terms.rows import AttachedKineticEnergy, AttachedMasses

# The number of a load by which results can be derived.
ACCELERATION = "acceleration"


def _of_vectors(mass: Array) -> Array:
    """Masses (n, k, k) [kg] of k points as matrices (n, 3k, 3k) by their components."""
    n, k, _ = mass.shape
    return np.einsum("nij,ab->niajb", mass, np.eye(3)).reshape(n, 3 * k, 3 * k)


class AttachedLoads(Differentiable, CompiledTerms["AttachedLoad"]):
    """All `AttachedLoad` terms of a scene: forces M (a + A (X - c)) on the attached vectors X of
    masses M."""

    is_external_load = True
    forces_are_forms = True
    has_shape_derivative = True

    def __init__(self, terms: Sequence[AttachedLoad], system: Assembly) -> None:
        self._system = system
        # New accelerations a of loads, by the identity of the term.
        self._accelerations: dict[int, Array] = {}
        # For each pair of a load and a kinetic energy with masses on its body, in the symbols of
        # `_add`: the load and the weights of positions in the ports (n, k); the kinetic energy and
        # which ports are on the body (n, k); P, offsets, M and A; global indices of the unknowns of
        # P; and a.
        self._loads: list[tuple[AttachedLoad, Array]] = []
        self._attached: list[tuple[AttachedKineticEnergy, Array]] = []
        self._masses: list[tuple[Array, Array, Array, Array]] = []
        self._indices: list[GlobalIndices] = []
        self._constant: list[Array] = []
        for term in terms:
            for masses in system.terms:
                if isinstance(masses, AttachedKineticEnergy):
                    self._add(term, masses, system)
        # Set by the first step; the shapes have to be right before it.
        self._X0: list[Array] = [np.zeros(constant.shape) for constant in self._constant]
        self._gather = Gather(system.numbering, self._indices) if self._indices else None

    def _add(self, term: AttachedLoad, masses: AttachedKineticEnergy, system: Assembly) -> None:
        """Prepare the acceleration a + A (x - c) of a body as a load on these masses; nothing if
        none of them is attached to the body.

        In the code P and o give the k attached vectors (3k,) of a tuple from its coordinates, as P
        q + o; M (n, 3k, 3k) [kg] are the masses, A (n, 3k, 3k) [1/s²] and a (n, 3k) [m/s²] the
        acceleration of these vectors.  n counts the tuples that this rank evaluates.
        """
        if not any(port.body is term.body for place in masses.ports for port in place):
            return
        # Each tuple of ports is evaluated on one rank, so that its load counts once.
        own = evaluated_here(masses.ports)
        k = masses.mass.shape[1]
        n = len(own)
        tuples = [masses.ports[i] for i in own]
        indices, P, o = attach_all(system.numbering, system.bodies, tuples, 3 * k)
        # The weight of the body's positions in each port: a director has no weight.
        points = np.array([[translation_weight(port) for port in ports] for ports in tuples])
        points = points.reshape(n, k)
        # A tuple may have ports of several bodies; the load acts on those of this one.
        is_on_body = np.array([[port.body is term.body for port in ports] for ports in tuples])
        is_on_body = is_on_body.reshape(n, k)
        M = _of_vectors(masses.mass[own])
        A = np.einsum("nj,ij,ab->niajb", is_on_body * 1.0, np.eye(k), term.gradient)
        A = A.reshape(n, 3 * k, 3 * k)
        self._loads.append((term, points))
        self._attached.append((masses, is_on_body))
        self._masses.append((P, o, M, A))
        self._indices.append(indices)
        self._constant.append(self._acceleration(len(self._loads) - 1))

    def _acceleration(self, pair: int) -> Array:
        """a (n, 3k) [m/s²] of a pair of a load and a kinetic energy."""
        term, points = self._loads[pair]
        _, is_on_body = self._attached[pair]
        # a + A (x - c) = (a - A c) + A x
        at_origin = self.get_number(term, ACCELERATION) - term.gradient @ term.centre
        n, k = points.shape
        return ((is_on_body * points)[:, :, None] * at_origin).reshape(n, 3 * k)

    def _vectors(self, q: PETSc.Vec) -> list[Array]:
        """Attached vectors (n, 3k) of each term at unknowns q.  Collective."""
        if self._gather is None:
            return []
        pairs = zip(self._masses, self._gather(q), strict=True)
        return [np.einsum("nax,nx->na", P, values) + o for (P, o, _, _), values in pairs]

    def _forces(self) -> list[tuple[Array, Array]]:
        """Vectors X (n, 3k) where forces of the step act, and forces M (a + A X) (n, 3k) [N], for
        directors [N m], of each pair of a load and a kinetic energy.  Collective.

        X is at (1 - α) X0 + α X1, α the weight of the end of the step: ½ is its middle, 1 its end.
        The force is linear in X, so the work of the step is exact.  A and a are zero for ports of
        other bodies, a also for directors.
        """
        α = self._system.rule.alpha
        found: list[tuple[Array, Array]] = []
        X1_of_all = self._vectors(self._system.q1)
        groups = zip(self._masses, self._constant, self._X0, X1_of_all, strict=True)
        for (_, _, M, A), a, X0, X1 in groups:
            X = (1 - α) * X0 + α * X1
            acceleration = a + np.einsum("nab,nb->na", A, X)
            found.append((X, np.einsum("nab,nb->na", M, acceleration)))
        return found

    def begin_step(self, t: float) -> None:
        self._X0 = self._vectors(self._system.q0)

    def add_forces(self, r: PETSc.Vec) -> None:
        groups = zip(self._masses, self._indices, self._forces(), strict=True)
        for (P, _, _, _), indices, (_, F) in groups:
            force = -np.einsum("nax,na->nx", P, F)
            r.setValues(indices.ravel(), force.ravel(), addv=PETSc.InsertMode.ADD_VALUES)
        if self._masses:
            r.assemble()

    def add_tangents(self, A: PETSc.Mat) -> None:
        α = self._system.rule.alpha
        for (P, _, M, gradient), indices in zip(self._masses, self._indices, strict=True):
            # Zero for gravity, whose acceleration is the same everywhere.
            if gradient.any():
                K = -α * np.einsum("nax,nab,nbc,ncy->nxy", P, M, gradient, P, optimize=True)
                add_blocks(A, indices, indices, K)

    def get_number(self, term: AttachedLoad, key: str) -> Array:
        return self._accelerations.get(id(term), term.acceleration)

    def set_number(self, term: AttachedLoad, key: str, value: Array) -> None:
        self._accelerations[id(term)] = np.array(value, dtype=float)
        for pair, (load, _) in enumerate(self._loads):
            if load is term:
                self._constant[pair] = self._acceleration(pair)

    def work_by_number(self, term: AttachedLoad, key: str, w: PETSc.Vec) -> Array:
        works = np.zeros(3)
        pairs = zip(self._loads, self._attached, self._masses, self._along(w), strict=True)
        for (load, points), (_, is_on_body), (_, _, M, _), along in pairs:
            if load is term:
                force = np.einsum("nab,na->nb", M, along).reshape(*points.shape, 3)
                works -= np.einsum("nk,nki->i", is_on_body * points, force)
        return works

    def work_on_masses(self, masses: AttachedKineticEnergy, w: PETSc.Vec) -> float:
        work = 0.0
        pairs = zip(self._attached, self._forces(), self._along(w), strict=True)
        for (attached, _), (_, F), along in pairs:
            if attached is masses:
                work -= float(np.sum(F * along))
        return work

    def _along(self, w: PETSc.Vec) -> list[Array]:
        """Displacements (n, 3k) of the attached vectors of each pair, under displacements w of the
        unknowns.  Collective."""
        if self._gather is None:
            return []
        pairs = zip(self._masses, self._gather(w), strict=True)
        return [np.einsum("nax,nx->na", P, values) for (P, _, _, _), values in pairs]

    def masses_changed(self) -> None:
        kinds = [one for one in self._system.compiled if isinstance(one, AttachedMasses)]
        for pair, (masses, _) in enumerate(self._attached):
            P, o, _, A = self._masses[pair]
            own = evaluated_here(masses.ports)
            self._masses[pair] = P, o, _of_vectors(kinds[0].mass_of(masses)[own]), A

    def supplied(self) -> float:
        """Work [J] of the forces in the step, this rank's share.  Collective."""
        ends = zip(self._forces(), self._X0, self._vectors(self._system.q1), strict=True)
        return sum(float(np.sum(F * (X1 - X0))) for (_, F), X0, X1 in ends)

    def resultants(self) -> dict[str, Array]:
        """Force [N] and moment [N m] about the origin, (2, 3), by the name of the load, this rank's
        share.  Collective."""
        found: dict[str, Array] = {}
        for (term, points), (X, F) in zip(self._loads, self._forces(), strict=True):
            f = F.reshape(*points.shape, 3)
            torque = np.cross(X.reshape(f.shape), f).sum(axis=(0, 1))
            # A force on a director is a couple: it has a moment, but pushes no point.
            total = np.array([np.einsum("nk,nki->i", points, f), torque])
            found[term.name] = found.get(term.name, 0.0) + total
        return found


@dataclass(frozen=True, eq=False)
class AttachedLoad:
    """Acceleration a + A (x - c) of a body's masses at points, also of those that other parts
    attach to it: a, c (3,), A (3, 3).  `parameters` may name `ACCELERATION`, a."""

    name: str
    body: Body
    acceleration: Array
    gradient: Array
    centre: Array
    parameters: tuple[Parameter, ...] = ()
    compiler: ClassVar[Compiler] = AttachedLoads
