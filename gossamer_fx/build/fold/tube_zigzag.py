"""A round tube that is folded flat between stubs, at whose ends it stays round.

Problem.  A tube whose root is a flat seam is a hinge there.  A round end stays stiff, but no map
from a round section to a flat one keeps all lengths: lines along the tube would have to be longer
at its sides than in its middle.

Idea.  Film resists tension and not compression.  A stub between both sections is compressed along
the tube, so that there are shapes of it that stretch the film nowhere; what is too long lies in
wrinkles.

Algorithm.

1. Blend the round section into the flat one within the stubs, which are shortened; fold the panels
   between them to a zigzag, with both sheets apart (`TubeZigzag._stub_rows`, `_panel_rows`).
2. With the principal strains e_i of all triangles find positions of least Σ max(e_i, 0)², the first
   and the last row fixed and the sheets apart: nonlinear least squares (`relax`).

Cost: a tenth of a second for 200 nodes, one for 1700.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from dolfinx import mesh as dmesh

from gossamer_fx.build.fold.fold_lines import FoldLine
from gossamer_fx.build.fold.folding import FIT, Folding, Gap, Length
from gossamer_fx.build.fold.polyline import Bent
from gossamer_fx.build.meshes.round_tube import TubeLattice
from gossamer_fx.core.checks.arguments import Range, check_arguments
from gossamer_fx.core.checks.errors import check_on_all
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.mechanics.bodies.membrane import Membrane

# Largest tensile strain at the start: 0.1 MPa in a polyimide film, a thirtieth of the stress of
# a tube that is filled to some kPa.
MAX_STRETCH = 5e-5

# Length of a panel at the start over its length.  Where one sheet lies round the other one the film
# would be too short; without this slack all of it has to come from the stubs, and step 2 takes
# hundreds of iterations.
SLACK = 0.98

# Weights of step 2 compared with strains: of sheets that are too near each other, and of the
# distance from the shape of step 1, both over the diameter.  The second one decides where nothing
# else does.
SHEETS_WEIGHT = 10.0
SHAPE_WEIGHT = 1e-5

# Share by which the squares fall in the last step of the search.
SMALLEST_FALL = 1e-3

# Evaluations after which step 2 ends; `stretch` says how far it has come.
MAX_EVALUATIONS = 100


@check_arguments
@dataclass(frozen=True)
class TubeZigzag(Folding):
    """Zigzag of a `round_tube` that is pressed flat between two stubs, with round ends.

    The first arguments are those of `gossamer_fx.meshes.round_tube.round_tube`.  Both ends stay as
    they are, but for a translation of the tip.  Panels rise and fall in turn by `angle` against the
    x axis; the circles between compartments are folds, those next to stubs with half of the angle
    of the others.  Stubs and panels are shortened, so that their film lies in wrinkles; it is
    stretched by 5e-5 at most.

    Args:
        length, diameter: of the tube [m].
        cells: edges on half of the circumference.
        panels: their number.
        stub: length of each stub [m], some 1.5 diameters.
        angle: [rad], between 0 (flat) and π/2 (pressed shut, which contact does not allow).
        opening: half of the largest distance of the sheets [m], within a panel.
        lift: half of their distance at the folds [m].
        shortening: length of a stub over its length when the tube is round.

    Raises:
        InputError: a number is out of its range, or the start stretches the film, e.g. as a stub is
            too short.

    Example:
        >>> from gossamer_fx.meshes.round_tube import round_tube
        >>> sizes = {"length": 0.25, "diameter": 0.03, "cells": 4, "panels": 2, "stub": 0.045}
        >>> folds = gx.fold.TubeZigzag(**sizes, angle=1.4, opening=1e-3, lift=1e-4)
        >>> film = gx.Membrane(folds.mark(round_tube(comm, **sizes)), law)
        >>> scene = gx.Scene(film, folds.start(film))
        >>> f"the tip is at x = {folds.tip[0]:.3f} m"
        'the tip is at x = 0.103 m'
    """

    called: ClassVar[str] = "fold.TubeZigzag"
    length: Length
    diameter: Length
    _: KW_ONLY
    cells: Annotated[int, Range(1)]
    panels: Annotated[int, Range(1)] = 2
    stub: Length
    angle: Annotated[float, Range(0.0, math.pi / 2, "rad", above=True)] = 1.4
    opening: Gap = 1e-3
    lift: Gap = 1e-4
    shortening: Annotated[float, Range(0.5, 1.0)] = 0.85

    def __post_init__(self) -> None:
        # Refuses what no tube has.
        self._lattice  # noqa: B018

    @cached_property
    def _lattice(self) -> TubeLattice:
        return TubeLattice(self.length, self.diameter, self.cells, self.panels, self.stub)

    @property
    def sides(self) -> int:
        """Sides of the polygon that is the section of the tube."""
        return self._lattice.around

    @property
    def stretch(self) -> float:
        """Largest tensile strain of the film at the start."""
        return self._relaxed.stretch

    @property
    def tip(self) -> tuple[float, float, float]:
        """Position [m] of the centre of the cap at the tip, e.g. for the body that it is fixed
        to."""
        x, y, z = self._folded[self._lattice.centres[1]]
        return float(x), float(y), float(z)

    def positions(self, film: Membrane) -> Array:
        """Folded positions, see `Folding.positions`."""
        owned = film.block.index_map.size_local
        X = film.space.tabulate_dof_coordinates()[:owned]
        nodes = self._nodes_at(X)
        misfit = np.abs(self._lattice.points[nodes] - X).max(initial=0.0)
        count = film.comm.allreduce(owned)
        check_on_all(
            film.comm,
            bool(misfit <= FIT * self.length) and count == len(self._lattice.points),
            f"{self.called}: the nodes of '{film.name}' are not those of the tube that the folds "
            "are for; make a film of order 1 on the mesh of round_tube with the same sizes.",
        )
        return self._folded[nodes]

    def lines(self, mesh: Mesh) -> list[FoldLine]:
        """The halves of the rings between compartments, with the angles of their folds."""
        lines = []
        for number, turn in enumerate(np.diff(self._rise), start=1):
            _, edges = mesh.group(f"ring {number}", self.called)
            height = np.empty(0)
            # dolfinx divides by the number of edges, and this rank may have none.
            if len(edges):
                height = dmesh.compute_midpoints(mesh.domain, 1, edges)[:, 2]
            for sheet, sign in (("top", 1.0), ("bottom", -1.0)):
                line = FoldLine(
                    name=f"fold {number} {sheet}",
                    # A turn upwards is a valley of the upper sheet, whose normal points up.
                    angle=float(sign * turn),
                    edges=np.sort(edges[sign * height > 0]),
                )
                lines.append(line)
        return lines

    @property
    def _rise(self) -> Array:
        """Directions (n,) [rad] of the compartments against the x axis, from the inlet."""
        panels = self.angle * (-1.0) ** np.arange(self.panels)
        return np.concatenate([[0.0], panels, [0.0]])

    def _nodes_at(self, X: Array) -> Indices:
        """The nodes (n,) of the lattice that are nearest to points X (n, 3) [m] of the round
        tube, whether they are near or not."""
        lattice = self._lattice
        halfway = (lattice.rows[1:] + lattice.rows[:-1]) / 2
        row = np.searchsorted(halfway, X[:, 0])
        turn = np.arctan2(X[:, 2], X[:, 1]) / (2 * math.pi)
        column = np.rint(turn * lattice.around).astype(np.int32) % lattice.around
        nodes = row * lattice.around + column
        inlet, tip = lattice.centres
        centre = np.where(row == 0, inlet, tip)
        is_centre = np.hypot(X[:, 1], X[:, 2]) < lattice.radius / 2
        return np.where(is_centre, centre, nodes).astype(np.int32)

    @cached_property
    def _pressed(self) -> PressedSection:
        lattice = self._lattice
        column = np.arange(lattice.around)
        half = lattice.around // 2
        # Edges from the nearer seam, the first one at y > 0
        steps = np.minimum(column, lattice.around - column)
        across = (half / 2 - steps) * lattice.edge
        side = np.where(column < half, 1.0, -1.0)
        side[[0, half]] = 0.0
        return PressedSection(across, side, np.cos(np.pi * across / (half * lattice.edge)))

    def _stub_rows(self) -> SheetRows:
        """Rows of the stub at the inlet before they are relaxed: the round section is blended into
        the flat one."""
        lattice = self._lattice
        section = self._pressed
        x = lattice.rows[: lattice.border_rows[1] + 1]
        share = x / self.stub
        # Without a kink at either end.
        flatness = (share**2 * (3 - 2 * share))[:, None]
        start = np.empty((len(x), lattice.around, 3))
        start[:, :, 0] = self.shortening * x[:, None]
        flat_section = (section.across, self.lift * section.side * section.share)
        for i, flat in enumerate(flat_section, start=1):
            start[:, :, i] = (1 - flatness) * lattice.points[: lattice.around, i] + flatness * flat
        outwards = np.zeros_like(start)
        outwards[:, :, 2] = section.side
        apart = np.tile(self.opening * section.share, (len(x), 1))
        return SheetRows(start, start * (1.0, 1.0, 0.0), outwards, apart)

    def _panel_rows(self) -> SheetRows:
        """Rows of the panels before they are relaxed, the first one at the origin."""
        lattice = self._lattice
        section = self._pressed
        numbers = np.arange(lattice.border_rows[1], lattice.border_rows[-2] + 1)
        x = lattice.rows[numbers] - self.stub
        panel = (self.length - 2 * self.stub) / self.panels
        bent = Bent(SLACK * panel * np.arange(self.panels + 1), self._rise)
        line, normal = bent.at(SLACK * x)
        pillow = self.opening * np.abs(np.sin(np.pi * x / panel))
        is_fold = np.isin(numbers, lattice.border_rows)
        apart = np.where(is_fold, self.lift, pillow)[:, None] * section.share
        middle = np.empty((len(x), lattice.around, 3))
        middle[:, :, 0] = line[:, :1]
        middle[:, :, 1] = section.across
        middle[:, :, 2] = line[:, 1:]
        outwards = np.zeros_like(middle)
        outwards[:, :, 0] = normal[:, :1] * section.side
        outwards[:, :, 2] = normal[:, 1:] * section.side
        return SheetRows(middle + apart[:, :, None] * outwards, middle, outwards, apart)

    @cached_property
    def _relaxed(self) -> RelaxedShape:
        """The tube with its film stretched as little as possible."""
        stub = self._stub_rows()
        flat_end = np.array([self.shortening * self.stub, 0.0, 0.0])
        panels = self._panel_rows().moved(flat_end)
        # The tip's stub is the mirror image of the first one, where the last panel ends.
        end = panels.middle[-1].mean(axis=0)
        tip = stub.mirrored().moved(end + flat_end)
        rows = SheetRows.joined([stub.part(0, -1), panels, tip.part(1, None)])
        shape = relax(self._lattice, rows)
        self._check(
            shape.stretch <= MAX_STRETCH,
            f"the start stretches the film by {shape.stretch:.2g}; give longer stubs, of some 1.5 "
            f"diameters, a smaller shortening than {self.shortening:g}, or sheets that are nearer "
            "each other.",
        )
        return shape

    @cached_property
    def _folded(self) -> Array:
        """Folded positions (n, 3) [m] of all nodes of the lattice."""
        wall = self._relaxed.positions
        return np.vstack([wall.reshape(-1, 3), [wall[0].mean(axis=0), wall[-1].mean(axis=0)]])


@dataclass(frozen=True)
class PressedSection:
    """Nodes of a row of the flat tube.

    Attributes:
        across: their positions y (n,) [m], from seam to seam.
        side: their sheet (n,): 1 upper, -1 lower, 0 at a seam.
        share: the share (n,) of an opening that they have: 1 in the middle, 0 at the seams.
    """

    across: Array
    side: Array
    share: Array


@dataclass(frozen=True)
class SheetRows:
    """Rows of nodes of a part of the tube, and how its sheets keep apart.

    Attributes:
        start: positions (rows, around, 3) [m] before they are relaxed.
        middle: points (rows, around, 3) [m] in the middle between the sheets.
        outwards: direction (rows, around, 3) in which each node keeps away from the middle; zero
            at the seams.
        apart: how far (rows, around) [m] it keeps away.
    """

    start: Array
    middle: Array
    outwards: Array
    apart: Array

    def moved(self, by: Array) -> SheetRows:
        """The same rows, translated by a vector (3,) [m]."""
        return replace(self, start=self.start + by, middle=self.middle + by)

    def mirrored(self) -> SheetRows:
        """The mirror image at x = 0, its rows in the order of x."""
        mirror = np.array([-1.0, 1.0, 1.0])
        return SheetRows(
            self.start[::-1] * mirror,
            self.middle[::-1] * mirror,
            self.outwards[::-1] * mirror,
            self.apart[::-1],
        )

    def part(self, first: int, end: int | None) -> SheetRows:
        """The rows from `first` to before `end`."""
        rows = slice(first, end)
        return SheetRows(self.start[rows], self.middle[rows], self.outwards[rows], self.apart[rows])

    @staticmethod
    def joined(parts: Sequence[SheetRows]) -> SheetRows:
        """The rows of several parts, one after the other."""
        return SheetRows(
            np.concatenate([part.start for part in parts]),
            np.concatenate([part.middle for part in parts]),
            np.concatenate([part.outwards for part in parts]),
            np.concatenate([part.apart for part in parts]),
        )


@dataclass(frozen=True)
class RelaxedShape:
    """Shape of the tube that stretches its film as little as possible: positions (rows, around, 3)
    [m] of its nodes, and the largest tensile strain."""

    positions: Array
    stretch: float


def relax(lattice: TubeLattice, tube: SheetRows) -> RelaxedShape:
    """Move the rows of a tube so that its film is stretched as little as possible, step 2 of the
    module; the first and the last row stay."""
    rows, around, _ = tube.start.shape
    triangles = np.concatenate([lattice.strip(row) for row in range(rows - 1)])
    strains = PrincipalStrains(lattice.points[: rows * around], triangles)
    fixed = tube.start.reshape(-1, 3)
    free = np.arange(around, (rows - 1) * around)
    direction = tube.outwards.reshape(-1, 3)[free]
    distance = tube.apart.ravel()[free]
    between = tube.middle.reshape(-1, 3)[free]
    has_sheet = np.abs(direction).max(axis=1) > 0
    unknown = np.full(rows * around, -1)
    unknown[free] = np.arange(len(free))

    def positions(u: Array) -> Array:
        x = fixed.copy()
        x[free] = u.reshape(-1, 3)
        return x

    def missing_distance(x: Array) -> Array:
        found = np.einsum("nc,nc->n", direction, x[free] - between)
        return np.where(has_sheet, np.maximum(distance - found, 0.0), 0.0)

    def residual(u: Array) -> Array:
        x = positions(u)
        strain, _ = strains.at(x)
        return np.concatenate(
            [
                np.maximum(strain, 0.0).ravel(),
                SHEETS_WEIGHT * missing_distance(x) / lattice.diameter,
                SHAPE_WEIGHT * (x[free] - fixed[free]).ravel() / lattice.diameter,
            ]
        )

    def jacobian(u: Array) -> scipy.sparse.csr_matrix:
        x = positions(u)
        count = len(free)
        strain, by_corner = strains.at(x)
        by_corner = np.where((strain > 0)[:, :, None, None], by_corner, 0.0)
        row = np.arange(strain.size).reshape(*strain.shape, 1, 1)
        column = 3 * unknown[triangles][:, None, :, None] + np.arange(3)
        row, column = np.broadcast_arrays(row, column)
        # Columns of fixed nodes are negative.
        is_free = column >= 0
        of_strains = scipy.sparse.coo_matrix(
            (by_corner[is_free], (row[is_free], column[is_free])), shape=(strain.size, 3 * count)
        )
        pushed = (missing_distance(x) > 0)[:, None] * direction
        of_sheets = scipy.sparse.coo_matrix(
            (
                -SHEETS_WEIGHT / lattice.diameter * pushed.ravel(),
                (np.repeat(np.arange(count), 3), np.arange(3 * count)),
            ),
            shape=(count, 3 * count),
        )
        of_shape = SHAPE_WEIGHT / lattice.diameter * scipy.sparse.identity(3 * count)
        return scipy.sparse.vstack([of_strains, of_sheets, of_shape]).tocsr()

    relaxed = positions(least_squares(residual, jacobian, fixed[free].ravel(), lattice.edge))
    strain, _ = strains.at(relaxed)
    return RelaxedShape(relaxed.reshape(tube.start.shape), float(strain.max()))


def least_squares(
    residual: Callable[[Array], Array],
    jacobian: Callable[[Array], scipy.sparse.csr_matrix],
    start: Array,
    scale: float,
) -> Array:
    """The unknowns u (n,) of least squares |residual(u)|² near a start, by the method of Levenberg
    and Marquardt with sparse factors: the iterative one of scipy needs hundreds of steps here.

    Args:
        residual, jacobian: of the unknowns: r (m,) and dr/du (m, n).
        start: u (n,).
        scale: a change of the unknowns that is large.
    """
    u = start
    r = residual(u)
    damping = 1.0
    identity = scipy.sparse.identity(len(u)) / scale**2
    for _ in range(MAX_EVALUATIONS):
        J = jacobian(u)
        step = scipy.sparse.linalg.spsolve((J.T @ J + damping * identity).tocsc(), -(J.T @ r))
        r_next = residual(u + step)
        if r_next @ r_next < r @ r:
            u = u + step
            fall = 1 - (r_next @ r_next) / (r @ r)
            r = r_next
            damping *= 0.1
            if fall < SMALLEST_FALL:
                break
        else:
            damping *= 10
    return u


class PrincipalStrains:
    """Principal strains of triangles between nodes, and their derivatives.

    Args:
        X: positions (n, 3) [m] of the nodes of the film without strain.
        triangles: their nodes (m, 3).
    """

    def __init__(self, X: Array, triangles: Indices) -> None:
        self._triangles = triangles
        sides = self._sides(X)
        metric = np.einsum("mci,mcj->mij", sides, sides)
        # L with L Lᵀ = G⁻¹ of the metric G: sides times L are those of a triangle in an orthonormal
        # frame.
        self._frame = np.linalg.cholesky(np.linalg.inv(metric))

    def at(self, x: Array) -> tuple[Array, Array]:
        """Both principal Green-Lagrange strains (m, 2) of the triangles at positions x (n, 3) [m],
        and their derivatives (m, 2, 3, 3) [1/m] by the coordinates of the three corners."""
        F = self._sides(x) @ self._frame
        squares, directions = np.linalg.eigh(np.einsum("mci,mcj->mij", F, F))
        # λ = |F w|², so that dλ = 2 (F w)·(dF w), with dF = d(sides) L.
        stretched = np.einsum("mci,mik->mkc", F, directions)
        by_side = np.einsum("mij,mjk->mki", self._frame, directions)
        second_and_third = np.einsum("mki,mkc->mkic", by_side, stretched)
        first = -second_and_third.sum(axis=2, keepdims=True)
        return (squares - 1) / 2, np.concatenate([first, second_and_third], axis=2)

    def _sides(self, x: Array) -> Array:
        """Two sides (m, 3, 2) [m] of each triangle, from its first corner."""
        corners = x[self._triangles]
        return np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
