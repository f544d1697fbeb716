"""A square airbag: two flat sheets that share their four edges."""

from __future__ import annotations

from typing import Any

from mpi4py import MPI

from gossamer_fx import Mesh, gmsh_mesh
from gossamer_fx.extend import check_arguments

from .arrays import Cells, Length, check_cells

CORNERS = ("corner", "right corner", "far corner", "left corner")


@check_arguments
def airbag(comm: MPI.Intracomm, edge: Length, cells: Cells) -> Mesh:
    """Make two squares [-edge/2, edge/2]² in z = 0, joined along their edges: a flat airbag.

    Nodes inside the sheets coincide in space and differ in topology; normals point outwards.  The
    triangles alternate, so that no triangle has all its nodes on the seam, where it could not open.
    Groups: "top", "bottom", "seam", and the points `CORNERS`.  Collective.

    Args:
        edge: length of the sides [m].
        cells: edges of triangles along a side, at least 1, rounded to an even number of at least 2.

    Raises:
        InputError: the edge is not positive, or there are no cells.
    """
    check_cells("airbag", 4 * cells**2)
    # The pattern is symmetric for even numbers only.
    cells = 2 * max(round(cells / 2), 1)

    def build(model: Any) -> None:
        geo = model.geo
        a = edge / 2
        corners = [
            geo.addPoint(-a, -a, 0),
            geo.addPoint(a, -a, 0),
            geo.addPoint(a, a, 0),
            geo.addPoint(-a, a, 0),
        ]
        lines = []
        for i in range(4):
            following = corners[(i + 1) % 4]
            lines.append(geo.addLine(corners[i], following))
        # Two surfaces with the same lines share the nodes of the seam only.
        loop = geo.addCurveLoop(lines)
        sheets = [geo.addPlaneSurface([loop]) for _ in range(2)]
        for line in lines:
            geo.mesh.setTransfiniteCurve(line, cells + 1)
        for sheet in sheets:
            geo.mesh.setTransfiniteSurface(sheet, "AlternateLeft")
        geo.synchronize()
        for name, sheet in zip(("top", "bottom"), sheets, strict=True):
            model.addPhysicalGroup(2, [sheet], name=name)
        model.addPhysicalGroup(1, lines, name="seam")
        for name, point in zip(CORNERS, corners, strict=True):
            model.addPhysicalGroup(0, [point], name=name)
        model.mesh.generate(2)
        # The lower sheet is seen from below: its normals point outwards, too.
        model.mesh.reverse([(2, sheets[1])])

    return gmsh_mesh(build, comm)
