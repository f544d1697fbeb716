"""How far cells of order 2 are from the straight pieces as which they touch."""

from __future__ import annotations

import numpy as np

from gossamer_fx.core.model.body import MeshBody
from gossamer_fx.mechanics.contact.contract import Array
from gossamer_fx.mechanics.contact.geometry.collision_mesh import CollisionMesh
from gossamer_fx.mechanics.contact.geometry.facets import EDGES_OF_CELLS

# Largest distance of a cell from its pieces over the second difference |a - 2m + b| of an edge, by
# the dimension of the cell.  A piece has half the length of the cell, and a quadratic map differs
# from its linear interpolant by half of the sum over the edges of λ_i λ_j times the second
# difference.  λ_i λ_j is at most 1/4 on a line; the sum is at most 1/3 in a triangle.
LARGEST_DISTANCE = {1: 1 / 8, 2: 1 / 6}


def has_middle_nodes(body: MeshBody) -> bool:
    """Whether the cells of a body are of order 2, which contact cuts into straight pieces."""
    return bool(body.space.ufl_element().degree == 2)


def distances_from_pieces(mesh: CollisionMesh, x: Array) -> Array:
    """Return a bound (m,) [m] for the distance of the cells round each point of a contact from the
    straight pieces as which they touch; collective.  It is zero for cells of order 1, points of
    obstacles, and flat cells whose middle nodes are in the middle.  `x`: points (m, 3) [m]."""
    count = mesh.points.body_count
    bounds = np.zeros(mesh.points.count)
    for number, body in enumerate(mesh.bodies):
        if not has_middle_nodes(body):
            continue
        of_body = np.flatnonzero(mesh.body[:count] == number)
        index_map = body.block.index_map
        local = index_map.global_to_local(mesh.nodes[of_body])
        # Points of other ranks' cells, which were imported, are not among the nodes of this rank.
        is_local = local >= 0
        positions = np.zeros((index_map.size_local + index_map.num_ghosts, 3))
        positions[local[is_local]] = x[of_body[is_local]]
        bound_of_node = _bounds_of_nodes(body, positions)
        bounds[of_body[is_local]] = bound_of_node[local[is_local]]
    # The least of the negative: the largest of all ranks that have a cell at the point.
    negative = -bounds
    mesh.take_minimum(negative)
    return -negative


def _bounds_of_nodes(body: MeshBody, positions: Array) -> Array:
    """Return for each node (n,) of this rank the largest bound [m] of its cells on this rank;
    `positions`: of the nodes (n, 3) [m]."""
    topology = body.space.mesh.topology
    cells = body.space.dofmap.list[: topology.index_map(topology.dim).size_local]
    dof_count = cells.shape[1]
    edges = np.array(EDGES_OF_CELLS[topology.dim, dof_count])
    middle = positions[cells[:, dof_count - len(edges) :]]
    ends = positions[cells[:, edges]]
    second_difference = np.linalg.norm(ends.sum(axis=2) - 2 * middle, axis=2)
    bound = LARGEST_DISTANCE[topology.dim] * second_difference.max(axis=1, initial=0.0)
    of_node = np.zeros(len(positions))
    np.maximum.at(of_node, cells, bound[:, None])
    return of_node
