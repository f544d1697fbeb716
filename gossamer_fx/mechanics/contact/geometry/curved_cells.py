"""Cells of order 2 in contact: into how many flat pieces they are cut, and how far they are from
these."""

from __future__ import annotations

import math

import numpy as np
from mpi4py import MPI

from gossamer_fx.core.model.body import MeshBody
from gossamer_fx.mechanics.contact.contract import Array
from gossamer_fx.mechanics.contact.geometry.facets import EDGES_OF_CELLS

# Largest distance of a cell from its n² pieces (n on a line), times n², over the second difference
# |a - 2m + b| of an edge, by the dimension of the cell.  A quadratic map differs from its linear
# interpolant on a piece by 2 Σ λ_i λ_j /n² times the second differences, λ the barycentric
# coordinates in the piece.  λ_i λ_j is at most 1/4 on a line; the sum is at most 1/3 in a triangle.
LARGEST_DISTANCE = {1: 1 / 2, 2: 2 / 3}

# Pieces along an edge at least, by the dimension of the cell.  The number is even, so that each
# node is a corner of pieces; in a triangle two would leave no area to its corners.
LEAST_PIECES = {1: 2, 2: 4}

# Pieces along an edge at most: a cell of 64 pieces takes as long to search as 16 smaller cells.
MOST_PIECES = 8

# Distance of the curved surface from the pieces that contact allows, over the activation distance.
ALLOWED_DISTANCE = 0.25


def has_middle_nodes(body: MeshBody) -> bool:
    """Whether the cells of a body are of order 2, which contact cuts into flat pieces."""
    return bool(body.space.ufl_element().degree == 2)


def least_piece_count(body: MeshBody) -> int:
    """Return into how many pieces the edges of a body's cells are cut at least: 1 for order 1."""
    return LEAST_PIECES[body.space.mesh.topology.dim] if has_middle_nodes(body) else 1


def piece_count(body: MeshBody, activation_distance: float, longest: float) -> int:
    """Return into how many pieces each edge of a body is cut, so that the curved cells are within
    `ALLOWED_DISTANCE` of the pieces in the stress-free shape; collective.  Fewer if an edge would
    have less than `longest` [m] a piece."""
    least = least_piece_count(body)
    if least == 1:
        return least
    X = body.space.tabulate_dof_coordinates()
    difference = second_differences(body, X).max(initial=0.0)
    shortest = _edge_lengths(body, X).min(initial=np.inf)
    bound = LARGEST_DISTANCE[body.space.mesh.topology.dim] * difference
    wanted = math.sqrt(bound / (ALLOWED_DISTANCE * activation_distance))
    wanted = float(body.comm.allreduce(wanted, op=MPI.MAX))
    possible = float(body.comm.allreduce(shortest, op=MPI.MIN)) / longest
    count = min(2 * math.ceil(wanted / 2), MOST_PIECES, 2 * math.floor(possible / 2))
    return max(least, count)


def second_differences(body: MeshBody, positions: Array) -> Array:
    """Return the largest |a - 2m + b| [m] of an edge with ends a, b and middle m of each cell that
    this rank owns (c,); `positions`: of the nodes (n, 3) [m]."""
    ends, middle = _nodes_of_edges(body)
    difference = positions[ends].sum(axis=2) - 2 * positions[middle]
    return np.asarray(np.linalg.norm(difference, axis=2).max(axis=1, initial=0.0))


def largest_distances(body: MeshBody, positions: Array, piece_count: int) -> Array:
    """Return for each node (n,) that this rank knows a bound [m] for the distance of its cells on
    this rank from their pieces; `positions`: of the nodes (n, 3) [m]."""
    topology = body.space.mesh.topology
    cells = body.space.dofmap.list[: topology.index_map(topology.dim).size_local]
    difference = second_differences(body, positions)
    bound = LARGEST_DISTANCE[topology.dim] / piece_count**2 * difference
    of_node = np.zeros(len(positions))
    np.maximum.at(of_node, cells, bound[:, None])
    return of_node


def _edge_lengths(body: MeshBody, positions: Array) -> Array:
    """Return twice the length [m] of the shorter half of each edge of a rank's cells (c, e)."""
    ends, middle = _nodes_of_edges(body)
    halves = positions[ends] - positions[middle][:, :, None]
    return np.asarray(2 * np.linalg.norm(halves, axis=3).min(axis=2))


def _nodes_of_edges(body: MeshBody) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes at the ends (c, e, 2) and in the middle (c, e) of the edges of the cells
    that this rank owns."""
    topology = body.space.mesh.topology
    cells = body.space.dofmap.list[: topology.index_map(topology.dim).size_local]
    dof_count = cells.shape[1]
    edges = np.array(EDGES_OF_CELLS[topology.dim, dof_count])
    return cells[:, edges], cells[:, dof_count - len(edges) :]
