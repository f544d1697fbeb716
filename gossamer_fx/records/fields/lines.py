"""Tension along a cable, beam or tape as arrays, e.g. for a curve over the distance along it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from gossamer_fx.core.algebra.point_measures import evaluated_here
from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.lookups import check_in_scene
from gossamer_fx.core.checks.short_repr import short_repr
from gossamer_fx.core.forms.backend import interpolation_points
from gossamer_fx.core.forms.compilation import compile_expression, compile_form
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.state import HasSystem, vector_key
from gossamer_fx.mechanics.bodies.cable import Curve
from gossamer_fx.mechanics.bodies.frames import DrawnAsLines
from gossamer_fx.mechanics.terms.discrete_gradient import EndPoint
from gossamer_fx.mechanics.terms.rows import CompiledRows, Rows
from gossamer_fx.records.fields.axial_force import GaussValues, axial_strain, stretch, tension
from gossamer_fx.records.fields.body_shape import At, BodyShape, rule_at
from gossamer_fx.records.fields.fields import position
from gossamer_fx.solve.system.system import System

# Difference of coordinates, over their size, below which they are equal
SAME_POSITION = 1e-9

Pairs = list[tuple[object, object]]


@check_arguments
@dataclass(frozen=True, eq=False)
class LineValues:
    """Tension, strain and length of the n elements of a line, the same on every rank.

    Elements are the cells of a cable or beam, the bars of a tape, the ropes of a bundle; a spring,
    rope or tether is one.  Those of a single open line are in their order along it: of a cable or
    beam from the side of the first cell that its mesh was made of, of a tape from the end whose
    initial position has the smaller x, or else y, or else z.

    Attributes:
        points: middles (n, 3) of the elements in their present position [m].
        tension: (n,) [N], negative for compression.
        strain: (n,) of which the tension is a function.
        length: (n,) [m] in the present shape.

    Example:
        >>> tape = gx.connectors.Tape.along_edges(film, gx.CableLaw(6e3, 0.01), edges="left")
        >>> run = gx.Simulation(gx.Scene(film, tape), gx.Midpoint(dt=0.1))
        >>> gx.fields.line_values(run, tape).distance.round(6)
        array([0.125, 0.375, 0.625, 0.875])
    """

    points: Array
    tension: Array
    strain: Array
    length: Array

    __repr__ = short_repr

    @property
    def distance(self) -> Array:
        """Distances (n,) [m] of the middles from the start of the line, along it."""
        return np.cumsum(self.length) - self.length / 2


@check_arguments
def line_values(state: HasSystem, line: Curve | DrawnAsLines, *, at: At = "mean") -> LineValues:
    """Tension, strain and length of each element of a cable, beam or connector.  Collective.

    Args:
        state: a `Simulation` in its current state, or an `Equilibrium`.
        line: a `Cable`, `Beam`, `Tape`, `Spring`, `Rope`, `RopeBundle` or `Tether` of its scene.
        at: "mean" for the mean tension of the last step, or "end" for that at its end; strain and
            length are those at the end.

    Raises:
        InputError: the line is something else, or is not in the scene.

    Example:
        >>> cable = gx.Cable(curve, gx.CableLaw(1e4, 0.01), initial_tension=50.0)
        >>> statics = gx.Equilibrium(gx.Scene(cable, gx.Fixed(cable, "line")))
        >>> values = gx.fields.line_values(statics, cable)
        >>> values.distance.round(6), values.tension.round(6)
        (array([0.125, 0.375, 0.625, 0.875]), array([50., 50., 50., 50.]))
    """
    if isinstance(line, Curve):
        return _of_body(state.system, line, at)
    system = state.system
    forces = line_forces(system, line, at)
    ends = list(line.lines_to_draw)
    points = system.unknowns.state.vectors([end for pair in ends for end in pair])
    middles = points.reshape(-1, 2, 3).mean(axis=1)
    order = _order_along_line([(vector_key(a), vector_key(b)) for a, b in ends])
    # The numbers of bars depend on the number of ranks; initial positions do not.
    first = ends[order[0]]
    last = ends[order[-1]]
    if len(ends) > 1 and _is_before(last[0].initial(), first[0].initial()):
        order = order[::-1]
    return LineValues(
        points=middles[order],
        tension=forces.tensions[order],
        strain=forces.strains[order],
        length=forces.lengths[order],
    )


def _is_before(a: Array, b: Array) -> bool:
    """Whether a point comes before another one by x, or else y, or else z, beyond round-off."""
    difference = a - b
    is_different = np.abs(difference) > SAME_POSITION * np.abs([a, b]).max()
    if not is_different.any():
        return False
    return bool(difference[is_different.argmax()] < 0)


def _of_body(system: System, body: Curve, at: At) -> LineValues:
    """The values of the cells of a cable or beam in their order along it, from all ranks."""
    shape = BodyShape(system, body)
    shape.update()
    quantities = [GaussValues(system, body, quantity, at) for quantity in (tension, axial_strain)]
    columns = []
    for quantity in quantities:
        quantity.update()
        columns.append(quantity.own_values().mean(axis=1))
    mesh = body.space.mesh
    # Ghost cells follow the owned ones; other ranks return those.
    cells = len(columns[0])
    lengths = fem.assemble_vector(compile_form(_length_density(shape))).array[:cells]
    rows = np.column_stack([_middles(shape)[:cells], *columns, lengths])
    mesh.topology.create_connectivity(1, 0)
    vertices = mesh.topology.connectivity(1, 0).array.reshape(-1, 2)[:cells]
    names = mesh.topology.index_map(0).local_to_global(vertices.ravel()).reshape(-1, 2)
    numbers = np.asarray(mesh.topology.original_cell_index)[:cells]
    # A line is short compared with a film: every rank takes all of it.
    gathered = system.comm.allgather((numbers, rows, names))
    as_given = np.concatenate([part for part, _, _ in gathered]).argsort()
    table = np.concatenate([part for _, part, _ in gathered])[as_given]
    pairs = np.concatenate([part for _, _, part in gathered])[as_given]
    order = _order_along_line([tuple(pair) for pair in pairs.tolist()])
    if order[0] > order[-1]:
        order = order[::-1]
    table = table[order]
    return LineValues(
        points=table[:, :3], tension=table[:, 3], strain=table[:, 4], length=table[:, 5]
    )


def _length_density(shape: BodyShape) -> ufl.Form:
    """The length [m] of each cell as a form with one test function for each cell."""
    body = shape.body
    cellwise = fem.functionspace(body.space.mesh, ("Discontinuous Lagrange", 0))
    return stretch(shape) * ufl.TestFunction(cellwise) * body.mass_dx


def _middles(shape: BodyShape) -> Array:
    """Positions (n, 3) [m] of the middles of this rank's n cells, ghosts included."""
    space = fem.functionspace(shape.body.space.mesh, ("Discontinuous Lagrange", 0, (3,)))
    middles = fem.Function(space)
    points = interpolation_points(space)
    middles.interpolate(compile_expression(position(shape.q), points))
    return np.asarray(middles.x.array).reshape(-1, 3)


def _order_along_line(ends: Pairs) -> npt.NDArray[np.int64]:
    """Numbers (n,) of n elements from one end of a line to the other.

    It may begin at either end.  Elements that do not form a single open line stay in their order.
    """
    at_point: dict[object, list[int]] = {}
    for number, pair in enumerate(ends):
        for end in pair:
            at_point.setdefault(end, []).append(number)
    given = np.arange(len(ends))
    # A single open line has two ends, and no point with more than two elements.
    free = [end for end, elements in at_point.items() if len(elements) == 1]
    is_branched = any(len(elements) > 2 for elements in at_point.values())
    if len(free) != 2 or is_branched:
        return given
    order: list[int] = []
    point = free[0]
    while True:
        # Each point has one or two elements; the line goes on through the one not just passed.
        onwards = [number for number in at_point[point] if number not in order[-1:]]
        if not onwards:
            break
        order.append(onwards[0])
        first, second = ends[onwards[0]]
        other_ends = {first: second, second: first}
        point = other_ends[point]
    # A closed line may be separate from the open one.
    if len(order) != len(ends):
        return given
    return np.array(order)


@dataclass(frozen=True)
class LineForces:
    """Tensions and lengths of the n lines of a connector, the same on every rank.

    A spring, rope or tether is one line, a bundle has one for each rope, a tape one for each bar.

    Attributes:
        tensions: (n,) [N], negative for compression; without the force of a damping.  They are
            those of the last step, or at its end.
        lengths: distances (n,) [m] of the two ends.
        natural_lengths: (n,) [m]; of a tether with a brake those in this state.
        weights: shares (n,) of the lines in the mean of the connector, whose sum is one.
        alternating: share of the lines that are taut at one end of the last step only; zero of
            those that bear compression, and of the ropes on reels.
    """

    tensions: Array
    lengths: Array
    natural_lengths: Array
    weights: Array
    alternating: float = 0.0

    @property
    def strains(self) -> Array:
        """Changes of length over the natural lengths (n,); infinite where these are zero."""
        with np.errstate(divide="ignore"):
            found: Array = self.lengths / self.natural_lengths - 1
        return found


def line_forces(system: System, connector: DrawnAsLines, at: At) -> LineForces:
    """Tensions of a connector in the last step, and lengths at its end.  Collective."""
    terms = system.unknowns.terms_of(connector)
    check_in_scene(f"'{connector.name}'", bool(terms))
    stored = [term for term in terms if isinstance(term, Rows) and term.stores]
    return _joined([_of_stored_energy(system, term, connector, at) for term in stored])


def _of_stored_energy(system: System, term: Rows, connector: DrawnAsLines, at: At) -> LineForces:
    """Tensions of the lines of one stored energy.

    The measure is e = ½ α l² + c of the length l.  With the stress S = dψ/de the tension is
    dψ/dl = S α l = 2 S (e - c)/l.  A spring has α = 1 and c = 0.  A tape has a multiple of
    ½(l²/L² - 1), so that l²/L² = (c - e)/c.  The mean force of a step acts in its middle, whose
    length is that of the tension.
    """
    [compiled] = system.equations.compiled_as(CompiledRows)
    count = len(term.measure.ports)
    is_tape = bool(np.any(term.measure.c))
    if is_tape:
        tape: Any = connector
        natural = np.asarray(tape.lengths, dtype=np.float64)
    elif term.history is not None:
        # That of a tether, which changes
        natural = compiled.variables_of(term)[:, 0].astype(np.float64)
    else:
        natural = np.broadcast_to(compiled.get_number(term, "L"), count).astype(np.float64)
    # Each line is evaluated on one rank: the sum over all ranks is its tension.
    here = evaluated_here(term.measure.ports)
    # Rows: tension [N], length at the end [m], and whether the line is taut at one end only.
    own_values = np.zeros((3, count))
    # Lengths of which a tape has its strains.
    nominal = natural
    if is_tape:
        natural = nominal * float(compiled.get_number(term, "length_scale")[0])
    offset = np.broadcast_to(term.measure.c, (count, 1))[here, 0]

    def length(quadratic_part: Array) -> Array:
        """Lengths (r,) [m] of which ½ α l² (r,) is given."""
        if is_tape:
            return nominal[here] * np.sqrt(np.maximum(-quadratic_part / offset, 0.0))
        return np.sqrt(2 * np.maximum(quadratic_part, 0.0))

    measure, stress = compiled.stresses(term, rule_at(at, system))
    quadratic_part = measure[:, 0] - offset
    acting_length = length(quadratic_part)
    # Coincident ends have no direction, and no tension along it.
    own_values[0, here] = np.divide(
        2 * stress[:, 0] * quadratic_part,
        acting_length,
        out=np.zeros(len(here)),
        where=acting_length > 0,
    )
    at_end, stress_at_end = compiled.stresses(term, EndPoint())
    own_values[1, here] = length(at_end[:, 0] - offset)
    if not system.unknowns.rule.acts_at_end:
        _, stress_at_start = compiled.stresses(term, EndPoint(), at_start=True)
        # Springs are never without any stress.
        own_values[2, here] = (stress_at_end[:, 0] == 0) != (stress_at_start[:, 0] == 0)
    tensions, lengths, alternates = system.comm.allreduce(own_values)
    weights = np.full(count, 1 / count)
    if is_tape:
        # Bars are parts of one line, and count by their lengths; ropes are lines by themselves.
        weights = natural / natural.sum()
    return LineForces(tensions, lengths, natural, weights, float(weights @ alternates))


def _joined(parts: list[LineForces]) -> LineForces:
    """The lines of several parts, each of which has the same weight in the mean."""
    weights = np.concatenate([part.weights for part in parts])
    return LineForces(
        tensions=np.concatenate([part.tensions for part in parts]),
        lengths=np.concatenate([part.lengths for part in parts]),
        natural_lengths=np.concatenate([part.natural_lengths for part in parts]),
        weights=weights / weights.sum(),
        alternating=float(np.mean([part.alternating for part in parts])),
    )
