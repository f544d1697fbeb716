"""The mass matrix of a scene, and what it makes of a turning frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc

from gossamer_fx.algebra.numbering import GlobalIndices, Numbering
from gossamer_fx.algebra.places import add_mass
from gossamer_fx.forms.compilation import compile_form
from gossamer_fx.model.terms import Array, AttachedKineticEnergy, Body, KineticEnergy, NodeKineticEnergy, Term
from gossamer_fx.terms.discrete_gradient import Coordinates


class Masses:
    """All kinetic parts of a scene."""

    def __init__(
        self, numbering: Numbering, bodies: list[Body], fields: dict[int, Coordinates], parts: Iterable[Term]
    ) -> None:
        self._numbering, self._bodies, self._fields = numbering, bodies, fields
        parts = list(parts)
        self._on_meshes = [(bodies.index(p.body), p) for p in parts if isinstance(p, KineticEnergy)]
        self._points = [(bodies.index(p.body), p) for p in parts if isinstance(p, NodeKineticEnergy)]
        self._attached = [p for p in parts if isinstance(p, AttachedKineticEnergy)]

    @property
    def at_points(self) -> bool:
        """Whether there are others than those of meshes."""
        return bool(self._points or self._attached)

    def add(self, M: PETSc.Mat) -> None:
        """Add the mass matrix to M."""
        for k in self._fields:
            self._numbering.assemble(M, k, self.forms(k))
        for rows, mass in self._nodes():
            M.setValues(rows, rows, np.kron(mass, np.eye(3)), addv=PETSc.InsertMode.ADD_VALUES)
        for attached in self._attached:
            add_mass(M, self._numbering, self._bodies, attached)

    def forms(self, k: int) -> list[fem.Form]:
        """The bilinear forms of the mass of body k, which is on a mesh."""
        at = self._fields[k]
        return [compile_form(part.mass(at.dq, at.w)) for j, part in self._on_meshes if j == k]

    def gyroscopic(self, G: PETSc.Mat, spin: tuple[float, float, float]) -> None:
        """Add the matrix of the Coriolis force 2 M (ω×v) in a frame that turns with ω = `spin` [rad/s]."""
        for k, part in self._on_meshes:
            at = self._fields[k]
            ω = fem.Constant(at.q0.function_space.mesh, tuple(float(c) for c in spin))
            v = [ufl.cross(ω, ufl.as_vector([at.dq[i + j] for j in range(3)])) for i in range(0, len(at.dq), 3)]
            turned = ufl.as_vector([vector[j] for vector in v for j in range(3)])
            self._numbering.assemble(G, k, [compile_form(2 * part.mass(turned, at.w))])
        for rows, mass in self._nodes():
            turned = np.kron(2 * mass, np.cross(np.eye(3), np.asarray(spin)))
            G.setValues(rows, rows, turned, addv=PETSc.InsertMode.ADD_VALUES)

    def _nodes(self) -> Iterator[tuple[GlobalIndices, Array]]:
        """Global indices and mass (s, s) of every owned node without mesh."""
        start = self._numbering.start
        for k, part in self._points:
            size = part.body.block.size
            for i in range(len(part.mass)):
                first = start + self._numbering.owned(k).start + i * size
                yield (first + np.arange(size)).astype(PETSc.IntType), part.mass[i]
