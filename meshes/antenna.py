"""The membrane antenna: a square film and two booms on its diagonals, each with its own mesh.

They share no nodes; they are tied by joints at points of the diagonals.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh
from meshes.line import line
from meshes.sheet import sheet

DIAGONALS = ((1.0, 1.0), (-1.0, 1.0))
CORNERS = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))


def film(comm: MPI.Comm, cells: int, side: float) -> Mesh:
    """`cells` × `cells` squares of two triangles on [-side/2, side/2]² in z = 0, diagonals in alternating directions.

    Groups: those of `meshes.sheet`.
    """
    mesh = sheet(comm, cells, cells, side, side, crossed=True)
    mesh.domain.geometry.x[:, :2] -= side / 2
    return mesh


def boom(comm: MPI.Comm, elements: int, side: float, diagonal: tuple[float, float]) -> Mesh:
    """A straight boom of `elements` from corner to corner of the film; groups: those of `meshes.line`."""
    x, y = (side / 2 * c for c in diagonal)
    return line(comm, [(-x, -y, 0), (x, y, 0)], elements)


def tie_points(cells: int, side: float) -> np.ndarray:
    """Where booms and film are tied, (8, 3) [m]: the corners A, B, C, D and the nodes E, F, G, H around the centre.

    With an odd number of cells E to H are the corners of the cell in the middle, with an even number the nodes next to
    the centre on the diagonals; two cells have none but the corners, and the points half-way to them are taken.
    """
    inner = side / (2 * cells) if cells % 2 else side / max(cells, 4)
    radii = np.repeat([side / 2, inner], 4)
    return np.array([(r * x, r * y, 0.0) for r, (x, y) in zip(radii, CORNERS * 2, strict=True)])
