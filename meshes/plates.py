"""Meshes of plates: irregular sheets and slit rings of plane triangles."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh
from gossamer_fx.extend import check_arguments

from .arrays import (
    Cells,
    Length,
    Middles,
    Order,
    cell_corners,
    check_cells,
    mesh_of_arrays,
    polyline,
    require_ascending,
    triangles_of,
)

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]


@check_arguments
def irregular_sheet(
    comm: MPI.Intracomm, nx: Cells, ny: Cells, width: Length, height: Length, seed: int = 1
) -> Mesh:
    """Make [0, width] × [0, height] of triangles with displaced nodes and random diagonals.

    Groups: "film"; the edges "bottom", "right", "top", "left"; "middle", a line of interior edges
    if nx is even.  Collective.

    Args:
        nx, ny: cells of two triangles along x and y.
        width, height: [m].
        seed: of the random numbers, the same mesh for the same seed.

    Raises:
        InputError: a length is not positive, or there are no cells.
    """
    check_cells("irregular_sheet", 2 * nx * ny)
    random = np.random.default_rng(seed)
    # Coordinates (nx + 1, ny + 1) of the nodes from 0 to 1, along x and y.
    unit_square = _displaced(nx, ny, random)
    u = unit_square[..., 0]
    v = unit_square[..., 1]
    has_middle = nx % 2 == 0
    if has_middle:
        # The middle line of nodes is straight, whatever the random displacements.
        u[nx // 2] = 0.5
    points = np.stack([width * u, height * v, 0 * u], axis=-1)
    ids = _ids(nx, ny)
    lines = _edges(ids)
    if has_middle:
        lines["middle"] = ids[nx // 2]
    # Diagonals of half of the cells run the other way.
    turned = random.random((nx, ny)) < 0.5
    return _mesh(comm, points, _triangles(ids, turned), lines)


@check_arguments
def leaning_sheet(
    comm: MPI.Intracomm, nx: Cells, ny: Cells, width: Length, height: Length, ramp: Length
) -> Mesh:
    """Make [0, width] × [0, height] in cells whose long sides lie at 45°, along wrinkles of a
    sheared film.

    Towards both ends they turn upright.  Groups: "film"; the edges "bottom", "right", "top",
    "left". Collective.

    Args:
        nx, ny: cells of two triangles along x and y.
        width, height: [m].
        ramp: length within which cells turn upright [m], more than half of the height.

    Raises:
        InputError: a length is not positive, or there are no cells.
    """
    check_cells("leaning_sheet", 2 * nx * ny)
    unit_square = _displaced(nx, ny, None)
    x = width * unit_square[..., 0]
    y = height * unit_square[..., 1]
    # 0 at the ends, 1 beyond the ramps: at 45° a node moves by its height above the middle.
    from_end = np.minimum(x, width - x)
    lean = np.clip(from_end / ramp, 0, 1)
    points = np.stack([x + lean * (y - height / 2), y, 0 * x], axis=-1)
    ids = _ids(nx, ny)
    none_turned = np.zeros((nx, ny), dtype=bool)
    return _mesh(comm, points, _triangles(ids, none_turned), _edges(ids))


@check_arguments
def slit_ring(
    comm: MPI.Intracomm,
    radial: Cells,
    around: Cells,
    inner: Length,
    outer: Length,
    order: Order = 1,
) -> Mesh:
    """Make a flat ring about the origin, cut along the positive x axis, in cells of two triangles.

    Groups: "film"; "start" and "end", the two sides of the slit, at 0 and 2π.  Collective.

    Args:
        radial, around: numbers of cells along a radius and around.
        inner, outer: radii [m].
        order: of the geometry, 1, or 2 with arcs around the axis.

    Raises:
        InputError: a radius is not positive, the inner one is not the smaller one, or there are no
            cells.
    """
    require_ascending("slit_ring", ("inner", "outer"), (inner, outer))
    check_cells("slit_ring", 2 * radial * around)
    # Coordinates (radial + 1, around + 1) of the nodes from 0 to 1, outwards and around.
    unit_square = _displaced(radial, around, None)
    # Diagonals alternate, so that the mesh has no sense of rotation.
    odd = np.add.outer(np.arange(radial), np.arange(around)) % 2 > 0
    r = inner + (outer - inner) * unit_square[..., 0]
    angle = 2 * np.pi * unit_square[..., 1]
    points = np.stack([r * np.cos(angle), r * np.sin(angle), 0 * r], axis=-1)
    ids = _ids(radial, around)
    lines = {"start": ids[:, 0], "end": ids[:, -1]}

    def middles(a: Floats, b: Floats) -> Floats:
        half_way = (a + b) / 2
        radii = np.linalg.norm([a, b, half_way], axis=2)
        is_arc = np.isclose(radii[0], radii[1], rtol=1e-9, atol=0.0)
        return half_way * np.where(is_arc, radii[0] / radii[2], 1.0)[:, None]

    curved = None if order == 1 else middles
    return _mesh(comm, points, _triangles(ids, odd), lines, curved)


@check_arguments
def free_slit_ring(
    comm: MPI.Intracomm, size: Length, inner: Length, outer: Length, order: Order = 1
) -> Mesh:
    """Make the ring of `slit_ring`, cut along the positive x axis, in triangles that follow no
    direction.

    Groups: "film"; "start" and "end", the two sides of the slit.  Collective.

    Args:
        size: of the edges of triangles, about [m].
        inner, outer: radii [m].
        order: of the geometry, 1, or 2 with curved triangles at the arcs.

    Raises:
        InputError: a length is not positive, or the inner radius is not the smaller one.
    """
    require_ascending("free_slit_ring", ("inner", "outer"), (inner, outer))
    check_cells("free_slit_ring", np.pi * (outer**2 - inner**2) / (size**2 / 2))

    def build(model: Any) -> None:
        import gmsh

        geo = model.geo
        # gmsh draws arcs below 180° only: three to a circle.  The last point is a second one on
        # the first, on the other side of the slit.
        angles = [2 * np.pi * k / 3 for k in range(4)]
        centre = geo.addPoint(0, 0, 0)

        def on_circle(radius: float) -> list[int]:
            """Points of gmsh at the four angles, on a circle of a radius [m]."""
            return [
                geo.addPoint(radius * np.cos(angle), radius * np.sin(angle), 0) for angle in angles
            ]

        inside = on_circle(inner)
        outside = on_circle(outer)
        inner_arcs = [geo.addCircleArc(p, centre, q) for p, q in pairwise(inside)]
        outer_arcs = [geo.addCircleArc(p, centre, q) for p, q in pairwise(outside)]
        start = geo.addLine(inside[0], outside[0])
        end = geo.addLine(inside[-1], outside[-1])
        back = [-arc for arc in reversed(inner_arcs)]
        loop = geo.addCurveLoop([start, *outer_arcs, -end, *back])
        surface = geo.addPlaneSurface([loop])
        geo.synchronize()
        for limit in ("Min", "Max"):
            gmsh.option.setNumber(f"Mesh.MeshSize{limit}", size)
        model.addPhysicalGroup(2, [surface], name="film")
        model.addPhysicalGroup(1, [start], name="start")
        model.addPhysicalGroup(1, [end], name="end")
        model.mesh.generate(2)
        model.mesh.setOrder(order)

    return gmsh_mesh(build, comm)


def _displaced(n: int, m: int, random: np.random.Generator | None) -> Floats:
    """Nodes (n + 1, m + 1, 2) of a grid of n by m cells on the unit square, the first index along
    the first side; a random generator moves them by up to a quarter of a cell, those on the edges
    along them."""
    nodes = np.empty((n + 1, m + 1, 2))
    nodes[..., 0] = np.linspace(0, 1, n + 1)[:, None]
    nodes[..., 1] = np.linspace(0, 1, m + 1)
    # More than a quarter of a cell could turn a triangle over.
    if random is not None:
        nodes[1:-1, :, 0] += random.uniform(-0.25, 0.25, (n - 1, m + 1)) / n
        nodes[:, 1:-1, 1] += random.uniform(-0.25, 0.25, (n + 1, m - 1)) / m
    return nodes


def _edges(ids: Integers) -> dict[str, Integers]:
    """The nodes along the four edges of a grid by name; its first index runs from the left to the
    right, its second one upwards."""
    return {
        "bottom": ids[:, 0],
        "right": ids[-1],
        "top": ids[:, -1],
        "left": ids[0],
    }


def _ids(n: int, m: int) -> Integers:
    """Numbers (n + 1, m + 1), from 0, of the nodes of a grid of n by m cells."""
    return np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)


def _triangles(ids: Integers, is_turned: npt.NDArray[np.bool_]) -> Integers:
    """Two triangles (2 n m, 3) of each cell of a grid, counterclockwise, by the numbers (n + 1, m +
    1) of its nodes, the first index along x; cells of the mask `is_turned` (n, m) have the other
    diagonal."""
    # `cell_corners` is counterclockwise where the second index runs along x: b and d are exchanged.
    corners = cell_corners(ids)
    a = corners.a
    b = corners.d
    c = corners.c
    d = corners.b
    usual = ~is_turned
    return np.concatenate(
        [
            triangles_of(a[usual], b[usual], c[usual]),
            triangles_of(a[usual], c[usual], d[usual]),
            triangles_of(a[is_turned], b[is_turned], d[is_turned]),
            triangles_of(b[is_turned], c[is_turned], d[is_turned]),
        ]
    )


def _mesh(
    comm: MPI.Intracomm,
    points: Floats,
    triangles: Integers,
    lines: dict[str, Integers],
    middles: Middles | None = None,
) -> Mesh:
    """Make a mesh of points (..., 3) [m], triangles (m, 3), and the nodes (k,) along each named
    group of edges, by their numbers from 0, and distribute it; `middles` as of `mesh_of_arrays`.
    Collective."""
    flat = points.reshape(-1, 3)
    edges = {name: polyline(nodes) for name, nodes in lines.items()}
    return mesh_of_arrays(comm, lambda: (flat, triangles, edges), middles)
