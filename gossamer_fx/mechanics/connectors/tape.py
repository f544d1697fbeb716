"""Tapes: cables bonded to a film, without additional unknowns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Annotated, Any

import numpy as np

from gossamer_fx.core.algebra.point_measures import PointMeasure
from gossamer_fx.core.checks.arguments import (
    Column,
    Range,
    at_least,
    check_arguments,
    not_negative,
    positive,
)
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.checks.relations import as_many
from gossamer_fx.core.forms.backend import geometry_nodes
from gossamer_fx.core.laws.tracing import Number
from gossamer_fx.core.model.body import Attached, Port, combine
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import MeasuresMesh, OnBody, Parameter, Term
from gossamer_fx.mechanics.bodies.cable import BarLaw, CableLaw, TensionOnly
from gossamer_fx.mechanics.bodies.frames import DrawnAsLines
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.bodies.piecewise_force import stretch_of, tabulated_bar
from gossamer_fx.mechanics.terms.rows import (
    AttachedKineticEnergy,
    Response,
    RowLaw,
    Rows,
    one_sided_average,
    positive_part,
)

Tension = Annotated[float, not_negative("N")]

EA = Parameter("EA", "N", "EA")
LENGTH_SCALE = Parameter("length_scale", "", "length_scale", changes_mass=True)
LINE_DENSITY = Parameter("line_density", "kg/m", "line_density", changes_mass=True)


def linear_bar(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """ψ = ½ EA L ε² of a bar of length L, ε = ½(λ² - 1)."""
    ε0, ε1 = _cut_strains(e0, e1, numbers)
    return _of_strains((ε0 + ε1) / 2, ε1**2, numbers)


def tension_bar(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """`linear_bar` that only pulls; in a step that passes zero, S_mean = Δψ/Δe."""
    ε0, ε1 = _cut_strains(e0, e1, numbers)
    return _of_strains(one_sided_average(ε0, ε1), positive_part(ε1) ** 2, numbers)


def engineering_bar(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """ψ = ½ EA L x² of a bar of length L, x = λ - 1."""
    λ0, λ1 = (stretch_of(ε) for ε in _cut_strains(e0, e1, numbers))
    mean = (λ0 + λ1) / 2
    return _of_strains((mean - 1) / mean, (λ1 - 1) ** 2, numbers)


def engineering_tension_bar(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """`engineering_bar` that only pulls."""
    λ0, λ1 = (stretch_of(ε) for ε in _cut_strains(e0, e1, numbers))
    mean_pull = one_sided_average(λ0 - 1, λ1 - 1)
    return _of_strains(2 * mean_pull / (λ0 + λ1), positive_part(λ1 - 1) ** 2, numbers)


def cut_tabulated_bar(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """`tabulated_bar` whose length has a scale."""
    return _cut(tabulated_bar, e0, e1, z0, h, numbers)


def cut_hysteretic_bar(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """`hysteretic_bar` whose length has a scale."""
    # Imported here: a scene without tables of unloading does not load it.
    from gossamer_fx.mechanics.bodies.cord_hysteresis import hysteretic_bar

    return _cut(hysteretic_bar, e0, e1, z0, h, numbers)


def cut_scaled_hysteretic_bar(e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """`scaled_hysteretic_bar` whose length has a scale."""
    from gossamer_fx.mechanics.bodies.cord_hysteresis import scaled_hysteretic_bar

    return _cut(scaled_hysteretic_bar, e0, e1, z0, h, numbers)


def _cut_strains(e0: Any, e1: Any, numbers: Any) -> tuple[Any, Any]:
    """Green strains of a bar with the natural length s L, s the scale, from those of the length
    L."""
    square = numbers.length_scale**2
    # Without a difference of nearly equal numbers where the scale is one.
    change = (1 / square - 1) / 2
    return e0[0] / square + change, e1[0] / square + change


def _of_strains(mean: Any, squared: Any, numbers: Any) -> Response:
    """Stress EA s L (mean strain) by the strain of the cut bar, as one by that of the length L, and
    the energy."""
    length = numbers.length * numbers.length_scale
    stress = numbers.EA * length * mean / numbers.length_scale**2
    return Response([stress], energy=numbers.EA * length * squared / 2)


def _cut(law: RowLaw, e0: Any, e1: Any, z0: Any, h: Number, numbers: Any) -> Response:
    """A law of a bar of length `numbers.length` as one whose length has a scale."""
    ε0, ε1 = _cut_strains(e0, e1, numbers)
    length = numbers.length * numbers.length_scale
    response = law([ε0], [ε1], z0, h, SimpleNamespace(**(vars(numbers) | {"length": length})))
    [stress] = response.stress
    return replace(response, stress=[stress / numbers.length_scale**2])


@check_arguments(as_many("bars", "lengths"))
@dataclass(frozen=True, eq=False)
class Tape(OnBody, DrawnAsLines):
    """Bars along a line of a film, each between two points of it that move with the film.

    Stored energy Σ L W(ε) with ε = ½(λ² - 1) of each bar, and its consistent mass.  `along_edges`
    takes the edges of the film's mesh, `through` any line across it, also between nodes.

    Args:
        body: the film or plate that it is bonded to.
        law: `CableLaw`, `TensionOnly` or `TabulatedCable`.
        bars: pairs of points of the film.
        lengths: natural length of each bar [m], positive, shape (n,) for n bars.
        name: name in messages and output.

    Raises:
        InputError: no bars, not as many lengths as bars, a length that is not positive.

    Example:
        >>> tape = gx.connectors.Tape.along_edges(film, gx.CableLaw(6e3, 0.01), edges="left")
        >>> len(tape.bars), round(float(sum(tape.lengths)), 12)
        (4, 1.0)
    """

    body: Membrane
    law: BarLaw
    _: KW_ONLY
    bars: Sequence[tuple[Port, Port]]
    lengths: Column
    name: str = "tape"

    @staticmethod
    @check_arguments
    def along_edges(
        body: Membrane,
        law: BarLaw,
        *,
        edges: str,
        length_factor: Annotated[float, positive()] = 1.0,
        initial_tension: Tension = 0.0,
        name: str = "tape",
    ) -> Tape:
        """A tape along the edges of the mesh in a named group of curves.  Collective.

        Args:
            body: the film or plate; each edge is one bar (order 1) or two (order 2).
            law: energy of the bars per natural length.
            edges: name of the group of curves of the film's mesh.
            length_factor: natural length over that of the edges (dimensionless): below 1 for a
                tendon that is shorter than the seam on which it is.
            initial_tension: tension [N] on the stress-free shape of the film, in place of a factor;
                zero or positive.
            name: name in messages and output.

        Raises:
            InputError: both are given, the factor is not positive, the mesh has no such group of
                curves, or the group has no edges.
        """
        length_factor = _factor(law, length_factor, initial_tension, name)
        table = body.mesh.edges
        space = body.space
        lines = body.mesh.curve(edges, f"Tape '{name}' on '{body.name}'")
        own_lines = lines[lines < table.owned]
        # Nodes of each edge (n, 2 or 3), from one end to the other.
        chains = table.nodes(space, own_lines)
        # Numbers of the mesh as it was read: bars have the same order on any number of ranks.
        geometry = space.mesh.geometry
        vertices_of_cells = space.mesh.topology.connectivity(2, 0).array
        numbers_of_vertices = np.zeros(vertices_of_cells.max(initial=0) + 1, dtype=np.int64)
        points_of_cells = geometry_nodes(space.mesh)[:, :3].ravel()
        numbers_of_vertices[vertices_of_cells] = geometry.input_global_indices[points_of_cells]
        numbers = numbers_of_vertices[table.vertices[own_lines]]
        is_reversed = numbers[:, 0] > numbers[:, 1]
        chains[is_reversed] = chains[is_reversed, ::-1]
        edge_names = [tuple(row) for row in np.sort(numbers, axis=1).tolist()]
        x = space.tabulate_dof_coordinates()
        # An edge of order 2 is two bars, so that its middle node has a bar, too.
        bars_per_edge = chains.shape[1] - 1
        ends = np.concatenate([chains[:, [k, k + 1]] for k in range(bars_per_edge)])
        own_lengths = np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)
        nodes = space.dofmap.index_map.local_to_global(ends.ravel()).reshape(-1, 2)
        # A bar is its edge, the global numbers of its two nodes and its length [m].  All ranks get
        # all bars: a line is short compared with a film.
        own_bars = [
            (edge, *bar, length)
            for edge, bar, length in zip(
                bars_per_edge * edge_names, nodes.tolist(), own_lengths.tolist(), strict=True
            )
        ]
        gathered = body.comm.allgather(own_bars)
        # Sorted by edges; both bars of one edge are on one rank, and stay in their order.
        bars = sorted((bar for of_rank in gathered for bar in of_rank), key=lambda bar: bar[0])
        check(
            len(bars) > 0,
            f"Tape '{name}' on '{body.name}': the group '{edges}' has no edges of the mesh; "
            "put a line of its edges into the group.",
        )
        pairs = [(Port(body, (a,)), Port(body, (b,))) for _, a, b, _ in bars]
        lengths = [length_factor * length for *_, length in bars]
        return MeasuredTape(body, law, bars=pairs, lengths=lengths, name=name)

    @staticmethod
    @check_arguments
    def through(
        body: Membrane,
        law: BarLaw,
        *,
        points: Annotated[Sequence[Sequence[float]], at_least(2)],
        bars_per_segment: Annotated[int, Range(1)],
        length_factor: Annotated[float, positive()] = 1.0,
        initial_tension: Tension = 0.0,
        name: str = "tape",
    ) -> Tape:
        """A tape through given points of the film's mesh, also between nodes.  Collective.

        Args:
            body: the film or plate.
            law: energy of the bars per natural length.
            points: two or more points (3,) [m] of the mesh.
            bars_per_segment: bars of equal length from each point to the next.
            length_factor: natural length over that of the line (dimensionless).
            initial_tension: tension [N] on the stress-free shape of the film, in place of a factor;
                zero or positive.
            name: name in messages and output.

        Raises:
            InputError: both are given, the factor is not positive, there are fewer than two points
                or no bars, or the line leaves the mesh.
        """
        length_factor = _factor(law, length_factor, initial_tension, name)
        corners = np.asarray(points, dtype=float)
        steps = np.arange(bars_per_segment * (len(corners) - 1) + 1) / bars_per_segment
        numbers = np.arange(len(corners))
        nodes = np.column_stack([np.interp(steps, numbers, component) for component in corners.T])
        ports = [body.port_at(node) for node in nodes]
        lengths = length_factor * np.linalg.norm(np.diff(nodes, axis=0), axis=1)
        return MeasuredTape(body, law, bars=list(pairwise(ports)), lengths=lengths, name=name)

    def __post_init__(self) -> None:
        lengths = np.asarray(self.lengths, dtype=float)
        object.__setattr__(self, "lengths", lengths)
        check(
            len(self.bars) > 0 and bool((lengths > 0).all()),
            f"Tape '{self.name}' has no bars, or one without length; "
            "give a line of different points.",
        )

    @property
    def lines_to_draw(self) -> Sequence[tuple[Attached, Attached]]:
        """The two ends of each bar."""
        return self.bars

    def terms(self, start: State) -> Iterable[Term]:
        law = self.law
        L = np.asarray(self.lengths)
        # A line with linear shape functions: ∫ N_i N_j ds = L/6 (1 + δ_ij).
        consistent = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6
        yield AttachedKineticEnergy(
            self.bars,
            law.line_density * L[:, None, None] * consistent,
            numbers={"line_density": law.line_density, "length_scale": 1.0},
            parameters=(LINE_DENSITY, LENGTH_SCALE),
        )
        # e = ε = ½|(x_b - x_a)/L|² - ½
        vectors = [(_stretch(a, b, float(k)),) for (a, b), k in zip(self.bars, L**-2, strict=True)]
        measure = PointMeasure(
            vectors, np.eye(3)[None], np.zeros((1, 3)), np.full((len(L), 1), -0.5)
        )
        function, numbers, variables = _row_law(law)
        all_numbers: dict[str, Any] = {"length": L, "length_scale": 1.0} | numbers
        yield Rows(
            self.name,
            measure,
            function,
            all_numbers,
            (EA, LENGTH_SCALE) if "EA" in numbers else (LENGTH_SCALE,),
            variables=variables,
        )


def _factor(law: BarLaw, factor: float, tension: float, name: str) -> float:
    """Natural length over that of a line on which a tape has a tension [N], or the factor that was
    given instead."""
    if not tension:
        return factor
    check(
        factor == 1.0 and isinstance(law, CableLaw),
        f"Tape '{name}': initial_tension is {tension:g} N with a length_factor of {factor:g} and a "
        f"{type(law).__name__}; give one of both, the tension with a CableLaw or TensionOnly only.",
    )
    assert isinstance(law, CableLaw)
    ratio = tension / law.EA
    stretch = 1 + ratio
    if law.strain == "green":
        # λ (λ² - 1)/2 = N/EA, whose largest real root is sought.
        roots = np.roots([0.5, 0.0, -0.5, -ratio])
        stretch = float(roots[np.abs(roots.imag) < 1e-9].real.max())
    return 1 / stretch


def _row_law(law: BarLaw) -> tuple[RowLaw, dict[str, Any], dict[str, float]]:
    """Law, further numbers and history variables at the start of bars, as a function of the Green
    strain of each."""
    if isinstance(law, CableLaw):
        laws = (linear_bar, tension_bar)
        if law.strain == "engineering":
            laws = (engineering_bar, engineering_tension_bar)
        return laws[isinstance(law, TensionOnly)], {"EA": law.EA}, {}
    # Imported here: a scene without tables does not load them.
    from gossamer_fx.mechanics.bodies.tabulated_cable import TabulatedCable

    check(
        isinstance(law, TabulatedCable),
        f"Tape: the law is a {type(law).__name__}; give a CableLaw, TensionOnly or TabulatedCable.",
    )
    assert isinstance(law, TabulatedCable)
    if not law.has_history:
        return cut_tabulated_bar, law.corners.as_numbers(), {}
    curve = cut_hysteretic_bar
    if law.unloading_rule == "scaled":
        curve = cut_scaled_hysteretic_bar
    return curve, law.hysteresis.as_numbers(), {"largest strain": 0.0}


def _stretch(a: Port, b: Port, square: float) -> Port:
    """The vector √square (x_b - x_a) of two points, as a port."""
    port = combine((square**0.5, -(square**0.5)), (b, a))
    assert isinstance(port, Port)
    return port


class MeasuredTape(Tape, MeasuresMesh):
    """A tape whose natural lengths were measured on the mesh, by `Tape.along_edges` or
    `Tape.through`; those of a `Tape` itself are given numbers."""

    without_mesh = (
        "give its lengths as numbers, Tape(body, law, bars=tape.bars, lengths=tape.lengths)"
    )
