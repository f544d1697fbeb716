"""Output fields of bodies by name, compiled when they are asked for.

    displacement            x - X, from the stress-free mesh [m]
    velocity                [m/s]
    strain1 ≥ strain2       principal Green-Lagrange strains of a film, thermal strains included
    elastic_strain1 ≥ elastic_strain2
                            principal strains less the thermal strain, of which stresses are
                            functions
    stress1 ≥ stress2       principal Cauchy stresses of a film [Pa]: force over its present
                            thickness and length
    von_mises_stress        of the same stress [Pa], √(σ1² - σ1 σ2 + σ2²)
    second_piola_stress1 ≥ second_piola_stress2
                            principal second Piola-Kirchhoff stresses of a film, ∂ψ/∂E over the
                            thickness of the stress-free film [Pa]
    direction               F n/|F n| with n the direction of strain1: the direction of tension on
                            the deformed film
    state                   0 slack, 1 wrinkled, 2 taut; in between where a step passes several
    pressure                gas pressure inside less that outside [Pa]; on a film between two
                            chambers the difference of their pressures
    temperature             of a film with thermal expansion or solar heating [K]; zero without
    group                   number of the cell's part among those of all films, see `groups_of`

    wrinkle_slope           largest slope of wrinkles that the mesh does not resolve, see
                            `fields.wrinkles`: local means, where `state` may alternate between
                            cells
    wrinkle_amplitude       estimate of their amplitude [m]
    wrinkle_direction       along their crests on the deformed film; zero without wrinkles

    fold_angle              angle of the creases at a cell [rad], zero in other cells
    mode_amplitude          distance from the equilibrium in the record of a mode [m], else zero
    contact_pressure        at the nodes [N/m²], both sides of a film added, by the area of the
                            stress-free shape: mean over the last step

    curvature1 ≥ curvature2 principal curvatures of a plate [1/m], positive towards the normal
                            of its mesh
    moment1 ≥ moment2       principal bending moments of a plate [N m/m]

    tension                 axial force of a cable or beam [N], negative for compression
    axial_strain            strain of which it is a function: with the initial strain, without the
                            thermal one

All bodies on a mesh have displacement, velocity and contact pressure; cables and beams have tension
and axial strain; plates have curvatures and moments; films have all others.

Stresses, states, moments and tensions are means over the last step, unless they are asked for at
its end, see `body_shape`; the others belong to the end of the step.

A field is either an expression of the coordinates q and velocities v of its body, or it is
collected from the scene: gas, creases and contact have values that are not functions of q.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.backend import cell_nodes, interpolation_points
from gossamer_fx.core.forms.compilation import compile_expression
from gossamer_fx.core.forms.kinematics import Expr, half_trace_and_radius
from gossamer_fx.core.model.body import Array, Body, MeshBody, has_nodal_unknowns
from gossamer_fx.core.model.state import HasSystem
from gossamer_fx.mechanics.bodies.cable import Curve
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.materials.film import FilmLaw, area_ratio
from gossamer_fx.mechanics.terms.element_energies import thermal_strain_of
from gossamer_fx.records.fields.axial_force import GaussValues, axial_strain, tension
from gossamer_fx.records.fields.body_shape import At, BodyShape
from gossamer_fx.records.fields.film_states import film_state
from gossamer_fx.solve.system.system import System

# Fields of `fields.wrinkles`
WRINKLE_MAPS = ("wrinkle_slope", "wrinkle_amplitude", "wrinkle_direction")

# An expression of the shape of a body
Expression = Callable[[BodyShape], Expr]

# Sets a function on a body to a field whose values come from the items of the scene
Collector = Callable[[fem.Function, MeshBody, System], None]


@dataclass(frozen=True)
class Field:
    """Description of a field.

    Attributes:
        shape: () for a scalar, (3,) for a vector.
        expression: of the shape of a body; None for a field that is collected from the scene.
        of_films: whether only films have it.  It may then jump between cells: strains are made of
            derivatives of q.
        of_plates: whether only films that bend have it.
        along_line: the quantity at the Gauss points of a cable or beam, for a field that only these
            have; else None.
    """

    shape: tuple[int, ...]
    expression: Expression | None = None
    of_films: bool = False
    of_plates: bool = False
    along_line: Expression | None = None


# ---- expressions ---------------------------------------------------------------------------------


def position(q: Expr) -> Expr:
    """The position (3,) among a node's coordinates, which come first; directors follow in beams."""
    return ufl.as_vector([q[i] for i in range(3)])


def _displacement(shape: BodyShape) -> Expr:
    return position(shape.q) - ufl.SpatialCoordinate(shape.body.space.mesh)


def _velocity(shape: BodyShape) -> Expr:
    return position(shape.v)


def _strains(shape: BodyShape) -> tuple[Expr, Expr]:
    """Principal strains, the larger one first."""
    mean, radius = half_trace_and_radius(shape.body.measure(shape.q))
    return mean + radius, mean - radius


def _elastic_strains(shape: BodyShape) -> tuple[Expr, Expr]:
    """Principal strains less the thermal strain, the larger one first."""
    mean, radius = half_trace_and_radius(shape.elastic_strain())
    return mean + radius, mean - radius


def _stresses(shape: BodyShape) -> tuple[Expr, Expr]:
    """Principal Cauchy stresses [Pa], the larger one first: those of U S U/J with the stretch U of
    the surface and the volume J of the material, over that of the mesh."""
    body = shape.body
    S = shape.stress()
    strain = body.strain_from_mesh(shape.q_acting)
    thermal = shape.thermal_strain
    stretched = strain
    if thermal is not None:
        stretched -= thermal
    law = body.law
    if type(law).taut_strain is not FilmLaw.taut_strain:
        # Wrinkles shorten the mesh and not the material.
        stretched = law.taut_strain(S, body.constants)
        if body.initial_strain is not None:
            stretched -= body.initial_strain
    J = law.volume_ratio(stretched, body.constants)
    if thermal is not None:
        # The law knows the strain that makes stress, and heat changes the size as well.
        J *= area_ratio(stretched + thermal) / area_ratio(stretched)
        # Across the film it expands as along it, where the law says how thick the film is.
        if type(law).volume_ratio is not FilmLaw.volume_ratio:
            J *= ufl.sqrt(area_ratio(thermal))
    # U = (C + √det C I)/√(tr C + 2 √det C) is the root of C = I + 2 E.
    C = ufl.as_matrix([[1 + 2 * strain[0], strain[2]], [strain[2], 1 + 2 * strain[1]]])
    area = area_ratio(strain)
    U = (C + area * ufl.Identity(2)) / ufl.sqrt(ufl.tr(C) + 2 * area)
    second_piola = ufl.as_matrix([[S[0], S[2]], [S[2], S[1]]]) / body.constants.thickness
    return _principal(U * second_piola * U / J)


def _von_mises(shape: BodyShape) -> Expr:
    """Von Mises stress [Pa] of the Cauchy stress, which has no part across the film."""
    σ1, σ2 = _stresses(shape)
    return ufl.sqrt(σ1**2 - σ1 * σ2 + σ2**2)


def _second_piola_stresses(shape: BodyShape) -> tuple[Expr, Expr]:
    """Principal second Piola-Kirchhoff stresses [Pa], the larger one first."""
    S = shape.stress() / shape.body.constants.thickness
    # `half_trace_and_radius` takes twice the shear, as strains have it.
    mean, radius = half_trace_and_radius(ufl.as_vector([S[0], S[1], 2 * S[2]]))
    return mean + radius, mean - radius


def _principal(tensor: Expr) -> tuple[Expr, Expr]:
    """Principal values of a symmetric tensor (2, 2), the larger one first."""
    components = [tensor[0, 0], tensor[1, 1], tensor[0, 1] + tensor[1, 0]]
    mean, radius = half_trace_and_radius(ufl.as_vector(components))
    return mean + radius, mean - radius


def _curvatures(shape: BodyShape) -> tuple[Expr, Expr]:
    """Principal curvatures [1/m]."""
    return _principal(shape.body.curvature(shape.q))


def _moments(shape: BodyShape) -> tuple[Expr, Expr]:
    """Principal bending moments [N m/m]; over a step the mean of both its ends."""
    plate = shape.body
    moment = plate.moment(shape.q)
    if shape.rule.takes_mid_strain:
        moment = plate.moment(shape.q_acting)
    elif shape.q_start is not None:
        moment = (plate.moment(shape.q_start) + moment) / 2
    if shape.thermal_curvature is not None:
        moment -= plate.bending_stiffness.moment(shape.thermal_curvature)
    return _principal(moment)


def _direction(shape: BodyShape) -> Expr:
    """Return the direction of tension on the deformed film, a unit vector (3,) as a UFL expression.

    It is F n/|F n| with the deformation gradient F and the direction n of the larger principal
    strain, thermal strain not included.  Where the principal strains are equal, n is the first
    vector of the film's frame."""
    e = shape.elastic_strain()
    # The radius is kept above zero by its definition, so nothing is divided by zero below.
    _, radius = half_trace_and_radius(e)
    a = (e[0] - e[1]) / 2
    b = e[2] / 2
    # Two forms of the eigenvector of [[a, b], [b, -a]]: in each its large component does not cancel
    # for one sign of a.
    n = ufl.conditional(
        ufl.ge(a, 0),
        ufl.as_vector([radius + a, b]),
        ufl.as_vector([b, radius - a]),
    )
    unit_n = n / ufl.sqrt(ufl.dot(n, n))
    tangent = ufl.dot(shape.body.deformation(shape.q), unit_n)
    return tangent / ufl.sqrt(ufl.dot(tangent, tangent))


def _larger(values: Callable[[BodyShape], tuple[Expr, Expr]]) -> Expression:
    """The expression of the larger of two principal values."""
    return lambda shape: values(shape)[0]


def _smaller(values: Callable[[BodyShape], tuple[Expr, Expr]]) -> Expression:
    """The expression of the smaller of two principal values."""
    return lambda shape: values(shape)[1]


FIELDS = {
    "displacement": Field((3,), _displacement),
    "velocity": Field((3,), _velocity),
    "strain1": Field((), _larger(_strains), of_films=True),
    "strain2": Field((), _smaller(_strains), of_films=True),
    "elastic_strain1": Field((), _larger(_elastic_strains), of_films=True),
    "elastic_strain2": Field((), _smaller(_elastic_strains), of_films=True),
    "stress1": Field((), _larger(_stresses), of_films=True),
    "stress2": Field((), _smaller(_stresses), of_films=True),
    "von_mises_stress": Field((), _von_mises, of_films=True),
    "second_piola_stress1": Field((), _larger(_second_piola_stresses), of_films=True),
    "second_piola_stress2": Field((), _smaller(_second_piola_stresses), of_films=True),
    "direction": Field((3,), _direction, of_films=True),
    "state": Field((), film_state, of_films=True),
    "curvature1": Field((), _larger(_curvatures), of_films=True, of_plates=True),
    "curvature2": Field((), _smaller(_curvatures), of_films=True, of_plates=True),
    "moment1": Field((), _larger(_moments), of_films=True, of_plates=True),
    "moment2": Field((), _smaller(_moments), of_films=True, of_plates=True),
    # The gas has a separate state, and a fold may have turned more than once: neither is a function
    # of the film's coordinates.
    "group": Field((), of_films=True),
    "wrinkle_slope": Field((), of_films=True),
    "wrinkle_amplitude": Field((), of_films=True),
    "wrinkle_direction": Field((3,), of_films=True),
    "pressure": Field((), of_films=True),
    "temperature": Field((), of_films=True),
    "fold_angle": Field((), of_films=True),
    "contact_pressure": Field(()),
    "mode_amplitude": Field(()),
    "tension": Field((), along_line=tension),
    "axial_strain": Field((), along_line=axial_strain),
}


def check_fields(body: Body, names: Sequence[str]) -> None:
    """Raise `InputError` for no names, or for a name that is not a field of a body."""
    is_film = isinstance(body, Membrane)
    is_line = isinstance(body, Curve)
    bends = isinstance(body, Membrane) and body.bends
    known = []
    for name, field in FIELDS.items():
        is_missing = (
            (field.of_films and not is_film)
            or (field.of_plates and not bends)
            or (field.along_line is not None and not is_line)
        )
        if not is_missing:
            known.append(name)
    choices = known
    if isinstance(body, Membrane) and not body.law.has_wrinkle_maps:
        # Asked for, they are refused with the reason.
        choices = [name for name in known if name not in WRINKLE_MAPS]
    fields = f"its fields are: {', '.join(choices)}."
    check(bool(names), f"No field of '{body.name}' is asked for; {fields}")
    for name in names:
        check(name in known, f"'{body.name}' has no field {name!r}; {fields}")


def jumps(name: str) -> bool:
    """Whether a field may jump between cells; then it is constant in each cell of a body of order
    1."""
    field = FIELDS[name]
    is_of_cells = field.of_films or field.along_line is not None
    # Maps of wrinkles are means at the vertices.
    return is_of_cells and name not in WRINKLE_MAPS


# ---- functions -----------------------------------------------------------------------------------


class FieldFunctions:
    """Named fields of one body as functions of one Lagrange element, so that one file can take
    them.

    The element has the order of the body.  It is continuous if all fields are, else discontinuous.
    Strains of a film of order p are polynomials of degree 2 (p - 1) in each cell, so for p = 1, 2
    nothing is lost or smoothed.

    Args:
        element: family and order of another element; None: as above.
        at: when stresses are taken, see `body_shape`.

    Attributes:
        functions: one for each name, in their order; set by `update`.
    """

    def __init__(
        self,
        system: System,
        body: MeshBody,
        names: Sequence[str],
        element: tuple[str, int] | None = None,
        at: At = "mean",
    ) -> None:
        """Make the functions, and compile the expressions of their values.  Collective."""
        check_fields(body, names)
        self._shape = BodyShape(system, body, at)
        self._at: At = at
        self._element = element or self._element_of(names)
        self.functions: list[fem.Function] = []
        self._updates: list[Callable[[], None]] = []
        for name in names:
            function = self._function(name)
            self.functions.append(function)
            self._updates.append(self._update_of(function, body, system))

    def _element_of(self, names: Sequence[str]) -> tuple[str, int]:
        """Return family and order of an element that can represent all fields."""
        order = self._shape.body.space.ufl_element().degree
        if any(jumps(name) for name in names):
            return "Discontinuous Lagrange", order
        return "Lagrange", order

    def _function(self, name: str) -> fem.Function:
        mesh = self._shape.body.space.mesh
        space = fem.functionspace(mesh, (*self._element, FIELDS[name].shape))
        return fem.Function(space, name=name)

    def _update_of(
        self, function: fem.Function, body: MeshBody, system: System
    ) -> Callable[[], None]:
        """Return a callable that sets the function of a field to the accepted state; collective."""
        field = FIELDS[function.name]
        if function.name in WRINKLE_MAPS:
            # Imported here, as few outputs need it.
            from gossamer_fx.records.fields.wrinkles import WrinkleMap

            return WrinkleMap(function, body, system).update
        if field.along_line is not None:
            assert isinstance(body, Curve)
            values = GaussValues(system, body, field.along_line, self._at)
            return partial(_interpolate_gauss_values, values, function)
        if field.expression is None:
            return partial(_COLLECTORS[function.name], function, body, system)
        points = interpolation_points(function.function_space)
        shape = self._shape
        expression = field.expression(shape)
        compiled = compile_expression(expression, points)
        if not shape.is_on_path(expression):
            return partial(function.interpolate, compiled)

        def interpolate_mean() -> None:
            """Set the function to the mean of the expression along the path of the last step."""
            total: Array = np.zeros_like(function.x.array)
            for weight in shape.path_points():
                function.interpolate(compiled)
                total += weight * function.x.array
            function.x.array[:] = total

        return interpolate_mean

    def update(self) -> None:
        """Set all functions to the accepted state, ghosts included.  Collective."""
        self._shape.update()
        for function, update in zip(self.functions, self._updates, strict=True):
            update()
            function.x.scatter_forward()


def _interpolate_gauss_values(values: GaussValues, function: fem.Function) -> None:
    """Set a discontinuous function to the polynomial through the values at the Gauss points."""
    values.update()
    function.interpolate(values.function)


# ---- fields that are collected from the scene ----------------------------------------------------


def _collect_pressure(function: fem.Function, film: MeshBody, system: System) -> None:
    """Set a discontinuous function to the gas pressure difference [Pa] on each cell.

    It is that inside less that outside; zero on films that enclose no gas.  Ghost cells are not
    set."""
    values = function.x.array
    values[:] = 0
    for unknowns in system.equations.scalar_unknowns:
        for state in unknowns.states().values():
            enclosure = state.chamber.enclosure
            if enclosure is None or not any(film is one for one in enclosure.films):
                continue
            outside = 0.0
            if state.chamber.outside is not None:
                outside = state.chamber.outside.pressure
            nodes = cell_nodes(function.function_space)[enclosure.cells(film)]
            # A cell between two chambers is visited twice: the second pressure less the first.
            values[nodes] = state.pressure - outside - values[nodes]


def _collect_group(function: fem.Function, film: MeshBody, system: System) -> None:
    """Set a discontinuous function to the number of each cell's part; see `groups_of`."""
    films = [body for body in system.unknowns.bodies if isinstance(body, Membrane)]
    _, parts_of_films = groups_of(films)
    for other, parts in zip(films, parts_of_films, strict=True):
        if other is film:
            nodes = cell_nodes(function.function_space)[: len(parts)]
            function.x.array[nodes] = parts[:, None]


def _collect_cell_values(function: fem.Function, body: MeshBody, system: System) -> None:
    """Set a discontinuous function to the mean of the scene's values in each cell; collective.

    Values come from the items of the scene that have some for this field, e.g. from creases; cells
    without a value are zero."""
    sums = function.x
    counts = fem.Function(function.function_space).x
    sums.array[:] = 0
    for compiled in system.equations.shown:
        found = compiled.cell_values(function.name, body)
        if found is None:
            continue
        cells, values = found
        nodes = cell_nodes(function.function_space)[cells]
        np.add.at(sums.array, nodes, values[:, None])
        np.add.at(counts.array, nodes, 1.0)
    # A cell may have values on several ranks.
    sums.scatter_reverse(la.InsertMode.add)
    counts.scatter_reverse(la.InsertMode.add)
    sums.array[:] /= np.maximum(counts.array, 1.0)


def _collect_node_values(function: fem.Function, body: MeshBody, system: System) -> None:
    """Set a function to the sum of the scene's values at each node; collective.

    Values come from the items of the scene that have some for this field, e.g. from contact; nodes
    without a value, and reduced films, whose unknowns are not at nodes, are zero."""
    # A reduced film has no terms at nodes.
    if not has_nodal_unknowns(body):
        function.x.array[:] = 0
        return
    index_map = body.block.index_map
    at_nodes = la.vector(index_map)
    at_nodes.array[:] = 0
    for compiled in system.equations.shown:
        found = compiled.node_values(function.name, body)
        if found is None:
            continue
        global_nodes, values = found
        # Nodes that are not on this rank have the local number -1.
        local = index_map.global_to_local(global_nodes)
        here = local >= 0
        np.add.at(at_nodes.array, local[here], values[here])
    # The rank that knows the value of a node need not own the node.
    at_nodes.scatter_reverse(la.InsertMode.add)
    at_nodes.scatter_forward()
    # The function may be discontinuous: it has the nodes of each cell.
    of_function = cell_nodes(function.function_space).ravel()
    of_body = cell_nodes(body.space).ravel()
    function.x.array[of_function] = at_nodes.array[of_body]


def _collect_temperature(function: fem.Function, body: MeshBody, system: System) -> None:
    """Set a discontinuous function to the temperature [K] of a film; zero if it has none.
    Collective."""
    strain = thermal_strain_of(system.unknowns, body)
    if strain is None:
        # Heated films without thermal expansion have a temperature in each cell.
        _collect_cell_values(function, body, system)
        return
    # The function has the order of positions, temperatures have one less.
    function.interpolate(strain.start_temperature)


_COLLECTORS: dict[str, Collector] = {
    "pressure": _collect_pressure,
    "temperature": _collect_temperature,
    "group": _collect_group,
    "fold_angle": _collect_cell_values,
    "contact_pressure": _collect_node_values,
    "mode_amplitude": _collect_node_values,
}


Integers = npt.NDArray[np.int64]


# ---- groups of cells, which pictures and recordings distinguish ----------------------------------


def groups_of(films: Sequence[Membrane]) -> tuple[list[str], list[Integers]]:
    """Return the names of the parts of films, and the part of each of this rank's own cells.
    Collective.

    The parts of a film are the groups of cells of its mesh, and "rest" for the cells in no group. A
    cell in several groups belongs to the last of them; a group that has no cell left is not a part.
    A film with one part only is called by the name of the film.  With several films, the names of
    their groups follow that of the film.

    Returns:
        The names of all parts, and for each film the numbers (cells,) of its cells' parts in that
        list.
    """
    names: list[str] = []
    parts: list[Integers] = []
    for film in films:
        film_names, film_parts = _groups_of_film(film)
        if len(films) > 1 and len(film_names) > 1:
            film_names = [f"{film.name}: {name}" for name in film_names]
        parts.append(film_parts + len(names))
        names += film_names
    return names, parts


def _groups_of_film(film: Membrane) -> tuple[list[str], Integers]:
    """Return the names of the parts of one film, and the part of each of this rank's own cells.

    A part is a group of cells of the mesh, or "rest" for the cells in no group.  Collective.

    Returns:
        names, the same on all ranks, and numbers (cells,) into them.
    """
    # The cells of a reduced film are those of the film that was reduced.
    mesh = film.full.mesh
    count = mesh.domain.topology.index_map(2).size_local
    surfaces = [(name, cells) for name, (dim, cells) in mesh.groups.items() if dim == 2]
    names = [name for name, _ in surfaces] + ["rest"]
    rest = len(surfaces)
    of_cells = np.full(count, rest, dtype=np.int64)
    for k, (_, cells) in enumerate(surfaces):
        owned = cells[cells < count]
        of_cells[owned] = k
    # A part counts if any rank has a cell of it, so that all ranks have the same list.
    here = np.bincount(of_cells, minlength=len(names)) > 0
    everywhere = film.comm.allreduce(here.astype(np.int64))
    visible = np.flatnonzero(everywhere)
    if len(visible) < 2:
        return [film.name], np.zeros(count, dtype=np.int64)
    numbers = np.searchsorted(visible, of_cells).astype(np.int64)
    return [names[k] for k in visible], numbers


# ---- arrays for scripts --------------------------------------------------------------------------


@check_arguments
def positions(state: HasSystem, body: Body) -> Array:
    """Positions (n, 3) [m] of this rank's nodes of a body.  Collective.

    Args:
        state: a `Simulation` in its current state, or an `Equilibrium`.
        body: a body of its scene; a reduced film has the nodes of the film that was reduced.

    Returns:
        A copy, which does not change with the state.

    Raises:
        InputError: the body is not in the scene.

    Example:
        >>> gx.fields.positions(run, mass)
        array([[ 0.,  0., -1.]])
    """
    return state.system.unknowns.state[body].node_positions().copy()


@check_arguments
def field_values(
    state: HasSystem, body: MeshBody, *, field: str, at: At = "mean"
) -> tuple[Array, Array]:
    """Points and values of a field on this rank's part of a body.  Collective.

    Args:
        state: a `Simulation` in its current state, or an `Equilibrium`.
        body: a film, plate, cable or beam of its scene.
        field: e.g. "displacement" [m], "strain1", "stress1" [Pa] or "state"; the error of a wrong
            name lists those of the body.
        at: "mean" for stresses, tensions, moments and states of films as means over the last step,
            or "end" for those at its end; of an equilibrium both are the same.

    Returns:
        Points (n, 3) [m] on the stress-free shape, and values (n,) or (n, 3) at these points.
        Fields that jump between cells have points of each cell, so a node occurs several times.

    Raises:
        InputError: the body is not in the scene, has no mesh, or does not have the field.

    Example:
        >>> scene = gx.Scene(film, gx.Fixed(film, "left"))
        >>> points, strain = gx.fields.field_values(
        ...     gx.Simulation(scene, gx.Midpoint(dt=0.1)), film, field="strain1"
        ... )
        >>> float(abs(strain).max()) < 1e-12
        True
    """
    fields = FieldFunctions(state.system, body, [field], at=at)
    fields.update()
    function = fields.functions[0]
    space = function.function_space
    # Ghosts follow the owned points; other ranks return those.
    owned = space.dofmap.index_map.size_local
    components = space.dofmap.index_map_bs
    points = np.asarray(space.tabulate_dof_coordinates()[:owned])
    values: Array = function.x.array.reshape(-1, components)[:owned].copy()
    if components == 1:
        values = values[:, 0]
    return points, values
