"""Cells as straight pieces: they fill the cell, have its orientation, and agree with VTK's order of
nodes."""

from __future__ import annotations

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI

from gossamer_fx.core.mesh.linear_pieces import from_vtk, linear_pieces, middles
from gossamer_fx.meshes.sheet import sheet

CORNERS = np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])


def areas(corners: np.ndarray) -> np.ndarray:
    """Signed areas (n,) [m²] of triangles (n, 3, 2), positive for counterclockwise corners."""
    one_x, one_y = (corners[:, 1] - corners[:, 0]).T
    other_x, other_y = (corners[:, 2] - corners[:, 0]).T
    return (one_x * other_y - one_y * other_x) / 2


@pytest.mark.parametrize("order", [1, 2])
def test_pieces_of_a_triangle_fill_it(order: int) -> None:
    """Each has an equal, positive part of the area: no node is taken for another."""
    nodes = CORNERS
    if order == 2:
        nodes = middles(CORNERS)
    numbers = np.arange(nodes.shape[1])
    pieces = linear_pieces(numbers[None], 2)
    # The area of the triangle is 0.5.
    assert areas(nodes[0][pieces]) == pytest.approx(0.5 / len(pieces))
    assert len(pieces) == order**2


def test_pieces_of_a_line() -> None:
    order_one = np.array([[4, 5]])
    assert linear_pieces(order_one, 1).tolist() == [[4, 5]]
    order_two = np.array([[4, 5, 6]])
    # The node in the middle is the last one of a line of order 2.
    assert linear_pieces(order_two, 1).tolist() == [[4, 6], [6, 5]]


def test_the_order_of_nodes_is_that_of_dolfinx() -> None:
    """On a film of order 2: nodes on edges lie in the middle of the corners that the table says."""
    domain = sheet(MPI.COMM_SELF, 2, 2).domain
    space = dolfinx.fem.functionspace(domain, ("Lagrange", 2, (3,)))
    cells = space.dofmap.list
    X = space.tabulate_dof_coordinates()[cells]
    assert middles(X[:, :3]) == pytest.approx(X)
    # VTK writes the number of nodes before the six nodes of each cell.
    rows = dolfinx.plot.vtk_mesh(space)[0].reshape(len(X), 7)
    vtk = rows[:, 1:]
    assert np.array_equal(from_vtk(vtk), cells)
