"""Derivatives of integrals with respect to what they depend on: constants, fields, positions of
mesh nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx.mesh import Mesh
from ufl.algorithms.analysis import extract_constants

from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.model.body import Array


class MeshNodes:
    """The positions of the nodes of a mesh [m], as a function of a space on the same mesh."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        degree = mesh.geometry.cmap.degree
        self.space = fem.functionspace(mesh, ("Lagrange", degree, (3,)))
        # For each node of the space the row of the mesh's array of positions.
        self._row = np.zeros(self._count, dtype=np.int64)
        self._row[self.space.dofmap.list.ravel()] = mesh.geometry.dofmap.ravel()

    @property
    def _count(self) -> int:
        nodes = self.space.dofmap.index_map
        return int(nodes.size_local + nodes.num_ghosts)

    def get(self) -> Array:
        """Positions (k,) of the owned nodes, flattened."""
        owned = self.space.dofmap.index_map.size_local
        positions: Array = self.mesh.geometry.x[self._row[:owned]]
        return positions.ravel()

    def set(self, values: Array) -> None:
        """Move the owned nodes to positions (k,), and their ghosts with them.  Collective."""
        moved = fem.Function(self.space)
        moved.x.array[: len(values)] = values
        moved.x.scatter_forward()
        self.mesh.geometry.x[self._row] = moved.x.array.reshape(-1, 3)


Coefficient = fem.Constant | fem.Function | MeshNodes


def depends_on(form: ufl.Form, coefficient: Coefficient) -> bool:
    """Whether a form contains a coefficient; every form depends on the nodes of its mesh."""
    if isinstance(coefficient, MeshNodes):
        return bool(form.ufl_domain().ufl_cargo() is coefficient.mesh._cpp_object)
    if isinstance(coefficient, fem.Constant):
        return any(constant is coefficient for constant in extract_constants(form))
    return any(function is coefficient for function in form.coefficients())


class FormDerivative:
    """The derivative of a sum of integrals with respect to one coefficient, a constant, a function
    or the nodes of the mesh, compiled.

    A constant is replaced by a function that is constant in each cell, of which the derivatives are
    added up: UFL takes derivatives with respect to functions only.
    """

    def __init__(self, forms: Sequence[ufl.Form], coefficient: Coefficient) -> None:
        self._coefficient = coefficient
        self._stand_in: fem.Function | None = None
        self._forms: list[fem.Form] = []
        concerned = [form for form in forms if depends_on(form, coefficient)]
        if not concerned:
            return
        variable: Any = coefficient
        if isinstance(coefficient, MeshNodes):
            space = coefficient.space
            variable = ufl.SpatialCoordinate(coefficient.mesh)
        elif isinstance(coefficient, fem.Constant):
            space = fem.functionspace(
                _mesh_of(concerned), ("Discontinuous Lagrange", 0, coefficient.ufl_shape)
            )
            variable = self._stand_in = fem.Function(space)
            concerned = [ufl.replace(form, {coefficient: variable}) for form in concerned]
        else:
            space = coefficient.function_space
        # Each form by itself: of a sum of forms with different quadrature the derivative by the
        # nodes of the mesh was wrong by some 1e-3 with UFL 2024.2.
        test = ufl.TestFunction(space)
        self._forms = [compile_form(ufl.derivative(form, variable, test)) for form in concerned]
        self._vector = la.vector(space.dofmap.index_map, space.dofmap.index_map_bs)
        self._owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs

    def assemble(self) -> Array:
        """The derivative: for a field (k,) of this rank's unknowns; for a constant this rank's
        share (k,)."""
        if not self._forms:
            return np.zeros(size_of(self._coefficient))
        components = 1
        if self._stand_in is not None and isinstance(self._coefficient, fem.Constant):
            values = np.ravel(self._coefficient.value)
            components = len(values)
            self._stand_in.x.array.reshape(-1, components)[:] = values
        self._vector.array[:] = 0
        for form in self._forms:
            fem.assemble_vector(self._vector.array, form)
        self._vector.scatter_reverse(la.InsertMode.add)
        owned: Array = self._vector.array[: self._owned].copy()
        if self._stand_in is not None:
            share: Array = owned.reshape(-1, components).sum(axis=0)
            return share
        return owned


def size_of(coefficient: Coefficient) -> int:
    """Number of values of a coefficient on this rank."""
    if isinstance(coefficient, MeshNodes):
        return len(coefficient.get())
    if isinstance(coefficient, fem.Constant):
        return int(np.size(coefficient.value))
    dofs = coefficient.function_space.dofmap
    return int(dofs.index_map.size_local * dofs.index_map_bs)


def _mesh_of(forms: Sequence[ufl.Form]) -> Mesh:
    """The mesh of forms, as dolfinx's object; each form of a scene depends on coordinates of a
    body."""
    for form in forms:
        for function in form.coefficients():
            return function.function_space.mesh
    raise ValueError("a form without coefficients has no mesh")
