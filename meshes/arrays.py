"""Meshes of which nodes and triangles are known."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh
from gossamer_fx.core.checks.errors import real_numbers
from gossamer_fx.core.mesh.gmsh_reader import check_cells as check_cells
from gossamer_fx.extend import Range, check, positive

Points = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
# Nodes of points (1,), of the edges of curves (n, 2), or of the triangles of surfaces (n, 3)
Groups = Mapping[str, Numbers]

# What generators take: lengths, numbers of cells, and the order of the geometry, 1 for plane
# triangles or 2 for curved ones.
Length = Annotated[float, positive("m")]
Cells = Annotated[int, Range(1)]
Order = Annotated[int, Range(1, 2)]

# Kinds of elements in gmsh's numbering.
GMSH_LINE = 1
GMSH_TRIANGLE = 2
GMSH_CURVED_TRIANGLE = 9
GMSH_POINT = 15


# Middle nodes (k, 3) [m] of curved edges, from their ends (k, 3) and (k, 3), which may be swapped.
Middles = Callable[[Points, Points], Points]


def mesh_of_arrays(
    comm: MPI.Intracomm,
    arrays: Callable[[], tuple[Points, Numbers, Groups]],
    middles: Middles | None = None,
) -> Mesh:
    """Make a mesh of given points and triangles, and distribute it; collective.

    Args:
        arrays: called on rank 0; returns points (n, 3) [m], triangles (m, 3) as numbers of points
            from 0, and nodes of further groups than "film" by name: (1,) of a point, (k, 2) of the
            edges of a curve, (k, 3) of the triangles of a surface.  A triangle may be in several
            surfaces.
        middles: called on rank 0 with the ends (k, 3) and (k, 3) [m] of edges; returns the middle
            nodes (k, 3) [m] of curved edges.  With it triangles are of order 2, without it of
            order 1, and plane.

    Raises:
        InputError: `arrays` raises an error, middle nodes are not k points, or the mesh cannot be
            used, e.g. without triangles.
    """

    def build(model: Any) -> None:
        points, triangles, groups = arrays()
        for name, array in {"points": points, "triangles": triangles, **groups}.items():
            has_integers = isinstance(array, np.ndarray) and array.dtype.kind in "iu"
            check(
                has_integers or (name == "points" and real_numbers(array) is not None),
                f"mesh_of_arrays: {name} is not an array of numbers of points; give integers.",
            )
        surfaces = {name: nodes for name, nodes in groups.items() if _dimension(nodes) == 2}
        # gmsh has each triangle once, in one entity; an entity may be in several groups.
        entities: dict[str, list[int]] = {name: [] for name in surfaces}
        film: list[int] = []
        for names, nodes in _pieces(triangles, surfaces):
            entity = model.addDiscreteEntity(2)
            # gmsh wants each node once: the first entity brings those of all.
            add_triangles(model, entity, points[:0] if film else points, nodes)
            film.append(entity)
            for name in names:
                entities[name].append(entity)
        for name, parts in entities.items():
            model.addPhysicalGroup(2, parts, name=name)
        model.addPhysicalGroup(2, film, name="film")
        for name, nodes in groups.items():
            if name in surfaces:
                continue
            dim = _dimension(nodes)
            entity = model.addDiscreteEntity(dim)
            model.mesh.addElementsByType(
                entity,
                GMSH_LINE if dim else GMSH_POINT,
                [],
                (nodes + 1).ravel(),
            )
            model.addPhysicalGroup(dim, [entity], name=name)
        if middles is not None:
            model.mesh.setOrder(2)
            _curve(model, middles)

    return gmsh_mesh(build, comm)


def _curve(model: Any, middles: Middles) -> None:
    """Move the middle nodes of the triangles of order 2, which gmsh puts between their corners."""
    tags, coordinates, _ = model.mesh.getNodes()
    position = np.empty((int(max(tags)) + 1, 3))
    position[tags] = coordinates.reshape(-1, 3)
    _, nodes = model.mesh.getElementsByType(GMSH_CURVED_TRIANGLE)
    corners, between = np.split(nodes.reshape(-1, 6).astype(np.int64), 2, axis=1)
    # The middle nodes follow the corners: of the edges 01, 12 and 20.
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)
    distinct, first = np.unique(between, return_index=True)
    a, b = ends.reshape(-1, 2)[first].T
    moved = real_numbers(middles(position[a], position[b]))
    check(
        moved is not None and moved.shape == (len(distinct), 3),
        f"mesh_of_arrays: middles returned no array of {len(distinct)} points (k, 3); give one "
        "point for each edge.",
    )
    assert moved is not None
    for tag, x in zip(distinct.tolist(), moved, strict=True):
        model.mesh.setNode(tag, x.tolist(), [])


def add_triangles(model: Any, entity: int, points: Points, triangles: Numbers) -> None:
    """Add points (n, 3) [m], if any, with gmsh's numbers from 1, and triangles (m, 3), which number
    them from 0, to a surface of gmsh."""
    if len(points):
        model.mesh.addNodes(
            2,
            entity,
            range(1, len(points) + 1),
            points.ravel(),
        )
    # gmsh lists nodes element by element.
    model.mesh.addElementsByType(
        entity,
        GMSH_TRIANGLE,
        [],
        (triangles + 1).ravel(),
    )


def _pieces(triangles: Numbers, surfaces: Mapping[str, Numbers]) -> list[tuple[list[str], Numbers]]:
    """Triangles (m, 3) by the surfaces that they are in: names of surfaces, and the triangles
    (n, 3) that are in all of these and in no other one, in the order of the surfaces."""
    if not surfaces:
        return [([], triangles)]
    rows = np.concatenate([triangles, *surfaces.values()])
    _, numbers = np.unique(np.sort(rows), axis=0, return_inverse=True)
    # The shape of the inverse differs between versions of NumPy.
    own, *of_surfaces = np.split(
        numbers.ravel(), np.cumsum([len(triangles), *map(len, surfaces.values())])[:-1]
    )
    is_in = np.empty((len(triangles), len(surfaces)), dtype=bool)
    for column, (name, found) in enumerate(zip(surfaces, of_surfaces, strict=True)):
        check(
            bool(np.isin(found, own).all()),
            f"mesh_of_arrays: the surface '{name}' has a triangle that is none of the triangles; "
            "add it to them.",
        )
        is_in[:, column] = np.isin(own, found)
    # Those that are in the first surface come first: False sorts below True.
    kinds, kind_of = np.unique(~is_in, axis=0, return_inverse=True)
    pieces = []
    for number, kind in enumerate(kinds):
        names = [name for name, is_out in zip(surfaces, kind, strict=True) if not is_out]
        pieces.append((names, triangles[kind_of.ravel() == number]))
    return pieces


def _dimension(nodes: Numbers) -> int:
    """Dimension of a group: 0 of a point (1,), 1 of edges (n, 2), 2 of triangles (n, 3)."""
    return nodes.shape[1] - 1 if nodes.ndim == 2 else 0


class CellCorners(NamedTuple):
    """Numbers of the nodes at the four corners of the cells of a grid, counterclockwise; arrays of
    one shape."""

    a: Numbers
    b: Numbers
    c: Numbers
    d: Numbers


def cell_corners(ids: Numbers) -> CellCorners:
    """Corners (ny, nx) of each cell of a grid of nodes (ny + 1, nx + 1), counterclockwise for rows
    upwards."""
    lower = ids[:-1]
    upper = ids[1:]
    return CellCorners(lower[:, :-1], lower[:, 1:], upper[:, 1:], upper[:, :-1])


def around_centres(corners: CellCorners, centre: Numbers) -> Numbers:
    """Four triangles (4 n, 3) of each of n cells, one on each side, with a node `centre` (n,) in
    its middle."""
    return np.concatenate(
        [
            triangles_of(corners.a, corners.b, centre),
            triangles_of(corners.b, corners.c, centre),
            triangles_of(corners.c, corners.d, centre),
            triangles_of(corners.d, corners.a, centre),
        ]
    )


def plane_grid(x: npt.NDArray[np.floating], y: npt.NDArray[np.floating]) -> Points:
    """Points (ny nx, 3) [m] in z = 0 of a grid with columns x (nx,) [m] and rows y (ny,) [m], row
    by row."""
    along = np.tile(x, len(y))
    across = np.repeat(y, len(x))
    return np.column_stack([along, across, np.zeros(along.size)])


def triangles_of(a: Numbers, b: Numbers, c: Numbers) -> Numbers:
    """Triangles (n, 3) of n first, second and third corners, arrays of any shape."""
    return np.stack([a, b, c], axis=-1).reshape(-1, 3)


def polyline(nodes: Numbers) -> Numbers:
    """Edges (n, 2) between consecutive nodes (n + 1,)."""
    return np.column_stack([nodes[:-1], nodes[1:]])


def joined(
    points: Points, triangles: Numbers, tolerance: float = 1e-9
) -> tuple[Points, Numbers, Numbers]:
    """Merge points (n, 3) [m] whose coordinates agree when rounded to a tolerance [m]: the
    different points (k, 3), the triangles between them (m, 3), and the new number of each given
    point (n,)."""
    rounded = np.rint(points / tolerance)
    _, first, inverse = np.unique(
        rounded,
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    # The shape of the inverse differs between versions of NumPy.
    new_numbers = inverse.ravel()
    return points[first], new_numbers[triangles], new_numbers


def rim(triangles: Numbers) -> Numbers:
    """Edges (n, 2) that belong to one of the triangles (m, 3) only, as numbers of nodes."""
    edges, count = np.unique(sorted_sides(triangles), axis=0, return_counts=True)
    return edges[count == 1]


def sorted_sides(triangles: Numbers) -> Numbers:
    """The sides (3 n, 2) of triangles (n, 3), the smaller number first: a side that two share
    occurs twice."""
    sides = triangles[:, [[0, 1], [1, 2], [2, 0]]]
    return np.sort(sides.reshape(-1, 2), axis=1)


def require_ascending(generator: str, names: Sequence[str], lengths: Sequence[float]) -> None:
    """Raise `InputError` unless the second of two lengths, named `names`, is the larger one; the
    same on all ranks."""
    check(
        lengths[0] < lengths[1],
        f"{generator}: {names[0]} is {lengths[0]!r} and {names[1]} is {lengths[1]!r}; "
        f"give a larger {names[1]}.",
    )
