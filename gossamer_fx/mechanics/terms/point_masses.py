"""Kinetic energy of vectors that are attached to bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.algebra.point_measures import add_blocks, attach_all, evaluated_here
from gossamer_fx.core.model.body import Array, Port
from gossamer_fx.mechanics.terms.assembly import (
    Assembly,
    CompiledTerms,
    Compiler,
    Differentiable,
)


class AttachedMasses(Differentiable, CompiledTerms["AttachedKineticEnergy"]):
    """All `AttachedKineticEnergy` terms of a scene."""

    forces_are_forms = True
    has_shape_derivative = True

    def __init__(self, terms: Sequence[AttachedKineticEnergy], system: Assembly) -> None:
        self._terms = terms
        self._system = system

    def add_mass(self, M: PETSc.Mat) -> None:
        self._add(M, np.eye(3))

    def add_gyroscopic(self, G: PETSc.Mat, spin: tuple[float, float, float]) -> None:
        """Add the matrix 2 w·M (spin × v) of a frame that turns with `spin` (3,) [rad/s] to G."""
        cross = np.cross(np.eye(3), np.asarray(spin))
        self._add(G, 2 * cross)

    def _add(self, matrix: PETSc.Mat, each: Array) -> None:
        """Add Σ_ij mass[i, j] w_i·(each v_j) of all terms to a matrix, v and w rates of attached
        vectors.

        Args:
            each: (3, 3), the same for all vectors: the unit matrix [-] for masses, or twice the
                matrix of a cross product with an angular velocity [rad/s] for the Coriolis force.
        """
        for term in self._terms:
            # Each tuple is added on one rank; the matrix adds up what ranks share.  The attached
            # vectors are P q (n tuples) of unknowns q.
            own = evaluated_here(term.ports)
            n = len(own)
            rows = 3 * term.mass.shape[1]
            tuples = [term.ports[i] for i in own]
            # Offsets of the ground are not needed: it has no velocity.
            indices, P, _ = attach_all(
                numbering=self._system.numbering,
                bodies=self._system.bodies,
                tuples=tuples,
                rows=rows,
            )
            of_vectors = np.einsum("nij,ab->niajb", term.mass[own], each)
            mass = of_vectors.reshape(n, rows, rows)
            of_unknowns = np.einsum("nax,nab,nby->nxy", P, mass, P, optimize=True)
            add_blocks(matrix, indices, indices, of_unknowns)


@dataclass(frozen=True, eq=False)
class AttachedKineticEnergy:
    """Kinetic energy ½ Σ_ij mass[i, j] v_i·v_j of the rates v of attached vectors.

    Args:
        ports: n tuples of k ports, as those of a `PointMeasure`.
        mass: (n, k, k) [kg] for points; kg m and kg m² where directors take part.
    """

    ports: Sequence[tuple[Port, ...]]
    mass: Array
    compiler: ClassVar[Compiler] = AttachedMasses
