"""Meshes from gmsh, with their physical groups by name."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from dolfinx import mesh as dmesh
from dolfinx.graph import adjacencylist
from dolfinx.io import distribute_entity_data
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import Direction, check_arguments, positive
from gossamer_fx.core.checks.errors import InputError, check, on_rank_zero
from gossamer_fx.core.checks.lookups import check_file, check_known
from gossamer_fx.core.forms.backend import (
    SHEETS_MAY_MEET,
    VERSION,
    distribute,
    gmsh_order,
    with_points,
)
from gossamer_fx.core.mesh.edges import EdgeTable, edges_of
from gossamer_fx.core.mesh.geometry_files import check_what_gmsh_reads
from gossamer_fx.core.mesh.gmsh_reader import (
    TIME_LIMIT,
    BadMesh,
    RawMesh,
    dropped_triangles,
    extract,
    in_child,
    read_file,
)

LOGGER = logging.getLogger("gossamer_fx")

# Parts of a mesh that share no edges: dolfinx takes 5 s for them, and four times as long for twice
# as many.
_MAX_PARTS = 30_000

# Directions that differ from a right angle by less, as typed with nine digits, are at one.
MAX_COSINE = 1e-8


@check_arguments
@dataclass(frozen=True)
class Mesh:
    """A mesh of triangles or line elements in space, with named groups.

    Made by `gmsh_mesh` or `read_mesh`.

    Attributes:
        domain: the mesh of dolfinx; coordinates in m.
        groups: for each name of a physical group of gmsh, its dimension and the local numbers of
            the entities in it (owned and ghost).

    Example:
        >>> import gossamer_fx as gx
        >>> from mpi4py import MPI
        >>> def square(model):
        ...     model.occ.addRectangle(0, 0, 0, 1, 1)
        ...     model.occ.synchronize()
        ...     model.addPhysicalGroup(2, [1], name="film")
        ...     model.mesh.generate(2)
        >>> mesh = gx.gmsh_mesh(square, MPI.COMM_SELF)
        >>> sorted(mesh.groups)
        ['film']
    """

    domain: dmesh.Mesh
    groups: dict[str, tuple[int, npt.NDArray[np.int32]]] = field(default_factory=dict)

    @property
    def comm(self) -> MPI.Intracomm:
        """The ranks that share the mesh."""
        return self.domain.comm

    @property
    def cells(self) -> int:
        """Number of triangles or line elements on all ranks."""
        topology = self.domain.topology
        return int(topology.index_map(topology.dim).size_global)

    def __repr__(self) -> str:
        """The numbers of cells and points, and the names of the groups."""
        points = int(self.domain.geometry.index_map().size_global)
        return f"<Mesh of {self.cells} {self._kind}, {points} points; {self.group_words()}>"

    @property
    def _kind(self) -> str:
        """What the cells are, in words."""
        if self.domain.topology.dim == 2:
            return "triangles"
        return "line elements"

    def group_words(self) -> str:
        """Names of the groups with what they are made of, for messages, e.g. "groups: film
        (surfaces), rim (curves)", or "groups: none"."""
        kinds = ("points", "curves", "surfaces")
        names = [
            f"{name or 'one without a name'} ({kinds[dim]})"
            for name, (dim, _) in self.groups.items()
        ]
        return f"groups: {', '.join(names) or 'none'}"

    @check_arguments
    def group(self, name: str, user: str = "group") -> tuple[int, npt.NDArray[np.int32]]:
        """Return dimension and local entities (owned and ghost) of a named group.

        Args:
            name: of the group: points, curves or surfaces of the gmsh file.
            user: item that needs the group, the first words of the error message.

        Returns:
            dimension 0, 1 or 2, and numbers (n,) of vertices, edges or cells of this rank; n may be
            0.

        Raises:
            InputError: the mesh has no group of this name; the message lists its groups.
        """
        check_known(f"{user}: the mesh", "group", name, sorted(self.groups))
        dim, entities = self.groups[name]
        check(
            dim in range(self.domain.topology.dim + 1),
            f"The group '{name}' has the dimension {dim!r}; give 0 to {self.domain.topology.dim}.",
        )
        return dim, entities

    @cached_property
    def edges(self) -> EdgeTable:
        """Edges of the triangles.  The first call creates the table, and is collective."""
        return edges_of(self.domain)

    def enclosed_volume(self) -> float:
        """Volume [m³] that the triangles enclose, positive if their normals point outwards.

        A pressure inflates a film whose normals point outwards.  Rims of an open surface are
        spanned, each by triangles between its edges and the mean of its points; a flat surface has
        the volume zero.  Collective.

        Raises:
            InputError: the mesh is one of line elements.

        Example:
            >>> import gossamer_fx as gx
            >>> from gossamer_fx.meshes.airbag import airbag
            >>> from mpi4py import MPI
            >>> airbag(MPI.COMM_SELF, edge=1.0, cells=4).enclosed_volume()
            0.0
        """
        check(
            self.domain.topology.dim == 2,
            "enclosed_volume: the mesh is one of line elements; give one of triangles.",
        )
        # Imported here: a scene does not need it.
        from gossamer_fx.core.mesh.enclosed_volume import enclosed_by

        return enclosed_by(self.domain, self.edges).volume

    @check_arguments
    def moved(
        self,
        *,
        to: tuple[float, float, float] = (0.0, 0.0, 0.0),
        x: Direction = (1.0, 0.0, 0.0),
        y: Direction = (0.0, 1.0, 0.0),
    ) -> Mesh:
        """The mesh, shifted and turned as a rigid body, with the same groups.  Collective.

        A ready mesh is made about the origin; the scene may need it elsewhere, e.g. a sheet that
        stands on its edge.  This mesh stays as it is.

        Args:
            to: where the origin of this mesh comes to lie [m].
            x: direction of its x axis afterwards, of any length.
            y: direction of its y axis, at a right angle to `x`.

        Raises:
            InputError: a direction is zero, or they are not at a right angle.

        Example:
            >>> import gossamer_fx as gx
            >>> from gossamer_fx.meshes.sheet import sheet
            >>> from mpi4py import MPI
            >>> upright = sheet(MPI.COMM_SELF, 4, 4).moved(to=(0.0, 0.0, 2.0), y=(0.0, 0.0, 1.0))
            >>> float(upright.domain.geometry.x[:, 2].max())
            3.0
        """
        lengths = np.linalg.norm([x, y], axis=1)
        first, second = np.array([x, y]) / lengths[:, None]
        cosine = float(first @ second)
        angle = float(np.degrees(np.arccos(cosine)))
        check(
            abs(cosine) < MAX_COSINE,
            f"moved: x and y must be at a right angle, and are at {angle:.4g}°; a mesh moves as a "
            "rigid body.",
        )
        axes = np.array([first, second, np.cross(first, second)])
        return Mesh(with_points(self.domain, to + self.domain.geometry.x @ axes), dict(self.groups))

    def curve(self, name: str, user: str) -> npt.NDArray[np.int32]:
        """Return the local numbers (n,) of edges, owned and ghost, of a named group of curves, in
        rising order.

        Args:
            name: name of the group.
            user: item that needs the curve, the first words of the error message.

        Raises:
            InputError: the mesh has no such group, or the group consists of triangles or points.
        """
        dim, edges = self.group(name, user)
        check(dim == 1, f"{user}: the group '{name}' has dimension {dim}; name curves of the mesh.")
        return edges


@check_arguments
def read_mesh(path: str | Path, comm: MPI.Intracomm, *, orient: bool = False) -> Mesh:
    """Read a mesh from a gmsh file (.msh) of version 2.2 or 4.x.  Collective.

    Physical groups have their names as keys of `Mesh.groups`; unnamed groups have their numbers.
    The log says which groups there are, and warns of a mesh without any.

    Args:
        path: path of the file; rank 0 reads it.
        comm: the ranks to which the mesh is distributed.
        orient: whether to turn triangles so that the normals of neighbours agree, and those of a
            closed surface, or of one whose rims are small, point outwards.

    Raises:
        InputError: the file does not exist, is damaged, is in another format, or contains a mesh
            that cannot be used, such as one of quadrilaterals or with a triangle of no area; or
            `orient` finds a surface with one side.

    Example:
        >>> def load(path):
        ...     return gx.read_mesh(path, comm).groups
    """

    def read() -> RawMesh:
        check_file(path, "mesh file", "give the path of a gmsh file (.msh)")
        try:
            return _oriented_if(orient, read_file(Path(path)))
        except BadMesh as error:
            raise InputError(str(error)) from error

    mesh = _distribute_mesh(comm, on_rank_zero(comm, read))
    words = f"'{path}': {mesh.cells} {mesh._kind}, {mesh.group_words()}"
    if mesh.groups:
        LOGGER.info(words)
    elif comm.rank == 0:
        LOGGER.warning(
            "%s; supports, seams and loads need names, so add physical groups in gmsh", words
        )
    return mesh


@check_arguments
def gmsh_mesh(
    build: Callable[[Any], None],
    comm: MPI.Intracomm,
    *,
    orient: bool = False,
    time_limit: Annotated[float, positive("s")] = TIME_LIMIT,
) -> Mesh:
    """Generate a mesh with gmsh on rank 0 and distribute it over all ranks.  Collective.

    The cells are the elements of the highest dimension; physical groups, also those of curves and
    points, become named groups.

    Args:
        build: function that takes `gmsh.model`, creates geometry [m] and physical groups, and calls
            `model.mesh.generate`.  It runs in a child process: of what it changes, only the model
            and files remain.
        comm: the ranks to which the mesh is distributed.
        orient: whether to turn triangles so that the normals of neighbours agree, and those of a
            closed surface, or of one whose rims are small, point outwards.
        time_limit: [s] after which gmsh is ended, as it may hang on outlines that cross.

    Raises:
        InputError: the model has no elements, elements of several kinds or of no size, or
            coordinates that are not finite, `build` raises an error or takes too long, or `orient`
            finds a surface with one side.

    Example:
        >>> import gossamer_fx as gx
        >>> from mpi4py import MPI
        >>> def line(model):
        ...     ends = [model.occ.addPoint(x, 0, 0, meshSize=0.5) for x in (0, 1)]
        ...     model.occ.addLine(*ends)
        ...     model.occ.synchronize()
        ...     model.mesh.generate(1)
        >>> gx.gmsh_mesh(line, MPI.COMM_SELF).domain.topology.index_map(1).size_local
        2
    """
    what = "The mesh of your function"
    return built(build, comm, what, orient=orient, time_limit=time_limit)


def _oriented_if(orient: bool, raw: RawMesh) -> RawMesh:
    """The mesh, with consistent normals if that is wanted."""
    if not orient:
        return raw
    # Imported here: most meshes have consistent normals, and do not pay for scipy's graphs.
    from gossamer_fx.core.mesh.enclosed_volume import oriented

    return oriented(raw)


def built(
    build: Callable[[Any], None],
    comm: MPI.Intracomm,
    what: str,
    *,
    orient: bool = False,
    time_limit: float = TIME_LIMIT,
) -> Mesh:
    """Distribute the mesh that a function builds in a new session of gmsh, see `gmsh_mesh`; `what`
    names the mesh in messages.  Collective."""

    def raw() -> RawMesh:
        import gmsh

        gmsh.initialize(readConfigFiles=False, interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.logger.start()
        check_what_gmsh_reads(time_limit)
        build(gmsh.model)
        dropped = dropped_triangles()
        return replace(_oriented_if(orient, extract(gmsh.model)), dropped=dropped)

    def task() -> RawMesh:
        # Any error becomes an error of all ranks; otherwise the others would wait for rank 0.
        try:
            mesh = in_child(raw, what, time_limit)
        except BadMesh as error:
            raise InputError(str(error)) from error
        if mesh.dropped:
            LOGGER.warning(
                "%s: gmsh has left out %d triangles of the STL file, which are there twice or have "
                "no area; look for holes, or write the file again",
                what,
                mesh.dropped,
            )
        return mesh

    return _distribute_mesh(comm, on_rank_zero(comm, task))


def _distribute_mesh(comm: MPI.Intracomm, raw: RawMesh | None) -> Mesh:
    """Distribute the mesh that rank 0 has, None on the other ranks, and its groups.  Collective.

    `InputError`: the mesh falls into very many parts, as that of a damaged file does; or more than
    two cells meet at one edge, on several ranks, and this version of dolfinx distributes only two.
    """
    about = None
    if raw is not None:
        about = (raw.kind, raw.order, raw.cells.shape[1], *_facets(raw))
    kind, order, width, sheets, parts = comm.bcast(about)
    check(
        parts <= _MAX_PARTS,
        f"The mesh falls into {parts} parts or more, the cells of which share no edge (or point of "
        f"a line), and may have {_MAX_PARTS}; remove duplicate nodes (gmsh: "
        "model.mesh.removeDuplicateNodes), or write the file again.",
    )
    version = ".".join(map(str, VERSION))
    check(
        sheets <= 2 or SHEETS_MAY_MEET or comm.size == 1,
        f"{sheets} cells of the mesh meet at one edge (or point of a line), and this dolfinx, "
        f"{version}, distributes only two to several ranks; use one rank, or dolfinx 0.11.",
    )
    permutation = gmsh_order(kind, width)
    # Ranks other than 0 contribute no points and no cells.
    points: npt.NDArray[np.float64] = np.zeros((0, 3))
    cells = np.zeros((0, width), dtype=np.int64)
    if raw is not None:
        points = raw.points
        cells = raw.cells[:, permutation].copy()
    domain = distribute(comm, cells, points, kind=kind, order=order, sheets=sheets)

    # All ranks must distribute the groups in the same order.
    table = None
    if raw is not None:
        table = [(name, dim, nodes.shape[1]) for name, (dim, nodes) in raw.groups.items()]
    groups = {}
    for name, dim, nodes_each in comm.bcast(table):
        entities = np.zeros((0, nodes_each), dtype=np.int64)
        if raw is not None:
            entities = raw.groups[name][1]
        # Cells have the same order of nodes as the mesh; edges of order 2 have it in both programs.
        if dim == domain.topology.dim:
            entities = entities[:, permutation]
        groups[name] = dim, _local_entities(domain, dim, entities)
    return Mesh(domain, groups)


def _facets(raw: RawMesh) -> tuple[int, int]:
    """Return the largest number of triangles that share an edge, or of line elements that share a
    point, and the number of parts, connected by such edges or points, that there are at least."""
    if raw.kind == "triangle":
        corners = np.sort(raw.cells[:, :3], axis=1)
        edges = np.vstack([corners[:, [i, j]] for i, j in ((0, 1), (0, 2), (1, 2))])
        edges = edges.astype(np.int64)
        # One number for each pair of nodes, since sorting numbers is faster than sorting rows.
        keys = edges[:, 0] * len(raw.points) + edges[:, 1]
    else:
        keys = raw.cells[:, :2].ravel()
    _, counts = np.unique(keys, return_counts=True)
    # Each cell at a facet but the first joins two parts, or parts that are joined already.
    joints = len(keys) - len(counts)
    return int(counts.max()), len(raw.cells) - joints


def _local_entities(
    domain: dmesh.Mesh, dim: int, entities: npt.NDArray[np.int64]
) -> npt.NDArray[np.int32]:
    """Local numbers (m,), owned and ghost, ascending, of entities that rank 0 lists by their nodes
    (n, k) in the numbering of the file.  Collective."""
    domain.topology.create_entities(dim)
    domain.topology.create_connectivity(dim, 0)
    domain.topology.create_connectivity(dim, domain.topology.dim)
    vertices, values = distribute_entity_data(
        domain, dim, entities, np.ones(len(entities), dtype=np.int32)
    )
    tags = dmesh.meshtags_from_entities(domain, dim, adjacencylist(vertices), values)
    return np.asarray(tags.indices, dtype=np.int32)
