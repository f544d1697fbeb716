"""Triangulated surfaces, from which cut patterns are made, and their sources.

A surface is the form that a film shall have when it is sewn and tensioned: a found form, an
equilibrium, a mesh, a height z(x, y) or a file of CAD.  Every rank has all of it, since patterns
are made of some ten thousand triangles and not of millions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from gossamer_fx.build.patterns.closest import Numbers
from gossamer_fx.build.patterns.cutting import cut_surface
from gossamer_fx.build.patterns.geodesics import SurfaceGraph, geodesic, graph_of
from gossamer_fx.build.patterns.seam_lines import (
    Neighbours,
    SeamLine,
    line_through,
    neighbours_of,
    points_on,
    section,
    section_lines,
)
from gossamer_fx.build.patterns.strips import Strips
from gossamer_fx.build.patterns.triangulation import (
    Triangulation,
    area_vectors,
    rows_of_points,
    sides_of,
)
from gossamer_fx.core.checks.arguments import at_least, check_arguments, ends_in, positive
from gossamer_fx.core.checks.errors import (
    InputError,
    are_usual_sizes,
    check,
    on_rank_zero,
    real_numbers,
)
from gossamer_fx.core.checks.lookups import check_file
from gossamer_fx.core.checks.relations import as_many
from gossamer_fx.core.checks.strange_files import open_file
from gossamer_fx.core.forms.backend import cell_nodes, geometry_nodes
from gossamer_fx.core.mesh.enclosed_volume import oriented
from gossamer_fx.core.mesh.gmsh_reader import (
    TIME_LIMIT,
    BadMesh,
    RawMesh,
    check_cells,
    extract,
    in_child,
)
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.state import HasSystem
from gossamer_fx.mechanics.bodies.membrane import Membrane

# Points (n, 3) [m] and triangles (m, 3) between them
PointsAndTriangles = tuple[npt.ArrayLike, npt.ArrayLike]

# Most triangles of a surface: every rank has all of them, and patterns need some ten thousand.
MAX_TRIANGLES = 1_000_000

# Area of a triangle over the square of its longest side, below which it counts as without area.
NO_AREA = 1e-12

# Endings of files that gmsh reads as CAD, in lower case.
CAD_FILES = (".step", ".stp", ".iges", ".igs", ".brep")


@check_arguments
@dataclass(frozen=True, eq=False, repr=False)
class FormSurface(Triangulation):
    """The form that a film shall have, as a triangulated surface; made by `surface`,
    `height_surface` or `read_surface`.

    Example:
        >>> points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
        >>> square = gx.patterns.surface((points, [[0, 1, 2], [0, 2, 3]]))
        >>> round(square.area, 12), len(square.triangles)
        (1.0, 2)
    """

    @check_arguments
    def by_planes(self, points: npt.ArrayLike, normal: npt.ArrayLike) -> list[SeamLine]:
        """Lines in which planes cut the surface, e.g. for seams.

        Where a plane meets the surface in several lines, each is one.  A line goes along (normal of
        the plane) × (normal of the surface).

        Args:
            points: a point (n, 3) [m] of each plane.
            normal: of all planes (3,), or of each one (n, 3).

        Raises:
            InputError: a normal is zero, or a plane does not cut the surface.

        Example:
            >>> points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
            >>> square = gx.patterns.surface((points, [[0, 1, 2], [0, 2, 3]]))
            >>> (line,) = square.by_planes([[0.25, 0.0, 0.0]], (1.0, 0.0, 0.0))
            >>> line.length
            1.0
        """
        origins = rows_of_points("FormSurface.by_planes", points)
        normals = real_numbers(normal)
        if normals is None or normals.shape not in ((3,), origins.shape):
            raise InputError(
                "FormSurface.by_planes: normal is not (3,), or one (3,) for each point."
            )
        found = []
        for k in range(len(origins)):
            origin: Array = origins[k]
            across: Array = normals if normals.ndim == 1 else normals[k]
            length = float(np.linalg.norm(across))
            check(
                math.isfinite(length) and length > 0,
                f"FormSurface.by_planes: the normal of plane {k + 1} is {across.tolist()}; "
                "give a vector that is not zero.",
            )
            cut = section(self, origin, across / length)
            lines = section_lines(self, self._neighbours, cut)
            check(
                bool(lines),
                f"FormSurface.by_planes: plane {k + 1} does not cut the surface; move its point.",
            )
            found += lines
        return found

    @check_arguments
    def along(self, points: npt.ArrayLike) -> SeamLine:
        """The line on the surface through given points, e.g. for a seam.

        Each point is moved to the closest one of the surface, and an end that is then near the rim
        to the rim.  Between two points the line is in the plane through both that contains the
        normal of the surface.

        Args:
            points: two or more points (n, 3) [m] in the order of the line.

        Raises:
            InputError: fewer than two points, a point far from the surface, or no way on the
                surface from one to the next.

        Example:
            >>> points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
            >>> square = gx.patterns.surface((points, [[0, 1, 2], [0, 2, 3]]))
            >>> round(square.along([(0.0, 0.5, 0.0), (0.5, 0.5, 0.0), (1.0, 0.7, 0.0)]).length, 4)
            1.0385
        """
        given = rows_of_points("FormSurface.along", points)
        check(len(given) > 1, "FormSurface.along: there is one point; give two or more.")
        return line_through(self, self._neighbours, given)

    @check_arguments(as_many("starts", "ends"))
    def geodesics(self, starts: npt.ArrayLike, ends: npt.ArrayLike) -> list[SeamLine]:
        """The shortest lines on the surface between pairs of points, e.g. for seams.

        Each point is moved to the closest one of the surface, and to the rim if that is near.  A
        geodesic is the straightest line:
        a strip between two of them has the straightest edges when it is flat.  If there are several
        ways, e.g. on both sides of a hill, it is the shortest one nearby; give it in parts, with a
        point between them, to have another one.

        Args:
            starts: a point (n, 3) [m] at the start of each line.
            ends: a point (n, 3) [m] at its end.

        Raises:
            InputError: there are not as many ends as starts, a point is far from the surface, both
                points of a line are one, or the surface does not connect them.

        Example:
            >>> points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
            >>> square = gx.patterns.surface((points, [[0, 1, 2], [0, 2, 3]]))
            >>> (line,) = square.geodesics([[0.0, 0.4, 0.0]], [[1.0, 0.7, 0.0]])
            >>> round(line.length, 4)
            1.044
        """
        given = rows_of_points("FormSurface.geodesics", starts)
        given_ends = rows_of_points("FormSurface.geodesics", ends)
        every = range(len(given))
        near = self._neighbours
        from_points = points_on(self, near, given, "FormSurface.geodesics: start", every)
        to_points = points_on(self, near, given_ends, "FormSurface.geodesics: end", every)
        lines = []
        for k in range(len(given)):
            line = geodesic(
                self._graph,
                triangles=(int(from_points.triangle[k]), int(to_points.triangle[k])),
                weights=(from_points.weights[k], to_points.weights[k]),
            )
            if line is None:
                raise InputError(
                    f"FormSurface.geodesics: start {k + 1} and end {k + 1} are one point, or are "
                    "on parts of the surface that are not connected."
                )
            lines.append(line)
        return lines

    @check_arguments
    def cut(self, lines: Annotated[Sequence[SeamLine], at_least(1)]) -> Strips:
        """Cut the surface along lines; both sides of a cut have the same points.

        Lines may cross each other, and may end inside of the surface.

        Args:
            lines: one or more lines of this surface.

        Raises:
            InputError: there are no lines, or one that only follows the rim.

        Example:
            >>> points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
            >>> square = gx.patterns.surface((points, [[0, 1, 2], [0, 2, 3]]))
            >>> strips = square.cut(square.by_planes([[0.25, 0, 0], [0.5, 0, 0]], (1, 0, 0)))
            >>> [round(strips[k].area, 12) for k in range(len(strips))]
            [0.25, 0.25, 0.5]
        """
        return Strips(self, cut_surface(self, lines))

    @cached_property
    def _graph(self) -> SurfaceGraph:
        """What geodesics need."""
        return graph_of(self, self._neighbours)

    @cached_property
    def _neighbours(self) -> Neighbours:
        """The triangles by their sides."""
        return neighbours_of(self)


@check_arguments
def surface(
    source: PointsAndTriangles | Mesh | Membrane,
    *,
    at: HasSystem | None = None,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> FormSurface:
    """Make a surface of points and triangles, of a mesh, or of a film.

    Of a film whose form was found (`analysis.find_form`) the mesh is the form.  Of an equilibrium
    or run, `at`, the present positions of the film are taken.  Named points and edges of the mesh
    are kept.  Of a curved mesh the corners of the triangles count.  Collective.

    Args:
        source: points (n, 3) [m] and triangles (m, 3), which number them from 0; or a mesh; or a
            film.
        at: an `Equilibrium` or a `Simulation` with the film.
        comm: the ranks that shall have it, of points and triangles; those of rank 0 are taken.  A
            mesh has its ranks.

    Raises:
        InputError: points that are not numbers, a triangle that is not of three points or has no
            area, more than two triangles at an edge, a surface with one side only.

    Example:
        >>> flat = gx.patterns.surface(mesh)
        >>> at_rest = gx.patterns.surface(film)
        >>> flat.area == at_rest.area
        True
    """
    if isinstance(source, tuple):
        check(at is None, "surface: at is given with points and triangles; give a film.")
        arrays = on_rank_zero(comm, lambda: _checked_arrays(source))
        return _distributed(comm, arrays)
    if isinstance(source, Mesh):
        check(at is None, "surface: at is given with a mesh; give the film.")
        return _of_mesh(source, source.domain.geometry.x)
    if at is None:
        return _of_mesh(source.mesh, source.mesh.domain.geometry.x)
    domain = source.mesh.domain
    positions = at.system.unknowns.state[source].local_positions()
    rows = geometry_nodes(domain)
    x = domain.geometry.x.copy()
    # The corners come first in the nodes of both, in the same order.
    x[rows[:, :3].ravel()] = positions[cell_nodes(source.space)[:, :3].ravel()]
    return _of_mesh(source.mesh, x)


@check_arguments
def height_surface(
    z: Callable[[Array, Array], Any],
    *,
    outline: Sequence[Sequence[float]] | Array,
    size: Annotated[float, positive("m")],
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> FormSurface:
    """Make the surface of a height z(x, y) over a plane outline.  Collective.

    Groups: "rim 1", ... are its sides, "corner 1", ... its corners, in the order of the outline;
    side k goes from corner k to the next one.

    Args:
        z: function of x (n,) and y (n,) [m] that returns heights (n,) [m].
        outline: three or more corners (k, 2) [m] of a polygon.
        size: length of the edges of triangles in the plan [m].
        comm: the ranks that shall have it.

    Raises:
        InputError: the outline has fewer than three corners, crosses itself or has no area, there
            would be too many triangles, or heights are not numbers.

    Example:
        >>> corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        >>> dish = gx.patterns.height_surface(
        ...     lambda x, y: (x**2 + y**2) / 4, outline=corners, size=0.2
        ... )
        >>> sorted(dish.groups)[:2], round(float(dish.points[:, 2].max()), 9)
        (['corner 1', 'corner 2'], 0.5)
    """
    corners = real_numbers(outline)
    if corners is None or corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise InputError("height_surface: outline is not a list of three corners (x, y) or more.")
    following = np.roll(corners, -1, axis=0)
    area = abs(float((corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]).sum())) / 2
    sides = np.linalg.norm(following - corners, axis=1)
    check(
        area > NO_AREA * float(sides.max()) ** 2 and bool((sides > 0).all()),
        "height_surface: outline has no area, or a corner twice; give the corners of a polygon.",
    )
    check_cells("height_surface", 2.3 * area / size**2)

    def build(model: Any) -> None:
        geo = model.geo
        points = [geo.addPoint(x, y, 0.0, size) for x, y in corners]
        lines = [geo.addLine(a, b) for a, b in zip(points, np.roll(points, -1), strict=True)]
        plane = geo.addPlaneSurface([geo.addCurveLoop(lines)])
        geo.synchronize()
        model.addPhysicalGroup(2, [plane], name="film")
        for k, (line, point) in enumerate(zip(lines, points, strict=True), start=1):
            model.addPhysicalGroup(1, [line], name=f"rim {k}")
            model.addPhysicalGroup(0, [point], name=f"corner {k}")
        model.mesh.generate(2)

    def arrays() -> RawMesh:
        raw = _from_gmsh(build, "The mesh of the outline")
        heights = real_numbers(z(raw.points[:, 0].copy(), raw.points[:, 1].copy()))
        check(
            heights is not None and heights.shape in ((), (len(raw.points),)),
            "height_surface: z does not return one number for each point; return an array like x.",
        )
        points = raw.points.copy()
        points[:, 2] = heights
        return _checked(replace(raw, points=points), "height_surface")

    return _distributed(comm, on_rank_zero(comm, arrays))


@check_arguments
def read_surface(
    path: Annotated[str | Path, ends_in(".stl", *CAD_FILES)],
    *,
    scale: Annotated[float, positive()] = 1.0,
    size: Annotated[float, positive("m")] | None = None,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    time_limit: Annotated[float, positive("s")] = TIME_LIMIT,
) -> FormSurface:
    """Read a surface from an STL file, or mesh one from a STEP, IGES or BREP file.  Collective.

    The triangles of an STL file are taken as they are.  All surfaces of a file are taken, with one
    side of normals where they are connected.

    Args:
        path: path of the file, which ends in .stl, .step, .stp, .iges, .igs or .brep; rank 0 reads
            it.
        scale: metres in a unit of the STL file.  Files of CAD say their unit.
        size: length of the edges of triangles [m], of files of CAD.
        comm: the ranks that shall have it.
        time_limit: [s] after which gmsh is ended.

    Raises:
        InputError: there is no such file, it is damaged or of another kind, a size is missing, or
            the surface cannot be used, see `surface`.

    Example:
        >>> def dish(path):
        ...     return gx.patterns.read_surface(path, scale=1e-3)
    """
    file = Path(path)
    ending = file.suffix.lower()
    check(
        ending == ".stl" or size is not None,
        f"read_surface: '{file}' has no triangles; give size, the length of their edges.",
    )

    def build(model: Any) -> None:
        import gmsh

        if ending == ".stl":
            gmsh.merge(str(file.resolve()))
            factor = [scale, 0, 0, 0, 0, scale, 0, 0, 0, 0, scale, 0]
            model.mesh.affineTransform(factor)
            model.mesh.removeDuplicateNodes()
            return
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
        model.occ.importShapes(str(file.resolve()))
        model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.MeshSizeMin", size)
        model.mesh.generate(2)

    def arrays() -> RawMesh:
        check_file(file, "file", "give the path of a surface")
        with open_file(file):
            # Refused here, if it is not a file that can be read as a whole.
            pass
        raw = _from_gmsh(build, f"The surface of '{file}'", time_limit)
        return _checked(raw, f"'{file}'")

    return _distributed(comm, on_rank_zero(comm, arrays))


def _from_gmsh(build: Callable[[Any], None], what: str, time_limit: float = TIME_LIMIT) -> RawMesh:
    """The mesh that a function builds in gmsh, on this rank alone."""

    def raw() -> RawMesh:
        import gmsh

        gmsh.initialize(readConfigFiles=False, interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
        build(gmsh.model)
        return extract(gmsh.model)

    try:
        found = in_child(raw, what, time_limit)
    except BadMesh as error:
        raise InputError(str(error)) from error
    check(found.kind == "triangle", f"{what} has no triangles; give a surface.")
    return found


def _checked_arrays(source: PointsAndTriangles) -> RawMesh:
    """Given points and triangles as a checked mesh."""
    points = rows_of_points("surface", source[0])
    triangles = np.asarray(source[1])
    check(
        triangles.ndim == 2 and triangles.shape[1] == 3 and triangles.dtype.kind in "iu",
        "surface: triangles are not rows of three numbers of points; give integers (m, 3).",
    )
    cells = triangles.astype(np.int64)
    check(
        len(cells) > 0 and bool((cells >= 0).all()) and bool((cells < len(points)).all()),
        f"surface: a triangle has a point that is none of the {len(points)} points, or there are "
        "no triangles; number the points from 0.",
    )
    return _checked(RawMesh("triangle", 1, points, cells, {}), "surface")


def _checked(raw: RawMesh, what: str) -> RawMesh:
    """A mesh of triangles with corners only, points that are used, and consistent normals;
    `InputError`: it is not a surface."""
    triangles = raw.cells[:, :3]
    check(
        len(triangles) <= MAX_TRIANGLES,
        f"{what}: there are {len(triangles)} triangles; give at most {MAX_TRIANGLES}.",
    )
    check(
        are_usual_sizes(raw.points),
        f"{what}: there are points whose coordinates are not numbers up to 1e100 m; mend them.",
    )
    corners = raw.points[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    areas = np.linalg.norm(area_vectors(raw.points, triangles), axis=1)
    flat = np.flatnonzero(areas <= NO_AREA * longest**2)
    check(
        not len(flat),
        f"{what}: {len(flat)} triangles have no area, the first of them the one numbered "
        f"{flat[0] if len(flat) else 0}; leave them out.",
    )
    sides = np.sort(sides_of(triangles), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    if count.max() > 2:
        where = ", ".join(f"{x:.4g}" for x in raw.points[edges[count.argmax()]].mean(axis=0))
        raise InputError(
            f"{what}: {count.max()} triangles meet at an edge, at ({where}) m; "
            "give a surface without branches."
        )
    try:
        triangles = oriented(replace(raw, order=1, cells=triangles)).cells
    except BadMesh as error:
        raise InputError(
            f"{what}: the surface has one side only, as a Möbius strip; cut it open."
        ) from error
    used, numbers = np.unique(triangles, return_inverse=True)
    new_number = np.full(len(raw.points), -1, dtype=np.int64)
    new_number[used] = np.arange(len(used))
    groups = {}
    for name, (dim, nodes) in raw.groups.items():
        if dim < 2:
            groups[name] = (dim, new_number[nodes[:, : dim + 1]])
    return RawMesh("triangle", 1, raw.points[used], numbers.reshape(-1, 3), groups)


def _distributed(comm: MPI.Intracomm, raw: RawMesh | None) -> FormSurface:
    """The surface of a mesh that rank 0 has, on all ranks.  Collective."""
    found = comm.bcast(raw)
    groups = {}
    for name, (dim, nodes) in found.groups.items():
        groups[name] = nodes.ravel() if dim == 0 else nodes
    return FormSurface(found.points, found.cells, groups, comm)


def _of_mesh(mesh: Mesh, x: Array) -> FormSurface:
    """The surface of a distributed mesh with its nodes at x (n, 3) [m], local rows of its geometry.
    Collective."""
    domain = mesh.domain
    check(
        domain.topology.dim == 2,
        "surface: the mesh is one of line elements; give one of triangles.",
    )
    own = domain.topology.index_map(2).size_local
    rows = geometry_nodes(domain)[:, :3]
    # Numbers of the mesh as it was read, which do not depend on the number of ranks.
    numbers = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)
    cell_numbers = np.asarray(domain.topology.original_cell_index, dtype=np.int64)[:own]
    nodes = np.unique(rows[:own])
    vertices = domain.topology.connectivity(2, 0).array
    row_of_vertex = np.zeros(int(vertices.max(initial=-1)) + 1, dtype=np.int64)
    row_of_vertex[vertices] = rows.ravel()
    groups = {}
    for name, (dim, entities) in mesh.groups.items():
        if dim == 0:
            groups[name] = numbers[row_of_vertex[entities]].reshape(-1, 1)
        elif dim == 1:
            groups[name] = numbers[row_of_vertex[mesh.edges.vertices[entities]]].reshape(-1, 2)
    mine = (cell_numbers, numbers[rows[:own]], numbers[nodes], x[nodes], groups)
    parts = mesh.comm.allgather(mine)
    order = np.argsort(np.concatenate([part[0] for part in parts]))
    triangles = np.concatenate([part[1] for part in parts])[order]
    given, first = np.unique(np.concatenate([part[2] for part in parts]), return_index=True)
    points = np.concatenate([part[3] for part in parts])[first]
    found: dict[str, tuple[int, Numbers]] = {}
    for name in mesh.groups:
        of_ranks = [part[4][name] for part in parts if name in part[4]]
        if of_ranks:
            together = np.unique(np.sort(np.concatenate(of_ranks), axis=1), axis=0)
            found[name] = (together.shape[1] - 1, np.searchsorted(given, together))
    raw = RawMesh(
        "triangle",
        1,
        np.asarray(points, dtype=np.float64),
        np.searchsorted(given, triangles),
        found,
    )
    return _distributed(mesh.comm, on_rank_zero(mesh.comm, lambda: _checked(raw, "surface")))
