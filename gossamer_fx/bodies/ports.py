"""Ports of bodies on a mesh: nodes of named groups, and points between nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from dolfinx import fem, geometry
from mpi4py import MPI

from gossamer_fx.checks.errors import check, check_on_all
from gossamer_fx.mesh.mesh import Mesh
from gossamer_fx.model.body import MeshBody, Port


def local_nodes(space: fem.FunctionSpace, mesh: Mesh, group: str) -> np.ndarray:
    """Local nodes (owned and ghost) of a named group of the mesh."""
    dim, entities = mesh.group(group)
    mesh.domain.topology.create_connectivity(dim, mesh.domain.topology.dim)
    nodes: np.ndarray = fem.locate_dofs_topological(space, dim, entities)
    return nodes


def global_node(body: MeshBody, mesh: Mesh, group: str) -> int:
    """The one node of a named point of the mesh."""
    nodes, index_map = local_nodes(body.space, mesh, group), body.block.index_map
    owned = nodes[nodes < index_map.size_local]
    found = [
        i for part in body.comm.allgather(index_map.local_to_global(owned).tolist()) for i in part
    ]
    check(
        len(found) == 1,
        f"Group '{group}' of '{body.name}' has {len(found)} nodes; a port is one point.",
    )
    return int(found[0])


def interpolated(body: MeshBody, point: Sequence[float], tolerance: float = 1e-6) -> Port:
    """The point of a body at `point` [m] of its mesh: a combination of the nodes of the cell that holds it.

    Raises:
        InputError: the point is further than `tolerance` [m] from the mesh.
    """
    mesh, x = body.space.mesh, np.asarray(point, dtype=float)
    tdim = mesh.topology.dim
    cells = np.arange(mesh.topology.index_map(tdim).size_local, dtype=np.int32)
    distance, cell = np.inf, -1
    check_on_all(
        body.comm,
        x.shape == (3,),
        f"A port of '{body.name}' is at {list(point)!r}; give three coordinates.",
    )
    if len(cells):
        tree = geometry.bb_tree(mesh, tdim, entities=cells)
        middle = geometry.create_midpoint_tree(mesh, tdim, cells)
        cell = int(geometry.compute_closest_entity(tree, middle, mesh, x)[0])
        here: Any = np.array([cell], dtype=np.int32)  # dolfinx says list and means array
        distance = float(np.sqrt(geometry.squared_distance(mesh, tdim, here, x)[0]))
    nearest, rank = body.comm.allreduce((distance, body.comm.rank), op=MPI.MIN)
    check(
        nearest <= tolerance,
        f"The point {x.tolist()} m is {nearest:.3g} m away from '{body.name}'; give a point of its mesh.",
    )
    nodes, weights = body.comm.bcast(
        _weights(body, cell, x) if body.comm.rank == rank else None, root=rank
    )
    return Port(body, nodes, weights=weights)


def _weights(body: MeshBody, cell: int, x: np.ndarray) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Global nodes of a cell and their shape functions at a point; those that vanish are left out."""
    space: Any = body.space
    mesh = space.mesh
    corners = mesh.geometry.x[mesh.geometry.dofmap[cell]]
    reference = mesh.geometry.cmap.pull_back(x[None], corners)
    values = space.element.basix_element.tabulate(0, reference)[0, 0, :, 0]
    nodes = body.block.index_map.local_to_global(space.dofmap.cell_dofs(cell))
    kept = np.abs(values) > 1e-12
    return tuple(int(n) for n in nodes[kept]), tuple(float(w) for w in values[kept])
