"""Ports of bodies on a mesh: nodes of named groups, and points between nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from dolfinx import fem, geometry
from mpi4py import MPI

from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import MeshBody, Port

# Shape functions below this value count as zero: a point on an edge of a cell depends on the nodes
# of that edge only, and then on fewer unknowns.
ZERO_WEIGHT = 1e-12


def local_nodes(space: fem.FunctionSpace, mesh: Mesh, group: str) -> np.ndarray:
    """Local nodes (owned and ghost) of a named group of the mesh."""
    dim, entities = mesh.group(group)
    mesh.domain.topology.create_connectivity(dim, mesh.domain.topology.dim)
    nodes: np.ndarray = fem.locate_dofs_topological(space, dim, entities)
    return nodes


def global_node(body: MeshBody, mesh: Mesh, group: str) -> int:
    """Global number of the one node of a named point of the mesh.  Collective.

    Args:
        body: on whose nodes the number is.
        mesh: of the body.
        group: name of a group that consists of one point.

    Raises:
        InputError: the mesh has no such group, or the group has no node, or several.
    """
    nodes = local_nodes(body.space, mesh, group)
    index_map = body.block.index_map
    # Each node is counted once, by its owner.
    owned = nodes[nodes < index_map.size_local]
    mine = index_map.local_to_global(owned).tolist()
    found = []
    for part in body.comm.allgather(mine):
        found += part
    check(
        len(found) == 1,
        f"Group '{group}' of '{body.name}' has {len(found)} nodes; a port is one point.",
    )
    return int(found[0])


def interpolated(body: MeshBody, point: Sequence[float], tolerance: float = 1e-6) -> Port:
    """The point of a body at given coordinates of its mesh, also between nodes.  Collective.

    Args:
        body: on a mesh of triangles or lines.
        point: coordinates (3,) [m] in the stress-free shape, the same on all ranks.
        tolerance: largest distance [m] of the point from the mesh.

    Returns:
        A port: the weighted sum of the nodes of the cell around the point.

    Raises:
        InputError: the point has not three coordinates, or is further than `tolerance` from the
            mesh.
    """
    mesh = body.space.mesh
    x = np.asarray(point, dtype=float)
    tdim = mesh.topology.dim
    cells = np.arange(mesh.topology.index_map(tdim).size_local, dtype=np.int32)
    check_on_all(
        body.comm,
        x.shape == (3,),
        f"A port of '{body.name}' is at {list(point)!r}; give three coordinates.",
    )
    # A rank without cells is infinitely far away.
    distance = np.inf
    cell = -1
    if len(cells):
        tree = geometry.bb_tree(mesh, tdim, entities=cells)
        middle = geometry.create_midpoint_tree(mesh, tdim, cells)
        cell = int(geometry.compute_closest_entity(tree, middle, mesh, x)[0])
        # The annotation of dolfinx is a list, but the function needs an array.
        cell_array: Any = np.array([cell], dtype=np.int32)
        squared_distance = geometry.squared_distance(mesh, tdim, cell_array, x)[0]
        distance = float(np.sqrt(squared_distance))
    # Of ranks at the same distance, the lowest one: a point between two ranks belongs to one of
    # them.
    nearest, rank = body.comm.allreduce((distance, body.comm.rank), op=MPI.MIN)
    check(
        nearest <= tolerance,
        f"The point {x.tolist()} m is {nearest:.3g} m away from '{body.name}'; give a point of its "
        "mesh.",
    )
    found = None
    if body.comm.rank == rank:
        found = _weights(body, cell, x)
    nodes, weights = body.comm.bcast(found, root=rank)
    return Port(body, nodes, weights=weights)


def _weights(body: MeshBody, cell: int, x: np.ndarray) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Nodes of a cell and their weights in the interpolation of a point.

    Args:
        x: point (3,) [m] in the cell.

    Returns:
        Global nodes and values of their shape functions at x, dimensionless, as tuples of the same
        length; without those whose value is below `ZERO_WEIGHT`.
    """
    space: Any = body.space
    mesh = space.mesh
    corners = mesh.geometry.x[mesh.geometry.dofmap[cell]]
    reference = mesh.geometry.cmap.pull_back(x[None], corners)
    values = space.element.basix_element.tabulate(0, reference)[0, 0, :, 0]
    nodes = body.block.index_map.local_to_global(space.dofmap.cell_dofs(cell))
    is_kept = np.abs(values) > ZERO_WEIGHT
    kept_nodes = tuple(int(node) for node in nodes[is_kept])
    weights = tuple(float(value) for value in values[is_kept])
    return kept_nodes, weights
