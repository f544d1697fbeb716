"""Output fields of bodies, by name: expressions of the coordinates q and the velocities v, compiled when asked for.

    displacement    x - X, from the stress-free mesh [m]
    velocity        [m/s]
    strain1 ≥ strain2     principal Green-Lagrange strains of a film
    stress1 ≥ stress2     principal second Piola-Kirchhoff stresses of a film, ∂ψ/∂E over the thickness [Pa]
    direction       F n/|F n|, n the direction of strain1: where the tension goes on the deformed film
    state           0 slack, 1 wrinkled, 2 taut
    group           number of the cell's part among those of all films, see `fields.groups`
    pressure        of the gas inside over that outside [Pa]; where a film parts two chambers, their difference

    fold_angle      of the creases at a cell [rad], zero in others
    contact_pressure    at the nodes [N/m²], both sides of a film added, by the area of the stress-free shape

    curvature1 ≥ curvature2   principal curvatures of a plate [1/m], positive towards the normal of its mesh
    moment1 ≥ moment2         principal bending moments of a plate [N m/m]

Displacement and velocity belong to any body on a mesh, curvatures and moments to plates, the others to films.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, la

from gossamer_fx.bodies.membrane import Membrane
from gossamer_fx.checks.errors import check
from gossamer_fx.fields.body_shape import BodyShape
from gossamer_fx.fields.groups import groups_of
from gossamer_fx.forms.backend import interpolation_points
from gossamer_fx.forms.compilation import compile_expression, compile_form, constant
from gossamer_fx.forms.kinematics import Expr, half_trace_and_radius
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.materials.film import SLACK, TAUT, WRINKLED
from gossamer_fx.model.body import Array, Body, MeshBody, has_nodal_unknowns
from gossamer_fx.model.roles import CellFields, NodeFields, playing
from gossamer_fx.system.system import System
from gossamer_fx.terms.discrete_gradient import gradient

STATES = {"slack": SLACK, "wrinkled": WRINKLED, "taut": TAUT}


@dataclass(frozen=True)
class Field:
    """What a field is: its shape, whether only films or plates have it, and its expression of (body, q, v).

    The fields of films are made of derivatives of q: they may jump from cell to cell.
    """

    shape: tuple[int, ...]
    of_films: bool
    expression: Callable[[Any, Expr, Expr], Expr] | None
    of_plates: bool = False
    of_nodes: bool = False  # whether terms have it at the nodes


def position(q: Expr) -> Expr:
    """The position among a node's coordinates, which come first."""
    return ufl.as_vector([q[i] for i in range(3)])


def _principal_strains(film: Membrane, x: Expr) -> tuple[Expr, Expr]:
    h, r = half_trace_and_radius(film.measure(x))
    return h + r, h - r


def _principal(tensor: Expr) -> tuple[Expr, Expr]:
    """The principal values of a symmetric tensor (2, 2), the larger one first."""
    h, r = half_trace_and_radius(
        ufl.as_vector([tensor[0, 0], tensor[1, 1], tensor[0, 1] + tensor[1, 0]])
    )
    return h + r, h - r


def _principal_stresses(film: Membrane, x: Expr) -> tuple[Expr, Expr]:
    S = gradient(film.density, film.measure(x)) / film.constants.thickness
    h, r = half_trace_and_radius(ufl.as_vector([S[0], S[1], 2 * S[2]]))
    return h + r, h - r


def _direction(film: Membrane, x: Expr) -> Expr:
    """F n/|F n|; where the principal strains coincide, n is the first vector of the film's frame."""
    e = film.measure(x)
    _, r = half_trace_and_radius(e)  # r > 0: guarded
    a, b = (e[0] - e[1]) / 2, e[2] / 2
    # of the two forms of the eigenvector of [[a, b], [b, -a]], the one whose large component does not cancel
    n = ufl.conditional(ufl.ge(a, 0), ufl.as_vector([r + a, b]), ufl.as_vector([b, r - a]))
    t = ufl.dot(film.deformation(x), n / ufl.sqrt(ufl.dot(n, n)))
    return t / ufl.sqrt(ufl.dot(t, t))


def film_state(film: Membrane, x: Expr) -> Expr:
    """0 slack, 1 wrinkled, 2 taut."""
    # the unit gives the state of a law that never wrinkles, a number, a mesh to be evaluated on
    unit = constant(film.space.mesh, 1.0)
    return unit * film.law.state(film.measure(x), film.constants)


FIELDS = {
    "displacement": Field(
        (3,), False, lambda body, q, v: position(q) - ufl.SpatialCoordinate(body.space.mesh)
    ),
    "velocity": Field((3,), False, lambda body, q, v: position(v)),
    "strain1": Field((), True, lambda film, x, v: _principal_strains(film, x)[0]),
    "strain2": Field((), True, lambda film, x, v: _principal_strains(film, x)[1]),
    "stress1": Field((), True, lambda film, x, v: _principal_stresses(film, x)[0]),
    "stress2": Field((), True, lambda film, x, v: _principal_stresses(film, x)[1]),
    "direction": Field((3,), True, lambda film, x, v: _direction(film, x)),
    "state": Field((), True, lambda film, x, v: film_state(film, x)),
    "curvature1": Field(
        (), True, lambda plate, x, v: _principal(plate.curvature(x))[0], of_plates=True
    ),
    "curvature2": Field(
        (), True, lambda plate, x, v: _principal(plate.curvature(x))[1], of_plates=True
    ),
    "moment1": Field((), True, lambda plate, x, v: _principal(plate.moment(x))[0], of_plates=True),
    "moment2": Field((), True, lambda plate, x, v: _principal(plate.moment(x))[1], of_plates=True),
    # not functions of the film's coordinates: the gas has its own state, and a fold may have turned more than once
    "group": Field((), True, None),
    "pressure": Field((), True, None),
    "fold_angle": Field((), True, None),
    "contact_pressure": Field((), False, None, of_nodes=True),
}


def check_fields(body: Body, names: Sequence[str]) -> None:
    """Raise `InputError` for a field that does not exist, or that this body has not."""
    is_film = isinstance(body, Membrane)
    bends = isinstance(body, Membrane) and body.bends
    known = [
        n
        for n, field in FIELDS.items()
        if (is_film or not field.of_films) and (bends or not field.of_plates)
    ]
    unknown = [name for name in names if name not in known]
    problem = (
        f"'{body.name}' has no field {unknown[0]!r}"
        if unknown
        else f"No field of '{body.name}' is asked for"
    )
    check(bool(names) and not unknown, f"{problem}; its fields are: {', '.join(known)}.")


class FieldFunctions:
    """Named fields of one body as functions of one Lagrange element, so that one file can take them.

    The element has the body's order: continuous if all fields are, else discontinuous.  Strains of a film of order p
    are polynomials of degree 2(p - 1) in each cell, so nothing is lost or smeared for p = 1, 2.
    """

    def __init__(self, system: System, body: MeshBody, names: Sequence[str]) -> None:
        check_fields(body, names)
        self._shape = shape = BodyShape(system.state, body)
        jumps = any(FIELDS[name].of_films for name in names)
        family, order = (
            "Discontinuous Lagrange" if jumps else "Lagrange",
            shape.body.space.ufl_element().degree,
        )
        self.functions: list[fem.Function] = []
        self._updates: list[Callable[[], None]] = []
        for name in names:
            field = FIELDS[name]
            function = fem.Function(
                fem.functionspace(shape.body.space.mesh, (family, order, field.shape)), name=name
            )
            self.functions.append(function)
            if field.expression is None:
                take = _take_at_nodes if field.of_nodes else _take_mean
                update = partial(take, function, name)
                if name in _BY_CELL:
                    update = partial(_BY_CELL[name], function)
                self._updates.append(partial(update, body, system))
            else:
                points = interpolation_points(function.function_space)
                compiled = compile_expression(
                    field.expression(shape.body, shape.q, shape.v), points
                )
                self._updates.append(partial(function.interpolate, compiled))

    def update(self) -> None:
        """Take the values of the accepted state."""
        self._shape.update()
        for function, update in zip(self.functions, self._updates, strict=True):
            update()
            function.x.scatter_forward()


def _take_pressure(function: fem.Function, film: MeshBody, system: System) -> None:
    """Set a discontinuous function to the pressure of the gas on each cell."""
    values = function.x.array
    values[:] = 0
    for border in system.scalar_unknowns:
        for gas in border.states().values():
            enclosure, outside = gas.chamber.enclosure, gas.chamber.outside
            if enclosure is not None and enclosure.film is film:
                cells = cell_nodes(function.function_space)[enclosure.cells()]
                values[cells] = (
                    gas.pressure - (outside.pressure if outside else 0.0) - values[cells]
                )


def _take_group(function: fem.Function, film: MeshBody, system: System) -> None:
    """Set a discontinuous function to the number of each cell's part; see `groups_of`."""
    films = [body for body in system.bodies if isinstance(body, Membrane)]
    for other, parts in zip(films, groups_of(films)[1], strict=True):
        if other is film:
            nodes = cell_nodes(function.function_space)[: len(parts)]
            function.x.array[nodes] = parts[:, None]


_BY_CELL = {"pressure": _take_pressure, "group": _take_group}


def _take_mean(function: fem.Function, name: str, body: MeshBody, system: System) -> None:
    """Set a discontinuous function to the mean of what terms have in each cell, and to zero elsewhere."""
    sums, counts = function.x, fem.Function(function.function_space).x
    sums.array[:] = 0
    for kind in playing(CellFields, system.compiled):
        found = kind.cell_values(name, body)
        if found is not None:
            nodes = cell_nodes(function.function_space)[found[0]]
            np.add.at(sums.array, nodes, found[1][:, None])
            np.add.at(counts.array, nodes, 1.0)
    for vector in (sums, counts):
        vector.scatter_reverse(la.InsertMode.add)
    sums.array[:] /= np.maximum(counts.array, 1.0)


def _take_at_nodes(function: fem.Function, name: str, body: MeshBody, system: System) -> None:
    """Set a function to the sum of what terms have at the nodes, and to zero elsewhere."""
    if not has_nodal_unknowns(body):  # of a reduced film there is nothing at nodes
        function.x.array[:] = 0
        return
    index_map, cells = body.block.index_map, cell_nodes(body.space)
    at_nodes = np.zeros(index_map.size_local + index_map.num_ghosts)
    for kind in playing(NodeFields, system.compiled):
        found = kind.node_values(name, body)
        if found is not None:
            local = index_map.global_to_local(found[0])
            np.add.at(at_nodes, local[local >= 0], found[1][local >= 0])
    function.x.array[cell_nodes(function.function_space).ravel()] = at_nodes[cells.ravel()]


class AreaFractions:
    """Fractions of the reference area of some films that are slack, wrinkled and taut; they add up to one."""

    def __init__(self, films: Sequence[Membrane]) -> None:
        self._films = films
        self._compiled: list[tuple[BodyShape, fem.Constant, fem.Form]] | None = None

    def _compile(self, system: System) -> list[tuple[BodyShape, fem.Constant, fem.Form]]:
        found = []
        for film in self._films:
            shape = BodyShape(system.state, film)
            which = constant(shape.body.space.mesh, 0.0)
            share = (
                ufl.conditional(ufl.eq(film_state(shape.body, shape.q), which), 1.0, 0.0)
                * shape.body.dx
            )
            found.append((shape, which, compile_form(share)))
        return found

    def __call__(self, system: System) -> Array:
        """(slack, wrinkled, taut) of the accepted state; the same on every rank."""
        if self._compiled is None:
            self._compiled = self._compile(system)
        areas = np.zeros(len(STATES))
        for shape, which, form in self._compiled:
            shape.update()
            for state in STATES.values():
                which.value = state
                areas[state] += fem.assemble_scalar(form)
        areas = system.comm.allreduce(areas)
        return areas / areas.sum()
