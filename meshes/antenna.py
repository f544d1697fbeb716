"""The membrane antenna: a square film and two booms on its diagonals, each with its own mesh.

They share no nodes; they are tied by joints at points of the diagonals: the corners A, B, C, D, and the corners E, F,
G, H of the middle ninth of the film, which is the cell around the centre of a film of 3 × 3 cells.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh

from .line import line

DIAGONALS = ((1.0, 1.0), (-1.0, 1.0))
CORNERS = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))


def film(comm: MPI.Intracomm, cells: int, side: float) -> Mesh:
    """`cells` × `cells` squares on [-side/2, side/2]² in z = 0, each of four triangles around its centre.

    So the mesh has the film's symmetries, and its edges lie along both diagonals, where it folds.  From 3 cells on it
    has nodes at E to H: two outer thirds of a side hold the same number of cells, the middle third the others.

    Group: "film".
    """

    def build(model: Any) -> None:
        ticks = _ticks(cells, side)
        centres = (ticks[1:] + ticks[:-1]) / 2
        grid_nodes = _square_grid(ticks)
        centre_nodes = _square_grid(centres)
        plane = np.vstack([grid_nodes, centre_nodes])
        points = np.column_stack([plane, np.zeros(len(plane))])

        # Grid node (i, j) has the number i (cells + 1) + j; the centres of the squares follow.
        i, j = _square_grid(np.arange(cells)).T
        row = cells + 1
        first = i * row + j
        corners = np.array([first, first + row, first + row + 1, first + 1])
        centre = row**2 + i * cells + j
        triangles = np.array([[corners[k], corners[(k + 1) % 4], centre] for k in range(4)])
        # One triangle a row: (side of the square, corner of the triangle, square) is turned round.
        triangles = triangles.transpose(0, 2, 1)

        surface = model.addDiscreteEntity(2)
        model.mesh.addNodes(2, surface, [], points.ravel())
        # gmsh counts from 1.
        model.mesh.addElementsByType(surface, 2, [], triangles.ravel() + 1)
        model.addPhysicalGroup(2, [surface], name="film")

    return gmsh_mesh(build, comm)


def _ticks(cells: int, side: float) -> np.ndarray:
    """Coordinates (cells + 1,) [m] of the grid lines about 0, two of them at the thirds of the side."""
    even = np.arange(cells + 1) / cells
    # With one or two cells no line is near a third, and the grid stays even.
    if cells > 2:
        outer = round(cells / 3) / cells
        even = np.interp(even, [0, outer, 1 - outer, 1], [0, 1 / 3, 2 / 3, 1])
    return side * (even - 0.5)


def _square_grid(ticks: np.ndarray) -> np.ndarray:
    """All pairs (n², 2) of n numbers, the second one fastest."""
    x, y = np.meshgrid(ticks, ticks, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel()])


def boom(comm: MPI.Intracomm, elements: int, side: float, diagonal: tuple[float, float]) -> Mesh:
    """A straight boom of `elements` from corner to corner of the film; groups: those of `meshes.line`."""
    x, y = (side / 2 * c for c in diagonal)
    return line(comm, [(-x, -y, 0), (x, y, 0)], elements)


def tie_points(side: float) -> np.ndarray:
    """Where booms and film are tied, (8, 3) [m]: A to D, then E to H."""
    corners = np.column_stack([CORNERS, np.zeros(4)])
    return np.vstack([side / 2 * corners, side / 6 * corners])
