"""Kinetic energy of vectors that are attached to bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from petsc4py import PETSc

from gossamer_fx.algebra.point_measures import add_blocks, attach_all, evaluated_here
from gossamer_fx.model.body import Array, Port
from gossamer_fx.model.roles import Mass
from gossamer_fx.terms.assembly import Assembly, CompiledTerms, Compiler


class AttachedMasses(Mass, CompiledTerms["AttachedKineticEnergy"]):
    """All `AttachedKineticEnergy` terms of a scene."""

    def __init__(self, terms: Sequence[AttachedKineticEnergy], system: Assembly) -> None:
        self._terms, self._system = terms, system

    def add_mass(self, M: PETSc.Mat) -> None:
        self._add(M, np.eye(3))

    def add_gyroscopic(self, G: PETSc.Mat, spin: tuple[float, float, float]) -> None:
        self._add(G, 2 * np.cross(np.eye(3), np.asarray(spin)))

    def _add(self, matrix: PETSc.Mat, each: Array) -> None:
        """Add Σ_ij mass[i, j] w_i·(each v_j)."""
        for term in self._terms:
            own = evaluated_here(term.ports)
            k = term.mass.shape[1]
            tuples = [term.ports[i] for i in own]
            indices, P, _ = attach_all(self._system.numbering, self._system.bodies, tuples, 3 * k)
            mass = np.einsum("nij,ab->niajb", term.mass[own], each).reshape(len(own), 3 * k, 3 * k)
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
