"""A closed sphere."""

from __future__ import annotations

import math
from typing import Any

from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh


def sphere(
    comm: MPI.Intracomm,
    radius: float,
    cells: int,
    order: int = 1,
) -> Mesh:
    """A sphere about the origin with about `cells` edges of triangles on its equator; normals point outwards.

    order: of the geometry, 1 (plane triangles between points of the sphere) or 2 (curved ones).

    Groups: "film".
    """

    def build(model: Any) -> None:
        import gmsh

        model.occ.addSphere(0, 0, 0, radius)
        model.occ.synchronize()
        model.addPhysicalGroup(2, [tag for _, tag in model.getEntities(2)], name="film")
        for option, value in (
            ("MeshSizeMin", 1.0),
            ("MeshSizeMax", 1.0),
            ("MeshSizeExtendFromBoundary", 0),
        ):
            gmsh.option.setNumber(
                f"Mesh.{option}", value * 2 * math.pi * radius / cells if value else 0
            )
        model.mesh.generate(2)
        model.mesh.setOrder(order)

    return gmsh_mesh(build, comm)
