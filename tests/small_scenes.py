"""The film and the gas of most small scenes."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.arrays import mesh_of_arrays

MATERIAL = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
WRINKLING = gx.Miyazaki(**MATERIAL)
LINEAR = gx.Linear(**MATERIAL)
AIR = gx.IdealGas(gamma=1.4, R=287.0)


def three_sheets() -> gx.Mesh:
    """Three triangles at one edge, the "seam", on each rank: dolfinx 0.9 cannot distribute them."""
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)], dtype=float)
    triangles = np.array([(0, 1, 2), (0, 1, 3), (0, 1, 4)])
    return mesh_of_arrays(MPI.COMM_SELF, lambda: (points, triangles, {"seam": np.array([[0, 1]])}))
