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
        outer = round(cells / 3) / cells if cells > 2 else 0.5
        lines = side * (np.interp(np.arange(cells + 1) / cells, *_thirds(outer)) - 0.5)
        centres = (lines[1:] + lines[:-1]) / 2
        xy = np.vstack(
            [np.array(np.meshgrid(s, s, indexing="ij")).reshape(2, -1).T for s in (lines, centres)]
        )
        i, j = (k.ravel() for k in np.meshgrid(*[np.arange(cells)] * 2, indexing="ij"))
        corners = np.array(
            [(i + a) * (cells + 1) + j + b for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
        )
        centre = (cells + 1) ** 2 + i * cells + j
        triangles = np.array([[corners[k], corners[(k + 1) % 4], centre] for k in range(4)])
        surface = model.addDiscreteEntity(2)
        model.mesh.addNodes(2, surface, [], np.pad(xy, ((0, 0), (0, 1))).ravel())
        model.mesh.addElementsByType(surface, 2, [], triangles.transpose(0, 2, 1).ravel() + 1)
        model.addPhysicalGroup(2, [surface], name="film")

    return gmsh_mesh(build, comm)


def _thirds(outer: float) -> tuple[list[float], list[float]]:
    """Stretches [0, 1] such that `outer` and 1 - `outer` come to the thirds."""
    if outer == 0.5:
        return [0, 1], [0, 1]
    return [0, outer, 1 - outer, 1], [0, 1 / 3, 2 / 3, 1]


def boom(comm: MPI.Intracomm, elements: int, side: float, diagonal: tuple[float, float]) -> Mesh:
    """A straight boom of `elements` from corner to corner of the film; groups: those of `meshes.line`."""
    x, y = (side / 2 * c for c in diagonal)
    return line(comm, [(-x, -y, 0), (x, y, 0)], elements)


def tie_points(side: float) -> np.ndarray:
    """Where booms and film are tied, (8, 3) [m]: A to D, then E to H."""
    radii = np.repeat([side / 2, side / 6], 4)
    return np.array([(r * x, r * y, 0.0) for r, (x, y) in zip(radii, CORNERS * 2, strict=True)])
