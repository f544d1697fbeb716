"""Where a sail that is pulled at its corners wrinkles least at equal mass: the thickness of every
cell is a parameter.

A square film of 0.5 m is pulled by ropes, at two opposite corners more than at the others, so that
it wrinkles.  The measure of wrinkling is the square of the compressive strain that the tension
field leaves,

    J = ∫ max(-(γ2 + ν γ1), 0)² dA,    γ1 ≥ γ2 the principal strains.

`gx.analysis.minimise` changes the thickness between a half and three times its mean, at constant
mass.

    ./gossamer demo sail_thickness
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import new_figure, save
from gossamer_fx.extend import Array, geometry_nodes, half_trace_and_radius
from meshes.sheet import CORNERS, crossed_sheet

SIDE = 0.5  # m
THICKNESS = 25e-6  # m
ARM = 0.1  # m
LAW = gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=THICKNESS, residual_stiffness=1e-3)
PULLS = (10.0, 2.0, 10.0, 2.0)  # N, at the corners in their order around the square
ROPE = 2e4  # N/m


def sail(comm: MPI.Comm, cells: int) -> tuple[gx.Membrane, gx.Equilibrium]:
    """The film with a field of thickness, and its equilibrium under the pulls."""
    film = gx.Membrane(
        crossed_sheet(comm, cells, cells, SIDE, SIDE),
        LAW,
        properties={"thickness": lambda x: np.full(x.shape[1], THICKNESS)},
    )
    ends = []
    lengths = []
    corners = ((0.0, 0.0), (SIDE, 0.0), (SIDE, SIDE), (0.0, SIDE))
    for name, (x, y), pull in zip(CORNERS, corners, PULLS, strict=True):
        outwards = np.array([x, y, 0.0]) - SIDE / 2 * np.array([1.0, 1.0, 0.0])
        anchor = np.array([x, y, 0.0]) + ARM * outwards / np.linalg.norm(outwards)
        ends.append((film.port(name), gx.Ground(tuple(anchor.tolist()))))
        # A little more than the stretch of the film at the corners is taken up by the ropes.
        lengths.append(ARM - pull / ROPE)
    ropes = gx.connectors.RopeBundle(ends, stiffness=ROPE, lengths=lengths)
    plane = gx.Fixed(film, "film", components=(2,))
    return film, gx.Equilibrium(gx.Scene(ropes, plane), gx.analysis.Continuation(tolerance=1e-10))


def main(
    cells: int = 10,
    iterations: int = 40,
    output: str | Path | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Minimise; with `output`, a folder, a picture of both sails."""
    began = time.process_time()
    film, equilibrium = sail(comm, cells)

    def density(q: Any) -> Any:
        h, r = half_trace_and_radius(film.measure(q))
        return ufl.max_value(-((h - r) + film.constants.nu * (h + r)), 0.0) ** 2

    wrinkling = gx.analysis.Integral(film, lambda q: density(q) * film.dx, unit="m²")
    mass = gx.analysis.Integral(
        film,
        lambda q: film.constants.density * film.constants.thickness * film.dx,
        unit="kg",
    )
    equilibrium.find()
    start = mass(equilibrium)
    before = cell_values(film, equilibrium, density)
    found = gx.analysis.minimise(
        equilibrium,
        of=wrinkling,
        by=["film.thickness"],
        bounds={"film.thickness": (THICKNESS / 2, 3 * THICKNESS)},
        limits=[gx.analysis.Limit(mass, low=start, high=start)],
        iterations=iterations,
        tolerance=1e-5,
    )
    if output is not None and comm.size == 1:
        after = cell_values(film, equilibrium, density)
        thickness = found.parameters["film.thickness"]
        draw(film, before, after, thickness, Path(output) / "sail_thickness.png")
    return {
        "wrinkling over that of the even sail": found.value / found.values[0],
        "mass over that of the even sail": mass(equilibrium) / start,
        "thicknesses": len(found.parameters["film.thickness"]),
        "iterations": found.iterations,
        "seconds": time.process_time() - began,
    }


def cell_values(film: gx.Membrane, equilibrium: gx.Equilibrium, density: Any) -> Array:
    """Roots of the mean of a density in each cell: compressive strains."""
    from dolfinx import fem

    q = equilibrium.system.unknowns.state[film].function()
    thickness = film.constants.thickness
    values = fem.Function(thickness.function_space)
    form = fem.form(density(q) * ufl.TestFunction(thickness.function_space) * film.dx)
    area = fem.form(ufl.TestFunction(thickness.function_space) * film.dx)
    values.x.array[:] = fem.assemble_vector(form).array / fem.assemble_vector(area).array
    return np.sqrt(np.asarray(values.x.array))


def draw(film: gx.Membrane, before: Array, after: Array, thickness: Array, path: Path) -> None:
    """Compressive strain of both sails, and the thickness that was found."""
    geometry = film.mesh.domain.geometry
    x = geometry.x[:, 0]
    y = geometry.x[:, 1]
    cells = geometry_nodes(film.mesh.domain)
    figure = new_figure(11.0, 3.6)
    panels = (
        ("compressive strain, even thickness [1e-3]", 1e3 * before, 1e3 * before.max()),
        ("the same, thickness optimised [1e-3]", 1e3 * after, 1e3 * before.max()),
        ("thickness [µm]", 1e6 * thickness, 1e6 * thickness.max()),
    )
    for axes, (title, values, largest) in zip(figure.subplots(1, 3), panels, strict=True):
        drawn = axes.tripcolor(x, y, cells, facecolors=values, vmin=0, vmax=largest)
        figure.colorbar(drawn, ax=axes)
        axes.set_title(title, fontsize=9)
        axes.set_aspect("equal")
        axes.set_axis_off()
    save(figure, path)


if __name__ == "__main__":
    print_figures(main(output="out/sail_thickness"))
