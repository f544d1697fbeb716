"""The form of a film between four corners and edge cables: a saddle.

A film of the tension n0 = 10 N/m in all directions spans a square of 1 m whose opposite corners stand 0.4 m high; its
edges are cables of the force N.  Nothing is stiff: the form is the one in which these forces are in equilibrium, with

    mean curvature 0 of the film,    curvature n0/N of the cables in the tangent plane of the film.

    ./gossamer demo four_corner_film
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.sheet import CORNERS, EDGES, sheet
from gossamer_fx.model.body import Array

TENSION, HEIGHT = 10.0, 0.4  # N/m, m
FILM = gx.analysis.Prestress(E=1e9, nu=0.3, density=1000.0, thickness=1e-5, tension=TENSION)


def main(
    force: float = 20.0,
    cells: int = 12,
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Form for cables of `force` [N]; with `output`, a folder, its picture."""
    began = time.process_time()
    film = gx.Membrane(sheet(comm, cells, cells, crossed=True), FILM)
    X = film.space.mesh.geometry.x
    X[:, 2] = HEIGHT * (X[:, 0] + X[:, 1] - 2 * X[:, 0] * X[:, 1])

    def scene() -> gx.Scene:
        held = [gx.Fixed(film, corner) for corner in CORNERS]
        return gx.Scene(
            film, *held, *(gx.analysis.EdgeCable(film, edge, force=force) for edge in EDGES)
        )

    found = gx.analysis.find_form(film, scene, change=2e-4)
    nodes = film.nodes("bottom")
    cable = np.concatenate(comm.allgather(X[nodes[nodes < film.space.dofmap.index_map.size_local]]))
    radius = radius_of_arc(cable[cable[:, 0].argsort()])
    if output is not None and comm.size == 1:
        draw(X, film.space.mesh.geometry.dofmap, Path(output) / "four_corner_film.png")
    return {
        "radius of a cable [m]": radius,
        "force/tension [m]": force / TENSION,
        "residual": found.residual,
        "seconds": time.process_time() - began,
    }


def radius_of_arc(x: Array) -> float:
    """Radius of the circle through the ends and the middle of a line of points (n, 3)."""
    a, b, c = x[0], x[len(x) // 2], x[-1]
    area = np.linalg.norm(np.cross(b - a, c - a)) / 2
    return float(np.linalg.norm(b - a) * np.linalg.norm(c - b) * np.linalg.norm(a - c) / (4 * area))


def draw(x: Array, cells: Array, path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4.2), dpi=100)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    axes.plot_trisurf(
        *x.T, triangles=cells, color=(0.55, 0.72, 0.88), edgecolor="white", linewidth=0.3
    )
    axes.set_proj_type("ortho")
    axes.set_box_aspect((1, 1, HEIGHT), zoom=1.1)
    axes.view_init(40, -20)
    axes.set_axis_off()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, bbox_inches="tight")


if __name__ == "__main__":
    for key, value in main(output="out/four_corner_film").items():
        if MPI.COMM_WORLD.rank == 0:
            print(f"{key:24} {value:.6g}")
