"""The variables of a gradient: parameters of a compiled scene, found by name, read and changed, and
the derivatives of the residual with respect to them.

With the adjoint vector μ the derivative of a result J by a parameter θ is

    dJ/dθ = ∂J/∂θ - Σ μ·∂r/∂θ,

summed over the steps of a run, or of the one equilibrium.  A `Variable` adds up this sum.  Where
the residual r consists of integrals, `FormDerivative` has their derivatives with respect to what
they depend on: constants, fields, positions of mesh nodes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx.mesh import Mesh
from petsc4py import PETSc

from gossamer_fx.core.checks.errors import InputError, check, check_on_all
from gossamer_fx.core.forms.backend import geometry_element, geometry_nodes
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.model.body import Array, Body, MeshBody, has_nodal_unknowns
from gossamer_fx.core.model.terms import MeasuresMesh, MeasuresStart, Parameter
from gossamer_fx.mechanics.bodies.meshed import Meshed
from gossamer_fx.mechanics.bodies.rigid_body import RigidBody
from gossamer_fx.mechanics.terms.assembly import Differentiable
from gossamer_fx.solve.system.system import System

if TYPE_CHECKING:
    # Scenes without gas do not load it.
    from gossamer_fx.mechanics.gas.adjoint import GasAdjoint


class MeshNodes:
    """The positions of the nodes of a mesh [m], as a function of a space on the same mesh."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        degree = geometry_element(mesh).degree
        self.space = fem.functionspace(mesh, ("Lagrange", degree, (3,)))
        # For each node of the space the row of the mesh's array of positions.
        self.rows = np.zeros(self._count, dtype=np.int64)
        self.rows[self.space.dofmap.list.ravel()] = geometry_nodes(mesh).ravel()

    @property
    def _count(self) -> int:
        """Number of nodes on this rank, ghosts included."""
        nodes = self.space.dofmap.index_map
        return int(nodes.size_local + nodes.num_ghosts)

    def get(self) -> Array:
        """Positions (3n,) [m] of the n owned nodes, node by node."""
        owned = self.space.dofmap.index_map.size_local
        positions: Array = self.mesh.geometry.x[self.rows[:owned]]
        return positions.ravel()

    def set(self, values: Array) -> None:
        """Move the owned nodes to positions (3n,) [m], and their ghosts with them.  Collective."""
        moved = fem.Function(self.space)
        moved.x.array[: len(values)] = values
        moved.x.scatter_forward()
        self.mesh.geometry.x[self.rows] = moved.x.array.reshape(-1, 3)


Coefficient = fem.Constant | fem.Function | MeshNodes


def depends_on(form: ufl.Form, coefficient: Coefficient) -> bool:
    """Whether a form contains a coefficient; every form depends on the nodes of its mesh."""
    if isinstance(coefficient, MeshNodes):
        return bool(form.ufl_domain().ufl_cargo() is coefficient.mesh._cpp_object)
    if isinstance(coefficient, fem.Constant):
        return any(constant is coefficient for constant in form.constants())
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
        """The derivative with the present values, zero if no form has the coefficient: for a field
        or nodes (k,) of this rank's unknowns; for a constant this rank's share (k,), which is to be
        added up over the ranks.  Collective."""
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
            return owned.reshape(-1, components).sum(axis=0)
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


# Names of variables that are not parameters of terms.
SHAPE = "shape"
INITIAL_VELOCITY = "initial_velocity"
INITIAL_POSITION = "initial_position"
SPIN = "spin"
VELOCITY = "velocity"


class AdjointFields:
    """An adjoint vector μ as functions on the meshes of bodies, which the derivatives of forms
    read; `inertia` has functions z, of which M z is the inertia of the step."""

    def __init__(self, system: System) -> None:
        self._system = system
        # Made at the first use: forms take longer to make than to derive, and all variables derive
        # the same ones.
        self._residual_forms: list[ufl.Form] | None = None
        self.of: dict[Body, fem.Function] = {}
        self.inertia: dict[Body, fem.Function] = {}
        for body in system.unknowns.bodies:
            if isinstance(body, MeshBody) and has_nodal_unknowns(body):
                self.of[body] = fem.Function(body.space)
                self.inertia[body] = fem.Function(body.space)

    def set(self, μ: PETSc.Vec) -> None:
        """Copy an adjoint vector to the functions, ghosts included.  Collective."""
        self._spread(μ, self.of)

    def set_inertia(self, z: PETSc.Vec) -> None:
        """Copy z [m/s²] to the functions, ghosts included.  Collective."""
        self._spread(z, self.inertia)

    def _spread(self, vector: PETSc.Vec, functions: dict[Body, fem.Function]) -> None:
        """Copy the part of a vector that belongs to each body to the function of the body."""
        for body, function in functions.items():
            owned = self._system.unknowns.block(body).owned
            self._system.unknowns.coordinates[body].take(function, vector.array_r[owned])

    def residual_forms(self) -> list[ufl.Form]:
        """μ·r of all forces that are forms.  Functions that are filled with values at quadrature
        points are replaced by their expressions, which depend on parameters, too."""
        if self._residual_forms is not None:
            return self._residual_forms
        expressions: dict[fem.Function, Any] = {}
        found = []
        for compiled in self._system.equations.differentiable:
            expressions.update(compiled.expressions())
            for body, μ in self.of.items():
                found += compiled.residual_forms(body, μ)
        if expressions:
            found = [ufl.replace(form, expressions) for form in found]
        self._residual_forms = found
        return found

    def inertia_forms(self) -> list[ufl.Form]:
        """μ·M z of all masses that are forms."""
        found = []
        for compiled in self._system.equations.differentiable:
            for body, μ in self.of.items():
                found += compiled.kinetic_forms(body, self.inertia[body], μ)
        return found


class Variable(ABC):
    """One variable "item.parameter" of a gradient, with its SI unit.  If it is distributed each
    rank has its own part of the values; otherwise all have all.

    `sum` (k,) is the derivative of the result by the values as far as it is added up; if the
    variable is not distributed, this rank's share of it.
    """

    name: str
    unit: str
    is_distributed: bool

    def __init__(self, name: str, unit: str, is_distributed: bool, size: int) -> None:
        self.name = name
        self.unit = unit
        self.is_distributed = is_distributed
        self.sum: Array = np.zeros(size)

    @abstractmethod
    def get(self) -> Array:
        """Present values (k,) of this rank."""

    def set(self, values: Array) -> None:
        """Give it other values (k,); `System.parameters_changed` is to be called then."""
        raise InputError(
            f"'{self.name}' belongs to the start of a run; make a scene with another one."
        )

    def start(self) -> None:
        """Begin a new sum."""
        self.sum[:] = 0

    def add_residual(self, μ: PETSc.Vec, with_inertia: bool) -> None:
        """Subtract μ·∂r/∂θ of the present step from the sum, `with_inertia` also that of the
        inertia M z; the `AdjointFields` have μ and z.  Nothing for variables of the start."""
        return

    def add_start(self, by_position: PETSc.Vec, by_velocity: PETSc.Vec) -> None:
        """Add what the derivatives of the result by the initial coordinates and velocities give;
        nothing for variables that the initial state does not depend on."""
        return

    def function(self, values: Array) -> fem.Function | None:
        """Values as a function that can be drawn; None if the variable is not a field."""
        return None


class FormVariable(Variable):
    """A coefficient of forms: a constant, a field, or the stress-free positions of mesh nodes."""

    def __init__(
        self,
        name: str,
        unit: str,
        coefficients: Sequence[Coefficient],
        adjoint: AdjointFields,
        points: PointVariable | None = None,
    ) -> None:
        """Compile the derivatives of the forces by each of the coefficients, which all have the
        same values; `points` are numbers of terms between points with these values, too, as the
        weight of a film also acts on masses that are attached to it."""
        first = coefficients[0]
        is_constant = isinstance(first, fem.Constant)
        super().__init__(name, unit, not is_constant, size_of(first))
        self.coefficients = list(coefficients)
        self._adjoint = adjoint
        forces = adjoint.residual_forms()
        self._forces = [FormDerivative(forces, one) for one in coefficients]
        self._inertia: list[FormDerivative] | None = None
        self._points = points

    def get(self) -> Array:
        first = self.coefficients[0]
        if isinstance(first, MeshNodes):
            return first.get()
        if isinstance(first, fem.Constant):
            return np.array(np.ravel(first.value), dtype=float)
        return first.x.array[: size_of(first)].copy()

    def set(self, values: Array) -> None:
        for one in self.coefficients:
            if isinstance(one, MeshNodes):
                one.set(values)
            elif isinstance(one, fem.Constant):
                one.value = values.reshape(one.ufl_shape)
            else:
                one.x.array[: len(values)] = values
                one.x.scatter_forward()
        if self._points is not None:
            self._points.set(values)

    def add_residual(self, μ: PETSc.Vec, with_inertia: bool) -> None:
        for derivative in self._forces:
            self.sum -= derivative.assemble()
        if with_inertia:
            self.sum -= self.inertia_derivative()
        if self._points is not None:
            self._points.start()
            self._points.add_residual(μ, with_inertia)
            self.sum += self._points.sum

    def inertia_derivative(self) -> Array:
        """∂(μ·M z)/∂θ (k,) of the vectors that the adjoint fields have; compiled at the first
        use."""
        if self._inertia is None:
            masses = self._adjoint.inertia_forms()
            self._inertia = [FormDerivative(masses, one) for one in self.coefficients]
        found = np.zeros(len(self.sum))
        for derivative in self._inertia:
            found += derivative.assemble()
        return found

    def function(self, values: Array) -> fem.Function | None:
        first = self.coefficients[0]
        if isinstance(first, fem.Constant):
            return None
        space = first.space if isinstance(first, MeshNodes) else first.function_space
        return _function(space, values)


class PointVariable(Variable):
    """Numbers of terms that are not forms: of springs, ropes, creases and point forces."""

    def __init__(
        self, name: str, unit: str, uses: Sequence[tuple[Differentiable, Any, Parameter]]
    ) -> None:
        """`uses` are the terms that have the parameter, each with its compiled kind.  A parameter
        is one number or vector of all terms, or has an entry for each term, e.g. each spring of an
        item; the variable has the values of all entries, one after the other."""
        self._uses = uses
        entries = [parameter.entry or 0 for _, _, parameter in uses]
        compiled, term, first = uses[0]
        self._width = len(compiled.get_number(term, str(first.source)))
        super().__init__(name, unit, False, (max(entries) + 1) * self._width)

    def _part(self, parameter: Parameter) -> slice:
        """The entries of the values that a parameter of a term has."""
        start = (parameter.entry or 0) * self._width
        return slice(start, start + self._width)

    def get(self) -> Array:
        values = np.zeros(len(self.sum))
        for compiled, term, parameter in self._uses:
            values[self._part(parameter)] = compiled.get_number(term, str(parameter.source))
        return values

    def set(self, values: Array) -> None:
        for compiled, term, parameter in self._uses:
            compiled.set_number(term, str(parameter.source), values[self._part(parameter)])

    def add_residual(self, μ: PETSc.Vec, with_inertia: bool) -> None:
        for compiled, term, parameter in self._uses:
            work = compiled.work_by_number(term, str(parameter.source), μ)
            self.sum[self._part(parameter)] -= work

    def add_inertia(self, v: PETSc.Vec, w: PETSc.Vec) -> None:
        """Add w·∂M/∂θ v of the masses of its terms, this rank's share.  Collective."""
        for compiled, term, parameter in self._uses:
            work = compiled.inertia_by_number(term, str(parameter.source), v, w)
            self.sum[self._part(parameter)] += work

    def add_by_number(self, derivative: Callable[[Any, Any, str], float]) -> None:
        """Add the derivatives of a result by the numbers of its terms, this rank's share, each from
        the compiled kind, the term and the key of the number."""
        for compiled, term, parameter in self._uses:
            self.sum[self._part(parameter)] += derivative(compiled, term, str(parameter.source))

    def energy_derivative(self) -> Array:
        """∂ψ/∂θ (k,) of the energies of its terms, this rank's share."""
        found = np.zeros(len(self.sum))
        for compiled, term, parameter in self._uses:
            found[self._part(parameter)] += compiled.energy_by_number(term, str(parameter.source))
        return found


class InitialVariable(Variable):
    """Coordinates or velocities of a body at the start of a run."""

    def __init__(self, name: str, body: Body, system: System, is_velocity: bool) -> None:
        """Take as many velocities [m/s] or coordinates [m] as this rank has unknowns of the
        body."""
        unit = "m/s" if is_velocity else "m"
        owned = system.unknowns.block(body).owned
        super().__init__(name, unit, True, owned.stop - owned.start)
        self._body = body
        self._owned = owned
        self._system = system
        self._is_velocity = is_velocity

    def get(self) -> Array:
        positions, velocities = self._body.initial_state()
        return np.array(velocities if self._is_velocity else positions, dtype=float)

    def add_start(self, by_position: PETSc.Vec, by_velocity: PETSc.Vec) -> None:
        vector = by_velocity if self._is_velocity else by_position
        self.sum += vector.array_r[self._owned]

    def function(self, values: Array) -> fem.Function | None:
        body = self._body
        if isinstance(body, MeshBody) and has_nodal_unknowns(body):
            return _function(body.space, values)
        return None


class RigidMotionVariable(Variable):
    """Velocity or angular velocity (3,) of a rigid body at the start of a run.  The body's director
    d has the velocity ω × d, so that dJ/dω = Σ d × dJ/dḋ."""

    def __init__(self, name: str, body: RigidBody, system: System) -> None:
        self._is_spin = name.rpartition(".")[2] == SPIN
        super().__init__(name, "rad/s" if self._is_spin else "m/s", False, 3)
        self._body = body
        self._system = system

    def get(self) -> Array:
        return np.array(self._body.spin if self._is_spin else self._body.velocity)

    def add_start(self, by_position: PETSc.Vec, by_velocity: PETSc.Vec) -> None:
        # Four vectors on the rank that owns the body, none on the others; ranks are added up.
        rates = by_velocity.array_r[self._system.unknowns.block(self._body).owned].reshape(-1, 4, 3)
        start = np.reshape(self._body.initial_state()[0], (-1, 4, 3))
        if self._is_spin:
            self.sum += np.cross(start[:, 1:], rates[:, 1:]).sum(axis=(0, 1))
        else:
            self.sum += rates[:, 0].sum(axis=0)


class ScalarVariable(Variable):
    """A number of scalar unknowns: of a chamber, an orifice, a wall or a reservoir of gas."""

    def __init__(self, name: str, adjoint: GasAdjoint, item: Any, system: System) -> None:
        """Take the unit of the parameter of a chamber, opening, wall or reservoir from the adjoint,
        which sums the derivative over the steps of a run."""
        self._what = name.rpartition(".")[2]
        self._item = item
        self._adjoint = adjoint
        self._is_first = system.comm.rank == 0
        super().__init__(name, adjoint.units[id(item), self._what], False, 1)

    def get(self) -> Array:
        return np.array([self._adjoint.value(self._item, self._what)])

    def add_start(self, by_position: PETSc.Vec, by_velocity: PETSc.Vec) -> None:
        # Every rank has the whole sum; the sums of the ranks are added up.
        if self._is_first:
            self.sum[0] += self._adjoint.sums[id(self._item), self._what]


def _function(space: fem.FunctionSpace, values: Array) -> fem.Function:
    """A function of the values (k,) of this rank's unknowns, ghosts included.  Collective."""
    function = fem.Function(space)
    function.x.array[: len(values)] = values
    function.x.scatter_forward()
    return function


# ---- by name -------------------------------------------------------------------------------------


def find_variables(
    system: System,
    names: Sequence[str],
    adjoint: AdjointFields,
    *,
    in_time: bool,
    scalars: Sequence[GasAdjoint] = (),
) -> list[Variable]:
    """The variables "item.parameter" of a scene, with initial conditions if the result is one of a
    run, `in_time`.  `InputError` names what the scene has.  Collective."""
    check(
        bool(names) and not isinstance(names, str),
        f"gradient: by is {names!r}; give a list of names, e.g. by=['film.thickness'].",
    )
    refuse_unknown_kinds(system)
    return [_find(system, name, adjoint, in_time, scalars) for name in names]


def refuse_unknown_kinds(system: System) -> None:
    """Raise `InputError` if the derivatives of some forces of a scene are unknown, with the name of
    the first.  Collective."""
    for compiled in system.equations.compiled:
        if isinstance(compiled, Differentiable):
            reason = compiled.without_gradient()
        else:
            reason = (
                f"'{brought_by(system, compiled)}' has no gradient, "
                "as the derivatives of its forces are not known; leave it out of the scene"
            )
        check_on_all(system.comm, not reason, f"gradient: {reason}.")


def brought_by(system: System, compiled: object) -> str:
    """The first item of a scene that has a term of a compiled kind: its name, else its class; that
    of the kind if no item has one."""
    for item in system.unknowns.items:
        for term in system.unknowns.terms_of(item):
            if type(compiled) is term.compiler:
                return str(getattr(item, "name", type(item).__name__))
    return type(compiled).__name__


def _find(
    system: System, name: str, adjoint: AdjointFields, in_time: bool, scalars: Sequence[GasAdjoint]
) -> Variable:
    """The variable of a parameter; what the scene does not have is refused with a list of what it
    has."""
    check(
        isinstance(name, str) and "." in name,
        f"gradient: by has {name!r}; give 'item.parameter', e.g. 'film.thickness'.",
    )
    item_name, _, what = name.rpartition(".")
    items = [item for item in system.unknowns.items if getattr(item, "name", None) == item_name]
    # Items without parameters would be refused next.
    known = {
        str(getattr(one, "name", ""))
        for one in system.unknowns.items
        if _names_of(system, one, in_time, scalars)
    }
    check(
        bool(items),
        f"gradient: the scene has no item '{item_name}'; its items with parameters are: "
        f"{', '.join(sorted(known - {''})) or 'none'}.",
    )
    item: Any = items[0]
    if what == SHAPE and _has_shape(item):
        return _shape(system, name, item, adjoint)
    if in_time and isinstance(item, RigidBody) and what in (SPIN, VELOCITY):
        return RigidMotionVariable(name, item, system)
    if in_time and item in system.unknowns.bodies and what in (INITIAL_VELOCITY, INITIAL_POSITION):
        if what == INITIAL_POSITION:
            _refuse_measured_start(system, name, item)
        return InitialVariable(name, item, system, what == INITIAL_VELOCITY)
    for part in scalars:
        if what in part.names_of(item):
            return ScalarVariable(name, part, item, system)
    found = [
        (term, parameter)
        for term in system.unknowns.terms_of(item)
        for parameter in getattr(term, "parameters", ())
        if parameter.name == what
    ]
    check(
        bool(found),
        f"gradient: '{item_name}' has no parameter '{what}' that results can be derived by; "
        f"it has: {', '.join(_names_of(system, item, in_time, scalars)) or 'none'}.",
    )
    check(
        not (in_time and any(parameter.changes_mass for _, parameter in found)),
        f"gradient: '{name}' changes a mass, whose derivative is not known, so that a run has none "
        "by it; take the gradient of an equilibrium.",
    )
    unit = found[0][1].unit
    coefficients = {id(p.source): p.source for _, p in found if not isinstance(p.source, str)}
    uses: list[tuple[Any, Any, Parameter]] = []
    for term, parameter in found:
        if isinstance(parameter.source, str):
            of_kind: list[Any] = system.equations.compiled_as(term.compiler)
            compiled = next(one for one in of_kind if one.has(term))
            uses.append((compiled, term, parameter))
    if not coefficients:
        return PointVariable(name, unit, uses)
    points = PointVariable(name, unit, uses) if uses else None
    return FormVariable(name, unit, list(coefficients.values()), adjoint, points)


def _refuse_measured_start(system: System, name: str, body: Body) -> None:
    """Raise `InputError` if an item of the scene keeps what it has measured on a body at first."""
    for item in system.unknowns.items:
        if not (isinstance(item, MeasuresStart) and item.keeps_measures()):
            continue
        check(
            not any(one is body for one in item.requires()),
            f"gradient: '{getattr(item, 'name', type(item).__name__)}' keeps what it measures in "
            f"the initial state, so that there is no derivative by '{name}'; leave it out of the "
            "scene.",
        )


def _names_of(system: System, item: Any, in_time: bool, scalars: Sequence[GasAdjoint]) -> list[str]:
    """List the parameters of an item by which a result has a derivative, in alphabetical order."""
    names = {
        parameter.name
        for term in system.unknowns.terms_of(item)
        for parameter in getattr(term, "parameters", ())
    }
    for part in scalars:
        names.update(part.names_of(item))
    if _has_shape(item):
        names.add(SHAPE)
    if in_time and isinstance(item, RigidBody):
        names |= {SPIN, VELOCITY}
    if in_time and item in system.unknowns.bodies:
        names |= {INITIAL_POSITION, INITIAL_VELOCITY}
    return sorted(names)


def _has_shape(item: object) -> bool:
    """Whether an item is a body whose stress-free shape is a mesh."""
    return isinstance(item, MeshBody) and has_nodal_unknowns(item)


def _shape(system: System, name: str, body: MeshBody, adjoint: AdjointFields) -> Variable:
    """The variable of the stress-free positions [m] of the nodes of a body; refused if a part of
    the scene measures the stress-free shape in another way than by forms, and of a plate."""
    # UFL takes the vertices of cells in its membrane strain for constants.
    check(
        not (isinstance(body, Meshed) and body.bends),
        f"gradient: the membrane strain of the plate '{body.name}' has no derivative by its nodes, "
        f"so that there is none by '{name}'; ask for another parameter, or make it a Membrane "
        "where its bending does not count.",
    )
    for compiled in system.equations.compiled:
        if not (isinstance(compiled, Differentiable) and compiled.has_shape_derivative):
            raise InputError(
                "gradient: "
                f"'{brought_by(system, compiled)}' is measured on the mesh when the scene is made, "
                f"so that there is no derivative by '{name}'; leave it out of the scene."
            )
    for item in system.unknowns.items:
        if not (isinstance(item, MeasuresMesh) and any(one is body for one in item.requires())):
            continue
        check(
            not item.depends_on_mesh(system.unknowns.terms_of(item), system.unknowns.time),
            f"gradient: '{getattr(item, 'name', type(item).__name__)}' has numbers that were "
            f"measured on the mesh when it was made, so that there is no derivative by '{name}'; "
            f"{item.without_mesh}.",
        )
    return FormVariable(name, "m", [MeshNodes(body.space.mesh)], adjoint)
