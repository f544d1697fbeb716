"""Ties and seams, which connect lines of films and cables.

A tie (`Tie`) holds a line of a film or cable on another from the start: each of its nodes stays at
the point of the other line where it is.  A seam (`Seam`) first draws two edges of films together.

Problem of seams.  A gossamer body is sewn or welded from panels that are cut flat and apart.  Their
edges do not coincide at the start, are curved differently, and their meshes may differ.

Idea.  Points of both edges belong together by the fraction σ of arc length on the cut pattern.  The
distance of a pair shrinks as a function of time,

    x_a(σ, t) - x_b(σ, t) = (1 - s(t)) (X_a(σ) - X_b(σ)),                                        (1)

with X the positions at the start of the scene and s rising from 0 to 1.  This is a linear
constraint with a moving right-hand side: the work of its multipliers counts as supplied, and it
keeps momentum, as both sides bear opposite forces.  An open gap has the direction that it had at
the start, so that something outside bears a moment until it is closed.  With s = 1 it is a tie.

Algorithm.

1. The edges are ordered as lines and turned so that points of like σ are near each other.
2. (1) is imposed for the nodes of the line with more nodes; the other side is interpolated between
   the nodes of the edge at σ (`bodies.edge_lines`).
3. s is the polynomial of degree five without rates and accelerations at both ends, so that the
   initial velocities fit, and no shock ends the sewing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import RISING, check_arguments, not_negative
from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.checks.relations import different
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.model.body import Array, MeshBody, Port
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import MeasuresMesh, MeasuresStart, Term
from gossamer_fx.mechanics.bodies.beam import Beam
from gossamer_fx.mechanics.bodies.edge_lines import EdgeLine, SewnEdges, aligned, edge_line
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.bodies.meshed import Meshed
from gossamer_fx.mechanics.constraints.joint import COINCIDE, coincidence
from gossamer_fx.mechanics.terms.point_constraints import PointConstraint

# Distance of a point from the end of a segment, over the length of the segment, below which it
# counts as the end, and depends on one node only.
NODE = 1e-9

Time = Annotated[float, not_negative("s")]


def have_points_between_nodes(terms: Iterable[Term], comm: MPI.Intracomm) -> bool:
    """Whether a tie holds a node at a point between two others, whose fraction depends on the
    meshes; what is tied node to node does not.  Collective."""
    own = False
    for term in terms:
        assert isinstance(term, PointConstraint)
        ports = [port for pair in term.measure.ports for port in pair if isinstance(port, Port)]
        own |= any(len(port.nodes) > 1 for port in ports)
    return bool(comm.allreduce(own, op=MPI.LOR))


@check_arguments(different(("a", "b"), ("group_a", "group_b"), give="another line"))
@dataclass(frozen=True, eq=False)
class Tie(MeasuresMesh):
    """A tie: the nodes of a line of one film or cable stay where they are at the start on a line of
    another.

        x_k - (1 - s) x_i - s x_j = 0

    for every node k of the first line, at the fraction s between nodes i and j of the second one.

    Meshes may differ: tie the finer line to the coarser one.  Three films on a line: tie two of
    them to the third.  Multipliers do no work and keep both momenta.  Matching lines are found
    where the scene starts, also of a folded film, as long as no other part of the second line is at
    the same point. `Contact` takes what is tied as connected.

    Args:
        a: a film or cable, whose nodes are tied.
        b: a film or cable, or the same one.
        group_a: name of a curve (of a cable also of points) of the mesh of `a`; None: all of a
            cable.
        group_b: name of a curve of the mesh of `b`; None: all of a cable.
        name: name in messages and output.

    Raises:
        InputError: beams (join their ends by joints), a film without a group, a line tied to
            itself; when the scene is compiled: nodes that are not on the other line.

    Example:
        >>> hem = gx.Cable(curve, gx.CableLaw(1e4, 0.01), name="hem")
        >>> gx.Tie(hem, film, group_b="bottom").name
        'hem/all tied to film/bottom'
    """

    a: Meshed
    b: Meshed
    _: KW_ONLY
    group_a: str | None = None
    group_b: str | None = None
    name: str = ""

    def __post_init__(self) -> None:
        sides = ((self.a, self.group_a), (self.b, self.group_b))
        for body, group in sides:
            check(
                not isinstance(body, Beam) and isinstance(body, MeshBody),
                f"Tie: '{body.name}' is not a film or cable; join others by joints.",
            )
            check(
                group is not None or body.space.mesh.topology.dim == 1,
                f"Tie: of the film '{body.name}' one line is tied; name a curve of its mesh.",
            )
        if not self.name:
            words = [f"{body.name}/{group or 'all'}" for body, group in sides]
            object.__setattr__(self, "name", " tied to ".join(words))
        # Groups that do not exist are refused here, before a scene is compiled.
        if self.group_a is not None:
            self.a.mesh.group(self.group_a, f"Tie of '{self.a.name}'")
        if self.group_b is not None:
            self.b.mesh.curve(self.group_b, f"Tie of '{self.b.name}'")

    def requires(self) -> Iterable[Any]:
        yield self.a
        yield self.b

    def terms(self, start: State) -> Iterable[Term]:
        yield coincidence(self.name, *self._pairs(start))

    def depends_on_mesh(self, terms: Sequence[Term], t: float) -> bool:
        return have_points_between_nodes(terms, self.a.comm)

    def _pairs(self, start: State) -> list[tuple[Port, Port]]:
        """This rank's nodes of the first line, each with its point of the second line, as ports.
        Collective."""
        comm = self.a.comm
        index_map = self.a.block.index_map
        nodes = np.arange(index_map.size_local)
        if self.group_a is not None:
            nodes = self.a.nodes(self.group_a)
        # Each node is tied on the rank that owns it.
        own = np.asarray(nodes[nodes < index_map.size_local], dtype=np.int32)
        x = start[self.a].positions()[own]
        ends, segments = self._segments(start)
        check(
            len(ends) > 0,
            f"'{self.name}': the group '{self.group_b}' has no edges; "
            f"name a line of '{self.b.name}'.",
        )
        count = comm.allreduce(len(own))
        check(
            count > 0,
            f"'{self.name}': the group '{self.group_a}' has no nodes; "
            f"name a line of '{self.a.name}'.",
        )
        which, fractions, distance = _nearest(x, segments)
        far = comm.allreduce(float(distance.max(initial=0.0)), op=MPI.MAX)
        check_on_all(
            comm,
            far <= COINCIDE * start.extent(),
            f"'{self.name}': "
            f"nodes of the first are up to {far:.3g} m away from the second line at the start; "
            "let them lie on it.",
        )
        numbers = index_map.local_to_global(own)
        pairs = []
        for node, segment, fraction in zip(numbers, which, fractions, strict=True):
            point = _between(self.b, ends[segment], float(fraction))
            pairs.append((Port(self.a, (int(node),)), point))
        return pairs

    def _segments(self, start: State) -> tuple[npt.NDArray[np.int64], Array]:
        """The straight pieces of the second line, on every rank: global nodes (n, 2) of their ends,
        and initial positions (n, 2, 3) [m].  Collective."""
        body = self.b
        space = body.space
        mesh = space.mesh
        if mesh.topology.dim == 2:
            edges = body.mesh.curve(str(self.group_b), self.name)
            local = body.mesh.edges.nodes(space, edges[edges < body.mesh.edges.owned])
        else:
            own = mesh.topology.index_map(1).size_local
            cells = np.arange(own)
            if self.group_b is not None:
                cells = body.mesh.curve(self.group_b, self.name)
            local = cell_nodes(space)[cells[cells < own]]
            # dolfinx has the middle of a quadratic line after its ends.
            if local.shape[1] == 3:
                local = local[:, [0, 2, 1]]
        # A quadratic edge is two straight pieces.
        pieces = np.concatenate([local[:, k : k + 2] for k in range(local.shape[1] - 1)])
        local_nodes = pieces.ravel().astype(np.int32)
        mine = body.block.index_map.local_to_global(local_nodes).reshape(-1, 2)
        x_mine = start[body].local_positions()[pieces].reshape(-1, 2, 3)
        # Lines are short compared with films: every rank may know all of the second one.
        parts = body.comm.allgather((mine, x_mine))
        nodes = np.concatenate([nodes_of_rank for nodes_of_rank, _ in parts])
        positions = np.concatenate([x_of_rank for _, x_of_rank in parts])
        return nodes, positions


def _nearest(x: Array, segments: Array) -> tuple[npt.NDArray[np.intp], Array, Array]:
    """The nearest of the segments (m, 2, 3) [m] of each point x (n, 3) [m]: its index, the position
    on it from 0 to 1, and the distance [m], (n,) each."""
    # Starts a and differences d (m, 3) of the ends; s (m,): nearest position on each segment.
    a = segments[:, 0]
    d = segments[:, 1] - a
    squared_length = np.einsum("mc,mc->m", d, d)
    found = np.zeros(len(x), dtype=np.intp)
    fractions = np.zeros(len(x))
    distances = np.zeros(len(x))
    # Point by point: arrays over all pairs would need memory for n m of them.
    for k, point in enumerate(x):
        along = np.einsum("mc,mc->m", point - a, d)
        s = np.clip(along / squared_length, 0, 1)
        distance = np.linalg.norm(a + s[:, None] * d - point, axis=1)
        i = int(distance.argmin())
        found[k] = i
        fractions[k] = s[i]
        distances[k] = distance[i]
    return found, fractions, distances


def _between(body: Meshed, ends: npt.NDArray[np.int64], s: float) -> Port:
    """The point at s, from 0 to 1, between two global nodes (2,); the node itself at an end."""
    if s < NODE:
        return Port(body, (int(ends[0]),))
    if s > 1 - NODE:
        return Port(body, (int(ends[1]),))
    return Port(body, (int(ends[0]), int(ends[1])), weights=(1 - s, s))


@check_arguments(different(("a", "b"), ("edge_a", "edge_b"), give="two edges"))
@dataclass(frozen=True, eq=False)
class Seam(MeasuresMesh, MeasuresStart, SewnEdges):
    """A seam: two edges of films that are drawn together in a time, and are tied from then on.

        x_a - x_b = (1 - s(t)) (X_a - X_b),    s = 0 before and 1 after `closing`

    Points belong together by the fraction of arc length on the mesh, the cut pattern.  The work of
    drawing them together counts as supplied.  Meshes may differ.  `Contact` takes both edges as
    connected, and `Chamber(seams=...)` takes the seam as closed.  Where several seams meet, one of
    their ties follows from the others and is left out.

    In an `Equilibrium`, close the seam in steps: `find(at=t)` for rising t.  A cord or load tape on
    the seam is a `connectors.Tape` along one of its edges.

    Args:
        a: a film or plate.
        edge_a: name of a line of its mesh.
        b: another one, or the same.
        edge_b: name of a line of its mesh.
        closing: times [s] at which the sewing begins and ends; None: the edges coincide at the
            start, e.g. after `StartFrom`.
        max_ease: largest difference of the lengths of both edges, over the shorter one.
        name: name in messages and output.

    Raises:
        InputError: a group that is not one line, an open and a closed line, lines of different
            length, one line twice, times that are negative or not rising.

    Example:
        >>> tube = gx.Seam(film, "left", film, "right")
        >>> tube.name, round(tube.ease, 12)
        ('film/left sewn to film/right', 0.0)
    """

    a: Membrane
    edge_a: str
    b: Membrane
    edge_b: str
    _: KW_ONLY
    closing: Annotated[tuple[Time, Time], RISING] | None = (0.0, 1.0)
    max_ease: Annotated[float, not_negative()] = 0.02
    name: str = ""

    def __post_init__(self) -> None:
        if not self.name:
            words = f"{self.a.name}/{self.edge_a} sewn to {self.b.name}/{self.edge_b}"
            object.__setattr__(self, "name", words)
        line_a, line_b = self._lines
        check(
            line_a.is_closed == line_b.is_closed,
            f"Seam '{self.name}': one of its edges is closed and the other is open; "
            "cut both alike.",
        )
        # Relative to the shorter line, so that the order of the edges does not matter.
        difference = max(self.ease, 1 / (1 + self.ease) - 1)
        check(
            difference <= self.max_ease,
            f"Seam '{self.name}': "
            f"its edges are {line_a.length:.4g} m and {line_b.length:.4g} m long, "
            f"{difference:.1%} apart; cut them alike, or allow it by max_ease={difference:.2g}.",
        )

    @cached_property
    def _lines(self) -> tuple[EdgeLine, EdgeLine]:
        """Both edges, not yet aligned."""
        user = f"Seam '{self.name}'"
        # Cached: following edges around a mesh is collective and takes time.
        return edge_line(self.a, self.edge_a, user), edge_line(self.b, self.edge_b, user)

    @property
    def ease(self) -> float:
        """Length of the first edge over that of the second, less 1."""
        line_a, line_b = self._lines
        return line_a.length / line_b.length - 1

    def lines(self, start: State) -> tuple[EdgeLine, EdgeLine]:
        """Both edges; the second is walked such that points of like fractions of arc length belong
        together, i.e. are close in the initial state.  Collective."""
        line_a, line_b = self._lines
        return line_a, aligned(line_a, line_b, start)

    @check_arguments
    def openness(self, t: float) -> float:
        """1 - s at a time t [s]: 1 before the sewing, 0 after it, and 0 without `closing`."""
        if self.closing is None:
            return 0.0
        begin, end = self.closing
        # Rate and acceleration are zero at both ends, so that the sewing excites no vibration.
        τ = min(max((t - begin) / (end - begin), 0.0), 1.0)
        return 1 - τ**3 * (10 - 15 * τ + 6 * τ**2)

    def requires(self) -> Iterable[Any]:
        yield self.a
        yield self.b

    def keeps_measures(self) -> bool:
        # The gap that it closes.
        return self.closing is not None

    def terms(self, start: State) -> Iterable[Term]:
        """The constraint (1) of the module for each node of the finer edge and its point of the
        other one.  Collective."""
        closing = None if self.closing is None else self.openness
        # Where seams meet, their constraints repeat each other; that is meant.
        joined = coincidence(self.name, *self._pairs(start))
        yield replace(joined, closing=closing, may_repeat=True)

    def depends_on_mesh(self, terms: Sequence[Term], t: float) -> bool:
        # An open seam has the gap of the start.
        return self.openness(t) > 0 or have_points_between_nodes(terms, self.a.comm)

    def _pairs(self, start: State) -> list[tuple[Port, Port]]:
        """Nodes of the edge with more nodes, each with its point of the other edge by the fraction
        of arc length, as ports; nodes that both edges have are left out.  Collective."""
        line_a, line_b = self.lines(start)
        # Nodes of the finer line on the coarser one: the other way round nodes of the finer line
        # would stay free, and gaps would open between those that are sewn.
        finer = line_a
        coarser = line_b
        if len(line_b.nodes) * line_b.order > len(line_a.nodes) * line_a.order:
            finer = line_b
            coarser = line_a
        nodes, fractions = finer.all_nodes()
        pairs = []
        for node, fraction in zip(nodes, fractions, strict=True):
            here = Port(finer.body, (int(node),))
            there = coarser.port(float(fraction))
            # A dart begins at a node that both of its edges have.
            is_same = here.body is there.body and here.nodes == there.nodes
            if not is_same:
                pairs.append((here, there))
        check(
            bool(pairs),
            f"Seam '{self.name}': both edges consist of the same nodes; name two edges.",
        )
        return pairs
