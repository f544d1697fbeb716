"""Draw the ready meshes with their groups, for the page `docs/howto/meshes.md`:

./gossamer python tools/mesh_pictures.py docs/static/meshes.png
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from mpi4py import MPI
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

import gossamer_fx as gx
from gossamer_fx.core.forms.backend import geometry_nodes
from gossamer_fx.core.mesh.quality import area_vectors
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.arc_polygon import arc_polygon
from gossamer_fx.meshes.disc import quarter_disc, ring
from gossamer_fx.meshes.revolved import balloon, bulkhead_tube, dish, hull, torus
from gossamer_fx.meshes.sheet import crossed_sheet
from gossamer_fx.meshes.sphere import sphere
from gossamer_fx.meshes.tube import flat_tube
from gossamer_fx.meshes.tube_section import cylinder

ALONE = MPI.COMM_SELF
TRIANGLE = [(0.0, 0.0), (1.0, 0.0), (0.5, 0.87)]
QUADRANT = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]

# What is drawn, by the calls that the page shows.
MESHES: dict[str, Callable[[], gx.Mesh]] = {
    "torus": lambda: torus(ALONE, 1.0, 0.25, 40, 12),
    "hull": lambda: hull(ALONE, 0.4, 1.0, 5),
    "dish": lambda: dish(ALONE, 1.0, 0.6, 8),
    "balloon": lambda: balloon(ALONE, 1.0, 8, 4),
    "bulkhead_tube": lambda: bulkhead_tube(ALONE, 0.3, 1.8, 4, 3).wall,
    "its bulkhead": lambda: bulkhead_tube(ALONE, 0.3, 1.8, 4, 3).bulkheads[0],
    "arc_polygon, triangle": lambda: arc_polygon(ALONE, TRIANGLE, 0.1, 0.08),
    "arc_polygon, quadrant": lambda: arc_polygon(ALONE, QUADRANT, 0.1, 0.09),
    "ring": lambda: ring(ALONE, 0.3, 1.0, 6, 40),
    "quarter_disc": lambda: quarter_disc(ALONE, 10),
    "sphere": lambda: sphere(ALONE, 1.0, 20),
    "cylinder, capped": lambda: cylinder(ALONE, 0.4, 1.2, 20, 10, capped=True),
    "flat_tube": lambda: flat_tube(ALONE, 1.5, 0.4, 6, 3),
    "airbag": lambda: airbag(ALONE, 1.0, 8),
    "crossed_sheet": lambda: crossed_sheet(ALONE, 6, 4, 1.5, 1.0),
}

SURFACE_COLOURS = ("#cfe2f3", "#fce5cd", "#d9ead3", "#ead1dc", "#fff2cc", "#d9d2e9")
CURVE_COLOURS = ("#c0392b", "#1f5fa8", "#2e7d32", "#8e44ad", "#d35400", "#00838f")


def draw(axes: Axes3D, mesh: gx.Mesh, title: str) -> None:
    """Triangles coloured by group, curves of groups that face the viewer as thick lines, points as
    dots."""
    vertices = mesh.domain.geometry.x
    nodes = _geometry_nodes(mesh)
    corners = vertices[geometry_nodes(mesh.domain)]
    colours = np.full(len(corners), SURFACE_COLOURS[0], dtype=object)
    surfaces = [name for name, (dim, _) in mesh.groups.items() if dim == 2 and name != "film"]
    for k, name in enumerate(surfaces):
        colours[mesh.groups[name][1]] = SURFACE_COLOURS[k % len(SURFACE_COLOURS)]
    triangles = Poly3DCollection(
        corners, facecolors=list(colours), edgecolors="#777777", linewidths=0.25
    )
    axes.add_collection3d(triangles)
    # Lines and dots are drawn over all triangles: those behind are left out.
    axes.computed_zorder = False
    is_flat = _is_flat(mesh)
    elevation = 90 if is_flat else 28
    azimuth = -90 if is_flat else -60
    axes.view_init(elev=elevation, azim=azimuth)
    faces_viewer = _faces(mesh, math.radians(elevation), math.radians(azimuth))
    curves = [name for name, (dim, _) in mesh.groups.items() if dim == 1]
    for k, name in enumerate(curves):
        ends = mesh.domain.topology.connectivity(1, 0).array.reshape(-1, 2)[mesh.groups[name][1]]
        segments = nodes[ends]
        shown = vertices[segments[faces_viewer[segments].all(axis=1)]]
        colour = CURVE_COLOURS[k % len(CURVE_COLOURS)]
        axes.add_collection3d(Line3DCollection(shown, colors=colour, linewidths=1.8, zorder=2))
    for dim, entities in mesh.groups.values():
        if dim == 0 and faces_viewer[nodes[entities]].all():
            x, y, z = vertices[nodes[entities]].T
            axes.scatter(x, y, z, color="black", s=14, depthshade=False, zorder=3)
    low = vertices.min(axis=0)
    high = vertices.max(axis=0)
    half = 0.5 * float((high - low).max())
    for k, set_limits in enumerate((axes.set_xlim, axes.set_ylim, axes.set_zlim)):
        middle = (low[k] + high[k]) / 2
        set_limits(middle - half, middle + half)
    axes.set_box_aspect((1, 1, 1), zoom=1.25)
    axes.set_axis_off()
    axes.set_title(title, fontsize=9, y=1.0)


def _is_flat(mesh: gx.Mesh) -> bool:
    """Whether a mesh is in a plane of one z."""
    heights = mesh.domain.geometry.x[:, 2]
    return float(heights.max() - heights.min()) < 1e-9


def _faces(mesh: gx.Mesh, elevation: float, azimuth: float) -> npt.NDArray[np.bool_]:
    """Whether each vertex of a closed mesh faces the viewer; of an open one all do."""
    vertices = mesh.domain.geometry.x
    if (mesh.edges.count == 1).any() or _is_flat(mesh):
        return np.ones(len(vertices), dtype=bool)
    cells = geometry_nodes(mesh.domain)
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, cells[:, k], area_vectors(vertices[cells]))
    across = math.cos(elevation)
    viewer = (across * math.cos(azimuth), across * math.sin(azimuth), math.sin(elevation))
    return normals @ viewer > 0


def _geometry_nodes(mesh: gx.Mesh) -> npt.NDArray[np.int64]:
    """Number of the geometry node of each vertex."""
    topology = mesh.domain.topology
    topology.create_connectivity(1, 0)
    cells = topology.connectivity(2, 0).array.reshape(-1, 3)
    nodes = np.zeros(topology.index_map(0).size_local, dtype=np.int64)
    nodes[cells] = geometry_nodes(mesh.domain)[:, :3]
    return nodes


def main(path: Path) -> None:
    """Draw all meshes into one picture."""
    figure = Figure(figsize=(11.0, 6.8))
    for k, (title, make) in enumerate(MESHES.items(), start=1):
        axes = figure.add_subplot(3, 5, k, projection="3d")
        draw(axes, make(), title)
    figure.subplots_adjust(left=0, right=1, bottom=0, top=0.96, wspace=0, hspace=0.08)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
