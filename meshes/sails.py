"""Sails and sheets whose nodes lie on fold lines, for the maps of `gossamer_fx.build.fold`."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh
from gossamer_fx.extend import Range, check, check_arguments

from .arrays import (
    Cells,
    Groups,
    Length,
    Numbers,
    Points,
    cell_corners,
    check_cells,
    joined,
    mesh_of_arrays,
    polyline,
    require_ascending,
    rim,
    triangles_of,
)


@check_arguments
def parallelograms(
    comm: MPI.Intracomm,
    a: Length,
    b: Length,
    gamma: float,
    columns: Cells,
    rows: Cells,
    cells: Cells,
) -> Mesh:
    """Make the flat sheet of Miura's fold: columns × rows parallelograms, each of cells × cells.

    Parallelogram (i, j) begins at x = i b sin γ; y of its corners rises by b cos γ in even columns
    and falls in odd ones.  Groups: "film"; the edges "left" and "right"; the corner points "bottom
    left" and "top right".  Collective.

    Args:
        a, b: sides of a parallelogram [m], a along y.
        gamma: angle γ between them [rad], between 0 and π/2.
        columns, rows: numbers of parallelograms along x and y.
        cells: of two triangles along each side.

    Raises:
        InputError: a side is not positive, there are no parallelograms or cells, or the angle is
            not between 0 and π/2.
    """
    check_cells("parallelograms", 2 * columns * rows * cells**2)
    check(
        0 < gamma < math.pi / 2,
        f"parallelograms: gamma is {gamma!r} rad; give an angle between 0 and π/2.",
    )

    def arrays() -> tuple[Points, Numbers, Groups]:
        # Nodes by columns u and rows v; each parallelogram has unit sides in u and v.
        across = np.arange(columns * cells + 1) / cells
        up = np.arange(rows * cells + 1) / cells
        u, v = np.meshgrid(across, up)
        # y rises from 0 to 1 in even columns and falls again in odd ones.
        wave = 1 - np.abs(np.remainder(u, 2) - 1)
        x = u * b * math.sin(gamma)
        y = v * a + b * math.cos(gamma) * wave
        points = np.stack([x, y, 0 * u], axis=-1).reshape(-1, 3)

        # Corners of each cell, counterclockwise.  The diagonal is the shorter one: q-s where the
        # columns rise, p-r where they fall.
        ids = np.arange(u.size).reshape(u.shape)
        p, q, r, s = cell_corners(ids)
        column = np.arange(columns * cells) // cells
        rising = column % 2 == 0
        first = triangles_of(p, q, np.where(rising, s, r))
        second = triangles_of(np.where(rising, q, p), r, s)
        triangles = np.concatenate([first, second])
        left = ids[:, 0]
        right = ids[:, -1]
        groups = {
            "left": polyline(left),
            "right": polyline(right),
            "bottom left": ids[0, :1],
            "top right": ids[-1, -1:],
        }
        return points, triangles, groups

    return mesh_of_arrays(comm, arrays)


@check_arguments
def trapezoids(
    comm: MPI.Intracomm,
    n: Annotated[int, Range(3)],
    inner: Cells,
    outer: Cells,
    pitch: Length,
    refine: Cells = 1,
) -> Mesh:
    """Make n flat trapezoids round a centre, joined along their seams, for the fold `Ikaros`.

    n = 4 is a square.  Row j is j pitch from the centre, its nodes at i tan(π/n) pitch, |i| ≤ j:
    rows, columns and seams are edges.  The middle of trapezoid 0 is at (0, -y).  Groups: "film";
    the edges "inner" and "outer"; the corner points "tip 0" and so on, tip k between trapezoids k
    and k + 1.  Collective.

    Args:
        n: number of trapezoids, at least 3.
        inner, outer: rows of the inner and outer edges, 0 < inner < outer.
        pitch: distance of rows [m].
        refine: edges of triangles between two rows.

    Raises:
        InputError: there are fewer than three trapezoids, no rows between the inner and the outer
            edge, or no edges between rows, or the pitch is not positive.
    """
    require_ascending("trapezoids", ("inner", "outer"), (inner, outer))
    check_cells("trapezoids", 2 * n * (outer * refine) ** 2)

    def arrays() -> tuple[Points, Numbers, Groups]:
        slope = math.tan(math.pi / n)
        h = pitch / refine
        cells = []
        for j in range(inner * refine, outer * refine):
            for i in range(-j - 1, j + 1):
                # a, b, c, d: corners of a cell, as pairs (position in the row, row).
                a = (i, j)
                b = (i + 1, j)
                c = (i, j + 1)
                d = (i + 1, j + 1)
                # Diagonals are mirrored about the middle, so that the seams are edges.
                pair = [(a, c, d), (a, d, b)]
                if i < 0:
                    pair = [(a, c, b), (b, c, d)]
                # At the seams only one of the two triangles is inside.
                cells += [triangle for triangle in pair if all(abs(u) <= w for u, w in triangle)]
        # The middle of trapezoid 0 points to negative y.
        grid = np.array(cells).reshape(-1, 2) * np.array([slope * h, -h])
        angles = [2 * math.pi * k / n for k in range(n)]
        points, triangles = _around(grid, angles, h)

        edges = rim(triangles)
        middles = points[edges].mean(axis=1)
        is_outer = _apothem(middles, n) > (inner + outer) / 2 * pitch
        groups = {"inner": edges[~is_outer], "outer": edges[is_outer]}

        radius = outer * pitch / math.cos(math.pi / n)
        for k in range(n):
            angle = math.pi * (2 * k + 1) / n - math.pi / 2
            tip = radius * np.array([math.cos(angle), math.sin(angle), 0.0])
            groups[f"tip {k}"] = _nearest(points, tip)
        return points, triangles, groups

    return mesh_of_arrays(comm, arrays)


@check_arguments
def pinwheel(
    comm: MPI.Intracomm, n: Annotated[int, Range(3)], side: Length, columns: Cells, reach: Cells
) -> Mesh:
    """Make the flat ring of the fold `Star`, outside a regular polygon of n sides.

    Sectors begin at the corners of the polygon and have their columns at right angles to their
    bounds.  Triangles at the rim end at columns, so that it has a step of one side at each corner.
    Groups: "film"; the edges "hub" and "rim"; the points "tip 0" and so on, where bisectors end.
    Collective.

    Args:
        n: sides of the polygon, at least 3.
        side: their length [m].
        columns: in a side, at least 1.
        reach: columns in a sector, each of side/columns.

    Raises:
        InputError: the polygon has fewer than three sides, there are no columns, or the side is not
            positive.
    """
    check_cells("pinwheel", 2 * n * (columns + reach) * reach)

    def arrays() -> tuple[Points, Numbers, Groups]:
        h = side / columns
        step = 2 * math.pi / n
        slope = math.tan(step / 2)
        cells = []
        for j in range(reach):
            for i in range(j + 1):
                here = (j, i)
                right = (j + 1, i)
                above = (j, i + 1)
                opposite = (j + 1, i + 1)
                cells.append((here, right, opposite))
                # On the bisector, i = j, a cell has one triangle.
                if i < j:
                    cells.append((here, opposite, above))
        half = np.array(cells).reshape(-1, 2) * np.array([h, h * slope])
        # c, s: cosine and sine of the angle of a sector.
        c = math.cos(step)
        s = math.sin(step)
        # Mirrored about the bisector; the order of corners is turned to keep the normals.
        mirrored = half @ np.array([[c, s], [s, -c]])
        mirrored = mirrored.reshape(-1, 3, 2)[:, ::-1].reshape(-1, 2)
        corner = np.array([side / 2, -side / 2 / math.tan(step / 2)])
        sector = np.vstack([half, mirrored]) + corner
        tip = np.array([[reach * h, reach * h * slope]]) + corner
        points, triangles = _around(
            sector,
            [step * k for k in range(n)],
            h,
        )

        # The middles of the polygon's sides are within its circumscribed circle, all others not.
        edges = rim(triangles)
        radii = np.linalg.norm(points[edges].mean(axis=1), axis=1)
        is_hub = radii < side / 2 / math.sin(step / 2)
        groups = {"hub": edges[is_hub], "rim": edges[~is_hub]}
        for k in range(n):
            groups[f"tip {k}"] = _nearest(points, _turned(tip, step * k)[0])
        return points, triangles, groups

    return mesh_of_arrays(comm, arrays)


def _around(sector: Points, angles: list[float], cell: float) -> tuple[Points, Numbers]:
    """Points (k, 3) [m] in z = 0 and triangles of a sector, with corners (3m, 2) [m] of m
    triangles, turned about the origin by each of the angles [rad], and joined where copies meet:
    corners nearer than 1e-6 of the size of a cell [m]."""
    copies = [_turned(sector, angle) for angle in angles]
    # Each corner of each triangle is a point at first.
    separate = np.arange(len(angles) * len(sector)).reshape(-1, 3)
    points, triangles, _ = joined(np.vstack(copies), separate, 1e-6 * cell)
    return points, triangles


def _turned(xy: Points, angle: float) -> Points:
    """Points (m, 2) turned about the origin by an angle [rad], as points (m, 3) in z = 0."""
    c = math.cos(angle)
    s = math.sin(angle)
    # Points are rows, so that the matrix of the rotation is transposed.
    turned = xy @ np.array([[c, s], [-s, c]])
    return np.column_stack([turned, np.zeros(len(xy))])


def _apothem(points: Points, n: int) -> Points:
    """Distance (m,) [m] of points (m, 3) from the centre at right angles to the sides of a regular
    polygon of n sides, one of which is below: the largest over the sides."""
    angles = 2 * math.pi * np.arange(n) / n - math.pi / 2
    directions = np.array([np.cos(angles), np.sin(angles)])
    return (points[:, :2] @ directions).max(axis=1)


def _nearest(points: Points, location: Points) -> Numbers:
    """The number (1,) of the point that is nearest to a location (3,) [m]."""
    distances = np.linalg.norm(points - location, axis=1)
    return np.array([distances.argmin()])
