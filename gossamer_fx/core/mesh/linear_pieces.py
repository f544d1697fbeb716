"""Cells of order 1 and 2 as straight lines and triangles between their nodes, for pictures,
sections and contact."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Integers = npt.NDArray[np.int64]

# Node numbers of the pieces, by the dimension of the cell and its number of nodes.  The order of
# nodes is that of dolfinx: the corners, then on a line the middle, and in a triangle the middles of
# the edges opposite corner 0, 1, 2. All triangles have the orientation of their cell.
_CORNERS_AND_CENTRE = (
    (0, 5, 4),
    (5, 1, 3),
    (4, 3, 2),
    (3, 4, 5),
)
_PIECES = {
    (1, 2): ((0, 1),),
    (1, 3): ((0, 2), (2, 1)),
    (2, 3): ((0, 1, 2),),
    (2, 6): _CORNERS_AND_CENTRE,
}
# Position in VTK's order of each node of a quadratic triangle in that of dolfinx, and the reverse.
# VTK has the middles of the edges 01, 12, 20; other cells have one order in both.
_FROM_VTK = (0, 1, 2, 4, 5, 3)
_TO_VTK = (0, 1, 2, 5, 3, 4)


def linear_pieces(cells: npt.NDArray[np.integer], dimension: int) -> Integers:
    """Cut cells of order 1 or 2, with nodes (n, k) in the order of dolfinx, into straight pieces
    between their nodes (m, dimension + 1); those of one cell follow each other.  E.g. the line [[7,
    8, 9]] becomes [[7, 9], [9, 8]]."""
    nodes_of_cell = cells.shape[1]
    pieces = np.array(_PIECES[dimension, nodes_of_cell])
    nodes = cells[:, pieces]
    return nodes.reshape(-1, dimension + 1).astype(np.int64)


def from_vtk(cells: npt.NDArray[np.integer]) -> Integers:
    """Cells (n, k) whose nodes are in VTK's order, with the nodes in the order of dolfinx."""
    if cells.shape[1] == len(_FROM_VTK):
        cells = cells[:, _FROM_VTK]
    return cells.astype(np.int64)


def to_vtk(cells: npt.NDArray[np.integer]) -> Integers:
    """Cells (n, k) whose nodes are in the order of dolfinx, with the nodes in VTK's order."""
    if cells.shape[1] == len(_TO_VTK):
        cells = cells[:, _TO_VTK]
    return cells.astype(np.int64)


def middles(corners: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    """Values (n, 6, ...) at the nodes of quadratic triangles, in the order of dolfinx (corners,
    then middles of the edges opposite to them), from linear ones (n, 3, ...) at their corners."""
    # Values at the three corners a, b, c
    a = corners[:, 0]
    b = corners[:, 1]
    c = corners[:, 2]
    # In the order of dolfinx: the middle of an edge has the position of the opposite corner.
    opposite_a = (b + c) / 2
    opposite_b = (c + a) / 2
    opposite_c = (a + b) / 2
    nodes = [a, b, c, opposite_a, opposite_b, opposite_c]
    return np.stack(nodes, axis=1)
