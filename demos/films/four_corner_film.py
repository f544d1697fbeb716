"""The form of a film between four corners and edge cables: a saddle.

A film with the isotropic tension n0 = 10 N/m spans a square of 1 m, two opposite corners of which
are 0.4 m high.  Its edges are cables with the force N.  No elastic stiffness is involved: the form
is the one in which these forces are in equilibrium, with

    mean curvature 0 of the film,    curvature n0/N of the cables in the tangent plane of the film.

    ./gossamer demo four_corner_film
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import draw_film, new_figure, save
from gossamer_fx.extend import Array, geometry_nodes
from gossamer_fx.meshes.sheet import CORNERS, EDGES, sheet

TENSION = 10.0  # n0 of the film [N/m]
HEIGHT = 0.4  # of two opposite corners [m]
# Stiffness and density have no part in the form; they are required by the law.
FILM = gx.analysis.Prestress(E=1e9, nu=0.3, density=1000.0, thickness=1e-5, tension=TENSION)


def main(
    force: float = 20.0,
    cells: int = 12,
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Find the form for edge cables with the `force` [N]; compare the radius of a cable with
    force/tension.

    Args:
        force: of the edge cables [N].
        cells: along an edge; each has four triangles.
        output: folder for a picture; None: no picture.
        comm: communicator of the mesh.
    """
    start_time = time.process_time()
    film = gx.Membrane(sheet(comm, cells, cells, crossed=True), FILM)
    # The first shape is a hyperbolic paraboloid through the four corners.
    points = film.space.mesh.geometry.x
    x = points[:, 0]
    y = points[:, 1]
    points[:, 2] = HEIGHT * (x + y - 2 * x * y)

    def scene() -> gx.Scene:
        supports = [gx.Fixed(film, corner) for corner in CORNERS]
        cables = [gx.analysis.EdgeCable(film, edge, force=force) for edge in EDGES]
        return gx.Scene(film, *supports, *cables)

    found = gx.analysis.find_form(film, scene)
    nodes = film.nodes("bottom")
    owned_nodes = nodes[nodes < film.space.dofmap.index_map.size_local]
    cable = np.concatenate(comm.allgather(points[owned_nodes]))
    radius = radius_of_arc(cable[cable[:, 0].argsort()])
    if output is not None and comm.size == 1:
        draw(points, geometry_nodes(film.space.mesh), Path(output) / "four_corner_film.png")
    return {
        "radius of a cable [m]": radius,
        "force/tension [m]": force / TENSION,
        "residual": found.residual,
        "seconds": time.process_time() - start_time,
    }


def radius_of_arc(x: Array) -> float:
    """Radius of the circle through the ends and the middle of a line of points (n, 3)."""
    a = x[0]
    b = x[len(x) // 2]
    c = x[-1]
    area = np.linalg.norm(np.cross(b - a, c - a)) / 2
    sides = np.linalg.norm([b - a, c - b, a - c], axis=1)
    return float(sides.prod() / (4 * area))


def draw(x: Array, cells: Array, path: Path) -> None:
    """Draw the film with points x (n, 3) and triangles `cells` as PNG."""
    figure = new_figure(9.0, 6.0)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d")
    draw_film(axes, x[cells], colour="#8cb8e0", view=(40.0, -20.0), zoom=1.1)
    save(figure, path)


if __name__ == "__main__":
    print_figures(main(cells=24, output="out/four_corner_film"))
