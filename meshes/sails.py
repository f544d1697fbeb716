"""Sails and sheets whose nodes lie on fold lines, for the maps of `gossamer_fx.fold`."""

from __future__ import annotations

import math

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh

from .arrays import Groups, Numbers, Points, joined, mesh_of_arrays, rim


def parallelograms(
    comm: MPI.Intracomm, a: float, b: float, gamma: float, columns: int, rows: int, cells: int
) -> Mesh:
    """The flat sheet of Miura's fold: columns × rows parallelograms with sides a and b [m], each of cells × cells.

    Parallelogram (i, j) begins at x = i b sin γ; y of its corners rises by b cos γ in even columns and falls in odd
    ones.  Groups: "film"; the edges "left" and "right"; the corner points "bottom left" and "top right".
    """

    def arrays() -> tuple[Points, Numbers, Groups]:
        u, v = np.meshgrid(
            np.arange(columns * cells + 1) / cells, np.arange(rows * cells + 1) / cells
        )
        wave = 1 - np.abs(np.remainder(u, 2) - 1)
        points = np.stack(
            [u * b * math.sin(gamma), v * a + b * math.cos(gamma) * wave, 0 * u], axis=-1
        ).reshape(-1, 3)
        ids = np.arange(u.size).reshape(u.shape)
        p, q, r, s = ids[:-1, :-1], ids[:-1, 1:], ids[1:, 1:], ids[1:, :-1]
        rising = (np.arange(columns * cells) // cells % 2 == 0)[None, :, None]
        first = np.where(rising, np.stack([p, q, s], axis=-1), np.stack([p, q, r], axis=-1))
        second = np.where(rising, np.stack([q, r, s], axis=-1), np.stack([p, r, s], axis=-1))
        sides = {
            name: np.column_stack([line[:-1], line[1:]])
            for name, line in (("left", ids[:, 0]), ("right", ids[:, -1]))
        }
        corners = {"bottom left": ids[0, :1], "top right": ids[-1, -1:]}
        return (
            points,
            np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)]),
            sides | corners,
        )

    return mesh_of_arrays(comm, arrays)


def trapezoids(
    comm: MPI.Intracomm, n: int, inner: int, outer: int, pitch: float, refine: int = 1
) -> Mesh:
    """n trapezoids between rows `inner` and `outer`, `pitch` [m] apart, joined along their seams; n = 4: a square.

    Row j is j pitch from the centre, its nodes at i tan(π/n) pitch, |i| ≤ j: rows, columns and seams are edges; cells
    are `refine` times finer.  The middle of trapezoid 0 is at (0, -y).  Groups: "film"; the edges "inner" and "outer";
    the corner points "tip 0" and so on, tip k between trapezoids k and k + 1.
    """

    def arrays() -> tuple[Points, Numbers, Groups]:
        slope, h = math.tan(math.pi / n), pitch / refine
        cells = []
        for j in range(inner * refine, outer * refine):
            for i in range(-j - 1, j + 1):
                a, b, c, d = (i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)
                for triangle in ((a, c, d), (a, d, b)) if i >= 0 else ((a, c, b), (b, c, d)):
                    if all(abs(u) <= w for u, w in triangle):
                        cells.append(triangle)
        grid = np.array(cells).reshape(-1, 2) @ np.array([[slope * h, 0.0], [0.0, -h]])
        places = [_turned(grid, 2 * math.pi * k / n) for k in range(n)]
        points, triangles, _ = joined(
            np.vstack(places), np.arange(n * len(grid)).reshape(-1, 3), 1e-6 * h
        )
        edges = rim(triangles)
        far = _apothem(points[edges].mean(axis=1), n) > (inner + outer) / 2 * pitch
        corner = math.pi * (2 * np.arange(n) + 1) / n - math.pi / 2
        tips = (
            np.column_stack([np.cos(corner), np.sin(corner), 0 * corner])
            * outer
            * pitch
            / math.cos(math.pi / n)
        )
        named = {f"tip {k}": _nearest(points, tips[k]) for k in range(n)}
        return points, triangles, {"inner": edges[~far], "outer": edges[far]} | named

    return mesh_of_arrays(comm, arrays)


def pinwheel(comm: MPI.Intracomm, n: int, side: float, columns: int, reach: int) -> Mesh:
    """The ring of `gx.fold.Star` outside a polygon of n sides [m]: `reach` columns of side/columns from each corner.

    Sectors begin at the corners of the polygon and have their columns at right angles to their bounds.  Triangles at
    the rim end at columns, so that it has a step of one side at each corner.  Groups: "film"; the edges "hub" and
    "rim"; the points "tip 0" and so on, where bisectors end.
    """

    def arrays() -> tuple[Points, Numbers, Groups]:
        h, step = side / columns, 2 * math.pi / n
        slope = math.tan(step / 2)
        cells = []
        for j in range(reach):
            for i in range(j + 1):
                cells.append(((j, i), (j + 1, i), (j + 1, i + 1)))
                if i < j:
                    cells.append(((j, i), (j + 1, i + 1), (j, i + 1)))
        half = np.array(cells).reshape(-1, 2) @ np.array([[h, 0.0], [0.0, h * slope]])
        c, s = math.cos(step), math.sin(step)
        mirrored = half @ np.array([[c, s], [s, -c]])  # about the bisector
        mirrored = mirrored.reshape(-1, 3, 2)[:, ::-1].reshape(-1, 2)
        corner = np.array([side / 2, -side / 2 / math.tan(step / 2)])
        sector = np.vstack([half, mirrored]) + corner
        tip = np.array([[reach * h, reach * h * slope]]) + corner
        places = [_turned(sector, step * k) for k in range(n)]
        points, triangles, _ = joined(
            np.vstack(places), np.arange(n * len(sector)).reshape(-1, 3), 1e-6 * h
        )
        edges = rim(triangles)
        near = np.linalg.norm(points[edges].mean(axis=1), axis=1) < side / 2 / math.sin(step / 2)
        named = {f"tip {k}": _nearest(points, _turned(tip, step * k)[0]) for k in range(n)}
        return points, triangles, {"hub": edges[near], "rim": edges[~near]} | named

    return mesh_of_arrays(comm, arrays)


def _turned(xy: Points, angle: float) -> Points:
    c, s = math.cos(angle), math.sin(angle)
    return np.column_stack([xy @ np.array([[c, s], [-s, c]]), np.zeros(len(xy))])


def _apothem(points: Points, n: int) -> Points:
    """Distance (m,) of points from the centre, across the sides of a polygon of n sides, one of which is below."""
    angles = 2 * math.pi * np.arange(n) / n - math.pi / 2
    distance: Points = (points[:, :2] @ np.array([np.cos(angles), np.sin(angles)])).max(axis=1)
    return distance


def _nearest(points: Points, place: Points) -> Numbers:
    return np.array([np.linalg.norm(points - place, axis=1).argmin()])
