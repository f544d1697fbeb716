"""Chambers of films that are sewn together, and the strips that close them along seams.

Problem.  The panels of a sewn body have separate edges.  Along a seam the edges of two panels are
tied, but with different meshes they do not coincide between the nodes, and while the seam closes
they are apart.  The volume, its gradient and the pressure force need a closed surface: only then is
the resultant of the pressure zero.

Idea.  A strip spans the gap.  With σ the fraction of arc length,

    x(σ, r) = (1 - r) x_a(σ) + r x_b(σ),    0 <= r <= 1,

and its segments are patches of the surface, as the strips of a ring are, see `gas.patches`.  Where
the edges coincide the strip has no area and costs nothing but its evaluation.

Algorithm.

1. The nodes of both edges divide the strip in segments, on each of which x_a and x_b are
   polynomials.
2. The surface is closed if every edge of a triangle is that of another triangle, or on a seam once.
3. Normals of different films are turned so that they agree across the seams: a film whose normals
   point the other way counts with the sign -1.

Limits.  Where several open seams meet, the polygon between their ends is not spanned.  It vanishes
when the seams are closed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.edge_lines import EdgeLine, SewnEdges, shape_functions
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.gas.enclosure import CompiledEnclosure, CompiledSurface, Enclosure
from gossamer_fx.mechanics.gas.film_area import all_triangles
from gossamer_fx.mechanics.gas.patches import Patches, Side, Triangles, is_owned
from gossamer_fx.mechanics.gas.ring import QUADRATURE_DEGREE_ACROSS, quadrature
from gossamer_fx.mechanics.gas.surface import Geometry
from gossamer_fx.mechanics.terms.assembly import Assembly

# Parts of an edge that are shorter than this fraction of the seam are left out: the strip has no
# gap there.
SHORTEST_SEGMENT = 1e-12


def seam_patches(line_a: EdgeLine, line_b: EdgeLine, system: Assembly) -> Patches:
    """The strip between the two aligned edges of a seam as patches, its segments, each on the rank
    that owns its first node.

    Sizes: n segments, k nodes of a segment, g quadrature points.  In the code s and r are the
    points along and across a segment, from 0 to 1; ξ0 and ξ1 are the local coordinates of its ends
    on an edge, ξ those of its points; N and dN are shape functions and their derivatives.
    """
    # Fractions of arc length, ascending from 0 to 1, at which segments begin and end.
    cuts = np.union1d(line_a.fractions, line_b.fractions)
    is_long = np.diff(cuts) > SHORTEST_SEGMENT
    begins = cuts[:-1][is_long]
    ends = cuts[1:][is_long]
    order = max(line_a.order, line_b.order)
    s, weights_s = quadrature(3 * order - 1)
    r, weights_r = quadrature(QUADRATURE_DEGREE_ACROSS)
    nodes = []
    values = []
    along = []
    across = []
    for line, share, slope in ((line_a, 1 - r, -1.0), (line_b, r, 1.0)):
        edges, ξ0, ξ1 = _edges_of(line, begins, ends)
        ξ = ξ0[:, None] + (ξ1 - ξ0)[:, None] * s
        N, dN = shape_functions(line.order, ξ.ravel())
        shape = (len(ξ0), len(s), line.order + 1)
        N = N.reshape(shape)
        dN = dN.reshape(shape) * (ξ1 - ξ0)[:, None, None]
        values.append(_at_points(N, share))
        along.append(_at_points(dN, share))
        across.append(_at_points(N, np.full(len(r), slope)))
        numbers = line.nodes[edges]
        first = system.block(line.body).to_global(numbers.ravel())[:, 0]
        nodes.append(first.reshape(numbers.shape))
    weights = np.outer(weights_s, weights_r).ravel()
    indices = np.concatenate(nodes, axis=1)
    mine = is_owned(indices[:, 0], system.numbering)
    return Patches(
        nodes=indices[mine],
        along=np.concatenate(along, axis=2)[mine],
        across=np.concatenate(across, axis=2)[mine],
        test=np.concatenate(values, axis=2)[mine] * weights[:, None],
    )


def _edges_of(line: EdgeLine, begins: Array, ends: Array) -> tuple[np.ndarray, Array, Array]:
    """Return the number of the edge of a line on which each of n segments lies (n,), and the local
    coordinates, 0 to 1, of its begin and end on it (n,); `begins` and `ends` (n,) are fractions of
    arc length, none across a node."""
    middle = (begins + ends) / 2
    edges = np.searchsorted(line.fractions, middle, side="right") - 1
    start = line.fractions[edges]
    width = line.fractions[edges + 1] - start
    return edges, (begins - start) / width, (ends - start) / width


class SewnEnclosure(Enclosure):
    """The volume inside films, each as a whole, that are sewn together along all of their open
    edges."""

    def __init__(self, films: Sequence[Membrane], seams: Sequence[SewnEdges], chamber: str) -> None:
        check(
            bool(films) and bool(seams),
            f"Chamber '{chamber}': several films are given without seams; "
            "give the seams that close them.",
        )
        self._films = tuple(films)
        self.seams = tuple(seams)
        self.chamber = chamber

    @property
    def films(self) -> Sequence[Membrane]:
        """The films that are sewn."""
        return self._films

    @property
    def whole_films(self) -> Sequence[Membrane]:
        """All of its films."""
        return self.films

    def cells(self, film: Membrane) -> np.ndarray:
        """All local triangles of one of its films."""
        return all_triangles(film)

    def requires(self) -> Iterable[Any]:
        yield from self.films
        yield from self.seams

    def compile(self, system: Assembly, geometry: Geometry) -> CompiledEnclosure:
        """The volume inside the films in a running scene.  Collective.  `InputError`: the surface
        is open, an edge is sewn twice, a seam is on another film, or normals of neighbouring
        triangles are opposite."""
        lines = [seam.lines(system.initial) for seam in self.seams]
        signs, strip_signs = self._orient(lines)
        sides: list[Side] = []
        for film, sign in zip(self.films, signs, strict=True):
            owned = film.mesh.domain.topology.index_map(2).size_local
            cells = self.cells(film)
            sides.append((Triangles(film, cells[cells < owned]), sign))
        for (line_a, line_b), sign in zip(lines, strip_signs, strict=True):
            sides.append((seam_patches(line_a, line_b, system), sign))
        return CompiledSurface(geometry.surfaces, sides)

    def _orient(
        self, lines: Sequence[tuple[EdgeLine, EdgeLine]]
    ) -> tuple[list[float], list[float]]:
        """Return the signs, 1 or -1, of sewn films, and of strips along seams, with which all
        normals agree.  Collective.  `InputError`: no seam joins a film to the others, normals
        change sides across a seam, or the surface is open."""
        passed = self._directions(lines)
        # a and b number the films on both sides of a seam.
        numbers = {id(film): k for k, film in enumerate(self.films)}
        signs = [0.0] * len(self.films)
        signs[0] = 1.0
        # Signs go from film to film across the seams, at most as often as there are films.
        for _ in self.films:
            for (line_a, line_b), (d_a, d_b) in zip(lines, passed, strict=True):
                a = numbers[id(line_a.body)]
                b = numbers[id(line_b.body)]
                if signs[a] and not signs[b]:
                    signs[b] = -signs[a] * d_a * d_b
                elif signs[b] and not signs[a]:
                    signs[a] = -signs[b] * d_a * d_b
        for film, sign in zip(self.films, signs, strict=True):
            check(
                sign != 0,
                f"Chamber '{self.chamber}': no seam joins '{film.name}' to the other films; "
                "sew it to them, or leave it out.",
            )
        strip_signs = []
        for seam, (line_a, line_b), (d_a, d_b) in zip(self.seams, lines, passed, strict=True):
            of_a = signs[numbers[id(line_a.body)]] * d_a
            of_b = signs[numbers[id(line_b.body)]] * d_b
            check(
                of_a == -of_b,
                f"Chamber '{self.chamber}': "
                f"normals of the films change sides across '{seam.name}'; "
                "orient the panels consistently (gmsh: model.mesh.reverse).",
            )
            # The strip passes the edges of a against the film, as a neighbour triangle would.
            strip_signs.append(-of_a)
        return signs, strip_signs

    def _directions(self, lines: Sequence[tuple[EdgeLine, EdgeLine]]) -> list[tuple[float, float]]:
        """Return for both edges of each seam 1 if triangles pass it in the direction in which its
        nodes are listed, else -1.  Collective.  `InputError`: an edge of a film is open or sewn
        twice, a seam is on another film, or neighbouring triangles have opposite normals."""
        sums = np.zeros((len(lines), 2))
        is_open = 0
        is_twisted = 0
        for film in self.films:
            table = film.mesh.edges
            count, directions = table.tally(self.cells(film))
            is_twisted += int(((count == 2) & (directions != 0)).sum())
            ends = table.ends[: table.owned]
            for k, both in enumerate(lines):
                for side, line in enumerate(both):
                    if line.body is film:
                        along = line.directions(ends)
                        sums[k, side] += along @ directions
                        count += along != 0
            is_open += int((count != 2).sum())
        comm = self.films[0].comm
        is_open, is_twisted = comm.allreduce(np.array([is_open, is_twisted])).tolist()
        for seam, both in zip(self.seams, lines, strict=True):
            for line in both:
                check(
                    any(line.body is film for film in self.films),
                    f"Chamber '{self.chamber}': the seam '{seam.name}' is on '{line.body.name}', "
                    "which does not bound it; add the film to the enclosure.",
                )
        names = ", ".join(f"'{film.name}'" for film in self.films)
        check(
            is_open == 0,
            f"Chamber '{self.chamber}': {is_open} edges of {names} are open, or sewn twice; "
            "give each open edge of the panels one seam.",
        )
        sums = comm.allreduce(sums)
        lengths = np.array([[len(line.nodes) for line in both] for both in lines])
        check(
            is_twisted == 0 and bool((np.abs(sums) == lengths).all()),
            f"Chamber '{self.chamber}': neighbouring triangles of {names} have opposite normals; "
            "orient each film consistently (gmsh: model.mesh.reverse).",
        )
        return [(float(a), float(b)) for a, b in np.sign(sums)]


def _at_points(along: Array, sideways: Array) -> Array:
    """Products (n, g, k) of functions along a segment (n, s, k) and across it (r,)."""
    products = np.einsum("nsk,r->nsrk", along, sideways.ravel())
    return products.reshape(len(along), -1, along.shape[2])
