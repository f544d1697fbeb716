"""A flat strip of two panels with a crease between them."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh
from gossamer_fx.extend import check_arguments

from .arrays import (
    Cells,
    Groups,
    Length,
    Numbers,
    Points,
    cell_corners,
    check_cells,
    mesh_of_arrays,
    plane_grid,
    polyline,
    triangles_of,
)


@check_arguments
def creased_strip(comm: MPI.Intracomm, nx: Cells, ny: Cells, length: Length, width: Length) -> Mesh:
    """Make a flat strip of two panels, [-length, 0] and [0, length] by [0, width], with a crease
    between.

    Groups: "film"; the edges "left", "right"; "crease", at x = 0.  Collective.

    Args:
        nx, ny: cells of two triangles along and across each panel.
        length: of each panel [m].
        width: of the strip [m].

    Raises:
        InputError: a length is not positive, or there are no cells.
    """
    check_cells("creased_strip", 4 * nx * ny)

    def arrays() -> tuple[Points, Numbers, Groups]:
        # 2 nx cells, so that the crease is a line of nodes.
        along = np.linspace(-length, length, 2 * nx + 1)
        across = np.linspace(0, width, ny + 1)
        points = plane_grid(along, across)

        nodes = np.arange(len(points)).reshape(ny + 1, 2 * nx + 1)
        # All diagonals run the same way, from the first to the third corner.
        corners = cell_corners(nodes)
        triangles = np.concatenate(
            [
                triangles_of(corners.a, corners.b, corners.c),
                triangles_of(corners.a, corners.c, corners.d),
            ]
        )
        # With an even number of columns of cells the middle line of nodes is the crease.
        groups = {
            "left": polyline(nodes[:, 0]),
            "crease": polyline(nodes[:, nx]),
            "right": polyline(nodes[:, -1]),
        }
        return points, triangles, groups

    return mesh_of_arrays(comm, arrays)
