"""Seams: edges of films that are cut flat and apart, drawn together and tied.

Problem.  A gossamer body is sewn or welded from flat panels.  Their edges do not coincide at the
start, are curved differently, and their meshes may differ.

Idea.  Points of both edges belong together by the fraction σ of arc length on the cut pattern.  The
distance of a pair shrinks as a function of time,

    x_a(σ, t) - x_b(σ, t) = (1 - s(t)) (X_a(σ) - X_b(σ)),                                        (1)

with X the positions at the start of the scene and s rising from 0 to 1.  This is a linear
constraint with a moving right-hand side: the work of its multipliers counts as supplied, and it
keeps momentum, as both sides bear opposite forces.  An open gap has the direction that it had at
the start, so that something outside bears a moment until it is closed.  With s = 1 it is the
ordinary tie.

Algorithm.

1. The edges are ordered as lines and turned so that points of like σ are near each other.
2. (1) is imposed for the nodes of the line with more nodes; the other side is interpolated between
   the nodes of the edge at σ (`bodies.edge_lines`).
3. s is the polynomial of degree five without rates and accelerations at both ends, so that the
   initial velocities fit, and no shock ends the sewing.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from gossamer_fx.core.algebra.point_measures import PointMeasure
from gossamer_fx.core.checks.arguments import check_arguments, not_negative
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Port
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.edge_lines import EdgeLine, aligned, edge_line
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.terms.point_constraints import Closing, PointConstraint


@check_arguments
@dataclass(frozen=True, eq=False)
class Seam:
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
    closing: tuple[float, float] | None = (0.0, 1.0)
    max_ease: Annotated[float, not_negative()] = 0.02
    name: str = ""

    def __post_init__(self) -> None:
        if not self.name:
            words = f"{self.a.name}/{self.edge_a} sewn to {self.b.name}/{self.edge_b}"
            object.__setattr__(self, "name", words)
        check(
            self.a is not self.b or self.edge_a != self.edge_b,
            f"Seam '{self.name}': the edge is sewn to itself; name two edges.",
        )
        if self.closing is not None:
            begin, end = self.closing
            check(
                0 <= begin < end,
                f"Seam '{self.name}': closing is from {begin:g} to {end:g} s; "
                "give two times that rise, from 0 on.",
            )
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
        """Both edges, turned so that points of like fractions of arc length belong together.
        Collective."""
        line_a, line_b = self._lines
        return line_a, aligned(line_a, line_b, start)

    @check_arguments
    def openness(self, t: float) -> float:
        """1 - s(t): 1 before the sewing, 0 after it."""
        if self.closing is None:
            return 0.0
        begin, end = self.closing
        # Rate and acceleration are zero at both ends, so that the sewing excites no vibration.
        τ = min(max((t - begin) / (end - begin), 0.0), 1.0)
        return 1 - τ**3 * (10 - 15 * τ + 6 * τ**2)

    def requires(self) -> Iterable[Any]:
        yield self.a
        yield self.b

    def terms(self, start: State) -> Iterable[Term]:
        """The constraint x_a - x_b = (1 - s(t)) (X_a - X_b) for each node of the finer edge and its
        point of the other one, with s from 0 to 1 during `closing`.  Collective."""
        pairs = self._pairs(start)
        difference = np.hstack([np.eye(3), -np.eye(3)])
        measure = PointMeasure(pairs, np.zeros((3, 6, 6)), difference, np.zeros(3))
        closing = None
        if self.closing is not None:
            closing = Closing(self.openness)
        # Where seams meet, their constraints repeat each other; that is meant.
        yield PointConstraint(self.name, measure, closing=closing, may_repeat=True)

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
