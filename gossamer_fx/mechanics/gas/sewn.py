"""Chambers of films that are sewn together, and the strips that close them along seams.

Problem.  The panels of a sewn body have separate edges.  Along a seam the edges of two panels are
tied, but with different meshes they do not coincide between the nodes, and while the seam closes
they are apart.  The volume, its gradient and the pressure force need a closed surface: only then is
the resultant of the pressure zero.

Idea.  A strip spans the gap.  With σ the fraction of arc length,

    x(σ, r) = (1 - r) x_a(σ) + r x_b(σ),    0 <= r <= 1,

and the volume of the strip, its gradient and tangent are those of the strips of a ring, see
`gas.ring`.  Where the edges coincide the strip has no area and costs nothing but its evaluation.

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
from dataclasses import dataclass
from typing import Any

import basix
import numpy as np
from petsc4py import PETSc

from gossamer_fx.core.algebra.point_measures import Gather, add_blocks
from gossamer_fx.core.algebra.rotations import cross_matrices
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Array
from gossamer_fx.mechanics.bodies.edge_lines import EdgeLine, SewnEdges, shape_functions
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.gas.enclosure import ROUND_OFF, CompiledEnclosure, all_triangles
from gossamer_fx.mechanics.gas.surface import FilmSurface, Geometry, Side
from gossamer_fx.mechanics.terms.assembly import Assembly

# Parts of an edge that are shorter than this fraction of the seam are left out: the strip has no
# gap there.
SHORTEST_SEGMENT = 1e-12

# The volume of a strip is quadratic across it, see `gas.ring`.
QUADRATURE_DEGREE_ACROSS = 2


class SeamStrip:
    """The strip between the two aligned edges of a seam in a running scene; see the module.

    Sizes: n segments, k nodes of a segment, g quadrature points.  `_X0` and `_X1` (n, k, 3) [m] are
    the positions of the nodes of the segments at the start and at the end of a step, zero until
    they are set.

    Attributes:
        volume: ⅓ ∫ x·n over the strip at q1 [m³], n = x,σ × x,r; the same on every rank.
        magnitude: sum of the sizes of the terms that add up to three volumes [m³].
        swept: the volume that the strip sweeps in the step [m³].
    """

    def __init__(self, line_a: EdgeLine, line_b: EdgeLine, system: Assembly) -> None:
        """Divide the strip between two edges at the nodes of both, and tabulate its shape
        functions.  Collective."""
        self._system = system
        # Weight of the end of a step in the positions where forces act: ½, or 1 at its end.
        self._alpha = system.rule.alpha
        self._acts_at_end = system.rule.acts_at_end
        self.volume = 0.0
        self.magnitude = 0.0
        self.swept = 0.0
        self._initial_volume = 0.0
        cuts = np.union1d(line_a.fractions, line_b.fractions)
        self._tabulate(line_a, line_b, cuts)
        columns = []
        for line in (line_a, line_b):
            edges = self._edges_of(line, self._begins, self._ends)[0]
            numbers = system.block(line.body).to_global(line.nodes[edges].ravel())
            columns.append(numbers[:, :3].reshape(*line.nodes[edges].shape, 3))
        # Global indices (n, k, 3) of the coordinates of the nodes of each segment.
        self._indices = np.concatenate(columns, axis=1).astype(PETSc.IntType)
        self._gather = Gather(system.numbering, [self._indices])
        start, end = system.q0.getOwnershipRange()
        first = self._indices[..., 0]
        self._mine = (start <= first) & (first < end)
        self._own = self._indices[self._mine] - start
        # Rows of the tangent that this rank adds: segments and those of their nodes that it owns.
        self._rows = np.nonzero(self._mine)
        self._row_indices = self._indices[self._rows]
        n, k, _ = self._indices.shape
        self._column_indices = self._indices[self._rows[0]].reshape(-1, 3 * k)
        self._X0: Array = np.zeros((n, k, 3))
        self._X1: Array = self._X0
        self._at_mid: Array = self._X0
        self._at_end: Array = self._X0
        self._initial_gradient: Array = self._X0

    def _edges_of(
        self, line: EdgeLine, begins: Array, ends: Array
    ) -> tuple[np.ndarray, Array, Array]:
        """Return the number of the edge of a line on which each of n segments lies (n,), and the
        local coordinates, 0 to 1, of its begin and end on it (n,); `begins` and `ends` (n,) are
        fractions of arc length, none across a node."""
        middle = (begins + ends) / 2
        edges = np.searchsorted(line.fractions, middle, side="right") - 1
        start = line.fractions[edges]
        width = line.fractions[edges + 1] - start
        return edges, (begins - start) / width, (ends - start) / width

    def _tabulate(self, line_a: EdgeLine, line_b: EdgeLine, cuts: Array) -> None:
        """Tabulate the shape functions (n, g, k) of a strip along a seam: `_test`, the weighted
        values, and `_ds` and `_dr`, the derivatives along and across.

        `cuts` are fractions of arc length, ascending from 0 to 1, at which segments begin and end.
        In the code s and r are the points along and across a segment, from 0 to 1; ξ0 and ξ1 are
        the local coordinates of its ends on an edge, ξ those of its points; N and dN are shape
        functions and their derivatives.
        """
        is_long = np.diff(cuts) > SHORTEST_SEGMENT
        self._begins = cuts[:-1][is_long]
        self._ends = cuts[1:][is_long]
        order = max(line_a.order, line_b.order)
        s, weights_s = _quadrature(3 * order - 1)
        r, weights_r = _quadrature(QUADRATURE_DEGREE_ACROSS)
        values = []
        along = []
        across = []
        for line, share, slope in ((line_a, 1 - r, -1.0), (line_b, r, 1.0)):
            _, ξ0, ξ1 = self._edges_of(line, self._begins, self._ends)
            ξ = ξ0[:, None] + (ξ1 - ξ0)[:, None] * s
            N, dN = shape_functions(line.order, ξ.ravel())
            shape = (len(ξ0), len(s), line.order + 1)
            N = N.reshape(shape)
            dN = dN.reshape(shape) * (ξ1 - ξ0)[:, None, None]
            values.append(_at_points(N, share))
            along.append(_at_points(dN, share))
            across.append(_at_points(N, np.full(len(r), slope)))
        weights = np.outer(weights_s, weights_r).ravel()
        self._test = np.concatenate(values, axis=2) * weights[:, None]
        self._ds = np.concatenate(along, axis=2)
        self._dr = np.concatenate(across, axis=2)

    # ---- a step ----------------------------------------------------------------------------------

    def follow(self) -> None:
        """Evaluate volume [m³], swept volume [m³] and gradients [m²] for the iterate's end q1; the
        same on every rank.  Collective."""
        self._X1 = self._gather(self._system.q1)[0]
        self._at_end = self._gradient(self._X1)
        self._at_mid = self._at_end
        if not self._acts_at_end:
            self._at_mid = self._gradient(self._middle())
        terms = self._at_end * self._X1
        self.volume = float(terms.sum()) / 3
        self.magnitude = float(np.abs(terms).sum())
        if self._acts_at_end:
            self.swept = self.volume - self._initial_volume
        else:
            self.swept = float((self._at_mid * (self._X1 - self._X0)).sum())

    def accept(self) -> None:
        """Make the end of this step the start of the next."""
        self._X0 = self._X1
        self._initial_gradient = self._at_end
        self._initial_volume = self.volume

    def gradients(self) -> tuple[Array, Array, Array]:
        """Return this rank's parts of three gradients [m²]: G = ∂V/∂q in the positions where forces
        act, which times the pressure is the force; and ∂V/∂q1 and ∂W/∂q1, W the swept volume."""
        of_swept = self._at_end
        if not self._acts_at_end:
            change = self._at_end - self._initial_gradient
            of_swept = self._at_mid + self._alpha * change
        return (
            self._in_system(self._at_mid),
            self._in_system(self._at_end),
            self._in_system(of_swept),
        )

    def add_tangent(self, A: PETSc.Mat, scale: float) -> None:
        """Add the derivative of a pressure's force by the end q1 of the step to the tangent of the
        system [N/m]; each rank adds its rows.

        The force is scale · G(q_mid), with a pressure `scale` [Pa], the gradient G [m²] of the
        strip's volume and q_mid = (1 - α) q0 + α q1; its derivative is scale · α · ∂G/∂q.  xs and
        xr are the tangents [m] along and across the strip at its points.
        """
        xs, xr = self._tangents(self._middle())
        # δG_i = Σ_j a_ij × δx_j, as in `gas.ring`
        by_xr = np.einsum("ngi,ngj,ngd->nijd", self._test, self._dr, xs, optimize=True)
        by_xs = np.einsum("ngi,ngj,ngd->nijd", self._test, self._ds, xr, optimize=True)
        a = by_xr - by_xs
        blocks = scale * self._alpha * cross_matrices(a[self._rows])
        k = self._indices.shape[1]
        values = blocks.transpose(0, 2, 1, 3).reshape(len(blocks), 3, 3 * k)
        add_blocks(A, self._row_indices, self._column_indices, values)

    def _middle(self) -> Array:
        """Positions (n, k, 3) [m] of the nodes where forces act."""
        return (1 - self._alpha) * self._X0 + self._alpha * self._X1

    def _tangents(self, X: Array) -> tuple[Array, Array]:
        """x,σ and x,r (n, g, 3) for the positions X (n, k, 3)."""
        return self._ds @ X, self._dr @ X

    def _gradient(self, X: Array) -> Array:
        """G (n, k, 3) [m²] at the nodes of each segment."""
        xs, xr = self._tangents(X)
        return self._test.transpose(0, 2, 1) @ np.cross(xs, xr)

    def _in_system(self, G: Array) -> Array:
        """This rank's part of a system vector whose entries at the nodes of the segments are the
        sums of G (n, k, 3) over them, and else zero."""
        vector = np.zeros(self._system.numbering.size_local)
        np.add.at(vector, self._own, G[self._mine])
        return vector


class SewnEnclosure:
    """The volume inside films, each as a whole, that are sewn together along all of their open
    edges."""

    def __init__(self, films: Sequence[Membrane], seams: Sequence[SewnEdges], chamber: str) -> None:
        check(
            bool(films) and bool(seams),
            f"Chamber '{chamber}': several films are given without seams; "
            "give the seams that close them.",
        )
        self.films = tuple(films)
        self.seams = tuple(seams)
        self.chamber = chamber

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
        surfaces = []
        for film, sign in zip(self.films, signs, strict=True):
            owned = film.mesh.domain.topology.index_map(2).size_local
            cells = self.cells(film)
            surface = geometry.surface(film)
            side = Side(cells[cells < owned], [], [])
            surfaces.append(_SignedSurface(surface, surface.add(side), sign))
        strips = []
        for (line_a, line_b), sign in zip(lines, strip_signs, strict=True):
            strip = SeamStrip(line_a, line_b, system)
            geometry.add(strip)
            strips.append((strip, sign))
        return _CompiledSewn(surfaces, strips)

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
            ends = table.ends
            # Number of the edge of this rank from its first to its second vertex, a and b
            at = {(int(ends[i, 0]), int(ends[i, 1])): i for i in range(table.owned)}
            for k, both in enumerate(lines):
                for side, line in enumerate(both):
                    if line.body is not film:
                        continue
                    for pair in line.vertices:
                        a = int(pair[0])
                        b = int(pair[1])
                        edge = at.get((a, b), at.get((b, a), -1))
                        if edge >= 0:
                            along = 1.0 if (a, b) in at else -1.0
                            sums[k, side] += along * directions[edge]
                            count[edge] += 1
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


@dataclass
class _SignedSurface:
    """One film of a chamber: its surface, the index of the chamber in it, and the sign of its
    normals."""

    surface: FilmSurface
    index: int
    sign: float


class _CompiledSewn:
    """Films and strips, with the signs of their normals, that enclose one chamber."""

    def __init__(
        self, surfaces: Sequence[_SignedSurface], strips: Sequence[tuple[SeamStrip, float]]
    ) -> None:
        self._surfaces = surfaces
        self._strips = strips
        # -1 if all normals point inwards
        self._sign = 1.0
        self._pressure = 0.0

    def _sum(self, quantity: str) -> float:
        """The sum [m³] over films and strips of their "volume" or "swept", with signs."""
        total = 0.0
        for one in self._surfaces:
            total += one.sign * float(getattr(one.surface, quantity)[one.index])
        for strip, sign in self._strips:
            total += sign * float(getattr(strip, quantity))
        return self._sign * total

    @property
    def volume(self) -> float:
        return self._sum("volume")

    @property
    def swept(self) -> float:
        return self._sum("swept")

    @property
    def magnitude(self) -> float:
        of_films = sum(float(one.surface.magnitude[one.index]) for one in self._surfaces)
        return of_films + sum(strip.magnitude for strip, _ in self._strips)

    def start(self) -> None:
        # Flat panels on each other have a volume of either sign by round-off.
        if self._sum("volume") < -ROUND_OFF * self.magnitude:
            self._sign = -self._sign

    def set_pressure(self, pressure: float) -> None:
        self._pressure = self._sign * pressure
        for one in self._surfaces:
            one.surface.pressures[one.index] = one.sign * self._pressure

    def add_force(self, values: Array) -> None:
        for one in self._surfaces:
            one.surface.add_force(one.index, values)
        for strip, sign in self._strips:
            values -= self._pressure * sign * strip.gradients()[0]

    def gradients(self) -> tuple[Array, Array, Array]:
        totals: list[Array] = []
        for one in self._surfaces:
            _add(totals, self._sign * one.sign, one.surface.gradients(one.index))
        for strip, sign in self._strips:
            _add(totals, self._sign * sign, strip.gradients())
        at_middle, of_volume, of_swept = totals
        return at_middle, of_volume, of_swept

    def add_tangents(self, A: PETSc.Mat) -> None:
        # The tangents of the films are forms, which `Geometry.tangents` gives.
        for strip, sign in self._strips:
            strip.add_tangent(A, -sign * self._pressure)


def _add(totals: list[Array], sign: float, parts: tuple[Array, Array, Array]) -> None:
    """Add arrays to the totals, which are empty at first."""
    if not totals:
        totals += [np.zeros_like(part) for part in parts]
    for total, part in zip(totals, parts, strict=True):
        total += sign * part


def _at_points(along: Array, sideways: Array) -> Array:
    """Products (n, g, k) of functions along a segment (n, s, k) and across it (r,)."""
    products = np.einsum("nsk,r->nsrk", along, sideways.ravel())
    return products.reshape(len(along), -1, along.shape[2])


def _quadrature(degree: int) -> tuple[Array, Array]:
    """Points and weights (g,) on [0, 1], exact for polynomials of a degree."""
    points, weights = basix.make_quadrature(basix.CellType.interval, degree)
    return np.asarray(points).ravel(), np.asarray(weights)
