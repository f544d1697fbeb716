"""Cells as straight pieces: they fill the cell, have its orientation, and agree with VTK's order of nodes."""

from __future__ import annotations

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI

from gossamer_fx.mesh.linear_pieces import from_vtk, linear_pieces, middles
from gossamer_fx.meshes.sheet import sheet

CORNERS = np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])


def areas(corners: np.ndarray) -> np.ndarray:
    one = corners[:, 1] - corners[:, 0]
    other = corners[:, 2] - corners[:, 0]
    return (one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]) / 2


@pytest.mark.parametrize("order", [1, 2])
def test_pieces_of_a_triangle_fill_it(order: int) -> None:
    """Each has an equal, positive part of the area: no node is taken for another."""
    nodes = CORNERS if order == 1 else middles(CORNERS)
    pieces = linear_pieces(np.arange(nodes.shape[1])[None], 2)
    measured = areas(nodes[0][pieces])
    assert measured == pytest.approx(0.5 / len(pieces))
    assert len(pieces) == order**2


def test_pieces_of_a_line() -> None:
    measured = linear_pieces(np.array([[4, 5]]), 1).tolist()
    assert measured == [[4, 5]]
    measured = linear_pieces(np.array([[4, 5, 6]]), 1).tolist()
    expected = [[4, 6], [6, 5]]
    assert measured == expected


def test_the_order_of_nodes_is_that_of_dolfinx() -> None:
    """On a film of order 2: nodes on edges lie in the middle of the corners that the table says."""
    space = dolfinx.fem.functionspace(sheet(MPI.COMM_SELF, 2, 2).domain, ("Lagrange", 2, (3,)))
    X = space.tabulate_dof_coordinates()[space.dofmap.list]
    measured = middles(X[:, :3])
    assert measured == pytest.approx(X)
    vtk = dolfinx.plot.vtk_mesh(space)[0].reshape(len(X), 7)[:, 1:]
    assert np.array_equal(from_vtk(vtk), space.dofmap.list)
