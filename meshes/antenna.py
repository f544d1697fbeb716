"""The membrane antenna: a square film and two booms on its diagonals, each with its own mesh.

They share no nodes; they are tied by joints at points of the diagonals: the corners A, B, C, D, and
the corners E, F, G, H of the middle ninth of the film, which is the cell around the centre of a
film of 3 × 3 cells.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh
from gossamer_fx.extend import check_arguments

from .arrays import (
    CellCorners,
    Cells,
    Groups,
    Length,
    Numbers,
    Points,
    around_centres,
    check_cells,
    mesh_of_arrays,
)
from .line import line

DIAGONALS = ((1.0, 1.0), (-1.0, 1.0))
CORNERS = (
    (1.0, 1.0),
    (-1.0, 1.0),
    (-1.0, -1.0),
    (1.0, -1.0),
)


@check_arguments
def film(comm: MPI.Intracomm, cells: Cells, side: Length) -> Mesh:
    """Make the square film [-side/2, side/2]² in z = 0 of squares of four triangles around a
    centre.

    So the mesh has the film's symmetries, and its edges lie along both diagonals, where it folds.
    From 3 cells on it has nodes at E to H: two outer thirds of a side hold the same number of
    cells, the middle third the others.  Group: "film".  Collective.

    Args:
        cells: squares along a side.
        side: length of the sides [m].

    Raises:
        InputError: there are no cells, or the side is not positive.
    """
    check_cells("film", 4 * cells**2)

    def arrays() -> tuple[Points, Numbers, Groups]:
        ticks = _ticks(cells, side)
        centres = (ticks[1:] + ticks[:-1]) / 2
        grid_nodes = _square_grid(ticks)
        centre_nodes = _square_grid(centres)
        plane = np.vstack([grid_nodes, centre_nodes])
        points = np.column_stack([plane, np.zeros(len(plane))])

        # Grid node (i, j) has the number i (cells + 1) + j; the centres of the squares follow.
        row = cells + 1
        grid = np.arange(row**2).reshape(row, row)
        centre = row**2 + np.arange(cells**2).reshape(cells, cells)
        # The first index runs along x, so that the second corner is a row further.
        corners = CellCorners(
            grid[:-1, :-1],
            grid[1:, :-1],
            grid[1:, 1:],
            grid[:-1, 1:],
        )
        return points, around_centres(corners, centre), {}

    return mesh_of_arrays(comm, arrays)


def _ticks(cells: int, side: float) -> np.ndarray:
    """Coordinates (cells + 1,) [m] of the grid lines along a side [m], about 0, ascending; from 3
    cells on two of the lines are at the thirds of the side."""
    even = np.arange(cells + 1) / cells
    # With one or two cells no line is near a third, and the grid stays even.
    if cells > 2:
        outer = round(cells / 3) / cells
        even = np.interp(
            even,
            [0, outer, 1 - outer, 1],
            [0, 1 / 3, 2 / 3, 1],
        )
    return side * (even - 0.5)


def _square_grid(ticks: np.ndarray) -> np.ndarray:
    """All pairs (n², 2) of n numbers, those with the same first number one after the other."""
    slow = np.repeat(ticks, len(ticks))
    fast = np.tile(ticks, len(ticks))
    return np.column_stack([slow, fast])


@check_arguments
def boom(comm: MPI.Intracomm, elements: Cells, side: Length, diagonal: tuple[float, float]) -> Mesh:
    """Make a straight boom of line elements from corner to corner of the film.

    Groups: "line", the points "start" and "end", and both as "point 0" and "point 1".  Collective.

    Args:
        elements: their number, at least 1.
        side: length of the sides of the film [m].
        diagonal: x and y of the end, over half of the side: one of `DIAGONALS`.

    Raises:
        InputError: there are no elements, or the side is not positive.
    """
    check_cells("boom", elements)
    # The booms cross in the middle of the film, which is the origin.
    x = side / 2 * diagonal[0]
    y = side / 2 * diagonal[1]
    return line(
        comm,
        [(-x, -y, 0), (x, y, 0)],
        elements,
    )


def tie_points(side: float) -> np.ndarray:
    """Where booms and film are tied, (8, 3) [m]: A to D, then E to H."""
    corners = np.column_stack([CORNERS, np.zeros(4)])
    return np.vstack([side / 2 * corners, side / 6 * corners])
