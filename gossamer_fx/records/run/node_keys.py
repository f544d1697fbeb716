"""Names of nodes that are the same on any number of ranks, for checkpoints.

Problem.  The order of nodes, and the rank that has them, depend on the partition of the mesh.

Idea.  A node of a Lagrange space is named after the vertices of the entity (vertex, edge or cell)
on which it is, by their indices in the mesh as it was read.  A multiplier is named after the first
node that its constraint ties, and by the number of constraints before it that tie the same node.  A
name is a hash of these indices with 64 bits.

Limits.  Spaces with one node at most on an edge or cell, that is up to order 2.
"""

from __future__ import annotations

import basix
import numpy as np
import numpy.typing as npt

from gossamer_fx.core.algebra.rank_exchange import Names, hash_rows
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.model.body import Attached, Body, MeshBody, Port, has_nodal_unknowns
from gossamer_fx.solve.system.system import System

# An entity of triangles has at most this many vertices; fewer are repeated, to give rows of one
# length.
MAX_VERTICES = 3


def node_names(body: Body) -> Names:
    """Names (n,) of the n nodes of a body that this rank owns: integers of 64 bits.

    A name is the same on any number of ranks: it is a hash of the vertices of the vertex, edge or
    cell on which the node is.
    """
    start, end = body.block.index_map.local_range
    if not has_nodal_unknowns(body):
        # Masses and reduced films have no mesh; their blocks are numbered in the same way
        # everywhere.
        return hash_rows(np.arange(start, end)[:, None])
    layout = body.space.dofmap.dof_layout
    nodes = body.space.dofmap.list
    index_map = body.block.index_map
    node_count = index_map.size_local + index_map.num_ghosts
    entity_of_node = np.zeros((node_count, MAX_VERTICES), dtype=np.int64)
    vertices = cell_vertices(body)
    cell_type = basix.CellType[body.space.mesh.topology.cell_name()]
    for dim, entities in enumerate(basix.topology(cell_type)):
        for i, corners in enumerate(entities):
            nodes_here = layout.entity_dofs(dim, i)
            if not nodes_here:
                continue
            # Two nodes of an edge could not be told apart by its vertices.
            check(
                len(nodes_here) == 1,
                f"'{body.name}' has {len(nodes_here)} nodes on one edge or cell; checkpoints know "
                "one.",
            )
            # Sorted, as neighbouring cells have the vertices of an edge in different orders.
            vertices_of_entity = np.sort(vertices[:, corners], axis=1)
            missing = MAX_VERTICES - len(corners)
            rows = np.pad(vertices_of_entity, ((0, 0), (0, missing)), mode="edge")
            entity_of_node[nodes[:, nodes_here[0]]] = rows
    owned = entity_of_node[: end - start]
    return hash_rows(owned)


def cell_vertices(body: MeshBody) -> npt.NDArray[np.int64]:
    """Vertices (cells, k) of this rank's cells, own and ghost, by their indices in the mesh as it
    was read."""
    geometry = body.space.mesh.geometry
    # The first points of a cell are its corners, also if the geometry is of order 2.
    corner_count = body.space.mesh.topology.dim + 1
    corners = geometry.dofmap[:, :corner_count]
    vertices: npt.NDArray[np.int64] = geometry.input_global_indices[corners]
    return vertices


def cell_names(body: MeshBody) -> Names:
    """Names (n,) of the n cells that this rank owns."""
    topology = body.space.mesh.topology
    own_count = topology.index_map(topology.dim).size_local
    return hash_rows(np.sort(cell_vertices(body)[:own_count], axis=1))


def mesh_name(body: MeshBody) -> int:
    """A number that depends on the cells of a mesh and not on their order; the same on every
    rank."""
    hashes = cell_names(body)
    # A sum does not depend on the order, nor on the partition.
    sum_of_rank = int(hashes.sum(dtype=np.uint64))
    total = sum(body.comm.allgather(sum_of_rank))
    return total % 2**64


def all_names(system: System) -> list[Names]:
    """Names of this rank's nodes of every block: bodies, then the multipliers of each constraint.

    Returns:
        an array (n,) of integers of 64 bits for each block, the same on any number of ranks.
    """
    names = [node_names(body) for body in system.bodies]
    tied_ports: list[list[tuple[Attached, ...]]] = []
    if system.constraints:
        tied_ports = system.constraints.tied_ports()
    multiplier_blocks = system.numbering.blocks[len(names) :]
    for ports, block in zip(tied_ports, multiplier_blocks, strict=True):
        # A single multiplier needs no name; it may tie the ground only, which has no node.
        if block.index_map.size_global == 1:
            names.append(hash_rows(np.zeros((len(ports), 1))))
        else:
            names.append(_names_of_multipliers(system, names, ports))
    return names


def _names_of_multipliers(
    system: System,
    names: list[Names],
    constraints: list[tuple[Attached, ...]],
) -> Names:
    """Names of Lagrange multipliers (m,), each after the first node that its constraint ties."""
    rows = []
    counts: dict[tuple[int, int], int] = {}  # constraints so far by their first node
    for ports in constraints:
        port = next(port for port in ports if isinstance(port, Port))
        k = system.bodies.index(port.body)
        first_owned = port.body.block.index_map.local_range[0]
        name = names[k][port.nodes[0] - first_owned]
        # Names have 64 bits without sign, rows of integers have 63 and a sign.
        node = (k, int(name >> np.uint64(1)))
        count = counts.get(node, 0)
        counts[node] = count + 1
        rows.append((*node, count))
    return hash_rows(np.array(rows, dtype=np.int64).reshape(-1, 3))
