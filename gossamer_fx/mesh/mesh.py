"""Meshes from gmsh, with their physical groups by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import mesh as dmesh
from dolfinx.graph import adjacencylist
from dolfinx.io import distribute_entity_data
from mpi4py import MPI

from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import InputError, check, on_rank_zero
from gossamer_fx.forms.backend import SHEETS_MAY_MEET, VERSION, distribute, gmsh_order
from gossamer_fx.mesh.edges import EdgeTable, edges_of
from gossamer_fx.mesh.gmsh_reader import BadMesh, RawMesh, extract, read_file


@check_arguments
@dataclass(frozen=True)
class Mesh:
    """A mesh in space with named groups.

    `groups` maps the name of a gmsh physical group to its dimension and the local entities in it (owned and ghost).
    """

    domain: dmesh.Mesh
    groups: dict[str, tuple[int, npt.NDArray[np.int32]]] = field(default_factory=dict)

    @property
    def comm(self) -> MPI.Intracomm:
        """The ranks that share the mesh."""
        return self.domain.comm

    def group(self, name: str) -> tuple[int, npt.NDArray[np.int32]]:
        """Dimension and local entities of a named group."""
        known = ", ".join(sorted(self.groups)) or "none"
        check(name in self.groups, f"The mesh has no group '{name}'; its groups are: {known}.")
        return self.groups[name]

    @cached_property
    def edges(self) -> EdgeTable:
        """The edges of the triangles, made when they are first asked for; collective then."""
        return edges_of(self.domain)

    def curve(self, name: str, user: str) -> npt.NDArray[np.int32]:
        """Local edges (owned and ghost) of a named group of curves, in rising order.

        Raises:
            InputError: no such group, or one of triangles or points; the message begins with `user`.
        """
        dim, edges = self.group(name)
        check(dim == 1, f"{user}: the group '{name}' has dimension {dim}; name curves of the mesh.")
        return edges


@check_arguments
def read_mesh(path: str | Path, comm: MPI.Intracomm) -> Mesh:
    """Read a gmsh file (.msh); physical groups keep their names, unnamed ones are called by their number.

    Raises:
        InputError: no such file, or what is wrong with it.
    """

    def read() -> RawMesh:
        check(
            Path(path).is_file(),
            f"There is no mesh file '{path}'; give the path of a gmsh file (.msh).",
        )
        try:
            return read_file(Path(path))
        except BadMesh as error:
            raise InputError(str(error)) from error

    return _distribute_mesh(comm, on_rank_zero(comm, read))


@check_arguments
def gmsh_mesh(build: Callable[[Any], None], comm: MPI.Intracomm) -> Mesh:
    """Mesh what `build(gmsh.model)` makes on rank 0 and distribute it.

    `build` creates geometry and physical groups and calls `model.mesh.generate`.  The cells are the elements of the
    highest dimension; groups of lower dimension (curves, points) become named groups.

    Raises:
        InputError: no elements, elements of several kinds, coordinates that are no numbers, or an error of `build`.
    """
    return _distribute_mesh(comm, on_rank_zero(comm, lambda: _build(build)))


def _build(build: Callable[[Any], None]) -> RawMesh:
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        build(gmsh.model)
        return extract(gmsh.model)
    except InputError:
        raise
    except BadMesh as error:
        raise InputError(str(error)) from error
    except Exception as error:  # on the other ranks nobody would see it
        words = " ".join(str(error).split()) or "no words"
        raise InputError(
            f"The function that builds the mesh raises {type(error).__name__} ({words}); correct it."
        ) from error
    finally:
        gmsh.finalize()


def _distribute_mesh(comm: MPI.Intracomm, raw: RawMesh | None) -> Mesh:
    """The mesh that rank 0 has, on all ranks."""
    about = (raw.kind, raw.order, raw.cells.shape[1], _most_at_a_facet(raw)) if raw else None
    kind, order, width, sheets = comm.bcast(about)
    check(
        sheets <= 2 or SHEETS_MAY_MEET or comm.size == 1,
        f"{sheets} cells of the mesh meet at one edge (or point of a line), and this dolfinx, "
        f"{'.'.join(map(str, VERSION))}, distributes only two to several ranks; use one rank, or dolfinx 0.11.",
    )
    permutation = gmsh_order(kind, width)
    points = raw.points if raw else np.zeros((0, 3))
    cells = raw.cells[:, permutation].copy() if raw else np.zeros((0, width), dtype=np.int64)
    domain = distribute(comm, cells, points, kind, order, sheets)
    groups = {}
    table = (
        [(name, dim, nodes.shape[1]) for name, (dim, nodes) in raw.groups.items()] if raw else None
    )
    for name, dim, nodes_each in comm.bcast(table):
        entities = raw.groups[name][1] if raw else np.zeros((0, nodes_each), dtype=np.int64)
        if dim == domain.topology.dim:
            entities = entities[:, permutation]
        groups[name] = dim, _distribute(domain, dim, entities)
    return Mesh(domain, groups)


def _most_at_a_facet(raw: RawMesh) -> int:
    """The most triangles that share an edge, or lines that share a point."""
    corners = np.sort(raw.cells[:, : 3 if raw.kind == "triangle" else 2], axis=1)
    facets = (
        [corners[:, [i, j]] for i, j in ((0, 1), (0, 2), (1, 2))]
        if raw.kind == "triangle"
        else [corners.T]
    )
    keys = np.vstack(facets).astype(np.int64)
    if raw.kind == "triangle":
        keys = keys[:, 0] * len(raw.points) + keys[:, 1]
    return int(np.unique(keys, return_counts=True)[1].max())


def _distribute(
    domain: dmesh.Mesh, dim: int, entities: npt.NDArray[np.int64]
) -> npt.NDArray[np.int32]:
    """Local entities (owned and ghost) of those that rank 0 lists by their input nodes."""
    domain.topology.create_entities(dim)
    domain.topology.create_connectivity(dim, 0)
    domain.topology.create_connectivity(dim, domain.topology.dim)
    vertices, values = distribute_entity_data(
        domain, dim, entities, np.ones(len(entities), dtype=np.int32)
    )
    tags = dmesh.meshtags_from_entities(domain, dim, adjacencylist(vertices), values)
    return np.asarray(tags.indices, dtype=np.int32)
