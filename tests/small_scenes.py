"""The film and the gas of most small scenes, and scenes that are brought to rest or moved."""

from __future__ import annotations

from typing import Any

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


def at_rest(*items: Any, search: gx.analysis.Continuation | None = None) -> gx.Equilibrium:
    """The equilibrium of a scene of these items."""
    equilibrium = gx.Equilibrium(gx.Scene(*items), search or gx.analysis.Continuation())
    equilibrium.find()
    return equilibrium


def run_until(until: float, *items: Any, dt: float, **options: Any) -> gx.Simulation:
    """The run of a scene of these items to a time [s], by the midpoint rule with steps of dt [s].

    Args:
        options: further arguments of the simulation.
    """
    run = gx.Simulation(gx.Scene(*items), gx.Midpoint(dt=dt), **options)
    run.run(until=until)
    return run
