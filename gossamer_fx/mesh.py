"""Meshes from gmsh, with their physical groups by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import mesh as dmesh
from dolfinx.graph import adjacencylist
from dolfinx.io import distribute_entity_data
from mpi4py import MPI

from gossamer_fx.errors import InputError, check, on_rank_zero


@dataclass(frozen=True)
class Mesh:
    """A mesh in space with named groups.

    `groups` maps the name of a gmsh physical group to its dimension and the local entities in it (owned and ghost).
    """

    domain: dmesh.Mesh
    groups: dict[str, tuple[int, npt.NDArray[np.int32]]] = field(default_factory=dict)

    @property
    def comm(self) -> MPI.Intracomm:
        return self.domain.comm

    def group(self, name: str) -> tuple[int, npt.NDArray[np.int32]]:
        """Dimension and local entities of a named group."""
        known = ", ".join(sorted(self.groups)) or "none"
        check(name in self.groups, f"The mesh has no group '{name}'; its groups are: {known}.")
        return self.groups[name]


def read_mesh(path: str | Path, comm: MPI.Intracomm) -> Mesh:
    """Read a gmsh file (.msh); physical groups keep their names, unnamed ones are called by their number."""

    def load(model: Any) -> None:
        import gmsh

        if not Path(path).is_file():
            raise InputError(f"There is no mesh file '{path}'; give the path of a gmsh file (.msh).")
        try:
            gmsh.merge(str(path))
        except Exception as error:
            raise InputError(f"gmsh cannot read '{path}' ({error}); write it again as MSH 4.1.") from error

    return gmsh_mesh(load, comm)


def gmsh_mesh(build: Callable[[Any], None], comm: MPI.Intracomm) -> Mesh:
    """Mesh what `build(gmsh.model)` makes on rank 0 and distribute it.

    `build` creates geometry and physical groups and calls `model.mesh.generate`, or merges a file.  The cells are the
    elements of the highest dimension; groups of lower dimension (curves, points) become named groups.

    Raises:
        InputError: no elements, or elements of several kinds.
    """
    raw = on_rank_zero(comm, lambda: _raw_mesh(build))
    shape = comm.bcast((raw.kind, raw.order, raw.cells.shape[1], list(raw.groups)) if raw else None)
    kind, order, nodes_per_cell, names = shape
    if raw is None:
        raw = _Raw(kind, order, np.zeros((0, 3)), np.zeros((0, nodes_per_cell), dtype=np.int64), {})
    domain = dmesh.create_mesh(
        comm,
        raw.cells,
        raw.points,
        ufl.Mesh(basix.ufl.element("Lagrange", kind, order, shape=(3,))),
        dmesh.create_cell_partitioner(dmesh.GhostMode.shared_facet),
    )
    groups = {}
    for name, dim, width in names_of(comm, raw, names):
        entities = raw.groups[name][1] if comm.rank == 0 else np.zeros((0, width), dtype=np.int64)
        groups[name] = dim, _distribute(domain, dim, entities)
    return Mesh(domain, groups)


@dataclass(frozen=True)
class _Raw:
    kind: str
    order: int
    points: npt.NDArray[np.float64]
    cells: npt.NDArray[np.int64]
    groups: dict[str, tuple[int, npt.NDArray[np.int64]]]


def names_of(comm: MPI.Intracomm, raw: _Raw, names: list[str]) -> list[tuple[str, int, int]]:
    """Name, dimension and nodes per entity of the groups that rank 0 knows."""
    table = [(name, raw.groups[name][0], raw.groups[name][1].shape[1]) for name in names] if comm.rank == 0 else None
    result: list[tuple[str, int, int]] = comm.bcast(table)
    return result


def _distribute(domain: dmesh.Mesh, dim: int, entities: npt.NDArray[np.int64]) -> npt.NDArray[np.int32]:
    """Local entities (owned and ghost) of those that rank 0 lists by their input nodes."""
    domain.topology.create_entities(dim)
    domain.topology.create_connectivity(dim, 0)
    domain.topology.create_connectivity(dim, domain.topology.dim)
    vertices, values = distribute_entity_data(domain, dim, entities, np.ones(len(entities), dtype=np.int32))
    tags = dmesh.meshtags_from_entities(domain, dim, adjacencylist(vertices), values)
    return np.asarray(tags.indices, dtype=np.int32)


_KINDS = {1: ("interval", 1), 8: ("interval", 2), 2: ("triangle", 1), 9: ("triangle", 2)}


def _raw_mesh(build: Callable[[Any], None]) -> _Raw:
    """Nodes, cells and groups of a gmsh model, on one rank."""
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        build(gmsh.model)
        return _extract(gmsh.model)
    finally:
        gmsh.finalize()


def _extract(model: Any) -> _Raw:
    from dolfinx.io.gmshio import cell_perm_array

    tags, coordinates, _ = model.mesh.getNodes()
    number = np.full(int(tags.max(initial=0)) + 1, -1, dtype=np.int64)
    dim = max((d for d, _ in model.getEntities() if model.mesh.getElements(d)[0].size), default=0)
    check(dim in (1, 2), "The mesh has no triangles or line elements; mesh a surface or a curve.")
    kinds = set(model.mesh.getElementTypes(dim))
    names = " and ".join(sorted(model.mesh.getElementProperties(kind)[0] for kind in kinds))
    check(
        len(kinds) == 1 and kinds <= set(_KINDS),
        f"The mesh is made of {names}; use triangles (or line elements) of one order, 1 or 2.",
    )
    kind, order = _KINDS[kinds.pop()]
    tagged = [(d, g) for d, g in model.getPhysicalGroups() if d <= dim]
    surfaces = [s for d, g in tagged if d == dim for s in model.getEntitiesForPhysicalGroup(d, g)]
    surfaces = sorted(set(surfaces)) or [s for _, s in model.getEntities(dim)]
    cells = np.vstack([_elements(model, dim, s) for s in surfaces])
    used = np.unique(cells)
    check(
        len(np.unique(np.sort(cells, axis=1), axis=0)) == len(cells),
        "Two cells of the mesh have the same nodes: where two sheets meet at a corner, choose the triangles so that "
        "each has a node of its own.",
    )
    number[used] = np.arange(len(used))
    points = np.zeros((int(tags.max()) + 1, 3))
    points[tags.astype(np.int64)] = coordinates.reshape(-1, 3)
    permutation = cell_perm_array(dmesh.to_type(kind), cells.shape[1])
    groups = {}
    for d, g in tagged:
        entities = [_elements(model, d, s) for s in model.getEntitiesForPhysicalGroup(d, g)]
        nodes = number[np.vstack(entities)]
        if d == dim:
            nodes = nodes[:, permutation]
        groups[model.getPhysicalName(d, g) or str(g)] = d, nodes[(nodes >= 0).all(axis=1)]
    return _Raw(kind, order, points[used], number[cells][:, permutation].copy(), groups)


def _elements(model: Any, dim: int, entity: int) -> npt.NDArray[np.int64]:
    """Nodes of the elements of one geometric entity, shape (n, nodes per element), gmsh numbers and order."""
    kinds, _, nodes = model.mesh.getElements(dim, entity)
    width = model.mesh.getElementProperties(kinds[0])[3]
    return np.asarray(nodes[0], dtype=np.int64).reshape(-1, width)
