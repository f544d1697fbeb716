"""A closed sphere."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh
from gossamer_fx.extend import Range, check_arguments

from .arrays import Length, Order, check_cells

# gmsh makes no sphere of fewer.
MIN_CELLS = 4

# Radii [m] that gmsh makes as they are; others are made with 1 m and scaled.
SMALLEST = 1e-2
LARGEST = 1e2


@check_arguments
def sphere(
    comm: MPI.Intracomm, radius: Length, cells: Annotated[int, Range(MIN_CELLS)], order: Order = 1
) -> Mesh:
    """Make a closed sphere about the origin; normals point outwards.  Group: "film".  Collective.

    Args:
        radius: [m].
        cells: edges of triangles on the equator, about; at least 4.
        order: of the geometry, 1 (plane triangles between points of the sphere) or 2 (curved ones).

    Raises:
        InputError: the radius is not positive, there are fewer cells, or the order is another one.
    """
    check_cells("sphere", cells**2)
    # gmsh's tolerances are lengths: a sphere of 1e6 m had five nodes, and one of 1e-5 m other
    # triangles than one of 1 m.
    made = radius if SMALLEST <= radius <= LARGEST else 1.0

    def build(model: Any) -> None:
        import gmsh

        model.occ.addSphere(0, 0, 0, made)
        model.occ.synchronize()
        surfaces = [tag for _, tag in model.getEntities(2)]
        model.addPhysicalGroup(2, surfaces, name="film")

        # Triangles of one size, the length of an edge on the equator.
        size = 2 * math.pi * made / cells
        gmsh.option.setNumber("Mesh.MeshSizeMin", size)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        # One size everywhere: none that spreads from the seam, which gmsh has from pole to pole.
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
        model.mesh.generate(2)
        model.mesh.setOrder(order)
        if made != radius:
            factors = np.eye(3, 4) * radius / made
            model.mesh.affineTransform(factors.ravel().tolist())

    return gmsh_mesh(build, comm)
